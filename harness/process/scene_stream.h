// A scene on its way from one process of this program to another.
#pragma once

#include <sys/types.h>

#include <optional>

#include "harness/scene/scene.h"

namespace voxspring {

/// Sends `scene`, or word that there is none, to the process `receiver` at the other end. All of it arrives
/// to the bit. No copy is made on the way: large arrays are written into the receiver's memory on all cores,
/// where the system lets a process do that to its child, else they go through the socket. Throws Closed.
void send_scene(int socket, const Scene* scene, pid_t receiver);
/// Throws Closed.
std::optional<Scene> receive_scene(int socket);

}  // namespace voxspring
