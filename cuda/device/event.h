// A time stamp in a stream.
#pragma once

#include "cuda/device/stream.h"

namespace voxspring::cuda {

class Event {
public:
    Event() {
        cudaEvent_t event{};
        check(cudaEventCreate(&event));
        handle_ = Handle<cudaEvent_t, cudaEventDestroy>(event);
    }
    void record(const Stream& stream) { check(cudaEventRecord(handle_.get(), stream.get())); }
    void wait() const { check(cudaEventSynchronize(handle_.get())); }
    /// Seconds from `begin` to this one, both of which the device has passed.
    double seconds_since(const Event& begin) const {
        float milliseconds = 0;
        check(cudaEventElapsedTime(&milliseconds, begin.handle_.get(), handle_.get()));
        return 1e-3 * double(milliseconds);
    }

private:
    Handle<cudaEvent_t, cudaEventDestroy> handle_;
};

}  // namespace voxspring::cuda
