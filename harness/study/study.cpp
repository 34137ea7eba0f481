#include "harness/study/study.h"

#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "backends/suggestion.h"
#include "builtin_study_files.h"  // generated
#include "harness/base/bad_input.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/choice/auto_choice.h"
#include "harness/study/measure.h"
#include "harness/study/selection.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

constexpr int max_repetitions = 10000;

std::vector<std::string> read_patterns(const JsonValue& list) {
    std::vector<std::string> patterns;
    for (const JsonValue& item : list.array(1)) {
        patterns.push_back(item.string());
        try {
            if (asks_for_auto(patterns.back())) {
                check_auto(patterns.back());
            } else if (expand(patterns.back()).empty() && !matches_left_out(patterns.back())) {
                item.refuse(accepted_globs(patterns.back()));
            }
        } catch (const BadSpecification& error) {
            item.refuse(error.what());
        }
    }
    return patterns;
}

int read_count(JsonObject& object, const std::string& key, int max, int otherwise) {
    const auto value = object.find(key);
    return value ? int(value->integer(1, max)) : otherwise;
}

/// The keys of `object` that are not common to all studies.
nlohmann::json keys_of_the_kind(JsonObject object, const std::set<std::string>& common) {
    nlohmann::json settings = nlohmann::json::object();
    for (const auto& [key, value] : object.items()) {
        if (!common.contains(key)) settings[key] = value.raw();
    }
    return settings;
}

/// The path of `scene` if it is a file beside the study file, resized ("my.json@64") or not; else `scene`.
std::string found_beside(const std::filesystem::path& study, const std::string& scene) {
    const std::filesystem::path folder = study.parent_path();
    std::error_code none;  // a name too long for a file is not the name of one
    const bool is_there = std::filesystem::is_regular_file(folder / scene, none) ||
                          std::filesystem::is_regular_file(folder / scene.substr(0, scene.rfind('@')), none);
    return is_there ? (folder / scene).string() : scene;
}

StudyScene read_scene(JsonObject object, const Study& study, const StudyKind& kind) {
    StudyScene item;
    item.scene = kind.read_scene(object);
    item.steps = study.steps;
    // A kind whose list of scenes is not called "scenes" decides by itself how many steps are made.
    if (kind.scenes_key() == "scenes")
        item.steps = read_count(object, "steps", max_steps_in_all, study.steps);
    if (const auto backends = object.find("backends")) item.backends = read_patterns(*backends);
    object.finish();
    item.settings = keys_of_the_kind(std::move(object), {"scene", "steps", "backends"});
    return item;
}

/// Reads a study. Files of scenes are looked for beside `file`, which is empty for a built-in study.
Study read_study(JsonObject root, const std::string& name, const std::filesystem::path& file) {
    Study study;
    study.name = name;
    if (const auto schema = root.find("$schema")) (void)schema->string();
    check_schema_version(root, study_schema_version);
    if (const auto description = root.find("description")) study.description = description->string();
    if (const auto kind = root.find("kind")) study.kind = kind->one_of(study_kind_names());
    const auto kind = make_study_kind(study.kind);
    kind->read(root);
    study.repetitions = read_count(root, "repetitions", max_repetitions, 9);
    study.steps = read_count(root, "steps", max_steps_in_all, 100);
    study.backends = read_patterns(root.require("backends"));
    const std::string key = kind->scenes_key();
    for (const JsonValue& item : root.require(key, "an array of " + key).array(1)) {
        study.scenes.push_back(read_scene(item.object(), study, *kind));
        if (!file.empty()) study.scenes.back().scene = found_beside(file, study.scenes.back().scene);
    }
    root.finish();
    study.settings = keys_of_the_kind(std::move(root), {"$schema", "schema_version", "description", "kind",
                                                        "repetitions", "steps", "backends", key});
    return study;
}

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
    if (const auto builtin = builtin_study_files.find(argument + ".json");
        builtin != builtin_study_files.end())
        return read_study(parse_json(builtin->second, std::string(builtin->first)), argument, {});
    if (path.extension() != ".json") {
        std::vector<std::string> names;
        for (const auto& [file, text] : builtin_study_files)
            names.push_back(std::filesystem::path(file).stem().string());
        throw BadInput("command line", "STUDY", argument,
                       joined(names) + ", or a .json file" + did_you_mean(argument, names));
    }
    return read_study(read_json(path), path.stem().string(), path);
}

}  // namespace voxspring
