#include "backends/cpu/perturbed_reference.h"

#include <omp.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <numeric>
#include <utility>
#include <vector>

#include "backends/cpu/array.h"
#include "backends/cpu/barrier.h"
#include "backends/cpu/cpu_backend.h"
#include "backends/cpu/perturbed_kernel.h"
#include "backends/physics/huge_pages.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"
#include "backends/physics/stored.h"

namespace voxspring {
namespace {

using namespace perturbed;
using Kind = Perturbation::Kind;

/// The mixing function of SplitMix64.
std::uint64_t mixed(std::uint64_t a) {
    a += 0x9E3779B97F4A7C15u;
    a = (a ^ a >> 30) * 0xBF58476D1CE4E5B9u;
    a = (a ^ a >> 27) * 0x94D049BB133111EBu;
    return a ^ a >> 31;
}

RoundingBits rounding_of(const Perturbation& perturbation) {
    RoundingBits bits;
    if (perturbation.kind == Kind::none) return bits;
    const bool random = perturbation.kind == Kind::random;
    if (perturbation.precision == Precision::float32) {
        // A fraction keeps 23 of its 52 bits. The exponent keeps the range of float64.
        constexpr int cut = 52 - 23;
        bits.kept = ~std::uint64_t(0) << cut;
        bits.random = random ? ~bits.kept : 0;
        bits.constant = random ? 0 : std::uint64_t(1) << (cut - 1);
    } else if (random) {
        // Two random bits decide: one unit up, one unit down, or no change.
        bits.random = bits.also_random = 1;
        bits.constant = ~std::uint64_t(0);
    }
    if (random) {
        bits.unit = perturbation.precision == Precision::float32 ? 0x1p-24 : 0x1p-53;
        bits.root_error = perturbation.root_error;
    }
    return bits;
}

using cpu_parallel::filled;
using cpu_parallel::worth_threads;
using Array = cpu_parallel::Array<double>;
using Arrays = std::array<Array, 3>;

template <class Pointer = double*>
std::array<Pointer, 3> pointers(Arrays& arrays) {
    return {arrays[0].get(), arrays[1].get(), arrays[2].get()};
}

class Reference final : public PerturbedReference, public ToolFacet {
public:
    explicit Reference(const Perturbation& perturbation) : next_perturbation_(perturbation) {}

    Capabilities capabilities() const override { return cpu_capabilities("float64", omp_get_max_threads()); }

    void perturb(const Perturbation& perturbation) override { next_perturbation_ = perturbation; }

    void upload(const Problem& problem, const State& state) override {
        perturbation_ = next_perturbation_;
        formulation_ = perturbation_.kind == Kind::none ? Formulation::increment : perturbation_.formulation;
        rounding_ = rounding_of(perturbation_);
        problem_ = &problem;
        step_ = 0;
        lay_out();
        fill(state);
        follow_springs();
    }

    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override { tool_moved_ = displacement; }
    glm::dvec3 tool_force() override { return tool_force_; }

    void edit(const Problem& edited, const SpringEdit& edit) override {
        problem_ = &edited;
        for (const SpringEdit::Touched& touched : edit.touched)
            mask_[std::size_t(element_[touched.particle])] = touched.mask;
        follow_springs();
    }

    void step(int count) override {
        const auto threads = int(std::clamp<std::ptrdiff_t>(std::ptrdiff_t(blocks_.size()) / min_blocks, 1,
                                                            omp_get_max_threads()));
        cpu_parallel::Barrier barrier;
#pragma omp parallel num_threads(threads)
        {
            const auto team = std::size_t(omp_get_num_threads()), thread = std::size_t(omp_get_thread_num());
#pragma omp single
            barrier.expect(int(team));
            for (std::int64_t n = step_; n < step_ + count; ++n) {
                if (!springs_.empty() || problem_->has_tool()) {
                    if (thread == 0) {
                        pull_beyond(std::size_t(n % 2));
                        use_tool(std::size_t(n % 2));
                    }
                    barrier.wait();
                }
                perturbed::step(share(n, thread, team), formulation_);
                barrier.wait();
            }
        }
        step_ += count;
    }

    State download() override {
        State state;
        read(state);
        return state;
    }

    void read(State& state) const override {
        resize_in_huge_pages(state.displacement, problem_->particle_count());
        resize_in_huge_pages(state.increment, problem_->particle_count());
        const auto now = std::size_t(step_ % 2);
        each_particle([&](std::size_t i) {
            const auto e = std::size_t(element_[i]);
            for (int c = 0; c < 3; ++c) {
                const double rest = on_positions(formulation_) ? problem_->rest_position[i][c] : 0;
                const double at = place_[now][std::size_t(c)][e];
                state.displacement[i][c] = at - rest;
                state.increment[i][c] = by_increments(formulation_) ? increment_[std::size_t(c)][e]
                                                                    : at - place_[1 - now][std::size_t(c)][e];
            }
        });
    }

    StepWork step_work(const Problem&) const override { return {}; }

private:
    /// Each of several threads gets at least this many blocks. With fewer, a further thread would not pay.
    static constexpr std::ptrdiff_t min_blocks = 256;

    template <class Do>
    void each_particle(const Do& act) const {
        const auto particles = std::ptrdiff_t(element_.size());
#pragma omp parallel for schedule(static) if (particles >= worth_threads)
        for (std::ptrdiff_t i = 0; i < particles; ++i) act(std::size_t(i));
    }

    bool random() const { return perturbation_.kind == Kind::random; }

    /// A number that many particles share: rounded to the backend's precision, or perturbed at random.
    double parameter(double value, std::uint64_t which) const {
        if (!random()) return stored_parameter(value);
        RoundingBits bits = rounding_;
        bits.key = mixed(perturbation_.seed);
        return value * (1 + (bits.unit + bits.root_error) * random_number(bits, which, 0));
    }
    /// A number that every backend stores in its precision without further arithmetic.
    double stored_parameter(double value) const {
        const bool single = perturbation_.kind != Kind::none && perturbation_.precision == Precision::float32;
        return single ? stored_as<float>(value) : value;
    }
    /// A rest length. It may be perturbed at random, but is not rounded to the precision: it must equal the
    /// length that a step computes at rest, as in a backend.
    double length_parameter(double value, std::uint64_t which) const {
        return random() ? parameter(value, which) : value;
    }

    void lay_out() {
        const Problem& problem = *problem_;
        const Lattice& lattice = problem.lattice;
        const bool has_lattice = !lattice.mask.empty();
        const glm::ivec3 dims = has_lattice ? lattice.dims : glm::ivec3(int(problem.particle_count()), 1, 1);
        row_ = (dims.x + block_size) / block_size * block_size;  // an empty column ends each row
        slice_ = row_ * (dims.y + 1);
        const std::ptrdiff_t guard = slice_ + row_ + block_size;
        const std::ptrdiff_t size = guard + slice_ * dims.z + guard;
        if (size != std::exchange(size_, size)) forget_arrays();
        element_.resize(problem.particle_count());
        fill_with(mask_, std::uint64_t(0));
        each_particle([&](std::size_t i) {
            const glm::ivec3 at =
                has_lattice ? lattice.coordinates(lattice.voxel[i]) : glm::ivec3(int(i), 0, 0);
            element_[i] = guard + slice_ * at.z + row_ * at.y + at.x;
            const std::uint32_t alone = ACTIVE_BIT | (problem.is_pinned(i) ? PINNED_BIT : 0);
            mask_[std::size_t(element_[i])] = has_lattice ? lattice.mask[i] : alone;
        });
        list_blocks(guard);
    }

    /// Lists the blocks that have an element of `element_`. Blocks are counted from `guard`.
    void list_blocks(std::ptrdiff_t guard) {
        const auto block_of = [&](std::size_t i) { return element_[i] - (element_[i] - guard) % block_size; };
        const auto begins_block = [&](std::size_t i) { return i == 0 || block_of(i) != block_of(i - 1); };
        // Blocks are counted first, so that chunks of particles can be processed in parallel.
        constexpr std::size_t chunk = std::size_t(1) << 20;
        const std::size_t particles = element_.size(), chunks = (particles + chunk - 1) / chunk;
        std::vector<std::size_t> begin(chunks + 1);
        const auto each_chunk = [&](const auto& act) {
#pragma omp parallel for schedule(static) if (chunks > 1)
            for (std::ptrdiff_t n = 0; n < std::ptrdiff_t(chunks); ++n) act(std::size_t(n));
        };
        const auto each_block = [&](std::size_t n, const auto& act) {
            for (std::size_t i = n * chunk; i < std::min(particles, (n + 1) * chunk); ++i) {
                if (begins_block(i)) act(block_of(i));
            }
        };
        each_chunk([&](std::size_t n) { each_block(n, [&](std::ptrdiff_t) { ++begin[n + 1]; }); });
        std::partial_sum(begin.begin(), begin.end(), begin.begin());
        blocks_.resize(begin.back());
        each_chunk([&](std::size_t n) {
            std::size_t next = begin[n];
            each_block(n, [&](std::ptrdiff_t block) { blocks_[next++] = block; });
        });
    }

    /// Fills `array` with size_ elements of `value`. An array that exists keeps its memory.
    template <class T>
    void fill_with(cpu_parallel::Array<T>& array, T value) const {
        if (array == nullptr) {
            array = filled(size_, value);
            return;
        }
        T* const begin = array.get();
#pragma omp parallel for schedule(static) if (size_ >= worth_threads)
        for (std::ptrdiff_t i = 0; i < size_; ++i) begin[i] = value;
    }

    void forget_arrays() {
        mask_ = nullptr;
        inverse_mass_ = nullptr;
        compliance_ = nullptr;
        for (Arrays* arrays : {&place_[0], &place_[1], &increment_, &load_, &extra_, &extra_size_})
            fill_with_zeros(*arrays, false);
    }

    /// `value`, a number of particle i's state, as upload() rounds it. Calls with the same `i` and `which`
    /// round alike.
    double stored_at_start(double value, std::size_t i, std::uint64_t which) const {
        if (formulation_ == Formulation::compensated) return value;
        RoundingBits bits = rounding_;
        bits.key = mixed(perturbation_.seed + 1);
        return rounded(value, bits, i, which);
    }

    void fill(const State& state) {
        const Problem& problem = *problem_;
        fill_with_zeros(place_[0], true);
        fill_with_zeros(place_[1], true);
        fill_with_zeros(increment_, by_increments(formulation_));
        fill_with_zeros(load_, !problem.load.empty());
        tool_moved_ = tool_force_ = glm::dvec3(0);
        fill_with(inverse_mass_, parameter(1 / problem.materials[0].mass, 0));
        if (problem.has_materials()) {
            fill_with(compliance_, 1.0);
        } else {
            compliance_ = nullptr;
        }
        const auto stored = [this](double value, std::size_t i, std::uint64_t which) {
            return stored_at_start(value, i, which);
        };
        each_particle([&](std::size_t i) {
            const auto e = std::size_t(element_[i]);
            const glm::dvec3 displaced = state.displacement_of(i), moving = state.increment_of(i);
            for (std::uint64_t c = 0; c < 3; ++c) {
                const int axis = int(c);
                const double u = displaced[axis], v = moving[axis];
                const double rest = on_positions(formulation_) ? problem.rest_position[i][axis] : 0;
                place_[0][c][e] = stored(rest + u, i, c);
                place_[1][c][e] = problem.is_pinned(i) ? place_[0][c][e] : stored(rest + u - v, i, 3 + c);
                if (by_increments(formulation_) && !problem.is_pinned(i))
                    increment_[c][e] = stored(v, i, 3 + c);
                if (!problem.load.empty()) load_[c][e] = problem.load[i][axis];
            }
            if (!problem.has_materials()) return;
            inverse_mass_[e] = parameter(1 / problem.material_of(i).mass, problem.material[i]);
            compliance_[e] = 1 / problem.material_of(i).stiffness;
        });
    }
    void fill_with_zeros(Arrays& arrays, bool wanted) const {
        for (Array& array : arrays) {
            if (wanted) {
                fill_with(array, 0.0);
            } else {
                array = nullptr;
            }
        }
    }

    /// Lists the directions in use and the springs of Problem::springs anew, after an upload or an edit.
    void follow_springs() {
        std::uint64_t bits = 0;
#pragma omp parallel for schedule(static) reduction(| : bits) if (size_ >= worth_threads)
        for (std::ptrdiff_t e = 0; e < size_; ++e) bits |= mask_[std::size_t(e)];
        pulls_.clear();
        for (const Direction& direction : directions()) {
            if ((bits >> direction.bit & 1u) == 0) continue;
            const glm::ivec3 o = direction.offset;
            const RestSpring rest = rest_spring(*problem_, direction);
            // Perturbation changes a spring's rest length. Both ends must see the same rest length, so
            // opposite directions share `which`.
            const auto which = std::uint64_t(direction.bit / 2) + 1000;
            pulls_.push_back({.stride = o.z * slice_ + o.y * row_ + o.x,
                              .bit = std::uint64_t(1) << direction.bit,
                              .rest_offset = {rest.offset.x, rest.offset.y, rest.offset.z},
                              .rest_length = length_parameter(rest.length, which),
                              .rest_deficit = rest.deficit,
                              .stiffness = parameter(problem_->group_stiffness[std::size_t(direction.group)],
                                                     which + 100)});
        }
        springs_ = problem_->springs;
        rest_springs_.clear();
        for (const Spring& spring : springs_) rest_springs_.push_back(rest_spring(*problem_, spring));
        fill_with_zeros(extra_, !springs_.empty());
        fill_with_zeros(extra_size_, !springs_.empty());
    }

    /// Sums the forces of springs_ (sutures, for example) at the positions or displacements place_[now].
    void pull_beyond(std::size_t now) {
        for (const Spring& spring : springs_) {
            for (const std::uint32_t i : {spring.first, spring.second}) {
                for (std::size_t c = 0; c < 3; ++c) {
                    extra_[c][std::size_t(element_[i])] = 0;
                    extra_size_[c][std::size_t(element_[i])] = 0;
                }
            }
        }
        const double shortest_squared = problem_->shortest_squared();
        for (std::size_t s = 0; s < springs_.size(); ++s) {
            const Spring& spring = springs_[s];
            const RestSpring& rest = rest_springs_[s];
            const auto a = std::size_t(element_[spring.first]), b = std::size_t(element_[spring.second]);
            const auto& at = place_[now];
            const glm::dvec3 relative(at[0][a] - at[0][b], at[1][a] - at[1][b], at[2][a] - at[2][b]);
            const glm::dvec3 offset = on_positions(formulation_) ? relative : rest.offset + relative;
            const glm::dvec3 force =
                by_increments(formulation_)
                    ? strain_force(relative, rest.offset, rest.length, rest.deficit, spring.stiffness,
                                   shortest_squared)
                    : spring_force(offset, rest.length, spring.stiffness, shortest_squared);
            for (std::size_t c = 0; c < 3; ++c) {
                const int axis = int(c);
                const double size =
                    std::abs(force[axis]) +
                    (by_increments(formulation_) ? 0 : spring.stiffness * std::abs(offset[axis]));
                extra_[c][a] += force[axis];
                extra_[c][b] -= force[axis];
                extra_size_[c][a] += size;
                extra_size_[c][b] += size;
            }
        }
    }

    /// Adds the tool's forces to the loads, at the positions or displacements place_[now].
    void use_tool(std::size_t now) {
        const Tool& tool = problem_->tool;
        tool_force_ = glm::dvec3(0);
        for (std::size_t n = 0; n < tool.particles.size(); ++n) {
            const std::size_t i = tool.particles[n];
            const auto e = std::size_t(element_[i]);
            const auto& at = place_[now];
            glm::dvec3 anchor = tool.held_at(n);
            if (on_positions(formulation_)) anchor += problem_->rest_position[i];
            // Where the tool took hold of a particle is rounded in the same way as the particle's initial
            // state.
            for (int c = 0; c < 3; ++c) anchor[c] = stored_at_start(anchor[c], i, std::uint64_t(c));
            const glm::dvec3 force = hold_force(anchor, glm::dvec3(at[0][e], at[1][e], at[2][e]),
                                                glm::dvec3(0), tool_moved_, tool.stiffness);
            for (std::size_t c = 0; c < 3; ++c) load_[c][e] = problem_->load[i][int(c)] + force[int(c)];
            tool_force_ -= force;
        }
    }

    Task share(std::int64_t n, std::size_t thread, std::size_t team) {
        const Problem& problem = *problem_;
        const auto now = std::size_t(n % 2);
        const std::ptrdiff_t* const first = blocks_.data();
        Task task{};
        task.at = pointers<const double*>(place_[now]);
        task.next = pointers(place_[1 - now]);
        task.increment = pointers(increment_);
        task.load = pointers<const double*>(load_);
        task.extra = pointers<const double*>(extra_);
        task.extra_size = pointers<const double*>(extra_size_);
        task.mask = mask_.get();
        task.inverse_mass = inverse_mass_.get();
        task.compliance = compliance_.get();
        task.begin = first + blocks_.size() * thread / team;
        task.end = first + blocks_.size() * (thread + 1) / team;
        task.pulls = pulls_.data();
        task.pull_count = pulls_.size();
        task.shortest_squared = problem.shortest_squared();
        for (std::size_t c = 0; c < 3; ++c) task.gravity[c] = parameter(problem.gravity[int(c)], 2000 + c);
        task.damping = stored_parameter(problem.damping);
        task.retained = stored_parameter(1 - problem.damping);
        task.doubled = stored_parameter(2 - problem.damping);
        task.time_step_squared = parameter(problem.time_step * problem.time_step, 2013);
        task.rounding = rounding_;
        task.rounding.key = mixed(mixed(perturbation_.seed) + std::uint64_t(n));
        return task;
    }

    Perturbation next_perturbation_;
    Perturbation perturbation_;
    Formulation formulation_ = Formulation::increment;
    RoundingBits rounding_;
    const Problem* problem_ = nullptr;
    std::int64_t step_ = 0;
    std::ptrdiff_t row_ = 0, slice_ = 0;
    std::vector<std::ptrdiff_t> element_;  ///< per particle: its element in the padded arrays
    std::vector<std::ptrdiff_t> blocks_;   ///< first elements of the blocks with a particle, ascending
    std::ptrdiff_t size_ = 0;              ///< elements per array
    cpu_parallel::Array<std::uint64_t> mask_;
    std::array<Arrays, 2> place_;  ///< positions or displacements after even and after odd steps
    Arrays increment_, load_, extra_, extra_size_;
    Array inverse_mass_, compliance_;
    std::vector<Pull> pulls_;
    std::vector<Spring> springs_;
    std::vector<RestSpring> rest_springs_;
    glm::dvec3 tool_moved_{0}, tool_force_{0};
};

}  // namespace

std::unique_ptr<PerturbedReference> make_perturbed_reference(const Perturbation& perturbation) {
    return std::make_unique<Reference>(perturbation);
}

}  // namespace voxspring
