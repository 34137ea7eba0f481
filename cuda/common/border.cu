#include <cstring>
#include <utility>

#include "cuda/common/border.h"
#include "cuda/device/check.h"
#include "cuda/device/event.h"
#include "cuda/device/pinned.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 128;

__device__ std::size_t thread_number() { return std::size_t(blockIdx.x) * blockDim.x + threadIdx.x; }

template <class Real>
__global__ void gather_kernel(BorderPlaces<Real> places, Real* message) {
    if (thread_number() < places.count) gather_place(places, thread_number(), message);
}

template <class Real>
__global__ void scatter_kernel(BorderPlaces<Real> places, const Real* message) {
    if (thread_number() < places.count) scatter_place(places, thread_number(), message);
}

unsigned blocks_for(std::size_t count) { return unsigned((count + block - 1) / block); }

/// By way of the host's memory, which the kernels read and write themselves.
template <class Real>
class HostBorder final : public Border {
public:
    HostBorder(const std::vector<std::uint32_t>& elements, BorderState<Real> state)
        : state_(std::move(state)) {
        elements_.upload(elements, state_.stream);
        message_.resize(places().numbers());
    }

    std::size_t bytes() const override { return message_.bytes(); }
    void read(std::byte* to) const override {
        gather_places(places(), message_.data(), state_.stream);
        state_.stream.synchronize();
        if (bytes() != 0) std::memcpy(to, message_.data(), bytes());
    }
    void write(const std::byte* from) override {
        if (bytes() == 0) return;
        taken_.wait();  // the message before, which may still be read
        std::memcpy(message_.data(), from, bytes());
        scatter_places(places(), message_.data(), state_.stream);
        taken_.record(state_.stream);
        state_.written();
    }

private:
    BorderPlaces<Real> places() const { return state_.places(elements_); }

    const BorderState<Real> state_;
    Buffer<std::uint32_t> elements_;
    Pinned<Real> message_;
    Event taken_;
};

}  // namespace

template <class Real>
void gather_places(const BorderPlaces<Real>& places, Real* message, const Stream& stream) {
    if (places.count == 0) return;
    gather_kernel<<<blocks_for(places.count), block, 0, stream.get()>>>(places, message);
    check(cudaGetLastError());
}

template <class Real>
void scatter_places(const BorderPlaces<Real>& places, const Real* message, const Stream& stream) {
    if (places.count == 0) return;
    scatter_kernel<<<blocks_for(places.count), block, 0, stream.get()>>>(places, message);
    check(cudaGetLastError());
}

template <class Real>
std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>& elements, BorderState<Real> state) {
    return std::make_unique<HostBorder<Real>>(elements, std::move(state));
}

#define FOR_PRECISION(Real)                                                              \
    template void gather_places(const BorderPlaces<Real>&, Real*, const Stream&);        \
    template void scatter_places(const BorderPlaces<Real>&, const Real*, const Stream&); \
    template std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>&, BorderState<Real>);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::cuda
