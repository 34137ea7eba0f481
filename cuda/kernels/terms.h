// What a kernel is compiled for: the terms of a scene and the formulation of a specification.
#pragma once

#include <cstdint>

#include "backends/layout/records/terms.h"
#include "backends/physics/formulation.h"
#include "backends/physics/portable.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// `scene_groups`: mask bits of the spring groups that are compiled in. `scene_terms`: the terms that are
/// compiled in. `at_run_time`: the scene may lack some of these; the kernel then tests the step's arguments,
/// or computes with what they hold for an absent term. Otherwise the scene has all of them.
template <Formulation scene_formulation, std::uint32_t scene_groups, std::uint32_t scene_terms,
          bool at_run_time>
struct KernelTerms {
    static constexpr Formulation formulation = scene_formulation;
    static constexpr bool positions = on_positions(scene_formulation);
    static constexpr bool increments = by_increments(scene_formulation);
    static constexpr bool split = scene_formulation == Formulation::compensated;
    static constexpr std::uint32_t groups = scene_groups;

    static VOXSPRING_HOST_DEVICE constexpr bool compiled(std::uint32_t term) {
        return (scene_terms & term) != 0;
    }
    /// Whether the scene has `term`. `asked`: what the step's arguments say, used only if `at_run_time`.
    template <std::uint32_t term>
    static VOXSPRING_HOST_DEVICE constexpr bool has(bool asked) {
        return compiled(term) && (!at_run_time || asked);
    }
    static VOXSPRING_HOST_DEVICE constexpr bool has_group(std::uint32_t bits, std::uint32_t asked) {
        return (groups & bits) != 0 && (!at_run_time || (asked & bits) != 0);
    }
};

}  // namespace voxspring::cuda
