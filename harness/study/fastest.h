// The summary of a study of kind `fastest`: for each dataset the fastest strategy, how close it is to its
// limit, its speed relative to the paper's strategies, and whether the targets are met.
#pragma once

#include <cstdint>
#include <ostream>
#include <string>
#include <vector>

#include "harness/base/json.h"
#include "harness/results/result.h"
#include "harness/results/table.h"

namespace voxspring {

/// The eight backends that reimplement the paper's seven strategies: two with OpenGL fragment shaders, by
/// implicit addressing and by lists, and six in CUDA. Rows of these backends count with any tuning.
const std::vector<std::string>& paper_backends();

/// What a target limits. Seconds must be at most the target's value, all other quantities at least.
enum class Quantity : std::uint8_t {
    seconds_per_step,
    particle_updates_per_second,
    spring_updates_per_second,
    fraction_of_limit,
    ready_seconds,
    speed_ratio,  ///< step time of the fastest of `over`, divided by that of the fastest of `backends`
};
std::string to_string(Quantity quantity);

/// A value that a quantity has to reach on one dataset, as a study file states it.
struct Target {
    std::string scene, formulation, precision;
    std::string backends = "*";  ///< glob of backend names; the fastest match counts
    std::string over;            ///< glob of the backends to compare with, for speed_ratio
    Quantity quantity = Quantity::seconds_per_step;
    double value = 0;
};

/// The list `fastest` of a result (results/schema.json). Each element, a block, is the summary of one scene,
/// formulation, precision and number of steps with a row in `benchmarks`; blocks are in the order of these
/// rows. A block includes what `--backend auto` would choose (auto_choice.h) and its targets: each block of a
/// target's scene, formulation and precision judges it, whatever its number of steps.
std::vector<nlohmann::json> fastest_of(const Result& result, const std::vector<Target>& targets);

/// Reads the list `targets` of a study file. Throws BadInput.
std::vector<Target> read_targets(const JsonValue& list);

/// Prints one line per block and notes on these lines. Then prints, for each block, the fastest of the
/// paper's strategies, what `auto` takes, and one line per target. At the end come the limits, and what was
/// skipped and what failed.
void print_fastest(const Result& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
