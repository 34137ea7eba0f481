// A stream, in which work runs in order.
#pragma once

#include "cuda/device/handle.h"

namespace voxspring::cuda {

/// Independent of the legacy default stream.
class Stream {
public:
    Stream() {
        cudaStream_t stream{};
        check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
        handle_ = Handle<cudaStream_t, cudaStreamDestroy>(stream);
    }
    /// One whose work begins before that of others wherever the device has room for either.
    static Stream with_priority() {
        int least = 0, greatest = 0;
        check(cudaDeviceGetStreamPriorityRange(&least, &greatest));
        cudaStream_t stream{};
        check(cudaStreamCreateWithPriority(&stream, cudaStreamNonBlocking, greatest));
        return Stream(stream);
    }
    cudaStream_t get() const { return handle_.get(); }
    /// Wait for everything enqueued; errors of that work surface here.
    void synchronize() const { check(cudaStreamSynchronize(get())); }
    /// Whether all of it has ended, well or not; does not wait.
    bool has_ended() const {
        if (cudaStreamQuery(get()) != cudaErrorNotReady) return true;
        // That was an answer and no error: the next to ask for the latest error has nothing to do with it.
        static_cast<void>(cudaGetLastError());
        return false;
    }

private:
    explicit Stream(cudaStream_t stream) : handle_(stream) {}

    Handle<cudaStream_t, cudaStreamDestroy> handle_;
};

}  // namespace voxspring::cuda
