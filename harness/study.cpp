#include "harness/study.h"

#include <fnmatch.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <thread>
#include <utility>

#include "backends/registry.h"
#include "builtin_study_files.h"  // generated
#include "harness/auto_choice.h"
#include "harness/bad_input.h"
#include "harness/json.h"
#include "harness/limits.h"
#include "harness/measure.h"
#include "harness/pareto.h"
#include "harness/playback.h"
#include "harness/reference.h"
#include "harness/result.h"
#include "harness/scene.h"
#include "harness/schema_versions.h"
#include "harness/stability_study.h"
#include "harness/stress.h"

namespace voxspring {
namespace {

bool matches(const std::string& glob, const std::string& text) {
    return fnmatch(glob.c_str(), text.c_str(), 0) == 0;
}

/// `options` with each value that `entry` has in the place of formulation=* and precision=*.
std::vector<std::string> each_of(const BackendEntry& entry, const std::string& options) {
    std::vector<std::string> all = {options};
    const auto replace = [&](const std::string& key, const auto& values) {
        std::vector<std::string> replaced;
        for (const std::string& one : all) {
            const auto at = one.find(key + "=*");
            if (at == std::string::npos) {
                replaced.push_back(one);
                continue;
            }
            for (const auto value : values) {
                replaced.push_back(one);
                replaced.back().replace(at + key.size() + 1, 1, to_string(value));
            }
        }
        all = std::move(replaced);
    };
    replace("formulation", entry.formulations);
    replace("precision", entry.precisions);
    return all;
}

/// The specifications that a pattern GLOB[:options] stands for, in the registry's order: those that take the
/// options. Throws BadSpecification if there are some and none does.
std::vector<BackendSpec> expand(const std::string& pattern) {
    const auto colon = pattern.find(':');
    const std::string glob = pattern.substr(0, colon);
    const std::string options = colon == std::string::npos ? "" : pattern.substr(colon);
    std::vector<BackendSpec> specs;
    std::optional<BadSpecification> refusal;
    for (const auto& [name, entry] : registry()) {
        if (!matches(glob, name)) continue;
        try {
            for (const std::string& one : each_of(entry, options))
                specs.push_back(BackendSpec::parse(name + one));
        } catch (const BadSpecification& error) {
            if (!refusal) refusal = error;
        }
    }
    if (specs.empty() && refusal) throw BadSpecification(*refusal);
    return specs;
}

bool matches_left_out(const std::string& pattern) {
    const std::string glob = pattern.substr(0, pattern.find(':'));
    return std::any_of(left_out().begin(), left_out().end(),
                       [&](const auto& backend) { return matches(glob, backend.first); });
}

/// All of `patterns` without repetition. A study may name backends that this build left out.
std::vector<BackendSpec> expand_all(const std::vector<std::string>& patterns) {
    std::vector<BackendSpec> specs;
    std::set<std::string> seen;
    for (const std::string& pattern : patterns) {
        for (BackendSpec& spec : expand(pattern)) {
            if (seen.insert(spec.label()).second) specs.push_back(std::move(spec));
        }
    }
    return specs;
}

/// What the command line's --backend leaves of a scene's contenders, and what it adds to them.
std::vector<BackendSpec> select(std::vector<BackendSpec> specs, const std::vector<std::string>& globs) {
    if (globs.empty()) return specs;
    std::vector<BackendSpec> kept;
    for (const std::string& glob : globs) {
        const auto wanted = [&](const BackendSpec& spec) {
            return matches(glob, spec.entry->name) || matches(glob, spec.label());
        };
        std::vector<BackendSpec> found;
        std::copy_if(specs.begin(), specs.end(), std::back_inserter(found), wanted);
        if (found.empty()) found = expand(glob);
        for (BackendSpec& spec : found) {
            const std::string label = spec.label();
            if (std::none_of(kept.begin(), kept.end(), [&](const auto& k) { return k.label() == label; })) {
                kept.push_back(std::move(spec));
            }
        }
    }
    return kept;
}

/// `patterns` with what the rules take for `scene` in the place of "auto". Adds each choice to `choices`.
std::vector<std::string> with_choices(std::vector<std::string> patterns, const Scene& scene,
                                      nlohmann::json& choices) {
    for (std::string& pattern : patterns) {
        if (!asks_for_auto(pattern)) continue;
        Playback playback(scene);
        const AutoChoice choice = choose_backend(
            pattern, scene, [&](const Backend& backend) { return playback.unsupported(backend).empty(); });
        nlohmann::json row = row_identity(scene.name, choice.spec);
        row["pattern"] = pattern;
        row["reason"] = choice.reason;
        choices.push_back(std::move(row));
        pattern = choice.spec.text();
    }
    return patterns;
}

std::vector<BackendSpec> contenders_of(const Study& study, const StudyScene& item, const Scene& scene,
                                       const StudyOptions& options, nlohmann::json& choices) {
    const auto& patterns = item.backends.empty() ? study.backends : item.backends;
    return select(expand_all(with_choices(patterns, scene, choices)),
                  with_choices(options.backends, scene, choices));
}

/// What --scene leaves of the study's scenes, and what it adds to them.
void select_scenes(Study& study, const std::vector<std::string>& globs) {
    if (globs.empty()) return;
    std::vector<StudyScene> kept;
    for (const std::string& glob : globs) {
        const auto before = kept.size();
        for (const StudyScene& scene : study.scenes) {
            if (matches(glob, scene.scene)) kept.push_back(scene);
        }
        if (kept.size() == before) kept.push_back({glob, study.steps, {}});
    }
    study.scenes = std::move(kept);
}

std::string registered_names() {
    std::string names;
    for (const auto& [name, entry] : registry()) names += (names.empty() ? "" : ", ") + name;
    return names;
}

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

/// The contenders of a scene that is not at hand: without what the rules would take.
std::vector<BackendSpec> known_contenders(const Study& study, const StudyScene& item,
                                          const StudyOptions& options) {
    const auto known = [](std::vector<std::string> patterns) {
        patterns.erase(std::remove_if(patterns.begin(), patterns.end(), asks_for_auto), patterns.end());
        return patterns;
    };
    return select(expand_all(known(item.backends.empty() ? study.backends : item.backends)),
                  known(options.backends));
}

/// The scenes of a study, which are kept, up to a quarter of the machine's memory, as each is asked for
/// twice.
class Scenes {
public:
    std::shared_ptr<const Scene> of(const Study& study, const StudyScene& item) {
        if (study.kind == StudyKind::stress) return std::make_shared<const Scene>(stands_for_all(item));
        if (item.built) return item.built;
        if (const auto known = kept_.find(item.scene); known != kept_.end()) return known->second;
        auto scene = std::make_shared<const Scene>(load_scene(item.scene));
        if (particles_ + scene->problem.particle_count() <= Limits::of_this_machine().particles / 4) {
            particles_ += scene->problem.particle_count();
            kept_[item.scene] = scene;
        }
        return scene;
    }

private:
    /// A stress study brings its own scenes: what stands for them is one that every backend takes.
    static Scene stands_for_all(const StudyScene& item) {
        Scene scene = load_scene("box@2");
        scene.name = item.scene;
        return scene;
    }

    std::map<std::string, std::shared_ptr<const Scene>> kept_;
    std::uint64_t particles_ = 0;
};

/// float64 that errors are taken against, each computed once.
struct AllReferences {
    References of_scenes;
    StressReferences of_suites;
};

/// What one scene of the study gives, by the study's kind.
SceneResult measure_scene(const Study& study, const StudyScene& item, const Scene& scene,
                          std::vector<Contender>& contenders, AllReferences& references,
                          const OnRepetition& on_repetition) {
    if (contenders.empty()) return {};
    switch (study.kind) {
        case StudyKind::timing:
        case StudyKind::fastest:
            return measure(scene, contenders,
                           {.steps = item.steps,
                            .repetitions = study.repetitions,
                            .total_error = study.total_error,
                            .rewind = item.rewind},
                           references.of_scenes, on_repetition);
        case StudyKind::pareto:
            return measure_pareto(scene, contenders, {study.time_steps, item.steps, study.repetitions},
                                  references.of_scenes, on_repetition);
        case StudyKind::stability:
            return {nullptr, measure_stability(scene, item.map, contenders, on_repetition)};
        case StudyKind::stress:
            break;
    }
    SceneResult result;
    int begun = 0;
    for (Contender& contender : contenders) {
        ++begun;
        const auto show = [&](const std::string& name) {
            on_repetition(contender.spec.label() + " " + name, begun, int(contenders.size()));
        };
        for (auto& [list, rows] : run_stress(contender, item.lengths, references.of_suites, show)) {
            for (auto& row : rows) result.lists[list].push_back(std::move(row));
        }
    }
    return result;
}

/// For studies without a row of Google Benchmark.
nlohmann::json plain_context() {
    std::ostringstream date;
    const std::time_t now = std::time(nullptr);
    std::tm parts{};
    date << std::put_time(gmtime_r(&now, &parts), "%FT%T+00:00");
    return {{"date", date.str()}, {"num_cpus", std::thread::hardware_concurrency()}};
}

constexpr int most_steps = 1000000000;
constexpr int most_repetitions = 10000;

/// One line on a terminal that is overwritten; nothing in a pipe.
class Progress {
public:
    ~Progress() { clear(); }
    void show(const std::string& text) {
        if (terminal_) std::cerr << "\r\x1b[K" << text << std::flush;
    }
    void clear() { show(""); }

private:
    bool terminal_ = isatty(STDERR_FILENO) != 0;
};

nlohmann::json describe(const Capabilities& capabilities) {
    return {{"api", capabilities.api},
            {"device", capabilities.device},
            {"driver", capabilities.driver},
            {"uuid", capabilities.uuid},
            {"clock", capabilities.clock},
            {"deterministic", capabilities.deterministic},
            {"highest_mhz", capabilities.highest_mhz}};
}

/// Empty, or why a backend on the card `uuid` is not for a table of `backends`, which describe() wrote.
std::string other_card(const nlohmann::json& backends, const std::string& uuid) {
    for (const auto& [name, backend] : backends.items()) {
        const std::string card = backend.at("uuid");
        if (uuid.empty() || card.empty() || card == uuid) continue;
        return "is on " + uuid + ", " + name + " on " + card + ": two cards are not compared as one";
    }
    return {};
}

/// The GPU and GL renderer that any row of this study ran on.
void note_devices(nlohmann::json& context) {
    for (const auto& [name, backend] : context.at("backends").items()) {
        const std::string api = backend.at("api");
        if (api.starts_with("CUDA")) {
            context["gpu"] = backend.at("device");
            context["driver"] = backend.at("driver");
        } else if (api.starts_with("OpenGL")) {
            context["gl_renderer"] = backend.at("device");
            if (context["driver"].is_null()) context["driver"] = backend.at("driver");
        }
    }
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
    const auto builtin = builtin_study_files.find(argument + ".json");
    if (builtin == builtin_study_files.end() && path.extension() != ".json") {
        std::string known;
        for (const auto& [file, text] : builtin_study_files)
            known += std::filesystem::path(file).stem().string() + ", ";
        throw BadInput("command line", "STUDY", argument, known + "or a .json file");
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
        // A file that the study names is found beside the study, wherever the study is run from.
        const auto beside = path.parent_path() / scene.scene;
        if (builtin == builtin_study_files.end() && std::filesystem::is_regular_file(beside)) {
            scene.scene = beside.string();
        }
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

nlohmann::json run_study(Study study, const StudyOptions& options) {
    if (study.kind == StudyKind::stress && !options.scenes.empty())
        throw BadInput("command line", "--scene", options.scenes.front(),
                       "none: the suite has its own scenes");
    select_scenes(study, options.scenes);
    study.repetitions = options.repetitions.value_or(study.repetitions);
    if (options.out) check_writable(*options.out, "--out", ".json");
    // Every scene is read before the first is timed: a mistake in the last one costs no hour.
    Scenes scenes;
    std::map<std::string, std::string> too_large;
    for (const StudyScene& scene : study.scenes) {
        std::shared_ptr<const Scene> loaded;
        try {
            loaded = scenes.of(study, scene);
        } catch (const TooLarge& refusal) {
            if (!options.scenes.empty()) throw;
            too_large[scene.scene] = refusal.what();
            continue;
        }
        if (study.kind == StudyKind::pareto)
            check_pareto(*loaded, {study.time_steps, scene.steps, study.repetitions});
        if (!scene.rewind && !loaded->edits.empty())
            throw BadInput("study " + study.name, "rewind of " + scene.scene, "false",
                           "true: its edits are made from the start");
        nlohmann::json ignored;
        if (contenders_of(study, scene, *loaded, options, ignored).empty()) {
            const std::string known = "a glob that matches one of: " + registered_names();
            if (!options.backends.empty())
                throw BadInput("command line", "--backend", options.backends.front(), known);
            const auto& patterns = scene.backends.empty() ? study.backends : scene.backends;
            throw BadInput("study " + study.name, "backends of " + scene.scene, patterns.front(), known);
        }
    }

    nlohmann::json result = {
        {"schema_version", result_schema_version}, {"context", plain_context()},
        {"benchmarks", nlohmann::json::array()},   {"verification", nlohmann::json::array()},
        {"skipped", nlohmann::json::array()},      {"failed", nlohmann::json::array()}};
    switch (study.kind) {
        case StudyKind::timing:
            break;
        case StudyKind::fastest:
            result["fastest"] = nlohmann::json::array();
            break;
        case StudyKind::pareto:
            result["pareto"] = nlohmann::json::array();
            break;
        case StudyKind::stability:
            result["stability"] = result["stability_map"] = nlohmann::json::array();
            break;
        case StudyKind::stress:
            result["stress"] = nlohmann::json::array();
            break;
    }
    nlohmann::json context = build_context();
    context["gpu"] = context["driver"] = context["gl_renderer"] = nullptr;
    context["study"] = {{"name", study.name}, {"repetitions", study.repetitions}};
    context["backends"] = nlohmann::json::object();

    Progress progress;
    MeasuredLimits limits;
    AllReferences references;
    bool has_context = false;
    std::size_t number = 0;
    const auto publish = [&] {
        note_devices(context);
        context["limits"] = limits.json();
        result["context"]["voxspring"] = context;
        if (study.kind == StudyKind::fastest) result["fastest"] = fastest_of(result, study.targets);
        if (options.out) write_atomically(*options.out, result.dump(2) + "\n");
    };
    for (const StudyScene& item : study.scenes) {
        ++number;
        if (const auto refusal = too_large.find(item.scene); refusal != too_large.end()) {
            for (const BackendSpec& spec : known_contenders(study, item, options)) {
                result["skipped"].push_back(row_identity(item.scene, spec));
                result["skipped"].back()["reason"] = refusal->second;
            }
            publish();
            continue;
        }
        const auto loaded = scenes.of(study, item);
        const Scene& scene = *loaded;
        nlohmann::json choices = nlohmann::json::array();
        const auto specs = contenders_of(study, item, scene, options, choices);
        for (auto& choice : choices) result["auto"].push_back(std::move(choice));
        const std::string heading = "[" + std::to_string(number) + "/" + std::to_string(study.scenes.size()) +
                                    "] " + scene.name + " ";

        Playback playback(scene);
        std::vector<Contender> contenders;
        for (const BackendSpec& spec : specs) {
            progress.show(heading + spec.label());
            nlohmann::json row = row_identity(scene.name, spec);
            try {
                const auto begin = std::chrono::steady_clock::now();
                auto backend = spec.make();
                const std::chrono::duration<double> construction = std::chrono::steady_clock::now() - begin;
                const Capabilities capabilities = backend->capabilities();
                row["reason"] = other_card(context["backends"], capabilities.uuid);
                if (row["reason"] == "") row["reason"] = playback.unsupported(*backend);
                if (row["reason"] == "") {
                    context["backends"][spec.entry->name] = describe(capabilities);
                    std::optional<DeviceLimits> device_limits;
                    if (study.kind == StudyKind::timing || study.kind == StudyKind::fastest)
                        device_limits = limits.of(spec, capabilities);
                    contenders.push_back({spec, std::move(backend), device_limits, construction.count()});
                } else {
                    result["skipped"].push_back(row);
                }
            } catch (const Unavailable& absent) {
                row["reason"] = absent.what();
                // What was there for an earlier scene has been lost since.
                const bool lost = context["backends"].contains(spec.entry->name);
                result[lost ? "failed" : "skipped"].push_back(row);
            } catch (const std::exception& error) {
                row["reason"] = error.what();
                result["failed"].push_back(row);
            }
        }
        SceneResult measured = measure_scene(
            study, item, scene, contenders, references, [&](const auto& label, int begun, int total) {
                progress.show(heading + std::to_string(begun) + "/" + std::to_string(total) + " " + label);
            });
        if (!measured.context.is_null() && !std::exchange(has_context, true))
            result["context"] = measured.context;
        for (auto& [list, rows] : measured.lists) {
            for (auto& row : rows) result[list].push_back(std::move(row));
        }
        publish();
    }
    return result;
}

}  // namespace voxspring
