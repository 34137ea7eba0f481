// Predicts the time of a step of cuda_march, whose blocks march through a lattice along z, from numbers of
// the device and of the plan. plan_march() chooses tiles by this time.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/records/march.h"
#include "backends/physics/formulation.h"

namespace voxspring::layout {

/// A tile of cuda_march: the particles that a block steps per plane.
struct MarchTile {
    std::string name;  ///< its width and height in particles, "128x16": the tuning parameter `tile`
    MarchShape shape;
    int blocks;  ///< how many blocks per multiprocessor the kernel's registers allow
    bool operator==(const MarchTile&) const = default;
};
/// All tiles of a precision. First come the tiles that were measured to be the fastest for some body, those
/// for the largest bodies before the others.
const std::vector<MarchTile>& march_tiles(Precision precision);
/// The tile with this name. Its shape is empty (no warps) if the precision has no such tile.
MarchTile march_tile(const std::string& name, Precision precision);

/// What plan_march() needs to know of a device.
struct MarchDevice {
    int multiprocessors = 0;
    int threads = 0;                     ///< per multiprocessor
    std::size_t shared_bytes = 0;        ///< per multiprocessor
    std::size_t reserved_bytes = 0;      ///< part of shared_bytes that the system takes per block
    std::size_t block_shared_bytes = 0;  ///< the most shared memory of one block
    double hertz = 0;                    ///< clock of the multiprocessors
    double bytes_per_second = 0;         ///< peak rate of the memory
    double cache_bytes = 0;              ///< size of the L2 cache
    bool tensor_copies = true;           ///< a copy engine fills windows; if false, the block's threads do
};
/// How many blocks with this tile share a multiprocessor; 0 if one block is too large for it.
int resident_blocks(const MarchTile& tile, Precision precision, const MarchDevice& device);

/// What it costs a block to step one plane, in cycles of a multiprocessor.
struct MarchRates {
    double wait;  ///< cycles while none of a block's warps can issue an instruction
    /// Cycles that the instructions of a warp take on its quarter of the multiprocessor: of a warp without
    /// masks, with masks, and without particles.
    double full, masked, idle;
};
MarchRates march_rates(const MarchTile& tile, Precision precision, Formulation formulation);

/// An item, the work of one block, as the cost model sees it.
struct MarchLoad {
    double planes = 0;  ///< planes whose springs are evaluated; the first of the lattice counts half
    double cycles = 0;  ///< sum over the block's warps and these planes (MarchRates)
};
/// Predicts the time of a launch whose items (one per block) all have the same tile.
class MarchCost {
public:
    MarchCost(const MarchTile& tile, Precision precision, Formulation formulation, const MarchDevice& device);

    const MarchRates& rates() const { return rates_; }
    /// How many blocks run at once on the device.
    int slots() const { return resident_ * device_.multiprocessors; }
    int resident() const { return resident_; }
    /// Seconds that a block takes before its first plane, if the launch has `items` items.
    double start_seconds(std::size_t items) const;
    /// The seconds in which `count` blocks that share a multiprocessor each step one plane. `cycles`: the sum
    /// over all their warps.
    double plane_seconds(double cycles, int count) const;
    /// The seconds from the first to the last instruction of a launch whose items are `loads`, in that order.
    /// The next block always goes to the multiprocessor that first has room.
    double work_seconds(const std::vector<MarchLoad>& loads) const;
    /// The seconds of a step that moves `bytes` to and from memory. `state_bytes`: the size of all arrays. If
    /// they fit into the cache, `bytes` do not count.
    double step_seconds(const std::vector<MarchLoad>& loads, double bytes, double state_bytes) const;

private:
    class Shared;

    MarchRates rates_;
    MarchDevice device_;
    int warps_, resident_;
    double start_bytes_;  ///< bytes that a block fetches before its first plane
};

}  // namespace voxspring::layout
