#include "backends/layout/particles.h"

#include "backends/layout/rounding.h"
#include "backends/physics/huge_pages.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/stored.h"

namespace voxspring::layout {

namespace {

// The number of particles, signed because OpenMP's loops prefer that.
std::ptrdiff_t count_of(const Problem& problem) { return std::ptrdiff_t(problem.particle_count()); }

// The number of elements of an axis (x, y or z) of the increments is a multiple of this: 32 elements of
// float32 fill a cache line.
constexpr std::size_t pitch_multiple = 32;

}  // namespace

Placement place_on_grid(const Lattice& lattice) {
    const std::size_t slice = std::size_t(lattice.dims.x) * std::size_t(lattice.dims.y);
    // The word of voxel 0 begins on a cache line.
    const std::size_t guard = rounded_up(slice + std::size_t(lattice.dims.x) + 1, std::size_t(8));
    return {.words = lattice.voxel_count() + 2 * guard, .first = guard, .voxel = &lattice.voxel};
}

Placement place_compact(const Problem& problem) { return {.words = problem.particle_count()}; }

std::size_t increment_pitch(const Placement& placement) {
    return rounded_up(placement.words, pitch_multiple);
}

template <class Real>
PackedState<Real> pack(const Problem& problem, const State& state, const Placement& placement,
                       std::span<const std::uint32_t> bits, Formulation formulation) {
    const bool increments = by_increments(formulation), split = formulation == Formulation::compensated;
    PackedState<Real> packed;
    resize_in_huge_pages(packed.current, placement.words);
    if (!increments) resize_in_huge_pages(packed.previous, placement.words);
    if (split) packed.current_low.resize(placement.words);
    const std::size_t pitch = increment_pitch(placement);
    if (increments) resize_in_huge_pages(packed.increment, 3 * pitch);
    if (split) packed.increment_low.resize(3 * pitch);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::size_t(n);
        const std::size_t at = placement.at(i);
        glm::dvec3 point = state.displacement_of(i);
        if (on_positions(formulation)) point += problem.rest_position[i];
        const auto word_bits = ParticleRecord<Real>::with(bits[i]);
        packed.current[at] = {vector_of<Real>(point), word_bits};
        if (!increments) packed.previous[at] = {vector_of<Real>(point - state.increment_of(i)), word_bits};
        if (split) packed.current_low[at] = {vector_of<Real>(lost_by<Real>(point)), 0};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double v = state.increment_of(i)[int(axis)];
            if (increments) packed.increment[axis * pitch + at] = Real(v);
            if (split) packed.increment_low[axis * pitch + at] = Real(lost_by<Real>(v));
        }
    }
    return packed;
}

template <class Real>
State unpack(const Problem& problem, const PackedState<Real>& packed, const Placement& placement,
             Formulation formulation) {
    const bool increments = by_increments(formulation), split = formulation == Formulation::compensated;
    const std::size_t pitch = increment_pitch(placement);
    State state = state_at_rest(problem);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < count_of(problem); ++n) {
        const auto i = std::size_t(n);
        const std::size_t at = placement.at(i);
        const glm::dvec3 point = dvec_of(packed.current[at].position);
        state.displacement[i] = on_positions(formulation) ? point - problem.rest_position[i] : point;
        if (!increments) state.increment[i] = point - dvec_of(packed.previous[at].position);
        if (split) state.displacement[i] += dvec_of(packed.current_low[at].position);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            double& v = state.increment[i][int(axis)];
            if (increments) v = double(packed.increment[axis * pitch + at]);
            if (split) v += double(packed.increment_low[axis * pitch + at]);
        }
    }
    return state;
}

template <class Real>
std::vector<Vector<Real>> pack_load(const Problem& problem, const Placement& placement) {
    if (problem.load.empty()) return {};
    std::vector<Vector<Real>> load(placement.words, Vector<Real>{0, 0, 0});
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        load[placement.at(i)] = vector_of<Real>(problem.load[i]);
    return load;
}

template <class Real>
std::vector<Real> pack_inverse_masses(const Problem& problem, const Placement& placement) {
    if (!problem.has_materials()) return {};
    std::vector<Real> inverse(placement.words);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        inverse[placement.at(i)] = Real(1 / problem.material_of(i).mass);
    return inverse;
}

template <class Real>
std::vector<Real> pack_compliance(const Problem& problem, const Placement& placement) {
    if (!problem.has_materials()) return {};
    std::vector<Real> compliance(placement.words);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        compliance[placement.at(i)] = Real(1 / problem.material_of(i).stiffness);
    return compliance;
}

template <class Real>
std::uint64_t particle_bytes(const Problem& problem, const Placement& placement, Formulation formulation,
                             bool every_term) {
    const bool split = formulation == Formulation::compensated;
    const std::uint64_t axes = 3 * increment_pitch(placement) * sizeof(Real);
    return placement.words * ((split ? 4 : 2) * sizeof(ParticleRecord<Real>) +
                              (every_term || !problem.load.empty() ? sizeof(Vector<Real>) : 0) +
                              (every_term || problem.has_materials() ? sizeof(Real) : 0)) +
           (by_increments(formulation) ? axes : 0) + (split ? axes : 0);
}

template <class Real>
Motion<Real> make_motion(const Problem& problem) {
    return {.gravity = vector_of<Real>(problem.gravity),
            .inverse_mass = Real(1 / problem.materials.front().mass),
            .inverse_masses = nullptr,
            .load = nullptr,
            .damping = Real(problem.damping),
            .retained = Real(1 - problem.damping),
            .doubled = Real(2 - problem.damping),
            .time_step_squared = Real(problem.time_step * problem.time_step),
            .shortest_squared = Real(problem.shortest_squared()),
            .flushed_below = Real(flushed_below * problem.shortest_spacing())};
}

std::vector<std::uint32_t> state_bits(const Problem& problem) {
    std::vector<std::uint32_t> bits(problem.particle_count(), ACTIVE_BIT);
    for (std::size_t i = 0; i < bits.size(); ++i) {
        if (problem.is_pinned(i)) bits[i] |= PINNED_BIT;
    }
    return bits;
}

std::uint32_t terms_of(const Problem& problem) {
    return (problem.has_materials() ? term_materials : 0) | (problem.damping != 0 ? term_damping : 0) |
           (problem.has_gravity() ? term_gravity : 0) | (problem.pinned.empty() ? 0 : term_pins) |
           (problem.load.empty() ? 0 : term_loads);
}

template <class Real>
std::vector<HeldWord<Real>> pack_held(const Problem& problem, const Placement& placement,
                                      Formulation formulation) {
    std::vector<HeldWord<Real>> held;
    held.reserve(problem.tool.particles.size());
    for (std::size_t n = 0; n < problem.tool.particles.size(); ++n) {
        const std::uint32_t i = problem.tool.particles[n];
        glm::dvec3 anchor = problem.tool.held_at(n);
        if (on_positions(formulation)) anchor += problem.rest_position[i];
        held.push_back(
            {vector_of<Real>(anchor), std::uint32_t(placement.at(i)), vector_of<Real>(problem.load[i])});
    }
    return held;
}

template <class Real>
glm::dvec3 force_on_tool(const std::vector<HeldForce<Real>>& forces) {
    glm::dvec3 sum(0);
    for (const HeldForce<Real>& force : forces) sum -= dvec_of(force.force);
    return sum;
}

// NOLINTBEGIN(bugprone-macro-parentheses): a type cannot be put in parentheses.
#define FOR_PRECISION(Real)                                                                           \
    template PackedState<Real> pack(const Problem&, const State&, const Placement&,                   \
                                    std::span<const std::uint32_t>, Formulation);                     \
    template State unpack(const Problem&, const PackedState<Real>&, const Placement&, Formulation);   \
    template std::vector<Vector<Real>> pack_load(const Problem&, const Placement&);                   \
    template std::vector<Real> pack_inverse_masses(const Problem&, const Placement&);                 \
    template std::vector<Real> pack_compliance(const Problem&, const Placement&);                     \
    template std::uint64_t particle_bytes<Real>(const Problem&, const Placement&, Formulation, bool); \
    template Motion<Real> make_motion(const Problem&);                                                \
    template std::vector<HeldWord<Real>> pack_held(const Problem&, const Placement&, Formulation);    \
    template glm::dvec3 force_on_tool(const std::vector<HeldForce<Real>>&);
// NOLINTEND(bugprone-macro-parentheses)
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
