// The main() of every test in C++: a study that one of them runs measures in processes of the test itself,
// and Vulkan's validation layers look on where they are installed.
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
