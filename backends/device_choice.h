// Which graphics card this process measures. CUDA knows; OpenGL and Vulkan follow, so that no table mixes two
// cards. Where several cards are there, it also says which one a thread takes that steps a part of a body.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

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
/// is a number, a part of a name in whatever case, or empty for all.
std::vector<std::size_t> devices_to_try(const std::vector<ListedDevice>& devices, const std::string& asked);

/// Which device Vulkan's backends are to take, as devices_to_try() has it: VOXSPRING_VULKAN_DEVICE, which
/// processes that this one starts inherit. Empty: the first that will do.
inline constexpr const char* vulkan_device_variable = "VOXSPRING_VULKAN_DEVICE";
std::string asked_vulkan_device();

/// A static object of this type names who lists Vulkan's devices, in Vulkan's order, with why a backend in
/// float32 does not take one. The function throws Unavailable where there is no Vulkan.
struct VulkanDeviceSource {
    explicit VulkanDeviceSource(std::function<std::vector<ListedDevice>()> devices);
};
/// Empty where this build has no Vulkan. Throws Unavailable.
std::vector<ListedDevice> vulkan_devices();

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
