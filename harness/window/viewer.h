// `voxspring view`: a window with the live body.
#pragma once

#include <ostream>
#include <string>

#include "harness/view/view_options.h"

namespace voxspring {

/// Returns the exit code once the window is closed. Throws BadInput, BadSpecification, Unavailable where
/// there is no display, and DeviceError where the window's own card fails.
int view_scene(const std::string& scene, const ViewOptions& options, std::ostream& out);

}  // namespace voxspring
