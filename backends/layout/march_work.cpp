#include "backends/layout/march_work.h"

#include <algorithm>
#include <array>

#include "backends/layout/records/particle.h"
#include "backends/layout/work.h"

namespace voxspring::layout {
namespace {

/// Operations of one spring of the march. They are counted as in pull_operations(), with three differences.
/// The formulations `position` and `displacement` take 1 operation after the root. Increments in float32 take
/// 4 for root, reciprocal and density together. Face springs take 1 more, to scale them.
template <class Real>
std::uint64_t march_pull_operations(const Direction& direction, Formulation formulation) {
    const std::uint64_t axes = axes_of(direction);
    std::uint64_t operations = 3 + (is_single<Real> ? 3 : 4) + (direction.group == SpringGroup::face ? 1 : 0);
    if (!on_positions(formulation)) operations += axes;
    if (by_increments(formulation)) return operations + 3 + axes + (is_single<Real> ? 4 : 6 + 1 + 5 + 2);
    return operations + (is_single<Real> ? 1 : 6) + 1;
}

}  // namespace

template <class Real>
StepWork shared_springs_work(const Problem& problem, Formulation formulation,
                             const std::array<SharedSprings, 2>& shares) {
    const std::uint64_t particles = problem.particle_count();
    const bool increments = by_increments(formulation);
    const std::uint64_t array = particles * sizeof(Vector<Real>);
    // The array that neighbours read has two copies: a step reads one and writes the other. The third array,
    // of increments, is overwritten in place.
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
    // A thread has two rows of two particles in float32, one row in float64.
    return shared_springs_work<Real>(problem, formulation,
                                     is_single<Real> ? std::array<SharedSprings, 2>{{{16, 12}, {38, 24}}}
                                                     : std::array<SharedSprings, 2>{{{9, 6}, {22, 12}}});
}

#define FOR_PRECISION(Real)                                                           \
    template StepWork shared_springs_work<Real>(const Problem&, Formulation,          \
                                                const std::array<SharedSprings, 2>&); \
    template StepWork march_work<Real>(const Problem&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
