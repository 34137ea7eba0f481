// A study: which scenes, which backends, how many steps; and its run.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "harness/scene/scene.h"
#include "harness/study/fastest.h"
#include "harness/study/stress.h"

namespace voxspring {

/// What a study measures.
enum class StudyKind : std::uint8_t {
    timing,     ///< the time of a step, with its errors (measure.h)
    fastest,    ///< the same, and for each dataset the fastest strategy against what was aimed at (fastest.h)
    pareto,     ///< run time to a fixed end time against error, over time steps (pareto.h)
    stability,  ///< up to which time step backends are stable (stability_study.h)
    stress,     ///< what backends do at the ends of what can be simulated (stress.h)
};

/// One scene of a study; of a stress study one of its suites.
struct StudyScene {
    std::string scene;                  ///< what load_scene() takes
    int steps = 0;                      ///< in a batch, errors are taken after it; of pareto see TimeSteps
    std::vector<std::string> backends;  ///< backend patterns; empty: the study's
    bool map = false;                   ///< of a stability study: with a map of damping against time step
    StressLengths lengths = StressLengths::full;   ///< of a stress study
    bool rewind = true;                            ///< of a fastest study: see Batch
    std::shared_ptr<const Scene> built = nullptr;  ///< one that is at hand, in the place of load_scene(scene)
};

/// A study file (results/study.schema.json). A backend pattern is `GLOB[:key=value,...]`: every
/// registered backend whose name matches and that has these options, with them; `formulation=*` and
/// `precision=*` stand for each that the backend has. `auto[:key=value,...]` is what `--backend auto` takes
/// for the scene (auto_choice.h).
struct Study {
    std::string name;
    std::string description;
    StudyKind kind = StudyKind::timing;
    int repetitions = 9;
    int steps = 0;                   ///< for scenes that the command line adds
    bool total_error = true;         ///< of a timing study: take errors against float64 refined in time
    std::vector<double> time_steps;  ///< of a pareto study: fractions of the stable one, descending
    std::vector<Target> targets;     ///< of a fastest study
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

/// What the command line changes about a study.
struct StudyOptions {
    /// Keep what matches one of these globs (a backend's name or its label; a scene's name); one that
    /// matches nothing of the study but a backend or a scene outside of it adds that.
    std::vector<std::string> backends;
    std::vector<std::string> scenes;
    VolumeOptions volume;  ///< of each scene that is a volume file
    std::optional<int> repetitions;
    /// The first SIGINT or SIGTERM ends the process, where nobody wants what is finished.
    bool stops_at_once = false;
    std::optional<std::filesystem::path> out;
    bool resume = false;  ///< go on with what a run of the same study left beside `out`
    /// For which a case's process may say nothing before it counts as hung. An answer is a batch or a
    /// measurement; the longest of the built-in studies, a map of stability on OpenGL in software, takes
    /// minutes.
    std::chrono::duration<double> timeout = std::chrono::minutes(30);
};

/// Runs the study and returns the result (results/schema.json). With `out` every finished measurement is in a
/// journal beside it at once (journal.h), and the file is replaced after every scene; the journal is removed
/// when the study is finished. The first SIGINT or SIGTERM stops it after what is in flight; its result is
/// then `unfinished`. A scene of the study's own that this machine has too little memory for is skipped.
/// Throws BadInput before anything has run, Unwritten or std::system_error where the disk takes no more.
nlohmann::json run_study(Study study, const StudyOptions& options);

/// Whether a result is of a study that was interrupted.
bool is_unfinished(const nlohmann::json& result);

}  // namespace voxspring
