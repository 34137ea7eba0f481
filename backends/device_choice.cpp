#include "backends/device_choice.h"

#include <utility>

#include "backends/backend.h"

namespace voxspring {
namespace {

std::function<std::string()>& source() {
    static std::function<std::string()> function = [] { return std::string(); };
    return function;
}

thread_local DeviceNumber device_of_thread;

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

int DeviceNumber::among(int count, const std::string& kind) const {
    if (wraps) return number % count;
    if (number < count) return number;
    const std::string there_are =
        count == 1 ? "there is device 0 alone" : "there are devices 0 to " + std::to_string(count - 1);
    throw Unavailable("no " + kind + " device " + std::to_string(number) + ": " + there_are);
}

int DeviceNumber::parts_among(int count) const {
    return wraps ? (parts - number % count + count - 1) / count : parts;
}

DeviceOfThread::DeviceOfThread(DeviceNumber device) : before_(std::exchange(device_of_thread, device)) {}

DeviceOfThread::~DeviceOfThread() { device_of_thread = before_; }

DeviceNumber DeviceOfThread::now() { return device_of_thread; }

std::string reason_to_pass_over(const std::string& uuid, bool software, const std::string& measured) {
    if (software || measured.empty() || uuid == measured) return {};
    return "is " + (uuid.empty() ? "a card without UUID" : uuid) + ", not the CUDA device " + measured;
}

}  // namespace voxspring
