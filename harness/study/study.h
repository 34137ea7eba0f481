// A study (its scenes, backends and numbers of steps) and its run. Its kind decides what is measured
// (study_kind.h).
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "harness/results/result.h"
#include "harness/scene/scene.h"

namespace voxspring {

class MpiRanks;

/// One scene of a study.
struct StudyScene {
    std::string scene;  ///< argument of load_scene(), or a name that the kind interprets
    /// Number of steps per batch. Errors are measured after one batch, unless the kind of study says
    /// otherwise.
    int steps = 0;
    std::vector<std::string> backends;                   ///< backend patterns; empty: those of the study
    std::vector<std::string> only = {};                  ///< the globs of --backend that apply to this scene
    std::shared_ptr<const Scene> built = nullptr;        ///< a scene in memory, instead of load_scene(scene)
    nlohmann::json settings = nlohmann::json::object();  ///< the kind's own keys in the study file

    /// The key of a setting: whether steps begin at strained_start() (random displacements that strain every
    /// spring) instead of the scene's own start. In few steps that start may strain too few springs to verify
    /// a backend.
    static constexpr const char* strained_key = "strained_start";
    bool is_strained() const { return settings.value(strained_key, false); }
};

/// What a study file says (results/study.schema.json). A backend pattern is `GLOB[:key=value,...]`: it stands
/// for every registered backend whose name matches and that takes these options. `key=*`, for example
/// `formulation=*`, stands for each value that the backend lists for the key. `auto[:key=value,...]` is what
/// `--backend auto` chooses for the scene (auto_choice.h).
struct Study {
    std::string name;
    std::string description;
    std::string kind = "timing";  ///< a registered kind (study_kind.h)
    int repetitions = 9;
    int steps = 0;  ///< number of steps of scenes that do not state theirs or that the command line adds
    nlohmann::json settings = nlohmann::json::object();  ///< the kind's own keys in the study file
    std::vector<std::string> backends;
    std::vector<StudyScene> scenes;
};

/// Loads a built-in study or a study file. Throws BadInput.
Study load_study(const std::string& argument);

std::vector<Named> builtin_studies();

/// The largest number of ranks that a study file may ask for.
constexpr int max_ranks = 1024;

/// What the command line changes about a study.
struct StudyOptions {
    /// Globs that backends (by name or label) and scenes (by name) of the study must match to be kept; all
    /// are kept if there are none. A glob that matches nothing in the study adds the backends or the scene
    /// that it names outside the study; a backend is added once to each scene. "!GLOB" leaves out the
    /// backends that match.
    std::vector<std::string> backends;
    std::vector<std::string> scenes;
    VolumeOptions volume;  ///< options for each scene that is a volume file or a mesh
    std::optional<int> repetitions;
    /// For a scaling study: the largest number of ranks; larger numbers are left out. Empty: as many as
    /// mpirun started, or else one per entry of `devices`, or else one per processor.
    std::optional<int> ranks;
    /// For a scaling study: the devices of its ranks, as their API numbers them, used cyclically. Without
    /// `ranks` and mpirun there is at most one rank per entry. Empty: ranks take the available devices in
    /// turn.
    std::vector<int> devices;
    /// For a scaling study: the processes that mpirun started, of which this one is rank 0. Null without
    /// mpirun.
    MpiRanks* mpi = nullptr;
    /// The largest number of cases (a backend on a scene) whose processes exist at the same time and are
    /// measured in turns. Each process with a context on a GPU makes the next one start more slowly.
    int together = 32;
    /// The largest number of cases that do untimed work at the same time: construct a backend, compile, run a
    /// suite (suite.h). Empty: one per two processors.
    std::optional<int> side_by_side;
    std::optional<std::filesystem::path> out;
    bool resume = false;  ///< continue from the journal that an earlier run of this study left beside `out`
    /// How long a case's process may send nothing before it counts as hung. A process sends something after
    /// each batch or measurement. In the built-in studies the longest measurement takes minutes: a map of
    /// stability with OpenGL on the processor.
    std::chrono::duration<double> timeout = std::chrono::minutes(30);
    /// The program whose processes measure. Empty: this program, whose main() must have called worker_main()
    /// (worker_main.h). If main() is not yours, in a plugin for example, name any program of the same build
    /// that calls worker_main(), such as the installed `voxspring`, which has Voxspring's backends only.
    std::filesystem::path worker;
};

/// Runs the study and returns the result. With `out` every finished measurement is written at once to a
/// journal beside it (journal.h), and the file is replaced after every scene; the journal is removed when the
/// study is finished. The first SIGINT or SIGTERM stops the study after the work in flight; the result is
/// then `unfinished`. A scene that is too large for this machine's memory is skipped, or refused if
/// `options.scenes` is not empty. Two different scenes with the same name are refused, since results identify
/// scenes by name.
///
/// Cases are measured in other processes, which some cases share (EnterOptions::at_once). For each scene
/// `options.worker` is started as a new program, which forks the processes of its cases. This process itself
/// is never forked, so its threads may hold any locks. A process can run one study at a time, since it
/// catches SIGINT and SIGTERM meanwhile.
///
/// Throws std::logic_error, before anything else, if `options.worker` is empty and main() has not called
/// worker_main(); BadInput for a mistake in the study or the options, before anything has run, for a worker
/// that cannot be started or is of another build, and if a device changes during the study; Unwritten or
/// std::system_error if the disk is full.
Result run_study(Study study, const StudyOptions& options);

/// Whether a result comes from a study that was interrupted.
bool is_unfinished(const Result& result);

/// Whether anything was measured: whether any list has a row, apart from the lists `skipped`, `failed` and
/// `auto` (the choices of `auto`).
bool has_measured(const Result& result);

}  // namespace voxspring
