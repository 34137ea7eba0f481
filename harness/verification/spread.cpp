#include "harness/verification/spread.h"

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

}  // namespace voxspring
