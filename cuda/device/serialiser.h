// Finds out what keeps kernels from running at the same time, where some wait for each other.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace voxspring::cuda {

/// Empty, or why `kernels` kernels in as many streams of this process may not run at the same time: "with
/// CUDA_LAUNCH_BLOCKING=1 kernels run one at a time". To be called once CUDA is in use, since that loads
/// tools.
std::string serialised_by(int kernels);

/// serialised_by() for any environment and loaded libraries. `value_of` gives a variable (null: not set).
std::string serialised_by(int kernels, const std::function<const char*(const char* name)>& value_of,
                          const std::vector<std::string>& libraries);

}  // namespace voxspring::cuda
