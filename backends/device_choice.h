// Which of several devices a backend takes. OpenGL and Vulkan follow the card that CUDA measures (api.h), so
// that no table mixes two cards. A thread that steps a part of a body may take another one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace voxspring {

/// GPU-xxxxxxxx-xxxx-xxxx-xxxx-xxxxxxxxxxxx
std::string uuid_text(const std::array<unsigned char, 16>& bytes);

/// What a device is, the preferred kind first.
enum class DeviceKind : std::uint8_t { discrete, integrated, virtual_card, other, software };
std::string to_string(DeviceKind kind);

/// A device as its API lists it.
struct ListedDevice {
    std::string name;
    DeviceKind kind = DeviceKind::other;
    std::string refusal = {};  ///< empty, or why it is not taken
};
/// "0 NVIDIA H200 (discrete), 1 llvmpipe (software)"
std::string names_of(const std::vector<ListedDevice>& devices);
/// The numbers of the devices to try, in this order: those that `asked` names, preferred kinds first. `asked`
/// is a number, a part of a name in upper or lower case, or empty for all devices.
std::vector<std::size_t> devices_to_try(const std::vector<ListedDevice>& devices, const std::string& asked);

/// One of the devices that an API counts from 0.
struct DeviceNumber {
    int number = 0;
    bool wraps = false;  ///< after the last device it goes on with the first
    /// How many parts of a body are stepped at once: all of them if it wraps, otherwise those on this device.
    int parts = 1;
    /// Which of `count` devices, at least one, it is. Throws Unavailable if there is none; the message calls
    /// the devices `kind`, for example "CUDA".
    int among(int count, const std::string& kind) const;
    /// How many of the parts take this one of `count` devices.
    int parts_among(int count) const;
};

/// While such an object exists, backends that its thread makes take this device, if their API has several.
/// Without one they take the first.
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

/// Empty, or why a process that measures the card `measured` skips a device. Software is no card and is never
/// skipped. Hardware must be that card, and must say so.
std::string reason_to_pass_over(const std::string& uuid, bool software, const std::string& measured);

}  // namespace voxspring
