// How accurate the square roots and divisions of a SIMD register are.
#pragma once

#include <cstdint>

namespace voxspring {

enum class Root : std::uint8_t {
    exact,    ///< IEEE 754's: the same bits on every processor
    refined,  ///< the processor's approximate reciprocals after one Newton step
    raw,      ///< the approximations themselves, whose error the SIMD target decides (lanes-inl.h)
};

/// Relative error, beyond rounding in float32, of a number divided by a length. It is the sum of the errors
/// of a reciprocal root and of a reciprocal, each of which is at most `approximation`.
constexpr double error_of_roots(Root root, double approximation) {
    switch (root) {
        case Root::exact:
            return 0;
        case Root::refined:
            // A Newton step turns an error e into e^2 for a reciprocal, and into 3/2 e^2 for a reciprocal
            // root. Each of the two results is then rounded, by one unit of 2^-23 at most.
            return 2.5 * approximation * approximation + 0x1p-22;
        case Root::raw:
            return 2 * approximation;
    }
    return 0;
}

}  // namespace voxspring
