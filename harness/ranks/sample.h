// Layers of a body that are verified instead of the whole body, if the body is too large.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "backends/layout/decomposition.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// The part of `scene` that belongs to `subdomain`. Moves subdomain.problem into the result. Edits that
/// change nothing in the subdomain are kept, because all ranks must stop at the same steps and upload at the
/// same points.
Scene part_of(const Scene& scene, Subdomain& subdomain);

/// The indices in `all` of the values of `some`. `all` contains every value of `some`, and both ascend.
std::vector<std::uint32_t> places_of(const std::vector<std::uint32_t>& some,
                                     const std::vector<std::uint32_t>& all);

/// A brick (a box of voxels: some layers across the longest axis), and a scene to verify it with. A force
/// reaches one voxel further per step. So after n steps the brick depends only on the n layers around it, and
/// the float64 reference needs to step only the brick and these layers.
struct Sample {
    /// The part of the scene in one of bricks() and in the layer of voxels around it (ghosts), which is
    /// verified as well.
    Scene judged;
    std::vector<std::uint32_t> particle;  ///< index in the whole body of each particle of `judged`, ascending
    /// The part of the scene in the brick and in the layers that `judged` depends on.
    Scene around;
    std::vector<std::uint32_t> in_around;  ///< indices in `around` of the particles of `judged`

    /// The three bricks of a sample, each `layers` layers thick: at either end of the body and in the middle.
    static std::vector<Decomposition::Brick> bricks(const Scene& scene, int layers);
    /// Empty, or why a sample of `layers` layers is not possible.
    static std::string refusal(const Scene& scene, int layers);
    /// The particles of these bricks and of the layers beside them, ascending.
    static std::vector<std::uint32_t> particles(const Problem& problem,
                                                const std::vector<Decomposition::Brick>& bricks);

    Sample(const Scene& scene, const Decomposition::Brick& brick, int steps);
};

}  // namespace voxspring
