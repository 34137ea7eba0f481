// A study: which scenes, which backends, how many steps; and its run. What is measured is its kind's
// (study_kind.h).
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "harness/scene/scene.h"

namespace voxspring {

class MpiRanks;

/// One scene of a study.
struct StudyScene {
    std::string scene;  ///< what load_scene() takes, or what the kind makes of it
    int steps = 0;      ///< in a batch, errors are taken after it; the kind may have it otherwise
    std::vector<std::string> backends;   ///< backend patterns; empty: the study's
    std::vector<std::string> only = {};  ///< what select_backends() leaves of StudyOptions::backends
    std::shared_ptr<const Scene> built = nullptr;  ///< one that is at hand, in the place of load_scene(scene)
    nlohmann::json settings = nlohmann::json::object();  ///< keys of the kind, as in a study file
};

/// A study file (results/study.schema.json). A backend pattern is `GLOB[:key=value,...]`: every
/// registered backend whose name matches and that has these options, with them; `formulation=*` and
/// `precision=*` stand for each that the backend has. `auto[:key=value,...]` is what `--backend auto` takes
/// for the scene (auto_choice.h).
struct Study {
    std::string name;
    std::string description;
    std::string kind = "timing";  ///< a registered one (study_kind.h)
    int repetitions = 9;
    int steps = 0;                                       ///< for scenes that the command line adds
    nlohmann::json settings = nlohmann::json::object();  ///< keys of the kind, as in a study file
    std::vector<std::string> backends;
    std::vector<StudyScene> scenes;
};

/// A built-in study or a study file. Throws BadInput.
Study load_study(const std::string& argument);

struct Named {
    std::string name;
    std::string description;
};
std::vector<Named> builtin_studies();

/// More ranks than any machine or study has.
constexpr int max_ranks = 1024;

/// What the command line changes about a study.
struct StudyOptions {
    /// Keep what matches one of these globs (a backend's name or its label; a scene's name); one that
    /// matches nothing of the study but a backend or a scene outside of it adds that, a backend to each scene
    /// once.
    /// "!GLOB" leaves out the backends that match.
    std::vector<std::string> backends;
    std::vector<std::string> scenes;
    VolumeOptions volume;  ///< of each scene that is a volume file
    std::optional<int> repetitions;
    /// Of a scaling study: the most ranks; larger numbers are left out. Nothing: one of each of `devices`, or
    /// one a processor, or as many as mpirun started.
    std::optional<int> ranks;
    /// Of a scaling study: the devices that its ranks take, as their API counts them, over and over; there
    /// are as many ranks at most, unless `ranks` says otherwise. Empty: each rank takes the next of those
    /// that there are.
    std::vector<int> devices;
    /// Of a scaling study: the processes that mpirun started, of which this one is rank 0. Null: it did not.
    MpiRanks* mpi = nullptr;
    /// So many processes measure in turns at most; each makes starting the next take longer, where all have a
    /// context on a GPU.
    int together = 32;
    /// So many cases do at once what is not timed, at most: construct, compile, go through a suite. Nothing:
    /// one for two cores.
    std::optional<int> side_by_side;
    std::optional<std::filesystem::path> out;
    bool resume = false;  ///< go on with what a run of the same study left beside `out`
    /// For which a case's process may say nothing before it counts as hung. An answer is a batch or a
    /// measurement; the longest of the built-in studies, a map of stability on OpenGL in software, takes
    /// minutes.
    std::chrono::duration<double> timeout = std::chrono::minutes(30);
    /// The program whose processes measure. Empty: this one, whose main() has called worker_main()
    /// (worker_main.h). Where main() is not yours, in a plugin for example: any of the same build that does,
    /// such as the installed `voxspring`, which has Voxspring's own backends.
    std::filesystem::path worker;
};

/// Runs the study and returns the result (results/schema.json). With `out` every finished measurement is in a
/// journal beside it at once (journal.h), and the file is replaced after every scene; the journal is removed
/// when the study is finished. The first SIGINT or SIGTERM stops it after what is in flight; its result is
/// then `unfinished`. A scene of the study's own that this machine has too little memory for is skipped. Two
/// different scenes of one name are refused: results tell scenes apart by their names.
///
/// Each case is measured in a process of its own, which is `options.worker` started anew. No process of this
/// program is forked, so it may have threads that hold whatever locks. One study at a time runs in a process:
/// SIGINT and SIGTERM are caught for it meanwhile.
///
/// Throws std::logic_error, before anything else, where there is no such program; BadInput before anything
/// has run, and for a worker that is not of this build; Unwritten or std::system_error where the disk takes
/// no more.
nlohmann::json run_study(Study study, const StudyOptions& options);

/// Whether a result is of a study that was interrupted.
bool is_unfinished(const nlohmann::json& result);

/// Whether anything was measured: a list beside those of what was skipped, failed and chosen has a row.
bool has_measured(const nlohmann::json& result);

}  // namespace voxspring
