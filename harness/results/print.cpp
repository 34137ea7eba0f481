#include "harness/results/print.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/device/limits.h"

namespace voxspring {
namespace {

/// Distinct values in the order of their first appearance.
class Distinct {
public:
    void add(const std::string& value) {
        if (seen_.insert(value).second) values_.push_back(value);
    }
    const std::vector<std::string>& values() const { return values_; }

private:
    std::set<std::string> seen_;
    std::vector<std::string> values_;
};

/// Names of cases, grouped by scene, in the order in which they were added.
class CasesByScene {
public:
    void add(const std::string& scene, const std::string& name) {
        if (scenes_.empty() || scenes_.back().first != scene) scenes_.push_back({scene, {}});
        scenes_.back().second.push_back(name);
        ++count_;
    }
    std::size_t count() const { return count_; }
    std::string text() const {
        std::vector<std::string> names;
        for (const auto& [scene, cases] : scenes_) names.push_back(scene + ": " + names_in_short(cases));
        return fmt::format("{}", fmt::join(names, "; "));
    }

private:
    std::vector<std::pair<std::string, std::vector<std::string>>> scenes_;
    std::size_t count_ = 0;
};

/// The backends, cases and scenes that were skipped or failed for one reason.
struct Unmeasured {
    Distinct backends, cases, scenes;
};

void print_skipped(const std::string& reason, const Unmeasured& of, std::ostream& out) {
    const auto& scenes = of.scenes.values();
    out << "skipped: " << names_in_short(of.backends.values()) << " on "
        << (scenes.size() <= 3 ? joined(scenes) : counted(scenes.size(), "scene")) << ": " << reason << "\n";
}

void print_failed(const std::string& reason, const Unmeasured& of, std::ostream& out) {
    out << "failed: " << reason << "\n    " << joined(of.cases.values()) << "\n    on "
        << joined(of.scenes.values()) << "\n";
}

std::string slow_down(const Row& row) {
    return fmt::format("{:+.1f} %", 100 * (row.step_seconds() / row.edits->seconds_per_step_without - 1));
}

void print_edits(const std::vector<Row>& rows, std::ostream& out, TableWidth width) {
    std::vector<Row> edited;
    std::copy_if(rows.begin(), rows.end(), std::back_inserter(edited),
                 [](const Row& row) { return row.edits.has_value(); });
    if (edited.empty()) return;
    out << "\n";
    for (Row& row : edited) row.counters = {};  // counters are in the first table already
    print_rows<Row>(
        edited,
        {{{"edits", 2}, [](const Row& row) { return std::to_string(row.edits->edits); }},
         {{"an edit (median)"}, [](const Row& row) { return si(row.edits->median_seconds, "s"); }},
         {{"(max)", 1}, [](const Row& row) { return si(row.edits->max_seconds, "s"); }},
         {{"a step without", 3}, [](const Row& row) { return si(row.edits->seconds_per_step_without, "s"); }},
         {{"slow-down"}, slow_down}},
        width, out);
}

/// Prints a line with the cases that have fewer repetitions than the study asks for, if there are any.
void print_shortened(const std::vector<Row>& rows, int repetitions, std::ostream& out) {
    CasesByScene cases;
    for (const Row& row : rows) {
        const int made = row.benchmark->repetitions;
        if (made < repetitions)
            cases.add(row.identity.scene, row.label() + " (" + std::to_string(made) + ")");
    }
    if (cases.count() == 0) return;
    out << fmt::format("{} of {} with fewer than {}, since these took long: {}\n", cases.count(),
                       counted(rows.size(), "time"), counted(std::uint64_t(repetitions), "repetition"),
                       cases.text());
}

/// A scene and a number of steps. Times per step of other numbers of steps are not compared with each other.
using Dataset = std::pair<std::string, int>;
Dataset dataset_of(const Row& row) { return {row.identity.scene, row.case_key().steps}; }

/// The rows that are medians, grouped by dataset in the order of the study. In each group the fastest is
/// first.
std::vector<std::vector<Row>> medians_by_dataset(const std::vector<Row>& rows_of_result) {
    std::vector<std::vector<Row>> scenes;
    std::map<Dataset, std::size_t> places;
    for (const Row& row : rows_of_result) {
        if (!row.benchmark->is_median()) continue;
        const auto [place, added] = places.emplace(dataset_of(row), scenes.size());
        if (added) scenes.emplace_back();
        scenes[place->second].push_back(row);
    }
    for (auto& rows : scenes) {
        std::stable_sort(rows.begin(), rows.end(),
                         [](const Row& a, const Row& b) { return a.step_seconds() < b.step_seconds(); });
    }
    return scenes;
}

}  // namespace

std::vector<std::string> counter_names(const std::vector<const Row*>& rows) {
    Distinct names;
    for (const Row* row : rows) {
        for (const Counter& counter : row->counters) names.add(counter.name);
    }
    return names.values();
}

std::string counter_cell(const Row& row, const std::string& name) {
    const Counter* const counter = row.counters.find(name);
    return counter != nullptr ? counter->text() : "-";
}

StepTimes step_times_of(const std::vector<Row>& rows) {
    StepTimes repetitions;
    for (const Row& row : rows) {
        if (row.benchmark->repetition_index)
            repetitions[row.case_key()].push_back(row.benchmark->real_microseconds);
    }
    return repetitions;
}

std::string time_text(const Row& row, double seconds, const StepTimes& repetitions) {
    constexpr double min_spread = 0.03;  // medians of two runs of one program differ by as much
    std::string text = row.noise_mark() + si(seconds, "s");
    const double spread = spread_of_case(row.case_key(), repetitions);
    if (spread >= min_spread) text += fmt::format(" +-{:.0f}%", 100 * spread);
    return text;
}

double spread_of_case(const CaseKey& of, const StepTimes& repetitions) {
    const auto found = repetitions.find(of);
    return found == repetitions.end() || found->second.size() < 3 ? 0 : relative_spread(found->second);
}

std::string ratio_text(double ratio, double spread, int decimals) {
    constexpr double least_spread = 0.01;  // a ratio differs by as much between two runs of one program
    const double uncertain = 2 * std::max(spread, least_spread) * std::abs(ratio);
    if (!(uncertain > 0)) return fixed_text(ratio, decimals);
    const int place = std::max(int(std::floor(std::log10(uncertain))), -decimals);
    const double unit = std::pow(10, place);
    return fixed_text(std::round(ratio / unit) * unit, std::max(0, -place));
}

Verdicts verdicts_of(const Result& result) {
    Verdicts verdicts;
    for (const Row& row : result.rows("verification")) {
        if (row.verdict) verdicts[row.case_key()] = *row.verdict;
    }
    return verdicts;
}

std::string threshold_text(const std::optional<VerdictPart>& verdict) {
    // Without motion, errors are judged, but there is nothing that their bound is a share of.
    if (!verdict || !verdict->moved()) return "-";
    const std::optional<double> threshold = verdict->threshold();
    if (!threshold) return "chaotic";
    if (verdict->verified() == false) return "not verified";
    return error_text(*threshold) + (verdict->strained_start ? "*" : "");
}

namespace {

/// The verdict on a row's case; null if there is none. Verdicts of older files do not say their steps.
const VerdictPart* verdict_on(const Row& row, const Verdicts& verdicts) {
    auto found = verdicts.find(row.case_key());
    if (found == verdicts.end()) found = verdicts.find({row.case_name()});
    return found == verdicts.end() ? nullptr : &found->second;
}

}  // namespace

std::string threshold_text(const Row& row, const Verdicts& verdicts) {
    const VerdictPart* const found = verdict_on(row, verdicts);
    return threshold_text(found == nullptr ? std::nullopt : std::optional(*found));
}

void print_thresholds(const std::vector<Row>& rows, const Verdicts& verdicts, std::ostream& out) {
    bool strained = false, last_alone = false;
    CasesByScene unverified;
    for (const Row& row : rows) {
        const VerdictPart* const found = verdict_on(row, verdicts);
        if (found == nullptr) continue;
        strained = strained || found->strained_start;
        last_alone = last_alone || !found->repetitions_judged;
        if (found->verified() == false) unverified.add(row.identity.scene, row.label());
    }
    if (strained)
        out << "* the threshold is that of a second run, which starts with every spring strained: the run "
               "from the scene's start strains fewer than half of the springs by more than the threshold\n";
    if (last_alone) out << "Only the state after the last repetition of each time was judged.\n";
    if (unverified.count() > 0)
        out << fmt::format(
            "{} of {} not verified, since no run that is not chaotic strains half of the springs by more "
            "than the threshold: {}\n",
            unverified.count(), counted(rows.size(), "time"), unverified.text());
}

std::string names_in_short(const std::vector<std::string>& names) {
    if (names.size() <= 3) return joined(names);
    const std::string prefix = names.front().substr(0, names.front().find('_') + 1);
    const bool shared = !prefix.empty() && std::all_of(names.begin(), names.end(), [&](const auto& name) {
        return name.starts_with(prefix);
    });
    return std::to_string(names.size()) + (shared ? " " + prefix + "* backends" : " backends");
}

void print_noise(const std::vector<Row>& rows, std::ostream& out) {
    std::map<std::string, CasesByScene> by_kind;
    for (const Row& row : rows) {
        for (const std::string& reason : row.noisy) {
            // `kind` is the reason without the figure in parentheses at its end.
            const std::string kind = reason.substr(0, reason.find(" ("));
            by_kind[kind].add(row.identity.scene, row.label() + reason.substr(kind.size()));
        }
    }
    for (const auto& [kind, cases] : by_kind)
        out << fmt::format("~ {} of {} not to be trusted, {}: {}\n", cases.count(),
                           counted(rows.size(), "time"), kind, cases.text());
}

void print_above_limit(const std::vector<Row>& rows, std::ostream& out) {
    bool any = false;
    for (const Row& row : rows) {
        if (!row.above_limit()) continue;
        if (!any) out << "! faster than its limit, so the limit is wrong:\n";
        any = true;
        out << "    " << row.identity.scene << " " << row.label() << " ("
            << fixed_text(100 * *row.limit->fraction, 1) << " %)\n";
    }
}

void print_unmeasured(const Result& result, std::ostream& out) {
    for (const char* list : {"skipped", "failed"}) {
        Distinct reasons;
        std::map<std::string, Unmeasured> by_reason;
        for (const Row& row : result.rows(list)) {
            const std::string reason = row.reason.value_or("");
            reasons.add(reason);
            Unmeasured& of = by_reason[reason];
            of.backends.add(row.identity.backend);
            of.cases.add(row.label());
            of.scenes.add(row.identity.scene);
        }
        for (const std::string& reason : reasons.values()) {
            if (std::string(list) == "skipped") {
                print_skipped(reason, by_reason[reason], out);
            } else {
                print_failed(reason, by_reason[reason], out);
            }
        }
    }
}

void print_table(const Result& result, std::ostream& out, TableWidth width) {
    const std::vector<Row>& measured = result.rows("benchmarks");
    const StepTimes repetitions = step_times_of(measured);
    const Verdicts verdicts = verdicts_of(result);
    std::vector<Row> all;
    std::map<Dataset, const Row*> fastest;
    std::set<std::string> chaotic;
    const std::vector<std::vector<Row>> by_dataset = medians_by_dataset(measured);
    for (const std::vector<Row>& rows : by_dataset) {
        fastest[dataset_of(rows.front())] = &rows.front();
        all.insert(all.end(), rows.begin(), rows.end());
    }
    const auto spread = [&](const Row& row) { return spread_of_case(row.case_key(), repetitions); };
    const auto errors_of = [](const Row& row) { return row.errors.value_or(Errors()); };
    print_rows<Row>(
        all,
        {{{"time per step"}, [&](const Row& row) { return time_text(row, row.step_seconds(), repetitions); }},
         {{"steps", 9}, [](const Row& row) { return std::to_string(row.workpiece->steps); }},
         {{"particles/s", 4},
          [](const Row& row) { return si(row.benchmark->particle_updates_per_second, "/s"); }},
         {{"springs/s", 6},
          [](const Row& row) { return si(row.benchmark->spring_updates_per_second, "/s"); }},
         {{"rounding error", 2}, [&](const Row& row) { return error_cell(errors_of(row).relative_l2); }},
         {{"(max)", 5}, [&](const Row& row) { return error_cell(errors_of(row).max); }},
         {{"error against the converged solution", 7},
          [&](const Row& row) { return error_cell(errors_of(row).total_relative_l2); }},
         {{"threshold/motion", 8}, [&](const Row& row) { return threshold_text(row, verdicts); }},
         {{"x fastest", 1},
          [&](const Row& row) {
              const Row& best = *fastest[dataset_of(row)];
              return ratio_text(row.step_seconds() / best.step_seconds(),
                                std::hypot(spread(row), spread(best)));
          }},
         {{"% of roofline", 3},
          [&](const Row& row) {
              if (!row.limit || !row.limit->fraction) return std::string("-");
              const double percent = 100 * *row.limit->fraction;
              return ratio_text(percent, spread(row), percent < 9.95 ? 1 : 0) + "%" + row.limit_mark();
          }}},
        width, out, 10);
    for (const Row& row : all) {
        if (!row.errors || !row.errors->chaotic) continue;
        chaotic.insert(row.identity.scene + " in " + row.identity.formulation + " " + row.identity.precision +
                       ": rounding alone carries it by " + error_cell(row.errors->spread) +
                       " of its motion in " + counted(std::uint64_t(row.workpiece->steps), "step"));
    }
    print_shortened(all, result.own_context().at("study").at("repetitions"), out);
    print_thresholds(all, verdicts, out);
    print_noise(all, out);
    print_above_limit(all, out);
    for (const std::string& scene : chaotic)
        out << "chaotic, judged by mass, energy and spectrum: " << scene << "\n";
    print_edits(all, out, width);
    print_limits(result.own_context().at("limits"), out);
    print_unmeasured(result, out);
}

}  // namespace voxspring
