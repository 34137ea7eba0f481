// What a host tells shaders/compute_explicit.comp about a problem.
#pragma once

#include <array>
#include <glm/vec4.hpp>
#include <vector>

#include "backends/glsl/compute.h"
#include "backends/layout/neighbour_lists.h"

namespace voxspring::glsl {

/// Which lists a problem needs.
struct ListKind {
    /// Springs that differ within a group have their stiffness and rest length in the secondary list.
    bool secondary = false;
    /// Another list says how springs beyond the lattice lie at rest, if the formulation needs that.
    bool off_lattice_rest = false;
};
ListKind list_kind(const Problem& problem, Formulation formulation);

/// Slots of each list.
std::uint32_t list_slots(const Problem& problem);

/// Bytes that upload() of a backend takes.
std::uint64_t explicit_bytes(const Problem& problem, const Options& options);

/// Bytes of each list by its name, empty lists included.
std::vector<std::pair<const char*, std::uint64_t>> list_bytes(const Problem& problem, const Options& options);

template <class Real>
layout::NeighbourLists<Real> make_lists(const Problem& problem, Formulation formulation);

/// New lists of the particles that `edit` touched, with `slots` slots per particle.
template <class Real>
layout::EditedLists<Real> edited_lists(const Problem& edited, const SpringEdit& edit, std::uint32_t slots,
                                       Formulation formulation);

/// Constants of shaders/compute_explicit.comp beyond those of terms.glsl.
Constants explicit_constants(ListKind kind, bool all_terms);
/// Constants of shaders/edit_rows.comp.
Constants edit_constants(ListKind kind, Formulation formulation);

/// Sets the uniforms of shaders/compute_explicit.comp. Rest lengths of `step` are as the device measured
/// them.
template <class Real, class Uniforms>
void set_explicit(Uniforms&& uniforms, const Problem& problem, const layout::ExplicitStep<Real>& step) {
    uniforms.set("particles", step.particles);
    uniforms.set("slot_stride", int(step.shape.slot_stride));
    std::vector<glm::vec<4, Real>> rest;
    for (const layout::SpringRest<Real>& r : step.rest)
        rest.emplace_back(r.offset.x, r.offset.y, r.offset.z, r.deficit);
    uniforms.set("rest", rest);
    uniforms.set("rest_length", step.rest_length);
    uniforms.set("group_stiffness", step.stiffness);
    std::array<int, 3> first_slot{}, slots{};
    const std::array<std::uint32_t, 3> bits = {FACE_BITS, EDGE_BITS, CORNER_BITS};
    for (std::size_t g = 0; g < bits.size(); ++g) {
        first_slot[g] = int(step.first_slot[g]);
        slots[g] = (problem.group_bits & bits[g]) != 0 ? 1 : 0;
    }
    uniforms.set("first_slot", first_slot);
    uniforms.set("slots", slots);
}

}  // namespace voxspring::glsl
