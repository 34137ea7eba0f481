// Memory shared by several processes of this host, and a state that they pass to each other through it.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>

#include "backends/physics/problem.h"

namespace voxspring {

/// A page-aligned segment of memory, zero at first, shared by this process and all that attach to its number.
/// The system frees it when the last of these processes has ended, in whatever way.
class SharedMemory {
public:
    /// A new segment. Memory is allocated only as it is written. Throws std::system_error.
    static SharedMemory of_bytes(std::size_t bytes);
    /// Attaches to a segment, which another process must still have. Throws std::system_error.
    explicit SharedMemory(int segment);
    SharedMemory(const SharedMemory&) = delete;
    SharedMemory& operator=(const SharedMemory&) = delete;
    ~SharedMemory();

    int segment() const { return segment_; }
    void* data() const { return data_; }

private:
    int segment_;  ///< id of System V's shared memory
    void* data_;
};

/// Room for the state of one problem, shared by this process and all that are given its description(). It
/// holds one state at a time: a state must be taken out before the next is put in.
class SharedState {
public:
    /// New room for this many particles. Memory is allocated only as it is written. Throws std::system_error.
    explicit SharedState(std::size_t particles);
    /// The room that another process described and must still have. Throws std::system_error.
    explicit SharedState(const nlohmann::json& description);
    SharedState(const SharedState&) = delete;
    SharedState& operator=(const SharedState&) = delete;

    nlohmann::json description() const;

    /// Puts a state in. Returns the sizes of its lists, which take() needs. Throws std::runtime_error if the
    /// state has more particles than there is room for.
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
