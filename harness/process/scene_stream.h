// Sends a scene from one process of this program to another.
#pragma once

#include <sys/types.h>

#include <optional>

#include "harness/scene/scene.h"

namespace voxspring {

/// Sends `scene`, or the message that there is none, to the process `receiver` at the other end. The bits
/// stay the same. No intermediate copy is made: large arrays are written into the receiver's memory on all
/// cores. If the system does not let a process do that to its child, they go through the socket. Throws
/// Closed.
void send_scene(int socket, const Scene* scene, pid_t receiver);
/// Receives a scene; empty if there is none. Throws Closed.
std::optional<Scene> receive_scene(int socket);

}  // namespace voxspring
