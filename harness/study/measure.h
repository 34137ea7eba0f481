// Times one scene on several backends, interleaved, and verifies each.
#pragma once

#include "harness/study/study_bench.h"
#include "harness/study/timing_runner.h"
#include "harness/verification/errors.h"

namespace voxspring {

/// Throws BadInput for a batch that the scene cannot be timed by: without rewind it has no edits; and all
/// steps together are at most max_steps_in_all.
void check_batch(const Study& study, const Scene& scene, const Batch& batch);
constexpr int max_steps_in_all = 1000000000;

/// What the states of such backends after all steps are held against, whose problem is `last` by then. Before
/// anything is timed, as it takes all cores.
ReferenceSolution solution_of(StudyBench& bench, const Problem& last, const Batch& batch,
                              const std::vector<BackendSpec>& specs);

/// The same for more backends, of which some may round in other ways.
void add_spreads(StudyBench& bench, const std::vector<BackendSpec>& specs, ReferenceSolution& solution);

/// Runs every backend of the bench `repetitions` times for `steps` steps, from the same state each time,
/// interleaved in random order after one warm-up batch each, and then compares the state that its last timed
/// batch left with float64 (errors.h). A DeviceError fails that case only, and so does the end of its
/// process, or a run that diverges. What the journal has is not run again. Where there are more than
/// StudyOptions::together, one group follows another, and interleaving is within each. The rows say what
/// speaks against trusting their times (noise.h). Once interrupted, cases that are not finished are left out.
///
/// Lists: `benchmarks`, Google Benchmark's rows of the cases that passed; `verification`, one row a case that
/// reached the last step; `failed`, cases that failed, each with a `reason`.
void measure(StudyBench& bench, const Batch& batch);

}  // namespace voxspring
