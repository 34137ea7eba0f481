// What harness/device/noise.cpp asks of NVML, answered by what tests/noise_test.cpp sets.
#include <sys/types.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

/// Of this process: the workers of its study.
std::vector<unsigned> children() {
    std::vector<unsigned> found;
    std::error_code none;
    for (const auto& folder : std::filesystem::directory_iterator("/proc", none)) {
        std::ifstream file(folder.path() / "stat");
        std::string stat;
        std::getline(file, stat);
        const auto end = stat.rfind(')');
        if (end == std::string::npos || end + 4 > stat.size()) continue;
        if (std::stol(stat.substr(end + 4)) == long(getpid())) found.push_back(unsigned(std::stoul(stat)));
    }
    return found;
}

}  // namespace

extern "C" {

struct Process {
    unsigned pid;
    unsigned long long used_memory;
    unsigned gpu_instance, compute_instance;
};

unsigned fake_clocks_mhz[2] = {1980, 1980};  // taken in turns
unsigned fake_strangers = 0;
bool fake_lists_children = true;

int nvmlInit_v2() { return 0; }
int nvmlShutdown() { return 0; }

int nvmlDeviceGetHandleByUUID(const char* uuid, void** device) {
    static int card;
    *device = &card;
    return std::strcmp(uuid, "GPU-fake") == 0 ? 0 : 6;  // not found
}

int nvmlDeviceGetClockInfo(void*, int type, unsigned* mhz) {
    static unsigned asked;
    *mhz = fake_clocks_mhz[asked++ % 2];
    return type == 1 ? 0 : 2;  // of multiprocessors
}

int nvmlDeviceGetComputeRunningProcesses_v3(void*, unsigned* count, void* of_type_process) {
    auto* const processes = static_cast<Process*>(of_type_process);
    // No process has a number as great as these.
    constexpr unsigned beyond = 1u << 30;
    std::vector<unsigned> all = fake_lists_children ? children() : std::vector<unsigned>();
    for (unsigned i = 0; i < fake_strangers; ++i) all.push_back(beyond + i);
    const bool fits = *count >= all.size();
    *count = unsigned(all.size());
    for (unsigned i = 0; fits && i < *count; ++i) processes[i] = {all[i], 0, 0, 0};
    return fits ? 0 : 7;  // too small
}
}
