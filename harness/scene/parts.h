// Which particles hang together by springs, and which of them nothing holds: voxels of noise beside a body
// fall freely, and would rule what is said of all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backends/physics/problem.h"

namespace voxspring {

struct BodyParts {
    std::vector<std::size_t> sizes;   ///< particles of each part, the largest first
    std::vector<std::uint32_t> part;  ///< per particle, an index into `sizes`; empty where there is one part
    std::vector<std::uint8_t> is_held;  ///< per part, 1 = it has a pinned particle or one that a tool holds

    std::uint32_t part_of(std::size_t particle) const { return part.empty() ? 0 : part[particle]; }
    /// The particles of the parts that nothing holds, ascending; none where nothing holds any part.
    std::vector<std::uint32_t> loose() const;
};

/// By the springs that the problem has now.
BodyParts parts_of(const Problem& problem);

/// "the body has 3 parts: 10,437, 9 and 5 particles; 14 particles are in parts that nothing pins, and fall";
/// empty where there is one part. Without gravity they "are not held back".
std::string describe(const BodyParts& parts, bool has_gravity);

/// 12345 as "12,345".
std::string with_commas(std::size_t number);

/// Which parts of a dataset make the body.
struct PartsToKeep {
    std::size_t least = 0;  ///< those of so many particles at least; 0: the largest alone

    /// As a command line and a scene file say it: "largest", or the number.
    std::string text() const { return least == 0 ? "largest" : std::to_string(least); }
};
inline constexpr std::int64_t max_part_particles = 4'294'967'295;

/// Makes the voxels of the other parts inactive, parts being by springs of these groups. Returns what to say
/// of it; empty where nothing was left out. Where no part is as large, every voxel is inactive then.
std::string leave_out_parts(VoxelGrid& grid, std::uint32_t group_bits, const PartsToKeep& keep);

}  // namespace voxspring
