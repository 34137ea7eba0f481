#include "cuda/device/nccl.h"

#include <dlfcn.h>

#include <string>

#include "backends/backend.h"

namespace voxspring::cuda {
namespace {

constexpr const char* library_name = "libnccl.so.2";

template <class Function>
void find(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(dlsym(library, name));
    if (function == nullptr) throw Unavailable(std::string(library_name) + " has no " + name);
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

NcclRanks::NcclRanks(const Nccl& nccl, int ranks, const NcclId& id, int rank) : nccl_(nccl) {
    nccl.check(nccl.init_rank_(&communicator_, ranks, id, rank));
}

NcclRanks::~NcclRanks() { static_cast<void>(nccl_.abort_(communicator_)); }

void NcclRanks::send(const void* from, std::size_t bytes, int to, const Stream& stream) const {
    nccl_.check(nccl_.send_(from, bytes, Nccl::bytes, to, communicator_, stream.get()));
}

void NcclRanks::receive(void* to, std::size_t bytes, int from, const Stream& stream) const {
    nccl_.check(nccl_.receive_(to, bytes, Nccl::bytes, from, communicator_, stream.get()));
}

}  // namespace voxspring::cuda
