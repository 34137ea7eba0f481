// Blocks of one launch send points to each other through L2. A point travels in a word of 16 bytes, the last
// four of which are a tag. A word is read and written whole: where the tag has arrived, so has the point, and
// no barrier is needed. Device code alone.
#pragma once

#include "backends/layout/records/resident.h"

namespace voxspring::cuda {

#ifdef __CUDACC__
/// Where `here` is false nothing is sent, without a branch.
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

__device__ inline TaggedPoint look_up(const TaggedPoint* from) {
    TaggedPoint found;
    asm volatile(
        "{\n"
        " .reg .b64 low, high;\n"
        " .reg .b128 word;\n"
        " ld.relaxed.gpu.global.b128 word, [%4];\n"
        " mov.b128 {low, high}, word;\n"
        " mov.b64 {%0, %1}, low;\n"
        " mov.b64 {%2, %3}, high;\n"
        "}"
        : "=f"(found.point.x), "=f"(found.point.y), "=f"(found.point.z), "=r"(found.tag)
        : "l"(from)
        : "memory");
    return found;
}
#endif

}  // namespace voxspring::cuda
