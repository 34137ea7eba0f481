// How particles lie in memory, built on the host and without a device: words, state, loads and masses.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "backends/layout/records/motion.h"
#include "backends/layout/records/terms.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::cuda {

/// Indices of words are of type int, and so are those of the threads that a last block has beyond them.
inline constexpr std::size_t max_words = 0x7FFFFFFF - 1023;

/// Which word of an array a particle has.
struct Placement {
    std::size_t words = 0;
    std::size_t first = 0;
    const std::vector<std::uint32_t>* voxel = nullptr;  ///< null: particle i is word first + i
    std::size_t at(std::size_t particle) const {
        return first + (voxel == nullptr ? particle : (*voxel)[particle]);
    }
};

/// One word per voxel, with enough guard words on either side that the 26 neighbours of every voxel are
/// words.
Placement place_on_grid(const Lattice& lattice);
/// One word per particle.
Placement place_compact(const Problem& problem);

/// The state of every particle in its word, as a formulation has it (formulation.h); words without a particle
/// are zero, and what a formulation has no use for is empty.
template <class Real>
struct PackedState {
    std::vector<ParticleRecord<Real>> current;      ///< x or u
    std::vector<ParticleRecord<Real>> previous;     ///< x or u at t - dt
    std::vector<ParticleRecord<Real>> current_low;  ///< low parts of u
    /// v and its low parts: x of all words, then y, then z, increment_pitch() apart.
    std::vector<Real> increment, increment_low;
};
/// Axes of increments begin on a cache line.
std::size_t increment_pitch(const Placement& placement);
/// `bits`: one per particle.
template <class Real>
PackedState<Real> pack(const Problem& problem, const State& state, const Placement& placement,
                       std::span<const std::uint32_t> bits, Formulation formulation);
template <class Real>
State unpack(const Problem& problem, const PackedState<Real>& packed, const Placement& placement,
             Formulation formulation);

/// Problem::load, one a word; empty if the problem has none.
template <class Real>
std::vector<Vector<Real>> pack_load(const Problem& problem, const Placement& placement);
/// 1 / mass, one a word; empty if there is one material.
template <class Real>
std::vector<Real> pack_inverse_masses(const Problem& problem, const Placement& placement);
/// 1 / stiffness, one a word; empty if there is one material.
template <class Real>
std::vector<Real> pack_compliance(const Problem& problem, const Placement& placement);

/// `load` and `inverse_masses` are the caller's to point at device memory.
template <class Real>
Motion<Real> make_motion(const Problem& problem);

/// Active and pinned bits of every particle.
std::vector<std::uint32_t> state_bits(const Problem& problem);

/// Terms of records/terms.h that `problem` has, lists aside.
std::uint32_t terms_of(const Problem& problem);

}  // namespace voxspring::cuda
