#include "harness/process/shared_state.h"

#include <sys/shm.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>

#include "backends/physics/huge_pages.h"

namespace voxspring {
namespace {

[[noreturn]] void refuse_to_share(int error) {
    throw std::system_error(error, std::generic_category(), "cannot share memory with another process");
}

/// Copies by all threads, since one core takes most of a second for the state of 16 million particles. Few
/// particles are copied on one core, which is done before the others have woken.
void copy(std::span<const glm::dvec3> from, glm::dvec3* to) {
    constexpr std::size_t few = 65536;
#pragma omp parallel for schedule(static) if (from.size() > few)
    for (std::ptrdiff_t i = 0; i < std::ptrdiff_t(from.size()); ++i) to[i] = from[std::size_t(i)];
}

}  // namespace

// The memory is a System V segment, since a file in memory would be subject to the limit on the size of
// files.
SharedMemory SharedMemory::of_bytes(std::size_t bytes) {
    const int segment =
        shmget(IPC_PRIVATE, std::max<std::size_t>(1, bytes), IPC_CREAT | SHM_NORESERVE | 0600);
    if (segment < 0) refuse_to_share(errno);
    // On return this object marks the segment for removal. Linux removes it once the last process has
    // detached, and until then lets further processes attach.
    const std::shared_ptr<void> removal(nullptr, [=](void*) { shmctl(segment, IPC_RMID, nullptr); });
    return SharedMemory(segment);
}

SharedMemory::SharedMemory(int segment) : segment_(segment), data_(shmat(segment, nullptr, 0)) {
    if (std::bit_cast<std::intptr_t>(data_) == -1) refuse_to_share(errno);
}

SharedMemory::~SharedMemory() { shmdt(data_); }

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
    const std::size_t particles = std::max(state.displacement.size(), state.increment.size());
    if (particles > particles_)
        throw std::runtime_error("the backend returned a state of " + std::to_string(particles) +
                                 " particles for a problem of " + std::to_string(particles_));
    copy(state.displacement, vectors_.data());
    copy(state.increment, vectors_.data() + particles_);
    return {state.displacement.size(), state.increment.size()};
}

void SharedState::take(const nlohmann::json& sizes, State& state) const {
    const auto displacements = vectors_.first(sizes.at(0).get<std::size_t>());
    const auto increments = vectors_.subspan(particles_, sizes.at(1).get<std::size_t>());
    resize_in_huge_pages(state.displacement, displacements.size());
    resize_in_huge_pages(state.increment, increments.size());
    copy(displacements, state.displacement.data());
    copy(increments, state.increment.data());
}

}  // namespace voxspring
