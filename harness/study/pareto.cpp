#include "harness/study/pareto.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

#include "harness/base/text.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"

namespace voxspring {
namespace {

/// The sort key of a row that has both: time, then error.
std::pair<double, double> key_of(const ParetoRow& row) {
    return {*row.seconds, *row.errors->total_relative_l2};
}

std::string digits(double value) { return fmt::format("{:.3g}", value); }

void print_front(std::vector<ParetoRow> rows, std::ostream& out, TableWidth width) {
    std::sort(rows.begin(), rows.end(),
              [](const ParetoRow& a, const ParetoRow& b) { return a.seconds < b.seconds; });
    print_cells<ParetoRow>(
        rows,
        {{{"  backend", 0, true}, [](const auto& row) { return "  " + row.label(); }},
         {{"run time"}, [](const auto& row) { return row.noise_mark() + si(*row.seconds, "s"); }},
         {{"error against the converged solution"},
          [](const auto& row) { return error_cell(row.errors->total_relative_l2); }},
         {{"rounding error", 1}, [](const auto& row) { return error_cell(row.errors->relative_l2); }},
         {{"time step", 2}, [](const auto& row) { return digits(row.time_step); }},
         {{"of stable", 4}, [](const auto& row) { return digits(row.fraction_of_stable); }},
         {{"steps", 3}, [](const auto& row) { return std::to_string(row.workpiece->steps); }}},
        width, out);
}

}  // namespace

void mark_fronts(std::vector<ParetoRow>& rows) {
    std::map<std::string, std::vector<ParetoRow*>> of_device;
    for (ParetoRow& row : rows) {
        if (row.seconds && row.errors && row.errors->total_relative_l2) of_device[row.device].push_back(&row);
    }
    for (auto& [device, all] : of_device) {
        std::stable_sort(all.begin(), all.end(),
                         [](const auto* a, const auto* b) { return key_of(*a) < key_of(*b); });
        double smallest = std::numeric_limits<double>::infinity();
        for (ParetoRow* row : all) {
            const double error = key_of(*row).second;
            row->on_front = error < 0.99 * smallest;
            smallest = std::min(smallest, error);
        }
    }
}

void print_fronts(const Result& result, std::ostream& out, TableWidth width) {
    std::vector<std::string> order, diverged;
    std::map<std::string, std::vector<ParetoRow>> fronts;
    std::map<std::string, std::string> without_total;
    std::vector<Row> all;
    for (const ParetoRow& one : result.rows<ParetoRow>("pareto")) {
        const Row& row = one;
        all.push_back(row);
        const std::string place = row.identity.scene + " on " + one.device;
        if (one.diverged) {
            diverged.push_back(row.identity.scene + " " + row.label() + " at " +
                               digits(one.fraction_of_stable) + " of the stable time step " +
                               row.reason.value_or(""));
        } else if (row.errors->total_reason) {
            without_total[row.identity.scene] = *row.errors->total_reason;
        }
        if (!one.on_front) continue;
        if (!fronts.contains(place)) order.push_back(place);
        fronts[place].push_back(one);
    }
    for (const std::string& place : order) {
        out << place << ", to time " << fronts[place].front().end_time << "\n";
        print_front(fronts[place], out, width);
    }
    print_noise(all, out);
    for (const auto& [scene, reason] : without_total)
        out << "no error against the converged solution: " << scene << ": " << reason << "\n";
    for (const std::string& text : diverged) out << text << "\n";
}

}  // namespace voxspring
