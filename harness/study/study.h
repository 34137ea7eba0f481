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
    std::vector<std::string> backends;             ///< backend patterns; empty: those of the study
    std::vector<std::string> only = {};            ///< globs of --backend for this scene (select_backends())
    std::shared_ptr<const Scene> built = nullptr;  ///< a scene in memory, instead of load_scene(scene)
    nlohmann::json settings = nlohmann::json::object();  ///< the kind's own keys in the study file

    /// The key for whether steps begin at strained_start() instead of the scene's own start, which strains
    /// too few springs in few steps to verify a backend.
    static constexpr const char* strained_key = "strained_start";
    bool is_strained() const { return settings.value(strained_key, false); }
};

/// What a study file says (results/study.schema.json). A backend pattern is `GLOB[:key=value,...]`: it
/// stands, with these options, for every registered backend whose name matches and that takes them.
/// `formulation=*` and `precision=*` stand for each one that the backend has. `auto[:key=value,...]` is what
/// `--backend auto` chooses for the scene (auto_choice.h).
struct Study {
    std::string name;
    std::string description;
    std::string kind = "timing";  ///< a registered kind (study_kind.h)
    int repetitions = 9;
    int steps = 0;  ///< number of steps of scenes that the command line adds
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
    /// Keep what matches one of these globs (a backend's name or its label; a scene's name); if empty, keep
    /// all. A glob that matches nothing in the study, but a backend or a scene outside it, adds that; a
    /// backend is added once to each scene. "!GLOB" leaves out the backends that match.
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
    /// The largest number of processes that exist together and measure in turns. If all have a context on a
    /// GPU, each one makes the next one start more slowly.
    int together = 32;
    /// The largest number of cases that do at once what is not timed: construct, compile, go through a suite.
    /// Empty: one per two cores.
    std::optional<int> side_by_side;
    std::optional<std::filesystem::path> out;
    bool resume = false;  ///< continue what an earlier run of the same study left beside `out`
    /// How long a case's process may send nothing before it counts as hung. An answer is a batch or a
    /// measurement; the longest one of the built-in studies, a map of stability on OpenGL in software, takes
    /// minutes.
    std::chrono::duration<double> timeout = std::chrono::minutes(30);
    /// The program whose processes measure. Empty: this program, whose main() must have called worker_main()
    /// (worker_main.h). If main() is not yours, in a plugin for example, name any program of the same build
    /// that calls it, such as the installed `voxspring`, which has Voxspring's backends only.
    std::filesystem::path worker;
};

/// Runs the study and returns the result. With `out` every finished measurement is written at once to a
/// journal beside it (journal.h), and the file is replaced after every scene; the journal is removed when the
/// study is finished. The first SIGINT or SIGTERM stops the study after the work in flight; the result is
/// then `unfinished`. A scene named by the study itself is skipped if this machine has too little memory for
/// it. Two different scenes with the same name are refused, since results identify scenes by name.
///
/// Each case is measured in a separate process of `options.worker`, which is started anew. This process
/// itself is not forked, so its threads may hold any locks. A process can run one study at a time, since it
/// catches SIGINT and SIGTERM meanwhile.
///
/// Throws std::logic_error, before anything else, if no worker can be started; BadInput before anything has
/// run, and for a worker of another build; Unwritten or std::system_error if the disk is full.
Result run_study(Study study, const StudyOptions& options);

/// Whether a result comes from a study that was interrupted.
bool is_unfinished(const Result& result);

/// Whether anything was measured: whether a list of measurements has a row. The lists of cases that were
/// skipped or failed, and of what `auto` chose, hold none.
bool has_measured(const Result& result);

}  // namespace voxspring
