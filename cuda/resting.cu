#include "cuda/resting.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned threads = 256;

/// A thread a block. What is not lively says that it was not stepped.
__global__ void list_kernel(BlockReports reports, const BlockOrigin* all, unsigned count, BlockOrigin* lively,
                            unsigned* lively_count) {
    const unsigned b = blockIdx.x * threads + threadIdx.x;
    BlockOrigin origin{};
    bool listed = false;
    if (b < count) {
        origin = all[b];
        listed = is_lively(reports, origin.report);
        if (!listed) reports.after[origin.report] = 0;
    }
    // A warp's blocks stay together: neighbours share what they fetch.
    const unsigned warp = __ballot_sync(~0U, int(listed));
    const unsigned lane = threadIdx.x % 32;
    unsigned first = 0;
    if (lane == 0 && warp != 0) first = atomicAdd(lively_count, unsigned(__popc(warp)));
    first = __shfl_sync(~0U, first, 0);
    if (listed) lively[first + unsigned(__popc(warp & ((1U << lane) - 1)))] = origin;
}

}  // namespace

void Resting::enqueue_list(int reading, const Stream& stream) const {
    const auto count = unsigned(all_.size());
    list_kernel<<<(count + threads - 1) / threads, threads, 0, stream.get()>>>(
        reports(reading), all_.data(), count, listed_.data(), counts_.data() + reading);
    cuda::check(cudaGetLastError());
}

}  // namespace voxspring::cuda
