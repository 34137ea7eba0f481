#include "backends/layout/work.h"

#include <algorithm>

#include "backends/layout/records/particle.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {
namespace {

/// The operations of unit_pull() for one end of a spring. Where two numbers are given, the first is for
/// float32 and the second for float64. The relative position or displacement takes 3; squared_length() 3 or
/// 4; inverse_root() 1 or 6; the density 3. In formulations on displacements, adding the rest offset takes 1
/// more per axis along which the neighbour lies. In formulations by increments the deficit takes 3, plus 1
/// per such axis, and fast_reciprocal() 1 or 4. Low parts take 6.
template <class Real>
std::uint64_t pull_operations(const Direction& direction, Formulation formulation) {
    const std::uint64_t axes = axes_of(direction);
    std::uint64_t operations = is_single<Real> ? 3 + 3 + 1 + 3 : 3 + 4 + 6 + 3;
    if (!on_positions(formulation)) operations += axes;
    if (by_increments(formulation)) operations += 3 + axes + (is_single<Real> ? 1 : 4);
    if (formulation == Formulation::compensated) operations += 6;
    return operations;
}

/// Stands for a spring beyond the lattice, which may have any direction. It is counted like one that lies
/// along all three axes.
const Direction oblique{.bit = 0, .offset = {1, 1, 1}, .group = SpringGroup::corner};

/// The operations for a lattice spring between materials: the sum of the arguments of
/// fast_series_stiffness(), that function itself, and multiplying the density by its result. In float32, then
/// in float64.
template <class Real>
constexpr std::uint64_t material_operations = is_single<Real> ? 1 + 1 + 1 : 1 + 5 + 1;

/// The operations per particle that combine the sums of its spring groups into the force.
std::uint64_t group_operations(const Problem& problem) {
    std::uint64_t groups = 0;
    for (const std::uint32_t bits : {FACE_BITS, EDGE_BITS, CORNER_BITS})
        groups += (problem.group_bits & bits) != 0 ? 1 : 0;
    // Without materials each group's sum is multiplied by the group's stiffness. With materials each spring's
    // force already has its stiffness: the first group's sum is taken as it is, and the others are added.
    if (problem.has_materials() && groups > 0) --groups;
    return groups * vector_operations;
}

/// The number of evaluations of springs if each spring is evaluated from both of its ends.
std::uint64_t spring_ends(const Problem& problem) { return 2 * count_springs(problem).total(); }

/// The operations of one spring of cuda_march. They are counted as in pull_operations(), with three
/// differences. The formulations `position` and `displacement` take 1 operation after the root. In float32,
/// increments take 4 for root, reciprocal and density together. Face springs take 1 more, to scale them.
template <class Real>
std::uint64_t march_pull_operations(const Direction& direction, Formulation formulation) {
    const std::uint64_t axes = axes_of(direction);
    std::uint64_t operations = 3 + (is_single<Real> ? 3 : 4) + (direction.group == SpringGroup::face ? 1 : 0);
    if (!on_positions(formulation)) operations += axes;
    if (by_increments(formulation)) return operations + 3 + axes + (is_single<Real> ? 4 : 6 + 1 + 4 + 2);
    return operations + (is_single<Real> ? 1 : 6) + 1;
}

}  // namespace

template <class Real>
StepWork motion_work(const Problem& problem, Formulation formulation) {
    const std::uint64_t particles = problem.particle_count();
    const std::uint64_t operands = (problem.load.empty() ? 0 : sizeof(Vector<Real>)) +
                                   (problem.has_materials() ? sizeof(Real) : 0);  // inverse masses
    const bool split = formulation == Formulation::compensated;
    constexpr std::uint64_t word = sizeof(ParticleRecord<Real>), vector = sizeof(Vector<Real>);
    std::uint64_t bytes = 3 * word, written = word, footprint = 2 * word;
    if (by_increments(formulation)) {
        const std::uint64_t parts = split ? 2 : 1;
        bytes = parts * (2 * word + 2 * vector);
        written = parts * (word + vector);
        footprint = parts * (2 * word + vector);
    }
    std::uint64_t vectors =
        2 + (problem.has_gravity() ? 1 : 0) + (problem.damping != 0 ? 1 : 0) + (problem.load.empty() ? 0 : 1);
    if (formulation == Formulation::paper) {
        vectors += 3;
    } else if (split) {
        vectors += 22;
    } else {
        vectors += by_increments(formulation) ? 2 : 3;
    }
    return {.bytes = particles * (bytes + operands),
            .written_bytes = particles * written,
            .footprint_bytes = particles * (footprint + operands),
            .operations = particles * vector_operations * vectors};
}

template <class Real>
std::uint64_t pull_operations(const Problem& problem, Formulation formulation) {
    const SpringCounts springs = count_springs(problem);
    std::uint64_t operations = springs.beyond * pull_operations<Real>(oblique, formulation);
    // All springs of a group lie along the same number of axes.
    for (std::size_t g = 0; g < 3; ++g) {
        const auto of_group = std::find_if(directions().begin(), directions().end(),
                                           [&](const Direction& d) { return std::size_t(d.group) == g; });
        operations += springs.group[g] * pull_operations<Real>(*of_group, formulation);
    }
    return operations;
}

template <class Real>
std::uint64_t off_lattice_rest_bytes(const Problem& problem, Formulation formulation) {
    return on_positions(formulation) ? 0 : problem.springs.size() * sizeof(SpringRest<Real>);
}

template <class Real>
StepWork implicit_work(const Problem& problem, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    if (problem.has_materials()) work.read_once(problem.particle_count() * sizeof(Real));  // compliance
    const std::uint64_t material = problem.has_materials() ? material_operations<Real> : 0;
    // Springs beyond the lattice, which cuda_explicit_delta takes too, have a stiffness each.
    const std::uint64_t ends = spring_ends(problem), lattice_ends = ends - 2 * problem.springs.size();
    work.operations += problem.particle_count() * group_operations(problem) +
                       2 * pull_operations<Real>(problem, formulation) + ends * vector_operations +
                       lattice_ends * material;
    return work;
}

template <class Real>
StepWork explicit_work(const Problem& problem, bool secondary, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    const std::uint64_t ends = spring_ends(problem);
    work.read_once(ends * (sizeof(std::uint32_t) + (secondary ? sizeof(SpringConstants<Real>) : 0)) +
                   2 * off_lattice_rest_bytes<Real>(problem, formulation));
    work.operations += 2 * pull_operations<Real>(problem, formulation) + ends * vector_operations;
    // Operations for the stiffness: 1 per spring end, or group_operations() per particle.
    work.operations += secondary ? ends : problem.particle_count() * group_operations(problem);
    return work;
}

template <class Real>
StepWork shared_springs_work(const Problem& problem, Formulation formulation,
                             const std::array<SharedSprings, 2>& shares) {
    const std::uint64_t particles = problem.particle_count();
    const bool increments = by_increments(formulation);
    const std::uint64_t array = particles * sizeof(Vector<Real>);
    // The array that neighbours read exists twice: a step reads one copy and writes the other. With
    // increments there is a third array, which is overwritten in place.
    StepWork work{.bytes = (increments ? 4 : 3) * array,
                  .written_bytes = (increments ? 2 : 1) * array,
                  .footprint_bytes = (increments ? 3 : 2) * array};
    const SpringCounts springs = count_springs(problem);
    for (std::size_t g = 0; g < shares.size(); ++g) {
        const auto of_group = std::find_if(directions().begin(), directions().end(),
                                           [&](const Direction& d) { return std::size_t(d.group) == g; });
        work.operations += springs.group[g] * shares[g].evaluations / shares[g].springs *
                           march_pull_operations<Real>(*of_group, formulation);
        work.operations += springs.group[g] * 2 * vector_operations;
    }
    const bool changed = problem.has_gravity() || problem.damping != 0;
    work.operations += particles * vector_operations * ((increments ? 2 : 3) + (changed ? 1 : 0));
    return work;
}

template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation) {
    // Evaluations and springs per thread and plane. A thread has two rows of two particles in float32, and
    // one row in float64.
    return shared_springs_work<Real>(problem, formulation,
                                     is_single<Real> ? std::array<SharedSprings, 2>{{{16, 12}, {38, 24}}}
                                                     : std::array<SharedSprings, 2>{{{9, 6}, {22, 12}}});
}

#define FOR_PRECISION(Real)                                                           \
    template StepWork motion_work<Real>(const Problem&, Formulation);                 \
    template std::uint64_t pull_operations<Real>(const Problem&, Formulation);        \
    template std::uint64_t off_lattice_rest_bytes<Real>(const Problem&, Formulation); \
    template StepWork implicit_work<Real>(const Problem&, Formulation);               \
    template StepWork explicit_work<Real>(const Problem&, bool, Formulation);         \
    template StepWork shared_springs_work<Real>(const Problem&, Formulation,          \
                                                const std::array<SharedSprings, 2>&); \
    template StepWork march_work<Real>(const Problem&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
