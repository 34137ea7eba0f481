// What `voxspring view` was asked for.
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
    glm::ivec2 size{1280, 800};                   ///< of the window, in the window system's units
    std::optional<int> steps;                     ///< a frame; as many as fit into one
    std::optional<double> seconds;                ///< after which the window closes by itself
    std::optional<std::filesystem::path> record;  ///< a film of the window
    std::optional<std::filesystem::path> save;    ///< where the state goes that is saved on request
};

}  // namespace voxspring
