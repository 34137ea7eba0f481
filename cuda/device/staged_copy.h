// Copies between pageable arrays of the host and device memory.
#pragma once

#include <cstddef>

#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// Copies `bytes` bytes after everything enqueued in `stream`, and returns once they have arrived. Large
/// arrays go in pieces through pinned memory, if it can be allocated; all cores fill or empty it. The driver
/// would also copy pageable arrays through pinned memory, but with one core.
void copy_to_device(void* to, const void* from, std::size_t bytes, const Stream& stream);
void copy_from_device(void* to, const void* from, std::size_t bytes, const Stream& stream);

}  // namespace voxspring::cuda
