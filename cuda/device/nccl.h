// NCCL, opened at run time if it is installed. It is not needed to build.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>

#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// The id by which ranks find each other, with the layout of NCCL's type, which is passed by value.
struct NcclId {
    std::array<char, 128> bytes;
};

/// The library and the functions of it that are called here.
class Nccl {
public:
    /// Opens the library at the first call. Throws Unavailable, with the reason, where there is none, and
    /// does so at every call.
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

/// One of several ranks, each on a separate device and in a separate thread.
class NcclRanks {
public:
    /// Starts this rank on the current device. Returns once all ranks have started. Throws DeviceError, also
    /// if NCCL has not started within `limit`: its start waits for all ranks and for the network and cannot
    /// be cancelled. The thread that waits for it is then left behind until the process ends.
    ///
    /// The start does not use ncclConfig_t::blocking = 0: with such a communicator every group of transfers
    /// starts a thread (ncclGroupEnd() of recent versions), which would add to the time of each step.
    NcclRanks(const Nccl& nccl, int ranks, const NcclId& id, int rank,
              std::chrono::duration<double> limit = std::chrono::minutes(2));
    NcclRanks(const NcclRanks&) = delete;
    NcclRanks& operator=(const NcclRanks&) = delete;
    /// Aborts the communicator unless end() was called, with all transfers that are under way.
    ~NcclRanks();

    /// Waits for the transfers that are under way, and ends. Returns once all ranks have called end(); no
    /// other member may be called afterwards. Throws DeviceError.
    void end();

    /// Enqueues the sends and receives that `transfers` calls, as one group: none of them waits for another.
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
