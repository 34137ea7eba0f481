#include "backends/backend.h"

#include <chrono>

namespace voxspring {

std::string to_string(Precision precision) { return precision == Precision::float32 ? "float32" : "float64"; }

std::optional<Choice> choice_of_auto(const Options& options,
                                     const std::map<std::string, std::string>& values) {
    Choice choice;
    for (const auto& [parameter, value] : values) {
        const auto asked = options.tuning.find(parameter);
        if (asked == options.tuning.end() || asked->second != "auto") continue;
        choice.tuning += (choice.tuning.empty() ? "" : ",") + parameter + "=" + value;
    }
    return choice.tuning.empty() ? std::nullopt : std::optional(choice);
}

std::string Backend::unsupported(const Problem& problem) const {
    // tool() changes nothing here. It is not const because callers may change the backend through its result.
    const bool has_tool = const_cast<Backend*>(this)->tool() != nullptr;
    return problem.has_tool() && !has_tool ? "the backend does not support a tool that holds particles"
                                           : std::string();
}

Timing Backend::timed(const std::function<void()>& run) {
    synchronize();
    const auto begin = std::chrono::steady_clock::now();
    mark(Mark::begin);
    run();
    mark(Mark::end);
    synchronize();
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin;
    return {.device_seconds = seconds_between_marks(), .host_seconds = elapsed.count()};
}

}  // namespace voxspring
