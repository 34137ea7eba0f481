#include "harness/process/shared_state.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace voxspring {

SharedState::SharedState(std::size_t particles)
    : particles_(particles),
      memory_(SharedMemory::of_bytes(2 * particles * sizeof(glm::dvec3))),
      vectors_(static_cast<glm::dvec3*>(memory_.data()), 2 * particles) {}

SharedState::SharedState(const nlohmann::json& description)
    : particles_(description.at("particles")),
      memory_(description.at("segment").get<int>()),
      vectors_(static_cast<glm::dvec3*>(memory_.data()), 2 * particles_) {}

nlohmann::json SharedState::description() const {
    return {{"particles", particles_}, {"segment", memory_.segment()}};
}

nlohmann::json SharedState::put(const State& state) {
    if (std::max(state.displacement.size(), state.increment.size()) > particles_)
        throw std::runtime_error("gave a state of " +
                                 std::to_string(std::max(state.displacement.size(), state.increment.size())) +
                                 " particles of a problem of " + std::to_string(particles_));
    std::copy(state.displacement.begin(), state.displacement.end(), vectors_.begin());
    std::copy(state.increment.begin(), state.increment.end(), vectors_.begin() + std::ptrdiff_t(particles_));
    return {state.displacement.size(), state.increment.size()};
}

void SharedState::take(const nlohmann::json& sizes, State& state) const {
    const auto displacements = vectors_.first(sizes.at(0).get<std::size_t>());
    const auto increments = vectors_.subspan(particles_, sizes.at(1).get<std::size_t>());
    state.displacement.assign(displacements.begin(), displacements.end());
    state.increment.assign(increments.begin(), increments.end());
}

}  // namespace voxspring
