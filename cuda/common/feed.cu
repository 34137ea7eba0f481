#include "cuda/common/feed.h"

// The system's own, which cuda_gl_interop.h names types of.
#include <GL/gl.h>
#include <cuda_gl_interop.h>

#include <utility>
#include <vector>

#include "cuda/device/buffer.h"
#include "cuda/device/check.h"
#include "cuda/device/handle.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 128;

template <class Real>
__global__ void feed_kernel(Feeding<Real> feeding, FedDisplacement* displacements) {
    const std::size_t n = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (n < feeding.count) displacements[n] = fed_displacement(feeding, n);
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

    void write() override {
        if (fed_.size() == 0) return;
        Feeding<Real> feeding = feeding_();
        feeding.fed = fed_.data();
        feeding.count = fed_.size();
        cudaGraphicsResource_t resource = resource_.get();
        check(cudaGraphicsMapResources(1, &resource, stream_.get()));
        void* displacements = nullptr;
        std::size_t bytes = 0;
        check(cudaGraphicsResourceGetMappedPointer(&displacements, &bytes, resource));
        const auto blocks = unsigned((feeding.count + block - 1) / block);
        feed_kernel<<<blocks, block, 0, stream_.get()>>>(feeding,
                                                         static_cast<FedDisplacement*>(displacements));
        check(cudaGetLastError());
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

}  // namespace

template <class Real>
std::unique_ptr<Feed> make_feed(const std::vector<FedWord<Real>>& fed, std::uint32_t buffer,
                                const Stream& stream, std::function<Feeding<Real>()> feeding) {
    cudaGraphicsResource_t resource = nullptr;
    const cudaError_t refused =
        cudaGraphicsGLRegisterBuffer(&resource, buffer, cudaGraphicsRegisterFlagsWriteDiscard);
    if (refused != cudaSuccess) {
        cudaGetLastError();  // has been seen
        return nullptr;
    }
    return std::make_unique<WindowFeed<Real>>(Resource(resource), fed, stream, std::move(feeding));
}

template std::unique_ptr<Feed> make_feed(const std::vector<FedWord<float>>&, std::uint32_t, const Stream&,
                                         std::function<Feeding<float>()>);
template std::unique_ptr<Feed> make_feed(const std::vector<FedWord<double>>&, std::uint32_t, const Stream&,
                                         std::function<Feeding<double>()>);

}  // namespace voxspring::cuda
