#include "backends/layout/work.h"

#include <algorithm>

#include "backends/layout/records/particle.h"
#include "backends/layout/records/springs.h"

namespace voxspring::layout {
namespace {

/// Operations of unit_pull() for one end of a spring. Two numbers are those of float32 and of float64. The
/// relative position or displacement takes 3; squared_length() 3 or 4; inverse_root() 1 or 6; the density 3.
/// On displacements, adding the offset takes 1 more per axis along which the neighbour lies. In formulations
/// by increments the deficit takes 3, plus 1 per such axis, and fast_reciprocal() 1 or 5. Low parts take 6.
template <class Real>
std::uint64_t pull_operations(const Direction& direction, Formulation formulation) {
    const std::uint64_t axes = axes_of(direction);
    std::uint64_t operations = is_single<Real> ? 3 + 3 + 1 + 3 : 3 + 4 + 6 + 3;
    if (!on_positions(formulation)) operations += axes;
    if (by_increments(formulation)) operations += 3 + axes + (is_single<Real> ? 1 : 5);
    if (formulation == Formulation::compensated) operations += 6;
    return operations;
}

/// A spring beyond the lattice may have any direction. It is counted as one that lies along all three axes.
const Direction oblique{.bit = 0, .offset = {1, 1, 1}, .group = SpringGroup::corner};

/// Operations of fast_series_stiffness(), of the sum of its arguments, and of multiplying the density by it.
template <class Real>
constexpr std::uint64_t material_operations = is_single<Real> ? 1 + 1 + 1 : 1 + 5 + 1;

/// Operations that combine the sums of spring groups into the force.
std::uint64_t group_operations(const Problem& problem) {
    std::uint64_t groups = 0;
    for (const std::uint32_t bits : {FACE_BITS, EDGE_BITS, CORNER_BITS})
        groups += (problem.group_bits & bits) != 0 ? 1 : 0;
    // With materials each spring carries the stiffness, so the first group's sum is already the force.
    if (problem.has_materials() && groups > 0) --groups;
    return groups * vector_operations;
}

/// Evaluations of springs: each spring is evaluated from both of its ends.
std::uint64_t spring_ends(const Problem& problem) { return 2 * count_springs(problem).total(); }

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
StepWork implicit_work(const Problem& problem, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    if (problem.has_materials()) work.read_once(problem.particle_count() * sizeof(Real));  // compliance
    const std::uint64_t material = problem.has_materials() ? material_operations<Real> : 0;
    work.operations += problem.particle_count() * group_operations(problem) +
                       2 * pull_operations<Real>(problem, formulation) +
                       spring_ends(problem) * (material + vector_operations);
    return work;
}

template <class Real>
StepWork explicit_work(const Problem& problem, bool secondary, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    const std::uint64_t ends = spring_ends(problem);
    work.read_once(ends * (sizeof(std::uint32_t) + (secondary ? sizeof(SpringConstants<Real>) : 0)));
    work.operations += 2 * pull_operations<Real>(problem, formulation) + ends * vector_operations;
    // Operations for the stiffness: once per spring end, or once per group.
    work.operations += secondary ? ends : problem.particle_count() * group_operations(problem);
    return work;
}

template StepWork motion_work<float>(const Problem&, Formulation);
template StepWork motion_work<double>(const Problem&, Formulation);
template std::uint64_t pull_operations<float>(const Problem&, Formulation);
template std::uint64_t pull_operations<double>(const Problem&, Formulation);
template StepWork implicit_work<float>(const Problem&, Formulation);
template StepWork implicit_work<double>(const Problem&, Formulation);
template StepWork explicit_work<float>(const Problem&, bool, Formulation);
template StepWork explicit_work<double>(const Problem&, bool, Formulation);

}  // namespace voxspring::layout
