// Streams, in which work runs in order; events, which are points in streams; and graphs, which replay work.
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
    /// A stream of the highest priority: if the device has room for the work of one stream only, this
    /// stream's work begins first.
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

/// A point in a stream. Streams and the host can wait until the device has passed that point, and two such
/// events tell the time between them.
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

/// Work that is captured from a stream once. Each launch() replays it.
class Graph {
public:
    /// Captures the work that `enqueue()` puts into `stream`, and into streams that then wait for events in
    /// it. The work does not run until launch().
    template <class Enqueue>
    static Graph capture(const Stream& stream, Enqueue enqueue) {
        check(cudaStreamBeginCapture(stream.get(), cudaStreamCaptureModeThreadLocal));
        cudaGraph_t graph{};
        try {
            enqueue();
        } catch (...) {
            // Ends the capture, so that the stream can be destroyed.
            if (cudaStreamEndCapture(stream.get(), &graph) == cudaSuccess)
                static_cast<void>(cudaGraphDestroy(graph));
            // The error is already on its way as an exception. Clear it, so that no later call reports it.
            static_cast<void>(cudaGetLastError());
            throw;
        }
        check(cudaStreamEndCapture(stream.get(), &graph));
        const Handle<cudaGraph_t, cudaGraphDestroy> owner(graph);
        cudaGraphExec_t executable{};
        check(cudaGraphInstantiate(&executable, graph, 0));
        Graph captured;
        captured.handle_ = Handle<cudaGraphExec_t, cudaGraphExecDestroy>(executable);
        check(cudaGraphUpload(executable, stream.get()));
        return captured;
    }
    void launch(const Stream& stream) const { check(cudaGraphLaunch(handle_.get(), stream.get())); }

private:
    Graph() = default;
    Handle<cudaGraphExec_t, cudaGraphExecDestroy> handle_;
};

}  // namespace voxspring::cuda
