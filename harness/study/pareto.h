// Run time to a fixed end time against error, over time steps: rows of a study of kind `pareto` and their
// fronts.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "harness/results/row.h"
#include "harness/results/table.h"

namespace voxspring {

/// One time step of one case: the time it takes to the end time, and its errors there.
struct ParetoRow {
    Row row;
    std::string device = {};  ///< one name a card, whatever the API
    double time_step = 0, fraction_of_stable = 0, end_time = 0;
    std::optional<double> seconds = {};  ///< median of the repetitions; nothing where it diverged
    std::optional<int> repetitions = {};
    bool diverged = false, on_front = false;
};
nlohmann::json to_json(const ParetoRow& row);
ParetoRow pareto_row_from_json(const nlohmann::json& json);

/// Sets `on_front` in rows of one scene: of those on the same device, sorted by time, each whose error
/// against the converged solution is more than 1% smaller than that of all before it. Those errors are known
/// no better.
void mark_fronts(std::vector<ParetoRow>& rows);

/// The front of each scene and device, fastest first; then what diverged and what has no such error.
void print_fronts(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
