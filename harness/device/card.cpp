#include "harness/device/card.h"

#include <dlfcn.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace voxspring {

/// NVML, opened for one card. Functions are found by name, so that building does not need NVML's header. The
/// binary interface of NVML is stable.
struct Card::Library {
    static constexpr int success = 0, too_small = 7;

    explicit Library(const std::string& uuid) {
        const std::string name = "libnvidia-ml.so.1";
        handle.reset(dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL));
        if (handle == nullptr) throw std::runtime_error("there is no " + name);
        const auto initialize = find<int()>("nvmlInit_v2");
        const auto by_uuid = find<int(const char*, void**)>("nvmlDeviceGetHandleByUUID");
        const bool complete = initialize != nullptr && by_uuid != nullptr && shutdown() != nullptr;
        if (!complete || initialize() != success) throw std::runtime_error(name + " cannot be initialised");
        if (by_uuid(uuid.c_str(), &device) == success) return;
        shutdown()();
        throw std::runtime_error(name + " knows no card " + uuid);
    }
    Library(const Library&) = delete;
    Library& operator=(const Library&) = delete;
    ~Library() { shutdown()(); }

    template <class Function>
    Function* find(const char* name) const {
        return reinterpret_cast<Function*>(dlsym(handle.get(), name));
    }
    int (*shutdown() const)() { return find<int()>("nvmlShutdown"); }

    /// What NVML's function `name` reports about the card; empty if there is no such function, or if it
    /// fails.
    template <class Value>
    std::optional<Value> ask(const char* name, auto... arguments) const {
        Value value = 0;
        const auto function = find<int(void*, decltype(arguments)..., Value*)>(name);
        if (function == nullptr || function(device, arguments..., &value) != success) return std::nullopt;
        return value;
    }
    /// Like ask(), for a function that reports two values of a setting: the present one, and the one after
    /// the next restart. Returns the present value.
    template <class Value>
    std::optional<Value> ask_now(const char* name) const {
        Value now = 0, later = 0;
        const auto function = find<int(void*, Value*, Value*)>(name);
        if (function == nullptr || function(device, &now, &later) != success) return std::nullopt;
        return now;
    }

    std::unique_ptr<void, int (*)(void*)> handle{nullptr, dlclose};
    void* device = nullptr;
};

Card::Card(const std::string& uuid) : library_(std::make_unique<Library>(uuid)) {}
Card::~Card() = default;

std::optional<unsigned> Card::clock_mhz() const {
    constexpr int clock_of_multiprocessors = 1;
    return library_->ask<unsigned>("nvmlDeviceGetClockInfo", clock_of_multiprocessors);
}

std::optional<double> Card::energy_joules() const {
    const auto millijoules = library_->ask<unsigned long long>("nvmlDeviceGetTotalEnergyConsumption");
    return millijoules ? std::optional(1e-3 * double(*millijoules)) : std::nullopt;
}

std::optional<double> Card::power_watts() const {
    const auto milliwatts = library_->ask<unsigned>("nvmlDeviceGetPowerUsage");
    return milliwatts ? std::optional(1e-3 * *milliwatts) : std::nullopt;
}

std::vector<std::string> Card::throttle_reasons() const {
    // The bits are NVML's nvmlClocksEventReason*. The bit 0x1, an idle card, is left out.
    constexpr std::pair<unsigned long long, const char*> reasons[] = {
        {0x2, "clocks set by a user"},
        {0x4, "power limit"},
        {0x8, "hardware slow-down"},
        {0x10, "synchronised with another card"},
        {0x20, "temperature (software)"},
        {0x40, "temperature (hardware)"},
        {0x80, "power brake"},
        {0x100, "clocks of the display"}};
    const unsigned long long bits =
        library_->ask<unsigned long long>("nvmlDeviceGetCurrentClocksThrottleReasons").value_or(0);
    std::vector<std::string> found;
    for (const auto& [bit, reason] : reasons) {
        if ((bits & bit) != 0) found.push_back(reason);
    }
    return found;
}

nlohmann::json Card::settings() const {
    constexpr int sensor_of_chip = 0;
    nlohmann::json settings = nlohmann::json::object();
    if (const auto milliwatts = library_->ask<unsigned>("nvmlDeviceGetEnforcedPowerLimit"))
        settings["power_limit_watts"] = 1e-3 * *milliwatts;
    if (const auto ecc = library_->ask_now<int>("nvmlDeviceGetEccMode")) settings["ecc"] = *ecc != 0;
    if (const auto mig = library_->ask_now<unsigned>("nvmlDeviceGetMigMode")) settings["mig"] = *mig != 0;
    if (const auto celsius = library_->ask<unsigned>("nvmlDeviceGetTemperature", sensor_of_chip))
        settings["temperature_celsius"] = *celsius;
    return settings;
}

std::optional<std::vector<pid_t>> Card::processes() const {
    struct Process {
        unsigned pid;
        unsigned long long used_memory;
        unsigned gpu_instance, compute_instance;
    };
    const auto list = library_->find<int(void*, unsigned*, void*)>("nvmlDeviceGetComputeRunningProcesses_v3");
    if (list == nullptr) return std::nullopt;
    // NVML refuses to fill a list that is too short, so the list begins with more room than most cards need.
    std::vector<Process> found(64);
    for (int tries = 0; tries < 3; ++tries) {
        auto count = unsigned(found.size());
        const int answer = list(library_->device, &count, found.data());
        if (answer == Library::success) {
            std::vector<pid_t> pids;
            for (unsigned k = 0; k < count; ++k) pids.push_back(pid_t(found[k].pid));
            return pids;
        }
        if (answer != Library::too_small) return std::nullopt;
        found.resize(2 * std::max<std::size_t>(found.size(), count));
    }
    return std::nullopt;
}

}  // namespace voxspring
