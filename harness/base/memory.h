// How much memory this process may use.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>

namespace voxspring {

/// The machine's memory in bytes, or the memory limit of this process's control group (for example that of a
/// container), whichever is smaller.
std::uint64_t memory_limit();

inline constexpr std::uint64_t no_memory_limit = std::numeric_limits<std::uint64_t>::max();

/// The smallest limit, in bytes, of this process's control group and of the groups above it; no_memory_limit
/// if none has a limit. `groups` is the file that lists the process's groups. `root` is the folder in which
/// control groups, of version 1 or 2, are mounted.
std::uint64_t cgroup_memory_limit(const std::filesystem::path& groups = "/proc/self/cgroup",
                                  const std::filesystem::path& root = "/sys/fs/cgroup");

}  // namespace voxspring
