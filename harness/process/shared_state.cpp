#include "harness/process/shared_state.h"

#include <sys/mman.h>
#include <sys/shm.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <system_error>

namespace voxspring {

namespace {

[[noreturn]] void refuse() {
    throw std::system_error(errno, std::generic_category(), "cannot share memory with another process");
}

}  // namespace

std::size_t SharedState::bytes() const {
    return std::max<std::size_t>(1, 2 * particles_ * sizeof(glm::dvec3));
}

// A file in memory would meet a limit on the size of files, which this does not.
SharedState::SharedState(std::size_t particles) : particles_(particles) {
    segment_ = shmget(IPC_PRIVATE, bytes(), SHM_NORESERVE | 0600);
    if (segment_ < 0) refuse();
    try {
        attach();
    } catch (...) {
        shmctl(segment_, IPC_RMID, nullptr);
        throw;
    }
    // It goes with the last process that has it, however that ends; Linux lets further ones attach until
    // then.
    shmctl(segment_, IPC_RMID, nullptr);
}

SharedState::SharedState(const nlohmann::json& description)
    : particles_(description.at("particles")), segment_(description.at("segment")) {
    attach();
}

void SharedState::attach() {
    void* memory = shmat(segment_, nullptr, 0);
    if (std::bit_cast<std::intptr_t>(memory) == -1) refuse();
    vectors_ = {static_cast<glm::dvec3*>(memory), 2 * particles_};
}

SharedState::~SharedState() { shmdt(vectors_.data()); }

nlohmann::json SharedState::description() const { return {{"particles", particles_}, {"segment", segment_}}; }

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
