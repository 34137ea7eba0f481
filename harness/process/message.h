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

/// Thrown if the other end of a socket is closed.
class Closed : public std::runtime_error {
public:
    Closed() : std::runtime_error("the other process is gone") {}
};
/// Thrown if no message came before the deadline.
class Late : public std::runtime_error {
public:
    Late() : std::runtime_error("no answer") {}
};
/// The time at which a function stops waiting for input. Empty: never.
using Deadline = std::optional<std::chrono::steady_clock::time_point>;

/// All functions of this header throw Closed. Those with a parameter `until` also throw Late.
void send_bytes(int socket, const void* bytes, std::size_t count);
void receive_bytes(int socket, void* bytes, std::size_t count, const Deadline& until = std::nullopt);

/// Send and receive JSON. Finite numbers and infinity arrive with the same bits, and NaN arrives as a NaN.
void send_message(int socket, const nlohmann::json& message);
nlohmann::json receive_message(int socket, const Deadline& until = std::nullopt);

/// Pass an open file, for example a socket, to the other process. The receiver must close its descriptor.
void send_descriptor(int socket, int descriptor);
int receive_descriptor(int socket, const Deadline& until = std::nullopt);

/// Sends `scene`, which may be null, to the process `receiver` at the other end of `socket`. All numbers keep
/// their bits. Members that no worker uses are not sent (scene_stream.cpp). Large arrays are not copied to a
/// buffer, but written directly into the receiver's memory, by all threads. If the system does not allow
/// that, they go through the socket. Before a large array the receiver may send {"error": REASON} and end, if
/// it has no memory for the array. This function then throws std::runtime_error with the reason.
void send_scene(int socket, const Scene* scene, pid_t receiver);
/// Receives what send_scene() sent; empty if that was null.
std::optional<Scene> receive_scene(int socket);

}  // namespace voxspring
