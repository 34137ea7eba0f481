// A stream, in which work runs in order.
#pragma once

#include "cuda/device/handle.h"

namespace voxspring::cuda {

/// A stream that is independent of the legacy default stream.
class Stream {
public:
    Stream() {
        cudaStream_t stream{};
        check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
        handle_ = Handle<cudaStream_t, cudaStreamDestroy>(stream);
    }
    /// A stream whose work begins before that of other streams wherever the device has room for only one.
    static Stream with_priority() {
        int least = 0, greatest = 0;
        check(cudaDeviceGetStreamPriorityRange(&least, &greatest));
        cudaStream_t stream{};
        check(cudaStreamCreateWithPriority(&stream, cudaStreamNonBlocking, greatest));
        return Stream(stream);
    }
    cudaStream_t get() const { return handle_.get(); }
    /// Waits for everything enqueued. Errors of that work surface here.
    void synchronize() const { check(cudaStreamSynchronize(get())); }
    /// Whether all enqueued work has ended, with or without an error. Does not wait.
    bool has_ended() const {
        if (cudaStreamQuery(get()) != cudaErrorNotReady) return true;
        // "Not ready" is an answer, not an error. Clear it, so that no later call reports it.
        static_cast<void>(cudaGetLastError());
        return false;
    }

private:
    explicit Stream(cudaStream_t stream) : handle_(stream) {}

    Handle<cudaStream_t, cudaStreamDestroy> handle_;
};

}  // namespace voxspring::cuda
