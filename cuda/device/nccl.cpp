#include "cuda/device/nccl.h"

#include <dlfcn.h>

#include <cmath>
#include <exception>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "backends/backend.h"
#include "cuda/device/check.h"

namespace voxspring::cuda {
namespace {

constexpr const char* library_name = "libnccl.so.2";

template <class Function>
void find(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(dlsym(library, name));
    if (function == nullptr) throw Unavailable(std::string(library_name) + " has no function " + name);
}

}  // namespace

const Nccl& Nccl::load() {
    static const Nccl nccl;
    return nccl;
}

Nccl::Nccl() : library_(dlopen(library_name, RTLD_NOW | RTLD_LOCAL)) {
    if (library_ == nullptr) {
        const char* const reason = dlerror();
        throw Unavailable("no NCCL: " + std::string(reason != nullptr ? reason : library_name));
    }
    find(library_, "ncclGetErrorString", error_text_);
    find(library_, "ncclGetUniqueId", get_unique_id_);
    find(library_, "ncclCommInitRank", init_rank_);
    find(library_, "ncclCommFinalize", finalize_);
    find(library_, "ncclCommDestroy", destroy_);
    find(library_, "ncclCommAbort", abort_);
    find(library_, "ncclGroupStart", group_start_);
    find(library_, "ncclGroupEnd", group_end_);
    find(library_, "ncclSend", send_);
    find(library_, "ncclRecv", receive_);
}

void Nccl::check(Status status) const {
    if (status != 0) throw DeviceError(std::string("NCCL: ") + error_text_(status));
}

NcclId Nccl::new_id() const {
    NcclId id{};
    check(get_unique_id_(&id));
    return id;
}

NcclRanks::NcclRanks(const Nccl& nccl, int ranks, const NcclId& id, int rank,
                     std::chrono::duration<double> limit)
    : nccl_(nccl) {
    int device = 0;
    cuda::check(cudaGetDevice(&device));
    const auto promise = std::make_shared<std::promise<Nccl::Communicator>>();
    std::future<Nccl::Communicator> started = promise->get_future();
    std::thread([promise, &nccl, ranks, id, rank, device] {
        try {
            cuda::check(cudaSetDevice(device));
            Nccl::Communicator communicator = nullptr;
            nccl.check(nccl.init_rank_(&communicator, ranks, id, rank));
            promise->set_value(communicator);
        } catch (...) {
            promise->set_exception(std::current_exception());
        }
    }).detach();
    if (started.wait_for(limit) != std::future_status::ready)
        throw DeviceError("NCCL did not start within " + std::to_string(std::lround(limit.count())) +
                          " s; with the environment variable NCCL_DEBUG=INFO it prints what it waits for");
    communicator_ = started.get();
}

NcclRanks::~NcclRanks() {
    if (communicator_ != nullptr) static_cast<void>(nccl_.abort_(communicator_));
}

void NcclRanks::end() {
    nccl_.check(nccl_.finalize_(communicator_));
    nccl_.check(nccl_.destroy_(std::exchange(communicator_, nullptr)));
}

void NcclRanks::send(const void* from, std::size_t bytes, int to, const Stream& stream) const {
    nccl_.check(nccl_.send_(from, bytes, Nccl::bytes, to, communicator_, stream.get()));
}

void NcclRanks::receive(void* to, std::size_t bytes, int from, const Stream& stream) const {
    nccl_.check(nccl_.receive_(to, bytes, Nccl::bytes, from, communicator_, stream.get()));
}

}  // namespace voxspring::cuda
