// How accurate the square roots and divisions of a SIMD register are.
#pragma once

#include <cstdint>

namespace voxspring {

enum class Root : std::uint8_t {
    exact,    ///< IEEE 754's: the same bits on every processor
    refined,  ///< the processor's approximate reciprocals after one Newton step: to some 22 bits
    raw,      ///< the approximations themselves: to some 12 bits, or 14 with AVX-512
};

}  // namespace voxspring
