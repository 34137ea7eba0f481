// Memory that several processes of this host have.
#pragma once

#include <cstddef>

namespace voxspring {

/// A segment of zeros, the same memory in this process and in all that attach to its number. It goes with the
/// last process that has it, however that ends. Page-aligned.
class SharedMemory {
public:
    /// Takes no memory before something is written. Throws std::system_error.
    static SharedMemory of_bytes(std::size_t bytes);
    /// The segment of a process that still has it. Throws std::system_error.
    explicit SharedMemory(int segment);
    SharedMemory(const SharedMemory&) = delete;
    SharedMemory& operator=(const SharedMemory&) = delete;
    ~SharedMemory();

    int segment() const { return segment_; }
    void* data() const { return data_; }

private:
    int segment_;  ///< of System V's shared memory
    void* data_;
};

}  // namespace voxspring
