#include "cuda/device/kernel.h"

#include <utility>
#include <vector>

namespace voxspring::cuda {

std::shared_ptr<const Kernel> Kernel::get(const KernelSource& source, const Device& device,
                                          CompileTime& time) {
    static std::vector<std::pair<KernelSource, std::shared_ptr<const Kernel>>> loaded;
    for (const auto& [known, kernel] : loaded) {
        if (known == source) return kernel;
    }
    const CompiledKernel compiled = compile(source, device.architecture());
    time += {compiled.found ? 0 : compiled.seconds, compiled.seconds};
    return loaded.emplace_back(source, std::make_shared<const Kernel>(compiled)).second;
}

Kernel::Kernel(const CompiledKernel& compiled) {
    cudaLibrary_t library{};
    check(cudaLibraryLoadData(&library, compiled.code.data(), nullptr, nullptr, 0, nullptr, nullptr, 0));
    library_ = Library(library);
    cudaKernel_t kernel{};
    check(cudaLibraryGetKernel(&kernel, library, kernel_name));
    kernel_ = reinterpret_cast<const void*>(kernel);
    // Loads its code, which must not happen first in a capture.
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, kernel_));
}

void Kernel::allow_shared(std::size_t bytes) const {
    constexpr std::size_t without_asking = 48U << 10U;
    if (bytes > without_asking)
        check(cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)));
}

}  // namespace voxspring::cuda
