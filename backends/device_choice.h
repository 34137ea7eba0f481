// Which graphics card this process measures. CUDA knows; OpenGL and Vulkan follow, so that no table mixes two
// cards. And which of several a thread takes that steps a part of a body.
#pragma once

#include <array>
#include <functional>
#include <string>

namespace voxspring {

/// GPU-xxxxxxxx-xxxx-xxxx-xxxx-xxxxxxxxxxxx
std::string uuid_text(const std::array<unsigned char, 16>& bytes);

/// A static object of this type names who knows the card: a function that returns its UUID, empty where
/// there is none, and does not throw.
struct MeasuredCardSource {
    explicit MeasuredCardSource(std::function<std::string()> uuid);
};

/// UUID of the card that this process measures; empty if nobody knows one. Asked once a process: a card that
/// fails later is still the one.
const std::string& measured_card();

/// One of the devices that an API counts from 0.
struct DeviceNumber {
    int number = 0;
    bool wraps = false;  ///< beyond the last device it goes on with the first
    /// Parts of a body that are stepped at once: all of them where it wraps, else those on this device.
    int parts = 1;
    /// Which of `count` devices, one at least, it is. Throws Unavailable where there is none: `kind`, "CUDA",
    /// is what the message calls them.
    int among(int count, const std::string& kind) const;
    /// How many of the parts take that one of `count` devices.
    int parts_among(int count) const;
};

/// While one lives, backends that its thread makes take that device, where their API has several. Otherwise
/// they take the first.
class DeviceOfThread {
public:
    explicit DeviceOfThread(DeviceNumber device);
    DeviceOfThread(const DeviceOfThread&) = delete;
    DeviceOfThread& operator=(const DeviceOfThread&) = delete;
    ~DeviceOfThread();
    static DeviceNumber now();

private:
    const DeviceNumber before_;
};

/// Empty, or why a process that measures the card `measured` passes over a device. Software is no card and
/// never in the way; hardware has to be that card and to say so.
std::string reason_to_pass_over(const std::string& uuid, bool software, const std::string& measured);

}  // namespace voxspring
