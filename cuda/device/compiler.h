// Compiles kernels for the scene and the card at hand, with NVRTC. Needs no GPU.
#pragma once

#include <map>
#include <string>

namespace voxspring::cuda {

/// A kernel before it is compiled: a file of kernels/ and the macros that specialise it.
struct KernelSource {
    std::string file;  ///< "implicit.cu"
    std::map<std::string, std::string> macros;
    /// Whether the kernel moves registers between threads (moves_registers()). If so, its code runs on one
    /// architecture only.
    bool moves_registers = false;
    bool operator==(const KernelSource&) const = default;
};

struct CompiledKernel {
    std::string code;    ///< machine code, or PTX if NVRTC does not know the card
    double seconds = 0;  ///< the time that compiling took, in this run or an earlier one
    /// Whether the code was found on disk, where an earlier run of the program had stored it with `seconds`.
    bool found = false;
};

/// Compiles `source`, or finds its code on disk. `architecture`: compute capability, 90 for 9.0. Throws
/// DeviceError with NVRTC's log if the source is wrong.
CompiledKernel compile(const KernelSource& source, int architecture);

/// A compute capability as text: "9.0" for 90.
std::string version_of(int architecture);

/// The oldest compute capability that is supported: 75 (for 7.5) or, if NVRTC compiles only for later ones,
/// the oldest of these.
int oldest_architecture();

/// Whether kernels for `architecture` may move registers from some threads of a block to others (setmaxnreg).
bool moves_registers(int architecture);

/// The part of compile()'s settings that is the same for all kernels on a card that do not move registers:
/// "NVRTC 13.0 <build id> --gpu-architecture=sm_90 --std=c++20 ...".
std::string compiler_and_options(int architecture);

/// The version of NVRTC and the build id of its library. Compiled code depends on these two as well as on its
/// source.
const std::string& compiler_build();

/// The name of the kernel in each file that has only one.
inline constexpr const char* kernel_name = "step";

}  // namespace voxspring::cuda
