// `voxspring advise`: which backend, formulation, precision and time step reach an error in the least time.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "harness/base/json.h"

namespace voxspring {

/// A row of a pareto result: one run that did not diverge and has a total error.
struct Candidate {
    std::string name;  ///< as result rows say it
    std::string backend, formulation, precision, tuning, device;
    double time_step = 0;
    double fraction_of_stable = 0;
    int steps = 0;
    double end_time = 0;
    double seconds = 0;  ///< to the end time
    double total_error = 0, rounding_error = 0;
};

/// Those of `scene` in a pareto result. Throws BadInput if the result has no list `pareto`, a row of the
/// scene is not as results/schema.json says, or none is of the scene.
std::vector<Candidate> candidates_of(JsonObject result, const std::string& scene);

struct Advice {
    /// The fastest of those whose total error is no larger than what was asked; nothing: none is.
    std::optional<Candidate> best;
    /// On each other device, and on that of `best` by another backend, formulation or precision: the fastest
    /// that reaches the error. By time.
    std::vector<Candidate> runners_up;
    /// The one with the smallest error, whatever it takes.
    Candidate most_accurate;
};
/// `candidates` is not empty.
Advice advise(const std::vector<Candidate>& candidates, double error);

/// "tile=64x16": the tuning parameters that are not at their default; all of them where this build does not
/// know the backend.
std::string changed_tuning(const Candidate& candidate);

/// "cpu_parallel:formulation=increment,precision=float32[,changed_tuning()]", what --backend takes.
std::string specification(const Candidate& candidate);

}  // namespace voxspring
