#include "cuda/work.h"

#include <bit>

#include "backends/physics/neighbours.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {
namespace {

template <class Real>
constexpr bool single = sizeof(Real) == sizeof(float);

/// unit_force_density() of an offset, the offset's 3 subtractions included: squared_length() 3 in float32 and
/// 4 in float64, inverse_root() 1 and 6, the density itself 3.
template <class Real>
constexpr std::uint64_t density_operations = single<Real> ? 3 + 3 + 1 + 3 : 3 + 4 + 6 + 3;

/// fast_series_stiffness(), the sum of its arguments included, and the density's multiplication by it.
template <class Real>
constexpr std::uint64_t material_operations = single<Real> ? 1 + 1 + 1 : 1 + 5 + 1;

/// A vector times a scalar, added to a sum or not.
constexpr std::uint64_t vector_operations = 3;

/// What moved() takes: x(t) and x(t - dt) read, x(t + dt) written, one operand of its own each where the
/// scene has one. next_position() has five vector operations when its additions are fused where they can be.
template <class Real>
StepWork motion_work(const Problem& problem) {
    const std::uint64_t particles = problem.particle_count();
    const std::uint64_t load = problem.load.empty() ? 0 : sizeof(Vector<Real>);
    const std::uint64_t inverse_mass = problem.has_materials() ? sizeof(Real) : 0;
    return {.bytes = particles * (3 * sizeof(Word<Real>) + load + inverse_mass),
            .operations = particles * vector_operations * (problem.load.empty() ? 5 : 6)};
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
StepWork implicit_work(const Problem& problem) {
    StepWork work = motion_work<Real>(problem);
    if (problem.has_materials()) work.bytes += problem.particle_count() * sizeof(Real);  // compliance
    const std::uint64_t material = problem.has_materials() ? material_operations<Real> : 0;
    work.operations += problem.particle_count() * group_operations(problem) +
                       spring_ends(problem) * (density_operations<Real> + material + vector_operations);
    return work;
}

template <class Real>
StepWork explicit_work(const Problem& problem, bool secondary) {
    StepWork work = motion_work<Real>(problem);
    const std::uint64_t ends = spring_ends(problem);
    work.bytes += ends * (sizeof(std::uint32_t) + (secondary ? sizeof(SpringConstants<Real>) : 0));
    work.operations += ends * (density_operations<Real> + vector_operations);
    // The stiffness: once a spring end, or once a group.
    work.operations += secondary ? ends : problem.particle_count() * group_operations(problem);
    return work;
}

template <class Real>
StepWork scatter_work(const Problem& problem) {
    StepWork work = motion_work<Real>(problem);
    const std::uint64_t springs = count_springs(problem).total();
    const std::uint64_t particles = problem.particle_count();
    const std::uint64_t force_read_and_written = 2 * particles * sizeof(Vector<Real>);
    work.bytes += force_read_and_written;
    if (springs == 0) return work;
    work.launches = 2;
    work.bytes += force_read_and_written + particles * sizeof(Word<Real>) +
                  springs * (sizeof(SpringEnds) + sizeof(SpringConstants<Real>));
    // The stiffness, the force, and its addition to either end.
    work.operations += springs * (density_operations<Real> + 1 + 3 * vector_operations);
    return work;
}

template StepWork implicit_work<float>(const Problem&);
template StepWork implicit_work<double>(const Problem&);
template StepWork explicit_work<float>(const Problem&, bool);
template StepWork explicit_work<double>(const Problem&, bool);
template StepWork scatter_work<float>(const Problem&);
template StepWork scatter_work<double>(const Problem&);

}  // namespace voxspring::cuda
