#include "harness/verification/divergence.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <sstream>

#include "harness/verification/verify.h"

namespace voxspring {
namespace {

constexpr int look_every = 64;
constexpr std::int64_t longest_replay = 1'000'000;

/// NaN where any is.
double longest(const std::vector<glm::dvec3>& vectors) {
    double length = 0;
    for (const glm::dvec3& v : vectors) {
        if (!(glm::length(v) <= length)) length = glm::length(v);
        if (std::isnan(length)) break;
    }
    return length;
}

}  // namespace

double largest_increment(const Scene& scene, int steps) {
    const Problem& problem = scene.problem;
    const SpringLengths springs = spring_lengths(problem);
    const double acceleration = forced_acceleration(problem);
    const double forced = problem.damping > 0 ? std::min(double(steps), 1 / problem.damping) : steps;
    return springs.longest + longest(scene.state.increment) + 2 * longest(scene.state.displacement) +
           springs.strain + problem.time_step * problem.time_step * acceleration * forced;
}

Watch watch_of(const Scene& scene, int steps) { return {largest_increment(scene, steps), look_every}; }

std::optional<Departure> find_departure(Backend& backend, SceneRunner& runner, const Watch& watch,
                                        const State& last, int steps) {
    std::optional<Departure> departure = backend.departure();
    const double fastest = longest(last.increment);
    if (!departure) {
        if (fastest <= watch.largest_increment) return std::nullopt;
        if (std::isfinite(fastest)) departure = Departure{0, steps};
    }
    if (departure && departure->found - departure->last_good <= 1) return departure;
    const std::int64_t end = departure ? departure->found : steps;
    if (end > longest_replay) return departure;
    backend.watch({watch.largest_increment, 1});
    runner.rewind(backend);
    runner.run(backend, int(end));
    const std::optional<Departure> replayed = backend.departure();
    backend.watch(watch);
    return replayed ? replayed : departure;
}

std::string describe(const Departure& departure, const Watch& watch) {
    std::ostringstream text;
    if (departure.found - departure.last_good <= 1) {
        text << "diverged at step " << departure.found;
    } else {
        text << "diverged between steps " << departure.last_good << " and " << departure.found;
    }
    text << ": a particle is not finite or moved by more than " << watch.largest_increment << " in one step";
    return text.str();
}

}  // namespace voxspring
