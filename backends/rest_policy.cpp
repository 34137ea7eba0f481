#include "backends/rest_policy.h"

#include <algorithm>

namespace voxspring {

Rest rest_of(const Options& options) {
    const std::string& rest = options.tuning.at("rest");
    if (rest == "auto") return options.tuning.at("terms") == "all" ? Rest::step : Rest::choose;
    if (rest == "skip") return Rest::skip;
    return rest == "flush" ? Rest::flush : Rest::step;
}

std::string refused_rest(const Options& options) {
    if (rest_of(options) != Rest::flush || by_increments(options.formulation)) return {};
    return "rest=flush requires formulation=increment or formulation=compensated";
}

bool stays_at_rest(const Problem& problem) {
    return problem.gravity == glm::dvec3(0) && problem.load.empty();
}

void RestPolicy::start(bool checks, bool chooses) {
    checks_ = checks;
    chooses_ = chooses;
    left_ = parameters_.period;
    pause_ = parameters_.min_pause;
}

void RestPolicy::begin_checks() {
    checks_ = true;
    left_ = parameters_.period;
}

void RestPolicy::decide(std::size_t active, std::size_t tiles) {
    if (pays(active, tiles)) {
        pause_ = parameters_.min_pause;
        left_ = parameters_.period;
        return;
    }
    checks_ = false;
    left_ = pause_;
    pause_ = std::min(2 * pause_, parameters_.max_pause);
}

}  // namespace voxspring
