#include "harness/process/shared_state.h"

#include <sys/mman.h>

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>

namespace voxspring {

std::size_t SharedState::bytes() const { return std::max<std::size_t>(1, vectors_.size_bytes()); }

SharedState::SharedState(std::size_t particles) : particles_(particles) {
    const std::size_t size = std::max<std::size_t>(1, 2 * particles * sizeof(glm::dvec3));
    void* memory =
        mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (memory == MAP_FAILED)
        throw std::system_error(errno, std::generic_category(), "cannot share memory with another process");
    vectors_ = {static_cast<glm::dvec3*>(memory), 2 * particles};
}

SharedState::~SharedState() { munmap(vectors_.data(), bytes()); }

nlohmann::json SharedState::put(const State& state) {
    if (std::max(state.displacement.size(), state.increment.size()) > particles_)
        throw std::runtime_error("gave a state of " +
                                 std::to_string(std::max(state.displacement.size(), state.increment.size())) +
                                 " particles of a problem of " + std::to_string(particles_));
    std::copy(state.displacement.begin(), state.displacement.end(), vectors_.begin());
    std::copy(state.increment.begin(), state.increment.end(), vectors_.begin() + std::ptrdiff_t(particles_));
    return {state.displacement.size(), state.increment.size()};
}

State SharedState::take(const nlohmann::json& sizes) {
    const auto displacements = vectors_.first(sizes.at(0).get<std::size_t>());
    const auto increments = vectors_.subspan(particles_, sizes.at(1).get<std::size_t>());
    State state;
    state.displacement.assign(displacements.begin(), displacements.end());
    state.increment.assign(increments.begin(), increments.end());
    madvise(vectors_.data(), bytes(), MADV_REMOVE);
    return state;
}

}  // namespace voxspring
