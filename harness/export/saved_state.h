// A state that `voxspring run --out FILE.npz` or the key w of `voxspring view` wrote, to go on from.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "harness/scene/scene.h"

namespace voxspring {

struct SavedState {
    int step = 0;  ///< after which it was
    State state;
    std::vector<std::uint32_t> mask;  ///< Lattice::mask
    std::vector<Spring> springs;      ///< Problem::springs
    /// What else the file holds of the particles and the scene has otherwise: a sentence, or empty.
    std::string differs;
};

/// Reads displacement, increment, step and springs of the arrays that npz() lists, to the bit. Throws
/// BadInput where the file is no such one, holds what is not finite, is of other voxels, another spacing or
/// another time step than `scene`, or has lattice springs that the scene's lattice cannot have: of another
/// stiffness or rest length, or between other particles. Allocates what the scene's state takes and what the
/// file's own springs take.
SavedState read_saved_state(const std::filesystem::path& file, const Scene& scene);

/// How many springs the state has otherwise than `scene` after as many steps: cut or joined by hand, or by
/// edits that the scene does not have.
std::size_t springs_that_differ(const Scene& scene, const SavedState& saved);

/// Makes `scene` one that has the state's springs from its start on. Of its edits those remain that come
/// after the state, and of each of them what still applies: a spring that is gone is not cut, and particles
/// that a spring joins are not joined again, as in `voxspring view`.
void take_springs(Scene& scene, const SavedState& saved);

}  // namespace voxspring
