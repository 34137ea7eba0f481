// NCCL, whose library is opened at run time if it is installed. The build does not need it.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>

#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// The id by which ranks find each other. It has the layout of ncclUniqueId, which NCCL's functions take by
/// value.
struct NcclId {
    std::array<char, 128> bytes;
};

/// NCCL's library, and those of its functions that this program calls.
class Nccl {
public:
    /// Opens the library at the first call. If it cannot be opened, this call and every later one throw
    /// Unavailable with the reason.
    static const Nccl& load();

    NcclId new_id() const;

private:
    friend class NcclRanks;
    using Status = int;  ///< 0: success
    using Communicator = void*;
    // NCCL's functions take this enumerator of ncclDataType_t, which in C is an int.
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

/// One rank of an NCCL communicator. Each rank has its device and its thread.
class NcclRanks {
public:
    /// Starts this rank on the current device. Returns once all ranks have started. Throws DeviceError if
    /// NCCL fails, or has not started within `limit`. NCCL's start waits for all ranks and for the network
    /// and cannot be cancelled, so a separate thread waits for it. After a timeout that thread is left behind
    /// until NCCL's start or the process ends.
    ///
    /// The start does not use ncclConfig_t::blocking = 0, which would return at once: with such a
    /// communicator, recent versions of ncclGroupEnd() start a thread for every group of transfers, which
    /// would add to the time of each step.
    NcclRanks(const Nccl& nccl, int ranks, const NcclId& id, int rank,
              std::chrono::duration<double> limit = std::chrono::minutes(2));
    NcclRanks(const NcclRanks&) = delete;
    NcclRanks& operator=(const NcclRanks&) = delete;
    /// Unless end() has freed the communicator, aborts it and all transfers that are under way.
    ~NcclRanks();

    /// Waits for the transfers that are under way, and frees the communicator. Returns once all ranks have
    /// called end(). No other member may be called afterwards. Throws DeviceError if NCCL fails.
    void end();

    /// Calls `transfers`, and enqueues the sends and receives that it makes as one group: none of them waits
    /// for another.
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
