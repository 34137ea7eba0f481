// The command line: its commands, its options and the values that they accept.
#pragma once

#include <functional>
#include <ostream>
#include <string>

#include "harness/view/view_options.h"

namespace voxspring {

/// `voxspring view`, which needs a display: shows the scene and returns the exit code.
using ViewScene = std::function<int(const std::string& scene, const ViewOptions& options, std::ostream& out)>;

/// Runs the command line and returns the exit code. Throws BadInput, BadSpecification and what the commands
/// throw.
int run_command_line(int argc, char** argv, std::ostream& out, const ViewScene& view);

}  // namespace voxspring
