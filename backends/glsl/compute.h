// What steps by compute shaders keep in storage buffers, whichever API dispatches them: shaders/compute.glsl
// and what includes it.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "backends/backend.h"
#include "backends/glsl/terms.h"
#include "backends/layout/particles.h"

namespace voxspring::glsl {

/// Storage buffers of shaders/compute.glsl.
enum Binding : unsigned {
    words,
    next_words,
    increments,
    words_low,
    next_words_low,
    increments_low,
    loads,
    inverse_masses,
    first_own_binding,
    held_words = 11,  ///< of shaders/tool.comp
    held_forces,
};
inline constexpr int storage_blocks = 13;

/// What moves particles besides springs, one a word; empty where the shader has no use for it.
template <class Real>
struct Operands {
    std::vector<cuda::Vector<Real>> loads;
    std::vector<Real> inverse_masses;
};
/// With `all_terms` neutral values stand where the problem has none.
template <class Real>
Operands<Real> pack_operands(const Problem& problem, const cuda::Placement& placement, bool all_terms);

/// Bytes of the state and the operands of a problem that is placed so.
std::uint64_t compute_bytes(const Problem& problem, const Options& options, const cuda::Placement& placement);

/// Work groups in rows of no more than every driver takes; there may be some more than asked for.
glm::ivec3 rows_of_groups(int groups);
inline constexpr int max_groups = 65535;  ///< along an axis, of every driver

/// What a device allows a work group.
struct WorkGroupLimits {
    std::uint64_t invocations = 0;
    glm::uvec3 extents{0};
};
/// Empty, or why work groups of `group` are beyond `limits`.
std::string work_group_refusal(glm::ivec3 group, const WorkGroupLimits& limits);

/// Work groups of 64 invocations that stride over `count` things, as shaders/divergence_check.comp,
/// measure.comp and edit*.comp do.
unsigned striding_groups(std::size_t count);

/// Empty, or why an upload that takes so many bytes is refused where `free` are free and the backend gives
/// `held` back first. A driver that does not tell refuses nothing before it fails.
std::string memory_refusal(std::uint64_t needed, std::uint64_t held, std::optional<std::uint64_t> free);

}  // namespace voxspring::glsl
