// What keeps kernels from running at the same time, where some wait for each other.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace voxspring::cuda {

/// Empty, or why `kernels` kernels in as many streams of this process need not run at the same time: "with
/// CUDA_LAUNCH_BLOCKING=1 kernels run one at a time". To be asked once CUDA is in use, since that loads
/// tools.
std::string serialised_by(int kernels);

/// The same of an environment, whose variables `value_of` gives (null: not set), and of loaded libraries.
std::string serialised_by(int kernels, const std::function<const char*(const char* name)>& value_of,
                          const std::vector<std::string>& libraries);

}  // namespace voxspring::cuda
