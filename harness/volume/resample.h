// Gives a grid of labels another distance of voxels.
#pragma once

#include <glm/vec3.hpp>
#include <string>

#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

/// Replaces the grid by one of cubes of edge `pitch`, whose middle is that of the old grid. A voxel is active
/// if at least `fill` of it, in (0, 1], lies in active voxels of the old grid, and has the label that fills
/// most of it, the smaller one of two that fill as much. Adds a note. Returns the centre of the new voxel
/// (0, 0, 0), seen from that of the old one. Throws BadInput, which names `file` and --pitch, if the grid is
/// too large for `limits` or no voxel is active.
glm::dvec3 resample(LabelledGrid& labelled, double pitch, double fill, const std::string& file,
                    const SceneSizeLimits& limits);

}  // namespace voxspring
