#include "harness/process/shared_memory.h"

#include <sys/shm.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <system_error>

namespace voxspring {
namespace {

[[noreturn]] void refuse_to_share(int error) {
    throw std::system_error(error, std::generic_category(), "cannot share memory with another process");
}

/// Marks the segment for removal once the last process detaches. Until then Linux lets further processes
/// attach.
struct Removal {
    int segment;
    ~Removal() { shmctl(segment, IPC_RMID, nullptr); }
};

}  // namespace

// A System V segment, since a file in memory would be subject to the limit on the size of files.
SharedMemory SharedMemory::of_bytes(std::size_t bytes) {
    const int segment =
        shmget(IPC_PRIVATE, std::max<std::size_t>(1, bytes), IPC_CREAT | SHM_NORESERVE | 0600);
    if (segment < 0) refuse_to_share(errno);
    const Removal when_attached{segment};
    return SharedMemory(segment);
}

SharedMemory::SharedMemory(int segment) : segment_(segment), data_(shmat(segment, nullptr, 0)) {
    if (std::bit_cast<std::intptr_t>(data_) == -1) refuse_to_share(errno);
}

SharedMemory::~SharedMemory() { shmdt(data_); }

}  // namespace voxspring
