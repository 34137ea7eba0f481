// The kernels that run between steps (cuda/kernels/between_steps.cu), compiled and loaded for the current
// device.
#pragma once

#include <memory>

#include "backends/backend.h"
#include "cuda/device/device.h"
#include "cuda/device/kernel.h"

namespace voxspring::cuda {

/// Each by the name that it has in between_steps.cu.
struct SupportKernels {
    std::shared_ptr<const Kernel> gather_border, scatter_border, check_words, check_axes, write_particle_bits,
        write_bare_words, write_slots_and_bits, write_rows, write_slices, write_springs, write_short_argument,
        write_long_argument, feed, pull_held_particles, measure_lengths, measure_springs,
        measure_inverse_roots;
};

/// Compiles and loads those of `Real` on the device, which is current, unless that has been done. `time`
/// grows by what compiling takes: it is the start of each backend that pays for it, even where another one
/// did. A kernel that is first loaded by its launch may wait until nothing runs on the device, and cannot be
/// captured.
template <class Real>
void load_support_kernels(const Device& device, CompileTime& time);

/// Those of the current device, where load_support_kernels() has been called.
template <class Real>
const SupportKernels& support_kernels();

/// Those of either precision, for kernels in which there is no number of that precision.
const SupportKernels& any_support_kernels();

/// Launches one thread for each of `count` elements, in blocks of 128; nothing where there are none.
template <class... Arguments>
void launch_for_each(const Kernel& kernel, std::size_t count, const Stream& stream,
                     const Arguments&... arguments) {
    constexpr unsigned block = 128;
    if (count == 0) return;
    kernel.launch(stream, dim3(unsigned((count + block - 1) / block)), dim3(block), 0, arguments...);
}

}  // namespace voxspring::cuda
