// A point in a stream. Streams and the host can wait until the device has passed that point, and two such
// events tell the time between them.
#pragma once

#include "cuda/device/stream.h"

namespace voxspring::cuda {

class Event {
public:
    /// An event of the current device, to be recorded in streams of that device.
    Event() : Event(cudaEventDefault) {}
    /// A cheaper event, for which seconds_since() does not work.
    static Event without_time() { return Event(cudaEventDisableTiming); }

    void record(const Stream& stream) { check(cudaEventRecord(handle_.get(), stream.get())); }
    /// Makes `stream`, of any device, wait until the device has passed the point where this event was last
    /// recorded.
    void hold(const Stream& stream) const { check(cudaStreamWaitEvent(stream.get(), handle_.get(), 0)); }
    void wait() const { check(cudaEventSynchronize(handle_.get())); }
    /// Seconds from `begin` to this event. The device must have passed both.
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
