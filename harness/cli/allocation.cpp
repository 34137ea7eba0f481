// The program's own `operator new`: vectors of large scenes are gigabytes.
#include <cstdlib>
#include <new>

#include "backends/huge_pages.h"

// Sanitizers bring their own, and know which function gave what back. Clang is what they are built with here.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)

void* operator new(std::size_t bytes) {
    for (;;) {
        if (void* const memory = std::malloc(bytes == 0 ? 1 : bytes); memory != nullptr) {
            voxspring::prefer_huge_pages(memory, bytes);
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
