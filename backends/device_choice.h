// Which of several devices a backend takes. OpenGL and Vulkan follow the card that CUDA measures (api.h), so
// that no table mixes two cards. Another card is taken only if the user names it, or in a thread that steps
// one part of a divided body (DeviceOfThread).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace voxspring {

/// Writes a UUID as "GPU-xxxxxxxx-xxxx-xxxx-xxxx-xxxxxxxxxxxx".
std::string uuid_text(const std::array<unsigned char, 16>& bytes);

/// The kinds of devices, the preferred kind first.
enum class DeviceKind : std::uint8_t { discrete, integrated, virtual_card, other, software };
std::string to_string(DeviceKind kind);

/// A device as its API lists it.
struct ListedDevice {
    std::string name;
    DeviceKind kind = DeviceKind::other;
    std::string refusal = {};  ///< why backends do not take the device; empty if they may
};
/// The devices as a list for users: "0 NVIDIA H200 (discrete), 1 llvmpipe (software)".
std::string names_of(const std::vector<ListedDevice>& devices);
/// The numbers of the devices that `asked` names, in the order in which to try them: preferred kinds first.
/// `asked` is the number of a device, or a part of its name in upper or lower case, or empty for all devices.
/// Digits alone are a number. If no device has it, the result is empty.
std::vector<std::size_t> devices_to_try(const std::vector<ListedDevice>& devices, const std::string& asked);

/// The number of a device in its API's list, counted from 0.
struct DeviceNumber {
    int number = 0;
    bool wraps = false;  ///< if there are n devices, `number` stands for device `number` modulo n
    /// How many parts of a body are stepped at once: on all devices if `wraps`, otherwise on this device.
    int parts = 1;
    /// The index of this device among `count` > 0 devices. Throws Unavailable if there is none; the message
    /// calls the devices `kind`, for example "CUDA".
    int among(int count, const std::string& kind) const;
    /// How many of the parts are stepped on this device if there are `count` devices.
    int parts_among(int count) const;
};

/// While an object of this type exists, CUDA backends that its thread makes take the object's device. Without
/// such an object they take the first device. Backends of other APIs do not heed it.
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

/// An empty string, or why a process that measures the card with the UUID `measured` skips the device with
/// the UUID `uuid`. A software device is never skipped. Hardware is skipped unless the UUIDs are equal or
/// `measured` is empty.
std::string reason_to_pass_over(const std::string& uuid, bool software, const std::string& measured);

}  // namespace voxspring
