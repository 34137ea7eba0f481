// What a kernel is compiled for: a scene's terms and a specification's formulation.
#pragma once

#include <cstdint>

#include "backends/physics/formulation.h"
#include "backends/physics/portable.h"

namespace voxspring::cuda {

// Terms of a scene, and what else changes the code, as bits.
inline constexpr std::uint32_t term_materials = 1;  ///< springs between several materials
inline constexpr std::uint32_t term_damping = 2;
inline constexpr std::uint32_t term_gravity = 4;
inline constexpr std::uint32_t term_pins = 8;
inline constexpr std::uint32_t term_loads = 16;
inline constexpr std::uint32_t term_own_rests = 32;     ///< springs beyond the lattice, by displacements
inline constexpr std::uint32_t term_refined_root = 64;  ///< refined_strain_density()
inline constexpr std::uint32_t term_interior = 128;     ///< no masks where no neighbour is missing
inline constexpr std::uint32_t term_own_springs = 256;  ///< springs beyond the lattice, by deltas
inline constexpr std::uint32_t term_resting = 512;      ///< blocks at rest are not stepped (resting.h)
inline constexpr std::uint32_t term_flush = 1024;       ///< what is less than flushed_below is zero
inline constexpr std::uint32_t all_terms =
    term_materials | term_damping | term_gravity | term_pins | term_loads;

/// `scene_groups`: mask bits of the spring groups in use. `scene_terms`: those compiled in. `at_run_time`:
/// ask the step's arguments which of them the scene has, instead of taking all for granted.
template <Formulation scene_formulation, std::uint32_t scene_groups, std::uint32_t scene_terms,
          bool at_run_time>
struct KernelTerms {
    static constexpr Formulation formulation = scene_formulation;
    static constexpr bool positions = on_positions(scene_formulation);
    static constexpr bool increments = by_increments(scene_formulation);
    static constexpr bool split = scene_formulation == Formulation::compensated;
    static constexpr bool refined = (scene_terms & term_refined_root) != 0;
    static constexpr std::uint32_t groups = scene_groups;

    /// Whether `term` is compiled in.
    static VOXSPRING_HOST_DEVICE constexpr bool compiled(std::uint32_t term) {
        return (scene_terms & term) != 0;
    }
    /// Whether the scene has it: what `asked` says, if that is to be asked.
    template <std::uint32_t term>
    static VOXSPRING_HOST_DEVICE constexpr bool has(bool asked) {
        return compiled(term) && (!at_run_time || asked);
    }
    static VOXSPRING_HOST_DEVICE constexpr bool has_group(std::uint32_t bits, std::uint32_t asked) {
        return (groups & bits) != 0 && (!at_run_time || (asked & bits) != 0);
    }
};

}  // namespace voxspring::cuda
