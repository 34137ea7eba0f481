#include "cuda/common/feed.h"

// The system's header, whose types cuda_gl_interop.h names.
#include <GL/gl.h>
#include <cuda_gl_interop.h>

#include <glm/vec4.hpp>
#include <span>
#include <utility>
#include <vector>

#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"
#include "cuda/device/check.h"
#include "cuda/device/handle.h"
#include "cuda/device/pinned.h"

namespace voxspring::cuda {
namespace {

/// Enqueues the kernel that writes what `feeding` names to `displacements`, which the device can reach.
template <class Real>
void enqueue_feed(Feeding<Real> feeding, const Buffer<FedWord<Real>>& fed, void* displacements,
                  const Stream& stream) {
    feeding.fed = fed.data();
    feeding.count = fed.size();
    launch_for_each(*support_kernels<Real>().feed, feeding.count, stream, feeding, displacements);
}

/// To be called before the buffers of a feed are freed, since freeing waits for whatever the device runs.
/// Asking `feeding` ends a launch that waits for ticks; otherwise such a launch would end only when its
/// patience does.
template <class Real>
void end_launch(const std::function<Feeding<Real>()>& feeding) noexcept {
    try {
        static_cast<void>(feeding());
    } catch (const DeviceError&) {
        // The launch has ended. The next call that steps reports why.
    }
}

using Resource = Handle<cudaGraphicsResource_t, cudaGraphicsUnregisterResource>;

template <class Real>
class WindowFeed final : public Feed {
public:
    WindowFeed(Resource resource, const std::vector<FedWord<Real>>& fed, const Stream& stream,
               std::function<Feeding<Real>()> feeding)
        : resource_(std::move(resource)), stream_(stream), feeding_(std::move(feeding)) {
        fed_.upload(fed, stream);
    }
    WindowFeed(const WindowFeed&) = delete;
    WindowFeed& operator=(const WindowFeed&) = delete;
    ~WindowFeed() override { end_launch(feeding_); }

    void write() override {
        if (fed_.size() == 0) return;
        const Feeding<Real> feeding = feeding_();
        cudaGraphicsResource_t resource = resource_.get();
        check(cudaGraphicsMapResources(1, &resource, stream_.get()));
        void* displacements = nullptr;
        std::size_t bytes = 0;
        check(cudaGraphicsResourceGetMappedPointer(&displacements, &bytes, resource));
        enqueue_feed(feeding, fed_, displacements, stream_);
        // OpenGL's commands from here on come after the kernel.
        check(cudaGraphicsUnmapResources(1, &resource, stream_.get()));
        stream_.synchronize();
    }

private:
    Resource resource_;
    const Stream& stream_;
    std::function<Feeding<Real>()> feeding_;
    Buffer<FedWord<Real>> fed_;
};

/// A feed whose kernel writes to the host's memory itself. A copy of so few bytes would be one more command
/// that waits for its turn.
template <class Real>
class PinnedFeed final : public HostFeed {
public:
    PinnedFeed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
               std::function<Feeding<Real>()> feeding)
        : stream_(stream), feeding_(std::move(feeding)) {
        fed_.upload(fed, stream);
        displacements_.resize(fed.size());
    }
    PinnedFeed(const PinnedFeed&) = delete;
    PinnedFeed& operator=(const PinnedFeed&) = delete;
    ~PinnedFeed() override { end_launch(feeding_); }

    std::span<const glm::vec4> read() override {
        if (fed_.size() == 0) return {};
        enqueue_feed(feeding_(), fed_, displacements_.data(), stream_);
        stream_.synchronize();
        return displacements_.values();
    }

private:
    const Stream& stream_;
    std::function<Feeding<Real>()> feeding_;
    Buffer<FedWord<Real>> fed_;
    static_assert(sizeof(glm::vec4) == sizeof(FedDisplacement));
    Pinned<glm::vec4> displacements_;
};

}  // namespace

template <class Real>
std::unique_ptr<Feed> make_feed(const std::vector<FedWord<Real>>& fed, std::uint32_t buffer,
                                const Stream& stream, std::function<Feeding<Real>()> feeding) {
    cudaGraphicsResource_t resource = nullptr;
    const cudaError_t refused =
        cudaGraphicsGLRegisterBuffer(&resource, buffer, cudaGraphicsRegisterFlagsWriteDiscard);
    if (refused != cudaSuccess) {
        cudaGetLastError();  // clears the error, which was handled here
        return nullptr;
    }
    return std::make_unique<WindowFeed<Real>>(Resource(resource), fed, stream, std::move(feeding));
}

template <class Real>
std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                         std::function<Feeding<Real>()> feeding) {
    return std::make_unique<PinnedFeed<Real>>(fed, stream, std::move(feeding));
}

template std::unique_ptr<Feed> make_feed(const std::vector<FedWord<float>>&, std::uint32_t, const Stream&,
                                         std::function<Feeding<float>()>);
template std::unique_ptr<Feed> make_feed(const std::vector<FedWord<double>>&, std::uint32_t, const Stream&,
                                         std::function<Feeding<double>()>);
template std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<float>>&, const Stream&,
                                                  std::function<Feeding<float>()>);
template std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<double>>&, const Stream&,
                                                  std::function<Feeding<double>()>);

}  // namespace voxspring::cuda
