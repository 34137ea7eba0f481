// Layers of a body that stand for all of it, where the whole is too large to be verified.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "backends/layout/decomposition.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// `scene` as a subdomain of its problem has it, whose problem becomes the part's. The edits of the whole
/// that change nothing here are there as well: all ranks stop at the same steps, and upload alike.
Scene part_of(const Scene& scene, Subdomain& subdomain);

/// Where the values of `some` are in `all`, which has all of them; both ascend.
std::vector<std::uint32_t> places_of(const std::vector<std::uint32_t>& some,
                                     const std::vector<std::uint32_t>& all);

/// Layers of voxels across the longest axis, and what they are verified by. After some steps they depend on
/// as many layers around them and on nothing else, since a force reaches one voxel: float64 steps these
/// alone.
struct Sample {
    /// One of `bricks()`, with a layer around it as ghosts, which is verified as well.
    Scene judged;
    std::vector<std::uint32_t> particle;  ///< what each is in the whole, ascending
    /// `judged` and the layers that it depends on.
    Scene around;
    std::vector<std::uint32_t> in_around;  ///< where the particles of `judged` are there

    /// Of `layers` layers: at either end and in the middle.
    static std::vector<Decomposition::Brick> bricks(const Scene& scene, int layers);
    /// Empty, or why so many layers are no sample of the scene.
    static std::string refusal(const Scene& scene, int layers);
    /// The particles of such bricks and of the layers beside them, ascending.
    static std::vector<std::uint32_t> particles(const Problem& problem,
                                                const std::vector<Decomposition::Brick>& bricks);

    Sample(const Scene& scene, const Decomposition::Brick& brick, int steps);
};

}  // namespace voxspring
