// A state that processes pass to each other through shared memory.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>

#include "backends/physics/problem.h"
#include "harness/process/shared_memory.h"

namespace voxspring {

/// Room for the state of one problem, shared by this process and all that have its description. It holds one
/// state at a time: a state must be taken out before the next is put in.
class SharedState {
public:
    /// New room. Memory is allocated only as it is written. Throws std::system_error.
    explicit SharedState(std::size_t particles);
    /// The room that another process describes, which must still have it. Throws std::system_error.
    explicit SharedState(const nlohmann::json& description);
    SharedState(const SharedState&) = delete;
    SharedState& operator=(const SharedState&) = delete;

    nlohmann::json description() const;

    /// Puts a state in. Returns its sizes, which take() needs and the receiver checks. Throws
    /// std::runtime_error if the state has more particles than there is room for.
    nlohmann::json put(const State& state);
    /// Copies the state out into `state`, whose memory is reused: allocating new memory would take longer
    /// than the copy.
    void take(const nlohmann::json& sizes, State& state) const;

private:
    std::size_t particles_;
    SharedMemory memory_;
    std::span<glm::dvec3> vectors_;  ///< displacements, then increments
};

}  // namespace voxspring
