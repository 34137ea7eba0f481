// Reads a state that `voxspring run --out FILE.npz` or the key w of `voxspring view` wrote, so that a run can
// resume from it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "harness/scene/scene.h"

namespace voxspring {

struct SavedState {
    int step = 0;  ///< steps after which the state was saved
    State state;
    std::vector<std::uint32_t> mask;  ///< Lattice::mask
    std::vector<Spring> springs;      ///< Problem::springs
    /// A sentence that says how the file's masses and pins differ from the scene's; empty if they do not.
    std::string differs;
};

/// Reads displacement, increment, step and springs from the arrays that npz() lists, with the same bits.
/// Throws BadInput if the file is of another kind, has a number that is not finite, differs from `scene` in
/// its voxels, spacing or time step, has lattice springs that are impossible on the scene's lattice because
/// of their stiffness, rest length or particles, or has other springs that are impossible. Allocates memory
/// for the scene's state and for the springs that the file really has.
SavedState read_saved_state(const std::filesystem::path& file, const Scene& scene);

/// The number of springs in which the state differs from `scene` after the same number of steps: they were
/// cut or joined by hand, or by edits that the scene does not have.
std::size_t springs_that_differ(const Scene& scene, const SavedState& saved);

/// Makes the saved springs those with which `scene` starts. Drops edits that were due before the state was
/// saved. Keeps of each later edit the part that still applies: a spring that is gone is not cut, and
/// particles that a spring joins are not joined again, as in `voxspring view`.
void take_springs(Scene& scene, const SavedState& saved);

}  // namespace voxspring
