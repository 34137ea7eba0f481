// NCCL, opened at run time where it is installed: nothing of it is needed to build.
#pragma once

#include <array>
#include <chrono>
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
    Status (*finalize_)(Communicator);
    Status (*destroy_)(Communicator);
    Status (*abort_)(Communicator);
    Status (*group_start_)();
    Status (*group_end_)();
    Status (*send_)(const void*, std::size_t, int type, int rank, Communicator, cudaStream_t);
    Status (*receive_)(void*, std::size_t, int type, int rank, Communicator, cudaStream_t);
};

/// One of several ranks, each on a device of its own and in a thread of its own.
class NcclRanks {
public:
    /// On the current device. Returns once all have called it. Throws DeviceError, and so where NCCL has not
    /// started within `limit`: its start waits for all ranks and for the network, and cannot be given up. The
    /// thread in which it waits is then left behind for the end of the process.
    ///
    /// It is not a start with ncclConfig_t::blocking = 0: of a communicator that began so, every group of
    /// transfers starts a thread (ncclGroupEnd() of recent versions), which would be in the time of each
    /// step.
    NcclRanks(const Nccl& nccl, int ranks, const NcclId& id, int rank,
              std::chrono::duration<double> limit = std::chrono::minutes(2));
    NcclRanks(const NcclRanks&) = delete;
    NcclRanks& operator=(const NcclRanks&) = delete;
    /// What is not finished then is given up, and so are the transfers that are under way.
    ~NcclRanks();

    /// Waits for the transfers that are under way, and ends. Returns once all ranks have called it; nothing
    /// else is to be called afterwards. Throws DeviceError.
    void end();

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
