// Rows of a study of kind `pareto` (run time to a fixed end time against error, over time steps), and their
// fronts.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "harness/results/row.h"

namespace voxspring {

/// One case at one time step: the run time until the end time, and the errors at the end time.
struct ParetoRow : Row {
    std::string device = {};  ///< one name per card, for all APIs
    double time_step = 0, fraction_of_stable = 0, end_time = 0;
    std::optional<double> seconds = {};  ///< median of the repetitions; empty if the run diverged
    std::optional<int> repetitions = {};
    bool diverged = false, on_front = false;

    static void fields(auto& row, auto& of) {
        of.required("device", row.device);
        of.required("time_step", row.time_step);
        of.required("fraction_of_stable", row.fraction_of_stable);
        of.required("end_time", row.end_time);
        of.nullable("seconds", row.seconds);
        of.optional("repetitions", row.repetitions);
        of.required("diverged", row.diverged);
        of.required("on_front", row.on_front);
    }
};

/// Sets `on_front` in the rows of one scene. Among the rows on one device, sorted by time, a row is on the
/// front if its error against the converged solution is more than 1% smaller than that of every row before
/// it. The errors are not known more precisely than 1%.
void mark_fronts(std::vector<ParetoRow>& rows);

}  // namespace voxspring
