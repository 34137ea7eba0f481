// Google Benchmark around the contract: times one scene on several backends and verifies each.
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/scene.h"
#include "harness/verify.h"

namespace voxspring {

/// A backend that is ready to run a scene.
struct Contender {
    BackendSpec spec;
    std::unique_ptr<Backend> backend;
    std::optional<DeviceLimits> limits;  ///< of its device; nothing: they could not be measured
};

/// Called before each repetition with the contender's label and how many repetitions have begun, so far
/// and in all.
using OnRepetition = std::function<void(const std::string& label, int begun, int total)>;

/// What measuring one scene gave. All rows carry the fields that say which scene and backend they are of.
struct SceneResult {
    nlohmann::json context;                    ///< Google Benchmark's own
    std::vector<nlohmann::json> benchmarks;    ///< Google Benchmark's rows of the contenders that passed
    std::vector<nlohmann::json> verification;  ///< one a contender that reached the last step
    std::vector<nlohmann::json> failed;        ///< contenders that failed, each with a `reason`
};

/// What a row is about: its name SCENE/BACKEND/FORMULATION/PRECISION[/TUNING] and the fields by which
/// results are paired, scene, backend, formulation, precision and tuning.
nlohmann::json row_identity(const std::string& scene, const BackendSpec& spec);

/// Runs every contender `repetitions` times for `steps` steps, from the same state each time, interleaved
/// in random order after one warm-up batch each, and compares the state that its last timed batch left
/// with cpu_reference after the same steps. A DeviceError fails that contender only.
SceneResult measure(const Scene& scene, std::vector<Contender>& contenders, int steps, int repetitions,
                    const OnRepetition& on_repetition);

}  // namespace voxspring
