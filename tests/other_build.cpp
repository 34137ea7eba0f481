// A rank that pretends to be of another build than rank 0, and then waits until it is told to leave.
// tests/scaling_test.py lets mpirun start it beside the program.
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "harness/ranks/open_mpi.h"

int main() {
    constexpr int tag_build = 1, tag_order = 2;  // as in harness/ranks/mpi_ranks.cpp
    const auto mpi = voxspring::OpenMpi::join();
    if (mpi == nullptr) return 1;
    mpi->send_json(0, tag_build, {{"build", {{"commit", "another"}}}, {"name", "rank 1 on this host"}});
    for (;;) {
        if (const auto message = mpi->arrived(tag_order)) {
            (void)mpi->receive_json(*message, tag_order);
            return 0;
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}
