// What a step of the march along z takes, predicted from counts of the device and of the plan: what
// plan_march() chooses tiles by.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/records/march.h"
#include "backends/physics/formulation.h"

namespace voxspring::cuda {

/// A tile of the march.
struct MarchTile {
    std::string name;  ///< its width and height in particles, "128x16": the tuning parameter `tile`
    MarchShape shape;
    int blocks;  ///< that share an SM, at most: registers are for as many
    bool operator==(const MarchTile&) const = default;
};
/// All that a precision has. Those that were measured to be the fastest for some body are first, those of the
/// largest bodies before others.
const std::vector<MarchTile>& march_tiles(Precision precision);
/// By its name. An empty shape (no warps) where the precision has none such.
MarchTile march_tile(const std::string& name, Precision precision);

/// A device, as far as plans depend on it.
struct MarchDevice {
    int multiprocessors = 0;
    int threads = 0;                     ///< of a multiprocessor
    std::size_t shared_bytes = 0;        ///< of a multiprocessor
    std::size_t reserved_bytes = 0;      ///< of them, for each block
    std::size_t block_shared_bytes = 0;  ///< of which a block may have so many
    double hertz = 0;                    ///< of the multiprocessors
    double bytes_per_second = 0;         ///< of the memory's pins
    double cache_bytes = 0;
};
/// Blocks of a tile that share a multiprocessor; 0 where one is too large.
int resident_blocks(const MarchTile& tile, Precision precision, const MarchDevice& device);

/// What a plane costs, in cycles of a multiprocessor.
struct MarchRates {
    double wait;                ///< of a block, while its warps can issue nothing
    double full, masked, idle;  ///< that a warp's instructions take on its quarter: without masks, with, and
                                ///< where all of its particles are missing
};
MarchRates march_rates(const MarchTile& tile, Precision precision, Formulation formulation);

/// An item, as its cost has it.
struct MarchLoad {
    double planes = 0;  ///< that arrive, their springs evaluated
    double cycles = 0;  ///< of all its warps (MarchRates)
};
/// What items cost one after the other.
class MarchCost {
public:
    MarchCost(const MarchTile& tile, Precision precision, Formulation formulation, const MarchDevice& device);

    const MarchRates& rates() const { return rates_; }
    /// Blocks that run at once.
    int slots() const { return resident_ * device_.multiprocessors; }
    int resident() const { return resident_; }
    /// Seconds that a block of a launch of `items` takes before its first plane.
    double start_seconds(std::size_t items) const;
    /// Seconds of one plane of each of `count` blocks that share a multiprocessor, whose warps take `cycles`
    /// together.
    double plane_seconds(double cycles, int count) const;
    /// Seconds from the first to the last instruction of a launch of `loads` in that order: a block goes to
    /// the emptiest multiprocessor as soon as one has room.
    double work_seconds(const std::vector<MarchLoad>& loads) const;
    /// Seconds of a step, of which memory moves `bytes`. `state_bytes`: of all arrays.
    double step_seconds(const std::vector<MarchLoad>& loads, double bytes, double state_bytes) const;

private:
    class Shared;

    MarchRates rates_;
    MarchDevice device_;
    int warps_, resident_;
    double start_bytes_;  ///< that a block asks for before its first plane
};

}  // namespace voxspring::cuda
