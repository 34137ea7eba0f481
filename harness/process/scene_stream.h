// A scene on its way from one process of this program to another.
#pragma once

#include <optional>

#include "harness/scene/scene.h"

namespace voxspring {

/// Sends `scene`, or word that there is none. All of it arrives to the bit. No copy is made on the way.
/// Throws Closed.
void send_scene(int socket, const Scene* scene);
/// Throws Closed.
std::optional<Scene> receive_scene(int socket);

}  // namespace voxspring
