// The references for errors: float64 at the same time step, and float64 refined in time.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/error_threshold.h"

namespace voxspring {

/// Returns the scene with another time step and the same motion; a copy of `scene` if it already has that
/// time step.
///
/// The motion is defined as follows. With g = lambda / (2 - lambda), the integrator is exactly the
/// second-order central difference of x'' + (2 g / dt) x' = f with f = (force / m + gravity) / (1 - lambda /
/// 2), started at x(0) with the velocity
///
///     v(0) = (x(dt) - x(-dt)) / (2 dt) = ((1 - lambda / 2) (x(0) - x(-dt)) + a dt^2 / 2) / dt
///
/// where a = force / m + gravity at the start. Refinement keeps three things: the rate 2 g / dt, f and v(0).
/// Hence g grows in proportion to the step, lambda' = 2 g' / (1 + g'), the mass is divided and gravity
/// multiplied by (1 - lambda' / 2) / (1 - lambda / 2), and x(0) - x(-dt') = dt' ((1 + g') v(0) - dt' f(0) /
/// 2). Every run is then of second order, its error is a series in dt^2, and with its own step the scene is
/// unchanged. A scene at rest has not moved in the step before its start. Its velocity is therefore half a
/// step of acceleration, and the increments of refined starts are not zero.
///
/// For scenes with edits or a tool every run is only of first order, because a force jumps between two steps.
/// Edits keep their numbers of steps, so they come at other times.
Scene at_time_step(const Scene& scene, double time_step);

/// A span of time, as a number of time steps of a given size.
struct Span {
    double time_step = 0;
    int steps = 0;
};
/// `scene` with the time step that covers the span in `steps` steps. All callers get the same bits for the
/// time step, and exactly span.time_step if `steps` is span.steps.
Scene in_steps(const Scene& scene, const Span& span, int steps);

/// The limit of float64 runs as their time step goes to zero.
struct Refined {
    std::vector<glm::dvec3> displacement;  ///< empty if it is not known
    double uncertainty = 0;  ///< relative L2 difference between the previous extrapolation and `displacement`
    int finest = 0;          ///< number of steps of the finest run
    std::string reason;      ///< why `displacement` is empty
};

/// The states of the latest runs, by name.
class LatestStates {
public:
    explicit LatestStates(std::size_t max_bytes) : max_bytes_(max_bytes) {}

    /// Null if the state is not kept.
    const State* find(const std::string& name) const;
    /// Keeps `state`, which `name` must not have yet. If it does not fit into max_bytes beside the others,
    /// they are dropped first; it is kept however large it is.
    const State& keep(const std::string& name, State state);
    std::size_t bytes() const { return bytes_; }

private:
    std::size_t max_bytes_;
    std::size_t bytes_ = 0;
    std::map<std::string, State> states_;
};

/// Computes references, each only once: the latest are kept in memory, up to about 1 GiB, and all on disk.
///
/// Short runs of small bodies use cpu_reference: one thread and a plain loop over a list of springs. It
/// shares only the functions of spring.h with the backends under test. Other runs use PerturbedReference,
/// without a perturbation, on all cores with SIMD. Its first steps are checked against cpu_reference on the
/// same scene. PerturbedReference shares the filling of SIMD registers (simd/lanes-inl.h) with cpu_parallel,
/// and only the functions of spring.h with other backends. Beyond four million particles the list of springs
/// may not fit into memory, so the check is left out. The states of such bodies are not kept either, because
/// reading one would take longer than computing the few steps for which such scenes are timed.
class References {
public:
    /// Called about ten times per second with the number of steps of a trajectory that are done. An exception
    /// that it throws ends the computation and reaches the caller.
    using OnProgress = std::function<void(int done, int steps)>;

    /// Computations shorter than `quiet` do not call `on_progress`.
    explicit References(DiskCache cache = DiskCache{}, OnProgress on_progress = {},
                        std::chrono::duration<double> quiet = std::chrono::seconds(1))
        : cache_(std::move(cache)), on_progress_(std::move(on_progress)), quiet_(quiet) {}

    /// The state after `steps` steps of the scene, edits included: the reference for rounding errors.
    State after(const Scene& scene, int steps);

    /// The displacement at the end of `span` in the limit dt = 0: the reference for total errors. It is
    /// Richardson's extrapolation, by a polynomial in dt^2 through runs of `counts` steps (ascending) and of
    /// repeatedly doubled numbers of steps. Let d be the relative difference between the extrapolations with
    /// and without the finest run. The extrapolation has converged if d is at most 0.01 and at most a
    /// hundredth of the error of the run of counts.back() steps, or if d is at most 1e-11. After four
    /// doublings, or if further runs would take too long, it gives up; Refined::reason then says why.
    Refined refined(const Scene& scene, const Span& span, std::vector<int> counts);

    /// The spread of each rounding model: how far rounding by this model carries the scene, in `steps` steps,
    /// from `reference`, the state after these steps.
    std::vector<Spread> spreads(const Scene& scene, int steps, const State& reference,
                                const std::vector<RoundingModel>& models);
    Spread spread(const Scene& scene, int steps, const State& reference, const RoundingModel& model) {
        return spreads(scene, steps, reference, {model}).front();
    }

    /// How many states after() and refined() have computed; those found in memory or on disk do not count.
    int computed() const { return computed_; }

    /// The backend that computes the reference for `steps` steps of the scene, and its name in result rows.
    static std::unique_ptr<Backend> backend_of(const Scene& scene, int steps);
    static std::string name_of_backend(const Scene& scene, int steps);

private:
    void play(SceneRunner& runner, int steps, Backend& backend) const;
    State computed(const Scene& scene, int steps, Backend& backend) const;
    void check_first_steps(const Scene& scene, int steps) const;
    struct PerturbedRuns;
    Spread measured_spread(const Scene& scene, int steps, const State& expected, const RoundingModel& model,
                           std::uint64_t seed, PerturbedRuns& runs) const;

    DiskCache cache_;
    OnProgress on_progress_;
    std::chrono::duration<double> quiet_;
    LatestStates latest_{std::size_t(1) << 30};
    int computed_ = 0;
};

/// A hash of the scene and of this code (fingerprint_of_code()). Scenes equal in every number have the same
/// hash.
std::string fingerprint_of(const Scene& scene);

/// The name of the backend that is the plain, single-threaded reference.
inline const std::string reference_backend = "cpu_reference";

/// The relative L2 difference ||a - b|| / ||b|| of two lists of vectors; 0 if a = b, else infinite if b = 0.
double relative_difference(const std::vector<glm::dvec3>& a, const std::vector<glm::dvec3>& b);

}  // namespace voxspring
