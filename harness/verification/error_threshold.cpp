#include "harness/verification/error_threshold.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace voxspring {

RoundingModel rounding_model_of(const BackendSpec& spec) {
    return {spec.options.formulation, spec.options.precision, spec.root_error()};
}

std::string to_string(const RoundingModel& model) {
    std::ostringstream text;
    text << to_string(model.formulation) << "/" << to_string(model.precision);
    if (model.root_error > 0) text << " with roots off by " << model.root_error;
    return text.str();
}

int random_runs(std::size_t particles) {
    if (particles <= 1 << 12) return 15;
    return particles > 1 << 18 ? 1 : 3;
}

double gate(double spread, double motion, double admitted) {
    // If the reference does not move, only the spread decides: a backend that does nothing is then right.
    if (motion == 0) return gate_in_spreads * spread + admitted;
    const double most = max_share_of_motion * motion;
    if (!(most >= min_gate_in_spreads * spread)) return std::numeric_limits<double>::infinity();
    return std::min(gate_in_spreads * spread + admitted, most);
}

double mean_gate(double spread, double motion, double admitted) {
    const double bound = std::max(gate_in_spreads * spread + admitted, min_share_of_mean * motion);
    return bound <= max_share_of_motion * motion ? bound : std::numeric_limits<double>::infinity();
}

bool is_chaotic(const Spread& spread) {
    return std::isinf(gate(spread.max, spread.motion_max, 0)) &&
           std::isinf(gate(spread.rms, spread.motion_rms, 0));
}

double statistic_gate(double spread, double size) {
    const double bound =
        std::clamp(gate_in_spreads * spread, min_statistics_share * size, max_statistics_share * size);
    return bound >= min_gate_in_spreads * spread ? bound : std::numeric_limits<double>::infinity();
}

}  // namespace voxspring
