// Large arrays of particle data, first touched by the threads that will step the particles.
#pragma once

#include <hwy/aligned_allocator.h>

#include <cstddef>
#include <string>

#include "backends/backend.h"
#include "backends/physics/huge_pages.h"

namespace voxspring::cpu_parallel {

template <class T>
using Array = hwy::AlignedFreeUniquePtr<T[]>;

/// With fewer elements or particles than this, a loop over them is faster on one thread than on several.
constexpr std::ptrdiff_t worth_threads = 1 << 16;

template <class T>
Array<T> filled(std::ptrdiff_t size, T value) {
    Array<T> array = hwy::AllocateAligned<T>(std::size_t(size));
    if (array == nullptr) {
        throw DeviceError("cannot allocate " + std::to_string(std::size_t(size) * sizeof(T)) +
                          " bytes of memory");
    }
    prefer_huge_pages(array.get(), std::size_t(size) * sizeof(T));
    // Each thread writes first to about the part that it will step. The system then puts that part into the
    // memory next to the thread's core (NUMA).
    T* const begin = array.get();
#pragma omp parallel for schedule(static) if (size >= worth_threads)
    for (std::ptrdiff_t i = 0; i < size; ++i) begin[i] = value;
    return array;
}

}  // namespace voxspring::cpu_parallel
