// Move-only owners of CUDA's handles.
#pragma once

#include <cuda_runtime_api.h>

#include <utility>

#include "cuda/device/check.h"

namespace voxspring::cuda {

/// Owns a handle of type `T`, which it destroys with `destroy`. The status of `destroy` is ignored.
template <class T, cudaError_t (*destroy)(T)>
class Handle {
public:
    Handle() = default;
    explicit Handle(T handle) : handle_(handle) {}
    Handle(Handle&& other) noexcept : handle_(std::exchange(other.handle_, T{})) {}
    Handle& operator=(Handle&& other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    ~Handle() {
        if (handle_ != T{}) static_cast<void>(destroy(handle_));
    }
    T get() const { return handle_; }

private:
    T handle_{};
};

}  // namespace voxspring::cuda
