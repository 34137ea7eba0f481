// Resamples a grid of labels to another distance between voxels.
#pragma once

#include <glm/vec3.hpp>
#include <string>

#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {

/// Replaces the grid of `labelled` by a grid of cubes of edge `pitch` with the same middle. A new voxel is
/// active if at least the share `fill` of it, in (0, 1], lies in active voxels of the old grid. Its label is
/// the one that fills most of it; if two fill the same share, the smaller one. Adds a note. Returns the
/// offset from the centre of the old voxel (0, 0, 0) to that of the new one. Throws BadInput, which names
/// `file` and --pitch, if the grid is too large for `limits` or no voxel is active.
glm::dvec3 resample(LabelledGrid& labelled, double pitch, double fill, const std::string& file,
                    const SceneSizeLimits& limits);

}  // namespace voxspring
