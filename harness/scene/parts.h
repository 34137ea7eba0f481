// Finds the connected parts of a body (no spring joins two parts), and the parts that nothing holds. Voxels
// of noise beside a body form parts of this kind: they fall freely, and would dominate statistics of the
// whole body.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

struct BodyParts {
    std::vector<std::size_t> sizes;     ///< number of particles of each part, the largest first
    std::vector<std::uint32_t> part;    ///< per particle, an index into `sizes`; empty if there is one part
    std::vector<std::uint8_t> is_held;  ///< per part, 1 = it has a pinned particle or one that a tool holds

    std::uint32_t part_of(std::size_t particle) const { return part.empty() ? 0 : part[particle]; }
    /// The particles of the parts that nothing holds, ascending. Empty if no part of the body is held.
    std::vector<std::uint32_t> loose() const;
};

/// Finds the connected parts of the body. Springs join the particles of a part, directly or through other
/// particles.
BodyParts parts_of(const Problem& problem);

/// A note: "the body has 3 parts: 10,437, 9 and 5 particles; 14 particles are in parts that nothing pins, and
/// fall". Without gravity it ends after "pins". The text is empty if there is one part.
std::string describe(const BodyParts& parts, bool has_gravity);

/// Writes the number 12345 as "12,345".
std::string with_commas(std::size_t number);

/// Which parts of a dataset make the body.
struct PartsToKeep {
    /// Parts with fewer particles (with particles at corners: voxels) are left out. 0: only the largest part
    /// is kept.
    std::size_t least = 0;

    /// The choice as command lines and scene files spell it: "largest", or `least` as a number.
    std::string text() const { return least == 0 ? "largest" : std::to_string(least); }
};
inline constexpr std::int64_t max_part_particles = 4'294'967'295;

/// Makes all voxels of the parts that `keep` leaves out inactive. Neighbours in the directions of
/// `group_bits` are in one part. Returns a note for the user, in which a voxel is called `noun`; it is empty
/// if no part is left out. If no part is large enough, every voxel becomes inactive.
std::string leave_out_parts(VoxelGrid& grid, std::uint32_t group_bits, const PartsToKeep& keep,
                            const std::string& noun);

}  // namespace voxspring
