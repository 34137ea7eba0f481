// Makes the voxels of datasets, and limits their size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

/// Limits of the size of a grid, checked before memory is allocated.
struct SceneSizeLimits {
    std::uint64_t voxels = 0;     ///< at most 2^32 - 1, so that an index fits into 32 bits
    std::uint64_t particles = 0;  ///< number of active voxels
    /// Largest number of voxels times triangles that all edits together may examine: about an hour on a slow
    /// machine.
    double edit_work = 1e11;

    /// The limits that fit memory_limit(): 16 bytes per voxel (the largest voxel type, label and index) and
    /// 192 bytes per particle (the problem and two states).
    static SceneSizeLimits of_this_machine();
};

/// Bounds of spacing, mass, stiffness and time step. A product of a few of them stays within the range of a
/// 64-bit float.
inline constexpr double min_quantity = 1e-12;
inline constexpr double max_quantity = 1e12;

/// Labels of a volume are whole numbers of at most 15 digits, which a 64-bit float holds exactly. There are
/// at most 255, because the material of a particle is a byte.
inline constexpr std::int64_t max_label = 999'999'999'999'999;
inline constexpr std::size_t max_labels = 255;

/// The longest side of a grid, chosen so that a product of three sides fits into 64 bits.
inline constexpr int max_side = 1 << 20;

/// Sides of a grid before they are checked.
using GridSides = glm::vec<3, std::int64_t>;

/// The number of voxels of a grid. Throws BadInput, naming `file`, `key` and the dims, if a side is not
/// within 1 to max_side or if there are more voxels than `limits` allows.
std::uint64_t checked_voxel_count(GridSides dims, const SceneSizeLimits& limits, std::string_view file,
                                  std::string_view key);

/// The limit that a grid with these sides exceeds, for messages: "at most 1000 voxels fit here". Empty if it
/// exceeds none.
std::string exceeded_limit(const glm::dvec3& sides, const SceneSizeLimits& limits);

/// The sides as text: "60 x 51 x 46".
std::string to_string(GridSides dims);

/// A box with all voxels active and spacing 1.
VoxelGrid make_box(glm::ivec3 dims);

/// The heart phantom: two ventricles, two atria, two vessels and two valves, made of ellipsoids and tubes
/// in a design box of 60 x 51 x 46, sampled at the voxel centres. At those dims it has the size of the
/// paper's MRI heart: 140760 voxels, 29449 of them active. Spacing 1.
VoxelGrid make_heart(glm::ivec3 dims);

/// Makes each voxel inactive with the probability `fraction`. A seed gives the same voxels on every machine.
void remove_at_random(VoxelGrid& grid, double fraction, std::uint64_t seed);

}  // namespace voxspring
