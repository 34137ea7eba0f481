// A kernel that was compiled for a card's architecture, and its launch.
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

/// A loaded kernel. All backends of a process share one object per source, function name and architecture.
class Kernel {
public:
    /// Calls compile() if this process has not done so yet for the source and architecture, and loads the
    /// function `name` on the current device, `device`. Any thread may call this; only one compiles at a
    /// time. The time that compiling took is added to `time`.
    static std::shared_ptr<const Kernel> get(const KernelSource& source, const Device& device,
                                             CompileTime& time, const std::string& name = kernel_name);

    Kernel(std::shared_ptr<const Library> library, const std::string& name);

    /// How many blocks of `block` threads, without dynamic shared memory, run at once on `device`, which must
    /// be current. Throws DeviceError if not even one fits on a multiprocessor.
    unsigned blocks_at_once(const Device& device, unsigned block) const;
    /// Registers per thread when a launch begins.
    int registers() const;
    /// Allows launches of this kernel with up to `bytes` bytes of dynamic shared memory per block. Never
    /// allows less than before, since backends of one process share a kernel.
    void allow_shared(std::size_t bytes) const;
    template <class... Arguments>
    void launch(const Stream& stream, dim3 grid, dim3 block, std::size_t shared_bytes,
                const Arguments&... arguments) const {
        std::array<void*, sizeof...(Arguments)> pointers{const_cast<Arguments*>(&arguments)...};
        check(cudaLaunchKernel(kernel_, grid, block, pointers.data(), shared_bytes, stream.get()));
    }

    /// Launches the kernel. If `dependent`, it may begin before earlier work in the stream has ended, and has
    /// to wait for that work itself (programmatic dependent launch). This needs compute capability 9.0.
    template <class... Arguments>
    void launch_dependent_if(bool dependent, const Stream& stream, dim3 grid, dim3 block,
                             std::size_t shared_bytes, const Arguments&... arguments) const {
        if (!dependent) return launch(stream, grid, block, shared_bytes, arguments...);
        cudaLaunchAttribute early{};
        early.id = cudaLaunchAttributeProgrammaticStreamSerialization;
        early.val.programmaticStreamSerializationAllowed = 1;
        launch_with(early, stream, grid, block, shared_bytes, arguments...);
    }

    /// Launches all blocks at once, so that they may wait for each other (a cooperative launch).
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

    /// Loads the kernel on the current device if it is not loaded there. The first load must not happen while
    /// a stream is captured.
    void load() const;

    std::shared_ptr<const Library> library_;  ///< shared by all kernels of a source
    const void* kernel_ = nullptr;            ///< a cudaKernel_t, which launches take as a function's address
};

}  // namespace voxspring::cuda
