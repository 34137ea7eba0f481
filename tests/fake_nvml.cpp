// What harness/device/noise.cpp asks of NVML, answered by what tests/noise_test.cpp sets.
#include <cstring>

extern "C" {

unsigned fake_clocks_mhz[2] = {1980, 1980};  // taken in turns
unsigned fake_process_count = 0;

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

int nvmlDeviceGetComputeRunningProcesses_v3(void*, unsigned* count, void*) {
    const bool fits = *count >= fake_process_count;
    *count = fake_process_count;
    return fits ? 0 : 7;  // too small
}
}
