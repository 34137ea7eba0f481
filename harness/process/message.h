// Messages between processes over a socket.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stdexcept>

#include "harness/scene/scene.h"

namespace voxspring {

/// The other end of a socket is closed.
class Closed : public std::runtime_error {
public:
    Closed() : std::runtime_error("the other process is gone") {}
};
/// No message came before the deadline.
class Late : public std::runtime_error {
public:
    Late() : std::runtime_error("no answer") {}
};
/// When to give up waiting. Empty: never.
using Deadline = std::optional<std::chrono::steady_clock::time_point>;

/// All functions of this header throw Closed; those that receive also throw Late.
void send_bytes(int socket, const void* bytes, std::size_t count);
void receive_bytes(int socket, void* bytes, std::size_t count, const Deadline& until = std::nullopt);

/// Numbers arrive with the same bits, NaN and infinity included.
void send_message(int socket, const nlohmann::json& message);
nlohmann::json receive_message(int socket, const Deadline& until = std::nullopt);

/// Passes an open file, a socket for example, to the other process. The receiver must close it.
void send_descriptor(int socket, int descriptor);
int receive_descriptor(int socket, const Deadline& until = std::nullopt);

/// Sends `scene`, or the message that there is none, to the process `receiver` at the other end of `socket`.
/// The bits stay the same. No intermediate copy is made: large arrays are written into the receiver's memory
/// on all cores. If the system does not let a process write there, arrays go through the socket.
void send_scene(int socket, const Scene* scene, pid_t receiver);
/// Receives what send_scene() sent; empty if that was no scene.
std::optional<Scene> receive_scene(int socket);

}  // namespace voxspring
