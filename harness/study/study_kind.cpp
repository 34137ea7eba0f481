#include "harness/study/study_kind.h"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/base/text.h"

namespace voxspring {
namespace {

using Factories = std::map<std::string, std::function<std::unique_ptr<StudyKind>()>>;
Factories& factories() {
    static Factories all;
    return all;
}

}  // namespace

RegisteredStudyKind::RegisteredStudyKind(const std::string& name,
                                         std::function<std::unique_ptr<StudyKind>()> make) {
    factories().emplace(name, std::move(make));
}

std::vector<std::string> study_kind_names() {
    std::vector<std::string> names;
    for (const auto& [name, make] : factories()) names.push_back(name);
    return names;
}

std::unique_ptr<StudyKind> make_study_kind(const std::string& name) { return factories().at(name)(); }

std::unique_ptr<StudyKind> kind_of(const Study& study) {
    if (!factories().contains(study.kind))
        throw BadInput("study " + study.name, "kind", study.kind, "one of: " + joined(study_kind_names()));
    auto kind = make_study_kind(study.kind);
    JsonObject settings = parse_json(json_text(study.settings), "study " + study.name);
    kind->read(settings);
    settings.finish();
    return kind;
}

void print_result(const Result& result, std::ostream& out, TableWidth width) {
    make_study_kind(result.own_context().at("study").at("kind"))->print(result, out, width);
    const nlohmann::json strained =
        result.own_context().at("study").value("strained_starts", nlohmann::json::array());
    if (!strained.empty())
        out << fmt::format("{}: steps begin at a random start that strains every spring\n",
                           joined(strained.get<std::vector<std::string>>()));
    const nlohmann::json units = result.own_context().value("units", nlohmann::json::object());
    for (const auto& [scene, of] : units.items())
        out << fmt::format("{}: lengths in {}, times of the motion in {}, forces in {}\n", scene,
                           of.at("length").get<std::string>(), of.at("time").get<std::string>(),
                           of.at("force").get<std::string>());
}

Result read_result(const nlohmann::json& file) {
    Result result;
    result.context = file.at("context");
    const nlohmann::json study = result.own_context().value("study", nlohmann::json::object());
    make_study_kind(study.value("kind", "timing"))->make_lists(result);
    const nlohmann::json counters = result.own_context().value("counters", nlohmann::json::object());
    result.own_context().erase("counters");
    for (const auto& [list, rows] : file.items()) {
        if (!rows.is_array()) continue;
        for (nlohmann::json row : rows) {
            for (const auto& [name, of] : counters.items()) {
                if (!row.contains(name)) continue;
                row["counters"].push_back(of);
                row["counters"].back()["name"] = name;
            }
            result.add(list, row);
        }
    }
    return result;
}

}  // namespace voxspring
