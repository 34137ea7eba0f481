// The run of a study: one scene after the other, each of its cases in a process of its own.
#include <algorithm>
#include <ctime>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <thread>
#include <utility>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/executable.h"
#include "harness/base/files.h"
#include "harness/base/interruption.h"
#include "harness/base/progress.h"
#include "harness/base/schema_versions.h"
#include "harness/device/limits.h"
#include "harness/device/noise.h"
#include "harness/process/case.h"
#include "harness/process/journal.h"
#include "harness/process/shared_state.h"
#include "harness/results/capabilities.h"
#include "harness/results/result.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/auto_choice.h"
#include "harness/study/fastest.h"
#include "harness/study/measure.h"
#include "harness/study/pareto.h"
#include "harness/study/selection.h"
#include "harness/study/stability_study.h"
#include "harness/study/stress.h"
#include "harness/study/study.h"
#include "harness/study/suite.h"
#include "harness/verification/reference.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

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

/// The cases of a scene that is not at hand: without what the rules would take.
std::vector<BackendSpec> known_cases(const Study& study, const StudyScene& item,
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
    /// `volume` is of those that are volume files.
    explicit Scenes(VolumeOptions volume) : volume_(std::move(volume)) {}

    std::shared_ptr<const Scene> of(const Study& study, const StudyScene& item) {
        if (study.kind == StudyKind::stress) return std::make_shared<const Scene>(stands_for_all(item));
        if (item.built) return item.built;
        if (const auto known = kept_.find(item.scene); known != kept_.end()) return known->second;
        auto scene = std::make_shared<const Scene>(
            load_scene(item.scene, is_volume_name(item.scene) ? volume_ : VolumeOptions{}));
        if (particles_ + scene->problem.particle_count() <=
            SceneSizeLimits::of_this_machine().particles / 4) {
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

    VolumeOptions volume_;
    std::map<std::string, std::shared_ptr<const Scene>> kept_;
    std::uint64_t particles_ = 0;
};

/// For studies without a row of Google Benchmark.
nlohmann::json plain_context() {
    std::ostringstream date;
    const std::time_t now = std::time(nullptr);
    std::tm parts{};
    date << std::put_time(gmtime_r(&now, &parts), "%FT%T+00:00");
    return {{"date", date.str()}, {"num_cpus", std::thread::hardware_concurrency()}};
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
        const ApiFamily family = capabilities_of(backend).family;
        if (family == ApiFamily::cuda) {
            context["gpu"] = backend.at("device");
            context["driver"] = backend.at("driver");
        } else if (family == ApiFamily::opengl) {
            context["gl_renderer"] = backend.at("device");
            if (context["driver"].is_null()) context["driver"] = backend.at("driver");
        }
    }
}

/// The lists of a result that a study of that kind has beside those of every study.
std::vector<std::string> own_lists(StudyKind kind) {
    switch (kind) {
        case StudyKind::timing:
            break;
        case StudyKind::fastest:
            return {"fastest"};
        case StudyKind::pareto:
            return {"pareto"};
        case StudyKind::stability:
            return {"stability", "stability_map"};
        case StudyKind::stress:
            return {"stress"};
    }
    return {};
}

/// The case NAME/FORMULATION/PRECISION[/TUNING].
BackendSpec spec_of_label(const std::string& label) {
    std::istringstream parts(label);
    std::string name, formulation, precision, tuning;
    std::getline(parts, name, '/');
    std::getline(parts, formulation, '/');
    std::getline(parts, precision, '/');
    std::getline(parts, tuning);
    return BackendSpec::parse(name + ":formulation=" + formulation + ",precision=" + precision +
                              (tuning.empty() ? "" : "," + tuning));
}

/// Whether a scene is of this program rather than of a file, which may change.
bool is_builtin(const std::string& scene) {
    const std::vector<BuiltinScene> all = builtin_scenes();
    const std::string name = scene.substr(0, scene.rfind('@'));
    return !std::filesystem::exists(scene) &&
           std::any_of(all.begin(), all.end(), [&](const auto& builtin) { return builtin.name == name; });
}

/// One run of one study.
class StudyRun {
public:
    StudyRun(Study study, const StudyOptions& options) : study_(std::move(study)), options_(options) {
        if (study_.kind == StudyKind::stress && !options.scenes.empty())
            throw BadInput("command line", "--scene", options.scenes.front(),
                           "none: the suite has its own scenes");
        select_scenes(study_, options.scenes);
        const auto is_volume = [](const StudyScene& item) { return is_volume_name(item.scene); };
        if (options.volume.any() && std::none_of(study_.scenes.begin(), study_.scenes.end(), is_volume))
            throw BadInput("command line", "--labels, --threshold, --spacing or --gravity", study_.name,
                           "a study with a volume file among its scenes: --scene FILE adds one");
        study_.repetitions = options.repetitions.value_or(study_.repetitions);
        if (options.out) check_writable(*options.out, "--out", ".json");
        for (const StudyScene& item : study_.scenes) check(item);
        begin_result();
        if (options.out) open_journal();
        progress_ = std::make_unique<Progress>(scenes_of_progress());
    }

    /// What a scene costs, as far as it is known beforehand: steps of all its particles.
    std::vector<Progress::Scene> scenes_of_progress() {
        constexpr double overhead = 5e5;  // steps of a particle, in the time of what else a batch takes
        std::vector<Progress::Scene> scenes;
        for (const StudyScene& item : study_.scenes) {
            const std::size_t rows = known_cases(study_, item, options_).size();
            double steps = item.steps;
            for (std::size_t i = 1; i < study_.time_steps.size(); ++i)
                steps += item.steps * study_.time_steps[0] / study_.time_steps[i];
            const bool fits = !too_large_.contains(item.scene);
            const double work = fits ? double(rows) * (overhead + particles_.at(item.scene) * steps) : 0;
            scenes.push_back({int(rows), work});
        }
        return scenes;
    }

    /// Of cases: measured, which of a timing study are the verified ones, skipped and failed.
    std::size_t row_count() const {
        std::size_t count = 0;
        for (const char* list : {"verification", "pareto", "stability", "stress", "skipped", "failed"}) {
            if (!result_.contains(list)) continue;
            for (const auto& row : result_.at(list)) count += row.value("passed", true) ? 1 : 0;
        }
        return count;
    }

    nlohmann::json run() {
        const CaughtInterruptions caught(options_.stops_at_once);
        check_devices();
        for (const StudyScene& item : study_.scenes) {
            ++number_;
            progress_->begin(item.scene);
            const std::size_t before = row_count();
            if (const auto refusal = too_large_.find(item.scene); refusal != too_large_.end()) {
                for (const BackendSpec& spec : known_cases(study_, item, options_))
                    put("skipped", row_identity(item.scene, spec), refusal->second);
            } else {
                try {
                    run_scene(item);
                } catch (const Interrupted&) {
                    // While a reference was computed: no case is finished.
                }
            }
            if (interrupted()) break;
            publish();
            progress_->end(int(row_count() - before));
        }
        if (!interrupted()) context_.erase("unfinished");
        publish();
        if (!interrupted()) journal_->remove();
        return std::move(result_);
    }

private:
    /// Every scene is read before the first is timed: a mistake in the last one costs no hour.
    void check(const StudyScene& item) {
        std::shared_ptr<const Scene> loaded;
        try {
            loaded = scenes_.of(study_, item);
        } catch (const TooLarge& refusal) {
            if (!options_.scenes.empty()) throw;
            too_large_[item.scene] = refusal.what();
            return;
        }
        particles_[item.scene] = double(loaded->problem.particle_count());
        if (study_.kind == StudyKind::pareto) check_pareto(*loaded, time_steps_of(item));
        if (!item.rewind && !loaded->edits.empty())
            throw BadInput("study " + study_.name, "rewind of " + item.scene, "false",
                           "true: its edits are made from the start");
        const auto& patterns = patterns_of(item);
        const auto chooses = [](const std::vector<std::string>& asked) {
            for (const std::string& pattern : asked) {
                if (asks_for_auto(pattern)) check_auto(pattern);
            }
            return std::any_of(asked.begin(), asked.end(), asks_for_auto);
        };
        if (chooses(options_.backends) || (chooses(patterns) && options_.backends.empty()) ||
            !known_cases(study_, item, options_).empty())
            return;
        if (!options_.backends.empty())
            throw BadInput("command line", "--backend", options_.backends.front(),
                           accepted_globs(options_.backends.front()));
        throw BadInput("study " + study_.name, "backends of " + item.scene, patterns.front(),
                       accepted_globs(patterns.front()));
    }

    void begin_result() {
        result_["schema_version"] = result_schema_version;
        result_["context"] = plain_context();
        for (const char* list : {"benchmarks", "verification", "skipped", "failed"})
            result_[list] = nlohmann::json::array();
        for (const std::string& list : own_lists(study_.kind)) result_[list] = nlohmann::json::array();
        context_ = build_context();
        context_["gpu"] = context_["driver"] = context_["gl_renderer"] = nullptr;
        context_["study"] = {{"name", study_.name}, {"repetitions", study_.repetitions}};
        context_["backends"] = nlohmann::json::object();
        context_["unfinished"] = true;
    }

    /// What a journal has to be of, to be resumed: all that decides what is measured, but the devices.
    nlohmann::json description() {
        nlohmann::json scenes = nlohmann::json::array(), files = nlohmann::json::object();
        for (const StudyScene& item : study_.scenes) {
            scenes.push_back(
                {item.scene, item.steps, item.backends, item.map, int(item.lengths), item.rewind});
            // What a file holds, or a volume that it names, may have changed since, or what another program
            // built; built-in scenes are of this one.
            const bool may_change = item.built != nullptr || !is_builtin(item.scene);
            if (may_change && !too_large_.contains(item.scene))
                files[item.scene] = fingerprint_of(*scenes_.of(study_, item));
        }
        const nlohmann::json build = build_context();
        return {{"study", study_.name},
                {"kind", int(study_.kind)},
                {"scenes", scenes},
                {"files", files},
                {"backends", study_.backends},
                {"--backend", options_.backends},
                {"repetitions", study_.repetitions},
                {"total_error", study_.total_error},
                {"time_steps", study_.time_steps},
                {"commit", build.at("commit")},
                {"program", fingerprint_of_executable()},
                {"cpu", build.at("cpu")}};
    }

    void open_journal() {
        const std::filesystem::path file = Journal::file_beside(*options_.out);
        std::error_code none;
        if (options_.resume && !std::filesystem::exists(file, none) && is_finished(*options_.out))
            throw BadInput("command line", "--resume", options_.out->string(),
                           "a study that was cut short; this one is finished");
        if (options_.resume && !std::filesystem::exists(file, none))
            std::cerr << "voxspring: there is no " << file.string() << " to resume: the study begins\n";
        journal_ = std::make_unique<Journal>(file, description(), options_.resume);
        if (!journal_->note().empty()) std::cerr << "voxspring: " << journal_->note() << "\n";
        if (journal_->sessions() > 1) context_["study"]["sessions"] = journal_->sessions();
    }

    /// Whether there is a result there, of a study that was not cut short.
    static bool is_finished(const std::filesystem::path& file) {
        std::ifstream text(file);
        const nlohmann::json result = nlohmann::json::parse(text, nullptr, false);
        return result.is_object() && result.contains("context") && result.at("context").is_object() &&
               !is_unfinished(result);
    }

    /// The devices that the journal knows are those of this machine; one backend of each API is asked.
    void check_devices() {
        std::set<std::string> seen;
        const std::string suffix = " introduction";
        journal_->visit([&](const std::string& name, const nlohmann::json& value) {
            if (!name.ends_with(suffix)) return;
            const nlohmann::json& known = value.at("capabilities");
            if (!seen.insert(known.at("api")).second) return;
            const std::size_t begin = name.find(' ') + 1;
            const BackendSpec spec = spec_of_label(name.substr(begin, name.size() - suffix.size() - begin));
            nlohmann::json now;
            const auto look = [](const Backend& backend) { return to_json(backend.capabilities()); };
            if (const auto failure = failure_of([&] { now = look_at(spec, look, options_.timeout); }))
                now = *failure;
            if (now == known) return;
            const Difference other = first_difference(known, now);
            throw BadInput(options_.out->string() + ".journal", other.where + " of " + spec.entry->name,
                           other.there, "what there is here, " + other.here);
        });
    }

    const std::vector<std::string>& patterns_of(const StudyScene& item) const {
        return item.backends.empty() ? study_.backends : item.backends;
    }
    TimeSteps time_steps_of(const StudyScene& item) const {
        return {study_.time_steps, item.steps, study_.repetitions};
    }
    Batch batch_of(const StudyScene& item) const {
        return {.steps = item.steps,
                .repetitions = study_.repetitions,
                .total_error = study_.total_error,
                .rewind = item.rewind};
    }

    void put(const char* list, nlohmann::json row, const std::string& reason) {
        row["reason"] = reason;
        result_[list].push_back(std::move(row));
    }

    /// What a scene has in the journal, whose names say which scene of the study it is: one may be there
    /// twice.
    JournalScope scope_of(const std::string& of) {
        return {*journal_, std::to_string(number_) + " " + of + " "};
    }

    /// `patterns` with what the rules take for `scene` in the place of "auto"; each choice is a row of
    /// `auto`.
    std::vector<std::string> with_choices(std::vector<std::string> patterns, const Scene& scene) {
        for (std::string& pattern : patterns) {
            if (!asks_for_auto(pattern)) continue;
            const Chosen choice = choose_by_rules(pattern, scene, [&](const BackendSpec& spec) {
                const auto accepts = [&](const Backend& backend) -> nlohmann::json {
                    return may_be_chosen(backend) && SceneRunner(scene).unsupported(backend).empty();
                };
                nlohmann::json accepted = false;
                (void)failure_of([&] { accepted = look_at(spec, accepts, options_.timeout); });
                return accepted.get<bool>();
            });
            nlohmann::json row = row_identity(scene.name, choice.spec);
            row["pattern"] = pattern;
            row["reason"] = choice.reason;
            result_["auto"].push_back(std::move(row));
            pattern = choice.spec.text();
        }
        return patterns;
    }

    std::vector<BackendSpec> cases_of(const StudyScene& item, const Scene& scene) {
        return select(expand_all(with_choices(patterns_of(item), scene)),
                      with_choices(options_.backends, scene));
    }

    /// The case, ready to be asked; nothing where it cannot run the scene, which the result then says.
    std::optional<Case> enter(const BackendSpec& spec, const Scene& scene,
                              const MakeCaseRunner& make_runner) {
        const nlohmann::json row = row_identity(scene.name, spec);
        Case benchmark_case(spec, scene, make_runner, scope_of(spec.label()), options_.timeout);
        if (const nlohmann::json* failed = benchmark_case.scope().find("not entered")) {
            put("failed", row, *failed);
            return std::nullopt;
        }
        std::string unavailable, reason;
        const auto failure = failure_of([&] {
            try {
                reason = refusal_of(benchmark_case);
                if (reason.empty()) note_limits(benchmark_case);
            } catch (const Unavailable& absent) {
                unavailable = absent.what();
            }
        });
        // What was there for an earlier scene has been lost since.
        const bool lost = context_["backends"].contains(spec.entry->name);
        if (failure) {
            benchmark_case.scope().keep("not entered", *failure);
            put("failed", row, *failure);
        }
        if (!unavailable.empty()) put(lost ? "failed" : "skipped", row, unavailable);
        if (!reason.empty()) put("skipped", row, reason);
        const bool entered = !failure && unavailable.empty() && reason.empty() && !interrupted();
        return entered ? std::optional(std::move(benchmark_case)) : std::nullopt;
    }

    /// Introduces a case: empty, or why it cannot run the scene.
    std::string refusal_of(Case& benchmark_case) {
        const nlohmann::json introduction = benchmark_case.introduce();
        const nlohmann::json& capabilities = introduction.at("capabilities");
        auto& backends = context_["backends"];
        if (std::string other = other_card(backends, capabilities.at("uuid")); !other.empty()) return other;
        std::string unsupported = introduction.at("unsupported");
        if (unsupported.empty()) {
            backends[benchmark_case.spec().entry->name] = capabilities;
            watch_card(capabilities.at("uuid"));
        }
        return unsupported;
    }

    /// All backends that compute on a card do so on one.
    void watch_card(const std::string& uuid) {
        if (uuid.empty() || context_.contains("card_watched")) return;
        try {
            card_ = std::make_unique<Card>(uuid);
            context_["card_watched"] = "yes";
        } catch (const std::runtime_error& reason) {
            context_["card_watched"] = std::string("not known: ") + reason.what();
        }
    }

    /// What a device can do is measured once, by the first case on it.
    void note_limits(Case& benchmark_case) {
        if (study_.kind != StudyKind::timing && study_.kind != StudyKind::fastest) return;
        const Capabilities capabilities = capabilities_of(benchmark_case.introduce().at("capabilities"));
        benchmark_case.limits = limits_.of(
            capabilities, [&] { return benchmark_case.measure_limits(JournalScope(*journal_, "limits ")); });
    }

    void run_scene(const StudyScene& item) {
        const auto scene = scenes_.of(study_, item);
        SceneResult measured = measure_scene(item, *scene, cases_of(item, *scene));
        if (!measured.context.is_null() && !std::exchange(has_context_, true))
            result_["context"] = measured.context;
        for (auto& [list, rows] : measured.lists) {
            for (auto& row : rows) result_[list].push_back(std::move(row));
        }
    }

    /// What one scene of the study gives, by the study's kind.
    SceneResult measure_scene(const StudyScene& item, const Scene& scene,
                              const std::vector<BackendSpec>& specs) {
        switch (study_.kind) {
            case StudyKind::timing:
            case StudyKind::fastest: {
                SharedState state(scene.problem.particle_count());
                auto cases = enter_all(specs, scene, timing_runner(scene, batch_of(item), state));
                if (cases.empty()) return {};
                return measure(scene, cases, batch_of(item), state, references_, card_.get(),
                               shows_progress());
            }
            case StudyKind::pareto: {
                SharedState state(scene.problem.particle_count());
                auto cases = enter_all(specs, scene, pareto_runner(scene, time_steps_of(item), state));
                if (cases.empty()) return {};
                return measure_pareto(scene, cases, time_steps_of(item), state, references_,
                                      shows_progress());
            }
            case StudyKind::stability:
                return measure_stability(item, scene, specs);
            case StudyKind::stress:
                break;
        }
        return measure_stress(item, scene, specs);
    }

    std::vector<Case> enter_all(const std::vector<BackendSpec>& specs, const Scene& scene,
                                const MakeCaseRunner& make_runner) {
        std::vector<Case> cases;
        for (const BackendSpec& spec : specs) {
            progress_->show(spec.label(), 0, int(specs.size()));
            if (auto benchmark_case = enter(spec, scene, make_runner))
                cases.push_back(*std::move(benchmark_case));
        }
        return cases;
    }

    SceneResult measure_stability(const StudyScene& item, const Scene& scene,
                                  const std::vector<BackendSpec>& specs) {
        StabilityStudy stability(scene);
        bool map = item.map;  // of the first
        SceneResult result;
        for (const BackendSpec& spec : specs) {
            const MakeCaseRunner make_runner =
                suite_runner([&stability, map](const BackendSpec& of, Backend& backend, const Once& once,
                                               const OnEvent&) { stability.run(of, backend, map, once); });
            auto benchmark_case = enter(spec, scene, make_runner);
            if (!benchmark_case) continue;
            if (stability.empty()) {
                put("skipped", row_identity(scene.name, spec),
                    "nothing oscillates, or how fast is not known");
                continue;
            }
            map = false;
            add(result, measure_suite(*benchmark_case, scene.name, shows_measurement(specs, spec)));
        }
        return result;
    }

    /// One case after the other: what one computes of references, the next ones have.
    SceneResult measure_stress(const StudyScene& item, const Scene& scene,
                               const std::vector<BackendSpec>& specs) {
        const MakeCaseRunner make_runner = suite_runner(
            [&](const BackendSpec& of, Backend& backend, const Once& once, const OnEvent& on_event) {
                stress_references_.report_to(on_event);
                run_stress(of, backend, item.lengths, stress_references_, once);
            });
        SceneResult result;
        for (const BackendSpec& spec : specs) {
            auto benchmark_case = enter(spec, scene, make_runner);
            if (!benchmark_case) continue;
            add(result, measure_suite(*benchmark_case, scene.name, shows_measurement(specs, spec),
                                      [&](const auto& event) { stress_references_.take(event); }));
        }
        return result;
    }

    static void add(SceneResult& result, const Rows& rows) {
        for (const auto& [list, more] : rows)
            result.lists[list].insert(result.lists[list].end(), more.begin(), more.end());
    }

    OnRepetition shows_progress() {
        return [this](const std::string& label, int begun, int total) {
            progress_->show(label, std::max(0, begun - 1), total);
        };
    }
    std::function<void(const std::string&)> shows_measurement(const std::vector<BackendSpec>& specs,
                                                              const BackendSpec& spec) {
        const int done = int(&spec - specs.data()), total = int(specs.size());
        return [this, label = spec.label(), done, total](const std::string& name) {
            progress_->show(label + " " + name, done, total);
        };
    }

    void publish() {
        note_devices(context_);
        context_["limits"] = limits_.json();
        result_["context"]["voxspring"] = context_;
        if (study_.kind == StudyKind::fastest) result_["fastest"] = fastest_of(result_, study_.targets);
        if (options_.out) write_atomically(*options_.out, result_.dump(2) + "\n");
    }

    Study study_;
    const StudyOptions& options_;
    Scenes scenes_{options_.volume};
    std::map<std::string, std::string> too_large_;  ///< scene to reason
    nlohmann::json result_, context_;
    bool has_context_ = false;  ///< of Google Benchmark
    std::unique_ptr<Journal> journal_ = std::make_unique<Journal>();
    MeasuredLimits limits_;
    std::unique_ptr<Card> card_;  ///< null: there is none, or it cannot be watched
    References references_{DiskCache{}, [this](int done, int steps) {
                               if (interrupted()) throw Interrupted();
                               progress_->show("float64 reference, " + std::to_string(done) + " of " +
                                                   std::to_string(steps) + " steps",
                                               0, 1);
                           }};
    StressReferences stress_references_;
    std::map<std::string, double> particles_;  ///< of each scene that fits
    std::unique_ptr<Progress> progress_;
    std::size_t number_ = 0;  ///< of the scene, from 1
};

}  // namespace

bool is_unfinished(const nlohmann::json& result) {
    return result.at("context").value("voxspring", nlohmann::json::object()).contains("unfinished");
}

nlohmann::json run_study(Study study, const StudyOptions& options) {
    return StudyRun(std::move(study), options).run();
}

}  // namespace voxspring
