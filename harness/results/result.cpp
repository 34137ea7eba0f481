#include "harness/results/result.h"

#include <algorithm>
#include <iomanip>
#include <map>
#include <sstream>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "harness/base/text.h"
#include "harness/device/limits.h"
#include "harness/device/noise.h"
#include "version.h"  // generated

namespace voxspring {
namespace {

using Row = std::vector<std::string>;

/// The head of a reason, without its figure.
std::string kind_of(const std::string& reason) { return reason.substr(0, reason.find(" (")); }

}  // namespace

bool is_median(const nlohmann::json& row) {
    const bool only = row.at("run_type") == "iteration" && row.at("repetitions") == 1;
    return only || row.value("aggregate_name", "") == "median";
}

std::string case_name(const nlohmann::json& row) {
    const std::string name = row.at("name");
    return name.substr(0, name.find("/iterations:"));
}

std::string case_label(const nlohmann::json& row) {
    const std::string scene = row.at("scene");
    std::string text = case_name(row).substr(scene.size() + 1);
    std::replace(text.begin(), text.end(), '/', ' ');
    return text;
}

std::string noise_mark(const nlohmann::json& row) { return row.contains("noisy") ? "~" : ""; }

void print_noise(const std::vector<nlohmann::json>& rows, std::ostream& out) {
    std::map<std::string, std::vector<std::string>> by_kind;
    for (const nlohmann::json& row : rows) {
        if (!row.contains("noisy")) continue;
        for (const std::string reason : row.at("noisy")) {
            const std::string kind = kind_of(reason);
            by_kind[kind].push_back(row.at("scene").get<std::string>() + " " + case_label(row) +
                                    reason.substr(kind.size()));
        }
    }
    for (const auto& [kind, cases] : by_kind) {
        out << "~ not to be trusted, " << kind << ":\n";
        for (const std::string& one : cases) out << "    " << one << "\n";
    }
}

void print_unmeasured(const nlohmann::json& result, std::ostream& out) {
    for (const char* list : {"skipped", "failed"}) {
        // A reason once, with all that it holds for.
        std::vector<std::string> reasons;
        std::map<std::string, std::vector<std::string>> cases, on;
        const auto add = [](std::vector<std::string>& to, const std::string& text) {
            if (std::find(to.begin(), to.end(), text) == to.end()) to.push_back(text);
        };
        for (const auto& row : result.at(list)) {
            const std::string reason = row.at("reason");
            add(reasons, reason);
            add(cases[reason], case_label(row));
            add(on[reason], row.at("scene"));
        }
        for (const std::string& reason : reasons) {
            out << list << ": " << reason << "\n    " << joined(cases[reason]) << "\n    on "
                << joined(on[reason]) << "\n";
        }
    }
}

nlohmann::json build_context() {
    const auto or_null = [](const std::string& text) {
        return text.empty() ? nlohmann::json(nullptr) : nlohmann::json(text);
    };
    return {{"commit", version_commit},
            {"clean", version_clean},
            {"compiler", version_compiler},
            {"flags", version_flags},
            {"cuda_compiler", or_null(version_cuda_compiler)},
            {"cuda_flags", or_null(version_cuda_flags)},
            {"cuda_architectures", or_null(version_cuda_architectures)},
            {"cpu", cpu_name()}};
}

void print_table(const nlohmann::json& result, std::ostream& out) {
    std::vector<std::string> scenes;
    std::map<std::string, std::vector<nlohmann::json>> medians;
    for (const auto& row : result.at("benchmarks")) {
        if (!is_median(row)) continue;
        const std::string scene = row.at("scene");
        if (!medians.contains(scene)) scenes.push_back(scene);
        medians[scene].push_back(row);
    }
    std::vector<Row> edits = {
        {"scene", "backend", "edits", "an edit (median)", "(max)", "a step without", "slow-down"}};
    std::vector<Row> table = {{"scene", "backend", "time a step", "particles/s", "springs/s",
                               "rounding error", "(max)", "total error", "x fastest", "of limit"}};
    std::vector<std::string> chaotic;
    for (const std::string& scene : scenes) {
        auto& rows = medians[scene];
        const auto time = [](const nlohmann::json& row) { return row.at("real_time").get<double>(); };
        std::stable_sort(rows.begin(), rows.end(),
                         [&](const auto& a, const auto& b) { return time(a) < time(b); });
        if (rows.front().at("chaotic").get<bool>()) {
            chaotic.push_back(scene + ": two float64 runs differ by " +
                              error_text(rows.front().at("divergence")) + " after " +
                              std::to_string(rows.front().at("steps").get<int>()) + " steps");
        }
        for (const auto& row : rows) {
            std::ostringstream ratio;
            ratio << std::fixed << std::setprecision(2) << time(row) / time(rows.front());
            table.push_back({scene, case_label(row), noise_mark(row) + si(time(row) * 1e-6, "s"),
                             si(row.at("particle_updates_per_second"), "/s"),
                             si(row.at("spring_updates_per_second"), "/s"),
                             error_text(row.at("error_relative_l2")), error_text(row.at("error_max")),
                             error_text(row.at("total_error_relative_l2")), ratio.str(),
                             percent_text(row.at("fraction_of_limit"))});
            if (!row.contains("edits")) continue;
            const double without = row.at("seconds_per_step_without_edits");
            std::ostringstream slow_down;
            slow_down << std::showpos << std::fixed << std::setprecision(1)
                      << 100 * (time(row) * 1e-6 / without - 1) << " %";
            edits.push_back({scene, case_label(row), std::to_string(row.at("edits").get<int>()),
                             si(row.at("edit_seconds_median"), "s"), si(row.at("edit_seconds_max"), "s"),
                             si(without, "s"), slow_down.str()});
        }
    }
    print_aligned(table, out);
    for (const std::string& scene : scenes) print_noise(medians[scene], out);
    for (const std::string& scene : chaotic) out << "chaotic, errors say nothing: " << scene << "\n";
    if (edits.size() > 1) {
        out << "\n";
        print_aligned(edits, out);
    }
    print_limits(result.at("context").at("voxspring").at("limits"), out);
    print_unmeasured(result, out);
}

}  // namespace voxspring
