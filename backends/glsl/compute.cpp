#include "backends/glsl/compute.h"

#include <algorithm>
#include <string>

#include "backends/by_precision.h"

namespace voxspring::glsl {
namespace {

/// Returns `values`. If there are none but they are `needed`, returns `count` times `neutral`.
template <class T>
std::vector<T> or_neutral(std::vector<T> values, bool needed, std::size_t count, const T& neutral) {
    if (values.empty() && needed) values.assign(count, neutral);
    return values;
}

}  // namespace

template <class Real>
Operands<Real> pack_operands(const Problem& problem, const layout::Placement& placement, bool all_terms) {
    return {
        or_neutral(layout::pack_load<Real>(problem, placement), needs_loads(problem, all_terms),
                   placement.words, layout::Vector<Real>{0, 0, 0}),
        or_neutral(layout::pack_inverse_masses<Real>(problem, placement), needs_materials(problem, all_terms),
                   placement.words, Real(1 / problem.materials[0].mass))};
}
template Operands<float> pack_operands(const Problem&, const layout::Placement&, bool);
template Operands<double> pack_operands(const Problem&, const layout::Placement&, bool);

std::uint64_t compute_bytes(const Problem& problem, const Options& options,
                            const layout::Placement& placement) {
    return by_precision(options.precision, [&]<class Real>(Real) {
        return layout::particle_bytes<Real>(problem, placement, options.formulation,
                                            options.tuning.at("terms") == "all");
    });
}

glm::ivec3 rows_of_groups(int groups) {
    const int rows = std::max((groups + max_groups - 1) / max_groups, 1);
    return {(groups + rows - 1) / rows, rows, 1};
}

std::string work_group_refusal(glm::ivec3 group, const WorkGroupLimits& limits) {
    const std::uint64_t invocations =
        std::uint64_t(group.x) * std::uint64_t(group.y) * std::uint64_t(group.z);
    if (invocations > limits.invocations)
        return "work groups of " + std::to_string(invocations) + " invocations exceed the " +
               std::to_string(limits.invocations) + " that the device allows";
    for (int axis = 0; axis < 3; ++axis) {
        if (unsigned(group[axis]) > limits.extents[axis])
            return "work groups of " + std::to_string(group[axis]) + " invocations along " + "xyz"[axis] +
                   " exceed the " + std::to_string(limits.extents[axis]) + " that the device allows";
    }
    return {};
}

std::string BufferLimits::too_large(const std::string& what, std::uint64_t bytes) const {
    if (bytes <= max_bytes) return {};
    return what + " of " + std::to_string(bytes) + " bytes exceed the " + std::to_string(max_bytes) +
           " that the driver allows one storage buffer (" + limit + ")";
}

unsigned striding_groups(std::size_t count) {
    constexpr std::size_t group = 64;
    return unsigned(std::min((count + group - 1) / group, std::size_t(max_groups)));
}

std::string memory_refusal(std::uint64_t needed, std::uint64_t held, std::optional<std::uint64_t> free) {
    if (!free || needed <= *free + held) return {};
    return "takes " + std::to_string(needed) + " bytes of device memory, and " +
           std::to_string(*free + held) + " are free";
}

}  // namespace voxspring::glsl
