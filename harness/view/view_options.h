// The options of `voxspring view`.
#pragma once

#include <filesystem>
#include <glm/vec2.hpp>
#include <optional>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

struct ViewOptions {
    std::string backend = "auto";
    VolumeOptions volume;
    glm::ivec2 size{1280, 800};                   ///< size of the window, in the window system's units
    std::optional<int> steps;                     ///< per frame; absent: as many as fit into a frame
    std::optional<double> seconds;                ///< time after which the window closes by itself
    std::optional<std::filesystem::path> record;  ///< file of a film of the window
    std::optional<std::filesystem::path> save;    ///< file of the state that is saved on request
};

}  // namespace voxspring
