// Up to which time step a backend is stable, found by trying, against what theory says.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "harness/scene/scene.h"
#include "harness/study/suite.h"

namespace voxspring {

/// Of a backend the largest stable time step on the particles and springs of `scene`, without gravity,
/// loads and damping of its own, by bisection, and stable_time_step() of the true frequency:
///
/// | start | damping | |
/// | --- | --- | --- |
/// | random within +-0.001 of the spacing | 0, 0.1, 1 | theory holds: within 0.2% |
/// | random within +-0.01, 0.1, 0.3 | 0 | springs meet and turn: the limit falls |
/// | twice the size of rest, and +-0.001 | 0 | theory about the stretched state; the surface is pinned |
///
/// A time step is stable if, after the steps that a mode takes to grow 30-fold from its share of a random
/// start where theory is exceeded by 0.1%, no particle moves 30 times the start's amplitude a step. With
/// `map` there is a map of damping against time step as well.
///
/// Rows of the list `stability`, one a start and damping, or the list `stability_map`; and `failed`, what
/// left theory's 0.2%. Rows as in results/schema.json.
class StabilityStudy {
public:
    /// Finds the true frequencies.
    explicit StabilityStudy(const Scene& scene);
    /// Whether there is anything to search: something oscillates, and how fast is known.
    bool empty() const { return searches_.empty(); }
    /// Runs all searches and, with `map`, the map. Throws what the backend does.
    void run(const BackendSpec& spec, Backend& backend, bool map, const Once& once);

private:
    struct Search;
    Rows search(const BackendSpec& spec, Backend& backend, Search& search) const;

    std::string scene_;
    std::vector<std::shared_ptr<Search>> searches_;
};

/// Every particle that can move displaced by uniform components within +-`amplitude`, at no speed; the same
/// each time.
State random_start(const Problem& problem, double amplitude);

/// The farthest that a particle moves in the last step; infinite where any is not finite.
double farthest(const State& state);

/// Amplitude of a start for which theory holds, in spacings, and what a bounded run stays under, in
/// amplitudes of its start. A float32 position at 16 spacings resolves a thousandth of 0.001, so that a
/// mode's share of the start is not rounded away; 30 times 0.001 is still less than where springs that are
/// not linear stop the growth of a damped mode, 0.07 to 0.2.
constexpr double small_amplitude = 1e-3;
constexpr double most_growth = 30;

/// Steps in which a mode of a random start comes to move most_growth times the start's amplitude a step, if
/// the time step is 1 + `excess` times its limit: by the root of z^2 - (2 - lambda - W) z + 1 - lambda = 0
/// beyond -1, W = omega^2 dt^2 = (4 - 2 lambda) (1 + excess)^2.
int steps_to_grow(const Problem& problem, double excess);

/// The state `steps` after `start`.
State run_from(const State& start, const Problem& problem, Backend& backend, int steps);

/// Total energy before the next step, which is taken: its velocity is the mean of those of half a step before
/// and after, without which the energy of a fast mode is out by up to a third.
double energy_before_step(const Problem& problem, Backend& backend);

/// A line a scene, start and damping, with the range of what cases reach, and each map.
void print_stability(const nlohmann::json& result, std::ostream& out);

}  // namespace voxspring
