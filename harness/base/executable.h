// Which program this is.
#pragma once

#include <string>

namespace voxspring {

/// The hash of the executable's file: another compiler, other flags or another line of code give another one.
/// A commit may have been built in two ways, and a tree may differ from its commit. Read once a process.
const std::string& fingerprint_of_executable();

}  // namespace voxspring
