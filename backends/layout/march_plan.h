// The plan of a launch of cuda_march: the tile (chosen by the predicted time of a step, march_cost.h), the
// items (the work of each block), and the mask words of items that need masks. Made on the host, without a
// device.
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

/// The planes `begin` to `end` (exclusive) of a part of a body that are stepped while the particles of its
/// borders travel to and from neighbouring parts.
struct MarchInterior {
    int begin = 0, end = std::numeric_limits<int>::max();
    /// The planes that are stepped, the interior among them. Planes before and after them have no particles
    /// but ghosts (Problem::ghosts), which are written as they arrive.
    int own_begin = 0, own_end = std::numeric_limits<int>::max();
    bool operator==(const MarchInterior&) const = default;
};
/// The longest run of planes without a particle in `border`. It may be empty.
MarchInterior interior_of(const Problem& problem, const std::vector<std::uint32_t>& border);

/// The work of all blocks.
struct MarchPlan {
    MarchTile tile;
    /// One item per block, in the order of blocks: first the items outside of the interior (MarchInterior),
    /// then those inside. Within each of these two groups the longest items come first.
    std::vector<MarchItem> items;
    std::size_t border_items = 0;      ///< how many items are outside of the interior
    std::vector<std::uint64_t> words;  ///< mask words of all items (MarchItem::words)
    /// How many of every `kept_of` planes the L2 cache is told to keep; 0: it is told nothing.
    int kept_planes = 0;
    double seconds = 0;  ///< predicted time of a step
    bool operator==(const MarchPlan&) const = default;
};

/// Predicted times that differ by less than this factor count as equal, because predictions are no more
/// accurate (march_cost_test).
constexpr double max_alike = 1.03;
/// Plans items for all particles that are no ghosts. Takes, of the `tiles` that fit the device, the first
/// whose predicted step is at most max_alike times the shortest. If none fits, takes the first of `tiles`,
/// which must not be empty. Neither the tile nor the cutting into items changes the bits of a result. No item
/// has planes both inside and outside of `interior`.
MarchPlan plan_march(const Problem& problem, const std::vector<MarchTile>& tiles, Precision precision,
                     Formulation formulation, const MarchDevice& device, MarchInterior interior = {});
/// An upper bound of the bytes of the items and mask words of a plan for a body that is not cut into parts.
std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape);

}  // namespace voxspring::layout
