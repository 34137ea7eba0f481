#include "harness/study/fastest.h"

#include <fnmatch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/choice/auto_choice.h"
#include "harness/device/limits.h"
#include "harness/device/noise.h"
#include "harness/results/print.h"
#include "harness/results/row.h"

namespace voxspring {
namespace {

/// A row whose time is the median of one half of its repetitions. The other half chooses the fastest row
/// (medians_of_halves()).
struct SplitCase {
    Row row;
    double chosen_by = 0;  ///< us per step
};
using SplitCases = std::vector<SplitCase>;

/// Bounds of a target's value: no time is shorter, and no rate of updates is higher.
constexpr double min_target = 1e-12, max_target = 1e18;

/// `microseconds` has the time per step of each repetition of `row`. If it is empty, the row's own time
/// counts.
SplitCase split_case_of(Row row, const std::vector<double>& microseconds) {
    const double all = row.benchmark->real_microseconds;
    if (microseconds.empty()) return {std::move(row), all};
    const auto [chosen_by, reported] = medians_of_halves(microseconds);
    const double ratio = reported / all;
    row.benchmark->real_microseconds = reported;
    row.benchmark->particle_updates_per_second /= ratio;
    row.benchmark->spring_updates_per_second /= ratio;
    if (row.limit && row.limit->fraction) *row.limit->fraction /= ratio;
    return {std::move(row), chosen_by};
}

/// The fastest row that `wanted` accepts; null if it accepts none.
template <class Wanted>
const Row* fastest_row(const SplitCases& cases, Wanted wanted) {
    const SplitCase* best = nullptr;
    for (const SplitCase& one : cases) {
        if (wanted(one.row) && (best == nullptr || one.chosen_by < best->chosen_by)) best = &one;
    }
    return best != nullptr ? &best->row : nullptr;
}

auto by_glob(const std::string& glob) {
    return [glob](const Row& row) { return fnmatch(glob.c_str(), row.identity.backend.c_str(), 0) == 0; };
}

bool of_the_paper(const Row& row) {
    const auto& names = paper_backends();
    return std::find(names.begin(), names.end(), row.identity.backend) != names.end();
}

/// A quantity: its name, its unit as text, its value in a row (empty: not known), and whether a target is an
/// upper bound.
struct QuantityName {
    const char *name, *unit;
    std::optional<double> (*of)(const Row&);  ///< null for a quantity that needs two rows
    bool at_most = false;
};
constexpr std::array quantities = {
    QuantityName{"seconds_per_step", "s", [](const Row& row) { return std::optional(row.step_seconds()); },
                 true},
    QuantityName{"particle_updates_per_second", "particles/s",
                 [](const Row& row) { return std::optional(row.benchmark->particle_updates_per_second); }},
    QuantityName{"spring_updates_per_second", "springs/s",
                 [](const Row& row) { return std::optional(row.benchmark->spring_updates_per_second); }},
    QuantityName{"fraction_of_limit", "",
                 [](const Row& row) { return row.limit ? row.limit->fraction : std::nullopt; }},
    QuantityName{
        "ready_seconds", "s",
        [](const Row& row) { return row.start ? std::optional(row.start->ready_seconds) : std::nullopt; },
        true},
    QuantityName{"speed_ratio", "", nullptr},
};

/// The value of the target's quantity in `row`, which is the fastest row of the target's backends. A
/// speed_ratio says how many times as fast `row` is as the fastest row of backends that match `target.over`.
/// Empty if the value is not known.
std::optional<double> measured(const Target& target, const Row& row, const SplitCases& rows) {
    if (const auto of = quantities.at(std::size_t(target.quantity)).of) return of(row);
    const Row* base = fastest_row(rows, by_glob(target.over));
    return base != nullptr ? std::optional(base->step_seconds() / row.step_seconds()) : std::nullopt;
}

/// Whether a target lies within the spread of the starts of `row`, so that another start could give the other
/// verdict. Other quantities are medians of many repetitions, and their verdict stands.
bool within_spread(const Target& target, const Row& row, double measured) {
    if (target.quantity != Quantity::ready_seconds) return false;
    const Counter* const spread = row.counters.find("ready_spread");
    return spread != nullptr && spread->value &&
           std::abs(target.value - measured) <= *spread->value * measured;
}

nlohmann::json judge(const Target& target, const SplitCases& rows) {
    nlohmann::json judged = {{"quantity", to_string(target.quantity)},
                             {"value", target.value},
                             {"backends", target.backends},
                             {"name", nullptr},
                             {"measured", nullptr},
                             {"reached", nullptr},
                             {"met", nullptr}};
    if (target.quantity == Quantity::speed_ratio) judged["over"] = target.over;
    const Row* best = fastest_row(rows, by_glob(target.backends));
    if (best == nullptr) return judged;
    judged["name"] = best->case_name();
    if (const auto value = measured(target, *best, rows); value && *value > 0) {
        judged["measured"] = *value;
        const double reached = quantities.at(std::size_t(target.quantity)).at_most ? target.value / *value
                                                                                   : *value / target.value;
        judged["reached"] = reached;
        if (!within_spread(target, *best, *value)) judged["met"] = reached >= 1;
    }
    return judged;
}

Target read_target(JsonObject object) {
    Target target;
    std::vector<std::string> formulations, names;
    for (const Formulation formulation : every_formulation) formulations.push_back(to_string(formulation));
    target.scene = object.require("scene").string();
    target.formulation = object.require("formulation").one_of(formulations);
    target.precision = "float32";
    if (const auto precision = object.find("precision"))
        target.precision = precision->one_of({to_string(Precision::float32), to_string(Precision::float64)});
    if (const auto backends = object.find("backends")) target.backends = backends->string();
    int given = 0;
    for (std::size_t n = 0; n < quantities.size(); ++n) {
        names.emplace_back(quantities[n].name);
        const auto value = object.find(names.back());
        if (!value) continue;
        ++given;
        target.quantity = Quantity(n);
        target.value = value->number(min_target, max_target);
    }
    if (given != 1) object.value().refuse("exactly one of " + joined(names));
    if (target.quantity == Quantity::speed_ratio)
        target.over = object.require("over", "a glob of backends").string();
    object.finish();
    return target;
}

std::string quantity_text(const nlohmann::json& target, const char* key) {
    const double value = target.at(key);
    const auto named = std::find_if(quantities.begin(), quantities.end(), [&](const QuantityName& one) {
        return one.name == target.at("quantity");
    });
    if (const std::string unit = named->unit; !unit.empty()) return si(value, unit);
    return fixed_text(value, 2) +
           (target.contains("over") ? " x " + target.at("over").get<std::string>() : " of the limit");
}

std::string number_text(const nlohmann::json& ratio, int digits = 2) {
    if (!ratio.is_number()) return "-";
    return fixed_text(ratio.get<double>(), digits);
}

/// The time per step during seconds of uninterrupted stepping; "-" if it was not measured.
std::string sustained_text(const nlohmann::json& block) {
    const auto found = block.find("sustained_seconds_per_step");
    return found == block.end() ? "-" : si(found->get<double>(), "s");
}

std::string percent_of(const nlohmann::json& fraction) {
    return fraction.is_number() ? number_text(100 * fraction.get<double>(), 0) + "%" : "-";
}

std::string verdict(const nlohmann::json& target) {
    if (target.at("measured").is_null()) return "not measured";
    const nlohmann::json& met = target.at("met");
    const std::string judged = met.is_null()     ? "not decided, within the spread of its starts: "
                               : met.get<bool>() ? "met: "
                                                 : "missed: ";
    return judged + quantity_text(target, "measured") + ", " + percent_of(target.at("reached")) +
           " of the target";
}

}  // namespace

const std::vector<std::string>& paper_backends() {
    static const std::vector<std::string> names = {
        "gl_fragment_implicit", "gl_fragment_explicit", "cuda_implicit_device", "cuda_implicit_shared",
        "cuda_implicit_cached", "cuda_explicit_device", "cuda_explicit_cached", "cuda_explicit_cached_grid"};
    return names;
}

std::string to_string(Quantity quantity) { return quantities.at(std::size_t(quantity)).name; }

std::vector<Target> read_targets(const JsonValue& list) {
    std::vector<Target> targets;
    for (const JsonValue& item : list.array()) targets.push_back(read_target(item.object()));
    return targets;
}

namespace {

/// The block of fastest_of() for `rows`, the rows of one scene, formulation, precision and number of steps.
nlohmann::json block_of(const Result& result, const SplitCases& rows) {
    const Row& best = *fastest_row(rows, [](const Row&) { return true; });
    nlohmann::json block = {
        {"name", best.case_name()}, {"seconds_per_step", best.step_seconds()}, {"chosen_from", rows.size()}};
    const nlohmann::json fields = to_json(best);
    for (const char* field :
         {"scene", "formulation", "precision", "backend", "tuning", "steps", "particles", "springs", "voxels",
          "particle_updates_per_second", "spring_updates_per_second", "limit_seconds", "limited_by",
          "fraction_of_limit", "error_relative_l2", "error_max", "error_steps", "reference"}) {
        block[field] = fields.at(field);
    }
    if (best.start) {
        block["ready_seconds"] = best.start->ready_seconds;
        if (const auto warm = best.start->warm_ready_seconds) block["warm_ready_seconds"] = *warm;
    }
    block["device"] = result.own_context().at("backends").at(best.identity.backend).at("device");
    if (!best.noisy.empty()) block["noisy"] = best.noisy;
    for (const char* counter : {"sustained_seconds_per_step", "sustained_watts", "limit_sum_seconds"}) {
        const Counter* const found = best.counters.find(counter);
        if (found != nullptr && found->value) block[counter] = *found->value;
    }
    block["paper"] = nullptr;
    if (const Row* paper = fastest_row(rows, of_the_paper)) {
        block["paper"] = {{"name", paper->case_name()},
                          {"seconds_per_step", paper->step_seconds()},
                          {"ratio", paper->step_seconds() / best.step_seconds()}};
    }
    std::vector<Row> all;
    for (const SplitCase& one : rows) all.push_back(one.row);
    block["auto"] = choose_among(result, all);
    return block;
}

}  // namespace

std::vector<nlohmann::json> fastest_of(const Result& result, const std::vector<Target>& targets) {
    struct Key {
        std::string scene, formulation, precision;
        int steps;
        auto operator<=>(const Key&) const = default;
    };
    std::vector<Key> order;
    std::map<Key, SplitCases> groups;
    StepTimes repetitions = step_times_of(result.rows("benchmarks"));
    for (const Row& row : result.rows("benchmarks")) {
        if (!row.benchmark->is_median()) continue;
        const CaseKey of = row.case_key();
        const Key key{row.identity.scene, row.identity.formulation, row.identity.precision, of.steps};
        if (!groups.contains(key)) order.push_back(key);
        groups[key].push_back(split_case_of(row, repetitions[of]));
    }
    std::vector<nlohmann::json> blocks;
    for (const Key& key : order) {
        nlohmann::json block = block_of(result, groups[key]);
        block["targets"] = nlohmann::json::array();
        for (const Target& target : targets) {
            if (Key{target.scene, target.formulation, target.precision, key.steps} == key)
                block["targets"].push_back(judge(target, groups[key]));
        }
        blocks.push_back(std::move(block));
    }
    return blocks;
}

void print_fastest(const Result& result, std::ostream& out, TableWidth width) {
    const std::vector<Column> columns = {{"scene", 0, true},   {"fastest", 0, true},  {"time per step"},
                                         {"steps", 8},         {"sustained", 2},      {"particles/s", 5},
                                         {"springs/s", 6},     {"rounding error", 3}, {"threshold/motion", 8},
                                         {"% of roofline", 2}, {"x paper's", 1},      {"x auto", 1},
                                         {"cold start", 4},    {"warm start", 7}};
    std::vector<std::vector<std::string>> table;
    const std::vector<nlohmann::json>& blocks = result.rows<nlohmann::json>("fastest");
    const std::vector<Row> rows = rows_from_json(blocks);
    const StepTimes repetitions = step_times_of(result.rows("benchmarks"));
    const Verdicts verdicts = verdicts_of(result);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const Row& row = rows[i];
        const nlohmann::json& block = blocks[i];
        const auto& paper = block.at("paper");
        const int steps = block.value("steps", 0);
        const auto spread = [&](const std::string& name) {
            return spread_of_case({name, steps}, repetitions);
        };
        table.push_back(
            {row.identity.scene, row.label(), time_text(row, block.at("seconds_per_step"), repetitions),
             std::to_string(steps), sustained_text(block), si(block.at("particle_updates_per_second"), "/s"),
             si(block.at("spring_updates_per_second"), "/s"),
             error_cell(row.errors ? row.errors->relative_l2 : std::nullopt), threshold_text(row, verdicts),
             percent_of(block.at("fraction_of_limit")) + row.limit_mark(),
             paper.is_null() ? "-"
                             : ratio_text(paper.at("ratio"),
                                          std::hypot(spread(row.identity.name), spread(paper.at("name")))),
             number_text(block.at("auto").at("times_fastest")),
             row.start ? si(row.start->ready_seconds, "s") : "-",
             row.start && row.start->warm_ready_seconds ? si(*row.start->warm_ready_seconds, "s") : "-"});
    }
    print_columns(columns, table, width, out);
    print_thresholds(rows, verdicts, out);
    print_noise(rows, out);
    print_above_limit(rows, out);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const Identity& of = rows[i].identity;
        const nlohmann::json& block = blocks[i];
        const std::string dataset = of.scene + " " + of.formulation + " " + of.precision + ", " +
                                    counted(std::uint64_t(block.value("steps", 0)), "step");
        if (!block.at("paper").is_null()) {
            const Row paper{.identity = {.name = block.at("paper").at("name"), .scene = of.scene}};
            out << dataset << ": the fastest of the paper's strategies is " << paper.label() << "\n";
        }
        out << dataset << ": auto takes " << block.at("auto").at("reason").get<std::string>() << "\n";
        for (const auto& target : block.at("targets")) {
            out << dataset << ": target for " << target.at("backends").get<std::string>() << " "
                << quantity_text(target, "value") << ", " << verdict(target) << "\n";
        }
    }
    print_limits(result.own_context().at("limits"), out);
    print_unmeasured(result, out);
}

}  // namespace voxspring
