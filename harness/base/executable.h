// Identifies the program that runs.
#pragma once

#include <string>

namespace voxspring {

/// The hash of the executable's file. Unlike the commit's hash, it also changes with the compiler, the flags
/// and code that is not committed. The file is read once per process.
const std::string& fingerprint_of_executable();

}  // namespace voxspring
