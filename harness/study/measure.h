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
#include "harness/device/noise.h"
#include "harness/process/case.h"
#include "harness/process/shared_state.h"
#include "harness/scene/scene.h"
#include "harness/verification/reference.h"

namespace voxspring {

/// Called before each repetition with the case's label and how many repetitions have begun, so far
/// and in all.
using OnRepetition = std::function<void(const std::string& label, int begun, int total)>;

/// Rows by the list of the result that they belong to. All carry the fields that say which scene and backend
/// they are of.
using Rows = std::map<std::string, std::vector<nlohmann::json>>;

/// What measuring one scene gave.
struct SceneResult {
    nlohmann::json context;  ///< Google Benchmark's own; null where it was not asked
    Rows lists;
};

/// What a row is about: its name SCENE/BACKEND/FORMULATION/PRECISION[/TUNING] and the fields by which
/// results are paired, scene, backend, formulation, precision and tuning.
nlohmann::json row_identity(const std::string& scene, const BackendSpec& spec);

/// Of at least one value; of an even number of them the greater of the two in the middle.
double median(std::vector<double> values);

/// Adds a row to `failed` for every case that the journal says failed.
void add_failures(SceneResult& result, const std::string& scene, std::vector<Case>& cases);

/// What is timed of each case.
struct Batch {
    int steps = 0;
    int repetitions = 0;
    bool total_error = true;  ///< whether errors are taken against float64 refined in time as well
    /// Whether each batch starts from the scene's state. If not each goes on where the one before it ended,
    /// for scenes whose upload takes longer than many batches, and which have no edits: after the same number
    /// of steps all cases are at the same state but for rounding, and errors are taken after the last
    /// batch.
    bool rewind = true;
};

/// What a case does in its process to be timed. `scene` and `state`, room for one of its states, must
/// outlive the process.
MakeCaseRunner timing_runner(const Scene& scene, const Batch& batch, SharedState& state);

/// Runs every case, whose runner is timing_runner(), `repetitions` times for `steps` steps, from the same
/// state each time, interleaved in random order after one warm-up batch each, and compares the state that its
/// last timed batch left with float64 (errors.h). A DeviceError fails that case only, and so does the
/// end of its process, or a run that diverges. What the journal has of them is not run again. The rows
/// say what speaks against trusting their times (noise.h), of the card too unless `card` is null. Once
/// interrupted, cases that are not finished are left out.
///
/// Lists: `benchmarks`, Google Benchmark's rows of the cases that passed; `verification`, one row a
/// case that reached the last step; `failed`, cases that failed, each with a `reason`.
SceneResult measure(const Scene& scene, std::vector<Case>& cases, const Batch& batch, SharedState& state,
                    References& references, const Card* card, const OnRepetition& on_repetition);

}  // namespace voxspring
