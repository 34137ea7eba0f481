// `voxspring report` and `voxspring diff`: Python scripts that come with the program.
#pragma once

#include <map>
#include <string>
#include <vector>

namespace voxspring {

/// What a script does, and the Python packages that it needs: `modules` are their import names, `packages`
/// their Debian packages, empty unless Debian has every one of them.
struct Script {
    std::string description, modules, packages;
};
/// All scripts, by the command that starts each.
const std::map<std::string, Script>& scripts();

/// Replaces this process by the script with these arguments; returns only by throwing. The script is looked
/// for in the folders results/ and share/voxspring/results/ beside the program and above it: in the source
/// tree, an installation or a package. Throws BadInput if it is not found, or if no Python here has the
/// packages that it needs.
int run_script(const std::string& command, const std::vector<std::string>& arguments);

}  // namespace voxspring
