// Large arrays in huge pages.
#pragma once

#include <sys/mman.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace voxspring {

inline constexpr std::size_t huge_page_bytes = std::size_t(1) << 21, large_array_bytes = 8 * huge_page_bytes;

/// Asks the system to put a large array, of large_array_bytes or more, into huge pages. The system clears
/// each page when it is first touched; with small pages this takes longer than filling or copying the array.
/// If the system refuses, nothing changes.
inline void prefer_huge_pages(void* memory, std::size_t bytes) {
    constexpr std::uintptr_t page = huge_page_bytes;
    if (bytes < large_array_bytes) return;
    const auto address = std::bit_cast<std::uintptr_t>(memory);
    const std::uintptr_t begin = (address + page - 1) / page * page, end = (address + bytes) / page * page;
    (void)madvise(std::bit_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

/// Touches the pages of a large array with all threads, but for the last 2 MiB at most, so that the system
/// clears them in parallel. The values are lost.
inline void touch_pages(void* memory, std::size_t bytes) {
    constexpr std::size_t page = 4096, share = huge_page_bytes;
    if (bytes < large_array_bytes) return;
    const auto shares = std::ptrdiff_t(bytes / share);
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < shares; ++n) {
        for (std::size_t at = 0; at < share; at += page)
            static_cast<volatile char*>(memory)[std::size_t(n) * share + at] = 0;
    }
}

/// Makes room in a list. If it has to grow, its values are lost, and the system is asked for huge pages if it
/// is large.
template <class T>
void reserve_in_huge_pages(std::vector<T>& list, std::size_t size) {
    if (list.capacity() >= size) return;
    list.clear();
    list.reserve(size);
    prefer_huge_pages(list.data(), size * sizeof(T));
}

/// Resizes a list. Old values may be lost; new elements are `value`. If a large list has to grow, the system
/// is asked for huge pages, which all threads touch.
template <class T>
void resize_in_huge_pages(std::vector<T>& list, std::size_t size, const T& value = T()) {
    if (list.capacity() < size) {
        reserve_in_huge_pages(list, size);
        touch_pages(list.data(), size * sizeof(T));
    }
    list.resize(size, value);
}

}  // namespace voxspring
