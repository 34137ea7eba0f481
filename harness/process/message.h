// What processes say to each other over a socket.
#pragma once

#include <chrono>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

namespace voxspring {

/// The other end of a socket is closed.
class Closed : public std::runtime_error {
public:
    Closed() : std::runtime_error("the other process is gone") {}
};
/// Nothing came until the deadline.
class Late : public std::runtime_error {
public:
    Late() : std::runtime_error("no answer") {}
};
/// Nothing: wait for as long as it takes.
using Deadline = std::optional<std::chrono::steady_clock::time_point>;

/// All throw Closed; those that receive throw Late as well.
void send_bytes(int socket, const void* bytes, std::size_t count);
void receive_bytes(int socket, void* bytes, std::size_t count, const Deadline& until = std::nullopt);

/// Numbers travel to the bit, those that are not finite too.
void send_message(int socket, const nlohmann::json& message);
nlohmann::json receive_message(int socket, const Deadline& until = std::nullopt);

/// Hands an open file, a socket for example, to the other process. What is received is the caller's to close.
void send_descriptor(int socket, int descriptor);
int receive_descriptor(int socket, const Deadline& until = std::nullopt);

}  // namespace voxspring
