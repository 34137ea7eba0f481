// What errors are taken against: float64 at the same time step, and float64 refined in time.
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
#include "harness/verification/spread.h"

namespace voxspring {

/// The same motion in steps of another size: `scene` with `time_step`, or `scene` itself if it has that step.
///
/// What the motion is: with g = lambda / (2 - lambda), the integrator is, exactly, the central difference of
/// second order of x'' + (2 g / dt) x' = f with f = (force / m + gravity) / (1 - lambda / 2), started at x(0)
/// with the velocity
///
///     v(0) = (x(dt) - x(-dt)) / (2 dt) = ((1 - lambda / 2) (x(0) - x(-dt)) + a dt^2 / 2) / dt
///
/// where a = force / m + gravity at the start. Refining keeps these three, the rate 2 g / dt, f and v(0): g
/// grows with the step, lambda' = 2 g' / (1 + g'), the mass is divided and gravity multiplied by (1 - lambda'
/// / 2) / (1
/// - lambda / 2), and x(0) - x(-dt') = dt' ((1 + g') v(0) - dt' f(0) / 2). So every run is of second order,
/// its error is a series in dt^2, and at its own step a scene is what it says. A scene at rest has moved by
/// nothing in the step before its start: its velocity is half a step of acceleration, and refined starts have
/// moved.
///
/// Of no use for a scene with edits or a tool: a force that changes from one step to the next makes the order
/// one.
Scene at_time_step(const Scene& scene, double time_step);

/// A span of time as a number of steps of some size.
struct Span {
    double time_step = 0;
    int steps = 0;
};
/// `scene` in `steps` steps over the span: one time step to the bit, whoever asks. (At span.steps, the
/// span's.)
Scene in_steps(const Scene& scene, const Span& span, int steps);

/// Where float64 goes as its time step goes to zero.
struct Refined {
    std::vector<glm::dvec3> displacement;  ///< empty: did not converge
    double uncertainty = 0;  ///< relative L2: how much the last but one extrapolation differs from it
    int finest = 0;          ///< steps over the span of the finest run
    std::string reason;      ///< why there is none
};

/// Computes references, each once: the latest are kept in memory, up to 1 GiB, and all on disk.
///
/// Short runs of small bodies are of cpu_reference: one thread and a plain loop over a list of springs, which
/// shares no code with what is compared with it but the functions of spring.h. Others are of
/// perturbed_reference.h, on all cores and with SIMD, after its first steps have been found to be those of
/// cpu_reference on the very scene. With cpu_parallel it shares how SIMD registers are filled
/// (simd/lanes-inl.h), with other backends nothing but those functions. Beyond four million particles, whose
/// list of springs no memory may hold, those first steps are left out, and nothing is kept: reading takes
/// longer than computing the few steps that such scenes are timed for.
class References {
public:
    /// Told, about ten times a second, how many of a trajectory's steps are done. What it throws ends the
    /// computation and passes through.
    using OnProgress = std::function<void(int done, int steps)>;

    /// Nothing is told of what takes less than `quiet`.
    explicit References(DiskCache cache = DiskCache{}, OnProgress on_progress = {},
                        std::chrono::duration<double> quiet = std::chrono::seconds(1))
        : cache_(std::move(cache)), on_progress_(std::move(on_progress)), quiet_(quiet) {}

    /// After `steps` steps of the scene, edits included: what rounding errors are taken against.
    State after(const Scene& scene, int steps);

    /// At the end of `span`, what total errors are taken against: the polynomial in dt^2 through runs of
    /// `counts` steps, ascending, and of twice as many and so on, at dt = 0 (Richardson). Converged if the
    /// extrapolations with and without the finest run differ by less than a hundredth of the error of the run
    /// of counts.back() steps, and of 1, or by less than 1e-11; given up after four doublings.
    Refined refined(const Scene& scene, const Span& span, std::vector<int> counts);

    /// How far rounding of each of these kinds carries the scene in `steps` steps, whose reference is
    /// `reference`.
    std::vector<Spread> spreads(const Scene& scene, int steps, const State& reference,
                                const std::vector<RoundingModel>& models);
    Spread spread(const Scene& scene, int steps, const State& reference, const RoundingModel& model) {
        return spreads(scene, steps, reference, {model}).front();
    }

    /// Trajectories computed so far rather than found.
    int computed() const { return computed_; }

    /// The backend that a reference of so many steps is of, and what result rows call it.
    static std::unique_ptr<Backend> backend_of(const Scene& scene, int steps);
    static std::string name_of_backend(const Scene& scene, int steps);

private:
    void play(SceneRunner& runner, int steps, Backend& backend) const;
    State computed(const Scene& scene, int steps, Backend& backend) const;
    void check_first_steps(const Scene& scene, int steps) const;
    struct PerturbedRuns;
    Spread measured_spread(const Scene& scene, int steps, const State& expected, const RoundingModel& model,
                           std::uint64_t seed, PerturbedRuns& runs) const;
    const State& latest(const std::string& name, State state);

    DiskCache cache_;
    OnProgress on_progress_;
    std::chrono::duration<double> quiet_;
    std::map<std::string, State> latest_;
    int computed_ = 0;
};

/// The same of two scenes that are the same in every number, whatever they are called.
std::string fingerprint_of(const Scene& scene);

/// The plain one.
inline const std::string reference_backend = "cpu_reference";

/// ||a - b|| / ||b|| of two lists of vectors; 0 if both vanish, infinite if only b does.
double relative_difference(const std::vector<glm::dvec3>& a, const std::vector<glm::dvec3>& b);

}  // namespace voxspring
