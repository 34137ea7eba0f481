// Boxes of voxels.
#pragma once

#include <cstddef>
#include <glm/vec3.hpp>

namespace voxspring::layout {

/// The number of a voxel in a box of `dims` voxels, x fastest.
inline std::size_t index_in(const glm::ivec3& dims, const glm::ivec3& at) {
    return (std::size_t(at.z) * std::size_t(dims.y) + std::size_t(at.y)) * std::size_t(dims.x) +
           std::size_t(at.x);
}
/// Whether a box of `dims` voxels has the voxel `at`.
inline bool has_voxel(const glm::ivec3& dims, const glm::ivec3& at) {
    return at.x >= 0 && at.y >= 0 && at.z >= 0 && at.x < dims.x && at.y < dims.y && at.z < dims.z;
}
inline std::size_t volume(const glm::ivec3& dims) {
    return std::size_t(dims.x) * std::size_t(dims.y) * std::size_t(dims.z);
}

/// Calls visit(at) for each voxel from `begin` to `end` (exclusive), x fastest.
template <class Visit>
void visit_box(const glm::ivec3& begin, const glm::ivec3& end, Visit visit) {
    for (int z = begin.z; z < end.z; ++z) {
        for (int y = begin.y; y < end.y; ++y) {
            for (int x = begin.x; x < end.x; ++x) visit(glm::ivec3(x, y, z));
        }
    }
}

}  // namespace voxspring::layout
