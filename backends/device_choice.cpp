#include "backends/device_choice.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <utility>

#include "backends/backend.h"

namespace voxspring {
namespace {

std::string in_lower_case(std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char letter) { return char(std::tolower(letter)); });
    return text;
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

std::string to_string(DeviceKind kind) {
    switch (kind) {
        case DeviceKind::discrete:
            return "discrete";
        case DeviceKind::integrated:
            return "integrated";
        case DeviceKind::virtual_card:
            return "virtual";
        case DeviceKind::software:
            return "software";
        default:
            return "other";
    }
}

std::string names_of(const std::vector<ListedDevice>& devices) {
    std::string text;
    for (std::size_t n = 0; n < devices.size(); ++n)
        text += (n == 0 ? "" : ", ") + std::to_string(n) + " " + devices[n].name + " (" +
                to_string(devices[n].kind) + ")";
    return text;
}

std::vector<std::size_t> devices_to_try(const std::vector<ListedDevice>& devices, const std::string& asked) {
    std::vector<std::size_t> tried;
    const bool is_number = !asked.empty() && std::all_of(asked.begin(), asked.end(), [](unsigned char c) {
        return std::isdigit(c) != 0;
    });
    if (is_number) {
        // A number beyond the list is not looked for in names: "7" would find an RTX 4070.
        std::size_t number = 0;
        const auto [end, error] = std::from_chars(asked.data(), asked.data() + asked.size(), number);
        if (error == std::errc() && number < devices.size()) tried.push_back(number);
        return tried;
    }
    for (std::size_t n = 0; n < devices.size(); ++n) {
        if (in_lower_case(devices[n].name).find(in_lower_case(asked)) != std::string::npos)
            tried.push_back(n);
    }
    std::stable_sort(tried.begin(), tried.end(),
                     [&](std::size_t a, std::size_t b) { return devices[a].kind < devices[b].kind; });
    return tried;
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
    return "has " + (uuid.empty() ? "no UUID" : "UUID " + uuid) +
           ", but the CUDA device that is measured has UUID " + measured;
}

}  // namespace voxspring
