// The limits of what can be simulated: how a backend behaves at rest, at the limit of stability, under large
// and degenerate displacements and over long runs, and how far it is from float64 there.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "harness/study/suite.h"

namespace voxspring {

/// How long the suite runs and how large its scenes are. `full`: the lengths at which the thresholds were
/// measured; takes seconds on a GPU or on all cores. `brief`: fewer steps and some smaller boxes, for
/// cpu_reference or for OpenGL on the processor. `shortest`: for tests, on small boxes.
enum class StressLengths : std::uint8_t { full, brief, shortest };

/// The float64 states that errors are measured against. Each is computed once, by cpu_parallel in formulation
/// `increment`.
class StressReferences {
public:
    /// The state after `steps` steps from rest. `name` identifies the problem.
    const State& of(const std::string& name, const Problem& problem, int steps);

    /// For references computed in another process: report_to() makes the object in that process report each
    /// new state, and take() keeps the state in the object in this process.
    void report_to(const OnEvent& on_event) { on_event_ = on_event; }
    void take(const nlohmann::json& event);
    /// known() returns all references as JSON, which take_all() reads in the next process.
    nlohmann::json known() const;
    void take_all(const nlohmann::json& known);

private:
    std::map<std::string, State> states_;
    OnEvent on_event_;
};

/// Runs the suite on a backend:
///
/// | part | | measured |
/// | --- | --- | --- |
/// | 1 | unloaded at rest, damping 0, 0.01 and 0.1 | displacement |
/// | 2 | 0.999 and 1.005 of the stable time step, damping 0 to 1 | growth of a start of 0.001 spacings |
/// | 3 | random start of +-0.3 spacings, undamped | least and largest energy over that of the start |
/// | 4 | random start of +-1 spacing, damping 0.01 | energy over that of the start |
/// | 5 | two coincident, two swapped particles, damping 0.05 | displacement in the end |
/// | 6 | NaN in a particle that no spring joins | other particles whose bits change |
/// | 7 | a rope, a free particle far from the origin, stiffnesses 1 and 1e6 | error against float64 |
/// | 8 | skipping of terms and of tiles at rest | particles whose bits differ without skipping |
/// | 9 | box, damped beam and heart; static box; small time steps | error against float64 |
/// | 9 | momentum of a long run | size of the sum over the sum of sizes |
///
/// A threshold that the model itself demands holds for every formulation, apart from known faults of `paper`.
/// A threshold for rounding holds for `increment` and `compensated`; for the others the figure is only
/// recorded. Lists by name: `stress`, one row per measurement; `skipped`; and `failed`, one row per missed
/// threshold or failed measurement.
void run_stress(const BackendSpec& spec, Backend& backend, StressLengths lengths,
                StressReferences& references, const Once& once);

}  // namespace voxspring
