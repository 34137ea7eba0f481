// Copies through pinned memory by one thread to several devices, and launches of many steps, over a fake CUDA
// whose devices are the host's memory. As on a real one, a stream records no event of another device.
#include "cuda/device/staged_copy.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <vector>

#include "cuda/common/joint_launch.h"

namespace {

int current_device = 0;
int pinned_allocations = 0;

// A handle encodes its device, and is not 0.
template <class Handle>
Handle handle_of(int device) {
    return reinterpret_cast<Handle>(std::uintptr_t(device) + 1);
}
template <class Handle>
int device_of(Handle handle) {
    return int(reinterpret_cast<std::uintptr_t>(handle)) - 1;
}

}  // namespace

// --- The calls that are made ---------------------------------------------------------------------------

extern "C" {
cudaError_t cudaGetDevice(int* device) {
    *device = current_device;
    return cudaSuccess;
}
cudaError_t cudaMallocHost(void** memory, std::size_t bytes) {
    *memory = std::malloc(bytes);
    ++pinned_allocations;
    return cudaSuccess;
}
cudaError_t cudaFreeHost(void* memory) {
    std::free(memory);
    return cudaSuccess;
}
cudaError_t cudaFree(void* memory) { return cudaFreeHost(memory); }
cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned) {
    *stream = handle_of<cudaStream_t>(current_device);
    return cudaSuccess;
}
cudaError_t cudaStreamDestroy(cudaStream_t) { return cudaSuccess; }
cudaError_t cudaStreamSynchronize(cudaStream_t) { return cudaSuccess; }
cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned) {
    *event = handle_of<cudaEvent_t>(current_device);
    return cudaSuccess;
}
cudaError_t cudaEventDestroy(cudaEvent_t) { return cudaSuccess; }
cudaError_t cudaEventSynchronize(cudaEvent_t) { return cudaSuccess; }
cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
    return device_of(event) == device_of(stream) ? cudaSuccess : cudaErrorInvalidResourceHandle;
}
cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind, cudaStream_t) {
    std::memcpy(to, from, bytes);
    return cudaSuccess;
}
const char* cudaGetErrorName(cudaError_t) { return "cudaErrorInvalidResourceHandle"; }
const char* cudaGetErrorString(cudaError_t) { return "an event of another device"; }
}

namespace voxspring::cuda {
namespace {

TEST(StagedCopies, GoToEachDeviceThatAThreadUses) {
    std::vector<std::uint32_t> sent((std::size_t(70) << 20) / sizeof(std::uint32_t));  // in three pieces
    for (std::size_t n = 0; n < sent.size(); ++n) sent[n] = std::uint32_t(2654435761U * n);
    const std::size_t bytes = sent.size() * sizeof(sent[0]);
    for (const int device : {0, 1, 0}) {
        current_device = device;
        const Stream stream;
        std::vector<std::uint32_t> there(sent.size()), back(sent.size());
        copy_to_device(there.data(), sent.data(), bytes, stream);
        copy_from_device(back.data(), there.data(), bytes, stream);
        EXPECT_EQ(there, sent) << "to device " << device;
        EXPECT_EQ(back, sent) << "from device " << device;
    }
}

// The ranks of every run are new threads. Pinned memory that each of them kept would grow from run to run.
TEST(StagedCopies, OfThreadsThatEndedLeaveTheirPinnedMemoryToTheNext) {
    current_device = 2;
    const int before = pinned_allocations;
    std::vector<std::byte> sent(std::size_t(64) << 20), there(sent.size());
    for (int run = 0; run < 3; ++run)
        std::thread([&] { copy_to_device(there.data(), sent.data(), sent.size(), Stream()); }).join();
    EXPECT_EQ(pinned_allocations - before, 2) << "two pieces for one copy at a time";
}

// The driver of a device with a display ends kernels that run for seconds.
TEST(JointLaunches, AreShortWhereTheDeviceHasADisplay) {
    const auto launches = [](bool watched) {
        const Stream stream;
        std::vector<int> steps_of_launches;
        JointLaunch(watched).enqueue(
            3, JointLaunch::most_steps, stream,
            [&](int steps, std::uint32_t, std::uint32_t) {
                steps_of_launches.push_back(steps);
                std::this_thread::sleep_for(steps * std::chrono::milliseconds(130));  // two exceed a pace
            },
            [](int) {});
        return steps_of_launches;
    };
    EXPECT_EQ(launches(true), (std::vector<int>{1, 1, 1}));
    EXPECT_EQ(launches(false), std::vector<int>{3});
}

}  // namespace
}  // namespace voxspring::cuda
