// Terms of a scene, and other choices that change the code of a kernel, as bits.
#pragma once

#include <cstdint>

namespace voxspring::layout {

inline constexpr std::uint32_t term_materials = 1;  ///< several materials, with own stiffnesses and masses
inline constexpr std::uint32_t term_damping = 2;
inline constexpr std::uint32_t term_gravity = 4;
inline constexpr std::uint32_t term_pins = 8;
inline constexpr std::uint32_t term_loads = 16;
inline constexpr std::uint32_t term_off_lattice_rests = 32;  ///< springs beyond the lattice have rest offsets
/// Threads may skip the tests of mask bits if no particle of their warp lacks a neighbour.
inline constexpr std::uint32_t term_full_stencil = 128;
/// The kernel of delta-compressed lists (delta.h) also evaluates springs that no lattice direction describes.
inline constexpr std::uint32_t term_off_lattice_springs = 256;
inline constexpr std::uint32_t term_resting = 512;  ///< blocks at rest are not stepped (resting.h)
inline constexpr std::uint32_t term_flush = 1024;   ///< components of u and v below flushed_below become 0
inline constexpr std::uint32_t term_bit_by_bit = 2048;  ///< no neighbour is fetched before its bit is tested
inline constexpr std::uint32_t all_terms =
    term_materials | term_damping | term_gravity | term_pins | term_loads;

}  // namespace voxspring::layout
