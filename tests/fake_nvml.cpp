// The functions of NVML that harness/device/card.cpp calls. tests/noise_test.cpp sets their answers by
// environment variables, which workers inherit.
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
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

/// How many times this process has asked for a card's energy.
std::atomic<int> energy_queries = 0;

unsigned number_in(const char* variable, unsigned otherwise) {
    const char* const text = std::getenv(variable);
    return text != nullptr ? unsigned(std::atoi(text)) : otherwise;
}

}  // namespace

extern "C" {

struct Process {
    unsigned pid;
    unsigned long long used_memory;
    unsigned gpu_instance, compute_instance;
};

int fake_energy_queries() { return energy_queries; }

int nvmlDeviceGetTotalEnergyConsumption(void*, unsigned long long* millijoules) {
    ++energy_queries;
    *millijoules = 0;
    if (number_in("FAKE_STILL_COUNTER", 0) != 0) return 0;
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    // The counter leaps every 20 ms, by 500 W.
    const long long leaps = (now.tv_sec * 1000000000ll + now.tv_nsec) / 20000000ll;
    *millijoules = static_cast<unsigned long long>(double(leaps) * 20 * 500);
    return 0;
}
int nvmlDeviceGetPowerUsage(void*, unsigned* milliwatts) {
    *milliwatts = 1000 * number_in("FAKE_SAMPLED_WATTS", 500);
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
    const char* const falls = std::getenv("FAKE_FALLING_CARD");  // by 200 MHz at each query
    const bool is_falling = falls != nullptr && uuid == falls;
    if (!is_falling) fallen_mhz = 0;
    *mhz = 1980 - fallen_mhz;
    if (is_falling) fallen_mhz += 200;
    return type == 1 ? 0 : 2;  // of multiprocessors
}

int nvmlDeviceGetComputeRunningProcesses_v3(void*, unsigned* count, void* of_type_process) {
    auto* const processes = static_cast<Process*>(of_type_process);
    // No process has an id as large as these.
    constexpr unsigned beyond = 1u << 30;
    std::vector<unsigned> all;
    if (number_in("FAKE_LISTS_WORKERS", 1) != 0) all = workers();
    for (unsigned i = 0; i < number_in("FAKE_STRANGERS", 0); ++i) all.push_back(beyond + i);
    const bool fits = *count >= all.size();
    *count = unsigned(all.size());
    for (unsigned i = 0; fits && i < *count; ++i) processes[i] = {all[i], 0, 0, 0};
    return fits ? 0 : 7;  // too small
}
}
