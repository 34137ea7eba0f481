// Every core and its SIMD registers: a gather over a padded grid with implicit addressing.
//
// State is a structure of arrays (x, y, z) over the grid, whose rows are padded to whole blocks of 64
// bytes; a neighbour is a constant number of elements away. Only blocks with active voxels are listed, and
// threads share the list evenly. A spring is evaluated once, when its lower end is stepped: its force
// density then waits in a buffer for the higher end, which multiplies its own offset with it. That is
// the force that it would have evaluated itself, to the bit; so forces, summed in the order of
// neighbours.h, depend neither on the number of threads nor on the width of a register.
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

#include "backends/cpu_backend.h"
#include "backends/physics/neighbours.h"
#include "backends/registry.h"

// Lanes has a register as a member, which those of unknown size cannot be.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
// Compile this file, as far as HWY_ONCE, for every SIMD target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backends/cpu_parallel.cpp"
#include <hwy/foreach_target.h>

#include "backends/simd/lanes-inl.h"

#ifndef VOXSPRING_CPU_PARALLEL_TYPES  // the same for every target
#define VOXSPRING_CPU_PARALLEL_TYPES
namespace voxspring {
namespace {

/// A mask as wide as the scalars, so that both fill the same registers.
template <class T>
using MaskOf = hwy::MakeUnsigned<T>;

/// Elements of a block: a register of the widest target.
template <class T>
constexpr std::ptrdiff_t block_size = 64 / sizeof(T);

struct Block {
    std::ptrdiff_t first;     ///< its first element
    std::ptrdiff_t in_slice;  ///< the same, counted from the start of its slice of constant z
    bool odd_slice;
    bool whole;  ///< every voxel has a particle that can move and has a neighbour in every direction in use
};

/// Two opposite directions, as a block in an even or an odd slice sees them.
template <class T>
struct Opposites {
    std::ptrdiff_t stride;  ///< elements from a particle to the higher neighbour; to the lower: -stride
    MaskOf<T> lower_bit, higher_bit;
    T rest_length;
    T stiffness;
    /// Where the force densities wait, by the particle's element in its slice: that of the spring to the
    /// lower neighbour, left by it, and that of the spring to the higher one. Null: evaluate both springs.
    const T* lower_density;
    T* higher_density;
};

/// One step of one thread's share.
template <class T>
struct Task {
    std::array<const T*, 3> position;
    std::array<T*, 3> next;        ///< holds the previous positions until it is overwritten
    std::array<const T*, 3> load;  ///< null: none
    const MaskOf<T>* mask;
    const T* inverse_mass;                         ///< one a particle; null: all the same
    const T* compliance;                           ///< one a particle; null: a stiffness a direction
    std::array<const Opposites<T>*, 2> opposites;  ///< of even and of odd slices
    std::size_t opposites_count;
    const Block *lead, *begin, *end;  ///< densities alone are needed of [lead, begin)
    T shortest_squared;
    T uniform_inverse_mass;
    std::array<T, 3> gravity;
    T retained;
    T time_step_squared;
};

}  // namespace
}  // namespace voxspring
#endif

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {
namespace {

template <class T, class Pointer>
HWY_INLINE Lanes3<T> load3(const std::array<Pointer, 3>& from, std::ptrdiff_t i) {
    return {Lanes<T>::load(from[0] + i), Lanes<T>::load(from[1] + i), Lanes<T>::load(from[2] + i)};
}

template <class T>
using MaskTag = hn::RebindToUnsigned<typename Lanes<T>::Tag>;

/// Lane by lane `a` where `chosen`, else `b`; what the other holds is dropped, a NaN included.
template <class T, class Chosen>
HWY_INLINE Lanes3<T> select(Chosen chosen, Lanes3<T> a, Lanes3<T> b) {
    const auto m = hn::RebindMask(typename Lanes<T>::Tag(), chosen);
    return {Lanes<T>(hn::IfThenElse(m, a.x.v, b.x.v)), Lanes<T>(hn::IfThenElse(m, a.y.v, b.y.v)),
            Lanes<T>(hn::IfThenElse(m, a.z.v, b.z.v))};
}

/// Stiffness of the springs between elements i.. and `neighbour`..
template <class T>
HWY_INLINE Lanes<T> stiffness(const Task<T>& task, const Opposites<T>& pair, std::ptrdiff_t i,
                              std::ptrdiff_t neighbour) {
    if (task.compliance == nullptr) return Lanes<T>(pair.stiffness);
    return series_stiffness(Lanes<T>::load(task.compliance + i), Lanes<T>::load(task.compliance + neighbour));
}

/// Leave the force densities of the springs to the higher neighbours of a register of particles.
template <class T>
HWY_INLINE void leave_densities(const Task<T>& task, const Block& block, std::ptrdiff_t lane) {
    const std::ptrdiff_t i = block.first + lane;
    const Lanes3<T> x = load3<T>(task.position, i);
    for (std::size_t p = 0; p < task.opposites_count; ++p) {
        const Opposites<T>& pair = task.opposites[block.odd_slice][p];
        if (pair.higher_density == nullptr) continue;
        const std::ptrdiff_t higher = i + pair.stride;
        force_density(x - load3<T>(task.position, higher), Lanes<T>(pair.rest_length),
                      stiffness(task, pair, i, higher), Lanes<T>(task.shortest_squared))
            .store(pair.higher_density + block.in_slice + lane);
    }
}

/// Step a register of particles. `whole`: as in Block, so that nothing needs masking.
template <bool whole, class T>
HWY_INLINE void step_particles(const Task<T>& task, const Block& block, std::ptrdiff_t lane) {
    const std::ptrdiff_t i = block.first + lane;
    const MaskTag<T> tag;
    const auto mask = hn::LoadU(tag, task.mask + i);
    const Lanes<T> shortest_squared(task.shortest_squared);
    const Lanes3<T> x = load3<T>(task.position, i);
    Lanes3<T> force{Lanes<T>(T(0)), Lanes<T>(T(0)), Lanes<T>(T(0))};
    const auto add = [&](MaskOf<T> bit, Lanes3<T> f) HWY_ATTR {
        force = whole ? force + f : select(hn::TestBit(mask, hn::Set(tag, bit)), force + f, force);
    };
    for (std::size_t p = 0; p < task.opposites_count; ++p) {
        const Opposites<T>& pair = task.opposites[block.odd_slice][p];
        const Lanes<T> rest_length(pair.rest_length);
        const std::ptrdiff_t lower = i - pair.stride;
        const std::ptrdiff_t higher = i + pair.stride;
        const Lanes3<T> from_lower = x - load3<T>(task.position, lower);
        const Lanes3<T> from_higher = x - load3<T>(task.position, higher);
        const Lanes<T> higher_density =
            force_density(from_higher, rest_length, stiffness(task, pair, i, higher), shortest_squared);
        if (pair.higher_density == nullptr) {
            add(pair.lower_bit,
                spring_force(from_lower, rest_length, stiffness(task, pair, i, lower), shortest_squared));
        } else {
            higher_density.store(pair.higher_density + block.in_slice + lane);
            add(pair.lower_bit, from_lower * Lanes<T>::load(pair.lower_density + block.in_slice + lane));
        }
        add(pair.higher_bit, from_higher * higher_density);
    }
    if (task.load[0] != nullptr) force = force + load3<T>(task.load, i);
    const Lanes<T> inverse_mass = task.inverse_mass != nullptr ? Lanes<T>::load(task.inverse_mass + i)
                                                               : Lanes<T>(task.uniform_inverse_mass);
    // Without gravity or damping its term is neutral rather than skipped: six instructions on constants,
    // in some three hundred, whose cost could not be measured.
    const Lanes3<T> gravity{Lanes<T>(task.gravity[0]), Lanes<T>(task.gravity[1]), Lanes<T>(task.gravity[2])};
    Lanes3<T> next = next_position(x, load3<T>(task.next, i), force, inverse_mass, gravity,
                                   Lanes<T>(task.retained), Lanes<T>(task.time_step_squared));
    if (!whole) {
        const auto bits = hn::And(mask, hn::Set(tag, ACTIVE_BIT | PINNED_BIT));
        next = select(hn::Eq(bits, hn::Set(tag, ACTIVE_BIT)), next, x);
    }
    next.x.store(task.next[0] + i);
    next.y.store(task.next[1] + i);
    next.z.store(task.next[2] + i);
}

template <class T>
HWY_FLATTEN void run_task(const Task<T>& task) {
    constexpr std::ptrdiff_t width = Lanes<T>::count();
    for (const Block* block = task.lead; block != task.begin; ++block) {
        for (std::ptrdiff_t lane = 0; lane < block_size<T>; lane += width)
            leave_densities(task, *block, lane);
    }
    for (const Block* block = task.begin; block != task.end; ++block) {
        if (block->whole) {
            for (std::ptrdiff_t lane = 0; lane < block_size<T>; lane += width)
                step_particles<true>(task, *block, lane);
        } else {
            for (std::ptrdiff_t lane = 0; lane < block_size<T>; lane += width)
                step_particles<false>(task, *block, lane);
        }
    }
}

void run_float32(const Task<float>& task) { run_task(task); }
void run_float64(const Task<double>& task) { run_task(task); }
const char* target_name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace
}  // namespace voxspring::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace voxspring {
namespace {

HWY_EXPORT(run_float32);
HWY_EXPORT(run_float64);
HWY_EXPORT(target_name);

void run_on_best_target(const Task<float>& task) { HWY_DYNAMIC_DISPATCH(run_float32)(task); }
void run_on_best_target(const Task<double>& task) { HWY_DYNAMIC_DISPATCH(run_float64)(task); }

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
    // In floating point, which does not overflow: an upper bound on the bytes of twelve arrays (copy_in)
    // over the padded grid, against what 64-bit systems give a process to address.
    const double rows = (double(d.y) + 4) * (double(d.z) + 4);
    if ((d.x + double(block_size<T>)) * rows * 12 * sizeof(T) < std::ldexp(1.0, 47)) return {};
    return "a grid of " + std::to_string(d.x) + " x " + std::to_string(d.y) + " x " + std::to_string(d.z) +
           " with rows padded to " + std::to_string(block_size<T>) + " exceeds the address space";
}

template <class T>
using Array = hwy::AlignedFreeUniquePtr<T[]>;

template <class T>
Array<T> filled(std::ptrdiff_t size, T value) {
    Array<T> array = hwy::AllocateAligned<T>(std::size_t(size));
    if (array == nullptr) {
        throw DeviceError("cannot allocate " + std::to_string(std::size_t(size) * sizeof(T)) + " bytes");
    }
    std::fill_n(array.get(), size, value);
    return array;
}

template <class T>
class CpuParallel final : public CpuBackend {
public:
    explicit CpuParallel(const Options& options) : options_(options), threads_(thread_count(options)) {}

    Capabilities capabilities() const override {
        return cpu_capabilities(HWY_DYNAMIC_DISPATCH(target_name)(), threads_);
    }

    std::string unsupported(const Problem& problem) const override { return refusal<T>(problem); }

    void begin(const Problem& problem, const State& state) override {
        problem_ = &problem;
        grid_ = std::make_unique<PaddedGrid<T>>(problem.lattice.dims);
        copy_in(state);
        bits_ = bits_in_use(problem, options_);
        list_blocks();
        deal_out();
    }

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
        }
        if (bits == bits_) return;
        // Springs in a direction that had none so far.
        bits_ = bits;
        list_blocks();
        deal_out();
    }

    bool within(double) override { return true; }

    void advance(int count) override {
        Barrier barrier;
#pragma omp parallel num_threads(int(shares_.size()))
        {
            // Each share to the same thread every time. Should OpenMP grant fewer threads, some take several.
            const auto threads = std::size_t(omp_get_num_threads());
#pragma omp single
            barrier.expect(int(threads));
            for (int n = 0; n < count; ++n) {
                for (auto s = std::size_t(omp_get_thread_num()); s < shares_.size(); s += threads) {
                    Task<T> task = shares_[s].task;
                    for (std::size_t axis = 0; axis < 3; ++axis) {
                        task.position[axis] = (n % 2 == 0 ? position_ : previous_)[axis].get();
                        task.next[axis] = (n % 2 == 0 ? previous_ : position_)[axis].get();
                    }
                    run_on_best_target(task);
                }
                barrier.wait();
            }
        }
        if (count % 2 != 0) std::swap(position_, previous_);
    }

    State download() override {
        State state = state_at_rest(*problem_);
        for (std::size_t i = 0; i < problem_->particle_count(); ++i) {
            const auto element = std::size_t(element_of(i));
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const double x = double(position_[axis][element]);
                const int a = int(axis);
                state.displacement[i][a] = x - problem_->rest_position[i][a];
                state.increment[i][a] = x - double(previous_[axis][element]);
            }
        }
        return state;
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
        const std::uint64_t arrays = 9 + (has_load ? 3 : 0) + (all || problem.has_materials() ? 1 : 0) +
                                     (problem.has_materials() ? 1 : 0);
        return {.bytes = (particles * arrays + masks) * sizeof(T),
                // A force density 5 + 1 + 1 + 3, and 2 more for its stiffness where materials give it. Either
                // end of a spring: offset 3, force 3, sum 3. A particle: next_position() 21.
                .operations = evaluations * (10 + (problem.has_materials() ? 2 : 0)) + ends * 9 +
                              particles * (21 + (has_load ? 3 : 0))};
    }

private:
    /// The mask bits of the neighbours along x, and of all those at a higher index.
    static constexpr std::uint32_t along_x = 0x3, higher = NEIGHBOUR_BITS & 0xAAAAAAAA;

    /// A thread's part of every step.
    struct Share {
        Array<T> density;
        std::array<std::vector<Opposites<T>>, 2> opposites;
        Task<T> task{};
    };

    std::ptrdiff_t element_of(std::size_t particle) const {
        return grid_->element(problem_->lattice.coordinates(problem_->lattice.voxel[particle]));
    }

    void copy_in(const State& state) {
        const Problem& problem = *problem_;
        // NaN in whatever holds no particle: a leak into a particle's force cannot go unseen.
        const auto array = [&] { return filled(grid_->size(), std::numeric_limits<T>::quiet_NaN()); };
        const bool all = all_terms(options_);
        const bool has_load = all || !problem.load.empty();
        mask_ = filled<MaskOf<T>>(grid_->size(), 0);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            position_[axis] = array();
            previous_[axis] = array();
            load_[axis] = has_load ? array() : nullptr;
        }
        inverse_mass_ = all || problem.has_materials() ? array() : nullptr;
        compliance_ = problem.has_materials() ? array() : nullptr;
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const auto element = std::size_t(element_of(i));
            mask_[element] = problem.lattice.mask[i];
            const glm::dvec3 position = problem.rest_position[i] + state.displacement[i];
            const glm::dvec3 previous = position - state.increment[i];
            const glm::dvec3 load = problem.load.empty() ? glm::dvec3(0) : problem.load[i];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                position_[axis][element] = T(position[int(axis)]);
                previous_[axis][element] = T(previous[int(axis)]);
                if (has_load) load_[axis][element] = T(load[int(axis)]);
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
        for (int z = 0; z < grid_->dims.z; ++z) {
            const std::ptrdiff_t slice = grid_->element({0, 0, z});
            for (std::ptrdiff_t in_slice = 0; in_slice < grid_->slice; in_slice += block_size<T>) {
                const MaskOf<T>* begin = mask_.get() + slice + in_slice;
                const MaskOf<T>* end = begin + block_size<T>;
                if (!all && std::all_of(begin, end, [](auto mask) { return mask == 0; })) continue;
                const std::ptrdiff_t block = slice + in_slice;
                blocks_.push_back({block, in_slice, z % 2 != 0, is_whole(block)});
            }
        }
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
            const Block* const first = blocks_.data();
            task.begin = first + blocks_.size() * s / count;
            task.end = first + blocks_.size() * (s + 1) / count;
            // From there on blocks have higher neighbours in this share.
            const std::ptrdiff_t lead = task.begin->first - grid_->slice - grid_->row - block_size<T>;
            task.lead = std::lower_bound(first, task.begin, lead, [](const Block& block, auto element) {
                return block.first < element;
            });
        }
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
                     .rest_length = T(problem_->rest_length[std::size_t(direction.bit)]),
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
        task.retained = T(1 - problem_->damping);
        task.time_step_squared = T(problem_->time_step * problem_->time_step);
        return task;
    }

    const Options options_;
    const int threads_;
    const Problem* problem_ = nullptr;
    std::unique_ptr<PaddedGrid<T>> grid_;
    std::uint32_t bits_ = 0;  ///< of the directions to visit
    Array<MaskOf<T>> mask_;
    std::array<Array<T>, 3> position_, previous_, load_;
    Array<T> inverse_mass_, compliance_;
    std::vector<Block> blocks_;
    std::vector<Share> shares_;
};

template <class T>
std::uint64_t bytes(const Problem& problem, const Options& options) {
    if (!refusal<T>(problem).empty()) return 0;
    const PaddedGrid<T> grid(problem.lattice.dims);
    const bool all = all_terms(options);
    const int arrays = 7 + (all || !problem.load.empty() ? 3 : 0) + (all || problem.has_materials() ? 1 : 0) +
                       (problem.has_materials() ? 1 : 0);
    const std::ptrdiff_t blocks = grid.slice / block_size<T> * grid.dims.z;
    const std::ptrdiff_t shares = share_count(options, blocks);
    return std::uint64_t(grid.size() * arrays * std::ptrdiff_t(sizeof(T)) +
                         shares * std::popcount(bits_in_use(problem, options)) * grid.densities() *
                             std::ptrdiff_t(sizeof(T)) +
                         blocks * std::ptrdiff_t(sizeof(Block)));
}

const Registered entry({
    .name = "cpu_parallel",
    .summary = "Every core and its SIMD registers: implicit addressing on a padded grid.",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {{"threads", {}}, {"terms", {"needed", "all"}}},
    .make = [](const Options& options) -> std::unique_ptr<Backend> {
        if (options.precision == Precision::float32) return std::make_unique<CpuParallel<float>>(options);
        return std::make_unique<CpuParallel<double>>(options);
    },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return options.precision == Precision::float32 ? bytes<float>(problem, options)
                                                           : bytes<double>(problem, options);
        },
});

}  // namespace
}  // namespace voxspring
#endif
