// Finds out what would keep kernels that wait for each other, or for the host, from running.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace voxspring::cuda {

/// Empty, or the reason why `kernels` kernels, each in a separate stream of this process, may not run at the
/// same time, for example "with CUDA_LAUNCH_BLOCKING=1 kernels run one at a time". To be called once CUDA is
/// in use, since profilers and memory checkers load their libraries only then.
std::string serialised_by(int kernels);

/// serialised_by() for a given environment: value_of(name) returns the value of an environment variable
/// (null: not set), and `libraries` are the file names of the libraries that the process has loaded.
std::string serialised_by(int kernels, const std::function<const char*(const char* name)>& value_of,
                          const std::vector<std::string>& libraries);

/// Empty, or the reason why a launch returns only when its kernel has ended, so that a kernel cannot wait for
/// the host's orders: "with CUDA_LAUNCH_BLOCKING=1 kernels run one at a time". To be called once CUDA is in
/// use.
std::string launches_block();
/// launches_block() for a given environment, as above.
std::string launches_block(const std::function<const char*(const char* name)>& value_of,
                           const std::vector<std::string>& libraries);

}  // namespace voxspring::cuda
