// The storage buffers of backends that step by compute shaders, in OpenGL and Vulkan alike. The shaders are
// those that include shaders/compute.glsl.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <limits>
#include <vector>

#include "backends/glsl/device.h"
#include "backends/layout/particles.h"

namespace voxspring::glsl {

/// Bindings of the storage buffers of shaders/compute.glsl.
enum Binding : unsigned {
    words,
    next_words,
    increments,
    words_low,
    next_words_low,
    increments_low,
    loads,
    inverse_masses,
    first_own_binding,  ///< from here on: buffers that only one kind of addressing has
    held_words = 11,    ///< for shaders/tool.comp
    held_forces,
};
inline constexpr int storage_blocks = 13;

/// What a step needs besides springs and the state, one element per word (a particle or, on a grid, a voxel).
/// A list is empty if the shader does not use it.
template <class Real>
struct Operands {
    std::vector<layout::Vector<Real>> loads;
    std::vector<Real> inverse_masses;
};
/// With `all_terms`, neutral values stand in for what the problem lacks.
template <class Real>
Operands<Real> pack_operands(const Problem& problem, const layout::Placement& placement, bool all_terms);

/// Bytes of the state and the operands of a problem with this placement.
std::uint64_t compute_bytes(const Problem& problem, const Options& options,
                            const layout::Placement& placement);

/// Arranges work groups in rows of a length that every driver accepts. The result may have some more groups
/// than `groups`.
glm::ivec3 rows_of_groups(int groups);
inline constexpr int max_groups = 65535;  ///< the most work groups along an axis that every driver accepts

/// An empty string, or why work groups of `group` exceed `limits`.
std::string work_group_refusal(glm::ivec3 group, const WorkGroupLimits& limits);

/// The number of work groups of 64 invocations that stride over `count` items, as in shaders/measure.comp,
/// for example.
unsigned striding_groups(std::size_t count);

/// 1 / `largest`, a DivergenceMonitor's largest increment, as shaders/divergence_check.comp takes it. Its
/// product with an increment of 0 is 0 even if `largest` is 0: an infinity would give a NaN, which the check
/// would find too fast.
inline double inverse_largest(double largest) {
    return 1 / std::max(largest, double(std::numeric_limits<float>::min()));
}

/// An empty string, or why an upload of `needed` bytes is refused. `free` bytes are free, and the backend
/// will free `held` bytes first. If the driver does not tell `free`, nothing is refused in advance.
std::string memory_refusal(std::uint64_t needed, std::uint64_t held, std::optional<std::uint64_t> free);

}  // namespace voxspring::glsl
