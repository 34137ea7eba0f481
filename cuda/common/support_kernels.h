// The kernels that run between steps (cuda/kernels/between_steps.cu), compiled and loaded for the current
// device.
#pragma once

#include <algorithm>
#include <memory>

#include "backends/backend.h"
#include "cuda/device/device.h"
#include "cuda/device/kernel.h"

namespace voxspring::cuda {

/// Expands X(name) for each kernel of between_steps.cu.
// clang-format off
#define SUPPORT_KERNELS(X) \
    X(gather_border) X(scatter_border) X(exchange_borders) X(check_words) X(check_axes) \
    X(write_particle_bits) X(write_bare_words) X(write_slots_and_bits) \
    X(write_rows) X(write_slices) X(write_springs) \
    X(write_short_argument) X(write_long_argument) \
    X(feed) X(pull_held_particles) \
    X(hash_words) X(measure_lengths) X(measure_springs) X(measure_inverse_roots)
// clang-format on
struct SupportKernels {
#define MEMBER(name) std::shared_ptr<const Kernel> name;
    SUPPORT_KERNELS(MEMBER)
#undef MEMBER
};

/// Compiles and loads the kernels of `Real` on the current device, `device`, unless this process has done so.
/// The time that compiling takes is added to `time`. The kernels are loaded here because a kernel that is
/// loaded only by its first launch may wait until nothing runs on the device, and cannot be captured.
template <class Real>
void load_support_kernels(const Device& device, CompileTime& time);

/// The kernels on the current device. Throws DeviceError unless load_support_kernels() has been called there.
template <class Real>
const SupportKernels& support_kernels();

/// The kernels for float or for double, whichever are loaded. Use only those that do not depend on Real.
const SupportKernels& any_support_kernels();

/// Launches one thread for each of `count` elements, in blocks of 128. Launches nothing if there are none.
template <class... Arguments>
void launch_for_each(const Kernel& kernel, std::size_t count, const Stream& stream,
                     const Arguments&... arguments) {
    constexpr unsigned block = 128;
    if (count == 0) return;
    kernel.launch(stream, dim3(unsigned((count + block - 1) / block)), dim3(block), 0, arguments...);
}

/// Launches few blocks, whose threads stride over `count` elements. The blocks are so few that two atomic
/// operations per warp cost next to nothing. Launches nothing if there are no elements.
template <class... Arguments>
void launch_striding(const Kernel& kernel, std::size_t count, const Stream& stream,
                     const Arguments&... arguments) {
    constexpr std::size_t block = 256, max_blocks = 1024;
    if (count == 0) return;
    const auto blocks = unsigned(std::min(max_blocks, (count + block - 1) / block));
    kernel.launch(stream, dim3(blocks), dim3(unsigned(block)), 0, arguments...);
}

}  // namespace voxspring::cuda
