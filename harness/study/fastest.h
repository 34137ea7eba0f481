// What a study of kind `fastest` makes of its rows: for each dataset the fastest strategy, how close to its
// limit it is, how many times as fast as what the paper had, and whether that is what was aimed at.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "harness/base/json.h"
#include "harness/results/table.h"

namespace voxspring {

/// The backends that re-do the paper's seven strategies: OpenGL fragment shaders, with implicit addressing
/// and with lists, and six in CUDA. A row of one of them counts with whatever tuning it has.
const std::vector<std::string>& paper_backends();

/// What a target is about. All but the seconds are to be at least what was aimed at.
enum class Quantity : std::uint8_t {
    seconds_per_step,
    particle_updates_per_second,
    spring_updates_per_second,
    fraction_of_limit,
    ready_seconds,
    speed_ratio,  ///< of the time of a step of the fastest of `over` to that of the fastest of `backends`
};
std::string to_string(Quantity quantity);
const std::vector<Quantity>& all_quantities();

/// What a study aims at on one dataset.
struct Target {
    std::string scene, formulation, precision;
    std::string backends = "*";  ///< a glob of names; the fastest of them is what counts
    std::string over;            ///< the same; of a speed_ratio
    Quantity quantity = Quantity::seconds_per_step;
    double value = 0;
};

/// The list `fastest` of a result (results/schema.json): a block for each scene, formulation and precision
/// that `result` has a row of in `benchmarks`, in their order, with the targets about it and with what
/// `--backend auto` takes there (auto_choice.h).
nlohmann::json fastest_of(const nlohmann::json& result, const std::vector<Target>& targets);

/// The targets of a study file's list.
std::vector<Target> read_targets(const JsonValue& list);

/// A line a block, then one a target, the limits, and what was skipped and what failed.
void print_fastest(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
