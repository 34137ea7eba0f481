// A point in a stream. Streams and the host can wait until the device has passed it, and two of them tell the
// time in between.
#pragma once

#include "cuda/device/stream.h"

namespace voxspring::cuda {

class Event {
public:
    /// An event of the current device, to be recorded in streams of that device.
    Event() : Event(cudaEventDefault) {}
    /// A cheaper event that knows no time.
    static Event without_time() { return Event(cudaEventDisableTiming); }

    void record(const Stream& stream) { check(cudaEventRecord(handle_.get(), stream.get())); }
    /// Makes `stream`, of any device, wait until the device has passed the point where this was last
    /// recorded.
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
