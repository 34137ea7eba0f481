// The GPU that a backend uses.
#pragma once

#include <cstddef>
#include <string>

namespace voxspring::cuda {

/// One of the devices that CUDA shows (CUDA_VISIBLE_DEVICES chooses those): the one that DeviceOfThread gives
/// to the constructing thread, or else the first. It is current in that thread from then on, and may be used
/// in that thread only. The constructor throws Unavailable, with the reason, if there is no device, driver,
/// context or NVRTC, or if the device is older than oldest_architecture().
class Device {
public:
    Device();

    /// The device's number as CUDA counts.
    int number() const { return number_; }
    /// How many devices CUDA shows.
    int count() const { return count_; }
    /// How many parts of a body are stepped on this device at once and share its multiprocessors.
    int parts() const { return parts_; }
    const std::string& name() const { return name_; }
    /// GPU-xxxxxxxx-xxxx-xxxx-xxxx-xxxxxxxxxxxx
    const std::string& uuid() const { return uuid_; }
    /// The largest number of 16-byte texels of a texture on linear memory.
    std::size_t max_texels() const { return max_texels_; }
    /// The highest clocks, of multiprocessors and of memory, that the card may run at.
    int sm_mhz() const { return sm_mhz_; }
    int memory_mhz() const { return memory_mhz_; }
    int multiprocessors() const { return multiprocessors_; }
    int threads_per_multiprocessor() const { return threads_per_multiprocessor_; }
    /// Bytes per second that the memory's pins carry at the highest clock.
    double memory_bytes_per_second() const { return memory_bytes_per_second_; }
    /// Size of the cache that all multiprocessors share.
    std::size_t cache_bytes() const { return cache_bytes_; }
    /// Shared memory of a multiprocessor, and how much of it each block costs in addition to what it asks
    /// for.
    std::size_t multiprocessor_shared_bytes() const { return multiprocessor_shared_bytes_; }
    std::size_t reserved_shared_bytes() const { return reserved_shared_bytes_; }
    /// The most shared memory that a block may have.
    std::size_t shared_bytes() const { return shared_bytes_; }
    /// Whether blocks of one launch may wait for each other (a cooperative launch).
    bool launches_together() const { return launches_together_; }
    /// Whether the driver ends kernels that run for seconds, as it does where the device has a display.
    bool ends_long_kernels() const { return ends_long_kernels_; }
    /// Compute capability, 90 for 9.0.
    int architecture() const { return architecture_; }
    /// Whether a kernel may be launched while the one before it still runs: from compute capability 9.0 on.
    bool has_dependent_launches() const { return architecture_ >= 90; }
    std::size_t free_bytes() const;

    /// "CUDA 13.0": the version of the runtime in this build.
    static std::string runtime_version();
    /// Version of the driver and, in parentheses, the newest CUDA that it knows.
    static std::string driver_version();

private:
    int number_ = 0;
    int count_ = 0;
    int parts_ = 1;
    std::string name_, uuid_;
    std::size_t max_texels_ = 0;
    int sm_mhz_ = 0;
    int memory_mhz_ = 0;
    int multiprocessors_ = 0;
    int threads_per_multiprocessor_ = 0;
    int architecture_ = 0;
    double memory_bytes_per_second_ = 0;
    std::size_t cache_bytes_ = 0;
    std::size_t multiprocessor_shared_bytes_ = 0;
    std::size_t reserved_shared_bytes_ = 0;
    std::size_t shared_bytes_ = 0;
    bool launches_together_ = false;
    bool ends_long_kernels_ = false;
};

}  // namespace voxspring::cuda
