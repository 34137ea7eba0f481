// cpu_parallel: all cores and their SIMD registers. Each particle gathers the forces of its springs, on a
// padded grid with implicit addressing.
//
// State is a structure of arrays (x, y, z) over the grid, whose rows are padded to whole blocks of 64 bytes.
// A neighbour is a constant number of elements away. Only blocks with active voxels are listed (with
// terms=all, every block), and threads share the list evenly.
//
// Unless terms=all, a thread evaluates a spring that does not lie along x once, at its lower end (the
// particle with the lower index). A buffer keeps its force density (force divided by length) for the higher
// end, which multiplies the density with its offset to the lower end. The product has the same bits as if the
// higher end had evaluated the spring. So forces, summed in the order of neighbours.h, depend neither on the
// number of threads nor on the width of a register. Tiles of blocks at rest can be left out (tiles.h), which
// changes no bit either.
#include <omp.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/by_precision.h"
#include "backends/cpu/barrier.h"
#include "backends/cpu/cpu_backend.h"
#include "backends/cpu/kernel.h"
#include "backends/cpu/padded_state.h"
#include "backends/cpu/parallel_options.h"
#include "backends/cpu/subnormals.h"
#include "backends/cpu/tiles.h"
#include "backends/physics/addressing.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"
#include "backends/registry.h"
#include "backends/rest_policy.h"

namespace voxspring {
namespace {

using namespace cpu_parallel;

/// An empty string, or why `problem` cannot run.
template <class T>
std::string refusal(const Problem& problem) {
    const glm::ivec3 d = problem.lattice.dims;
    if (std::string why = implicit_refusal(problem); !why.empty()) return why;
    // Up to 24 arrays over the padded grid (PaddedState) must fit into the address space of a process on a
    // 64-bit system. This bound on their bytes is in floating point, which does not overflow.
    const double rows = (double(d.y) + 4) * (double(d.z) + 4);
    if ((d.x + double(block_size<T>)) * rows * 24 * sizeof(T) < std::ldexp(1.0, 47)) return {};
    return "a grid of " + std::to_string(d.x) + " x " + std::to_string(d.y) + " x " + std::to_string(d.z) +
           " with rows padded to multiples of " + std::to_string(block_size<T>) +
           " voxels exceeds the address space of a process";
}

template <class T>
class CpuParallel final : public MonitoredCpuBackend, public BorderFacet, public ToolFacet {
public:
    explicit CpuParallel(const Options& options)
        : options_(options),
          formulation_(options.formulation),
          root_(root_of(options)),
          sleep_(sleep_threshold(options)),
          flush_(flush_threshold(options)),
          flushes_subnormals_(options.tuning.at("subnormals") == "flush"),
          threads_(thread_count(options, "cpu_parallel")) {}

    Capabilities capabilities() const override {
        Capabilities all = cpu_capabilities(target_name(), threads_);
        all.has_borders = true;
        return all;
    }

    std::string unsupported(const Problem& problem) const override { return refusal<T>(problem); }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        problem_ = &edited;
        std::uint32_t bits = bits_;
        for (const SpringEdit::Touched& touched : edit.touched) {
            const std::ptrdiff_t element = state_.element_of(edited, touched.particle);
            state_.mask[std::size_t(element)] = touched.mask;
            bits |= touched.mask & NEIGHBOUR_BITS;
            Block& block = blocks_[block_of(element)];
            block.full_stencil = has_full_stencil(block.first);
            tiles_->mark_active(block.tile, step_);
        }
        if (bits == bits_) return;
        // The edit added springs in a direction in which the problem had none so far.
        bits_ = bits;
        list_blocks();
        deal_out();
    }

    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override {
        tool_moved_ = vector_of(displacement);
        // The tiles of the held particles may be at rest. A tool that moves makes them active.
        for (const Share& share : shares_) {
            for (const Held& held : share.held) tiles_->mark_active(held.tile, step_);
        }
    }
    glm::dvec3 tool_force() override {
        glm::dvec3 sum(0);
        for (const std::array<T, 3>& force : tool_forces_) sum -= glm::dvec3(force[0], force[1], force[2]);
        return sum;
    }

    State download() override { return state_.unpack(*problem_, formulation_, std::size_t(step_ % 2)); }

    BorderFacet* borders() override { return this; }
    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        return std::make_unique<Places>(*this, particles);
    }

    WorkCount count_work() override {
        if (!policy_.may_check()) return {};
        step(1);
        return {{"tiles", tiles_->used()},
                {"tiles_stepped", policy_.checks() ? tiles_stepped() : tiles_->used()}};
    }

    std::optional<Choice> choice() const override {
        return choice_of_auto(options_,
                              {{"rest", policy_.choice()}, {"threads", std::to_string(shares_.size())}});
    }

    StepWork step_work(const Problem& problem) const override {
        const bool all = all_terms(options_);
        const bool has_load = all || !problem.load.empty();
        const std::uint32_t full_stencil = bits_in_use(problem, options_) | ACTIVE_BIT;
        std::uint64_t masks = 0;        // masks read: those of particles without a full stencil
        std::uint64_t evaluations = 0;  // of force densities: two per spring along x or if `all`, else one
        for (const std::uint32_t mask : problem.lattice.mask) {
            masks += all || mask != full_stencil ? 1 : 0;
            const std::uint32_t twice = all ? NEIGHBOUR_BITS : along_x;
            evaluations += std::uint64_t(std::popcount(mask & twice) + std::popcount(mask & ~twice & higher));
        }
        const std::uint64_t particles = problem.particle_count();
        const std::uint64_t ends = 2 * count_springs(problem).total();
        // Formulations by increments read displacements from one array, write them to another, and overwrite
        // increments in place. The others read one of two arrays of positions and overwrite the other.
        const auto state = std::uint64_t(state_arrays(formulation_));
        const bool increments = by_increments(formulation_);
        const std::uint64_t read_only =
            (has_load ? 3 : 0) + (all || problem.has_materials() ? 1 : 0) + (problem.has_materials() ? 1 : 0);
        // Operations of a force density: 5 + 1 + 1 + 3 for force_density(), or 3 + 5 + 1 + 5 + 1 + 1 + 4 for
        // strain_density() without its offset; 2 more if materials give the stiffness.
        const std::uint64_t density =
            (by_increments(formulation_) ? 20 : 10) + (problem.has_materials() ? 2 : 0);
        // Operations at each end of a spring: 3 for u_i - u_j or x_i - x_j, and 6 more with low parts; 3 for
        // the offset, if it is made from displacements; 3 for the force; 3 to add the force.
        const bool split = formulation_ == Formulation::compensated;
        const std::uint64_t end = 9 + (split ? 6 : 0) + (on_positions(formulation_) ? 0 : 3);
        // Operations of a particle: 21 for next_position(), or for increment_change() and two sums. Each sum
        // that is split takes 33 instead of 3.
        return {.bytes = (particles * ((increments ? state / 3 * 4 : 9) + read_only) + masks) * sizeof(T),
                .written_bytes = particles * (increments ? state / 3 * 2 : 3) * sizeof(T),
                .footprint_bytes = (particles * (state + read_only) + masks) * sizeof(T),
                .operations = evaluations * density + ends * end +
                              particles * (21 + (split ? 60 : 0) + (has_load ? 3 : 0))};
    }

private:
    /// The mask bits of the two neighbours along x, and of all neighbours with a higher index.
    static constexpr std::uint32_t along_x = 0x3, higher = NEIGHBOUR_BITS & 0xAAAAAAAA;
    /// A tile sleeps once it and the tiles around it were slow for this many steps.
    static constexpr int steps_to_sleep = 8;
    /// With fewer tiles rest=auto never checks them for rest. A step of this many tiles takes some 50 us.
    static constexpr std::size_t min_checked_tiles = 128;

    /// A particle that the tool holds.
    struct Held {
        std::size_t number = 0;  ///< its index in Tool::particles
        std::ptrdiff_t element = 0;
        std::uint32_t tile = 0;
        /// The particle's position or displacement when the tool took hold, and its Problem::load.
        std::array<T, 3> anchor{}, load{};
    };

    /// A thread's share of every step.
    struct Share {
        Array<T> density;
        std::array<std::vector<Opposites<T>>, 2> opposites;
        Tiles::Share tiles;
        std::vector<Held> held;
        Task<T> task{};
    };

    /// Reads and writes the positions or displacements of some particles in the current state.
    class Places final : public Border {
    public:
        Places(CpuParallel& of, const std::vector<std::uint32_t>& particles) : of_(of) {
            const Lattice& lattice = of.problem_->lattice;
            for (const std::uint32_t i : particles) {
                const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
                places_.push_back(
                    {of.state_.grid.element(at), of.tiles_->at({at.x / int(block_size<T>), at.y, at.z})});
            }
        }

        std::size_t bytes() const override { return places_.size() * arrays().size() * sizeof(T); }
        void read(std::byte* to) const override {
            for (T* const array : arrays()) {
                for (const Place& place : places_) {
                    std::memcpy(to, array + place.element, sizeof(T));
                    to += sizeof(T);
                }
            }
        }
        void write(const std::byte* from) override {
            for (T* const array : arrays()) {
                for (const Place& place : places_) {
                    T value{};
                    std::memcpy(&value, from, sizeof(T));
                    from += sizeof(T);
                    // The tile may be at rest. Only a value with other bits makes it active.
                    T& here = array[place.element];
                    if (std::bit_cast<MaskOf<T>>(here) == std::bit_cast<MaskOf<T>>(value)) continue;
                    here = value;
                    of_.tiles_->mark_active(place.tile, of_.step_);
                }
            }
        }

    private:
        struct Place {
            std::ptrdiff_t element;
            std::uint32_t tile;
        };
        std::vector<T*> arrays() const {
            const auto current = std::size_t(of_.step_ % 2);
            std::vector<T*> all;
            for (const auto* vector : {&of_.state_.at[current], &of_.state_.at_low[current]}) {
                for (const Array<T>& array : *vector) {
                    if (array != nullptr) all.push_back(array.get());
                }
            }
            return all;
        }

        CpuParallel& of_;
        std::vector<Place> places_;
    };

    static std::array<T, 3> vector_of(const glm::dvec3& v) { return {T(v.x), T(v.y), T(v.z)}; }

    void begin(const Problem& problem, const State& state) override {
        problem_ = &problem;
        step_ = 0;
        state_ = {};  // frees the old arrays before the new ones are made
        state_ = PaddedState<T>(problem, options_, state);
        bits_ = bits_in_use(problem, options_);
        tool_moved_ = {};
        tool_forces_.assign(problem.tool.particles.size(), {});
        list_blocks();
        deal_out();
        start_policy();
    }

    void start_policy() {
        const Rest rest = rest_of(options_);
        const bool always = rest == Rest::skip || rest == Rest::flush || sleep_ > 0;
        const bool chooses = rest == Rest::choose && !always && stays_at_rest(*problem_) &&
                             tiles_->used() >= min_checked_tiles;
        // With terms=all no tile is left out for being at rest. But `sleep` changes results, so it acts.
        const bool any = !all_terms(options_) || sleep_ > 0;
        policy_.start(any && (always || chooses), any && chooses);
    }

    void integrate(int count) override {
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
            tiles_->mark_all_active(step_);
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
            // Each share goes to the same thread every time. If OpenMP grants fewer threads, some take
            // several shares.
            const auto threads = std::size_t(omp_get_num_threads());
            const FlushSubnormals flush(flushes_subnormals_);
#pragma omp single
            barrier.expect(int(threads));
            for (std::int64_t step = step_ + 1; step <= step_ + count; ++step) {
                for (auto s = std::size_t(omp_get_thread_num()); s < shares_.size(); s += threads) {
                    Share& share = shares_[s];
                    Task<T> task = task_from(share, step - 1);
                    use_tool(share, task);
                    if (checks) {
                        tiles_->decide(share.tiles, step);
                        task.action = share.tiles.action.data();
                        task.active_tile = share.tiles.active.data();
                    }
                    cpu_parallel::step(task, formulation_, root_);
                    if (checks) tiles_->settle(share.tiles, step);
                }
                barrier.wait();
            }
        }
        step_ += count;
    }

    /// Adds the tool's forces to the loads of held particles. No other thread reads the loads of this share.
    void use_tool(const Share& share, const Task<T>& task) {
        for (const Held& held : share.held) {
            std::array<T, 3>& force = tool_forces_[held.number];
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const T low = task.at_low[axis] != nullptr ? task.at_low[axis][held.element] : T(0);
                force[axis] = hold_force(held.anchor[axis], task.at[axis][held.element], low,
                                         tool_moved_[axis], T(problem_->tool.stiffness));
                state_.load[axis][std::size_t(held.element)] = held.load[axis] + force[axis];
            }
        }
    }

    bool within(double largest_increment) override {
        bool all = true;
#pragma omp parallel for num_threads(int(shares_.size())) schedule(static, 1) reduction(&& : all)
        for (std::size_t s = 0; s < shares_.size(); ++s) {
            all = all && cpu_parallel::within(task_from(shares_[s], step_), formulation_, largest_increment);
        }
        return all;
    }

    /// The index in blocks_ of the block that holds a particle's element.
    std::size_t block_of(std::ptrdiff_t element) const {
        const auto next = std::upper_bound(blocks_.begin(), blocks_.end(), element,
                                           [](auto e, const Block& block) { return e < block.first; });
        return std::size_t(next - blocks_.begin()) - 1;
    }

    bool has_full_stencil(std::ptrdiff_t first) const {
        const MaskOf<T>* begin = state_.mask.get() + first;
        return !all_terms(options_) && std::all_of(begin, begin + block_size<T>, [this](auto mask) {
            return mask == (bits_ | ACTIVE_BIT);
        });
    }

    void list_blocks() {
        const bool all = all_terms(options_);
        blocks_.clear();
        tiles_ = std::make_unique<Tiles>(state_.grid.blocks(), sleep_ > 0 ? steps_to_sleep : 1);
        for (int z = 0; z < state_.grid.dims.z; ++z) {
            const std::ptrdiff_t slice = state_.grid.element({0, 0, z});
            for (std::ptrdiff_t in_slice = 0; in_slice < state_.grid.slice; in_slice += block_size<T>) {
                const MaskOf<T>* begin = state_.mask.get() + slice + in_slice;
                const MaskOf<T>* end = begin + block_size<T>;
                if (!all && std::all_of(begin, end, [](auto mask) { return mask == 0; })) continue;
                const std::ptrdiff_t block = slice + in_slice;
                const std::uint32_t tile = tiles_->at(
                    {int(in_slice % state_.grid.row / block_size<T>), int(in_slice / state_.grid.row), z});
                tiles_->use(tile);
                std::uint8_t quarters = 0;
                for (std::ptrdiff_t i = 0; i < block_size<T>; ++i)
                    quarters |= std::uint8_t(all || begin[i] != 0) << (i * 4 / block_size<T>);
                blocks_.push_back({block, in_slice, tile, z % 2 != 0, has_full_stencil(block), quarters});
            }
        }
        tiles_->mark_all_active(step_);
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
            // Only blocks that begin at this element or later can have higher neighbours in this share.
            const std::ptrdiff_t lead =
                task.begin->first - state_.grid.slice - state_.grid.row - block_size<T>;
            task.lead = std::lower_bound(first, task.begin, lead, [](const Block& block, auto element) {
                return block.first < element;
            });
            const auto [lowest, highest] = std::minmax_element(
                task.lead, task.end, [](const Block& a, const Block& b) { return a.tile < b.tile; });
            share.tiles = tiles_->share(lowest->tile, highest->tile + 1);
            share.held = held_of(task);
        }
    }

    /// The particles that the tool holds in the blocks of a task.
    std::vector<Held> held_of(const Task<T>& task) const {
        std::vector<Held> held;
        const Tool& tool = problem_->tool;
        for (std::size_t n = 0; n < tool.particles.size(); ++n) {
            const std::uint32_t i = tool.particles[n];
            const std::ptrdiff_t element = state_.element_of(*problem_, i);
            const Block* const block = &blocks_[block_of(element)];
            if (block < task.begin || block >= task.end) continue;
            glm::dvec3 anchor = tool.held_at(n);
            if (on_positions(formulation_)) anchor += problem_->rest_position[i];
            held.push_back({n, element, block->tile, vector_of(anchor), vector_of(problem_->load[i])});
        }
        return held;
    }

    /// The task that steps the share's particles from state `step` to the next state.
    Task<T> task_from(const Share& share, std::int64_t step) const {
        using Vector = typename PaddedState<T>::Vector;
        const auto pointers = [](const Vector& v) {
            return std::array<T*, 3>{v[0].get(), v[1].get(), v[2].get()};
        };
        const auto constant = [](const Vector& v) {
            return std::array<const T*, 3>{v[0].get(), v[1].get(), v[2].get()};
        };
        const auto current = std::size_t(step % 2);
        Task<T> task = share.task;
        task.at = constant(state_.at[current]);
        task.next = pointers(state_.at[1 - current]);
        task.at_low = constant(state_.at_low[current]);
        task.next_low = pointers(state_.at_low[1 - current]);
        task.increment = pointers(state_.increment);
        task.increment_low = pointers(state_.increment_low);
        return task;
    }

    void fill_opposites(Share& share) {
        if (bits_ == 0) return;
        const auto pairs = std::ptrdiff_t(std::popcount(bits_) / 2);
        share.density = filled(2 * pairs * state_.grid.densities(), T(0));
        T* density = share.density.get() + state_.grid.density_guard();
        for (const Direction& direction : directions()) {
            if (direction.bit % 2 == 0 || (bits_ >> direction.bit & 1u) == 0) continue;
            const glm::ivec3 o = direction.offset;
            const std::ptrdiff_t stride_in_slice = o.y * state_.grid.row + o.x;
            const std::ptrdiff_t stride = o.z * state_.grid.slice + stride_in_slice;
            const RestSpring rest = rest_spring(*problem_, direction);
            const std::array<T*, 2> of_slice = {density, density + state_.grid.densities()};
            density += 2 * state_.grid.densities();
            // Along x both ends of a spring evaluate the density. The lower neighbour lies in the same
            // register or in the one before, so its density would have been stored just now, and a load that
            // overlaps such a recent store waits longer than the evaluation takes.
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
        task.load = {state_.load[0].get(), state_.load[1].get(), state_.load[2].get()};
        task.mask = state_.mask.get();
        task.inverse_mass = state_.inverse_mass.get();
        task.compliance = state_.compliance.get();
        task.shortest_squared = T(problem_->shortest_squared());
        task.uniform_inverse_mass = T(1 / problem_->materials[0].mass);
        task.gravity = {T(g.x), T(g.y), T(g.z)};
        const double shortest = problem_->shortest_spacing();
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
    const double sleep_, flush_;  ///< in spacings; 0: off
    const bool flushes_subnormals_;
    const int threads_;
    const Problem* problem_ = nullptr;
    std::int64_t step_ = 0;  ///< since upload()
    std::array<T, 3> tool_moved_{};
    std::vector<std::array<T, 3>> tool_forces_;  ///< in the latest step, in the order of Tool::particles
    PaddedState<T> state_;
    std::uint32_t bits_ = 0;  ///< mask bits of the directions to visit
    std::vector<Block> blocks_;
    std::vector<Share> shares_;
    std::unique_ptr<Tiles> tiles_;
    /// Checking tiles costs a little. It pays if at least an eighth of them rests.
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
    .addressing = Addressing::by_grid,
    .summary = "All cores and their SIMD registers, with implicit addressing on a padded grid.",
    .strength = "it steps on every core, with SIMD instructions",
    .precisions = {Precision::float32, Precision::float64},
    .formulations = every_formulation,
    .tuning = {{"threads", {}},
               {"terms", {"needed", "all"}},
               {"root", {"exact", "refined", "raw"}},
               {"rest", {"auto", "step", "skip", "flush"}},
               {"sleep", {"off", "1e-3", "1e-4", "1e-5", "1e-6"}},
               {"subnormals", {"flush", "keep"}}},
    .make = [](const Options& options) { return make_by_precision<CpuParallel>(options, options); },
    .bytes =
        [](const Problem& problem, const Options& options) {
            return by_precision(options.precision,
                                [&]<class Real>(Real) { return bytes<Real>(problem, options); });
        },
    // The particles of a sleeping tile stand still, although without sleep each might move by up to this per
    // step.
    .admitted_spacings_per_step = sleep_threshold,
    .root_error = root_error,
    .refused_options = refused_options,
});

}  // namespace
}  // namespace voxspring
