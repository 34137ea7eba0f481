// What is timed of a backend, in its process; measure.h asks it.
#pragma once

#include <limits>

#include "harness/process/case_runner.h"

namespace voxspring {

/// What is timed of each case.
struct Batch {
    int steps = 0;
    int repetitions = 0;
    bool total_error = true;  ///< whether errors are taken against the converged solution as well
    bool start_times = true;  ///< whether rows say how long a start takes, which is then made one by one
    /// Whether each batch starts from the scene's state. If not each goes on where the one before it ended,
    /// for scenes whose upload takes longer than many batches, and which have no edits: after the same number
    /// of steps all cases are at the same state but for rounding, and errors are taken after the last batch.
    bool rewind = true;
    /// A case makes no further repetitions once they have taken that long together, two at least. Only with
    /// rewind, without which all cases have to take the same steps.
    double most_seconds = std::numeric_limits<double>::infinity();
};

/// Steps from the state that the last batch left back to the last rewind, the warm-up included.
int steps_in_all(const Batch& batch);

/// Answers "warm up" with what the first upload took, "repeat" with a timed batch, "state" with what the last
/// one left, through `shared`, "edits" with their latencies and "step work" with the least work of a step
/// (limits.h).
CaseProgram timing_program(const Batch& batch, SharedState& shared);

}  // namespace voxspring
