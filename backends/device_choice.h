// Which graphics card this process measures. CUDA knows; OpenGL and Vulkan follow, so that no table mixes two
// cards.
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

/// Empty, or why a process that measures the card `measured` passes over a device. Software is no card and
/// never in the way; hardware has to be that card and to say so.
std::string reason_to_pass_over(const std::string& uuid, bool software, const std::string& measured);

}  // namespace voxspring
