// The main() of every C++ test. A study that a test runs measures in processes of the test program, and
// Vulkan's validation layers are enabled if they are installed.
#include <gmock/gmock.h>

#include <cstdlib>

#include "harness/process/worker_main.h"
#ifdef VOXSPRING_HAS_VULKAN
#include "backends/vulkan/validation.h"
#endif

int main(int argc, char** argv) {
    setenv("VOXSPRING_VULKAN_VALIDATION", "1", 0);  // workers inherit it
    voxspring::worker_main(argc, argv);
    testing::InitGoogleMock(&argc, argv);
    const int result = RUN_ALL_TESTS();
#ifdef VOXSPRING_HAS_VULKAN
    if (voxspring::vulkan::unreported_messages() > 0) return 1;
#endif
    return result;
}
