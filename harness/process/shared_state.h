// A state that processes hand to each other.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <span>

#include "backends/physics/problem.h"
#include "harness/process/shared_memory.h"

namespace voxspring {

/// Room for the state of one problem, the same memory in this process and in all that have its description.
/// One state at a time: what is put in is to be taken out before the next.
class SharedState {
public:
    /// Takes no memory before something is put in. Throws std::system_error.
    explicit SharedState(std::size_t particles);
    /// The room that another process, which still has it, describes. Throws std::system_error.
    explicit SharedState(const nlohmann::json& description);
    SharedState(const SharedState&) = delete;
    SharedState& operator=(const SharedState&) = delete;

    nlohmann::json description() const;

    /// Returns what take() needs to know: the sizes, which are for the receiver to judge. Throws
    /// std::runtime_error for a state of more particles than there is room for.
    nlohmann::json put(const State& state);
    /// Copies the state out to where an earlier one may have been: new memory for each would take longer than
    /// the copy.
    void take(const nlohmann::json& sizes, State& state) const;

private:
    std::size_t particles_;
    SharedMemory memory_;
    std::span<glm::dvec3> vectors_;  ///< displacements, then increments
};

}  // namespace voxspring
