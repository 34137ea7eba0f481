#include "cuda/common/feed.h"

// The system's OpenGL header: cuda_gl_interop.h uses its types.
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

namespace voxspring::cuda {
namespace {

/// The particles of a feed, and the kernel that writes their displacements.
template <class Real>
class FeedKernel {
public:
    FeedKernel(const std::vector<FedWord<Real>>& fed, const Stream& stream,
               std::function<Feeding<Real>()> feeding)
        : stream_(stream), feeding_(std::move(feeding)) {
        fed_.upload(fed, stream);
    }
    FeedKernel(const FeedKernel&) = delete;
    FeedKernel& operator=(const FeedKernel&) = delete;
    /// Freeing the buffers of a feed waits until the device is idle. A launch that goes on and waits for the
    /// host's next order (Ticks) would keep the device busy up to its time limit. Calling feeding_() first
    /// ends that launch.
    ~FeedKernel() {
        try {
            static_cast<void>(feeding_());
        } catch (const DeviceError&) {
            // The launch has ended. The next call that waits for the device reports why.
        }
    }
    bool empty() const { return fed_.size() == 0; }
    /// Asks where the particles are now. That also ends a launch that waits for the host's next order
    /// (Ticks).
    Feeding<Real> feeding() const {
        Feeding<Real> feeding = feeding_();
        feeding.fed = fed_.data();
        feeding.count = fed_.size();
        return feeding;
    }
    /// Enqueues the kernel that writes the displacements of the particles in `feeding` to `displacements`,
    /// which the device can reach.
    void enqueue(const Feeding<Real>& feeding, void* displacements) const {
        launch_for_each(*support_kernels<Real>().feed, feeding.count, stream_, feeding, displacements);
    }
    const Stream& stream() const { return stream_; }

private:
    const Stream& stream_;
    std::function<Feeding<Real>()> feeding_;
    Buffer<FedWord<Real>> fed_;
};

using Resource = Handle<cudaGraphicsResource_t, cudaGraphicsUnregisterResource>;

template <class Real>
class WindowFeed final : public Feed {
public:
    WindowFeed(Resource resource, const std::vector<FedWord<Real>>& fed, const Stream& stream,
               std::function<Feeding<Real>()> feeding)
        : resource_(std::move(resource)), kernel_(fed, stream, std::move(feeding)) {}

    void write() override {
        if (kernel_.empty()) return;
        const Feeding<Real> feeding = kernel_.feeding();
        const Stream& stream = kernel_.stream();
        cudaGraphicsResource_t resource = resource_.get();
        check(cudaGraphicsMapResources(1, &resource, stream.get()));
        void* displacements = nullptr;
        std::size_t bytes = 0;
        check(cudaGraphicsResourceGetMappedPointer(&displacements, &bytes, resource));
        kernel_.enqueue(feeding, displacements);
        // OpenGL commands that are issued after this call run after the kernel.
        check(cudaGraphicsUnmapResources(1, &resource, stream.get()));
        stream.synchronize();
    }

private:
    Resource resource_;
    FeedKernel<Real> kernel_;
};

/// A feed whose kernel writes into pinned host memory. A separate copy of these few bytes to the host would
/// be one more command that waits for its turn.
template <class Real>
class PinnedFeed final : public HostFeed {
public:
    PinnedFeed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
               std::function<Feeding<Real>()> feeding)
        : kernel_(fed, stream, std::move(feeding)) {
        displacements_.resize(fed.size());
    }

    std::span<const glm::vec4> read() override {
        if (kernel_.empty()) return {};
        kernel_.enqueue(kernel_.feeding(), displacements_.data());
        kernel_.stream().synchronize();
        return displacements_.values();
    }

private:
    static_assert(sizeof(glm::vec4) == sizeof(FedDisplacement));
    Pinned<glm::vec4> displacements_;
    // Declared last, so destroyed first: its destructor ends a launch for which the freeing of the memory
    // above would wait.
    FeedKernel<Real> kernel_;
};

/// A feed into an array on the device, for another library.
template <class Real>
class ArrayFeed final : public DeviceFeed {
public:
    ArrayFeed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
              std::function<Feeding<Real>()> feeding)
        : kernel_(fed, stream, std::move(feeding)) {
        displacements_.resize(fed.size());
        check(cudaGetDevice(&device_));
    }

    const void* read() override {
        if (kernel_.empty()) return nullptr;
        kernel_.enqueue(kernel_.feeding(), displacements_.data());
        kernel_.stream().synchronize();
        return displacements_.data();
    }
    int device() const override { return device_; }

private:
    int device_ = 0;
    Buffer<glm::vec4> displacements_;
    // Declared last, so destroyed first: its destructor ends a launch for which the freeing of the memory
    // above would wait.
    FeedKernel<Real> kernel_;
};

}  // namespace

template <class Real>
std::unique_ptr<Feed> make_feed(const std::vector<FedWord<Real>>& fed, std::uint32_t buffer,
                                const Stream& stream, std::function<Feeding<Real>()> feeding) {
    cudaGraphicsResource_t resource = nullptr;
    const cudaError_t refused =
        cudaGraphicsGLRegisterBuffer(&resource, buffer, cudaGraphicsRegisterFlagsWriteDiscard);
    if (refused != cudaSuccess) {
        cudaGetLastError();  // clears the error, since returning null handles it
        return nullptr;
    }
    return std::make_unique<WindowFeed<Real>>(Resource(resource), fed, stream, std::move(feeding));
}

template <class Real>
std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                         std::function<Feeding<Real>()> feeding) {
    return std::make_unique<PinnedFeed<Real>>(fed, stream, std::move(feeding));
}

template <class Real>
std::unique_ptr<DeviceFeed> make_device_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                             std::function<Feeding<Real>()> feeding) {
    return std::make_unique<ArrayFeed<Real>>(fed, stream, std::move(feeding));
}

template std::unique_ptr<Feed> make_feed(const std::vector<FedWord<float>>&, std::uint32_t, const Stream&,
                                         std::function<Feeding<float>()>);
template std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<float>>&, const Stream&,
                                                  std::function<Feeding<float>()>);
template std::unique_ptr<DeviceFeed> make_device_feed(const std::vector<FedWord<float>>&, const Stream&,
                                                      std::function<Feeding<float>()>);
template std::unique_ptr<Feed> make_feed(const std::vector<FedWord<double>>&, std::uint32_t, const Stream&,
                                         std::function<Feeding<double>()>);
template std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<double>>&, const Stream&,
                                                  std::function<Feeding<double>()>);
template std::unique_ptr<DeviceFeed> make_device_feed(const std::vector<FedWord<double>>&, const Stream&,
                                                      std::function<Feeding<double>()>);

}  // namespace voxspring::cuda
