#include "harness/cli/commands.h"
#include "version.h"  // generated

namespace voxspring {

std::string version_text() {
    return std::string("voxspring ") + version_number + " (commit " + version_commit +
           (version_clean ? "" : ", changed since") + ")";
}

}  // namespace voxspring
