#include "harness/results/result.h"

#include <sys/utsname.h>

#include <fstream>
#include <stdexcept>
#include <string_view>

#include "backends/cpu/cpu_backend.h"
#include "harness/base/json.h"
#include "version.h"  // generated

namespace voxspring {
namespace {

/// The operating system: "Debian GNU/Linux 12 (bookworm), Linux 6.1.0".
std::string os_name() {
    std::string name;
    std::ifstream file("/etc/os-release");
    constexpr std::string_view key = "PRETTY_NAME=";
    for (std::string line; std::getline(file, line);) {
        if (!line.starts_with(key)) continue;
        name = line.substr(key.size());
        std::erase(name, '"');
        name += ", ";
    }
    utsname kernel{};
    if (uname(&kernel) != 0) return name + "unknown kernel";
    return name + kernel.sysname + " " + kernel.release;
}

}  // namespace

Result::Result() {
    for (const char* list : {"benchmarks", "verification", "skipped", "failed"}) rows(list);
}

void Result::add(const std::string& list, const nlohmann::json& row) {
    std::unique_ptr<List>& found = lists_[list];
    if (!found) found = std::make_unique<ListOf<nlohmann::json>>();
    found->add(row);
}

void to_json(nlohmann::json& json, const Result& result) {
    json = {{"schema_version", result_schema_version}, {"context", result.context}};
    for (const auto& [name, list] : result.lists()) {
        nlohmann::json& rows = json[name] = list->json();
        for (nlohmann::json& row : rows) {
            if (!row.is_object() || !row.contains("counters")) continue;
            for (const auto& counter : row.at("counters")) {
                nlohmann::json& known = json["context"]["voxspring"]["counters"][counter.at("name")];
                const nlohmann::json described = {{"unit", counter.at("unit")},
                                                  {"better", counter.at("better")}};
                if (!known.is_null() && known != described)
                    throw std::logic_error("two different counters have the name " +
                                           json_text(counter.at("name")));
                known = described;
            }
            row.erase("counters");
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
            {"study_flags", version_study_flags},
            {"cuda_compiler", or_null(version_cuda_compiler)},
            {"cpu", cpu_name()},
            {"cpu_model", or_null(cpu_model())},
            {"os", os_name()}};
}

}  // namespace voxspring
