// Every core and its SIMD registers: a gather over a padded grid with implicit addressing.
//
// State is a structure of arrays (x, y, z) over the grid, whose rows are padded to whole blocks of 64
// bytes; a neighbour is a constant number of elements away. Only blocks with active voxels are listed, and
// threads share the list evenly. A spring is evaluated once, when its lower end is stepped: its force
// density then waits in a buffer for the higher end, which multiplies its own offset with it. That is
// the force that it would have evaluated itself, to the bit; so forces, summed in the order of
// neighbours.h, depend neither on the number of threads nor on the width of a register. Tiles of blocks that
// rest are not stepped (tiles.h), which changes no bit either.
#include <hwy/aligned_allocator.h>
#include <omp.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "backends/cpu/kernel.h"
#include "backends/cpu/subnormals.h"
#include "backends/cpu/tiles.h"
#include "backends/physics/neighbours.h"
#include "backends/registry.h"
#include "backends/rest_policy.h"

namespace voxspring {
namespace {

using namespace cpu_parallel;

/// More than this starts more threads than a process can be sure to get, where OpenMP ends it.
constexpr int most_threads = 1024;

int thread_count(const Options& options) {
    const std::string& threads = options.tuning.at("threads");
    const int count = threads == "auto" ? omp_get_max_threads() : std::stoi(threads);
    if (count > most_threads) {
        throw BadSpecification("backend cpu_parallel: threads=" + threads + " is more than " +
                               std::to_string(most_threads));
    }
    return count;
}

/// How many threads share that many blocks: all there are, but where the number is left to us none for less
/// work than a barrier is worth. 128 blocks take a core about 10 us.
std::ptrdiff_t share_count(const Options& options, std::ptrdiff_t blocks) {
    const std::ptrdiff_t least = options.tuning.at("threads") == "auto" ? 128 : 1;
    return std::min<std::ptrdiff_t>(
        {thread_count(options), blocks, std::max<std::ptrdiff_t>(1, blocks / least)});
}

/// Where the threads of a step meet. OpenMP's own barrier spins for milliseconds: where another process has
/// one of the cores, it keeps the very thread that it waits for from running, at the cost of a scheduler's
/// time slice (4 ms) a step. This one spins for some microseconds, then lets others run.
class Barrier {
public:
    /// Before any thread waits.
    void expect(int threads) { threads_ = threads; }
    void wait() {
        const unsigned phase = phase_.load(std::memory_order_acquire);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 == threads_) {
            arrived_.store(0, std::memory_order_relaxed);
            phase_.store(phase + 1, std::memory_order_release);
            return;
        }
        for (int tries = 0; phase_.load(std::memory_order_acquire) == phase; ++tries) {
            if (tries >= patience) std::this_thread::yield();
        }
    }

private:
    static constexpr int patience = 2000;  // loads

    int threads_ = 0;
    // A cache line each: a thread that arrives does not disturb those that look.
    alignas(64) std::atomic<int> arrived_ = 0;
    alignas(64) std::atomic<unsigned> phase_ = 0;
};

/// Whether everything is computed, with neutral values where the scene has none, and nothing is skipped
/// or shared: what the skips are tested against.
bool all_terms(const Options& options) { return options.tuning.at("terms") == "all"; }

Root root_of(const Options& options) {
    const std::string& root = options.tuning.at("root");
    if (root == "exact") return Root::exact;
    return root == "refined" ? Root::refined : Root::raw;
}

/// Empty, or why these options do not go together.
std::string refused_options(const Options& options) {
    const std::string& root = options.tuning.at("root");
    if (root != "exact" && options.precision == Precision::float64) return "root=" + root + " is for float32";
    return refused_rest(options);
}

/// How far a particle of a tile that falls asleep moves in a step at most, in spacings; 0: none sleeps.
double sleep_threshold(const Options& options) {
    const std::string& sleep = options.tuning.at("sleep");
    return sleep == "off" ? 0 : std::stod(sleep);
}

/// How close to 0 a part of the state is set to it, in spacings; 0: not at all.
double flush_threshold(const Options& options) { return rest_of(options) == Rest::flush ? flushed_below : 0; }

/// Scalars of a particle's state: positions or displacements of two steps, or those and the increment.
int state_arrays(Formulation formulation) {
    if (formulation == Formulation::compensated) return 2 * (6 + 3);
    return by_increments(formulation) ? 6 + 3 : 6;
}

/// The neighbour bits of the directions to visit: those in which any particle has a neighbour.
std::uint32_t bits_in_use(const Problem& problem, const Options& options) {
    if (all_terms(options)) return NEIGHBOUR_BITS;
    std::uint32_t bits = 0;
    for (const std::uint32_t mask : problem.lattice.mask) bits |= mask;
    return bits & NEIGHBOUR_BITS;
}

/// The lattice with rows of whole blocks. In front of it and behind it lies a guard as long as the farthest
/// neighbour is away, so that every register of neighbours can be loaded.
template <class T>
struct PaddedGrid {
    glm::ivec3 dims;
    std::ptrdiff_t row, slice, guard;

    explicit PaddedGrid(glm::ivec3 d)
        : dims(d),
          row((d.x + block_size<T> - 1) / block_size<T> * block_size<T>),
          slice(row * d.y),
          guard(slice + row + block_size<T>) {}

    std::ptrdiff_t size() const { return guard + slice * dims.z + guard; }
    std::ptrdiff_t element(glm::ivec3 c) const { return guard + slice * c.z + row * c.y + c.x; }
    /// A row's blocks, rows and slices.
    glm::ivec3 blocks() const { return {int(row / block_size<T>), dims.y, dims.z}; }
    /// Force densities of one direction and one slice, with guards as above.
    std::ptrdiff_t density_guard() const { return row + block_size<T>; }
    std::ptrdiff_t densities() const { return density_guard() + slice + density_guard(); }
};

/// Empty, or why `problem` cannot run.
template <class T>
std::string refusal(const Problem& problem) {
    const glm::ivec3 d = problem.lattice.dims;
    if (problem.lattice.voxel_count() == 0) return "implicit addressing needs a lattice";
    if (!problem.springs.empty()) return "implicit addressing has no springs beyond the lattice";
    // In floating point, which does not overflow: an upper bound on the bytes of 24 arrays (copy_in)
    // over the padded grid, against what 64-bit systems give a process to address.
    const double rows = (double(d.y) + 4) * (double(d.z) + 4);
    if ((d.x + double(block_size<T>)) * rows * 24 * sizeof(T) < std::ldexp(1.0, 47)) return {};
    return "a grid of " + std::to_string(d.x) + " x " + std::to_string(d.y) + " x " + std::to_string(d.z) +
           " with rows padded to " + std::to_string(block_size<T>) + " exceeds the address space";
}

template <class T>
using Array = hwy::AlignedFreeUniquePtr<T[]>;

/// Elements or particles from which on copying them is worth starting threads.
constexpr std::ptrdiff_t worth_threads = 1 << 16;

template <class T>
Array<T> filled(std::ptrdiff_t size, T value) {
    Array<T> array = hwy::AllocateAligned<T>(std::size_t(size));
    if (array == nullptr) {
        throw DeviceError("cannot allocate " + std::to_string(std::size_t(size) * sizeof(T)) + " bytes");
    }
    // Each thread is the first to touch, and so has in its own memory, about what it will step.
    T* const begin = array.get();
#pragma omp parallel for schedule(static) if (size >= worth_threads)
    for (std::ptrdiff_t i = 0; i < size; ++i) begin[i] = value;
    return array;
}

template <class T>
class CpuParallel final : public MonitoredCpuBackend {
public:
    explicit CpuParallel(const Options& options)
        : options_(options),
          formulation_(options.formulation),
          root_(root_of(options)),
          sleep_(sleep_threshold(options)),
          flush_(flush_threshold(options)),
          flushes_subnormals_(options.tuning.at("subnormals") == "flush"),
          threads_(thread_count(options)) {}

    Capabilities capabilities() const override { return cpu_capabilities(target_name(), threads_); }

    std::string unsupported(const Problem& problem) const override { return refusal<T>(problem); }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        problem_ = &edited;
        std::uint32_t bits = bits_;
        for (const SpringEdit::Touched& touched : edit.touched) {
            const std::ptrdiff_t element = element_of(touched.particle);
            mask_[std::size_t(element)] = touched.mask;
            bits |= touched.mask & NEIGHBOUR_BITS;
            // A block with a particle is listed, and has no other guards than those that end its row.
            const auto next = std::upper_bound(blocks_.begin(), blocks_.end(), element,
                                               [](auto e, const Block& block) { return e < block.first; });
            Block& block = *std::prev(next);
            block.whole = is_whole(block.first);
            tiles_->wake(block.tile, step_);
        }
        if (bits == bits_) return;
        // Springs in a direction that had none so far.
        bits_ = bits;
        list_blocks();
        deal_out();
    }

    State download() override {
        State state = state_at_rest(*problem_);
        const auto current = std::size_t(step_ % 2);
        const auto particles = std::ptrdiff_t(problem_->particle_count());
#pragma omp parallel for schedule(static) if (particles >= worth_threads)
        for (std::ptrdiff_t particle = 0; particle < particles; ++particle) {
            const auto i = std::size_t(particle);
            const auto element = std::size_t(element_of(i));
            const auto part = [element](const Array<T>& array) {
                return array == nullptr ? 0.0 : double(array[element]);
            };
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const int a = int(axis);
                const double at = part(at_[current][axis]);
                const double rest = on_positions(formulation_) ? problem_->rest_position[i][a] : 0;
                state.displacement[i][a] = at - rest + part(at_low_[current][axis]);
                state.increment[i][a] = by_increments(formulation_)
                                            ? part(increment_[axis]) + part(increment_low_[axis])
                                            : at - part(at_[1 - current][axis]);
            }
        }
        return state;
    }

    WorkCount count_work() override {
        if (!policy_.may_check()) return {};
        step(1);
        return {{"tiles", tiles_->used()},
                {"tiles_stepped", policy_.checks() ? tiles_stepped() : tiles_->used()}};
    }

    StepWork step_work(const Problem& problem) const override {
        const bool all = all_terms(options_);
        const bool has_load = all || !problem.load.empty();
        const std::uint32_t whole = bits_in_use(problem, options_) | ACTIVE_BIT;
        std::uint64_t masks = 0;        // read: of particles that can lie in no whole block
        std::uint64_t evaluations = 0;  // of a spring's force density: springs along x are evaluated twice
        for (const std::uint32_t mask : problem.lattice.mask) {
            masks += all || mask != whole ? 1 : 0;
            const std::uint32_t twice = all ? NEIGHBOUR_BITS : along_x;
            evaluations += std::uint64_t(std::popcount(mask & twice) + std::popcount(mask & ~twice & higher));
        }
        const std::uint64_t particles = problem.particle_count();
        const std::uint64_t ends = 2 * count_springs(problem).total();
        // Of the state the one of two steps that is overwritten is written but, in place of increments, read.
        const std::uint64_t state = std::uint64_t(state_arrays(formulation_)) / 3 * 4;
        const std::uint64_t arrays = (by_increments(formulation_) ? state : 9) + (has_load ? 3 : 0) +
                                     (all || problem.has_materials() ? 1 : 0) +
                                     (problem.has_materials() ? 1 : 0);
        // force_density() 5 + 1 + 1 + 3; strain_density() without the offset 3 + 5 + 1 + 5 + 1 + 1 + 4; and 2
        // more for a stiffness that materials give.
        const std::uint64_t density =
            (by_increments(formulation_) ? 20 : 10) + (problem.has_materials() ? 2 : 0);
        // Either end of a spring: u_i - u_j or x_i - x_j 3, and twice that more where it has low parts; the
        // offset that it makes 3; force 3; sum 3.
        const bool split = formulation_ == Formulation::compensated;
        const std::uint64_t end = 9 + (split ? 6 : 0) + (on_positions(formulation_) ? 0 : 3);
        // A particle: next_position() or increment_change() and two sums 21; each sum that is split 33
        // instead of 3.
        return {.bytes = (particles * arrays + masks) * sizeof(T),
                .operations = evaluations * density + ends * end +
                              particles * (21 + (split ? 60 : 0) + (has_load ? 3 : 0))};
    }

private:
    using Vector = std::array<Array<T>, 3>;

    /// The mask bits of the neighbours along x, and of all those at a higher index.
    static constexpr std::uint32_t along_x = 0x3, higher = NEIGHBOUR_BITS & 0xAAAAAAAA;
    /// A tile sleeps once it and those around it were slow for that many steps.
    static constexpr int steps_to_sleep = 8;
    /// Tiles from which on rest=auto checks at all: a step of less takes some 50 us.
    static constexpr std::size_t min_checked_tiles = 128;

    /// A thread's part of every step.
    struct Share {
        Array<T> density;
        std::array<std::vector<Opposites<T>>, 2> opposites;
        Tiles::Share tiles;
        Task<T> task{};
    };

    void begin(const Problem& problem, const State& state) override {
        problem_ = &problem;
        step_ = 0;
        grid_ = std::make_unique<PaddedGrid<T>>(problem.lattice.dims);
        copy_in(state);
        bits_ = bits_in_use(problem, options_);
        list_blocks();
        deal_out();
        start_policy();
    }

    void start_policy() {
        const Rest rest = rest_of(options_);
        const bool always = rest == Rest::skip || rest == Rest::flush || sleep_ > 0;
        const bool chooses = rest == Rest::choose && !always && stays_at_rest(*problem_) &&
                             tiles_->used() >= min_checked_tiles;
        const bool any = !all_terms(options_);
        policy_.start(any && (always || chooses), any && chooses);
    }

    void advance(int count) override {
        while (count > 0) {
            if (policy_.is_due()) choose();
            const int steps = std::min(count, policy_.steps_to_decision());
            run_steps(steps);
            policy_.stepped(steps);
            count -= steps;
        }
    }

    void choose() {
        if (policy_.checks()) {
            policy_.decide(tiles_stepped(), tiles_->used());
        } else {
            policy_.begin_checks();
            tiles_->wake_all(step_);
        }
    }

    std::size_t tiles_stepped() const {
        std::vector<const Tiles::Share*> all;
        for (const Share& share : shares_) all.push_back(&share.tiles);
        return tiles_->stepped(all);
    }

    void run_steps(int count) {
        Barrier barrier;
        const bool checks = policy_.checks();
#pragma omp parallel num_threads(int(shares_.size()))
        {
            // Each share to the same thread every time. Should OpenMP grant fewer threads, some take several.
            const auto threads = std::size_t(omp_get_num_threads());
            const FlushSubnormals flush(flushes_subnormals_);
#pragma omp single
            barrier.expect(int(threads));
            for (std::int64_t step = step_ + 1; step <= step_ + count; ++step) {
                for (auto s = std::size_t(omp_get_thread_num()); s < shares_.size(); s += threads) {
                    Share& share = shares_[s];
                    Task<T> task = task_from(share, step - 1);
                    if (checks) {
                        tiles_->decide(share.tiles, step);
                        task.action = share.tiles.action.data();
                        task.lively = share.tiles.lively.data();
                    }
                    cpu_parallel::step(task, formulation_, root_);
                    if (checks) tiles_->settle(share.tiles, step);
                }
                barrier.wait();
            }
        }
        step_ += count;
    }

    bool within(double largest_increment) override {
        bool all = true;
#pragma omp parallel for num_threads(int(shares_.size())) schedule(static, 1) reduction(&& : all)
        for (std::size_t s = 0; s < shares_.size(); ++s) {
            all = all && cpu_parallel::within(task_from(shares_[s], step_), formulation_, largest_increment);
        }
        return all;
    }

    std::ptrdiff_t element_of(std::size_t particle) const {
        return grid_->element(problem_->lattice.coordinates(problem_->lattice.voxel[particle]));
    }

    void copy_in(const State& state) {
        const Problem& problem = *problem_;
        // NaN in whatever holds no particle: a leak into a particle's force cannot go unseen.
        const auto array = [&] { return filled(grid_->size(), std::numeric_limits<T>::quiet_NaN()); };
        const bool all = all_terms(options_);
        const bool has_load = all || !problem.load.empty();
        const bool split = formulation_ == Formulation::compensated;
        mask_ = filled<MaskOf<T>>(grid_->size(), 0);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            for (std::size_t parity = 0; parity < 2; ++parity) {
                at_[parity][axis] = array();
                at_low_[parity][axis] = split ? array() : nullptr;
            }
            increment_[axis] = by_increments(formulation_) ? array() : nullptr;
            increment_low_[axis] = split ? array() : nullptr;
            load_[axis] = has_load ? array() : nullptr;
        }
        inverse_mass_ = all || problem.has_materials() ? array() : nullptr;
        compliance_ = problem.has_materials() ? array() : nullptr;
        const auto particles = std::ptrdiff_t(problem.particle_count());
#pragma omp parallel for schedule(static) if (particles >= worth_threads)
        for (std::ptrdiff_t particle = 0; particle < particles; ++particle) {
            const auto i = std::size_t(particle);
            const auto element = std::size_t(element_of(i));
            mask_[element] = problem.lattice.mask[i];
            const glm::dvec3 at = on_positions(formulation_)
                                      ? problem.rest_position[i] + state.displacement[i]
                                      : state.displacement[i];
            const glm::dvec3 before = at - state.increment[i];
            const glm::dvec3 load = problem.load.empty() ? glm::dvec3(0) : problem.load[i];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const int a = int(axis);
                const auto put = [element](Array<T>& to, double value) {
                    if (to != nullptr) to[element] = T(value);
                };
                const double increment = state.increment[i][a];
                put(at_[0][axis], at[a]);
                put(at_low_[0][axis], at[a] - double(T(at[a])));
                put(at_[1][axis], before[a]);
                put(increment_[axis], increment);
                put(increment_low_[axis], increment - double(T(increment)));
                put(load_[axis], load[a]);
            }
            const Material& material = problem.material_of(i);
            if (inverse_mass_ != nullptr) inverse_mass_[element] = T(1 / material.mass);
            if (compliance_ != nullptr) compliance_[element] = T(1 / material.stiffness);
        }
    }

    bool is_whole(std::ptrdiff_t first) const {
        const MaskOf<T>* begin = mask_.get() + first;
        return !all_terms(options_) && std::all_of(begin, begin + block_size<T>, [this](auto mask) {
            return mask == (bits_ | ACTIVE_BIT);
        });
    }

    void list_blocks() {
        const bool all = all_terms(options_);
        blocks_.clear();
        tiles_ = std::make_unique<Tiles>(grid_->blocks(), sleep_ > 0 ? steps_to_sleep : 1);
        for (int z = 0; z < grid_->dims.z; ++z) {
            const std::ptrdiff_t slice = grid_->element({0, 0, z});
            for (std::ptrdiff_t in_slice = 0; in_slice < grid_->slice; in_slice += block_size<T>) {
                const MaskOf<T>* begin = mask_.get() + slice + in_slice;
                const MaskOf<T>* end = begin + block_size<T>;
                if (!all && std::all_of(begin, end, [](auto mask) { return mask == 0; })) continue;
                const std::ptrdiff_t block = slice + in_slice;
                const std::uint32_t tile =
                    tiles_->at({int(in_slice % grid_->row / block_size<T>), int(in_slice / grid_->row), z});
                tiles_->use(tile);
                blocks_.push_back({block, in_slice, tile, z % 2 != 0, is_whole(block)});
            }
        }
        tiles_->wake_all(step_);
    }

    void deal_out() {
        const auto count = std::size_t(share_count(options_, std::ptrdiff_t(blocks_.size())));
        shares_.clear();
        for (std::size_t s = 0; s < count; ++s) {
            Share& share = shares_.emplace_back();
            fill_opposites(share);
            Task<T>& task = share.task;
            task = uniform_task();
            task.opposites = {share.opposites[0].data(), share.opposites[1].data()};
            task.opposites_count = share.opposites[0].size();
            for (const Opposites<T>& pair : share.opposites[0])
                task.farthest = std::max(task.farthest, pair.stride);
            const Block* const first = blocks_.data();
            task.begin = first + blocks_.size() * s / count;
            task.end = first + blocks_.size() * (s + 1) / count;
            // From there on blocks have higher neighbours in this share.
            const std::ptrdiff_t lead = task.begin->first - grid_->slice - grid_->row - block_size<T>;
            task.lead = std::lower_bound(first, task.begin, lead, [](const Block& block, auto element) {
                return block.first < element;
            });
            const auto [least, most] = std::minmax_element(
                task.lead, task.end, [](const Block& a, const Block& b) { return a.tile < b.tile; });
            share.tiles = tiles_->share(least->tile, most->tile + 1);
        }
    }

    /// The share's next step, from state `step`.
    Task<T> task_from(const Share& share, std::int64_t step) const {
        const auto pointers = [](const Vector& v) {
            return std::array<T*, 3>{v[0].get(), v[1].get(), v[2].get()};
        };
        const auto constant = [](const Vector& v) {
            return std::array<const T*, 3>{v[0].get(), v[1].get(), v[2].get()};
        };
        const auto current = std::size_t(step % 2);
        Task<T> task = share.task;
        task.at = constant(at_[current]);
        task.next = pointers(at_[1 - current]);
        task.at_low = constant(at_low_[current]);
        task.next_low = pointers(at_low_[1 - current]);
        task.increment = pointers(increment_);
        task.increment_low = pointers(increment_low_);
        return task;
    }

    void fill_opposites(Share& share) {
        if (bits_ == 0) return;
        const auto pairs = std::ptrdiff_t(std::popcount(bits_) / 2);
        share.density = filled(2 * pairs * grid_->densities(), T(0));
        T* density = share.density.get() + grid_->density_guard();
        for (const Direction& direction : directions()) {
            if (direction.bit % 2 == 0 || (bits_ >> direction.bit & 1u) == 0) continue;
            const glm::ivec3 o = direction.offset;
            const std::ptrdiff_t stride_in_slice = o.y * grid_->row + o.x;
            const std::ptrdiff_t stride = o.z * grid_->slice + stride_in_slice;
            const RestSpring rest = rest_spring(*problem_, direction);
            const std::array<T*, 2> of_slice = {density, density + grid_->densities()};
            density += 2 * grid_->densities();
            // Neighbours along x lie in the same register or were left in the latest: a load that overlaps
            // a store so recent waits longer than the evaluation takes.
            const bool waits = !all_terms(options_) && stride != 1;
            for (std::size_t odd = 0; odd < 2; ++odd) {
                const T* const lower = of_slice[(odd + std::size_t(o.z)) % 2] - stride_in_slice;
                share.opposites[odd].push_back(
                    {.stride = stride,
                     .lower_bit = MaskOf<T>(1) << (direction.bit - 1),
                     .higher_bit = MaskOf<T>(1) << direction.bit,
                     .rest_offset = {T(rest.offset.x), T(rest.offset.y), T(rest.offset.z)},
                     .rest_length = T(rest.length),
                     .rest_deficit = T(rest.deficit),
                     .stiffness = T(problem_->group_stiffness[std::size_t(direction.group)]),
                     .lower_density = waits ? lower : nullptr,
                     .higher_density = waits ? of_slice[odd] : nullptr});
            }
        }
    }

    Task<T> uniform_task() const {
        const glm::dvec3 g = problem_->gravity;
        Task<T> task{};
        task.load = {load_[0].get(), load_[1].get(), load_[2].get()};
        task.mask = mask_.get();
        task.inverse_mass = inverse_mass_.get();
        task.compliance = compliance_.get();
        task.shortest_squared = T(problem_->shortest_squared());
        task.uniform_inverse_mass = T(1 / problem_->materials[0].mass);
        task.gravity = {T(g.x), T(g.y), T(g.z)};
        const glm::dvec3 spacing = problem_->lattice.spacing;
        const double shortest = std::min({spacing.x, spacing.y, spacing.z});
        task.slow = T(sleep_ * shortest);
        task.flush = T(flush_ * shortest);
        task.damping = T(problem_->damping);
        task.retained = T(1 - problem_->damping);
        task.doubled = T(2 - problem_->damping);
        task.time_step_squared = T(problem_->time_step * problem_->time_step);
        return task;
    }

    const Options options_;
    const Formulation formulation_;
    const Root root_;
    const double sleep_, flush_;  ///< in spacings; 0: no
    const bool flushes_subnormals_;
    const int threads_;
    const Problem* problem_ = nullptr;
    std::int64_t step_ = 0;  ///< since upload()
    std::unique_ptr<PaddedGrid<T>> grid_;
    std::uint32_t bits_ = 0;  ///< of the directions to visit
    Array<MaskOf<T>> mask_;
    /// x or u of an even and of an odd step: the one is read while the other is overwritten.
    std::array<Vector, 2> at_, at_low_;
    Vector increment_, increment_low_, load_;
    Array<T> inverse_mass_, compliance_;
    std::vector<Block> blocks_;
    std::vector<Share> shares_;
    std::unique_ptr<Tiles> tiles_;
    /// To check tiles costs a little, and pays where an eighth of them rests.
    RestPolicy policy_{
        {.period = 16, .min_pause = 64, .max_pause = 1024, .paying_numerator = 7, .paying_denominator = 8}};
};

template <class T>
std::uint64_t bytes(const Problem& problem, const Options& options) {
    if (!refusal<T>(problem).empty()) return 0;
    const PaddedGrid<T> grid(problem.lattice.dims);
    const bool all = all_terms(options);
    const int arrays = 1 + state_arrays(options.formulation) + (all || !problem.load.empty() ? 3 : 0) +
                       (all || problem.has_materials() ? 1 : 0) + (problem.has_materials() ? 1 : 0);
    const std::ptrdiff_t blocks = grid.slice / block_size<T> * grid.dims.z;
    const std::ptrdiff_t shares = share_count(options, blocks);
    return std::uint64_t(grid.size() * arrays * std::ptrdiff_t(sizeof(T)) +
                         shares * std::popcount(bits_in_use(problem, options)) * grid.densities() *
                             std::ptrdiff_t(sizeof(T)) +
                         blocks * std::ptrdiff_t(sizeof(Block))) +
           Tiles::bytes(grid.blocks(), std::size_t(shares));
}

const Registered entry({
    .name = "cpu_parallel",
    .summary = "Every core and its SIMD registers: implicit addressing on a padded grid.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"threads", {}},
               {"terms", {"needed", "all"}},
               {"root", {"exact", "refined", "raw"}},
               {"rest", {"auto", "step", "skip", "flush"}},
               {"sleep", {"off", "1e-3", "1e-4", "1e-5", "1e-6"}},
               {"subnormals", {"flush", "keep"}}},
    .make = [](const Options& options) -> std::unique_ptr<Backend> {
        if (options.precision == Precision::float32) return std::make_unique<CpuParallel<float>>(options);
        return std::make_unique<CpuParallel<double>>(options);
    },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return options.precision == Precision::float32 ? bytes<float>(problem, options)
                                                           : bytes<double>(problem, options);
        },
    // What sleeps stands still where it would have moved by less than that.
    .admitted_spacings_per_step = sleep_threshold,
    .refused_options = refused_options,
});

}  // namespace
}  // namespace voxspring
