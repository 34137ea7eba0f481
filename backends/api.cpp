#include "backends/api.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <utility>

namespace voxspring {
namespace {

std::map<std::string, Api>& mutable_apis() {
    static std::map<std::string, Api> all;
    return all;
}

std::string first_card() {
    for (const auto& [name, api] : apis()) {
        if (std::string uuid = api.card ? api.card() : ""; !uuid.empty()) return uuid;
    }
    return {};
}

}  // namespace

RegisteredApi::RegisteredApi(Api api) {
    auto name = api.name;
    mutable_apis().emplace(std::move(name), std::move(api));
}

const std::map<std::string, Api>& apis() { return mutable_apis(); }

const std::string& measured_card() {
    static const std::string uuid = first_card();
    return uuid;
}

std::string device_option(const std::string& api) { return "--" + api + "-device"; }

std::string device_variable(const std::string& api) {
    std::string name = "VOXSPRING_" + api + "_DEVICE";
    std::transform(name.begin(), name.end(), name.begin(),
                   [](unsigned char letter) { return char(std::toupper(letter)); });
    return name;
}

std::string asked_device(const std::string& api) {
    const char* const value = std::getenv(device_variable(api).c_str());
    return value == nullptr ? "" : value;
}

}  // namespace voxspring
