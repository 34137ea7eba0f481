// Sends a scene from one process of this program to another.
#pragma once

#include <sys/types.h>

#include <optional>

#include "harness/scene/scene.h"

namespace voxspring {

/// Sends `scene`, or the message that there is none, to the process `receiver` at the other end of `socket`.
/// The bits stay the same. No intermediate copy is made: large arrays are written into the receiver's memory
/// on all cores. If the system does not let a process write there, arrays go through the socket. Throws
/// Closed.
void send_scene(int socket, const Scene* scene, pid_t receiver);
/// Receives what send_scene() sent; empty if that was no scene. Throws Closed.
std::optional<Scene> receive_scene(int socket);

}  // namespace voxspring
