// A state that `voxspring run --out FILE.npz` wrote, to go on from.
#pragma once

#include <filesystem>

#include "harness/scene/scene.h"

namespace voxspring {

struct SavedState {
    int step = 0;  ///< after which it was
    State state;
};

/// Reads displacement, increment and step of the arrays that npz() lists, to the bit. Throws BadInput where
/// the file is no such one, holds what is not finite, or is of other voxels, another spacing or another time
/// step than `scene`. Allocates what the scene's state takes, whatever the file says.
SavedState read_saved_state(const std::filesystem::path& file, const Scene& scene);

}  // namespace voxspring
