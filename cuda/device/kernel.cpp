#include "cuda/device/kernel.h"

#include <mutex>
#include <utility>
#include <vector>

namespace voxspring::cuda {

std::shared_ptr<const Kernel> Kernel::get(const KernelSource& source, const Device& device,
                                          CompileTime& time) {
    struct Loaded {
        KernelSource source;
        int architecture;
        std::shared_ptr<const Kernel> kernel;
    };
    static std::vector<Loaded> loaded;
    static std::mutex mutex;
    const std::lock_guard lock(mutex);
    for (const Loaded& known : loaded) {
        if (known.source != source || known.architecture != device.architecture()) continue;
        known.kernel->load();
        return known.kernel;
    }
    const CompiledKernel compiled = compile(source, device.architecture());
    time += {compiled.found ? 0 : compiled.seconds, compiled.seconds};
    auto kernel = std::make_shared<const Kernel>(compiled);
    kernel->load();
    return loaded.emplace_back(Loaded{source, device.architecture(), std::move(kernel)}).kernel;
}

Kernel::Kernel(const CompiledKernel& compiled) {
    cudaLibrary_t library{};
    check(cudaLibraryLoadData(&library, compiled.code.data(), nullptr, nullptr, 0, nullptr, nullptr, 0));
    library_ = Library(library);
    cudaKernel_t kernel{};
    check(cudaLibraryGetKernel(&kernel, library, kernel_name));
    kernel_ = reinterpret_cast<const void*>(kernel);
}

void Kernel::load() const {
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, kernel_));
}

int Kernel::registers() const {
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, kernel_));
    return attributes.numRegs;
}

void Kernel::allow_shared(std::size_t bytes) const {
    constexpr std::size_t without_asking = 48U << 10U;
    if (bytes > without_asking)
        check(cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)));
}

}  // namespace voxspring::cuda
