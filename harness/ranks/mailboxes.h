// Messages between ranks through shared memory, between threads or between processes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace voxspring {

/// The unit of shared memory. Data that different ranks write lies in different Lines. A Line is two cache
/// lines, since the prefetcher fetches them in pairs.
struct alignas(128) Line {
    std::byte bytes[128];
};

/// One direction between two ranks, with room for two messages, so that one can be written while the one
/// before is read. One side sends, the other takes.
class Mailbox {
public:
    /// `memory` has lines(capacity) Lines. A message has at most `capacity` bytes.
    Mailbox(Line* memory, std::size_t capacity);
    static std::size_t lines(std::size_t capacity);

    bool has_room() const;
    std::byte* room() const;       ///< for the next message; requires has_room()
    void send(std::size_t bytes);  ///< sends what was written to room()
    bool has_message() const;
    const std::byte* message() const;  ///< the first one not yet taken; requires has_message()
    std::size_t message_bytes() const;
    void take();

private:
    struct Head;
    Head& head() const;
    std::byte* slot(std::uint64_t number) const;

    Line* memory_;
    std::size_t slot_lines_;
};

/// Which ranks send each other messages, and how large these may be.
class Routes {
public:
    /// A rank always has routes to the ranks before and behind it, since meet() needs them (exchange.h).
    explicit Routes(int ranks);

    /// Adds a route from one rank to another, for messages of up to `capacity` bytes, and a route back.
    void add(int from, int to, std::size_t capacity);

    int ranks() const { return ranks_; }
    /// The ranks to which `rank` has a route, ascending.
    std::vector<int> from(int rank) const;
    /// The largest message in bytes, by sender and receiver.
    const std::map<std::pair<int, int>, std::size_t>& capacities() const { return capacity_; }

private:
    int ranks_;
    std::map<std::pair<int, int>, std::size_t> capacity_;
};
nlohmann::json to_json(const Routes& routes);
Routes routes_from_json(const nlohmann::json& json);

/// All mailboxes of a run, and the reason if it failed.
class Mailroom {
public:
    /// `memory` has lines(routes) Lines, which are zero at first.
    Mailroom(Line* memory, const Routes& routes);
    static std::size_t lines(const Routes& routes);

    const Routes& routes() const { return routes_; }
    /// The mailbox of a route, which must exist.
    Mailbox box(int from, int to) const;

    /// Notes why the run failed. The first reason is kept.
    void fail(const std::string& reason) const noexcept;
    bool has_failed() const;
    std::string reason() const;

private:
    struct Board;
    Board& board() const;

    Line* memory_;
    Routes routes_;
    std::map<std::pair<int, int>, std::size_t> begin_;  ///< first Line of a mailbox, by sender and receiver
};

}  // namespace voxspring
