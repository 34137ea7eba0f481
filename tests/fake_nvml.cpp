// The functions of NVML that harness/device/card.cpp calls, with answers that tests/noise_test.cpp sets.
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace {

/// The workers of the study that this process runs, which are its launcher's children.
std::vector<unsigned> workers() {
    std::map<long, long> parents;
    std::error_code none;
    for (const auto& folder : std::filesystem::directory_iterator("/proc", none)) {
        std::ifstream file(folder.path() / "stat");
        std::string stat;
        std::getline(file, stat);
        const auto end = stat.rfind(')');
        if (end == std::string::npos || end + 4 > stat.size()) continue;
        parents[std::stol(stat)] = std::stol(stat.substr(end + 4));
    }
    std::vector<unsigned> found;
    for (const auto& [process, parent] : parents) {
        const auto launcher = parents.find(parent);
        if (launcher != parents.end() && launcher->second == long(getpid()))
            found.push_back(unsigned(process));
    }
    return found;
}

using Cards = std::map<std::string, unsigned>;
/// By how many MHz the clock of each card, named by UUID, has fallen.
Cards cards;
std::mutex mutex_of_cards;

}  // namespace

extern "C" {

struct Process {
    unsigned pid;
    unsigned long long used_memory;
    unsigned gpu_instance, compute_instance;
};

unsigned fake_clock_mhz = 1980;
unsigned fake_clock_falls_mhz = 0;  // at each query
unsigned fake_strangers = 0;
bool fake_lists_workers = true;

double fake_watts = 500;  // according to the counter

int nvmlDeviceGetTotalEnergyConsumption(void*, unsigned long long* millijoules) {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    // The counter leaps every 20 ms.
    const long long leaps = (now.tv_sec * 1000000000ll + now.tv_nsec) / 20000000ll;
    *millijoules = static_cast<unsigned long long>(double(leaps) * 20 * fake_watts);
    return 0;
}
int nvmlDeviceGetPowerUsage(void*, unsigned* milliwatts) {
    // Workers inherit the environment of the test, and query NVML too.
    const char* watts = std::getenv("FAKE_SAMPLED_WATTS");
    *milliwatts = watts != nullptr ? unsigned(1000 * std::atoi(watts)) : 500000;
    return 0;
}
int nvmlDeviceGetEnforcedPowerLimit(void*, unsigned* milliwatts) {
    *milliwatts = 700000;
    return 0;
}
int nvmlDeviceGetCurrentClocksThrottleReasons(void*, unsigned long long* bits) {
    *bits = 0x5;  // idle, and limited by power
    return 0;
}
int nvmlDeviceGetEccMode(void*, int* now, int* later) {
    *now = *later = 1;
    return 0;
}
int nvmlDeviceGetMigMode(void*, unsigned*, unsigned*) { return 3; }  // not supported

int nvmlInit_v2() { return 0; }
int nvmlShutdown() { return 0; }

int nvmlDeviceGetHandleByUUID(const char* uuid, void** device) {
    const std::lock_guard lock(mutex_of_cards);
    *device = &*cards.try_emplace(uuid).first;
    return std::strncmp(uuid, "GPU-fake", 8) == 0 ? 0 : 6;  // not found
}

int nvmlDeviceGetClockInfo(void* device, int type, unsigned* mhz) {
    const std::lock_guard lock(mutex_of_cards);
    auto& [uuid, fallen_mhz] = *static_cast<Cards::pointer>(device);
    *mhz = fake_clock_mhz - fallen_mhz;
    fake_clock_mhz -= fake_clock_falls_mhz;
    // Workers inherit the environment of the test.
    if (const char* falls = std::getenv("FAKE_FALLING_CARD"); falls != nullptr && uuid == falls)
        fallen_mhz += 200;
    return type == 1 ? 0 : 2;  // of multiprocessors
}

int nvmlDeviceGetComputeRunningProcesses_v3(void*, unsigned* count, void* of_type_process) {
    auto* const processes = static_cast<Process*>(of_type_process);
    // No process has an id as large as these.
    constexpr unsigned beyond = 1u << 30;
    std::vector<unsigned> all = fake_lists_workers ? workers() : std::vector<unsigned>();
    const char* const strangers = std::getenv("FAKE_STRANGERS");
    const unsigned count_of_strangers =
        strangers != nullptr ? unsigned(std::atoi(strangers)) : fake_strangers;
    for (unsigned i = 0; i < count_of_strangers; ++i) all.push_back(beyond + i);
    const bool fits = *count >= all.size();
    *count = unsigned(all.size());
    for (unsigned i = 0; fits && i < *count; ++i) processes[i] = {all[i], 0, 0, 0};
    return fits ? 0 : 7;  // too small
}
}
