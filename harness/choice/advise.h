// `voxspring advise`: finds the backend, formulation, precision and time step that reach an error soonest.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "harness/base/json.h"

namespace voxspring {

/// One run in the result of a study of kind pareto: a run that did not diverge and has a total error.
struct Candidate {
    std::string name;  ///< the `name` of the row in the result
    std::string backend, formulation, precision, tuning, device;
    double time_step = 0;
    double fraction_of_stable = 0;
    int steps = 0;
    double end_time = 0;
    double seconds = 0;  ///< how long the run takes to reach `end_time`
    double total_error = 0, rounding_error = 0;
};

/// The candidates for `scene` in the result of a pareto study. Throws BadInput if the result is of a newer
/// schema version or has no list `pareto`, if a row cannot be read, or if the scene has no row.
std::vector<Candidate> candidates_of(JsonObject result, const std::string& scene);

struct Advice {
    /// The fastest candidate whose total error is at most `error` of advise(); empty if there is none.
    std::optional<Candidate> best;
    /// Further candidates that reach the error, fastest first: the fastest on each other device, and the
    /// fastest on the device of `best` with another backend, formulation or precision.
    std::vector<Candidate> runners_up;
    /// The candidate with the smallest error, regardless of its time.
    Candidate most_accurate;
};
/// Chooses among `candidates`, which must not be empty. `error` is the largest accepted total error (relative
/// L2).
Advice advise(const std::vector<Candidate>& candidates, double error);

/// The tuning parameters of a candidate that differ from their defaults: "tile=64x16". All of its tuning
/// parameters if this program does not have the backend with these options.
std::string changed_tuning(const Candidate& candidate);

/// The argument of --backend with which `voxspring run` repeats the run of a candidate:
/// "cpu_parallel:formulation=increment,precision=float32[,changed_tuning()]".
std::string specification(const Candidate& candidate);

}  // namespace voxspring
