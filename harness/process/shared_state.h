// Memory that several processes of this host share, and a State that they pass to each other through it.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>

#include "backends/physics/problem.h"

namespace voxspring {

/// A page-aligned segment of memory, zero at first. Other processes attach to it by its number, segment().
/// The system frees the segment when the last process that is attached detaches or ends, in whatever way.
class SharedMemory {
public:
    /// Makes a segment. Its pages are allocated when they are first accessed. Throws std::system_error.
    static SharedMemory of_bytes(std::size_t bytes);
    /// Attaches to a segment to which another process is still attached. Throws std::system_error.
    explicit SharedMemory(int segment);
    SharedMemory(const SharedMemory&) = delete;
    SharedMemory& operator=(const SharedMemory&) = delete;
    ~SharedMemory();

    int segment() const { return segment_; }
    void* data() const { return data_; }

private:
    int segment_;  ///< the ID of a System V shared memory segment
    void* data_;
};

/// Shared memory for one state of a problem. Other processes attach to it by its description(). It holds one
/// state at a time: put() overwrites the previous state, so take() must be called before the next put().
class SharedState {
public:
    /// Makes shared memory for a state of this many particles. Throws std::system_error.
    explicit SharedState(std::size_t particles);
    /// Attaches to the shared memory that has this description() in another process, which must still be
    /// attached to it. Throws std::system_error.
    explicit SharedState(const nlohmann::json& description);
    SharedState(const SharedState&) = delete;
    SharedState& operator=(const SharedState&) = delete;

    nlohmann::json description() const;

    /// Copies `state` into the shared memory. Returns the sizes of its lists, which take() needs. Throws
    /// std::runtime_error if the state has too many particles.
    nlohmann::json put(const State& state);
    /// Copies the state from the shared memory to `state`, whose memory is reused: allocating new memory
    /// would take longer than the copy.
    void take(const nlohmann::json& sizes, State& state) const;

private:
    std::size_t particles_;
    SharedMemory memory_;
    std::span<glm::dvec3> vectors_;  ///< displacements, then increments
};

}  // namespace voxspring
