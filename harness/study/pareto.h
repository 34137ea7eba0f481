// Rows of a study of kind `pareto` (run time to a fixed end time against error, over time steps), and their
// fronts.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "harness/results/row.h"
#include "harness/results/table.h"

namespace voxspring {

/// One case at one time step: the run time to the end time, and the errors there.
struct ParetoRow {
    Row row;
    std::string device = {};  ///< one name per card, for all APIs
    double time_step = 0, fraction_of_stable = 0, end_time = 0;
    std::optional<double> seconds = {};  ///< median of the repetitions; empty if the run diverged
    std::optional<int> repetitions = {};
    bool diverged = false, on_front = false;
};
nlohmann::json to_json(const ParetoRow& row);
ParetoRow pareto_row_from_json(const nlohmann::json& json);

/// Sets `on_front` in the rows of one scene. Among the rows on one device, sorted by time, a row is on the
/// front if its error against the converged solution is more than 1% smaller than that of every row before
/// it. The errors are not known more precisely than 1%.
void mark_fronts(std::vector<ParetoRow>& rows);

/// Prints the front of each scene and device, fastest first, then the runs that diverged and those without
/// such an error.
void print_fronts(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
