// `voxspring advise`: which backend, formulation, precision and time step reach an error in the least time.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "harness/base/json.h"

namespace voxspring {

/// A row of a pareto result: one run that did not diverge and has a total error.
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

/// The candidates for `scene` in a pareto result. Throws BadInput if the result has no list `pareto`, if a
/// row of the scene does not follow results/schema.json, or if there is no row of the scene.
std::vector<Candidate> candidates_of(JsonObject result, const std::string& scene);

struct Advice {
    /// The fastest candidate whose total error is at most `error` of advise(); empty if there is none.
    std::optional<Candidate> best;
    /// Alternatives that reach the error, by time: the fastest one on each other device, and the fastest one
    /// on the device of `best` with another backend, formulation or precision.
    std::vector<Candidate> runners_up;
    /// The candidate with the smallest error, regardless of its time.
    Candidate most_accurate;
};
/// Chooses among `candidates`, which must not be empty. `error`: largest total error, relative L2.
Advice advise(const std::vector<Candidate>& candidates, double error);

/// The tuning parameters that differ from their defaults: "tile=64x16". All of them if this build does not
/// know the backend or a parameter.
std::string changed_tuning(const Candidate& candidate);

/// The argument of --backend that makes `voxspring run` use a candidate:
/// "cpu_parallel:formulation=increment,precision=float32[,changed_tuning()]".
std::string specification(const Candidate& candidate);

}  // namespace voxspring
