#include "backends/layout/march_cost.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <queue>
#include <utility>

#include "backends/by_precision.h"
#include "backends/layout/rounding.h"

namespace voxspring::layout {
namespace {

constexpr int quarters = 4;  // each multiprocessor has four quarters with one scheduler each

// Where nothing else is said, the constants of the model are fitted to measured times of one NVIDIA H200;
// march_cost_test.cpp lists these times beside the predictions. Times other than a launch's are in cycles, so
// they also hold at other clocks.

/// The time of a launch in a CUDA graph, measured with an empty kernel. It is the same for all plans.
constexpr double launch_seconds = 0.66e-6;
/// Cycles from the start of a block to its first window: barriers, and a copy's way to memory and back.
constexpr double start_latency = 1200;
/// Bytes per cycle that a multiprocessor gets from memory while all multiprocessors fill their first windows
/// (planes of a tile in shared memory).
constexpr double start_bytes_per_cycle = 20;
/// The share of the memory's peak rate that a pass over arrays larger than any cache reaches (4.28 of 4.8
/// TB/s).
constexpr double copy_share = 0.89;
/// Instructions and memory slow each other down if both take about as long: with times a and b and this
/// exponent p, a step takes (a^p + b^p)^(1/p). For the box of 512^3, a and b are 1.21 ms and 1.13 ms, and the
/// step took 1.30 ms.
constexpr double overlap_exponent = 5;

/// Cycles that one warp of a block takes to start the copy engine's copies of a plane.
constexpr double copy_cycles = 100;
/// Cycles that a thread takes to start a copy of 16 bytes: one per instruction, estimated from the source.
constexpr double async_copy_cycles = 16;

/// Cycles per warp and plane. In float32 `full` is the number of instructions of a warp without masks,
/// counted in the machine code of sm_90. In float64, whose pipe takes two cycles per instruction, `full` is
/// the time for which the profiler shows this pipe busy. `masked` and `wait` are fitted to measured times.
MarchRates rates_of(Precision precision, Formulation formulation) {
    const bool increments = by_increments(formulation);
    constexpr double idle = 100;
    MarchRates rates{};
    if (precision == Precision::float32) {
        rates = increments ? MarchRates{1650, 1370, 1500, idle} : MarchRates{1180, 870, 950, idle};
    } else {
        rates = increments ? MarchRates{3700, 1680, 1840, idle} : MarchRates{2300, 1066, 1170, idle};
    }
    // In the formulation `displacement` a thread subtracts rest offsets as well: one component per face
    // spring and two per edge spring. These are 92 with two rows, and 53 with the one row of float64.
    if (formulation == Formulation::displacement) {
        const double cycles = precision == Precision::float32 ? 92 : 2 * 53;
        rates.full += cycles;
        rates.masked += cycles;
    }
    return rates;
}

/// The factor by which a tile with 16 lanes per row costs more: the two halves of a warp then read rows that
/// share banks of shared memory.
constexpr double narrow_share = 1.1;

}  // namespace

const std::vector<MarchTile>& march_tiles(Precision precision) {
    // With two rows, a thread evaluates 13.5 springs per particle, with one row 15.5. In float64 a thread has
    // registers for one row only.
    static const std::vector<MarchTile> of_float32 = {
        {"128x20", {2, 32, 2, 10, 4, 2}, 1}, {"64x16", {2, 32, 1, 8, 4, 3}, 2},
        {"64x8", {2, 32, 1, 4, 3, 2}, 5},    {"32x20", {2, 16, 1, 5, 3, 2}, 4},
        {"64x20", {2, 32, 1, 10, 4, 2}, 2},  {"128x16", {2, 32, 2, 8, 4, 3}, 1}};
    static const std::vector<MarchTile> of_float64 = {{"64x8", {1, 32, 1, 8, 4, 3}, 2},
                                                      {"64x4", {1, 32, 1, 4, 3, 2}, 4},
                                                      {"128x8", {1, 32, 2, 8, 4, 3}, 1}};
    return precision == Precision::float32 ? of_float32 : of_float64;
}

MarchTile march_tile(const std::string& name, Precision precision) {
    const std::vector<MarchTile>& tiles = march_tiles(precision);
    const auto found =
        std::find_if(tiles.begin(), tiles.end(), [&](const MarchTile& tile) { return tile.name == name; });
    return found == tiles.end() ? MarchTile{} : *found;
}

int resident_blocks(const MarchTile& tile, Precision precision, const MarchDevice& device) {
    const auto bytes = std::size_t(tile.shape.shared_bytes(int(scalar_bytes(precision))));
    if (bytes > device.block_shared_bytes) return 0;
    const auto fit = int(device.shared_bytes / (bytes + device.reserved_bytes));
    // If threads copy the windows, they need 128 registers each, or some registers are spilled. If the copy
    // engine does, the number of registers per thread only has to let `tile.blocks` blocks share a
    // multiprocessor.
    constexpr int registers = 65536, registers_to_copy = 128;
    const int most = device.tensor_copies
                         ? tile.blocks
                         : std::max(1, registers / (registers_to_copy * tile.shape.threads()));
    return std::min({tile.blocks, most, fit, device.threads / tile.shape.threads()});
}

MarchRates march_rates(const MarchTile& tile, Precision precision, Formulation formulation) {
    MarchRates rates = rates_of(precision, formulation);
    const double share = tile.shape.lanes < 32 ? narrow_share : 1;
    rates.full *= share;
    rates.masked *= share;
    return rates;
}

MarchCost::MarchCost(const MarchTile& tile, Precision precision, Formulation formulation,
                     const MarchDevice& device)
    : rates_(march_rates(tile, precision, formulation)),
      device_(device),
      warps_(tile.shape.warps()),
      resident_(std::max(1, resident_blocks(tile, precision, device))) {
    const int real = int(scalar_bytes(precision));
    if (!device.tensor_copies) {
        const int bytes_at_once = 16 * tile.shape.threads();
        const int copies = units_of(3 * tile.shape.axis(real) * real, bytes_at_once) +
                           units_of(3 * tile.shape.before_axis() * real, bytes_at_once);
        for (double* cycles : {&rates_.full, &rates_.masked, &rates_.idle})
            *cycles += async_copy_cycles * copies;
    }
    start_bytes_ = (tile.shape.planes - 1) * tile.shape.window_bytes(real) +
                   (tile.shape.previous_windows - 1) * tile.shape.before_bytes(real);
}

double MarchCost::start_seconds(std::size_t items) const {
    const double first = double(std::min(items, std::size_t(slots()))) / device_.multiprocessors;
    return (start_latency + first * start_bytes_ / start_bytes_per_cycle) / device_.hertz;
}

double MarchCost::plane_seconds(double cycles, int count) const {
    const int warps = count * warps_;
    // A warp runs on one quarter of the multiprocessor, and the quarter with the most warps decides the time.
    // So the number of warps is rounded up to a multiple of four.
    const double uneven = double(units_of(warps, quarters) * quarters) / warps;
    const double asking = device_.tensor_copies ? copy_cycles : 0;
    return (rates_.wait + count * asking + uneven * cycles / quarters) / device_.hertz;
}

/// A multiprocessor and the items that share it.
class MarchCost::Shared {
public:
    explicit Shared(const MarchCost& cost, double start) : cost_(&cost), start_(start) {}

    bool empty() const { return items_.empty(); }
    bool has_room() const { return int(items_.size()) < cost_->resident(); }
    void add(const MarchLoad& load) { items_.push_back({&load, 1}); }
    /// The time when the first of the items will be done, if no other item joins them.
    double next() const {
        double first = std::numeric_limits<double>::infinity();
        for (const Item& item : items_) first = std::min(first, item.left * seconds_of(item));
        return now_ + first;
    }
    /// Advances all items to the time `until`, and removes those that are done.
    void advance(double until) {
        constexpr double none = 1e-9;  // tolerance for rounding
        std::vector<Item> rest;
        for (const Item& item : items_) {
            const double left = item.left - (until - now_) / seconds_of(item);
            if (left > none) rest.push_back({item.load, left});
        }
        items_ = std::move(rest);
        now_ = until;
    }

private:
    struct Item {
        const MarchLoad* load;
        double left;  ///< remaining fraction of the item
    };
    double seconds_of(const Item& item) const {
        double cycles = 0;
        for (const Item& other : items_) cycles += other.load->cycles / other.load->planes;
        return start_ + item.load->planes * cost_->plane_seconds(cycles, int(items_.size()));
    }

    const MarchCost* cost_;
    double start_;
    std::vector<Item> items_;
    double now_ = 0;
};

double MarchCost::work_seconds(const std::vector<MarchLoad>& loads) const {
    std::vector<Shared> all(std::size_t(device_.multiprocessors), Shared(*this, start_seconds(loads.size())));
    std::size_t given = 0;
    for (int round = 0; round < resident_; ++round) {
        for (Shared& one : all) {
            if (given < loads.size()) one.add(loads[given++]);
        }
    }
    using Event = std::pair<double, std::size_t>;
    std::priority_queue<Event, std::vector<Event>, std::greater<>> events;
    for (std::size_t n = 0; n < all.size(); ++n) {
        if (!all[n].empty()) events.emplace(all[n].next(), n);
    }
    double last = 0;
    while (!events.empty()) {
        const auto [when, n] = events.top();
        events.pop();
        Shared& one = all[n];
        one.advance(when);
        last = when;
        while (given < loads.size() && one.has_room()) one.add(loads[given++]);
        if (!one.empty()) events.emplace(one.next(), n);
    }
    return last;
}

double MarchCost::step_seconds(const std::vector<MarchLoad>& loads, double bytes, double state_bytes) const {
    const double work = work_seconds(loads);
    const bool cached = state_bytes <= device_.cache_bytes;
    const double memory = cached ? 0 : bytes / (copy_share * device_.bytes_per_second);
    return launch_seconds + std::pow(std::pow(work, overlap_exponent) + std::pow(memory, overlap_exponent),
                                     1 / overlap_exponent);
}

}  // namespace voxspring::layout
