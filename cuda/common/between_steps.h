// The host's side of kernels that run between steps: rest lengths measured with the device's inverse root
// (physics/inverse_root.h), the divergence monitor's check, and the hash of arrays (physics/state_hash.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "backends/layout/records/springs.h"
#include "backends/layout/state_hash.h"
#include "cuda/common/support_kernels.h"
#include "cuda/device/buffer.h"
#include "cuda/kernels/divergence_check.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// Replaces each squared length by what `kernel` computes from it on the device.
template <class Real>
void measure_on_device(const Kernel& kernel, std::span<Real> squared, const Stream& stream) {
    Buffer<Real> values;
    values.upload(squared, stream);
    launch_for_each(kernel, values.size(), stream, values.data(), values.size());
    values.download(squared, stream);
}
/// Replaces each squared length by measured_or_zero() of it, computed on the device.
template <class Real>
void calibrate_rest_lengths(std::span<Real> squared, const Stream& stream) {
    measure_on_device(*support_kernels<Real>().measure_lengths, squared, stream);
}
/// Replaces the squared rest length of every spring by measured_or_zero() of it, computed on the device.
template <class Real>
void calibrate_rest_lengths(const Buffer<SpringConstants<Real>>& springs, const Stream& stream) {
    launch_for_each(*support_kernels<Real>().measure_springs, springs.size(), stream, springs.data(),
                    springs.size());
    stream.synchronize();
}

struct DivergenceCheck {
    std::int64_t step;         ///< the check is made after this step
    std::int64_t last_check;   ///< the step of the previous check
    double largest_increment;  ///< the largest |x(t) - x(t - dt)| that passes
};

/// Enqueues a check of the first `count` elements of `particles`. `kernel`: check_words or check_axes,
/// whichever takes the type of `particles`. In a structure of arrays, elements without a particle pass: they
/// are finite and do not move. Before the first check the caller fills `first` with the largest numbers of
/// its type.
template <class Real, template <class> class Particles>
void launch_divergence_check(const Kernel& kernel, const Particles<Real>& particles, std::size_t count,
                             const DivergenceCheck& parameters, FirstDivergence* first,
                             const Stream& stream) {
    const auto max_squared = Real(parameters.largest_increment * parameters.largest_increment);
    const auto step = static_cast<long long>(parameters.step);
    const auto last_check = static_cast<long long>(parameters.last_check);
    launch_striding(kernel, count, stream, particles, count, max_squared, step, last_check, first);
}

/// Hashes arrays on the device, so that only the sums travel to the host.
class StateHash {
public:
    explicit StateHash(const Stream& stream) : stream_(stream) {
        sums_.resize(layout::HashSums().size());
        sums_.fill_with_zeros(stream);
    }

    template <class T>
    void add(const Buffer<T>& buffer) {
        static_assert(sizeof(T) % sizeof(std::uint32_t) == 0);
        const unsigned number = arrays_++;
        const std::size_t count = buffer.bytes() / sizeof(std::uint32_t);
        const void* const words = buffer.data();
        launch_striding(*any_support_kernels().hash_words, count, stream_, words, count, number,
                        sums_.data());
    }
    std::string text() const {
        layout::HashSums sums;
        sums_.download(sums, stream_);
        return layout::text_of(sums);
    }

private:
    const Stream& stream_;
    Buffer<std::uint32_t> sums_;
    unsigned arrays_ = 0;
};

}  // namespace voxspring::cuda
