// The argument of explicit addressing's kernels (cuda/kernels/explicit.h).
#pragma once

#include "backends/layout/records/motion.h"
#include "backends/layout/records/springs.h"
#include "backends/physics/neighbours.h"

namespace voxspring::layout {

/// Where lists are in memory: slot s of particle i is element i * particle_stride + s * slot_stride.
/// `vertical` lists (Figure 6 b of the paper) keep the same slot of all particles together; `concatenated`
/// lists (Figure 6 a) keep all slots of a particle together.
struct ListShape {
    std::uint32_t particle_stride = 0;
    std::uint32_t slot_stride = 0;
    std::uint32_t slots = 0;  ///< per particle
    VOXSPRING_HOST_DEVICE std::size_t at(std::uint32_t particle, std::uint32_t slot) const {
        return std::size_t(particle) * particle_stride + std::size_t(slot) * slot_stride;
    }
    bool operator==(const ListShape&) const = default;
};

/// Everything a step needs besides the particles' state.
template <class Real>
struct ExplicitStep {
    int particles;
    std::uint32_t group_bits;
    ListShape shape;
    /// The lists: indices of neighbours. In formulations on displacements each element also has a direction
    /// code (neighbours.h).
    const std::uint32_t* neighbour;
    const SpringConstants<Real>* constants;  ///< per spring (the secondary list); null: per group
    /// Used if `constants` is null: the slot at which each spring group begins in a particle's list, and the
    /// constants of the group's springs.
    std::uint32_t first_slot[3];
    Real stiffness[3], rest_length[3];
    SpringRest<Real> rest[direction_codes];  ///< how springs lie at rest, by direction code
    /// How springs with direction code OWN_DIRECTION lie at rest, by list element; null: there are none.
    const SpringRest<Real>* off_lattice_rest;
    Motion<Real> motion;
    bool operator==(const ExplicitStep&) const = default;
};

/// The bits of a particle's word that count its springs, if each spring has constants (a secondary list).
inline constexpr std::uint32_t list_count_bits = NEIGHBOUR_BITS;

/// If constants are stored per spring group, not per spring, the bits of a particle's word hold the number of
/// its springs in each group: the number for `group` begins at bit shift(group).
struct GroupCounters {
    static VOXSPRING_HOST_DEVICE std::uint32_t shift(int group) {
        return group == 0 ? 0 : group == 1 ? 3 : 7;
    }
    static VOXSPRING_HOST_DEVICE std::uint32_t count(std::uint32_t bits, int group) {
        return bits >> shift(group) & (group == 0 ? 7U : 15U);
    }
};

/// The number of springs whose neighbours a thread fetches together, unless it takes short_chunk of them
/// (cuda/kernels/explicit.h) or, with rows (ListRows), one by one. If constants are stored per spring, the
/// number of slots per particle is a multiple of this.
inline constexpr int list_chunk = 6;

/// Rows that may stand before the lists, as in the paper. A row has one element per particle and begins on a
/// cache line. The first row says where each particle's list begins. The others say how many entries the list
/// has: one row if constants are stored per spring (`secondary`), otherwise one row per spring group.
struct ListRows {
    static constexpr std::uint32_t cache_line = 32;  ///< elements of 4 bytes
    static VOXSPRING_HOST_DEVICE std::uint32_t count(bool secondary) { return secondary ? 2 : 4; }
    static VOXSPRING_HOST_DEVICE std::uint32_t stride(std::uint32_t particles) {
        return (particles + cache_line - 1) / cache_line * cache_line;
    }
    /// The number of elements of all rows together.
    static VOXSPRING_HOST_DEVICE std::size_t size(std::uint32_t particles, bool secondary) {
        return std::size_t(stride(particles)) * count(secondary);
    }
};

}  // namespace voxspring::layout
