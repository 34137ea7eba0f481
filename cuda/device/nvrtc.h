// NVRTC, whose library is opened at run time: a program without NVRTC still computes on the processor.
#pragma once

#include <dlfcn.h>
#include <nvrtc.h>

#include <string>

#include "backends/backend.h"
#include "nvrtc_found.h"  // generated

namespace voxspring::cuda {

/// NVRTC's library, and those of its functions that this program calls, with the types that nvrtc.h declares.
class Nvrtc {
public:
    /// Opens the library at the first call: the one that the system's loader finds, or else the one with
    /// which this build was configured. If neither can be opened, this call and every later one throw
    /// Unavailable with the reason.
    static const Nvrtc& load() {
        static const Nvrtc nvrtc;
        return nvrtc;
    }

#define VOXSPRING_NVRTC(name) decltype(&nvrtc##name) const name = find<decltype(&nvrtc##name)>("nvrtc" #name)
private:
    void* const library_ = open();

public:
    VOXSPRING_NVRTC(GetErrorString);
    VOXSPRING_NVRTC(Version);
    VOXSPRING_NVRTC(GetNumSupportedArchs);
    VOXSPRING_NVRTC(GetSupportedArchs);
    VOXSPRING_NVRTC(CreateProgram);
    VOXSPRING_NVRTC(CompileProgram);
    VOXSPRING_NVRTC(DestroyProgram);
    VOXSPRING_NVRTC(GetProgramLogSize);
    VOXSPRING_NVRTC(GetProgramLog);
    VOXSPRING_NVRTC(GetCUBINSize);
    VOXSPRING_NVRTC(GetCUBIN);
    VOXSPRING_NVRTC(GetPTXSize);
    VOXSPRING_NVRTC(GetPTX);
#undef VOXSPRING_NVRTC

private:
    Nvrtc() = default;

    static void* open() {
        if (void* const found = dlopen(nvrtc_name, RTLD_NOW | RTLD_LOCAL)) return found;
        const char* const reason = dlerror();
        const std::string text = reason != nullptr ? reason : nvrtc_name;
        if (void* const configured = dlopen(nvrtc_file, RTLD_NOW | RTLD_LOCAL)) return configured;
        throw Unavailable("no NVRTC: " + text +
                          "; it is part of the CUDA toolkit and of the Python package " +
                          "nvidia-cuda-nvrtc");
    }
    template <class Function>
    Function find(const char* name) const {
        const auto function = reinterpret_cast<Function>(dlsym(library_, name));
        if (function == nullptr) throw Unavailable(std::string(nvrtc_name) + " has no function " + name);
        return function;
    }
};

}  // namespace voxspring::cuda
