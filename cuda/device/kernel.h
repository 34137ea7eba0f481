// A kernel that was compiled for this process's card, and its launch.
#pragma once

#include <array>
#include <memory>

#include "cuda/compiler.h"
#include "cuda/device/device.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

using Library = Handle<cudaLibrary_t, cudaLibraryUnload>;

/// Shared by all that launch it.
class Kernel {
public:
    /// Compiles and loads what this process has not loaded yet. `seconds` grows by what compiling took.
    static std::shared_ptr<const Kernel> get(const KernelSource& source, const Device& device,
                                             double& seconds);

    explicit Kernel(const CompiledKernel& compiled);

    /// Lets a block have `bytes` of shared memory, where that is more than every kernel may have.
    void allow_shared(std::size_t bytes) const;
    template <class... Arguments>
    void launch(const Stream& stream, dim3 grid, dim3 block, std::size_t shared_bytes,
                const Arguments&... arguments) const {
        std::array<void*, sizeof...(Arguments)> pointers{const_cast<Arguments*>(&arguments)...};
        check(cudaLaunchKernel(kernel_, grid, block, pointers.data(), shared_bytes, stream.get()));
    }

private:
    Library library_;
    const void* kernel_ = nullptr;  // a cudaKernel_t, which launches like a function's address
};

}  // namespace voxspring::cuda
