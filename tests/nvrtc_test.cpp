// On a system without NVRTC a program starts and its other backends step; those of CUDA say what is missing.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <string_view>

#include "backends/registry.h"
#include "cuda/device/compiler.h"
#include "tests/surroundings.h"

/// The loader's, but for NVRTC, which it looks for where there is none.
extern "C" void* dlopen(const char* file, int mode) noexcept {
    using Open = void* (*)(const char*, int);
    static const auto loader = reinterpret_cast<Open>(dlsym(RTLD_NEXT, "dlopen"));
    const std::string_view name = file != nullptr ? file : "";
    if (name.find("libnvrtc") == std::string_view::npos) return loader(file, mode);
    return loader(("/nowhere/" + std::string(name.substr(name.rfind('/') + 1))).c_str(), mode);
}

namespace voxspring::cuda {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using testing::message_of;
using ::testing::StartsWith;

TEST(WithoutNvrtc, EveryCallSaysWhatIsMissingAndWhoseItIs) {
    for (int call = 0; call < 2; ++call) {
        const std::string said = message_of<Unavailable>([] { oldest_architecture(); });
        EXPECT_THAT(said, StartsWith("no NVRTC: /nowhere/libnvrtc.so."));
        EXPECT_THAT(said, HasSubstr("the CUDA toolkit and of the Python package nvidia-cuda-nvrtc"));
    }
}

// Where there is no driver either, backends look for it first and name it.
TEST(WithoutNvrtc, CudaBackendsAreUnavailableAndOthersAreNot) {
    for (const auto& entry : registry()) {
        const std::string& name = entry.first;
        if (!name.starts_with("cuda_")) continue;
        EXPECT_THAT(message_of<Unavailable>([&name] { BackendSpec::parse(name).make(); }),
                    AnyOf(StartsWith("no NVRTC: "), StartsWith("no NVIDIA driver"), StartsWith("no CUDA ")))
            << name;
    }
    EXPECT_EQ(message_of<Unavailable>([] { BackendSpec::parse("cpu_parallel").make(); }), "");
}

}  // namespace
}  // namespace voxspring::cuda
