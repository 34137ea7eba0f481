// The GPU that a backend uses.
#pragma once

#include <cstddef>
#include <string>

namespace voxspring::cuda {

/// One of the devices that CUDA shows to this process (CUDA_VISIBLE_DEVICES chooses which): the one that
/// DeviceOfThread assigns to the constructing thread, otherwise the first. The device is current in that
/// thread from then on, and this object may be used in that thread only. The constructor throws Unavailable,
/// with the reason, if there is no device, driver, context or NVRTC, or if the device is older than
/// oldest_architecture().
struct Device {
    Device();

    /// Whether a kernel may be launched while the one before it still runs: from compute capability 9.0 on.
    bool has_dependent_launches() const { return architecture >= 90; }
    std::size_t free_bytes() const;

    /// "CUDA 13.0": the version of the runtime in this build.
    static std::string runtime_version();
    /// Version of the driver and, in parentheses, the newest CUDA that it knows. If the version cannot be
    /// read, the result is that CUDA alone.
    static std::string driver_version();

    int number = 0;  ///< as CUDA counts, from 0
    int count = 0;   ///< how many devices CUDA shows
    int parts = 1;  ///< parts of a body that are stepped on this device at once and share its multiprocessors
    std::string name;
    std::string uuid;            ///< GPU-xxxxxxxx-xxxx-xxxx-xxxx-xxxxxxxxxxxx
    std::size_t max_texels = 0;  ///< the largest number of 16-byte texels of a texture on linear memory
    /// The highest clocks, of multiprocessors and of memory, that the card may run at.
    int sm_mhz = 0, memory_mhz = 0;
    int multiprocessors = 0;
    int threads_per_multiprocessor = 0;
    int architecture = 0;                ///< compute capability, 90 for 9.0
    double memory_bytes_per_second = 0;  ///< of device memory, at its highest clock
    std::size_t cache_bytes = 0;         ///< size of the cache that all multiprocessors share
    /// Bytes of shared memory of a multiprocessor, and how many of them each block takes in addition to those
    /// that it asks for.
    std::size_t multiprocessor_shared_bytes = 0, reserved_shared_bytes = 0;
    std::size_t shared_bytes = 0;    ///< the most shared memory that a block may have
    bool launches_together = false;  ///< blocks of one launch may wait for each other (a cooperative launch)
    /// Whether the driver ends kernels that run for seconds, as it does if the device drives a display.
    bool ends_long_kernels = false;
};

}  // namespace voxspring::cuda
