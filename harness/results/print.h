// Prints a result as text for people.
#pragma once

#include <concepts>
#include <functional>
#include <map>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "harness/results/result.h"
#include "harness/results/table.h"

namespace voxspring {

/// A column of a table, and the text of its cell in a row.
template <std::derived_from<Row> T>
struct ColumnOf {
    Column column;
    std::function<std::string(const T&)> cell;
};

/// Prints a table with one line per row.
template <std::derived_from<Row> T>
void print_cells(const std::vector<T>& rows, const std::vector<ColumnOf<T>>& columns, TableWidth width,
                 std::ostream& out) {
    std::vector<Column> headings;
    std::vector<std::vector<std::string>> table(rows.size());
    for (const ColumnOf<T>& one : columns) {
        headings.push_back(one.column);
        for (std::size_t n = 0; n < rows.size(); ++n) table[n].push_back(one.cell(rows[n]));
    }
    print_columns(headings, table, width, out);
}

/// counter_names() returns the names of all counters of the rows, in the order of their first appearance.
/// counter_cell() returns the text of the counter `name` of one row; "-" if the row has no such counter.
std::vector<std::string> counter_names(const std::vector<const Row*>& rows);
std::string counter_cell(const Row& row, const std::string& name);

/// Prints one line per row: its scene and backend, `columns`, and the counters. `first_counter` is
/// Column::expendable of the first counter, and each further counter's is one more. So in a table that is too
/// wide, the last counter is dropped before the others. With 0 the first counter is never dropped.
template <std::derived_from<Row> T>
void print_rows(const std::vector<T>& rows, const std::vector<ColumnOf<T>>& columns, TableWidth width,
                std::ostream& out, int first_counter = 0) {
    std::vector<ColumnOf<T>> all = {{{"scene", 0, true}, [](const T& row) { return row.identity.scene; }},
                                    {{"backend", 0, true}, [](const T& row) { return row.label(); }}};
    all.insert(all.end(), columns.begin(), columns.end());
    std::vector<const Row*> plain;
    for (const T& row : rows) plain.push_back(&row);
    int expendable = first_counter;
    for (const std::string& name : counter_names(plain)) {
        std::string heading = name;
        std::replace(heading.begin(), heading.end(), '_', ' ');
        all.push_back({{heading, expendable++}, [name](const T& row) { return counter_cell(row, name); }});
    }
    print_cells(rows, all, width, out);
}

/// The times of a step in us, one per repetition.
using StepTimes = std::map<CaseKey, std::vector<double>>;
StepTimes step_times_of(const std::vector<Row>& rows);

/// The time of a step as text: "~1.25 us +-6%". The text begins with "~" if the time is not to be trusted,
/// and ends with relative_spread() of the repetitions if this spread is 3% or more.
std::string time_text(const Row& row, double seconds, const StepTimes& repetitions);

/// relative_spread() of the repetitions of a case; 0 if there are fewer than three repetitions.
double spread_of_case(const CaseKey& of, const StepTimes& repetitions);

/// A ratio of two times, rounded to the digits that are certain. `spread` is the relative uncertainty of the
/// ratio; below 1% it counts as 1%. One unit of the last digit is at most twice that uncertainty, unless this
/// would take more than `decimals` decimals. Example: 91.79 with a spread of 4% is "92".
std::string ratio_text(double ratio, double spread, int decimals = 2);

/// Prints one line per reason not to trust times: how many rows have the reason, and which. Times of these
/// rows have the mark "~" in the table.
void print_noise(const std::vector<Row>& rows, std::ostream& out);

/// The verdicts of a result.
using Verdicts = std::map<CaseKey, VerdictPart>;
Verdicts verdicts_of(const Result& result);

/// The largest accepted error of a row as a fraction of the body's motion, such as "2.9e-04". A "*" after the
/// number says that the error is that of a second run, which starts with every spring strained. Other results
/// are "chaotic" (no displacement is judged), "not verified" (a backend without springs might pass) and "-"
/// (there is no verdict, or nothing moved).
std::string threshold_text(const std::optional<VerdictPart>& verdict);
std::string threshold_text(const Row& row, const Verdicts& verdicts);

/// Prints what "*" in threshold_text() means, if a row has a run from a strained start, and which rows are
/// not verified. Also prints a line if only the last repetition of a row was judged.
void print_thresholds(const std::vector<Row>& rows, const Verdicts& verdicts, std::ostream& out);

/// Prints the rows whose time is shorter than their limit, if any. Such a limit is wrong, not the time.
void print_above_limit(const std::vector<Row>& rows, std::ostream& out);

/// Prints what was skipped and what failed. Each reason for skipping takes one line, with the backends and
/// scenes in a few words. Each reason for failure is followed by the names of all its cases and scenes.
void print_unmeasured(const Result& result, std::ostream& out);

/// Names of backends as short text: "cpu_parallel, cpu_reference", "10 cuda_* backends", "12 backends".
std::string names_in_short(const std::vector<std::string>& names);

/// Prints one line per case that passed, fastest first within a scene: time per step (the median of the
/// repetitions), particle and spring updates per second, errors, the time as a multiple of the fastest
/// case's, and the shortest possible time as a percentage of the time. Then follow notes on the rows, the
/// chaotic scenes, edits, the limits of the devices, and what was skipped or failed, with the reasons.
void print_table(const Result& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
