#include "cuda/device/kernel.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace voxspring::cuda {

namespace {

std::shared_ptr<const Library> load_library(const CompiledKernel& compiled) {
    cudaLibrary_t library{};
    check(cudaLibraryLoadData(&library, compiled.code.data(), nullptr, nullptr, 0, nullptr, nullptr, 0));
    return std::make_shared<const Library>(library);
}

}  // namespace

std::shared_ptr<const Kernel> Kernel::get(const KernelSource& source, const Device& device, CompileTime& time,
                                          const std::string& name) {
    struct Loaded {
        KernelSource source;
        int architecture;
        std::shared_ptr<const Library> library;
        std::map<std::string, std::shared_ptr<const Kernel>> kernels;
    };
    static std::vector<Loaded> loaded;
    static std::mutex mutex;
    const std::lock_guard lock(mutex);
    auto found = std::find_if(loaded.begin(), loaded.end(), [&](const Loaded& known) {
        return known.source == source && known.architecture == device.architecture;
    });
    if (found == loaded.end()) {
        const CompiledKernel compiled = compile(source, device.architecture);
        time += {compiled.found ? 0 : compiled.seconds, compiled.seconds};
        loaded.push_back({source, device.architecture, load_library(compiled), {}});
        found = std::prev(loaded.end());
    }
    std::shared_ptr<const Kernel>& kernel = found->kernels[name];
    if (kernel == nullptr) kernel = std::make_shared<const Kernel>(found->library, name);
    kernel->load();
    return kernel;
}

Kernel::Kernel(std::shared_ptr<const Library> library, const std::string& name)
    : library_(std::move(library)) {
    cudaKernel_t kernel{};
    check(cudaLibraryGetKernel(&kernel, library_->get(), name.c_str()));
    kernel_ = reinterpret_cast<const void*>(kernel);
}

unsigned Kernel::blocks_at_once(const Device& device, unsigned block) const {
    int blocks = 0;
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel_, int(block), 0));
    if (blocks < 1)
        throw DeviceError("a multiprocessor has no room for one block of the kernel, which has " +
                          std::to_string(block) + " threads");
    return unsigned(blocks * device.multiprocessors);
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
    cudaFuncAttributes attributes{};
    check(cudaFuncGetAttributes(&attributes, kernel_));
    if (int(bytes) > attributes.maxDynamicSharedSizeBytes)
        check(cudaFuncSetAttribute(kernel_, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)));
}

}  // namespace voxspring::cuda
