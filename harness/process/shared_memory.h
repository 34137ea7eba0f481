// Memory shared by several processes of this host.
#pragma once

#include <cstddef>

namespace voxspring {

/// A page-aligned segment, zero at first, shared by this process and all that attach to its number. It is
/// freed with the last process that has it, however that ends.
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
    int segment_;  ///< of System V's shared memory
    void* data_;
};

}  // namespace voxspring
