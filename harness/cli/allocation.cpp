// Replaces `operator new` for this program, since vectors of large scenes take gigabytes.
#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <exception>
#include <new>
#include <thread>
#include <vector>

#include "backends/huge_pages.h"

// Sanitizers bring their own operators, and check that allocation and release match. Builds with sanitizers
// use Clang, so Clang is left out.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)

namespace {

/// Touches large arrays with several threads, since the system clears memory at its first touch. OpenMP is
/// not used: its threads would be missing in a process that is forked from this one.
void touch(void* memory, std::size_t bytes) {
    constexpr std::size_t page = 4096, worth_a_thread = std::size_t(1) << 25;
    if (bytes < 2 * worth_a_thread) return;  // the usual case: counting processors is a system call
    const std::size_t shares =
        std::min<std::size_t>(bytes / worth_a_thread, std::min(16U, std::thread::hardware_concurrency()));
    if (shares < 2) return;
    const std::size_t pages = bytes / page;
    volatile auto* const begin = static_cast<std::byte*>(memory);
    const auto touch_share = [=](std::size_t n) {
        for (std::size_t at = pages * n / shares; at < pages * (n + 1) / shares; ++at)
            begin[at * page] = std::byte(0);
    };
    try {
        std::vector<std::jthread> threads;
        threads.reserve(shares);
        for (std::size_t n = 0; n < shares; ++n) threads.emplace_back(touch_share, n);
    } catch (const std::exception&) {
        // Without threads the caller touches the memory as it fills the array.
    }
}

}  // namespace

void* operator new(std::size_t bytes) {
    for (;;) {
        if (void* const memory = std::malloc(bytes == 0 ? 1 : bytes); memory != nullptr) {
            voxspring::prefer_huge_pages(memory, bytes);
            touch(memory, bytes);
            return memory;
        }
        const std::new_handler handler = std::get_new_handler();
        if (handler == nullptr) throw std::bad_alloc();
        handler();
    }
}

void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t /*bytes*/) noexcept { std::free(memory); }

#endif
