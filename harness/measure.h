// Google Benchmark around the contract: times one scene on several backends and verifies each.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/reference.h"
#include "harness/scene.h"

namespace voxspring {

/// A backend that is ready to run a scene.
struct Contender {
    BackendSpec spec;
    std::unique_ptr<Backend> backend;
    std::optional<DeviceLimits> limits;  ///< of its device; nothing: they could not be measured
    double construct_seconds = 0;        ///< that constructing `backend` took, on the host's clock
};

/// Called before each repetition with the contender's label and how many repetitions have begun, so far
/// and in all.
using OnRepetition = std::function<void(const std::string& label, int begun, int total)>;

/// What measuring one scene gave: rows by the list of the result that they belong to. All rows carry the
/// fields that say which scene and backend they are of.
struct SceneResult {
    nlohmann::json context;  ///< Google Benchmark's own; null where it was not asked
    std::map<std::string, std::vector<nlohmann::json>> lists;
};

/// What a row is about: its name SCENE/BACKEND/FORMULATION/PRECISION[/TUNING] and the fields by which
/// results are paired, scene, backend, formulation, precision and tuning.
nlohmann::json row_identity(const std::string& scene, const BackendSpec& spec);

/// Of at least one value; of an even number of them the greater of the two in the middle.
double median(std::vector<double> values);

/// What is timed of each contender.
struct Batch {
    int steps = 0;
    int repetitions = 0;
    bool total_error = true;  ///< whether errors are taken against float64 refined in time as well
    /// Whether each batch starts from the scene's state. If not each goes on where the one before it ended,
    /// for scenes whose upload takes longer than many batches, and which have no edits: after the same number
    /// of steps all contenders are at the same state but for rounding, and errors are taken after the last
    /// batch.
    bool rewind = true;
};

/// Runs every contender `repetitions` times for `steps` steps, from the same state each time, interleaved
/// in random order after one warm-up batch each, and compares the state that its last timed batch left
/// with float64 (errors.h). A DeviceError fails that contender only, and so does a run that diverges.
///
/// Lists: `benchmarks`, Google Benchmark's rows of the contenders that passed; `verification`, one row a
/// contender that reached the last step; `failed`, contenders that failed, each with a `reason`.
SceneResult measure(const Scene& scene, std::vector<Contender>& contenders, const Batch& batch,
                    References& references, const OnRepetition& on_repetition);

}  // namespace voxspring
