// Large arrays in huge pages.
#pragma once

#include <sys/mman.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace voxspring {

/// Asks the system to put a large array, of 16 MiB or more, into huge pages. The system clears each page when
/// it is first touched; with small pages this takes longer than filling or copying the array. If the system
/// refuses, nothing changes.
inline void prefer_huge_pages(void* memory, std::size_t bytes) {
    constexpr std::uintptr_t page = std::uintptr_t(1) << 21;
    constexpr std::size_t large = 8 * page;
    if (bytes < large) return;
    const auto address = std::bit_cast<std::uintptr_t>(memory);
    const std::uintptr_t begin = (address + page - 1) / page * page, end = (address + bytes) / page * page;
    (void)madvise(std::bit_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

/// Resizes a list. Old values may be lost; new elements are `value`. If a large list has to grow, the system
/// is asked for huge pages.
template <class T>
void resize_in_huge_pages(std::vector<T>& list, std::size_t size, const T& value = T()) {
    if (list.capacity() < size) {
        list.clear();
        list.reserve(size);
        prefer_huge_pages(list.data(), size * sizeof(T));
    }
    list.resize(size, value);
}

}  // namespace voxspring
