// The run of a study: one scene after the other, with its cases in other processes.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/files.h"
#include "harness/base/interruption.h"
#include "harness/base/json.h"
#include "harness/base/progress.h"
#include "harness/choice/auto_choice.h"
#include "harness/process/case.h"
#include "harness/process/journal.h"
#include "harness/ranks/rank_run.h"
#include "harness/results/capabilities.h"
#include "harness/results/google_benchmark.h"
#include "harness/results/result.h"
#include "harness/scene/scene.h"
#include "harness/study/selection.h"
#include "harness/study/study.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/reference.h"
#include "harness/volume/dataset.h"
#include "harness/volume/volume.h"

namespace voxspring {
namespace {

/// Whether the list of this name holds measurements, or a summary of them.
bool is_measured(const std::string& list) { return list != "skipped" && list != "failed" && list != "auto"; }

/// The backend of a label NAME/FORMULATION/PRECISION[/TUNING].
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

/// Whether a scene is built into this program, and not in a file, which may change.
bool is_builtin(const std::string& scene) {
    const std::vector<Named> all = builtin_scenes();
    const std::string name = scene.substr(0, scene.rfind('@'));
    return !std::filesystem::exists(scene) &&
           std::any_of(all.begin(), all.end(), [&](const auto& builtin) { return builtin.name == name; });
}

/// Whether `file` is the result of a study that was not interrupted.
bool is_finished(const std::filesystem::path& file) {
    std::stringstream text;
    text << std::ifstream(file).rdbuf();
    try {
        const nlohmann::json context = parsed_json(text.str()).at("context");
        return !context.value("voxspring", nlohmann::json::object()).contains("unfinished");
    } catch (const nlohmann::json::exception&) {
        return false;
    }
}

/// The study after the command line's options have been applied.
Study narrowed(Study study, const StudyOptions& options) {
    select_scenes(study, options.scenes);
    const std::vector<std::string> without_effect = globs_without_effect(study, options.backends);
    if (const auto without = select_backends(study, options.backends); !without.empty())
        std::cerr << fmt::format("voxspring: --backend leaves these scenes without a backend: {}\n",
                                 fmt::join(without, ", "));
    for (const std::string& glob : without_effect)
        std::cerr << "voxspring: --backend " << glob
                  << " leaves nothing out: no backend of the study matches\n";
    study.repetitions = options.repetitions.value_or(study.repetitions);
    return study;
}

/// Loads scenes and keeps them, since each is needed twice: to check the study, and to run it. The scenes
/// kept together have up to a quarter of the particles that this machine's memory can hold. A scene with more
/// is not kept. If all others together have more, the smallest are dropped, which take the least time to
/// build.
class StudyScenes {
public:
    /// `volume` has the options for scenes that are volume files or meshes.
    StudyScenes(const StudyKind& kind, VolumeOptions volume) : kind_(kind), volume_(std::move(volume)) {}

    /// The scene of an item. Throws BadInput, TooLarge.
    std::shared_ptr<const Scene> of(const StudyScene& item);
    /// Refuses `scene`, the scene of `item`, if a different scene has the same name, since results identify
    /// scenes by name.
    void check_name(const StudyScene& item, const Scene& scene);

private:
    void keep(const std::string& name, const std::shared_ptr<const Scene>& scene);

    const StudyKind& kind_;
    const VolumeOptions volume_;
    std::map<std::string, std::shared_ptr<const Scene>> kept_;
    std::uint64_t particles_ = 0;
    std::map<std::string, const StudyScene*> named_;  ///< the first item of each name
};

std::shared_ptr<const Scene> StudyScenes::of(const StudyScene& item) {
    if (auto own = kind_.own_scene(item)) return own;
    const std::string name = item.scene + (item.is_strained() ? ", strained" : "");
    if (const auto known = kept_.find(name); known != kept_.end()) return known->second;
    if (item.built && !item.is_strained()) return item.built;
    Scene scene = item.built ? *item.built
                             : load_scene(item.scene, is_body_file(item.scene) ? volume_ : VolumeOptions{});
    if (item.is_strained()) scene.state = strained_start(scene.problem);
    auto shared = std::make_shared<const Scene>(std::move(scene));
    if (!item.built) keep(name, shared);
    return shared;
}

void StudyScenes::keep(const std::string& name, const std::shared_ptr<const Scene>& scene) {
    const std::uint64_t most = SceneSizeLimits::of_this_machine().particles / 4;
    if (scene->problem.particle_count() > most) return;
    kept_[name] = scene;
    particles_ += scene->problem.particle_count();
    while (particles_ > most) {
        const auto smallest = std::min_element(kept_.begin(), kept_.end(), [](const auto& a, const auto& b) {
            return a.second->problem.particle_count() < b.second->problem.particle_count();
        });
        particles_ -= smallest->second->problem.particle_count();
        kept_.erase(smallest);
    }
}

void StudyScenes::check_name(const StudyScene& item, const Scene& scene) {
    const auto [first, added] = named_.emplace(scene.name, &item);
    const StudyScene& other = *first->second;
    const bool same = other.scene == item.scene && other.built == item.built;
    if (added || (same && other.is_strained() == item.is_strained())) return;
    if (same)
        throw BadInput("study", std::string(StudyScene::strained_key) + " of " + scene.name,
                       item.is_strained() ? "true" : "false",
                       "the value that the study's other item of this scene has: otherwise the rows of the "
                       "two could not be told apart");
    if (fingerprint_of(*of(other)) == fingerprint_of(scene)) return;
    throw BadInput("study", "scene", item.scene,
                   "a scene with a name that no other has: " + other.scene + " is called " + scene.name +
                       " as well, and their rows could not be told apart; rename the file");
}

/// Checks options set by a program that calls run_study(). The command line has checked its options already.
void check_options(const StudyOptions& options) {
    const auto check = [](bool accepted, const char* name, const std::string& value, const char* expected) {
        if (!accepted) throw BadInput("run_study()", name, value, expected);
    };
    const auto check_count = [&](const std::optional<int>& count, const char* name) {
        if (count) check(*count >= 1, name, std::to_string(*count), "1 or more");
    };
    check_count(options.together, "together");
    check_count(options.side_by_side, "side_by_side");
    check_count(options.repetitions, "repetitions");
    check_count(options.ranks, "ranks");
    for (const int device : options.devices)
        check(device >= 0, "devices", std::to_string(device), "numbers of devices, 0 or more");
    check(options.timeout.count() > 0, "timeout", fmt::format("{} s", options.timeout.count()),
          "more than 0 s");
}

/// One run of one study.
class StudyRun {
public:
    StudyRun(Study study, const StudyOptions& options);
    Result run();

private:
    void check(const StudyScene& item);
    void check_backends(const StudyScene& item) const;
    void begin_result();
    nlohmann::json description();
    void open_journal();
    void check_devices();
    Progress::Scene cost_of(const StudyScene& item) const;
    void run_scene(const StudyScene& item, std::size_t number);
    std::size_t row_count() const;
    void publish();
    nlohmann::json& context() { return result_.own_context(); }

    const Study study_;
    const StudyOptions& options_;
    const std::unique_ptr<StudyKind> kind_;
    StudyScenes scenes_;
    std::map<std::string, std::string> too_large_;  ///< why a scene is too large; key: StudyScene::scene
    std::map<std::string, double> particles_;       ///< number of particles of a scene that fits; same key
    Result result_;
    std::unique_ptr<Journal> journal_ = std::make_unique<Journal>();
    std::unique_ptr<Progress> progress_;
    std::unique_ptr<StudyBench> bench_;
};

StudyRun::StudyRun(Study study, const StudyOptions& options)
    : study_(narrowed(std::move(study), options)),
      options_(options),
      kind_(kind_of(study_)),
      scenes_(*kind_, options.volume) {
    if (kind_->scenes_key() != "scenes" && !options.scenes.empty())
        throw BadInput("command line", "--scene", options.scenes.front(),
                       "no --scene: a study of this kind has its own scenes");
    const auto is_body = [](const StudyScene& item) { return is_body_file(item.scene); };
    if (options.volume.any() && std::none_of(study_.scenes.begin(), study_.scenes.end(), is_body))
        throw BadInput("command line", "study", study_.name,
                       "a study that has a volume file or a mesh, with" + options.volume.text() +
                           ": --scene FILE adds one");
    const auto only_scaling = [&](bool given, const char* name, const std::string& value) {
        if (given && study_.kind != "scaling")
            throw BadInput("command line", name, value,
                           "none: study " + study_.name + " is not of the kind scaling");
    };
    only_scaling(options.mpi != nullptr, "mpirun", "several ranks");
    only_scaling(options.ranks.has_value(), "--ranks", std::to_string(options.ranks.value_or(0)));
    only_scaling(!options.devices.empty(), "--devices", fmt::format("{}", fmt::join(options.devices, ",")));
    if (options.out) check_writable(*options.out, "--out", ".json");
    Activity reading;
    for (const StudyScene& item : study_.scenes) {
        reading.begin("reading " + item.scene);
        check(item);
    }
    reading.end();
    begin_result();
    if (options.out) open_journal();
    std::vector<Progress::Scene> costs;
    for (const StudyScene& item : study_.scenes) costs.push_back(cost_of(item));
    progress_ = std::make_unique<Progress>(std::move(costs));
    bench_ = std::make_unique<StudyBench>(study_, options_, *journal_, *progress_, *kind_, result_);
}

/// Every scene is loaded before the first one is timed, so that a mistake in the last one shows at once and
/// not after hours.
void StudyRun::check(const StudyScene& item) {
    std::shared_ptr<const Scene> loaded;
    try {
        loaded = scenes_.of(item);
    } catch (const TooLarge& refusal) {
        if (!options_.scenes.empty()) throw;
        too_large_[item.scene] = refusal.what();
        // A backend that is not known yet has no row to say so.
        if (known_specs(study_, item).empty())
            std::cerr << "voxspring: a scene is left out: " << refusal.what() << "\n";
        return;
    }
    scenes_.check_name(item, *loaded);
    const double particles = double(loaded->problem.particle_count());
    const bool is_new = particles_.emplace(item.scene, particles).second;
    if (is_new) say_notes(*loaded);
    kind_->check(study_, item, *loaded);
    check_backends(item);
}

/// Throws BadInput if there is no backend to run on the scene, as far as is known without a device.
void StudyRun::check_backends(const StudyScene& item) const {
    const auto check_each = [](const std::vector<std::string>& asked) {
        for (const std::string& pattern : asked) {
            if (asks_for_auto(pattern)) check_auto(pattern);
        }
    };
    check_each(item.only);
    check_each(patterns_of(study_, item));
    if (has_backends(study_, item)) return;
    throw BadInput("study " + study_.name, "backends of " + item.scene, patterns_of(study_, item).front(),
                   accepted_globs(patterns_of(study_, item).front()));
}

/// The cost of a scene in particle steps, as far as is known beforehand.
Progress::Scene StudyRun::cost_of(const StudyScene& item) const {
    constexpr double overhead = 5e6;  // time of a case outside its steps, in particle steps
    if (too_large_.contains(item.scene)) return {};
    const double steps = kind_->steps_of_case(study_, item);
    return {.cases = int(known_specs(study_, item).size()),
            .rows_per_case = kind_->rows_of_case(study_, item),
            .work_per_case = overhead + particles_.at(item.scene) * steps};
}

void StudyRun::begin_result() {
    const nlohmann::json machine = google_benchmark_context();
    result_.context = {{"date", machine.at("date")}, {"num_cpus", machine.at("num_cpus")}};
    kind_->make_lists(result_);
    context() = build_context();
    context()["gpu"] = context()["driver"] = context()["gl_renderer"] = nullptr;
    context()["study"] = {{"name", study_.name}, {"kind", study_.kind}, {"repetitions", study_.repetitions}};
    std::set<std::string> strained;  // names of scenes; a set, since several items may have the same scene
    for (const StudyScene& item : study_.scenes) {
        if (item.is_strained()) strained.insert(item.scene);
    }
    if (!strained.empty()) context()["study"]["strained_starts"] = strained;
    context()["backends"] = nlohmann::json::object();
    context()["unfinished"] = true;
}

/// The description that a journal must match to be resumed: everything that decides what is measured, except
/// the devices and the number of ranks that mpirun starts.
nlohmann::json StudyRun::description() {
    nlohmann::json scenes = nlohmann::json::array(), files = nlohmann::json::object();
    for (const StudyScene& item : study_.scenes) {
        scenes.push_back({item.scene, item.steps, item.backends, item.settings});
        // Scene files, the volumes that they name and scenes built by another program may have changed since
        // the journal was written. Built-in scenes belong to this program, whose fingerprint is compared
        // anyway.
        const bool may_change = item.built != nullptr || !is_builtin(item.scene);
        if (may_change && !too_large_.contains(item.scene))
            files[item.scene] = fingerprint_of(*scenes_.of(item));
    }
    const nlohmann::json build = build_context();
    return {{"study", study_.name},
            {"kind", study_.kind},
            {"scenes", scenes},
            {"files", files},
            {"backends", study_.backends},
            {"--backend", options_.backends},
            {"repetitions", study_.repetitions},
            {"--ranks", options_.ranks.value_or(0)},
            {"--devices", options_.devices},
            {"settings", study_.settings},
            {"commit", build.at("commit")},
            {"program", fingerprint_of_code()},
            {"cpu", build.at("cpu")}};
}

void StudyRun::open_journal() {
    const std::filesystem::path file = Journal::file_beside(*options_.out);
    std::error_code none;
    if (options_.resume && !std::filesystem::exists(file, none) && is_finished(*options_.out))
        throw BadInput("command line", "--resume", options_.out->string(),
                       "a study that was cut short; this one is finished");
    if (options_.resume && !std::filesystem::exists(file, none))
        std::cerr << "voxspring: there is no " << file.string()
                  << " to resume: the study starts from the beginning\n";
    journal_ = std::make_unique<Journal>(file, description(), options_.resume);
    if (!journal_->note().empty()) std::cerr << "voxspring: " << journal_->note() << "\n";
    if (journal_->sessions() > 1) context()["study"]["sessions"] = journal_->sessions();
}

/// Checks that the devices in the journal are those of this machine. One backend of each API is asked.
void StudyRun::check_devices() {
    std::set<std::string> seen;
    const std::string suffix = " introduction";
    Workers workers(options_.worker);
    const DeviceNumber device = RankPlan{.devices = options_.devices}.first_device();
    journal_->visit([&](const std::string& name, const nlohmann::json& value) {
        if (!name.ends_with(suffix)) return;
        const nlohmann::json& known = value.at("capabilities");
        if (!seen.insert(known.at("api")).second) return;
        const std::size_t begin = name.find(' ') + 1;
        const BackendSpec spec = spec_of_label(name.substr(begin, name.size() - suffix.size() - begin));
        nlohmann::json now;
        const auto failure =
            failure_of([&] { now = introduce(spec, workers, options_.timeout, device).at("capabilities"); });
        if (failure) now = *failure;
        if (now == known) return;
        const Difference other = first_difference(known, now);
        throw refusal(options_.out->string() + ".journal", other.where + " of " + spec.entry->name, other,
                      "what there is here, " + other.here);
    });
}

Result StudyRun::run() {
    const CaughtInterruptions caught;
    Activity looking;
    looking.begin("looking for devices");
    check_devices();
    bench_->look_for_devices(study_.scenes);
    looking.end();
    std::size_t number = 0;
    for (const StudyScene& item : study_.scenes) {
        progress_->begin(item.scene);
        const std::size_t before = row_count();
        try {
            run_scene(item, ++number);
        } catch (const Interrupted&) {
            // Interrupted, for example while a reference was computed. The result has the rows of the cases
            // that were finished before.
        }
        if (interrupted()) break;
        publish();
        progress_->end(int(row_count() - before));
    }
    if (!interrupted()) context().erase("unfinished");
    publish();
    if (!interrupted()) journal_->remove();
    return std::move(result_);
}

void StudyRun::run_scene(const StudyScene& item, std::size_t number) {
    if (const auto refusal = too_large_.find(item.scene); refusal != too_large_.end()) {
        for (const BackendSpec& spec : known_specs(study_, item)) {
            Row row = row_of(item.scene, spec);
            row.reason = refusal->second;
            bench_->add("skipped", row);
        }
        return;
    }
    bench_->turn_to(item, scenes_.of(item), number);
    const Scene& scene = bench_->scene();
    if (scene.world)
        context()["units"][scene.name] = {
            {"length", scene.world->length}, {"time", "s"}, {"force", scene.world->force()}};
    kind_->run(*bench_);
}

/// The number of rows with measurements. The rows of `benchmarks` do not count: each case in that list also
/// has a row of `verification`. Nor do those of `fastest`, which sum up other rows.
std::size_t StudyRun::row_count() const {
    std::size_t count = 0;
    for (const auto& [name, list] : result_.lists()) {
        if (is_measured(name) && name != "benchmarks" && name != "fastest") count += list->size();
    }
    return count;
}

void StudyRun::publish() {
    bench_->describe_devices();
    if (row_count() > 0 && !result_.context.contains("caches")) {
        nlohmann::json machine = google_benchmark_context();
        machine.update(result_.context);  // keeps the date of the beginning
        result_.context = std::move(machine);
    }
    context()["elapsed_seconds"] = journal_->elapsed_seconds();
    kind_->summarise(result_);
    if (options_.out) write_atomically(*options_.out, json_text(result_, 2) + "\n");
}

}  // namespace

bool is_unfinished(const Result& result) { return result.own_context().contains("unfinished"); }

bool has_measured(const Result& result) {
    return std::any_of(result.lists().begin(), result.lists().end(),
                       [](const auto& list) { return is_measured(list.first) && list.second->size() > 0; });
}

Result run_study(Study study, const StudyOptions& options) {
    const Workers checks_that_workers_can_start(options.worker);
    check_options(options);
    return StudyRun(std::move(study), options).run();
}

}  // namespace voxspring
