#include "harness/choice/advise.h"

#include <algorithm>
#include <limits>
#include <set>
#include <tuple>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/base/text.h"

namespace voxspring {
namespace {

/// Reads a row of the result of a pareto study. Empty if the run diverged or has no total error.
std::optional<Candidate> read_candidate(JsonObject row) {
    const auto seconds = row.require("seconds", "a number or null");
    const auto error = row.require("total_error_relative_l2", "a number or null");
    const auto rounding = row.require("error_relative_l2", "a number or null");
    if (seconds.text() == "null" || error.text() == "null" || rounding.text() == "null") return std::nullopt;
    constexpr double most = std::numeric_limits<double>::max();
    Candidate candidate;
    candidate.name = row.require("name").string();
    candidate.backend = row.require("backend").string();
    candidate.formulation = row.require("formulation").string();
    candidate.precision = row.require("precision").string();
    if (const auto tuning = row.require("tuning"); tuning.text() != "\"\"")
        candidate.tuning = tuning.string();
    candidate.device = row.require("device").string();
    candidate.time_step = row.require("time_step").number(0, most);
    candidate.fraction_of_stable = row.require("fraction_of_stable").number(0, most);
    candidate.steps = int(row.require("steps").integer(1, 2147483647));
    candidate.end_time = row.require("end_time").number(0, most);
    candidate.seconds = seconds.number(0, most);
    candidate.total_error = error.number(0, most);
    candidate.rounding_error = rounding.number(0, most);
    return candidate;
}

std::string with_tuning(const Candidate& candidate, const std::string& tuning) {
    return candidate.backend + ":formulation=" + candidate.formulation + ",precision=" + candidate.precision +
           (tuning.empty() ? "" : "," + tuning);
}

/// Whether `a` comes before `b`: by time, then by error, then by name.
bool faster(const Candidate& a, const Candidate& b) {
    return std::tie(a.seconds, a.total_error, a.name) < std::tie(b.seconds, b.total_error, b.name);
}

}  // namespace

std::vector<Candidate> candidates_of(JsonObject result, const std::string& scene) {
    check_schema_version(result, result_schema_version);
    const JsonValue list = result.require("pareto", "the result of a study of kind pareto");
    std::vector<Candidate> candidates;
    std::set<std::string> scenes;
    for (const JsonValue& item : list.array()) {
        JsonObject row = item.object();
        const std::string of = row.require("scene").string();
        scenes.insert(of);
        if (of != scene) continue;
        if (auto candidate = read_candidate(std::move(row))) candidates.push_back(*std::move(candidate));
    }
    if (!scenes.contains(scene))
        throw BadInput(list.file(), "pareto", scene,
                       "a scene of this result: " +
                           (scenes.empty() ? "it has none" : joined({scenes.begin(), scenes.end()})));
    return candidates;
}

Advice advise(const std::vector<Candidate>& candidates, double error) {
    Advice advice;
    advice.most_accurate =
        *std::min_element(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
            return std::tie(a.total_error, a.seconds) < std::tie(b.total_error, b.seconds);
        });
    std::vector<Candidate> reach;
    for (const Candidate& candidate : candidates) {
        if (candidate.total_error <= error) reach.push_back(candidate);
    }
    std::sort(reach.begin(), reach.end(), faster);
    if (reach.empty()) return advice;
    advice.best = reach.front();
    std::set<std::string> devices;
    for (const Candidate& candidate : reach) {
        const Candidate& best = *advice.best;
        const bool same = std::tie(candidate.backend, candidate.formulation, candidate.precision) ==
                          std::tie(best.backend, best.formulation, best.precision);
        if (same && candidate.device == best.device) continue;
        if (devices.insert(candidate.device).second) advice.runners_up.push_back(candidate);
    }
    return advice;
}

std::string changed_tuning(const Candidate& candidate) {
    const std::string alike =
        candidate.backend + "/" + candidate.formulation + "/" + candidate.precision + "/";
    try {
        const std::string label = BackendSpec::parse(with_tuning(candidate, candidate.tuning)).label();
        return label.starts_with(alike) ? label.substr(alike.size()) : "";
    } catch (const BadSpecification&) {
        return candidate.tuning;
    }
}

std::string specification(const Candidate& candidate) {
    return with_tuning(candidate, changed_tuning(candidate));
}

}  // namespace voxspring
