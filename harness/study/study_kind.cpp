#include "harness/study/study_kind.h"

#include <fmt/format.h>

#include <cstddef>
#include <exception>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
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

/// The row of a file with its counters, which the file describes in its context.
nlohmann::json with_counters(nlohmann::json row, const nlohmann::json& counters) {
    for (const auto& [name, of] : counters.items()) {
        if (!row.contains(name)) continue;
        row["counters"].push_back(of);
        row["counters"].back()["name"] = name;
    }
    return row;
}

BadInput refusal_of_row(const std::string& file, const std::string& list, std::size_t number,
                        const std::exception& error) {
    return {file, fmt::format("{}[{}]", list, number), error.what(), "a row as results/schema.json has it"};
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

Result read_result(const nlohmann::json& file, const std::string& name) {
    Result result;
    result.context = file.at("context");
    const nlohmann::json study = result.own_context().value("study", nlohmann::json::object());
    make_study_kind(study.value("kind", "timing"))->make_lists(result);
    const nlohmann::json counters = result.own_context().value("counters", nlohmann::json::object());
    result.own_context().erase("counters");
    for (const auto& [list, rows] : file.items()) {
        if (!rows.is_array()) continue;
        for (std::size_t n = 0; n < rows.size(); ++n) {
            try {
                result.add(list, with_counters(rows[n], counters));
            } catch (const nlohmann::json::exception& error) {
                throw refusal_of_row(name, list, n, error);
            } catch (const std::logic_error& error) {  // an unknown unit, or a counter that is there twice
                throw refusal_of_row(name, list, n, error);
            }
        }
    }
    return result;
}

Result read_result_of(const std::string& kind, JsonObject file, const std::string& scene,
                      const std::vector<std::string>& figures) {
    const std::string accepted = "the result of a study of kind " + kind;
    check_schema_version(file, result_schema_version);
    const JsonValue list = file.require(kind, accepted);
    JsonObject context = file.require("context", accepted).object().require("voxspring", accepted).object();
    const JsonValue found = context.require("study", accepted).object().require("kind", accepted);
    if (found.string() != kind) found.refuse(kind);
    std::set<std::string> scenes;
    for (const JsonValue& item : list.array()) {
        JsonObject row = item.object();
        const std::string of = row.require("scene").string();
        // Tables have the name without its scene (Row::label()), and the size of the body.
        const JsonValue name = row.require("name");
        if (!name.string().starts_with(of + "/")) name.refuse(of + "/BACKEND/FORMULATION/PRECISION");
        (void)row.require("particles", "a number").number();
        // Without this check a missing figure would be read as 0, and the row would be the best of all.
        for (const std::string& figure : figures)
            (void)row.require(figure, "a number").number(0, std::numeric_limits<double>::max());
        scenes.insert(of);
    }
    if (!scenes.contains(scene))
        throw BadInput(list.file(), kind, scene,
                       "one of the result's scenes: " +
                           (scenes.empty() ? "it has none" : joined({scenes.begin(), scenes.end()})));
    return read_result(file.value().raw(), list.file());
}

}  // namespace voxspring
