// Rounding up to whole units.
#pragma once

namespace voxspring::layout {

/// How many units of size `unit` it takes to hold `count`.
template <class T>
constexpr T units_of(T count, T unit) {
    return (count + unit - 1) / unit;
}
/// `count` rounded up to a multiple of `unit`.
template <class T>
constexpr T rounded_up(T count, T unit) {
    return units_of(count, unit) * unit;
}

}  // namespace voxspring::layout
