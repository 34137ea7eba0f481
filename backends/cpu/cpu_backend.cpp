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

namespace {

/// The first value that is not empty of `key` in lines "key : value"; empty if there is none.
std::string first_value(const std::filesystem::path& file, const std::string& key) {
    std::ifstream stream(file);
    for (std::string line; std::getline(stream, line);) {
        const auto colon = line.find(':');
        if (colon == std::string::npos || line.find_last_not_of(" \t", colon - 1) + 1 != key.size() ||
            !line.starts_with(key))
            continue;
        const auto value = line.find_first_not_of(" \t", colon + 1);
        if (value != std::string::npos) return line.substr(value);
    }
    return {};
}

}  // namespace

std::string cpu_name(const std::filesystem::path& cpuinfo) {
    const std::string name = first_value(cpuinfo, "model name");
    return name.empty() ? "unknown CPU" : name;
}

std::string cpu_model(const std::filesystem::path& cpuinfo) {
    std::string model;
    // The keys are those of x86 processors, then those of ARM processors.
    for (const auto& [key, name] : {std::pair{"cpu family", "family"},
                                    {"model", "model"},
                                    {"stepping", "stepping"},
                                    {"CPU implementer", "implementer"},
                                    {"CPU part", "part"},
                                    {"CPU revision", "revision"}}) {
        const std::string value = first_value(cpuinfo, key);
        if (!value.empty()) model += (model.empty() ? "" : ", ") + std::string(name) + " " + value;
    }
    return model;
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
