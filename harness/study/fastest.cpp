#include "harness/study/fastest.h"

#include <fnmatch.h>

#include <algorithm>
#include <iomanip>
#include <map>
#include <optional>
#include <sstream>
#include <tuple>
#include <utility>

#include "harness/base/text.h"
#include "harness/device/limits.h"
#include "harness/device/noise.h"
#include "harness/results/result.h"
#include "harness/study/auto_choice.h"

namespace voxspring {
namespace {

using Rows = std::vector<nlohmann::json>;

double step_seconds(const nlohmann::json& row) { return 1e-6 * row.at("real_time").get<double>(); }

/// The fastest of `rows` that `wanted` accepts; nothing if it accepts none.
template <class Wanted>
std::optional<nlohmann::json> fastest_row(const Rows& rows, Wanted wanted) {
    const nlohmann::json* best = nullptr;
    for (const auto& row : rows) {
        if (wanted(row) && (best == nullptr || step_seconds(row) < step_seconds(*best))) best = &row;
    }
    return best == nullptr ? std::nullopt : std::optional(*best);
}

auto by_glob(const std::string& glob) {
    return [glob](const nlohmann::json& row) {
        return fnmatch(glob.c_str(), row.at("backend").get<std::string>().c_str(), 0) == 0;
    };
}

bool of_the_paper(const nlohmann::json& row) {
    const auto& names = paper_backends();
    return std::find(names.begin(), names.end(), row.at("backend").get<std::string>()) != names.end();
}

bool is_at_most(Quantity quantity) {
    return quantity == Quantity::seconds_per_step || quantity == Quantity::ready_seconds;
}

/// Of the fastest row, and of the fastest of `over`; nothing where that is not known.
std::optional<double> measured(const Target& target, const nlohmann::json& row, const Rows& rows) {
    if (target.quantity == Quantity::seconds_per_step) return step_seconds(row);
    if (target.quantity == Quantity::speed_ratio) {
        const auto base = fastest_row(rows, by_glob(target.over));
        return base ? std::optional(step_seconds(*base) / step_seconds(row)) : std::nullopt;
    }
    const auto& value = row.at(to_string(target.quantity));
    return value.is_number() ? std::optional(value.get<double>()) : std::nullopt;
}

nlohmann::json judge(const Target& target, const Rows& rows) {
    nlohmann::json judged = {{"quantity", to_string(target.quantity)},
                             {"value", target.value},
                             {"backends", target.backends},
                             {"name", nullptr},
                             {"measured", nullptr},
                             {"reached", nullptr},
                             {"met", nullptr}};
    if (target.quantity == Quantity::speed_ratio) judged["over"] = target.over;
    const auto best = fastest_row(rows, by_glob(target.backends));
    if (!best) return judged;
    judged["name"] = case_name(*best);
    if (const auto value = measured(target, *best, rows); value && *value > 0) {
        judged["measured"] = *value;
        const double reached = is_at_most(target.quantity) ? target.value / *value : *value / target.value;
        judged["reached"] = reached;
        judged["met"] = reached >= 1;
    }
    return judged;
}

std::string quantity_text(const nlohmann::json& target, const char* key) {
    const double value = target.at(key);
    const std::string quantity = target.at("quantity");
    if (quantity.ends_with("seconds") || quantity.starts_with("seconds")) return si(value, "s");
    if (quantity == to_string(Quantity::particle_updates_per_second)) return si(value, "particles/s");
    if (quantity == to_string(Quantity::spring_updates_per_second)) return si(value, "springs/s");
    std::ostringstream text;
    text << std::fixed << std::setprecision(2) << value;
    return text.str() + (quantity == to_string(Quantity::speed_ratio)
                             ? " x " + target.at("over").get<std::string>()
                             : " of the limit");
}

std::string ratio_text(const nlohmann::json& ratio, int digits = 2) {
    if (!ratio.is_number()) return "-";
    std::ostringstream text;
    text << std::fixed << std::setprecision(digits) << ratio.get<double>();
    return text.str();
}

std::string percent_of(const nlohmann::json& fraction) {
    return fraction.is_number() ? ratio_text(100 * fraction.get<double>(), 0) + "%" : "-";
}

std::string verdict(const nlohmann::json& target) {
    if (target.at("met").is_null()) return "not measured";
    return (target.at("met").get<bool>() ? "met: " : "missed: ") + quantity_text(target, "measured") + ", " +
           percent_of(target.at("reached")) + " of it";
}

}  // namespace

const std::vector<std::string>& paper_backends() {
    static const std::vector<std::string> names = {
        "gl_fragment_implicit", "gl_fragment_explicit", "cuda_implicit_device", "cuda_implicit_shared",
        "cuda_implicit_cached", "cuda_explicit_device", "cuda_explicit_cached", "cuda_explicit_cached_grid"};
    return names;
}

const std::vector<Quantity>& all_quantities() {
    static const std::vector<Quantity> all = {Quantity::seconds_per_step,
                                              Quantity::particle_updates_per_second,
                                              Quantity::spring_updates_per_second,
                                              Quantity::fraction_of_limit,
                                              Quantity::ready_seconds,
                                              Quantity::speed_ratio};
    return all;
}

std::string to_string(Quantity quantity) {
    switch (quantity) {
        case Quantity::seconds_per_step:
            return "seconds_per_step";
        case Quantity::particle_updates_per_second:
            return "particle_updates_per_second";
        case Quantity::spring_updates_per_second:
            return "spring_updates_per_second";
        case Quantity::fraction_of_limit:
            return "fraction_of_limit";
        case Quantity::ready_seconds:
            return "ready_seconds";
        case Quantity::speed_ratio:
            return "speed_ratio";
    }
    return {};
}

nlohmann::json fastest_of(const nlohmann::json& result, const std::vector<Target>& targets) {
    using Key = std::tuple<std::string, std::string, std::string>;
    std::vector<Key> order;
    std::map<Key, Rows> groups;
    for (const auto& row : result.at("benchmarks")) {
        if (!is_median(row)) continue;
        const Key key{row.at("scene"), row.at("formulation"), row.at("precision")};
        if (!groups.contains(key)) order.push_back(key);
        groups[key].push_back(row);
    }
    nlohmann::json blocks = nlohmann::json::array();
    for (const Key& key : order) {
        const Rows& rows = groups[key];
        const nlohmann::json best = fastest_row(rows, [](const auto&) { return true; }).value();
        nlohmann::json block = {{"name", case_name(best)}, {"seconds_per_step", step_seconds(best)}};
        for (const char* field :
             {"scene", "formulation", "precision", "backend", "tuning", "particles", "springs", "voxels",
              "particle_updates_per_second", "spring_updates_per_second", "ready_seconds", "limit_seconds",
              "limited_by", "fraction_of_limit", "error_relative_l2", "error_max", "error_steps",
              "reference"}) {
            block[field] = best.at(field);
        }
        block["device"] =
            result.at("context").at("voxspring").at("backends").at(best.at("backend")).at("device");
        if (best.contains("noisy")) block["noisy"] = best.at("noisy");
        block["paper"] = nullptr;
        if (const auto paper = fastest_row(rows, of_the_paper)) {
            block["paper"] = {{"name", case_name(*paper)},
                              {"seconds_per_step", step_seconds(*paper)},
                              {"ratio", step_seconds(*paper) / step_seconds(best)}};
        }
        block["auto"] = choose_among(result, rows);
        block["targets"] = nlohmann::json::array();
        for (const Target& target : targets) {
            if (Key{target.scene, target.formulation, target.precision} == key)
                block["targets"].push_back(judge(target, rows));
        }
        blocks.push_back(std::move(block));
    }
    return blocks;
}

void print_fastest(const nlohmann::json& result, std::ostream& out) {
    std::vector<std::vector<std::string>> table = {{"scene", "fastest", "time a step", "particles/s",
                                                    "springs/s", "rounding error", "of limit", "x paper's",
                                                    "x auto", "ready"}};
    for (const auto& block : result.at("fastest")) {
        const auto& paper = block.at("paper");
        table.push_back(
            {block.at("scene"), case_label(block), noise_mark(block) + si(block.at("seconds_per_step"), "s"),
             si(block.at("particle_updates_per_second"), "/s"),
             si(block.at("spring_updates_per_second"), "/s"), error_text(block.at("error_relative_l2")),
             percent_of(block.at("fraction_of_limit")), paper.is_null() ? "-" : ratio_text(paper.at("ratio")),
             ratio_text(block.at("auto").at("times_fastest")), si(block.at("ready_seconds"), "s")});
    }
    print_aligned(table, out);
    print_noise(result.at("fastest"), out);
    for (const auto& block : result.at("fastest")) {
        const std::string dataset = block.at("scene").get<std::string>() + " " +
                                    block.at("formulation").get<std::string>() + " " +
                                    block.at("precision").get<std::string>();
        if (!block.at("paper").is_null())
            out << dataset << ": the best of the paper's is "
                << case_label({{"scene", block.at("scene")}, {"name", block.at("paper").at("name")}}) << "\n";
        out << dataset << ": auto takes " << block.at("auto").at("reason").get<std::string>() << "\n";
        for (const auto& target : block.at("targets")) {
            out << dataset << ": target for " << target.at("backends").get<std::string>() << " "
                << quantity_text(target, "value") << ", " << verdict(target) << "\n";
        }
    }
    print_limits(result.at("context").at("voxspring").at("limits"), out);
    print_unmeasured(result, out);
}

}  // namespace voxspring
