// Verifies and times a kernel that is not a backend but a function of a user's program, by the rules of a
// study.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/device/noise.h"
#include "harness/results/google_benchmark.h"
#include "harness/results/result.h"
#include "harness/scene/scene.h"
#include "harness/verification/errors.h"
#include "harness/verification/reference.h"

namespace voxspring {

/// What a row says of a kernel.
struct Kernel {
    std::string name;  ///< the row's `backend`; neither empty nor with a '/' or a blank
    /// What its arrays hold between steps: positions, or displacements and what rounding keeps of them. Its
    /// errors are compared with those of correct arithmetic in this formulation and precision.
    Formulation formulation = Formulation::position;
    Precision precision = Precision::float32;
    Capabilities capabilities = {};  ///< `api` names the system with its version, "torch 2.11.0"
    Counters counters = {};          ///< counters of its row
};

/// One kernel on one scene. The caller makes a warm-up and then the repetitions, each from start(), in this
/// process; trials of several kernels may take turns. All states are judged.
class KernelTrial {
public:
    /// Computes the references, which takes all cores. `on_progress` as for References. Throws BadInput for
    /// an invalid name, and for a scene with edits or a tool, since a kernel is not told of these.
    KernelTrial(std::shared_ptr<const Scene> scene, int steps, int repetitions, Kernel kernel,
                References::OnProgress on_progress = {});
    KernelTrial(const KernelTrial&) = delete;
    KernelTrial& operator=(const KernelTrial&) = delete;

    /// The state at which each repetition begins.
    const State& start() const { return scene_->state; }

    /// Times one repetition. `run` makes all steps, waits for them, and returns the seconds of the device's
    /// own clock; empty: the host's clock counts.
    void repeat(const std::function<std::optional<double>()>& run);
    /// Judges the state that the latest repetition left.
    void judge_state(const State& left);

    /// The state from which a further run, which is not timed, has to begin after the repetitions. Null: the
    /// scene's own start strains enough springs to verify the kernel.
    const State* strained_start();
    /// Judges the state that the run from strained_start() left.
    void judge_strained(const State& left);

    /// The result with this kernel as its only case: in `benchmarks` and `verification`, or in `failed`.
    Result result() const;

private:
    ReferenceSolution solve(const Scene& scene);

    const std::shared_ptr<const Scene> scene_;
    const int steps_, asked_;  ///< steps per repetition; number of repetitions
    const Kernel kernel_;
    BackendEntry entry_;
    BackendSpec spec_;
    References references_;
    ReferenceSolution solution_;
    double own_share_;  ///< share of the springs that the scene's own start strains
    std::optional<Scene> strained_scene_;
    std::optional<ReferenceSolution> strained_solution_;

    std::vector<Repetition> repetitions_;
    Observed observed_;
    std::optional<Row> judged_;  ///< errors and verdict of the first wrong state, or else of the last one
};

/// What a row says of the state that a run left. `own_share` is strained_share() of the scene's own start.
Row judged_row(const ReferenceSolution& solution, const State& left, const BackendSpec& spec,
               double own_share);
/// What a row says of the state that a run from a strained start left.
Row judged_strained_row(const ReferenceSolution& solution, const State& left, const BackendSpec& spec);
/// Adds the verdict of a run from a strained start to that of the run from the scene's own start.
void add_strained(Row& row, const Row& strained);

}  // namespace voxspring
