// Blocks of one launch send points to each other through L2. A point travels in a word of 16 bytes, the last
// four of which are a tag. A word is read and written whole: once the tag has arrived, so has the point, and
// no barrier is needed. This is device code only.
//
// Words between blocks of one launch are stored with the scope of the GPU and, unless the launch steps a part
// of a body, loaded with it. Words between parts of a body, whose kernels may run on different devices, are
// accessed with that of the system. The latter lie in the memory of the device that reads them, so that only
// stores cross the link. The code relies on this:
// - PTX counts .b128 as one scalar, unlike a vector of four floats, which is four accesses in any order. A
//   store and a load of one word do not tear if the scope of each includes the other's thread. Hence .sys on
//   both sides: .gpu would leave out the threads of other devices.
// - NVLink delivers an aligned word of 16 bytes whole. Over NVLink NCCL relies on even more (LL128: lines of
//   128 bytes arrive in order), but over other links only on words of 8 bytes. So the backend refuses to send
//   words of 16 bytes over PCIe.
// - The order of two words is undefined, and nothing depends on it: each word has its own tag.
#pragma once

#include "backends/layout/records/resident.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
/// Stores a point and its tag as one word if `here` is true. The store is predicated, so there is no branch.
__device__ inline void publish_if(bool here, TaggedPoint* to, Vector<float> point, std::uint32_t tag) {
    asm volatile(
        "{\n"
        " .reg .pred here;\n"
        " .reg .b64 low, high;\n"
        " .reg .b128 word;\n"
        " setp.ne.u32 here, %5, 0;\n"
        " mov.b64 low, {%1, %2};\n"
        " mov.b64 high, {%3, %4};\n"
        " mov.b128 word, {low, high};\n"
        " @here st.relaxed.gpu.global.b128 [%0], word;\n"
        "}" ::"l"(to),
        "f"(point.x), "f"(point.y), "f"(point.z), "r"(tag), "r"(std::uint32_t(here))
        : "memory");
}

/// Defines TaggedPoint name(from), which loads a word. The scope, "gpu" or "sys", is part of the instruction.
#define LOAD_WORD(name, scope)                                                               \
    __device__ inline TaggedPoint name(const TaggedPoint* from) {                            \
        TaggedPoint found;                                                                   \
        asm volatile(                                                                        \
            "{\n"                                                                            \
            " .reg .b64 low, high;\n"                                                        \
            " .reg .b128 word;\n"                                                            \
            " ld.relaxed." scope                                                             \
            ".global.b128 word, [%4];\n"                                                     \
            " mov.b128 {low, high}, word;\n"                                                 \
            " mov.b64 {%0, %1}, low;\n"                                                      \
            " mov.b64 {%2, %3}, high;\n"                                                     \
            "}"                                                                              \
            : "=f"(found.point.x), "=f"(found.point.y), "=f"(found.point.z), "=r"(found.tag) \
            : "l"(from)                                                                      \
            : "memory");                                                                     \
        return found;                                                                        \
    }
LOAD_WORD(load_word_gpu, "gpu")
/// Reads words that threads of any device write.
LOAD_WORD(load_word_system, "sys")
#undef LOAD_WORD

/// Stores a point and its tag as one word, for readers on any device.
__device__ inline void store_word_system(TaggedPoint* to, Vector<float> point, std::uint32_t tag) {
    asm volatile(
        "{\n"
        " .reg .b64 low, high;\n"
        " .reg .b128 word;\n"
        " mov.b64 low, {%1, %2};\n"
        " mov.b64 high, {%3, %4};\n"
        " mov.b128 word, {low, high};\n"
        " st.relaxed.sys.global.b128 [%0], word;\n"
        "}" ::"l"(to),
        "f"(point.x), "f"(point.y), "f"(point.z), "r"(tag)
        : "memory");
}
#endif

}  // namespace voxspring::cuda
