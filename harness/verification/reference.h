// What errors are taken against: float64 at the same time step, and float64 refined in time.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"

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
/// Of no use for a scene with edits: a force that changes from one step to the next makes the order one.
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

/// How far apart float64 is from float64.
struct Chaos {
    std::optional<double> divergence;  ///< relative L2 of displacement; nothing: no second float64 runs this
    bool chaotic() const { return divergence.has_value() && !(*divergence <= 1e-9); }
};

/// Computes references, each once: the latest are kept in memory, up to 1 GiB, and all on disk.
///
/// All are of cpu_reference, which shares no code with what is compared with it but the physics: an error of
/// cpu_parallel cannot hide in its own reference. It is slower, which the cache makes up for. Beyond four
/// million particles its lists of springs take more memory than the state a hundred times over, and reading a
/// reference takes longer than computing the few steps that such scenes are timed for: there references are
/// of cpu_parallel in float64, which smaller scenes compare with cpu_reference, and nothing is kept.
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

    /// Whether rounding errors mean anything after `steps` steps: the difference between cpu_reference and
    /// cpu_parallel in float64, which sum forces in different orders. Beyond 1e-9 they do not. Not known of
    /// large scenes.
    Chaos chaos(const Scene& scene, int steps);

    /// Trajectories computed so far rather than found.
    int computed() const { return computed_; }

    /// The backend that references of the scene are of.
    static std::string specification(const Scene& scene);
    /// Whether references of the scene are of cpu_parallel.
    static bool is_large(const Scene& scene);

private:
    void play(SceneRunner& runner, Backend& backend, int steps) const;
    State computed(const Scene& scene, int steps, const std::string& specification);
    const State& run(const Scene& scene, int steps, const std::string& specification);

    DiskCache cache_;
    OnProgress on_progress_;
    std::chrono::duration<double> quiet_;
    std::map<std::string, State> latest_;
    int computed_ = 0;
};

/// The same of two scenes that are the same in every number, whatever they are called.
std::string fingerprint_of(const Scene& scene);

/// The backend that References::after() takes float64 from.
inline const std::string reference_backend = "cpu_reference";

/// ||a - b|| / ||b|| of two lists of vectors; 0 if both vanish, infinite if only b does.
double relative_difference(const std::vector<glm::dvec3>& a, const std::vector<glm::dvec3>& b);

}  // namespace voxspring
