// A kernel that was compiled for this process's card, and its launch.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "backends/backend.h"
#include "cuda/device/compiler.h"
#include "cuda/device/device.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

using Library = Handle<cudaLibrary_t, cudaLibraryUnload>;

/// Shared by all that launch it, on any device of its architecture.
class Kernel {
public:
    /// Compiles what this process has not loaded yet, and loads its function `name` on the device, which is
    /// current. Any thread may call this; one at a time compiles. `time` grows by what compiling took.
    static std::shared_ptr<const Kernel> get(const KernelSource& source, const Device& device,
                                             CompileTime& time, const std::string& name = kernel_name);

    Kernel(std::shared_ptr<const Library> library, const std::string& name);

    /// Blocks of `block` threads that the device, which is current, holds at once.
    unsigned blocks_at_once(const Device& device, unsigned block) const;
    /// Registers that a thread begins with.
    int registers() const;
    /// Lets a block have `bytes` of shared memory, where that is more than every kernel may have.
    void allow_shared(std::size_t bytes) const;
    template <class... Arguments>
    void launch(const Stream& stream, dim3 grid, dim3 block, std::size_t shared_bytes,
                const Arguments&... arguments) const {
        std::array<void*, sizeof...(Arguments)> pointers{const_cast<Arguments*>(&arguments)...};
        check(cudaLaunchKernel(kernel_, grid, block, pointers.data(), shared_bytes, stream.get()));
    }

    /// Begins before what was launched in the stream before it has ended: it waits for that itself
    /// (programmatic dependent launch). From compute capability 9.0 on.
    template <class... Arguments>
    void launch_dependent(const Stream& stream, dim3 grid, dim3 block, std::size_t shared_bytes,
                          const Arguments&... arguments) const {
        cudaLaunchAttribute dependent{};
        dependent.id = cudaLaunchAttributeProgrammaticStreamSerialization;
        dependent.val.programmaticStreamSerializationAllowed = 1;
        launch_with(dependent, stream, grid, block, shared_bytes, arguments...);
    }

    /// All blocks at once, which may wait for each other (a cooperative launch).
    template <class... Arguments>
    void launch_together(const Stream& stream, dim3 grid, dim3 block, std::size_t shared_bytes,
                         const Arguments&... arguments) const {
        cudaLaunchAttribute together{};
        together.id = cudaLaunchAttributeCooperative;
        together.val.cooperative = 1;
        launch_with(together, stream, grid, block, shared_bytes, arguments...);
    }

private:
    template <class... Arguments>
    void launch_with(cudaLaunchAttribute attribute, const Stream& stream, dim3 grid, dim3 block,
                     std::size_t shared_bytes, const Arguments&... arguments) const {
        std::array<void*, sizeof...(Arguments)> pointers{const_cast<Arguments*>(&arguments)...};
        cudaLaunchConfig_t config{};
        config.gridDim = grid;
        config.blockDim = block;
        config.dynamicSmemBytes = shared_bytes;
        config.stream = stream.get();
        config.attrs = &attribute;
        config.numAttrs = 1;
        check(cudaLaunchKernelExC(&config, kernel_, pointers.data()));
    }

    /// On the current device, where that has not happened: it must not happen first in a capture.
    void load() const;

    std::shared_ptr<const Library> library_;  ///< shared by all kernels of a file
    const void* kernel_ = nullptr;            // a cudaKernel_t, which launches like a function's address
};

}  // namespace voxspring::cuda
