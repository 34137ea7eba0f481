#include "backends/cpu/cpu_backend.h"

#include <algorithm>
#include <fstream>

#include "backends/api.h"

namespace voxspring {

void MonitoredCpuBackend::upload(const Problem& problem, const State& state) {
    monitor_ = next_monitor_;
    steps_ = last_good_ = 0;
    divergence_.reset();
    begin(problem, state);
}

void MonitoredCpuBackend::step(int count) {
    while (count > 0) {
        const std::int64_t to_check = monitor_.every > 0 ? monitor_.every - steps_ % monitor_.every : count;
        const int steps = int(std::min<std::int64_t>(count, to_check));
        integrate(steps);
        steps_ += steps;
        count -= steps;
        if (steps != to_check || monitor_.every <= 0 || divergence_.has_value()) continue;
        if (within(monitor_.largest_increment)) {
            last_good_ = steps_;
        } else {
            divergence_ = {last_good_, steps_};
        }
    }
}

namespace {

const RegisteredApi api({.name = host_api, .title = "CPU"});

}  // namespace

std::string cpu_name(const std::filesystem::path& cpuinfo) {
    std::ifstream stream(cpuinfo);
    for (std::string line; std::getline(stream, line);) {
        const auto colon = line.find(':');
        if (!line.starts_with("model name") || colon == std::string::npos) continue;
        // There may be no name after the colon.
        const auto name = line.find_first_not_of(" \t", colon + 1);
        if (name != std::string::npos) return line.substr(name);
    }
    return "unknown CPU";
}

Capabilities cpu_capabilities(const std::string& target, int threads) {
    return {.api = "CPU",
            .device = cpu_name(),
            .driver = target + ", " + std::to_string(threads) + (threads == 1 ? " thread" : " threads"),
            .uuid = {},
            .clock = "steady_clock",
            .deterministic = true,
            .limits_of = "CPU"};
}

}  // namespace voxspring
