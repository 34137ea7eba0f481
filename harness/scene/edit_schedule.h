// A scene file's cuts and sutures, found on its voxels.
#pragma once

#include <vector>

#include "backends/physics/problem.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_file.h"
#include "harness/volume/dataset.h"

namespace voxspring {

/// The edits of `specs` in the order in which they are made, each found on what the ones before it left of
/// `problem`. An edit that repeats changes something at least once; times without a change are left out.
/// Throws BadInput.
std::vector<ScheduledEdit> schedule_edits(const std::vector<EditSpec>& specs, const Problem& problem,
                                          const SceneSizeLimits& limits);

}  // namespace voxspring
