#include "backends/layout/march_layout.h"

#include <algorithm>
#include <array>
#include <bit>
#include <functional>
#include <limits>
#include <queue>
#include <utility>

#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"

namespace voxspring::cuda {
namespace {

constexpr int max_rows = 2;

/// The first lattice direction of each spring class.
constexpr std::array<glm::ivec3, spring_classes> class_offsets = {glm::ivec3{1, 0, 0}, {0, 1, 0}, {0, 0, 1},
                                                                  {1, 1, 0},           {1, 0, 1}, {0, 1, 1}};

const Direction& direction_to(const glm::ivec3& offset) {
    return *std::find_if(directions().begin(), directions().end(),
                         [&](const Direction& direction) { return direction.offset == offset; });
}

/// How much springs of class k pull in units of what the kernel computes of them: (l - |d|) / |d| by
/// increments, the same in units of l otherwise.
double pull_of_class(const Problem& problem, std::size_t k, Formulation formulation) {
    const Direction& direction = direction_to(class_offsets[k]);
    const double stiffness = problem.group_stiffness[std::size_t(direction.group)];
    return by_increments(formulation) ? stiffness : stiffness * rest_spring(problem, direction).length;
}

/// Which bits of a thread's word stand for the springs of its particles in the plane that arrived (1) and the
/// one before (0), by row, column and mask bit.
class PlaneMaskTable {
public:
    explicit PlaneMaskTable(int rows) : rows_(rows) {
        if (rows == 1) {
            visit_springs<1, true>(*this);
        } else {
            visit_springs<max_rows, true>(*this);
        }
    }

    void both(int bit, int z, int r, int c, int z2, int r2, int c2) {
        half(bit, z, r, c, z2, r2, c2);
        half(bit, z2, r2, c2, z, r, c);
    }
    void half(int bit, int z, int r, int c, int z2, int r2, int c2) {
        const Direction& direction = direction_to({c2 - c, r2 - r, z2 - z});
        bits_[index(z, r, c)][std::size_t(direction.bit)] |= std::uint64_t(1) << bit;
    }

    /// Of a particle whose neighbours are `mask`, in the word of its own plane and in that of the next.
    std::uint64_t own(int r, int c, std::uint32_t mask) const { return of(1, r, c, mask); }
    std::uint64_t next(int r, int c, std::uint32_t mask) const {
        std::uint64_t word = of(0, r, c, mask) | std::uint64_t(1) << stored(r);
        if ((mask & PINNED_BIT) == 0) word |= std::uint64_t(1) << moves(r, c);
        return word;
    }

private:
    static std::size_t index(int z, int r, int c) {
        return (std::size_t(z) * max_rows + std::size_t(r)) * 2 + std::size_t(c);
    }
    int moves(int r, int c) const {
        return rows_ == 1 ? PlaneMask<1>::moves(r, c) : PlaneMask<max_rows>::moves(r, c);
    }
    int stored(int r) const { return rows_ == 1 ? PlaneMask<1>::stored(r) : PlaneMask<max_rows>::stored(r); }
    std::uint64_t of(int z, int r, int c, std::uint32_t mask) const {
        std::uint64_t word = 0;
        for (std::uint32_t bits = mask & (FACE_BITS | EDGE_BITS); bits != 0; bits &= bits - 1)
            word |= bits_[index(z, r, c)][std::size_t(std::countr_zero(bits))];
        return word;
    }

    int rows_;
    std::array<std::array<std::uint64_t, neighbour_count>, std::size_t(2) * max_rows * 2> bits_{};
};

/// Mask bits of the directions whose offset `chosen` accepts.
template <class Chosen>
std::uint32_t bits_where(Chosen chosen) {
    std::uint32_t bits = 0;
    for (const Direction& direction : directions())
        bits |= chosen(direction.offset) ? 1U << direction.bit : 0;
    return bits;
}

/// What plan_march() asks about a lattice, from masks by voxel.
class Planner {
public:
    Planner(const Problem& problem, const MarchShape& shape)
        : lattice_(&problem.lattice),
          shape_(shape),
          groups_(problem.group_bits & (FACE_BITS | EDGE_BITS)),
          left_(bits_where([](glm::ivec3 o) { return o.x < 0; })),
          right_(bits_where([](glm::ivec3 o) { return o.x > 0; })),
          below_(bits_where([](glm::ivec3 o) { return o.z < 0; })),
          above_(bits_where([](glm::ivec3 o) { return o.z > 0; })),
          tiles_x_(units_of(lattice_->dims.x, shape.width())),
          tiles_y_(units_of(lattice_->dims.y, shape.height())),
          masks_(lattice_->voxel_count()) {
        const auto particles = std::ptrdiff_t(lattice_->voxel.size());
#pragma omp parallel for
        for (std::ptrdiff_t n = 0; n < particles; ++n)
            masks_[lattice_->voxel[std::size_t(n)]] = lattice_->mask[std::size_t(n)];
    }

    /// Runs of planes of each tile that hold a particle, cut where for long the same warps have full
    /// stencils: a plane of pins would otherwise leave masks to all above it.
    std::vector<MarchItem> runs() const {
        const std::ptrdiff_t tiles = std::ptrdiff_t(tiles_x_) * tiles_y_;
        std::vector<std::vector<MarchItem>> of_tile(std::size_t(tiles), std::vector<MarchItem>{});
#pragma omp parallel for schedule(dynamic)
        for (std::ptrdiff_t t = 0; t < tiles; ++t) {
            const int x = int(t % tiles_x_) * shape_.width(), y = int(t / tiles_x_) * shape_.height();
            bool open = false;
            for (int z = 0; z < lattice_->dims.z; ++z) {
                const bool active = has_particle(x, y, z);
                if (active && !open) of_tile[std::size_t(t)].push_back({x, y, z, z, 0, 0});
                if (active) of_tile[std::size_t(t)].back().end = z + 1;
                open = active;
            }
            std::vector<MarchItem> cut;
            for (const MarchItem& run : of_tile[std::size_t(t)]) cut_by_full_stencils(run, cut);
            of_tile[std::size_t(t)] = std::move(cut);
        }
        std::vector<MarchItem> all;
        for (const auto& items : of_tile) all.insert(all.end(), items.begin(), items.end());
        return all;
    }

    /// Sets which warps of `item` have full stencils.
    void judge(MarchItem& item) const {
        item.full_stencils = 0;
        for (int warp = 0; warp < shape_.warps(); ++warp)
            item.full_stencils |= std::size_t(has_full_stencils(item, warp) ? 1 : 0) << warp;
    }

    bool all_full_stencils(const MarchItem& item) const {
        return item.full_stencils == (std::size_t(1) << shape_.warps()) - 1;
    }
    std::size_t word_count(const MarchItem& item) const {
        return std::size_t(item.end - item.begin + 1) * std::size_t(shape_.threads());
    }

    void write_words(const MarchItem& item, const PlaneMaskTable& table, std::uint64_t* words) const {
        const auto threads = std::size_t(shape_.threads());
        for (int z = item.begin; z < item.end; ++z) {
            std::uint64_t* const own = words + std::size_t(z - item.begin) * threads;
            std::uint64_t* const next = own + threads;
            for (int thread = 0; thread < shape_.threads(); ++thread) {
                for (int r = 0; r < shape_.rows; ++r) {
                    for (int c = 0; c < 2; ++c) {
                        const std::uint32_t mask =
                            mask_at(item.x + shape_.column(thread) + c, item.y + shape_.row(thread) + r, z);
                        if (mask == 0) continue;
                        own[thread] |= table.own(r, c, mask);
                        next[thread] |= table.next(r, c, mask);
                    }
                }
            }
        }
    }

private:
    void cut_by_full_stencils(const MarchItem& run, std::vector<MarchItem>& items) const {
        // What an item costs beside its planes is three planes' time, and masks cost an eighth.
        constexpr int long_enough = 32;
        std::vector<MarchItem> stretches;
        for (int z = run.begin; z < run.end; ++z) {
            MarchItem plane{run.x, run.y, z, z + 1, 0, 0};
            judge(plane);
            if (stretches.empty() || stretches.back().full_stencils != plane.full_stencils) {
                stretches.push_back(plane);
            } else {
                stretches.back().end = z + 1;
            }
        }
        const auto is_long = [](const MarchItem& stretch) {
            return stretch.end - stretch.begin >= long_enough;
        };
        for (std::size_t n = 0; n < stretches.size(); ++n) {
            if (n > 0 && !is_long(stretches[n]) && !is_long(stretches[n - 1])) {
                items.back().end = stretches[n].end;
            } else {
                items.push_back(stretches[n]);
            }
        }
    }
    std::uint32_t mask_at(int x, int y, int z) const {
        const glm::ivec3 dims = lattice_->dims;
        if (x >= dims.x || y >= dims.y) return 0;
        return masks_[(std::size_t(z) * std::size_t(dims.y) + std::size_t(y)) * std::size_t(dims.x) +
                      std::size_t(x)];
    }
    bool has_particle(int x, int y, int z) const {
        const int end_x = std::min(x + shape_.width(), lattice_->dims.x);
        const int end_y = std::min(y + shape_.height(), lattice_->dims.y);
        for (int j = y; j < end_y; ++j) {
            for (int i = x; i < end_x; ++i) {
                if (mask_at(i, j, z) != 0) return true;
            }
        }
        return false;
    }
    bool has_full_stencils(const MarchItem& item, int warp) const {
        const int x = item.x + shape_.column(32 * warp), y = item.y + shape_.row(32 * warp);
        const int width = 2 * shape_.lanes, height = shape_.rows * (32 / shape_.lanes);
        for (int z = item.begin; z < item.end; ++z) {
            for (int j = y; j < y + height; ++j) {
                for (int i = x; i < x + width; ++i) {
                    std::uint32_t wanted = groups_ | ACTIVE_BIT;
                    if (i == 0) wanted &= ~left_;
                    if (i + 1 == lattice_->dims.x) wanted &= ~right_;
                    if (z == 0) wanted &= ~below_;
                    if (z + 1 == lattice_->dims.z) wanted &= ~above_;
                    if ((mask_at(i, j, z) & (wanted | PINNED_BIT)) != wanted) return false;
                }
            }
        }
        return true;
    }

    const Lattice* lattice_;
    const MarchShape shape_;
    const std::uint32_t groups_, left_, right_, below_, above_;
    const int tiles_x_, tiles_y_;
    std::vector<std::uint32_t> masks_;
};

/// The lengths of the parts that a run of planes is cut into, none longer than `most`.
std::vector<int> parts_of(const MarchItem& run, int most) {
    const int length = run.end - run.begin, count = units_of(length, most);
    std::vector<int> parts;
    for (int part = 0; part < count; ++part)
        parts.push_back(length * (part + 1) / count - length * part / count);
    return parts;
}

/// When the last of `slots` has nothing left to do, each of which takes the longest item that is left. A
/// block takes three planes' time more than its item has: two that it shares with others, and the first, for
/// which it waits.
int finished_at(std::vector<int> lengths, int slots) {
    constexpr int extra = 3;
    std::sort(lengths.begin(), lengths.end(), std::greater<>());
    std::priority_queue<int, std::vector<int>, std::greater<>> ends;
    for (int slot = 0; slot < slots; ++slot) ends.push(0);
    int last = 0;
    for (const int length : lengths) {
        const int end = ends.top() + length + extra;
        ends.pop();
        ends.push(end);
        last = std::max(last, end);
    }
    return last;
}

/// How many planes an item should have at most.
int best_length(const std::vector<MarchItem>& runs, int slots) {
    constexpr int shortest = 16;
    int longest = 1;
    for (const MarchItem& run : runs) longest = std::max(longest, run.end - run.begin);
    int best = longest, least = std::numeric_limits<int>::max();
    for (int parts = 1; parts == 1 || units_of(longest, parts) >= shortest; ++parts) {
        const int length = units_of(longest, parts);
        std::vector<int> lengths;
        for (const MarchItem& run : runs) {
            const std::vector<int> of_run = parts_of(run, length);
            lengths.insert(lengths.end(), of_run.begin(), of_run.end());
        }
        const int finished = finished_at(std::move(lengths), slots);
        if (finished < least) {
            least = finished;
            best = length;
        }
    }
    return best;
}

}  // namespace

MarchTile march_tile(const std::string& name, Precision precision) {
    // Two rows a thread evaluate 13.5 springs a particle, one row 15.5: in float64 all that registers have
    // room for.
    if (precision == Precision::float64) {
        if (name == "64x4") return {{1, 32, 1, 4, 3, 2}, 4};
        if (name == "64x8") return {{1, 32, 1, 8, 4, 3}, 2};
        if (name == "128x8") return {{1, 32, 2, 8, 4, 3}, 1};
        return {};
    }
    if (name == "32x20") return {{2, 16, 1, 5, 3, 2}, 4};
    if (name == "64x8") return {{2, 32, 1, 4, 3, 2}, 5};
    if (name == "64x16") return {{2, 32, 1, 8, 4, 3}, 2};
    if (name == "64x20") return {{2, 32, 1, 10, 4, 2}, 2};
    if (name == "128x16") return {{2, 32, 2, 8, 4, 3}, 1};
    if (name == "64x24") return {{2, 32, 1, 12, 3, 2}, 2};
    if (name == "128x20") return {{2, 32, 2, 10, 4, 2}, 1};
    if (name == "128x24") return {{2, 32, 2, 12, 3, 2}, 1};
    return {};
}

std::string best_march_tile(const Problem& problem, Precision precision, std::size_t shared_bytes) {
    // From the fastest on an H200 to what fits any card.
    std::vector<const char*> tiles = {"128x20", "64x20", "64x16", "64x8"};
    // Narrow tiles hold less that is empty where little is active, and small lattices need many blocks.
    const bool dense = 2 * problem.particle_count() > problem.lattice.voxel_count();
    if (precision == Precision::float64) {
        tiles = {"64x8", "64x4"};
    } else if (problem.lattice.dims.x <= 64) {
        tiles = {"64x8"};
    } else if (!dense) {
        tiles = {"64x16", "64x8"};
    }
    const int real = precision == Precision::float32 ? sizeof(float) : sizeof(double);
    const auto best = std::find_if(tiles.begin(), tiles.end(), [&](const char* tile) {
        return std::size_t(march_tile(tile, precision).shape.shared_bytes(real)) <= shared_bytes;
    });
    return best == tiles.end() ? tiles.back() : *best;
}

SoaStrides march_strides(const Lattice& lattice, std::size_t real_bytes) {
    constexpr std::size_t line = 128;
    const std::size_t row = rounded_up(std::size_t(lattice.dims.x) * real_bytes, line) / real_bytes;
    const std::size_t plane = row * std::size_t(lattice.dims.y);
    return {row, plane, plane * std::size_t(lattice.dims.z)};
}

namespace {

/// Calls visit(particle, element) for each particle.
template <class Visit>
void visit_particles(const Problem& problem, const SoaStrides& axes, Visit visit) {
    const Lattice& lattice = problem.lattice;
    const auto particles = std::ptrdiff_t(problem.particle_count());
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < particles; ++n) {
        const auto i = std::size_t(n);
        const glm::ivec3 c = lattice.coordinates(lattice.voxel[i]);
        visit(i, std::size_t(c.x) + axes.row * std::size_t(c.y) + axes.plane * std::size_t(c.z));
    }
}

}  // namespace

template <class Real>
MarchState<Real> pack_march(const Problem& problem, const State& state, Formulation formulation) {
    const SoaStrides axes = march_strides(problem.lattice, sizeof(Real));
    MarchState<Real> packed;
    packed.current.resize(axes.size());
    packed.before.resize(axes.size());
    visit_particles(problem, axes, [&](std::size_t i, std::size_t at) {
        glm::dvec3 point = state.displacement[i];
        if (on_positions(formulation)) point += problem.rest_position[i];
        const glm::dvec3 before =
            by_increments(formulation) ? state.increment[i] : point - state.increment[i];
        for (std::size_t axis = 0; axis < 3; ++axis) {
            packed.current[axis * axes.axis + at] = Real(point[int(axis)]);
            packed.before[axis * axes.axis + at] = Real(before[int(axis)]);
        }
    });
    return packed;
}

template <class Real>
State unpack_march(const Problem& problem, const MarchState<Real>& packed, Formulation formulation) {
    const SoaStrides axes = march_strides(problem.lattice, sizeof(Real));
    State state = state_at_rest(problem);
    visit_particles(problem, axes, [&](std::size_t i, std::size_t at) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double point = double(packed.current[axis * axes.axis + at]);
            const double before = double(packed.before[axis * axes.axis + at]);
            const double rest = on_positions(formulation) ? problem.rest_position[i][int(axis)] : 0;
            state.displacement[i][int(axis)] = point - rest;
            state.increment[i][int(axis)] = by_increments(formulation) ? before : point - before;
        }
    });
    return state;
}

MarchPlan plan_march(const Problem& problem, const MarchShape& shape, int slots) {
    const Planner planner(problem, shape);
    const std::vector<MarchItem> runs = planner.runs();
    const int length = best_length(runs, slots);
    MarchPlan plan;
    for (const MarchItem& run : runs) {
        MarchItem item = run;
        for (const int part : parts_of(run, length)) {
            item.end = item.begin + part;
            plan.items.push_back(item);
            item.begin = item.end;
        }
    }
    // The longest first, so that what is left at the end is short; else tile by tile at the same height, so
    // that neighbours find each other's frames in the cache.
    std::stable_sort(plan.items.begin(), plan.items.end(), [&](const MarchItem& a, const MarchItem& b) {
        const int a_length = a.end - a.begin, b_length = b.end - b.begin;
        return a_length != b_length ? a_length > b_length : a.begin < b.begin;
    });
    const auto count = std::ptrdiff_t(plan.items.size());
#pragma omp parallel for schedule(dynamic)
    for (std::ptrdiff_t n = 0; n < count; ++n) planner.judge(plan.items[std::size_t(n)]);
    std::size_t words = 0;
    for (MarchItem& item : plan.items) {
        item.words = planner.all_full_stencils(item) ? 0 : words;
        if (!planner.all_full_stencils(item)) words += planner.word_count(item);
    }
    plan.words.resize(words);
    const PlaneMaskTable table(shape.rows);
#pragma omp parallel for schedule(dynamic)
    for (std::ptrdiff_t n = 0; n < count; ++n) {
        const MarchItem& item = plan.items[std::size_t(n)];
        if (!planner.all_full_stencils(item))
            planner.write_words(item, table, plan.words.data() + item.words);
    }
    return plan;
}

std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape) {
    const std::uint64_t tiles = std::uint64_t(units_of(lattice.dims.x, shape.width())) *
                                std::uint64_t(units_of(lattice.dims.y, shape.height()));
    // An item has one plane of words more than planes, and there is an empty plane between two runs.
    const std::uint64_t items = tiles * std::uint64_t(units_of(lattice.dims.z, 2));
    const std::uint64_t planes = tiles * std::uint64_t(lattice.dims.z) + items;
    return items * sizeof(MarchItem) + planes * std::uint64_t(shape.threads()) * sizeof(std::uint64_t);
}

bool has_inverse_lengths(const Problem& problem, Precision precision, Formulation formulation) {
    if (by_increments(formulation)) return true;
    const double smallest = precision == Precision::float32 ? double(std::numeric_limits<float>::min())
                                                            : std::numeric_limits<double>::min();
    return std::all_of(directions().begin(), directions().end(), [&](const Direction& direction) {
        return (problem.group_bits >> direction.bit & 1U) == 0 ||
               squared_rest_length(problem, direction) >= smallest;
    });
}

bool equal_edges(const Problem& problem, Formulation formulation) {
    if ((problem.group_bits & EDGE_BITS) == 0) return false;
    const double first = pull_of_class(problem, 3, formulation);
    return first > 0 && first == pull_of_class(problem, 4, formulation) &&
           first == pull_of_class(problem, 5, formulation);
}

template <class Real>
MarchStep<Real> make_march_step(const Problem& problem, Formulation formulation) {
    const Lattice& lattice = problem.lattice;
    const SoaStrides axes = march_strides(lattice, sizeof(Real));
    MarchStep<Real> step{};
    step.nx = lattice.dims.x;
    step.ny = lattice.dims.y;
    step.nz = lattice.dims.z;
    step.row = axes.row;
    step.plane = axes.plane;
    step.axis = axes.axis;
    step.spacing = {Real(lattice.spacing.x), Real(lattice.spacing.y), Real(lattice.spacing.z)};
    const double unit = equal_edges(problem, formulation) ? pull_of_class(problem, 3, formulation) : 1;
    for (std::size_t k = 0; k < spring_classes; ++k) {
        const Direction& direction = direction_to(class_offsets[k]);
        step.rest_length[k] = listed_length<Real>(problem, direction, formulation);
        step.deficit[k] = Real(rest_spring(problem, direction).deficit);
        step.stiffness[k] = Real(pull_of_class(problem, k, formulation) / unit);
    }
    const double squared = problem.time_step * problem.time_step;
    step.scale = Real(unit * squared / problem.materials.front().mass);
    step.gravity = {Real(problem.gravity.x * squared), Real(problem.gravity.y * squared),
                    Real(problem.gravity.z * squared)};
    step.damping = Real(problem.damping);
    step.retained = Real(1 - problem.damping);
    step.shortest_squared = Real(problem.shortest_squared());
    return step;
}

#define FOR_PRECISION(Real)                                                            \
    template MarchState<Real> pack_march(const Problem&, const State&, Formulation);   \
    template State unpack_march(const Problem&, const MarchState<Real>&, Formulation); \
    template MarchStep<Real> make_march_step(const Problem&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::cuda
