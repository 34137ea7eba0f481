#include "cuda/common/support_kernels.h"

#include <array>
#include <atomic>
#include <deque>
#include <mutex>
#include <string>

#include "cuda/device/check.h"

namespace voxspring::cuda {
namespace {

/// The tables below have room for this many devices of one host.
constexpr std::size_t max_devices = 64;

/// The kernels of `Real` on each device; null if they are not loaded there.
template <class Real>
std::array<std::atomic<const SupportKernels*>, max_devices> kernels_by_device;

std::size_t current_device() {
    int device = 0;
    check(cudaGetDevice(&device));
    return std::size_t(device);
}

template <class Real>
SupportKernels load(const Device& device, CompileTime& time) {
    const KernelSource source{"between_steps.cu",
                              {{"REAL", sizeof(Real) == sizeof(float) ? "float" : "double"}}};
    SupportKernels loaded;
#define LOAD(name) loaded.name = Kernel::get(source, device, time, #name);
    SUPPORT_KERNELS(LOAD)
#undef LOAD
    return loaded;
}

}  // namespace

template <class Real>
void load_support_kernels(const Device& device, CompileTime& time) {
    static std::mutex mutex;
    static std::deque<SupportKernels> loaded;
    const std::lock_guard lock(mutex);
    std::atomic<const SupportKernels*>& kernels = kernels_by_device<Real>.at(std::size_t(device.number));
    if (kernels == nullptr) kernels = &loaded.emplace_back(load<Real>(device, time));
}

template <class Real>
const SupportKernels& support_kernels() {
    const SupportKernels* const kernels = kernels_by_device<Real>.at(current_device());
    if (kernels == nullptr)
        throw DeviceError("the kernels that run between steps are not loaded on the current device");
    return *kernels;
}

const SupportKernels& any_support_kernels() {
    const SupportKernels* const kernels = kernels_by_device<float>.at(current_device());
    return kernels != nullptr ? *kernels : support_kernels<double>();
}

template void load_support_kernels<float>(const Device&, CompileTime&);
template void load_support_kernels<double>(const Device&, CompileTime&);
template const SupportKernels& support_kernels<float>();
template const SupportKernels& support_kernels<double>();

}  // namespace voxspring::cuda
