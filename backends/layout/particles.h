// How particles lie in memory: words, state, loads, masses, and the particles that a tool holds or a picture
// shows. Made on the host, without a device.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "backends/layout/records/feed.h"
#include "backends/layout/records/motion.h"
#include "backends/layout/records/terms.h"
#include "backends/layout/records/tool.h"
#include "backends/layout/vectors.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// The largest number of words in an array. Threads index words by int; the last block may have 1023 threads
/// too many, whose index must not overflow either.
inline constexpr std::size_t max_words = 0x7FFFFFFF - 1023;

/// Maps each particle to its word in an array.
struct Placement {
    std::size_t words = 0;
    std::size_t first = 0;
    /// Particle i has word first + (*voxel)[i] or, if this is null, word first + i.
    const std::vector<std::uint32_t>* voxel = nullptr;
    std::size_t at(std::size_t particle) const {
        return first + (voxel == nullptr ? particle : (*voxel)[particle]);
    }
};

/// Places particles on the grid: one word per voxel, and before and after these so many guard words that all
/// 26 neighbours of every voxel have a word.
Placement place_on_grid(const Lattice& lattice);
/// Particle i has word i, without guard words.
Placement place_compact(const Problem& problem);

/// The state of every particle in the variables of a formulation (formulation.h). Words without a particle
/// are zero, and arrays that the formulation does not use are empty.
template <class Real>
struct PackedState {
    std::vector<ParticleRecord<Real>> current;      ///< position x or displacement u, at t
    std::vector<ParticleRecord<Real>> previous;     ///< x or u at t - dt
    std::vector<ParticleRecord<Real>> current_low;  ///< low parts of u
    /// The increments v and their low parts: x of all words, then y, then z, increment_pitch() elements
    /// apart.
    std::vector<Real> increment, increment_low;
};
/// The number of elements from one axis of the increments to the next. Each axis begins on a cache line.
std::size_t increment_pitch(const Placement& placement);
/// Packs the state into words. `bits`: for each particle the bits of its word (ParticleRecord).
template <class Real>
PackedState<Real> pack(const Problem& problem, const State& state, const Placement& placement,
                       std::span<const std::uint32_t> bits, Formulation formulation);
template <class Real>
State unpack(const Problem& problem, const PackedState<Real>& packed, const Placement& placement,
             Formulation formulation);

/// Problem::load, one per word. Empty if the problem has none.
template <class Real>
std::vector<Vector<Real>> pack_load(const Problem& problem, const Placement& placement);
/// 1 / mass of the particle in each word, 0 in words without a particle. Empty if there is one material.
template <class Real>
std::vector<Real> pack_inverse_masses(const Problem& problem, const Placement& placement);
/// 1 / stiffness, one per word. Empty if there is one material.
template <class Real>
std::vector<Real> pack_compliance(const Problem& problem, const Placement& placement);

/// Bytes of the arrays of a problem's state, loads and masses. With `every_term` there are loads and masses
/// even if the problem has none.
template <class Real>
std::uint64_t particle_bytes(const Problem& problem, const Placement& placement, Formulation formulation,
                             bool every_term = false);

/// Makes a Motion. Its pointers `load` and `inverse_masses` are null: the caller sets them to arrays on the
/// device.
template <class Real>
Motion<Real> make_motion(const Problem& problem);

/// For each particle the active bit and, if it is pinned, the pinned bit.
std::vector<std::uint32_t> state_bits(const Problem& problem);

/// Which terms (records/terms.h) `problem` has: materials, damping, gravity, pins and loads. The bits for
/// other choices of a kernel are not set.
std::uint32_t terms_of(const Problem& problem);

/// Packs the particles that the tool holds, in the order of Tool::particles. Empty without a tool.
template <class Real>
std::vector<HeldWord<Real>> pack_held(const Problem& problem, const Placement& placement,
                                      Formulation formulation);

/// The force on the tool (ToolFacet::tool_force()): minus the sum of the tool's forces on the held particles.
template <class Real>
glm::dvec3 force_on_tool(const std::vector<HeldForce<Real>>& forces);

/// Packs `particles`, whose displacements a picture shows, in their order. word_of(i): the index of particle
/// i's word.
template <class Real, class WordOf>
std::vector<FedWord<Real>> pack_fed(const Problem& problem, const std::vector<std::uint32_t>& particles,
                                    Formulation formulation, WordOf word_of) {
    std::vector<FedWord<Real>> fed;
    fed.reserve(particles.size());
    for (const std::uint32_t i : particles) {
        const glm::dvec3 rest = on_positions(formulation) ? problem.rest_position[i] : glm::dvec3(0);
        fed.push_back({vector_of<Real>(rest), std::uint32_t(word_of(i))});
    }
    return fed;
}

}  // namespace voxspring::layout
