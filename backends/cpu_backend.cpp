#include "backends/cpu_backend.h"

#include <fstream>

namespace voxspring {

std::string cpu_name() {
    std::ifstream cpuinfo("/proc/cpuinfo");
    for (std::string line; std::getline(cpuinfo, line);) {
        if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
    }
    return "unknown CPU";
}

Capabilities cpu_capabilities(const std::string& target, int threads) {
    return {.api = "CPU",
            .device = cpu_name(),
            .driver = target + ", " + std::to_string(threads) + (threads == 1 ? " thread" : " threads"),
            .uuid = {},
            .clock = "steady_clock",
            .deterministic = true};
}

}  // namespace voxspring
