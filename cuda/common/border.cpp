#include "cuda/common/border.h"

#include <cstring>
#include <utility>

#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {
namespace {

/// A border whose messages are in pinned host memory, which the kernels read and write themselves.
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
        taken_.wait();  // the device may still be reading the previous message
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
    launch_for_each(*support_kernels<Real>().gather_border, places.count, stream, places, message);
}

template <class Real>
void scatter_places(const BorderPlaces<Real>& places, const Real* message, const Stream& stream) {
    launch_for_each(*support_kernels<Real>().scatter_border, places.count, stream, places, message);
}

template <class Real>
void exchange_places(const BorderPlaces<Real>& places, const BorderLinks<Real>& links,
                     const ExchangeLaunch& launch, const WaitLimit& limit, const Stream& stream) {
    if (links.size() == 0) return;
    const Kernel& kernel = *support_kernels<Real>().exchange_borders;
    const dim3 grid(launch.blocks, unsigned(links.size())), block(exchange_threads);
    const BorderLink<Real>* const first = links.data();
    kernel.launch_dependent_if(launch.dependent, stream, grid, block, 0, places, first, launch.stores,
                               launch.takes, limit);
}

template <class Real>
std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>& elements, BorderState<Real> state) {
    return std::make_unique<HostBorder<Real>>(elements, std::move(state));
}

template void gather_places(const BorderPlaces<float>&, float*, const Stream&);
template void scatter_places(const BorderPlaces<float>&, const float*, const Stream&);
template void exchange_places(const BorderPlaces<float>&, const BorderLinks<float>&, const ExchangeLaunch&,
                              const WaitLimit&, const Stream&);
template std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>&, BorderState<float>);
template void gather_places(const BorderPlaces<double>&, double*, const Stream&);
template void scatter_places(const BorderPlaces<double>&, const double*, const Stream&);
template void exchange_places(const BorderPlaces<double>&, const BorderLinks<double>&, const ExchangeLaunch&,
                              const WaitLimit&, const Stream&);
template std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>&, BorderState<double>);

}  // namespace voxspring::cuda
