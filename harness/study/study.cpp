#include "harness/study/study.h"

#include <cstdint>
#include <map>
#include <set>
#include <utility>

#include "backends/suggestion.h"
#include "builtin_study_files.h"  // generated
#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/base/schema_versions.h"
#include "harness/study/auto_choice.h"
#include "harness/study/selection.h"

namespace voxspring {
namespace {

std::vector<std::string> read_patterns(const JsonValue& list) {
    std::vector<std::string> patterns;
    for (const JsonValue& item : list.array(1)) {
        patterns.push_back(item.string());
        try {
            if (asks_for_auto(patterns.back())) {
                check_auto(patterns.back());
            } else if (expand(patterns.back()).empty() && !matches_left_out(patterns.back())) {
                item.refuse("a glob that matches one of: " + registered_names());
            }
        } catch (const BadSpecification& error) {
            item.refuse(error.what());
        }
    }
    return patterns;
}

std::string join(const std::vector<std::string>& words) {
    std::string text;
    for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
    return text;
}

template <class Value>
std::vector<std::string> names_of(const std::vector<Value>& values) {
    std::vector<std::string> names;
    for (const Value value : values) names.push_back(to_string(value));
    return names;
}

/// Nothing takes less seconds than the one or makes more updates a second than the other.
constexpr double smallest_target = 1e-12, largest_target = 1e18;

int read_count(JsonObject& object, const std::string& key, int most, int otherwise) {
    const auto value = object.find(key);
    return value ? int(value->integer(1, most)) : otherwise;
}

/// Fractions of the stable time step, each smaller than the one before it.
std::vector<double> read_time_steps(const JsonValue& list) {
    std::vector<double> fractions;
    for (const JsonValue& item : list.array(1, 64)) {
        fractions.push_back(item.number(1e-6, 1));
        if (fractions.size() > 1 && fractions.back() >= fractions[fractions.size() - 2])
            item.refuse("fractions of the stable time step in descending order");
    }
    return fractions;
}

/// What a fastest study aims at.
std::vector<Target> read_targets(const JsonValue& list) {
    std::vector<Target> targets;
    for (const JsonValue& item : list.array()) {
        JsonObject object = item.object();
        Target target;
        target.scene = object.require("scene").string();
        target.formulation = object.require("formulation").one_of(names_of(every_formulation));
        target.precision = "float32";
        if (const auto precision = object.find("precision"))
            target.precision =
                precision->one_of(names_of(std::vector{Precision::float32, Precision::float64}));
        if (const auto backends = object.find("backends")) target.backends = backends->string();
        int quantities = 0;
        for (const Quantity quantity : all_quantities()) {
            const auto value = object.find(to_string(quantity));
            if (!value) continue;
            ++quantities;
            target.quantity = quantity;
            target.value = value->number(smallest_target, largest_target);
        }
        if (quantities != 1) item.refuse("one of " + join(names_of(all_quantities())));
        if (target.quantity == Quantity::speed_ratio)
            target.over = object.require("over", "a glob of backends").string();
        object.finish();
        targets.push_back(std::move(target));
    }
    return targets;
}

const std::map<std::string, StudyKind> study_kinds = {{"timing", StudyKind::timing},
                                                      {"fastest", StudyKind::fastest},
                                                      {"pareto", StudyKind::pareto},
                                                      {"stability", StudyKind::stability},
                                                      {"stress", StudyKind::stress}};
const std::map<std::string, StressLengths> stress_lengths = {
    {"full", StressLengths::full}, {"brief", StressLengths::brief}, {"shortest", StressLengths::shortest}};

template <class Value>
Value read_choice(const JsonValue& value, const std::map<std::string, Value>& choices) {
    std::vector<std::string> names;
    for (const auto& [name, choice] : choices) names.push_back(name);
    return choices.at(value.one_of(names));
}

/// The suites of a stress study, in the place of scenes.
std::vector<StudyScene> read_suites(const JsonValue& list) {
    std::vector<StudyScene> suites;
    for (const JsonValue& item : list.array(1)) {
        JsonObject object = item.object();
        StudyScene suite;
        suite.scene = "stress";
        suite.lengths = read_choice(object.require("lengths", "full, brief or shortest"), stress_lengths);
        if (const auto backends = object.find("backends")) suite.backends = read_patterns(*backends);
        object.finish();
        suites.push_back(std::move(suite));
    }
    return suites;
}

/// A file that the study names, resized ("my.json@64") or not, is found beside the study, wherever the study
/// is run from.
std::string found_beside(const std::filesystem::path& study, const std::string& scene) {
    const std::filesystem::path folder = study.parent_path();
    const bool is_there = std::filesystem::is_regular_file(folder / scene) ||
                          std::filesystem::is_regular_file(folder / scene.substr(0, scene.rfind('@')));
    return is_there ? (folder / scene).string() : scene;
}

constexpr int most_steps = 1000000000;
constexpr int most_repetitions = 10000;

}  // namespace

std::vector<Named> builtin_studies() {
    std::vector<Named> studies;
    for (const auto& [file, text] : builtin_study_files) {
        const Study study = load_study(std::filesystem::path(file).stem().string());
        studies.push_back({study.name, study.description});
    }
    return studies;
}

Study load_study(const std::string& argument) {
    const std::filesystem::path path(argument);
    const auto builtin = builtin_study_files.find(argument + ".json");
    if (builtin == builtin_study_files.end() && path.extension() != ".json") {
        std::string known;
        std::vector<std::string> names;
        for (const auto& [file, text] : builtin_study_files) {
            names.push_back(std::filesystem::path(file).stem().string());
            known += names.back() + ", ";
        }
        throw BadInput("command line", "STUDY", argument,
                       known + "or a .json file" + did_you_mean(argument, names));
    }
    JsonObject root = builtin != builtin_study_files.end()
                          ? parse_json(builtin->second, std::string(builtin->first))
                          : read_json(path);
    Study study;
    study.name = path.stem().string();
    if (const auto schema = root.find("$schema")) (void)schema->string();
    check_schema_version(root, study_schema_version);
    if (const auto description = root.find("description")) study.description = description->string();
    if (const auto kind = root.find("kind")) study.kind = read_choice(*kind, study_kinds);
    if (study.kind == StudyKind::timing) {
        if (const auto total = root.find("total_error")) study.total_error = total->boolean();
    } else if (study.kind == StudyKind::fastest) {
        study.total_error = false;
        if (const auto targets = root.find("targets")) study.targets = read_targets(*targets);
    } else if (study.kind == StudyKind::pareto) {
        study.time_steps = read_time_steps(root.require("time_steps", "fractions of the stable time step"));
    }
    study.repetitions = read_count(root, "repetitions", most_repetitions, 9);
    study.steps = read_count(root, "steps", most_steps, 100);
    study.backends = read_patterns(root.require("backends"));
    if (study.kind == StudyKind::stress) {
        study.scenes = read_suites(root.require("suites", "an array of suites"));
        root.finish();
        return study;
    }
    for (const JsonValue& item : root.require("scenes").array(1)) {
        JsonObject object = item.object();
        StudyScene scene;
        scene.scene = object.require("scene").string();
        if (builtin == builtin_study_files.end()) scene.scene = found_beside(path, scene.scene);
        scene.steps = read_count(object, "steps", most_steps, study.steps);
        if (const auto backends = object.find("backends")) scene.backends = read_patterns(*backends);
        if (study.kind == StudyKind::stability) {
            if (const auto map = object.find("map")) scene.map = map->boolean();
        } else if (study.kind == StudyKind::fastest) {
            if (const auto rewind = object.find("rewind")) scene.rewind = rewind->boolean();
        }
        object.finish();
        study.scenes.push_back(std::move(scene));
    }
    root.finish();
    return study;
}

}  // namespace voxspring
