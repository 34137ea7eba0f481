// Timing of a backend, in the case's process; measure.h asks for it.
#pragma once

#include <limits>

#include "backends/limits.h"
#include "harness/process/case_runner.h"

namespace voxspring {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StepWork, bytes, written_bytes, footprint_bytes, operations, launches,
                                   exchanges)

/// How each case is timed.
struct Batch {
    int steps = 0;
    int repetitions = 0;
    bool total_error = true;  ///< whether errors are also measured against the converged solution
    bool start_times = true;  ///< whether rows report start times; cases are then started one by one
    /// Whether each batch starts from the scene's state. If not, each continues where the previous one ended,
    /// for scenes without edits whose upload takes longer than many batches. After the same number of steps
    /// all cases are at the same state except for rounding, and errors are measured after the last batch.
    bool rewind = true;
    /// How long the fastest cases of a scene are also stepped without a pause; 0: not at all. The repetitions
    /// are bursts of milliseconds, at clocks that a device may not hold for a second.
    double sustained_seconds = 0;
    /// A case stops repeating once its repetitions have taken this long together, after at least two. This
    /// requires `rewind`: otherwise all cases must make the same number of steps.
    double most_seconds = std::numeric_limits<double>::infinity();
};
/// What the case's process is told of a batch.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Batch, steps, repetitions, rewind)

/// Steps from the last rewind to the end of the last batch, including the warm-up if there is no rewind.
int steps_in_all(const Batch& batch);

/// The program of a timed case. Its runner answers "warm up" (the times of the first upload), "repeat" (a
/// timed batch), "state" (the state after the last batch, through `shared`), "fingerprint" (a hash of that
/// state), "edits" (their latencies), "sustain" (the time of a step while batches follow each other without a
/// pause), "strained" (the state after a batch from strained_start(), through `shared`), "compile" (null,
/// once a second backend has compiled kernels for the process), "launch" (the time of a launch) and "step
/// work" (the least work of a step, see limits.h).
CaseProgram timing_program(const Batch& batch, SharedState& shared);

}  // namespace voxspring
