// Identifies the program that runs.
#pragma once

#include <string>

namespace voxspring {

/// The hash of the executable's file. It changes with the compiler, the flags and every line of code, while
/// one commit may be built in two ways, and a tree may differ from its commit. The file is read once per
/// process.
const std::string& fingerprint_of_executable();

}  // namespace voxspring
