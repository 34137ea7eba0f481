// Which block of the march along z does what: the tile, chosen by what a step costs with it
// (march_cost.h), items of work, and the words of those that need masks. Built on the host and without a
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

namespace voxspring::cuda {

/// Planes `begin` to `end` (exclusive) of a slab, which are stepped while its borders travel.
struct MarchInterior {
    int begin = 0, end = std::numeric_limits<int>::max();
    bool operator==(const MarchInterior&) const = default;
};
/// The longest run of planes without a particle of a border; may be empty.
MarchInterior interior_of(const Lattice& lattice, const std::vector<std::uint32_t>& border);

/// What blocks do.
struct MarchPlan {
    MarchTile tile;
    /// In the order of blocks: those of planes outside of the interior and then the others, of either the
    /// longest first.
    std::vector<MarchItem> items;
    std::size_t border_items = 0;  ///< how many are outside of it
    std::vector<std::uint64_t> words;
    double seconds = 0;  ///< of a step, as predicted
    bool operator==(const MarchPlan&) const = default;
};

/// Times up to so many times the shortest are alike: less than predictions are off (march_cost_test).
constexpr double max_alike = 1.03;
/// Items for all particles, in the tile that a step is predicted to be the shortest with: of those of `tiles`
/// that fit the device, or the first if none does. Of tiles that are alike the first. At least one tile.
/// Particles step to the same bits whatever the tile and however runs of planes are cut into items: none has
/// planes of the interior and others.
MarchPlan plan_march(const Problem& problem, const std::vector<MarchTile>& tiles, Precision precision,
                     Formulation formulation, const MarchDevice& device, MarchInterior interior = {});
/// Bytes of a plan whose interior is all, at most.
std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape);

}  // namespace voxspring::cuda
