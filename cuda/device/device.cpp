#include "cuda/device/device.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <regex>

#include "backends/api.h"
#include "cuda/device/check.h"
#include "cuda/device/compiler.h"

namespace voxspring::cuda {
namespace {

void require(cudaError_t status, const std::string& what) {
    if (status == cudaSuccess) return;
    cudaGetLastError();  // clears the error, which a later call would report again
    throw Unavailable(what + ": " + cudaGetErrorString(status));
}

// CUDA writes 13.0 as 13000.
std::string version_text(int version) {
    return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

int attribute(cudaDeviceAttr which, int device) {
    int value = 0;
    check(cudaDeviceGetAttribute(&value, which, device));
    return value;
}

int megahertz(cudaDeviceAttr clock, int device) { return attribute(clock, device) / 1000; }

std::string uuid_of(const cudaDeviceProp& properties) {
    std::array<unsigned char, 16> bytes{};
    std::copy(std::begin(properties.uuid.bytes), std::end(properties.uuid.bytes), bytes.begin());
    return uuid_text(bytes);
}

/// The UUID of the first card, which Device takes by default; empty if there is none. Makes no context on it.
std::string first_card() {
    cudaDeviceProp properties{};
    if (cudaGetDeviceProperties(&properties, 0) == cudaSuccess) return uuid_of(properties);
    cudaGetLastError();
    return {};
}

const RegisteredApi api(
    {.name = "cuda", .title = "CUDA", .device_field = "gpu", .card = first_card, .shares_process = true});

}  // namespace

Device::Device() {
    // Ask for the driver's version first: without a driver, other calls of the runtime say only that the
    // driver is too old.
    int driver = 0;
    require(cudaDriverGetVersion(&driver), "no CUDA driver");
    if (driver == 0) throw Unavailable("no NVIDIA driver is installed");
    require(cudaGetDeviceCount(&count), "no CUDA device");
    if (count == 0) throw Unavailable("no CUDA device");
    number = DeviceOfThread::now().among(count, "CUDA");
    parts = DeviceOfThread::now().parts_among(count);
    require(cudaSetDevice(number), "no CUDA context");
    cudaDeviceProp properties{};
    require(cudaGetDeviceProperties(&properties, number), "no CUDA context");
    name = properties.name;
    uuid = uuid_of(properties);
    multiprocessors = properties.multiProcessorCount;
    threads_per_multiprocessor = properties.maxThreadsPerMultiProcessor;
    shared_bytes = properties.sharedMemPerBlockOptin;
    multiprocessor_shared_bytes = properties.sharedMemPerMultiprocessor;
    reserved_shared_bytes = properties.reservedSharedMemPerBlock;
    cache_bytes = std::size_t(properties.l2CacheSize);
    architecture = 10 * properties.major + properties.minor;
    launches_together = attribute(cudaDevAttrCooperativeLaunch, number) != 0;
    ends_long_kernels = attribute(cudaDevAttrKernelExecTimeout, number) != 0;
    if (const int oldest = oldest_architecture(); architecture < oldest)
        throw Unavailable(name + " has compute capability " + version_of(architecture) +
                          ", but this program needs " + version_of(oldest) + " or later");
    const cudaChannelFormatDesc texel = cudaCreateChannelDesc(32, 32, 32, 32, cudaChannelFormatKindFloat);
    check(cudaDeviceGetTexture1DLinearMaxWidth(&max_texels, &texel, number));
    sm_mhz = megahertz(cudaDevAttrClockRate, number);
    memory_mhz = megahertz(cudaDevAttrMemoryClockRate, number);
    // Each pin carries two bits per clock, one at either edge.
    memory_bytes_per_second = 2e6 * memory_mhz * properties.memoryBusWidth / 8;
}

std::size_t Device::free_bytes() const {
    std::size_t available = 0;
    std::size_t total = 0;
    check(cudaMemGetInfo(&available, &total));
    return available;
}

std::string Device::runtime_version() {
    int version = 0;
    check(cudaRuntimeGetVersion(&version));
    return "CUDA " + version_text(version);
}

std::string Device::driver_version() {
    int version = 0;
    check(cudaDriverGetVersion(&version));
    std::string text = "CUDA " + version_text(version);
    // Only the kernel module and NVML know the driver's version, and not every server has NVML.
    std::ifstream module("/proc/driver/nvidia/version");
    std::string line;
    std::smatch number;
    if (std::getline(module, line) && std::regex_search(line, number, std::regex(R"(\b\d+\.\d+(\.\d+)?\b)")))
        text = number.str() + " (" + text + ")";
    return text;
}

}  // namespace voxspring::cuda
