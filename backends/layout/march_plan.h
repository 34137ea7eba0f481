// Which block of the march along z does what: the tile, chosen by the predicted time of a step
// (march_cost.h), items of work, and words for items that need masks. Built on the host, without a device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/march_cost.h"
#include "backends/layout/records/march.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// Planes `begin` to `end` (exclusive) of a slab, which are stepped while its borders travel.
struct MarchInterior {
    int begin = 0, end = std::numeric_limits<int>::max();
    bool operator==(const MarchInterior&) const = default;
};
/// The longest run of planes without a particle of a border; may be empty.
MarchInterior interior_of(const Lattice& lattice, const std::vector<std::uint32_t>& border);

/// The work of all blocks.
struct MarchPlan {
    MarchTile tile;
    /// Items in the order of blocks: first those outside of the interior, then the others, either group with
    /// the longest first.
    std::vector<MarchItem> items;
    std::size_t border_items = 0;  ///< how many are outside of the interior
    std::vector<std::uint64_t> words;
    int kept_planes = 0;  ///< that L2 is told to keep, of every kept_of; 0: it is told nothing
    double seconds = 0;   ///< predicted time of a step
    bool operator==(const MarchPlan&) const = default;
};

/// Times that differ by less than this factor count as alike: predictions are off by more (march_cost_test).
constexpr double max_alike = 1.03;
/// Items for all particles, in the tile with the shortest predicted step among those of `tiles` that fit the
/// device, or in the first tile if none fits. Of tiles that are alike the first is chosen. `tiles` must not
/// be empty. Particles step to the same bits whatever the tile, and however runs of planes are cut into
/// items. No item has both planes of the interior and others.
MarchPlan plan_march(const Problem& problem, const std::vector<MarchTile>& tiles, Precision precision,
                     Formulation formulation, const MarchDevice& device, MarchInterior interior = {});
/// An upper bound of the bytes of a plan whose interior is everything.
std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape);

}  // namespace voxspring::layout
