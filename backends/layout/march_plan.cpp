#include "backends/layout/march_plan.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <set>
#include <utility>

#include "backends/by_precision.h"
#include "backends/layout/march_columns.h"
#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"

namespace voxspring::layout {
namespace {

constexpr int max_rows = 2;
/// When runs of planes are cut into items, the longest part of the longest run keeps at least this many
/// planes, because every item costs the time of three planes more than it has.
constexpr int shortest_part = 3;

/// Finds the bits in a thread's mask word (PlaneMask) that one of its particles sets. The particle is given
/// by its plane (1: the one that arrived, 0: the one before), row, column and neighbour mask.
class PlaneMaskTable {
public:
    explicit PlaneMaskTable(int rows) : rows_(rows) {
        if (rows == 1) {
            visit_springs<1>(*this);
        } else {
            visit_springs<max_rows>(*this);
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

    /// own(): the bits that a particle with `mask` sets in the word for its own plane. next(): the bits that
    /// it sets in the word for the next plane.
    std::uint64_t own(int r, int c, std::uint32_t mask) const { return of(1, r, c, mask); }
    std::uint64_t next(int r, int c, std::uint32_t mask) const {
        std::uint64_t word = of(0, r, c, mask) | std::uint64_t(1) << stored(r);
        if ((mask & PINNED_BIT) == 0) word |= std::uint64_t(1) << moves(r, c);
        return word;
    }

private:
    // A mask has 18 bits of face and edge springs. They are looked up in two halves.
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

/// A run: successive planes `begin` to `end` (exclusive) of a column.
struct Run {
    int column, begin, end;
    int length() const { return end - begin; }
};

/// The runs of planes with particles, in all columns.
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

/// Cuts runs where the set of warps with full stencils changes, unless both stretches beside the cut are
/// short. Without such cuts one plane of pinned particles would force masks on the whole run.
std::vector<Run> cut_by_full_stencils(const MarchColumns& columns, const std::vector<Run>& runs) {
    // A cut makes one more item, which costs the time of three planes. Masks add up to a tenth to the time of
    // a plane (march_rates()).
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

/// Cuts runs where the interior (MarchInterior) begins and ends. Planes that are not stepped are dropped.
std::vector<Run> cut_by_interior(const MarchInterior& interior, const std::vector<Run>& runs) {
    std::vector<Run> cut;
    for (const Run& run : runs) {
        const int first = std::clamp(interior.own_begin, run.begin, run.end);
        const int last = std::clamp(interior.own_end, first, run.end);
        const int begin = std::clamp(interior.begin, first, last);
        const int end = std::clamp(interior.end, begin, last);
        for (const Run& part :
             {Run{run.column, first, begin}, Run{run.column, begin, end}, Run{run.column, end, last}}) {
            if (part.length() > 0) cut.push_back(part);
        }
    }
    return cut;
}

/// Element n: the number of items that are n planes long.
using LengthCounts = std::vector<int>;

/// The time until all items are done, in units of the time that a plane takes. `slots` blocks run at once. A
/// slot that becomes free takes the longest item that is left. An item of n planes takes the time of n + 3
/// planes: it also fetches the plane below and the plane above, and waits for its first plane as long as one
/// more plane takes.
int finished_at(const LengthCounts& counts, int slots) {
    constexpr int extra = 3;
    std::priority_queue<int, std::vector<int>, std::greater<>> ends;
    for (int slot = 0; slot < slots; ++slot) ends.push(0);
    int last = 0;
    for (int length = int(counts.size()) - 1; length > 0; --length) {
        for (int n = 0; n < counts[std::size_t(length)]; ++n) {
            const int end = ends.top() + length + extra;
            ends.pop();
            ends.push(end);
            last = std::max(last, end);
        }
    }
    return last;
}

/// Cuts `run` into parts, and calls visit(part) for each. Their lengths are at most `most` and differ by at
/// most one plane.
template <class Visit>
void visit_parts(const Run& run, int most, Visit visit) {
    const int count = units_of(run.length(), most);
    // A run of 10^5 planes times the number of a part may exceed the largest int.
    const auto begin_of = [&](int part) {
        return run.begin + int(std::int64_t(run.length()) * part / count);
    };
    for (int part = 0; part < count; ++part) visit(Run{run.column, begin_of(part), begin_of(part + 1)});
}

/// The limit of the length of items, in planes, with which all items are done the soonest.
int best_length(const std::vector<Run>& runs, int slots) {
    int longest = 1;
    for (const Run& run : runs) longest = std::max(longest, run.length());
    int best = longest, least = std::numeric_limits<int>::max();
    for (int parts = 1, before = 0; parts == 1 || units_of(longest, parts) >= shortest_part; ++parts) {
        const int length = units_of(longest, parts);
        if (length == before) continue;
        before = length;
        LengthCounts counts(std::size_t(length) + 1);
        for (const Run& run : runs)
            visit_parts(run, length, [&](const Run& part) { ++counts[std::size_t(part.length())]; });
        const int finished = finished_at(counts, slots);
        if (finished < least) {
            least = finished;
            best = length;
        }
    }
    return best;
}

/// A body cut into items that all have the same tile, and the predicted seconds of a step.
class Candidate {
public:
    Candidate(const MarchCells& cells, const MarchTile& tile, Precision precision, Formulation formulation,
              const MarchDevice& device, const MarchInterior& interior)
        : tile_(tile),
          columns_(cells, tile.shape),
          cost_(tile, precision, formulation, device),
          lattice_(&cells.lattice()),
          increments_(by_increments(formulation)),
          real_(int(scalar_bytes(precision))) {
        cut(interior);
        predict();
    }

    const MarchTile& tile() const { return tile_; }
    const MarchColumns& columns() const { return columns_; }
    double seconds() const { return seconds_; }
    /// Computes MarchPlan::kept_planes. If the state is about as large as L2 or somewhat larger, every step
    /// evicts from L2 what the next step reads first. Then telling L2 what to keep makes a step up to a tenth
    /// faster. If the state is smaller or larger, or items march in several rounds, it makes a step slower.
    /// The bounds `least` and `most` lie between states that were measured on an H100.
    int kept_planes(const MarchDevice& device) const {
        constexpr double least = 0.9, most = 1.75;
        const double state = state_bytes() / device.cache_bytes;
        // In a box whose lowest plane is pinned, this plane is cut from the rest. Items of one or two planes
        // are soon done, so they do not count as a second round.
        const auto at_once = std::size_t(cost_.slots());
        const bool one_round = items_.size() <= at_once || items_[at_once].length() < shortest_part;
        return device.tensor_copies && one_round && state > least && state < most ? 2 : 0;
    }
    /// The items in the order of blocks.
    const std::vector<Run>& items() const { return items_; }
    std::size_t border_items() const { return border_items_; }

private:
    /// Cuts runs into items of about equal length. Then items of neighbouring columns march at the same
    /// height, and find in the cache the points around their tiles.
    void cut(const MarchInterior& interior) {
        const std::vector<Run> runs =
            cut_by_interior(interior, cut_by_full_stencils(columns_, runs_of(columns_)));
        const int length = best_length(runs, cost_.slots());
        for (const Run& run : runs)
            visit_parts(run, length, [&](const Run& part) { items_.push_back(part); });
        // The longest items come first, so that little work is left at the end. Equally long items are
        // ordered from the lowest to the highest, and at one height column by column.
        std::stable_sort(items_.begin(), items_.end(), [](const Run& a, const Run& b) {
            return a.length() != b.length() ? a.length() > b.length() : a.begin < b.begin;
        });
        const auto first = std::stable_partition(items_.begin(), items_.end(), [&](const Run& item) {
            return item.begin < interior.begin || item.begin >= interior.end;
        });
        border_items_ = std::size_t(first - items_.begin());
    }
    void predict() {
        std::vector<MarchLoad> loads;
        double bytes = 0;
        for (const Run& item : items_) starts_.emplace(item.column, item.begin);
        for (const Run& item : items_) {
            loads.push_back(load_of(item));
            bytes += bytes_of(item);
        }
        seconds_ = cost_.step_seconds(loads, bytes, state_bytes());
    }
    double state_bytes() const { return double(lattice_->voxel_count()) * 3 * real_ * (increments_ ? 3 : 2); }

    /// The springs that are added when plane z arrives, as a share of those for an inner plane. At the first
    /// plane of the lattice there are no springs to a plane below.
    static double springs_of(int z) { return z == 0 ? 0.5 : 1; }
    /// Cycles of all warps when plane z arrives. Warps whose bit is set in `full` use no masks.
    double count_cycles(int column, int z, std::uint32_t full) const {
        std::uint32_t active = columns_.at(column, z).active;
        if (z > 0) active |= columns_.at(column, z - 1).active;
        const MarchRates& rates = cost_.rates();
        const int all = columns_.shape().warps(), at_work = std::popcount(active);
        const int without = std::popcount(active & full);
        return without * rates.full + (at_work - without) * rates.masked + (all - at_work) * rates.idle;
    }
    MarchLoad load_of(const Run& item) const {
        std::uint32_t full = ~0U;
        for (int z = item.begin; z < item.end; ++z) full &= columns_.at(item.column, z).full;
        MarchLoad load;
        // The plane above the item is fetched as well.
        for (int z = item.begin; z <= std::min(item.end, columns_.planes() - 1); ++z) {
            load.planes += springs_of(z);
            load.cycles += springs_of(z) * count_cycles(item.column, z, full);
        }
        return load;
    }

    /// How many of the columns on the four sides of the item have an item that begins at the same plane as
    /// this one.
    int neighbours_in_step(const Run& item) const {
        const int across = units_of(lattice_->dims.x, columns_.shape().width());
        const int x = item.column % across;
        int found = 0;
        for (const int step : {-1, 1, -across, across}) {
            const bool beside = step != -1 && step != 1;
            if (!beside && (x + step < 0 || x + step >= across)) continue;
            found += int(starts_.count({item.column + step, item.begin}));
        }
        return found;
    }
    /// The bytes that plane z moves: those of its window (the plane of the tile and a frame around it), and
    /// those that the step overwrites. `fetched_frame`: the share of the frame that comes from memory.
    double bytes_at(int column, int z, double fetched_frame) const {
        // The fewest bytes that an access to the card's memory (HBM) delivers.
        constexpr int fetched_bytes = 64;
        const MarchShape& shape = columns_.shape();
        const int margin = fetched_bytes / real_;
        const auto within = [](int begin, int end, int size) {
            return std::min(end, size) - std::max(begin, 0);
        };
        const int x = columns_.x(column), y = columns_.y(column);
        const double window = double(within(x - margin, x + shape.width() + margin, lattice_->dims.x)) *
                              within(y - 1, y + shape.height() + 1, lattice_->dims.y);
        const double own = double(within(x, x + shape.width(), lattice_->dims.x)) *
                           within(y, y + shape.height(), lattice_->dims.y);
        const double stored = double(std::popcount(columns_.at(column, z).active)) / shape.warps();
        return 3 * real_ *
               (own + fetched_frame * (window - own) + own * (1 + stored * (increments_ ? 2 : 1)));
    }
    /// The bytes of an item. Half of a window's frame counts as cached if the tiles on all sides march at the
    /// same height, and nothing of it if none does. On an H200 at commit 46c228e the heart of 480x408x368,
    /// whose runs begin at all heights, took 410 us with tile 64x8 and 482 us with 32x20. If half of all
    /// frames counted as cached, 32x20 would be chosen. The time predicted for this heart is a fifth too
    /// short.
    double bytes_of(const Run& item) const {
        constexpr int sides = 4;
        const double fetched_frame = 1 - 0.5 * neighbours_in_step(item) / sides;
        double bytes = 0;
        for (int z = item.begin; z < item.end; ++z) bytes += bytes_at(item.column, z, fetched_frame);
        // The planes below and above the item: only their windows are fetched, a third or a quarter of the
        // bytes.
        const double window = bytes_at(item.column, item.begin, fetched_frame) / (increments_ ? 4 : 3);
        return bytes + window * ((item.begin > 0 ? 1 : 0) + (item.end < columns_.planes() ? 1 : 0));
    }

    MarchTile tile_;
    MarchColumns columns_;
    MarchCost cost_;
    const Lattice* lattice_;
    bool increments_;
    int real_;
    std::vector<Run> items_;
    std::size_t border_items_ = 0;
    std::set<std::pair<int, int>> starts_;  ///< columns and first planes of items
    double seconds_ = 0;
};

/// Writes the items and mask words of a plan.
class Writer {
public:
    Writer(const MarchCells& cells, const MarchShape& shape)
        : cells_(cells),
          shape_(shape),
          table_(shape.rows),
          thread_of_(std::size_t(shape.width() / 2 * rows())) {
        for (int thread = 0; thread < shape.threads(); ++thread)
            thread_of_[std::size_t(shape.row(thread) / shape.rows) * std::size_t(shape.width() / 2) +
                       std::size_t(shape.column(thread) / 2)] = thread;
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
            &thread_of_[std::size_t((y - item.y) / shape_.rows) * std::size_t(shape_.width() / 2)];
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
    std::vector<int> thread_of_;  ///< by group of rows and pair of columns: the thread that has them
};

}  // namespace

MarchInterior interior_of(const Problem& problem, const std::vector<std::uint32_t>& border) {
    const Lattice& lattice = problem.lattice;
    const auto plane_of = [&](std::size_t i) { return lattice.coordinates(lattice.voxel[i]).z; };
    std::vector<std::uint8_t> touched(std::size_t(lattice.dims.z));
    for (const std::uint32_t i : border) touched[std::size_t(plane_of(i))] = 1;
    std::vector<std::ptrdiff_t> stepped(touched.size());  // per plane: particles without ghosts
    for (std::size_t i = 0; i < problem.particle_count(); ++i) ++stepped[std::size_t(plane_of(i))];
    for (const std::uint32_t i : problem.ghosts) --stepped[std::size_t(plane_of(i))];
    MarchInterior longest{0, 0}, run{0, 0};
    for (int z = 0; z < lattice.dims.z; ++z) {
        if (touched[std::size_t(z)] != 0) run.begin = z + 1;
        run.end = z + 1;
        if (run.end - run.begin > longest.end - longest.begin) longest = run;
    }
    const auto some = [](std::ptrdiff_t count) { return count > 0; };
    const auto first = std::find_if(stepped.begin(), stepped.end(), some);
    const auto last = std::find_if(stepped.rbegin(), stepped.rend(), some);
    longest.own_begin = int(first - stepped.begin());
    longest.own_end = std::max(longest.own_begin, int(stepped.rend() - last));
    return longest;
}

MarchPlan plan_march(const Problem& problem, const std::vector<MarchTile>& tiles, Precision precision,
                     Formulation formulation, const MarchDevice& device, MarchInterior interior) {
    int narrowest = std::numeric_limits<int>::max();
    for (const MarchTile& tile : tiles) narrowest = std::min(narrowest, 2 * tile.shape.lanes);
    const MarchCells cells(problem, narrowest);
    const auto fits = [&](const MarchTile& tile) { return resident_blocks(tile, precision, device) > 0; };
    const bool any_fits = std::any_of(tiles.begin(), tiles.end(), fits);
    std::vector<Candidate> candidates;
    double least = std::numeric_limits<double>::infinity();
    for (const MarchTile& tile : tiles) {
        if (any_fits ? !fits(tile) : !candidates.empty()) continue;
        candidates.emplace_back(cells, tile, precision, formulation, device, interior);
        least = std::min(least, candidates.back().seconds());
    }
    const auto best = std::find_if(candidates.begin(), candidates.end(), [&](const Candidate& candidate) {
        return candidate.seconds() <= max_alike * least;
    });
    MarchPlan plan;
    plan.tile = best->tile();
    plan.seconds = best->seconds();
    plan.border_items = best->border_items();
    plan.kept_planes = best->kept_planes(device);
    Writer(cells, plan.tile.shape).write(best->columns(), best->items(), plan);
    return plan;
}

std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape) {
    const std::uint64_t tiles = std::uint64_t(units_of(lattice.dims.x, shape.width())) *
                                std::uint64_t(units_of(lattice.dims.y, shape.height()));
    const std::uint64_t planes = tiles * std::uint64_t(lattice.dims.z);
    // An item takes at least two planes of a column on average: the parts of longer runs have two or more,
    // and a run of one plane is followed by an empty plane or lies beside a much longer run.
    static_assert(shortest_part == 3);
    const std::uint64_t items = tiles * std::uint64_t(units_of(lattice.dims.z, 2));
    // An item has at most one mask word per thread for each of its planes and for the plane after them.
    return items * sizeof(MarchItem) +
           (planes + items) * std::uint64_t(shape.threads()) * sizeof(std::uint64_t);
}

}  // namespace voxspring::layout
