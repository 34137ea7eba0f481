// NCCL, opened at run time where it is installed: nothing of it is needed to build.
#pragma once

#include <array>
#include <cstddef>

#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// What ranks find each other by. As NCCL has it, which takes it by value.
struct NcclId {
    std::array<char, 128> bytes;
};

/// The library and those of its functions that are called here.
class Nccl {
public:
    /// Opened by the first call. Throws Unavailable, with the reason, where there is none; always again.
    static const Nccl& load();

    NcclId new_id() const;

private:
    friend class NcclRanks;
    using Status = int;  ///< 0: success
    using Communicator = void*;
    // In C an enumerator is an int.
    static constexpr int bytes = 0;  ///< ncclInt8

    Nccl();
    void check(Status status) const;

    void* library_;
    const char* (*error_text_)(Status);
    Status (*get_unique_id_)(NcclId*);
    Status (*init_rank_)(Communicator*, int ranks, NcclId id, int rank);
    Status (*abort_)(Communicator);
    Status (*group_start_)();
    Status (*group_end_)();
    Status (*send_)(const void*, std::size_t, int type, int rank, Communicator, cudaStream_t);
    Status (*receive_)(void*, std::size_t, int type, int rank, Communicator, cudaStream_t);
};

/// One of several ranks, each on a device of its own and in a thread of its own.
class NcclRanks {
public:
    /// On the current device. Returns once all have called it. Throws DeviceError.
    NcclRanks(const Nccl& nccl, int ranks, const NcclId& id, int rank);
    NcclRanks(const NcclRanks&) = delete;
    NcclRanks& operator=(const NcclRanks&) = delete;
    /// What is not finished then is given up.
    ~NcclRanks();

    /// Enqueues the sends and receipts of `transfers`, none of which waits for another.
    template <class Transfers>
    void together(const Transfers& transfers) const {
        nccl_.check(nccl_.group_start_());
        transfers();
        nccl_.check(nccl_.group_end_());
    }
    void send(const void* from, std::size_t bytes, int to, const Stream& stream) const;
    void receive(void* to, std::size_t bytes, int from, const Stream& stream) const;

private:
    const Nccl& nccl_;
    Nccl::Communicator communicator_ = nullptr;
};

}  // namespace voxspring::cuda
