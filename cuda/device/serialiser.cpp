#include "cuda/device/serialiser.h"

#include <link.h>

#include <algorithm>
#include <array>
#include <cstdlib>

namespace voxspring::cuda {
namespace {

/// Tools that run one kernel at a time, each recognised by a part of the name of the library that it loads.
struct Tool {
    const char* soname;
    const char* name;
    bool blocks;  ///< whether a launch returns only when its kernel has ended
};
constexpr std::array tools = {Tool{"sanitizer-collection", "compute-sanitizer", false},
                              Tool{"cuda-injection", "Nsight Compute", true}};

/// How many hardware queues a process has for its streams, unless CUDA_DEVICE_MAX_CONNECTIONS says otherwise.
/// A device has no more than the second number, whatever that variable asks for.
constexpr int usual_connections = 8, most_connections = 32;

std::vector<std::string> loaded_libraries() {
    std::vector<std::string> names;
    dl_iterate_phdr(
        [](dl_phdr_info* file, std::size_t, void* found) {
            static_cast<std::vector<std::string>*>(found)->emplace_back(file->dlpi_name);
            return 0;
        },
        &names);
    return names;
}

using Environment = std::function<const char*(const char* name)>;
const char* environment(const char* name) { return std::getenv(name); }

/// Empty, or why kernels run one at a time: a variable, or one of the tools (of those that block launches).
std::string one_at_a_time(const Environment& value_of, const std::vector<std::string>& libraries,
                          bool only_blocking) {
    const char* const blocking = value_of("CUDA_LAUNCH_BLOCKING");
    if (blocking != nullptr && std::atoi(blocking) != 0)
        return std::string("with CUDA_LAUNCH_BLOCKING=") + blocking + " kernels run one at a time";
    for (const std::string& library : libraries) {
        for (const Tool& tool : tools) {
            if ((tool.blocks || !only_blocking) && library.find(tool.soname) != std::string::npos)
                return std::string("under ") + tool.name + " kernels run one at a time";
        }
    }
    return {};
}

}  // namespace

std::string serialised_by(int kernels, const Environment& value_of,
                          const std::vector<std::string>& libraries) {
    if (std::string why = one_at_a_time(value_of, libraries, false); !why.empty()) return why;
    const char* const text = value_of("CUDA_DEVICE_MAX_CONNECTIONS");
    const int asked = text == nullptr ? 0 : std::atoi(text);
    const int connections = asked > 0 ? std::min(asked, most_connections) : usual_connections;
    if (kernels > connections)
        return "the streams of a process share " + std::to_string(connections) +
               " queues (environment variable CUDA_DEVICE_MAX_CONNECTIONS), but " + std::to_string(kernels) +
               " kernels need one queue each";
    return {};
}

std::string serialised_by(int kernels) { return serialised_by(kernels, environment, loaded_libraries()); }

std::string launches_block(const Environment& value_of, const std::vector<std::string>& libraries) {
    return one_at_a_time(value_of, libraries, true);
}

std::string launches_block() { return launches_block(environment, loaded_libraries()); }

}  // namespace voxspring::cuda
