// Finds the springs that cuts and sutures of a scene file change.
#pragma once

#include <vector>

#include "backends/physics/problem.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_file.h"
#include "harness/volume/dataset.h"

namespace voxspring {

/// The edits of `specs` in the order in which they are made. Each is computed on `problem` as the edits
/// before it have left it. Repetitions that change no spring are left out. Throws BadInput, also if no
/// repetition of an edit changes a spring or the edits exceed `limits`.
std::vector<ScheduledEdit> schedule_edits(const std::vector<EditSpec>& specs, const Problem& problem,
                                          const SceneSizeLimits& limits);

}  // namespace voxspring
