// Work captured once and replayed with one call.
#pragma once

#include "cuda/device/stream.h"

namespace voxspring::cuda {

class Graph {
public:
    /// Captures the work that `enqueue()` puts into `stream`. The work does not run until launch().
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
