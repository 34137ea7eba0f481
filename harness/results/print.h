// A result as text for people.
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

/// A column of a table of rows.
template <std::derived_from<Row> T>
struct ColumnOf {
    Column column;
    std::function<std::string(const T&)> cell;
};

/// Prints one line per row.
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

/// The names of the rows' counters, in the order of their first appearance, and the text of one of them in a
/// row.
std::vector<std::string> counter_names(const std::vector<const Row*>& rows);
std::string counter_cell(const Row& row, const std::string& name);

/// Prints one line per row: its scene and backend, `columns`, and the counters. While the table is too wide,
/// the last counter is dropped. `first_counter` is Column::expendable of the first counter, which always
/// stays if that is 0.
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

/// The time of a step in each repetition, in us, by the name of the case.
using StepTimes = std::map<std::string, std::vector<double>>;
StepTimes step_times_of(const std::vector<Row>& rows);

/// "~1.25 us +-6%": the time of a step. It begins with the mark of a row that is not to be trusted, and ends
/// with relative_spread() of the repetitions if that is 3% or more.
std::string time_text(const Row& row, double seconds, const StepTimes& repetitions);

/// relative_spread() of the repetitions of a case; 0 if there are fewer than three.
double spread_of_case(const std::string& case_name, const StepTimes& repetitions);

/// A ratio of two times, rounded to the digits that are certain. The last digit stands for at most twice the
/// `spread` of the ratio, where a spread below 1% counts as 1%. There are at most `decimals` decimals. 91.79
/// with a spread of 4% is "92".
std::string ratio_text(double ratio, double spread, int decimals = 2);

/// Prints one line per reason not to trust rows: how many rows, and which in a few words. The table marks
/// each such row, and the file has its figures.
void print_noise(const std::vector<Row>& rows, std::ostream& out);

/// The verdicts of a result, by the name of the case.
using Verdicts = std::map<std::string, VerdictPart>;
Verdicts verdicts_of(const Result& result);

/// The largest accepted error of a row as a fraction of the body's motion, "2.9e-04". A "*" after it says
/// that it belongs to the run from a strained start. "chaotic" means that no displacement is judged, "not
/// verified" that a backend without springs might pass, and "-" that nothing is known.
std::string threshold_text(const std::optional<VerdictPart>& verdict);
std::string threshold_text(const Row& row, const Verdicts& verdicts);

/// Says what the marks of threshold_text() mean, if a row has one, and whether only the last repetitions were
/// judged.
void print_thresholds(const std::vector<Row>& rows, const Verdicts& verdicts, std::ostream& out);

/// Prints the cases that were faster than their limit, if any. In these the limit is wrong, not the time.
void print_above_limit(const std::vector<Row>& rows, std::ostream& out);

/// Prints what was skipped and what failed. A reason for skipping takes one line: how many backends, of what
/// kind, on how many scenes. A reason for failure names every case that it holds for.
void print_unmeasured(const Result& result, std::ostream& out);

/// Names of backends in a few words: "cpu_parallel, cpu_reference", "10 cuda_* backends", "12 backends".
std::string names_in_short(const std::vector<std::string>& names);

/// Prints one row per case that passed, fastest first within a scene: time per step (median over the
/// repetitions), particle and spring updates per second, errors, time as a multiple of the fastest, and the
/// fraction of its limit that it reached. Then follow notes on the rows, the chaotic scenes, edits, the
/// limits of the devices, and what was skipped or failed, with the reasons.
void print_table(const Result& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
