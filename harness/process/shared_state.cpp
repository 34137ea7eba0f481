#include "harness/process/shared_state.h"

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <string>

namespace voxspring {

namespace {

/// Copies on all cores, since one core takes most of a second for the state of 16 million particles. For few
/// particles one core is done before the others have woken.
void copy(std::span<const glm::dvec3> from, glm::dvec3* to) {
    constexpr std::size_t few = 65536;
#pragma omp parallel for schedule(static) if (from.size() > few)
    for (std::ptrdiff_t i = 0; i < std::ptrdiff_t(from.size()); ++i) to[i] = from[std::size_t(i)];
}

}  // namespace

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
    copy(state.displacement, vectors_.data());
    copy(state.increment, vectors_.data() + particles_);
    return {state.displacement.size(), state.increment.size()};
}

void SharedState::take(const nlohmann::json& sizes, State& state) const {
    const auto displacements = vectors_.first(sizes.at(0).get<std::size_t>());
    const auto increments = vectors_.subspan(particles_, sizes.at(1).get<std::size_t>());
    state.displacement.resize(displacements.size());
    state.increment.resize(increments.size());
    copy(displacements, state.displacement.data());
    copy(increments, state.increment.data());
}

}  // namespace voxspring
