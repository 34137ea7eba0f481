#include "harness/device/card.h"

#include <dlfcn.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

namespace voxspring {

/// The functions and constants of NVML that are used. NVML's header is not needed: its binary interface is
/// stable.
struct Card::Library {
    static constexpr int success = 0, too_small = 7, clock_of_multiprocessors = 1;
    using Device = void*;

    void* handle = nullptr;
    Device device = nullptr;
    int (*shutdown)() = nullptr;
    int (*clock)(Device, int, unsigned*) = nullptr;
    /// One entry of what `processes` fills.
    struct Process {
        unsigned pid;
        unsigned long long used_memory;
        unsigned gpu_instance, compute_instance;
    };
    int (*processes)(Device, unsigned*, void* of_type_process) = nullptr;
    int (*energy)(Device, unsigned long long* millijoules) = nullptr;
    int (*power)(Device, unsigned* milliwatts) = nullptr;
    int (*power_limit)(Device, unsigned* milliwatts) = nullptr;
    int (*throttling)(Device, unsigned long long* bits) = nullptr;
    int (*ecc)(Device, int* now, int* after_restart) = nullptr;
    int (*mig)(Device, unsigned* now, unsigned* after_restart) = nullptr;
    int (*temperature)(Device, int sensor, unsigned* celsius) = nullptr;

    /// What `function`, one of those above, reports about the card.
    template <class Value, class... Arguments>
    std::optional<Value> ask(int (*function)(Device, Arguments...), auto... arguments) const {
        Value value = 0;
        if (function == nullptr || function(device, arguments..., &value) != success) return std::nullopt;
        return value;
    }
    /// What `function` reports, for those that also report the value after a restart.
    template <class Value>
    std::optional<Value> ask_now(int (*function)(Device, Value*, Value*)) const {
        Value now = 0, later = 0;
        if (function == nullptr || function(device, &now, &later) != success) return std::nullopt;
        return now;
    }

    template <class Function>
    void find(Function*& function, const char* name) const {
        function = reinterpret_cast<Function*>(dlsym(handle, name));
    }
};

Card::Card(const std::string& uuid) : library_(std::make_unique<Library>()) {
    const char* name = "libnvidia-ml.so.1";
    library_->handle = dlopen(name, RTLD_NOW | RTLD_LOCAL);
    if (library_->handle == nullptr) throw std::runtime_error(std::string("there is no ") + name);
    int (*initialize)() = nullptr;
    int (*by_uuid)(const char*, Library::Device*) = nullptr;
    library_->find(initialize, "nvmlInit_v2");
    library_->find(by_uuid, "nvmlDeviceGetHandleByUUID");
    library_->find(library_->shutdown, "nvmlShutdown");
    library_->find(library_->clock, "nvmlDeviceGetClockInfo");
    library_->find(library_->processes, "nvmlDeviceGetComputeRunningProcesses_v3");
    library_->find(library_->energy, "nvmlDeviceGetTotalEnergyConsumption");
    library_->find(library_->power, "nvmlDeviceGetPowerUsage");
    library_->find(library_->power_limit, "nvmlDeviceGetEnforcedPowerLimit");
    library_->find(library_->throttling, "nvmlDeviceGetCurrentClocksThrottleReasons");
    library_->find(library_->ecc, "nvmlDeviceGetEccMode");
    library_->find(library_->mig, "nvmlDeviceGetMigMode");
    library_->find(library_->temperature, "nvmlDeviceGetTemperature");
    const bool complete = initialize != nullptr && by_uuid != nullptr && library_->shutdown != nullptr;
    if (!complete || initialize() != Library::success) {
        dlclose(library_->handle);
        throw std::runtime_error(std::string(name) + " does not start");
    }
    if (by_uuid(uuid.c_str(), &library_->device) != Library::success) {
        library_->shutdown();
        dlclose(library_->handle);
        throw std::runtime_error(std::string(name) + " knows no card " + uuid);
    }
}

Card::~Card() {
    library_->shutdown();
    dlclose(library_->handle);
}

std::optional<unsigned> Card::clock_mhz() const {
    return library_->ask<unsigned>(library_->clock, Library::clock_of_multiprocessors);
}

std::optional<double> Card::energy_joules() const {
    const auto millijoules = library_->ask<unsigned long long>(library_->energy);
    if (!millijoules) return std::nullopt;
    return 1e-3 * double(*millijoules);
}

std::optional<double> Card::power_watts() const {
    const auto milliwatts = library_->ask<unsigned>(library_->power);
    if (!milliwatts) return std::nullopt;
    return 1e-3 * *milliwatts;
}

std::vector<std::string> Card::throttle_reasons() const {
    // The bits are nvmlClocksEventReason*. 0x1, an idle card, is left out.
    constexpr std::pair<unsigned long long, const char*> reasons[] = {
        {0x2, "clocks set by a user"},
        {0x4, "power limit"},
        {0x8, "hardware slow-down"},
        {0x10, "synchronised with another card"},
        {0x20, "temperature (software)"},
        {0x40, "temperature (hardware)"},
        {0x80, "power brake"},
        {0x100, "clocks of the display"}};
    const unsigned long long bits = library_->ask<unsigned long long>(library_->throttling).value_or(0);
    std::vector<std::string> found;
    for (const auto& [bit, reason] : reasons) {
        if ((bits & bit) != 0) found.push_back(reason);
    }
    return found;
}

nlohmann::json Card::settings() const {
    constexpr int sensor_of_chip = 0;
    nlohmann::json settings = nlohmann::json::object();
    if (const auto milliwatts = library_->ask<unsigned>(library_->power_limit))
        settings["power_limit_watts"] = 1e-3 * *milliwatts;
    if (const auto ecc = library_->ask_now(library_->ecc)) settings["ecc"] = *ecc != 0;
    if (const auto mig = library_->ask_now(library_->mig)) settings["mig"] = *mig != 0;
    if (const auto celsius = library_->ask<unsigned>(library_->temperature, sensor_of_chip))
        settings["temperature_celsius"] = *celsius;
    return settings;
}

std::optional<std::vector<pid_t>> Card::processes() const {
    if (library_->processes == nullptr) return std::nullopt;
    // The list has room for processes that begin between two calls.
    constexpr int max_tries = 3;
    std::vector<Library::Process> found(64);
    for (int i = 0; i < max_tries; ++i) {
        auto count = unsigned(found.size());
        const int answer = library_->processes(library_->device, &count, found.data());
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
