// `voxspring view`: a window with the live body.
#pragma once

#include <ostream>
#include <string>

#include "harness/cli/arguments.h"

namespace voxspring {

/// Shows the scene and returns the exit code once the window is closed. Throws BadInput, BadSpecification,
/// Unavailable if there is no display, and DeviceError if the card that draws the window fails.
int view_scene(const std::string& scene, const ViewOptions& options, std::ostream& out);

}  // namespace voxspring
