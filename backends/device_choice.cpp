#include "backends/device_choice.h"

#include <utility>

namespace voxspring {
namespace {

std::function<std::string()>& source() {
    static std::function<std::string()> function = [] { return std::string(); };
    return function;
}

}  // namespace

std::string uuid_text(const std::array<unsigned char, 16>& bytes) {
    constexpr std::array<char, 17> digits{"0123456789abcdef"};
    std::string text = "GPU-";
    for (std::size_t i = 0; i < bytes.size(); ++i) {
        if (i == 4 || i == 6 || i == 8 || i == 10) text += '-';
        text += digits[bytes[i] >> 4];
        text += digits[bytes[i] & 15];
    }
    return text;
}

MeasuredCardSource::MeasuredCardSource(std::function<std::string()> uuid) { source() = std::move(uuid); }

const std::string& measured_card() {
    static const std::string uuid = source()();
    return uuid;
}

std::string reason_to_pass_over(const std::string& uuid, bool software, const std::string& measured) {
    if (software || measured.empty() || uuid == measured) return {};
    return "is " + (uuid.empty() ? "a card without UUID" : uuid) + ", not the CUDA device " + measured;
}

}  // namespace voxspring
