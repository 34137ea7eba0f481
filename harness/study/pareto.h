// The study of kind `pareto`: run time to a fixed end time against error, over time steps.
#pragma once

#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "harness/scene/scene.h"
#include "harness/study/measure.h"
#include "harness/verification/reference.h"

namespace voxspring {

/// Which time steps a scene is run with.
struct TimeSteps {
    std::vector<double> fractions;  ///< of the stable time step, descending
    int steps = 0;                  ///< in the first of them, which sets the end time: the same for all
    int repetitions = 0;            ///< timed runs at each, fewer where they take more than a second together
};

/// Throws BadInput if the scene has no such study: it oscillates, its springs stay as they are, and no time
/// step takes more steps than an int holds.
void check_pareto(const Scene& scene, const TimeSteps& time_steps);

/// What a case does in its process to be measured so. `scene` and `state` must outlive it.
MakeCaseRunner pareto_runner(const Scene& scene, const TimeSteps& time_steps, SharedState& state);

/// Runs every case, whose runner is pareto_runner(), with every time step. The list `pareto` has one row for
/// each: seconds from the start to the end time (median), errors of the state there (errors.h), and whether
/// it is on its device's front. A run that left its bounds is `diverged`; it has no time and no errors. The
/// list `failed`: cases whose device or process failed, or whose rounding error is out of bounds. What
/// the journal has of them is not run again; once interrupted, nothing further is run.
SceneResult measure_pareto(const Scene& scene, std::vector<Case>& cases, const TimeSteps& time_steps,
                           SharedState& state, References& references, const OnRepetition& on_repetition);

/// Sets `on_front` in rows of one scene: of those on the same device, sorted by time, each whose total error
/// is more than 1% smaller than that of all before it. Total errors are known no better.
void mark_fronts(std::vector<nlohmann::json>& rows);

/// The front of each scene and device, fastest first; then what diverged and what has no total error.
void print_fronts(const nlohmann::json& result, std::ostream& out);

}  // namespace voxspring
