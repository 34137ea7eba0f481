#include "backends/layout/march_plan.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "backends/layout/march_columns.h"
#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"

namespace voxspring::cuda {
namespace {

constexpr int max_rows = 2;
/// A plan has at most so many items more than there are runs of planes: a few times the blocks that the
/// largest cards run at once.
constexpr std::size_t max_cuts = 4096;

/// Which bits of a thread's word stand for the springs of its particles in the plane that arrived (1) and the
/// one before (0), by row, column and mask.
class PlaneMaskTable {
public:
    explicit PlaneMaskTable(int rows) : rows_(rows) {
        if (rows == 1) {
            visit_springs<1, true>(*this);
        } else {
            visit_springs<max_rows, true>(*this);
        }
        for (std::size_t place = 0; place < places; ++place) {
            for (std::uint32_t mask = 0; mask < half_size; ++mask) {
                words_[0][place][mask] = word_of(place, mask);
                words_[1][place][mask] = word_of(place, mask << half_bits);
            }
        }
    }

    void both(int bit, int z, int r, int c, int z2, int r2, int c2) {
        half(bit, z, r, c, z2, r2, c2);
        half(bit, z2, r2, c2, z, r, c);
    }
    void half(int bit, int z, int r, int c, int z2, int r2, int c2) {
        const glm::ivec3 offset(c2 - c, r2 - r, z2 - z);
        for (const Direction& direction : directions()) {
            if (direction.offset == offset)
                bits_[index(z, r, c)][std::size_t(direction.bit)] |= std::uint64_t(1) << bit;
        }
    }

    /// Of a particle whose neighbours are `mask`, in the word of its own plane and in that of the next.
    std::uint64_t own(int r, int c, std::uint32_t mask) const { return of(1, r, c, mask); }
    std::uint64_t next(int r, int c, std::uint32_t mask) const {
        std::uint64_t word = of(0, r, c, mask) | std::uint64_t(1) << stored(r);
        if ((mask & PINNED_BIT) == 0) word |= std::uint64_t(1) << moves(r, c);
        return word;
    }

private:
    // The 18 bits of faces and edges in two halves.
    static constexpr int half_bits = 9;
    static constexpr std::uint32_t half_size = 1U << half_bits;
    static_assert((FACE_BITS | EDGE_BITS) == (1U << 2 * half_bits) - 1);
    static constexpr std::size_t places = std::size_t(2) * max_rows * 2;

    static std::size_t index(int z, int r, int c) {
        return (std::size_t(z) * max_rows + std::size_t(r)) * 2 + std::size_t(c);
    }
    int moves(int r, int c) const {
        return rows_ == 1 ? PlaneMask<1>::moves(r, c) : PlaneMask<max_rows>::moves(r, c);
    }
    int stored(int r) const { return rows_ == 1 ? PlaneMask<1>::stored(r) : PlaneMask<max_rows>::stored(r); }
    std::uint64_t word_of(std::size_t place, std::uint32_t mask) const {
        std::uint64_t word = 0;
        for (std::uint32_t bits = mask; bits != 0; bits &= bits - 1)
            word |= bits_[place][std::size_t(std::countr_zero(bits))];
        return word;
    }
    std::uint64_t of(int z, int r, int c, std::uint32_t mask) const {
        const std::size_t place = index(z, r, c);
        return words_[0][place][mask % half_size] | words_[1][place][mask >> half_bits & (half_size - 1)];
    }

    int rows_;
    std::array<std::array<std::uint64_t, neighbour_count>, places> bits_{};
    std::array<std::array<std::array<std::uint64_t, half_size>, places>, 2> words_{};
};

/// Planes `begin` to `end` (exclusive) of a column.
struct Run {
    int column, begin, end;
    int length() const { return end - begin; }
};

/// Runs of planes that hold a particle.
std::vector<Run> runs_of(const MarchColumns& columns) {
    std::vector<Run> runs;
    for (int column = 0; column < columns.count(); ++column) {
        bool open = false;
        for (int z = 0; z < columns.planes(); ++z) {
            const bool active = columns.at(column, z).active != 0;
            if (active && !open) runs.push_back({column, z, z});
            if (active) runs.back().end = z + 1;
            open = active;
        }
    }
    return runs;
}

/// Cut where for long the same warps have full stencils: a plane of pins would otherwise leave masks to all
/// above it.
std::vector<Run> cut_by_full_stencils(const MarchColumns& columns, const std::vector<Run>& runs) {
    // What an item costs beside its planes is three planes' time, and masks cost an eighth.
    constexpr int long_enough = 32;
    std::vector<Run> cut;
    for (const Run& run : runs) {
        std::vector<Run> stretches;
        for (int z = run.begin; z < run.end; ++z) {
            if (z == run.begin || columns.at(run.column, z).full != columns.at(run.column, z - 1).full)
                stretches.push_back({run.column, z, z});
            stretches.back().end = z + 1;
        }
        for (std::size_t n = 0; n < stretches.size(); ++n) {
            const bool joined =
                n > 0 && stretches[n].length() < long_enough && stretches[n - 1].length() < long_enough;
            if (joined) {
                cut.back().end = stretches[n].end;
            } else {
                cut.push_back(stretches[n]);
            }
        }
    }
    return cut;
}

/// A way to cut a body into items of one tile, and its cost.
class Candidates {
public:
    Candidates(const MarchCells& cells, const MarchTile& tile, Precision precision, Formulation formulation,
               const MarchDevice& device)
        : columns_(cells, tile.shape),
          cost_(tile, precision, formulation, device),
          multiprocessors_(std::size_t(device.multiprocessors)),
          lattice_(&cells.lattice()),
          increments_(by_increments(formulation)),
          real_(precision == Precision::float32 ? sizeof(float) : sizeof(double)),
          cycles_(std::size_t(columns_.count()) * std::size_t(columns_.planes())) {
        const auto count = std::ptrdiff_t(columns_.count());
#pragma omp parallel for
        for (std::ptrdiff_t column = 0; column < count; ++column) {
            for (int z = 0; z < columns_.planes(); ++z)
                cycles_[index(int(column), z)] =
                    float(count_cycles(int(column), z, columns_.at(int(column), z).full));
        }
    }

    const MarchColumns& columns() const { return columns_; }
    double seconds() const { return seconds_; }
    const std::vector<Run>& best() const { return best_; }

    /// Tries them all.
    void search() {
        const std::vector<Run> runs = runs_of(columns_);
        try_runs(runs);
        const std::vector<Run> cut = cut_by_full_stencils(columns_, runs);
        if (cut.size() > runs.size()) try_runs(cut);
    }

private:
    /// What items cost a block, beside others of the mean cost.
    struct Sharing {
        std::size_t slots;            ///< blocks that run at once
        double start, wait, a_cycle;  ///< seconds of an item, of a plane, of a cycle of its warps
    };

    void try_runs(const std::vector<Run>& runs) {
        try_equal_parts(runs);
        for (int count = 1; count <= cost_.resident(); ++count) try_equal_shares(runs, count);
    }

    /// Parts of the same length, which march over their columns at the same height: neighbours find each
    /// other's frames in the cache.
    void try_equal_parts(const std::vector<Run>& runs) {
        const std::size_t most = runs.size() + std::min(max_cuts, 4 * std::size_t(cost_.slots()));
        int longest = 1;
        for (const Run& run : runs) longest = std::max(longest, run.length());
        for (int parts = 1, before = 0; parts <= longest; ++parts) {
            const int length = units_of(longest, parts);
            if (length == before) continue;
            before = length;
            std::vector<Run> items;
            for (const Run& run : runs) {
                const int count = units_of(run.length(), length);
                for (int part = 0; part < count; ++part)
                    items.push_back({run.column, run.begin + run.length() * part / count,
                                     run.begin + run.length() * (part + 1) / count});
            }
            if (parts > 1 && items.size() > most) return;
            consider(std::move(items), true);
        }
    }

    /// Spans of equal cost that go on from column to column, for `count` blocks a multiprocessor. The longest
    /// parts are first, so that the device gives the rest of each span to the block that ends first.
    void try_equal_shares(const std::vector<Run>& runs, int count) {
        constexpr int trials = 8;
        const Sharing sharing = sharing_of(runs, count);
        // If cuts cost nothing.
        double least = 0;
        for (const Run& run : runs) least += seconds_of(run, sharing);
        least /= double(sharing.slots);
        double most = least;
        std::optional<std::vector<Run>> items;
        while (!items) items = deal_out(runs, most *= 2, sharing);
        for (int trial = 0; trial < trials; ++trial) {
            const double share = (least + most) / 2;
            if (auto fitting = deal_out(runs, share, sharing)) {
                most = share;
                items = std::move(fitting);
            } else {
                least = share;
            }
        }
        if (items->size() <= runs.size() + max_cuts) consider(std::move(*items), false);
    }

    /// Items such that those of each slot take `share` seconds at most, or nothing.
    std::optional<std::vector<Run>> deal_out(const std::vector<Run>& runs, double share,
                                             const Sharing& sharing) const {
        std::vector<Run> items;
        std::size_t used = 1;
        double left = share;
        for (const Run& run : runs) {
            int z = run.begin;
            while (z < run.end) {
                // The plane above an item arrives as well.
                double taken = sharing.start + plane_seconds(run.column, z, sharing);
                int end = z;
                while (end < run.end) {
                    const double more = plane_seconds(run.column, end + 1, sharing);
                    if (taken + more > left) break;
                    taken += more;
                    ++end;
                }
                if (end > z) {
                    items.push_back({run.column, z, end});
                    left -= taken;
                    z = end;
                } else if (left == share) {
                    return std::nullopt;
                }
                if (z == run.end) break;
                if (++used > sharing.slots) return std::nullopt;
                left = share;
            }
        }
        return items;
    }

    Sharing sharing_of(const std::vector<Run>& runs, int count) const {
        double cycles = 0, planes = 0;
        for (const Run& run : runs) {
            const MarchLoad load = load_of(run);
            cycles += load.cycles;
            planes += load.planes;
        }
        const std::size_t slots = multiprocessors_ * std::size_t(count);
        const double others = planes == 0 ? 0 : (count - 1) * cycles / planes;
        const double wait = cost_.plane_seconds(others, count);
        return {slots, cost_.start_seconds(slots), wait, cost_.plane_seconds(others + 1, count) - wait};
    }
    double plane_seconds(int column, int z, const Sharing& sharing) const {
        if (z >= columns_.planes()) return 0;
        return springs_of(z) * (sharing.wait + sharing.a_cycle * double(cycles_[index(column, z)]));
    }
    double seconds_of(const Run& run, const Sharing& sharing) const {
        double seconds = sharing.start;
        for (int z = run.begin; z <= run.end; ++z) seconds += plane_seconds(run.column, z, sharing);
        return seconds;
    }

    std::size_t index(int column, int z) const {
        return std::size_t(column) * std::size_t(columns_.planes()) + std::size_t(z);
    }
    /// Of the springs of a plane: the first of the lattice has those within it alone.
    static double springs_of(int z) { return z == 0 ? 0.5 : 1; }
    /// Cycles of all warps as plane z arrives, those of `full` without masks.
    double count_cycles(int column, int z, std::uint32_t full) const {
        std::uint32_t active = columns_.at(column, z).active;
        if (z > 0) active |= columns_.at(column, z - 1).active;
        const MarchRates& rates = cost_.rates();
        const int all = columns_.shape().warps(), at_work = std::popcount(active);
        const int without = std::popcount(active & full);
        return without * rates.full + (at_work - without) * rates.masked + (all - at_work) * rates.idle;
    }
    MarchLoad load_of(const Run& run) const {
        std::uint32_t full = ~0U;
        for (int z = run.begin; z < run.end; ++z) full &= columns_.at(run.column, z).full;
        MarchLoad load;
        for (int z = run.begin; z <= std::min(run.end, columns_.planes() - 1); ++z) {
            const bool same = columns_.at(run.column, z).full == full;
            load.planes += springs_of(z);
            load.cycles += springs_of(z) *
                           (same ? double(cycles_[index(run.column, z)]) : count_cycles(run.column, z, full));
        }
        return load;
    }

    /// Bytes of a plane's window and of what it overwrites. Half of a frame is still in the cache if the
    /// tiles around it march at the same height.
    double bytes_at(int column, int z, bool in_step) const {
        const MarchShape& shape = columns_.shape();
        const int margin = MarchShape::margin(real_);
        const double frame = in_step ? 0.5 : 1;
        const auto within = [](int begin, int end, int size) {
            return std::min(end, size) - std::max(begin, 0);
        };
        const int x = columns_.x(column), y = columns_.y(column);
        const double window = double(within(x - margin, x + shape.width() + margin, lattice_->dims.x)) *
                              within(y - 1, y + shape.height() + 1, lattice_->dims.y);
        const double own = double(within(x, x + shape.width(), lattice_->dims.x)) *
                           within(y, y + shape.height(), lattice_->dims.y);
        const double stored = double(std::popcount(columns_.at(column, z).active)) / shape.warps();
        return 3 * real_ * (own + frame * (window - own) + own * (1 + stored * (increments_ ? 2 : 1)));
    }
    double bytes_of(const Run& run, bool in_step) const {
        double bytes = 0;
        for (int z = run.begin; z < run.end; ++z) bytes += bytes_at(run.column, z, in_step);
        // The planes below and above, of which windows alone are fetched: a third or a quarter.
        const double window = bytes_at(run.column, run.begin, in_step) / (increments_ ? 4 : 3);
        return bytes + window * ((run.begin > 0 ? 1 : 0) + (run.end < columns_.planes() ? 1 : 0));
    }

    void consider(std::vector<Run> items, bool in_step) {
        std::vector<std::pair<MarchLoad, std::size_t>> order;
        double bytes = 0;
        for (std::size_t n = 0; n < items.size(); ++n) {
            order.emplace_back(load_of(items[n]), n);
            bytes += bytes_of(items[n], in_step);
        }
        // The dearest first, so that what is left at the end is short; else at the same height.
        std::stable_sort(order.begin(), order.end(), [&](const auto& a, const auto& b) {
            const double one = cost_.alone_seconds(a.first), other = cost_.alone_seconds(b.first);
            return one != other ? one > other : items[a.second].begin < items[b.second].begin;
        });
        std::vector<MarchLoad> loads;
        for (const auto& [load, n] : order) loads.push_back(load);
        const double state = double(lattice_->voxel_count()) * 3 * real_ * (increments_ ? 3 : 2);
        const double seconds = cost_.step_seconds(loads, bytes, state);
        if (!best_.empty() && seconds >= seconds_) return;
        seconds_ = seconds;
        best_.clear();
        for (const auto& [load, n] : order) best_.push_back(items[n]);
    }

    MarchColumns columns_;
    MarchCost cost_;
    std::size_t multiprocessors_;
    const Lattice* lattice_;
    bool increments_;
    int real_;
    std::vector<float> cycles_;  ///< of each plane of each column
    std::vector<Run> best_;
    double seconds_ = std::numeric_limits<double>::infinity();
};

/// Sets items and words of a plan.
class Writer {
public:
    Writer(const MarchCells& cells, const MarchShape& shape)
        : cells_(cells),
          shape_(shape),
          table_(shape.rows),
          thread_of_(std::size_t(shape.width() / 2 * rows())) {
        for (int thread = 0; thread < shape.threads(); ++thread)
            thread_of_[std::size_t(shape.row(thread) / shape.rows * (shape.width() / 2) +
                                   shape.column(thread) / 2)] = thread;
    }

    void write(const MarchColumns& columns, const std::vector<Run>& runs, MarchPlan& plan) const {
        const std::size_t all = (std::size_t(1) << shape_.warps()) - 1;
        std::size_t words = 0;
        for (const Run& run : runs) {
            MarchItem item{columns.x(run.column), columns.y(run.column), run.begin, run.end, 0, all};
            for (int z = run.begin; z < run.end; ++z) item.full_stencils &= columns.at(run.column, z).full;
            if (item.full_stencils != all) {
                item.words = words;
                words += std::size_t(run.length() + 1) * std::size_t(shape_.threads());
            }
            plan.items.push_back(item);
        }
        plan.words.resize(words);
        const auto count = std::ptrdiff_t(plan.items.size());
#pragma omp parallel for schedule(dynamic)
        for (std::ptrdiff_t n = 0; n < count; ++n) {
            const MarchItem& item = plan.items[std::size_t(n)];
            if (item.full_stencils != all) write_words(item, plan.words.data() + item.words);
        }
    }

private:
    int rows() const { return shape_.height() / shape_.rows; }

    void write_words(const MarchItem& item, std::uint64_t* words) const {
        const auto threads = std::size_t(shape_.threads());
        const Lattice& lattice = cells_.lattice();
        const int end_y = std::min(item.y + shape_.height(), lattice.dims.y);
        for (int z = item.begin; z < item.end; ++z) {
            std::uint64_t* const own = words + std::size_t(z - item.begin) * threads;
            for (int y = item.y; y < end_y; ++y) write_row(item, y, z, own, own + threads);
        }
    }
    void write_row(const MarchItem& item, int y, int z, std::uint64_t* own, std::uint64_t* next) const {
        const Lattice& lattice = cells_.lattice();
        const std::size_t row =
            (std::size_t(z) * std::size_t(lattice.dims.y) + std::size_t(y)) * std::size_t(lattice.dims.x);
        const auto first = lattice.voxel.begin() + std::ptrdiff_t(cells_.first_particle(y, z));
        const auto last = lattice.voxel.begin() + std::ptrdiff_t(cells_.end_particle(y, z));
        const int r = (y - item.y) % shape_.rows;
        const int* const threads =
            &thread_of_[std::size_t((y - item.y) / shape_.rows * (shape_.width() / 2))];
        for (auto voxel = std::lower_bound(first, last, row + std::size_t(item.x)); voxel != last; ++voxel) {
            const int x = int(*voxel - row) - item.x;
            if (x >= shape_.width()) break;
            const std::uint32_t mask = lattice.mask[std::size_t(voxel - lattice.voxel.begin())];
            own[threads[x / 2]] |= table_.own(r, x % 2, mask);
            next[threads[x / 2]] |= table_.next(r, x % 2, mask);
        }
    }

    const MarchCells& cells_;
    const MarchShape shape_;
    const PlaneMaskTable table_;
    std::vector<int> thread_of_;  ///< by half of its column, and by its row
};

}  // namespace

MarchPlan plan_march(const Problem& problem, const std::vector<MarchTile>& tiles, Precision precision,
                     Formulation formulation, const MarchDevice& device) {
    int narrowest = std::numeric_limits<int>::max();
    for (const MarchTile& tile : tiles) narrowest = std::min(narrowest, 2 * tile.shape.lanes);
    const MarchCells cells(problem, narrowest);
    const auto fits = [&](const MarchTile& tile) { return resident_blocks(tile, precision, device) > 0; };
    const bool any_fits = std::any_of(tiles.begin(), tiles.end(), fits);
    std::optional<Candidates> best;
    MarchPlan plan;
    for (const MarchTile& tile : tiles) {
        if (any_fits ? !fits(tile) : best.has_value()) continue;
        Candidates candidates(cells, tile, precision, formulation, device);
        candidates.search();
        if (best && candidates.seconds() >= best->seconds()) continue;
        plan.tile = tile;
        best.emplace(std::move(candidates));
    }
    plan.seconds = best->seconds();
    Writer(cells, plan.tile.shape).write(best->columns(), best->best(), plan);
    return plan;
}

std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape) {
    const std::uint64_t tiles = std::uint64_t(units_of(lattice.dims.x, shape.width())) *
                                std::uint64_t(units_of(lattice.dims.y, shape.height()));
    const std::uint64_t planes = tiles * std::uint64_t(lattice.dims.z);
    // There is an empty plane between two runs.
    const std::uint64_t runs = tiles * std::uint64_t(units_of(lattice.dims.z, 2));
    const std::uint64_t items = std::min(planes, runs + max_cuts);
    // An item has one plane of words more than planes.
    return items * sizeof(MarchItem) +
           (planes + items) * std::uint64_t(shape.threads()) * sizeof(std::uint64_t);
}

}  // namespace voxspring::cuda
