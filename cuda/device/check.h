// Turns a CUDA status into an exception.
#pragma once

#include <cuda_runtime_api.h>

#include <source_location>
#include <string>

#include "backends/backend.h"

namespace voxspring::cuda {

/// Throws DeviceError, naming the error and the caller's file and line, unless `status` is success.
inline void check(cudaError_t status, const std::source_location& where = std::source_location::current()) {
    if (status == cudaSuccess) return;
    const std::string file = where.file_name();
    throw DeviceError(std::string(cudaGetErrorName(status)) + ": " + cudaGetErrorString(status) + " (" +
                      file.substr(file.find_last_of('/') + 1) + ":" + std::to_string(where.line()) + ")");
}

}  // namespace voxspring::cuda
