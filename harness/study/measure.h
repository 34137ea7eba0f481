// Times one scene on several backends, interleaved, and verifies each.
#pragma once

#include "harness/study/study_bench.h"
#include "harness/study/timing_runner.h"
#include "harness/verification/errors.h"

namespace voxspring {

/// Throws BadInput if the scene cannot be timed in such batches: a scene with edits needs `batch.rewind`, and
/// at most max_steps_in_all steps may be made without a rewind.
void check_batch(const Study& study, const Scene& scene, const Batch& batch);
constexpr int max_steps_in_all = 1000000000;

/// The reference for the states that `specs` leave after `steps` steps of `scene`, which may differ from the
/// bench's scene. `last` is the problem after the edits within these steps. The reference lacks the converged
/// solution. Must not be called while anything is timed, since it takes all cores.
ReferenceSolution solution_of(StudyBench& bench, const Scene& scene, const Problem& last, int steps,
                              const std::vector<BackendSpec>& specs);

/// Adds to `row` the errors and the verdict of `left`, the state that the measured run left, and records that
/// the verdict covers `repetitions_judged` repetitions. Throws std::runtime_error if the state does not agree
/// with the reference. For kinds of study whose rows of measurements include the verdict.
void add_verdict(Row& row, const ReferenceSolution& solution, const State& left, const BackendSpec& spec,
                 int repetitions_judged);

/// Adds to `solution`, the reference for `scene`, the spreads that `specs` need and that it does not have
/// yet.
void add_spreads(StudyBench& bench, const Scene& scene, const std::vector<BackendSpec>& specs,
                 ReferenceSolution& solution);

/// Runs every backend of the bench in batches of `batch.steps` steps: one to warm up each process, and at
/// most `batch.repetitions` that are timed, interleaved in random order. Each begins at the same state,
/// unless `batch.rewind` is false. The state after the last batch is compared with float64 (errors.h). Timed
/// batches that begin at the same state must have left the same bits or, if the backend is not deterministic,
/// their states are compared with float64 as well. If the scene's own start strains too few springs, a
/// further batch from a start in which every spring is strained is compared as well. A DeviceError, the end
/// of a case's process or a run that diverges fails that case only. What the journal has is not measured
/// again. The backends are measured group by group (StudyBench::groups()), and interleaved within each group.
/// The rows give reasons not to trust their times (noise.h). After an interruption, cases that are not
/// finished are left out.
///
/// Lists: `benchmarks`, Google Benchmark's rows of the cases that passed; `verification`, one row per case
/// whose states were judged, unless a measurement failed; `failed`, cases that failed, each with a `reason`.
void measure(StudyBench& bench, const Batch& batch);

}  // namespace voxspring
