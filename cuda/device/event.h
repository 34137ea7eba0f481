// A point in a stream: when the device passed it, and what waits until it has.
#pragma once

#include "cuda/device/stream.h"

namespace voxspring::cuda {

class Event {
public:
    /// Of the current device, as the streams are that it is recorded in.
    Event() : Event(cudaEventDefault) {}
    /// One that is cheaper, and knows no time.
    static Event without_time() { return Event(cudaEventDisableTiming); }

    void record(const Stream& stream) { check(cudaEventRecord(handle_.get(), stream.get())); }
    /// Has `stream`, of any device, go on only once the device has passed where this was recorded last.
    void hold(const Stream& stream) const { check(cudaStreamWaitEvent(stream.get(), handle_.get(), 0)); }
    void wait() const { check(cudaEventSynchronize(handle_.get())); }
    /// Seconds from `begin` to this one, both of which the device has passed.
    double seconds_since(const Event& begin) const {
        float milliseconds = 0;
        check(cudaEventElapsedTime(&milliseconds, begin.handle_.get(), handle_.get()));
        return 1e-3 * double(milliseconds);
    }

private:
    explicit Event(unsigned flags) {
        cudaEvent_t event{};
        check(cudaEventCreateWithFlags(&event, flags));
        handle_ = Handle<cudaEvent_t, cudaEventDestroy>(event);
    }

    Handle<cudaEvent_t, cudaEventDestroy> handle_;
};

}  // namespace voxspring::cuda
