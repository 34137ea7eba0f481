// The functions of NCCL that cuda/device/nccl.cpp calls. tests/device_borders_test.cpp, which has the
// streams, answers them.
#include <cstddef>

struct Id {
    char bytes[128];
};

extern "C" {

int fake_nccl_init(void** communicator, int ranks, int rank);
int fake_nccl_end(void* communicator, const char* how);
int fake_nccl_transfer(void* memory, std::size_t bytes, int peer, void* communicator, void* stream,
                       bool sends);

const char* ncclGetErrorString(int) { return "an error of the fake"; }
int ncclGetUniqueId(Id* id) {
    *id = {};
    return 0;
}
int ncclCommInitRank(void** communicator, int ranks, Id, int rank) {
    return fake_nccl_init(communicator, ranks, rank);
}
int ncclCommFinalize(void* communicator) { return fake_nccl_end(communicator, "finalized"); }
int ncclCommDestroy(void* communicator) { return fake_nccl_end(communicator, "destroyed"); }
int ncclCommAbort(void* communicator) { return fake_nccl_end(communicator, "aborted"); }
int ncclGroupStart() { return 0; }
int ncclGroupEnd() { return 0; }
int ncclSend(const void* from, std::size_t bytes, int, int to, void* communicator, void* stream) {
    return fake_nccl_transfer(const_cast<void*>(from), bytes, to, communicator, stream, true);
}
int ncclRecv(void* to, std::size_t bytes, int, int from, void* communicator, void* stream) {
    return fake_nccl_transfer(to, bytes, from, communicator, stream, false);
}
}
