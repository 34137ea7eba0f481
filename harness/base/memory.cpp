#include "harness/base/memory.h"

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace voxspring {
namespace {

/// The limit in `file`, in bytes; no_memory_limit if there is no such file or the file says "max".
std::uint64_t limit_in(const std::filesystem::path& file) {
    std::ifstream stream(file);
    std::uint64_t bytes = 0;
    return stream >> bytes ? bytes : no_memory_limit;
}

/// The smallest limit, in bytes, in the files `name` of `group`, of the groups above it and of `root`. `root`
/// is the folder in which control groups are mounted; in a container it may be the container's own group.
std::uint64_t min_limit(const std::filesystem::path& root, std::filesystem::path group,
                        const std::string& name) {
    std::uint64_t limit = limit_in(root / name);
    for (group = group.relative_path(); !group.empty(); group = group.parent_path())
        limit = std::min(limit, limit_in(root / group / name));
    return limit;
}

/// Whether `word` is one of the words between the commas of `list`.
bool has_word(const std::string& list, const std::string& word) {
    return ("," + list + ",").find("," + word + ",") != std::string::npos;
}

}  // namespace

std::uint64_t cgroup_memory_limit(const std::filesystem::path& groups, const std::filesystem::path& root) {
    std::uint64_t limit = no_memory_limit;
    std::ifstream stream(groups);
    // A line is NUMBER:CONTROLLERS:GROUP. Version 2 of control groups has the number 0 and no controllers.
    for (std::string line; std::getline(stream, line);) {
        const auto first = line.find(':');
        const auto second = line.find(':', first + 1);
        if (first == std::string::npos || second == std::string::npos) continue;
        const std::string controllers = line.substr(first + 1, second - first - 1);
        const std::string group = line.substr(second + 1);
        if (controllers.empty()) {
            limit = std::min(limit, min_limit(root, group, "memory.max"));
        } else if (has_word(controllers, "memory")) {
            limit = std::min(limit, min_limit(root / "memory", group, "memory.limit_in_bytes"));
        }
    }
    return limit;
}

std::uint64_t memory_limit() {
    const long pages = sysconf(_SC_PHYS_PAGES);
    const long page_bytes = sysconf(_SC_PAGE_SIZE);
    const std::uint64_t physical =
        std::uint64_t(std::max(pages, 1L)) * std::uint64_t(std::max(page_bytes, 1L));
    return std::min(physical, cgroup_memory_limit());
}

}  // namespace voxspring
