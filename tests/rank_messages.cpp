// Ranks that all send to all others before any of them receives. tests/scaling_test.py lets mpirun start
// them.
#include <chrono>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "harness/ranks/open_mpi.h"

int main() {
    constexpr int tag = 1;
    const std::string text(std::size_t(1) << 20, 'x');  // so large that MPI sends it only once it is received
    const auto mpi = voxspring::OpenMpi::join();
    if (mpi == nullptr) return 1;
    for (int other = 0; other < mpi->ranks(); ++other) {
        if (other == mpi->rank()) continue;
        nlohmann::json message;
        message["from"] = mpi->rank();
        message["text"] = text;
        mpi->send_json(other, tag, message);
    }
    for (int heard = 1; heard < mpi->ranks() || !mpi->has_sent_all();) {
        const auto message = mpi->arrived(tag);
        if (!message) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
            continue;
        }
        ++heard;
        const nlohmann::json said = mpi->receive_json(*message, tag);
        if (said.at("from").get<int>() != message->from || said.at("text").get<std::string>() != text)
            return 1;
    }
    return 0;
}
