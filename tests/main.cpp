// The main() of every test in C++: a study that one of them runs measures in processes of the test itself.
#include <gmock/gmock.h>

#include "harness/process/worker_main.h"

int main(int argc, char** argv) {
    voxspring::worker_main(argc, argv);
    testing::InitGoogleMock(&argc, argv);
    return RUN_ALL_TESTS();
}
