#include "backends/layout/work.h"

#include <algorithm>
#include <array>

#include "backends/layout/records/delta.h"
#include "backends/layout/records/scatter.h"
#include "backends/layout/rounding.h"
#include "backends/physics/neighbours.h"

namespace voxspring::cuda {
namespace {

template <class Real>
constexpr bool single = sizeof(Real) == sizeof(float);

/// unit_pull() of a relative position or displacement, the 3 subtractions that it takes included:
/// squared_length() 3 in float32 and 4 in float64, inverse_root() 1 and 6, fast_reciprocal() 1 and 5, the
/// density 3. On displacements an offset takes one operation more for each axis along which the neighbour
/// lies, by increments the deficit 3 and as many again; low parts are 6.
template <class Real>
std::uint64_t pull_operations(const Direction& direction, Formulation formulation) {
    const glm::ivec3 o = direction.offset;
    const auto axes = std::uint64_t((o.x != 0) + (o.y != 0) + (o.z != 0));
    std::uint64_t operations = single<Real> ? 3 + 3 + 1 + 3 : 3 + 4 + 6 + 3;
    if (!on_positions(formulation)) operations += axes;
    if (by_increments(formulation)) operations += 3 + axes + (single<Real> ? 1 : 5);
    if (formulation == Formulation::compensated) operations += 6;
    return operations;
}

/// Of a spring beyond the lattice, which may lie along no axis.
const Direction oblique{.bit = 0, .offset = {1, 1, 1}, .group = SpringGroup::corner};

/// fast_series_stiffness(), the sum of its arguments included, and the density's multiplication by it.
template <class Real>
constexpr std::uint64_t material_operations = single<Real> ? 1 + 1 + 1 : 1 + 5 + 1;

/// A vector times a scalar, added to a sum or not.
constexpr std::uint64_t vector_operations = 3;

/// What integrate_and_store() takes: x(t) and x(t - dt) read, x(t + dt) written, one operand of its own each
/// where the scene has one; by increments x(t), v read and written, x(t + dt) written; low parts of both as
/// much again. In vector operations: the mass, gravity and the time step 3 and, where there is damping, 1;
/// next_position() 3 more, paper_position() 2, increments 1; split sums 2 x 11.
template <class Real>
StepWork motion_work(const Problem& problem, Formulation formulation) {
    const std::uint64_t particles = problem.particle_count();
    const std::uint64_t load = problem.load.empty() ? 0 : sizeof(Vector<Real>);
    const std::uint64_t inverse_mass = problem.has_materials() ? sizeof(Real) : 0;
    const bool split = formulation == Formulation::compensated;
    std::uint64_t bytes = 3 * sizeof(ParticleRecord<Real>);
    if (by_increments(formulation))
        bytes = (split ? 2 : 1) * (2 * sizeof(ParticleRecord<Real>) + 2 * sizeof(Vector<Real>));
    std::uint64_t vectors =
        2 + (problem.has_gravity() ? 1 : 0) + (problem.damping != 0 ? 1 : 0) + (problem.load.empty() ? 0 : 1);
    if (formulation == Formulation::paper) {
        vectors += 3;
    } else if (split) {
        vectors += 22;
    } else {
        vectors += by_increments(formulation) ? 2 : 3;
    }
    return {.bytes = particles * (bytes + load + inverse_mass),
            .operations = particles * vector_operations * vectors};
}

/// Sums of groups into the force.
std::uint64_t group_operations(const Problem& problem) {
    std::uint64_t groups = 0;
    for (const std::uint32_t bits : {FACE_BITS, EDGE_BITS, CORNER_BITS})
        groups += (problem.group_bits & bits) != 0 ? 1 : 0;
    // Materials carry the stiffness, so that the first group's sum is the force.
    if (problem.has_materials() && groups > 0) --groups;
    return groups * vector_operations;
}

/// Every spring is evaluated from both of its ends.
std::uint64_t spring_ends(const Problem& problem) { return 2 * count_springs(problem).total(); }

}  // namespace

template <class Real>
std::uint64_t pull_operations(const Problem& problem, Formulation formulation) {
    const SpringCounts springs = count_springs(problem);
    std::uint64_t operations = springs.beyond * pull_operations<Real>(oblique, formulation);
    // Springs of a group lie along as many axes.
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
    if (problem.has_materials()) work.bytes += problem.particle_count() * sizeof(Real);  // compliance
    const std::uint64_t material = problem.has_materials() ? material_operations<Real> : 0;
    work.operations += problem.particle_count() * group_operations(problem) +
                       2 * pull_operations<Real>(problem, formulation) +
                       spring_ends(problem) * (material + vector_operations);
    return work;
}

namespace {

/// A spring of the march: as pull_operations() counts, but that what follows the root is 1 on positions and
/// displacements, and by increments in float32 3 with the root's and the reciprocal's own. Face springs are
/// scaled.
template <class Real>
std::uint64_t march_pull_operations(const Direction& direction, Formulation formulation) {
    const glm::ivec3 o = direction.offset;
    const auto axes = std::uint64_t((o.x != 0) + (o.y != 0) + (o.z != 0));
    std::uint64_t operations = 3 + (single<Real> ? 3 : 4) + (direction.group == SpringGroup::face ? 1 : 0);
    if (!on_positions(formulation)) operations += axes;
    if (by_increments(formulation)) return operations + 3 + axes + (single<Real> ? 4 : 6 + 1 + 5 + 2);
    return operations + (single<Real> ? 1 : 6) + 1;
}

}  // namespace

template <class Real>
StepWork march_work(const Problem& problem, Formulation formulation) {
    const std::uint64_t particles = problem.particle_count();
    const bool increments = by_increments(formulation);
    StepWork work{.bytes = particles * (increments ? 4 : 3) * sizeof(Vector<Real>), .operations = 0};
    // Evaluations of the springs of a thread's particles, of which some are shared with other threads: two
    // rows of two in float32, one in float64.
    struct Share {
        std::uint64_t evaluations, springs;
    };
    const std::array<Share, 2> shares =
        single<Real> ? std::array<Share, 2>{{{16, 12}, {38, 24}}} : std::array<Share, 2>{{{9, 6}, {22, 12}}};
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
StepWork explicit_work(const Problem& problem, bool secondary, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    const std::uint64_t ends = spring_ends(problem);
    work.bytes += ends * (sizeof(std::uint32_t) + (secondary ? sizeof(SpringConstants<Real>) : 0));
    work.operations += 2 * pull_operations<Real>(problem, formulation) + ends * vector_operations;
    // The stiffness: once a spring end, or once a group.
    work.operations += secondary ? ends : problem.particle_count() * group_operations(problem);
    return work;
}

template <class Real>
StepWork delta_work(const Problem& problem, Formulation formulation) {
    StepWork work = implicit_work<Real>(problem, formulation);
    const std::uint64_t off_lattice_ends = 2 * count_springs(problem).beyond;
    work.bytes += units_of(problem.particle_count(), std::size_t(slice_particles)) * sizeof(Slice) +
                  off_lattice_ends * (sizeof(std::uint32_t) + sizeof(SpringConstants<Real>) +
                                      (on_positions(formulation) ? 0 : sizeof(SpringRest<Real>)));
    work.operations += off_lattice_ends;  // the stiffness
    return work;
}

template <class Real>
StepWork scatter_work(const Problem& problem, Formulation formulation) {
    StepWork work = motion_work<Real>(problem, formulation);
    const std::uint64_t springs = count_springs(problem).total();
    const std::uint64_t particles = problem.particle_count();
    const std::uint64_t force_read_and_written = 2 * particles * sizeof(Vector<Real>);
    work.bytes += force_read_and_written;
    if (springs == 0) return work;
    work.launches = 2;
    work.bytes += force_read_and_written + particles * sizeof(ParticleRecord<Real>) +
                  springs * (sizeof(SpringEnds) + sizeof(SpringConstants<Real>));
    // The stiffness, the force, and its addition to either end.
    work.operations += pull_operations<Real>(problem, formulation) + springs * (1 + 3 * vector_operations);
    return work;
}

template std::uint64_t pull_operations<float>(const Problem&, Formulation);
template std::uint64_t pull_operations<double>(const Problem&, Formulation);
template StepWork implicit_work<float>(const Problem&, Formulation);
template StepWork implicit_work<double>(const Problem&, Formulation);
template StepWork march_work<float>(const Problem&, Formulation);
template StepWork march_work<double>(const Problem&, Formulation);
template StepWork explicit_work<float>(const Problem&, bool, Formulation);
template StepWork explicit_work<double>(const Problem&, bool, Formulation);
template StepWork delta_work<float>(const Problem&, Formulation);
template StepWork delta_work<double>(const Problem&, Formulation);
template StepWork scatter_work<float>(const Problem&, Formulation);
template StepWork scatter_work<double>(const Problem&, Formulation);

}  // namespace voxspring::cuda
