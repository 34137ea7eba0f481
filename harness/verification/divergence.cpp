#include "harness/verification/divergence.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "harness/verification/sum.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

constexpr int check_every = 64;
constexpr std::int64_t longest_replay = 1'000'000;

/// The largest of several lengths; NaN if any of them is NaN.
struct Longest {
    double length = 0;
    Longest& operator+=(const Longest& other) {
        if (!(other.length <= length) && !std::isnan(length)) length = other.length;
        return *this;
    }
};

double longest(const std::vector<glm::dvec3>& vectors) {
    return sum_of<Longest>(vectors.size(),
                           [&](Longest& part, std::size_t i) { part += {glm::length(vectors[i])}; })
        .length;
}

}  // namespace

double largest_increment(const Scene& scene, int steps, const State& start) {
    const Problem& problem = scene.problem;
    const SpringLengths springs = spring_lengths(problem);
    const double acceleration = forced_acceleration(problem);
    const double forced = problem.damping > 0 ? std::min(double(steps), 1 / problem.damping) : steps;
    return springs.longest + longest(start.increment) + 2 * longest(start.displacement) +
           4 * longest(scene.tool_motion.displacement) + springs.strain +
           problem.time_step * problem.time_step * acceleration * forced;
}

DivergenceMonitor divergence_monitor(const Scene& scene, int steps, const State& start) {
    return {largest_increment(scene, steps, start), check_every};
}

std::optional<Divergence> find_divergence(Backend& backend, SceneRunner& runner,
                                          const DivergenceMonitor& monitor, const State& last, int steps) {
    std::optional<Divergence> divergence = backend.divergence();
    const double fastest = longest(last.increment);
    if (!divergence) {
        if (fastest <= monitor.largest_increment) return std::nullopt;
        if (std::isfinite(fastest)) divergence = Divergence{0, steps};
    }
    if (divergence && divergence->found - divergence->last_good <= 1) return divergence;
    const std::int64_t end = divergence ? divergence->found : steps;
    if (end > longest_replay) return divergence;
    backend.monitor({monitor.largest_increment, 1});
    runner.rewind(backend);
    runner.run(backend, int(end));
    const std::optional<Divergence> replayed = backend.divergence();
    backend.monitor(monitor);
    return replayed ? replayed : divergence;
}

std::string describe(const Divergence& divergence, const DivergenceMonitor& monitor) {
    const std::string when =
        divergence.found - divergence.last_good <= 1
            ? fmt::format("at step {}", divergence.found)
            : fmt::format("between steps {} and {}", divergence.last_good, divergence.found);
    return fmt::format("diverged {}: a particle is not finite or moved by more than {:g} in one step", when,
                       monitor.largest_increment);
}

}  // namespace voxspring
