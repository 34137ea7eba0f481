// Timing of a backend, in the case's process; measure.h asks for it.
#pragma once

#include <limits>

#include "harness/process/case_runner.h"

namespace voxspring {

/// How each case is timed.
struct Batch {
    int steps = 0;
    int repetitions = 0;
    bool total_error = true;  ///< whether errors are also measured against the converged solution
    bool start_times = true;  ///< whether rows report start times; cases are then started one by one
    /// Whether each batch starts from the scene's state. If not, each continues where the previous one ended.
    /// That is for scenes without edits whose upload takes longer than many batches. After the same number of
    /// steps all cases are at the same state except for rounding, and errors are measured after the last
    /// batch.
    bool rewind = true;
    /// How long the fastest cases of a scene are also stepped without a pause; 0: not at all. The repetitions
    /// are bursts of milliseconds, at clocks that a device may not hold for a second.
    double sustained_seconds = 0;
    /// A case stops repeating once its repetitions have taken this long together, after at least two. It
    /// requires `rewind`: without it all cases must make the same number of steps.
    double most_seconds = std::numeric_limits<double>::infinity();
};

/// Steps from the last rewind to the end of the last batch, including the warm-up if there is no rewind.
int steps_in_all(const Batch& batch);

/// Answers "warm up" with the times of the first upload, "repeat" with a timed batch, "state" with the state
/// that the last batch left, through `shared`, "fingerprint" with that of this state, "edits" with their
/// latencies, "sustain" with the time of a step while batches follow each other for so long, "strained" with
/// the state after a batch from strained_start(), through `shared`, "compile" once a second backend has
/// compiled kernels for the process, "launch" with the time of a launch, and "step work" with the least work
/// of a step (limits.h).
CaseProgram timing_program(const Batch& batch, SharedState& shared);

}  // namespace voxspring
