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

/// A user's kernel, as its row of the result describes it.
struct Kernel {
    std::string name;  ///< the row's `backend`; neither empty nor with a '/' or a blank
    /// What the kernel stores between steps, see Formulation. Its errors are compared with those of correct
    /// arithmetic in this formulation and precision.
    Formulation formulation = Formulation::position;
    Precision precision = Precision::float32;
    Capabilities capabilities = {};  ///< `api` names the system with its version, "torch 2.11.0"
    Counters counters = {};          ///< further counters for its row
};

/// A trial of one kernel on one scene. The caller runs the kernel in this process, each time from start():
/// first a warm-up, then the repetitions. Trials of several kernels may take turns.
class KernelTrial {
public:
    /// Computes the references, which takes all cores. `on_progress` as for References. Throws BadInput for
    /// an invalid name or count, and for a scene with edits or a tool, since a kernel is not told of these.
    KernelTrial(std::shared_ptr<const Scene> scene, int steps, int repetitions, Kernel kernel,
                References::OnProgress on_progress = {});
    KernelTrial(const KernelTrial&) = delete;
    KernelTrial& operator=(const KernelTrial&) = delete;

    /// The state at which each repetition begins.
    const State& start() const { return scene_->state; }

    /// Times one repetition. `run` makes all steps, waits for them, and returns the seconds that the device's
    /// own clock measured. If it returns nothing, the host's clock counts.
    void repeat(const std::function<std::optional<double>()>& run);
    /// Judges the state that the latest repetition left, unless an earlier one was wrong.
    void judge_state(const State& left);

    /// The state from which one more run, which is not timed, has to begin after the repetitions. Null if no
    /// such run is needed: the scene's own start strains enough springs to verify the kernel.
    const State* strained_start();
    /// Judges the state that the run from strained_start() left.
    void judge_strained(const State& left);

    /// The result with this kernel as its only case: in `verification`, and in `benchmarks` or `failed`.
    Result result() const;

private:
    ReferenceSolution solve(const Scene& scene);

    const std::shared_ptr<const Scene> scene_;
    const int steps_, asked_;  ///< steps per repetition, and number of repetitions
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
    /// Errors and verdict of the first wrong state; if none is wrong, of the last state.
    std::optional<Row> judged_;
};

/// A row that judges `left`, the state after a run. `own_share`: strained_share() of the scene's start.
Row judged_row(const ReferenceSolution& solution, const State& left, const BackendSpec& spec,
               double own_share);
/// A row with the verdict of `left`, the state after a run from a strained start.
Row judged_strained_row(const ReferenceSolution& solution, const State& left, const BackendSpec& spec);
/// Adds the verdict of `strained`, from judged_strained_row(), to `row`, from judged_row().
void add_strained(Row& row, const Row& strained);

}  // namespace voxspring
