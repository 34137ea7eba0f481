// Messages between ranks through memory that they share, between threads or between processes.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "harness/ranks/exchange.h"

namespace voxspring {

/// What shared memory is made of: what different ranks write lies in lines of its own, two for the prefetcher
/// that fetches them in pairs.
struct alignas(128) Line {
    std::byte bytes[128];
};

/// One direction between two ranks, with room for two messages, so that the next one is written while the
/// latest is read. One side sends, the other one takes.
class Mailbox {
public:
    /// In `memory` of as many lines(capacity), for messages of up to `capacity` bytes.
    Mailbox(Line* memory, std::size_t capacity);
    static std::size_t lines(std::size_t capacity);

    bool has_room() const;
    std::byte* room() const;       ///< of the next message; where has_room()
    void send(std::size_t bytes);  ///< what was written there
    bool has_message() const;
    const std::byte* message() const;  ///< the first that was not taken; where has_message()
    std::size_t message_bytes() const;
    void take();

private:
    struct Head;
    Head& head() const;
    std::byte* slot(std::uint64_t number) const;

    Line* memory_;
    std::size_t slot_lines_;
};

/// Which ranks send each other messages, and how many bytes one may have at most.
class Routes {
public:
    /// A rank and those before and behind it meet (exchange.h): these have a route in any case.
    explicit Routes(int ranks);

    /// Messages from one rank to another, and back again.
    void add(int from, int to, std::size_t capacity);

    int ranks() const { return ranks_; }
    /// To which ranks this one has a route, ascending.
    std::vector<int> from(int rank) const;
    /// By sender and receiver.
    const std::map<std::pair<int, int>, std::size_t>& capacities() const { return capacity_; }

private:
    int ranks_;
    std::map<std::pair<int, int>, std::size_t> capacity_;
};
nlohmann::json to_json(const Routes& routes);
Routes routes_from_json(const nlohmann::json& json);

/// All mailboxes of a run, and why it failed.
class Mailroom {
public:
    /// In `memory` of as many lines(routes), which begins as zeros.
    Mailroom(Line* memory, const Routes& routes);
    static std::size_t lines(const Routes& routes);

    const Routes& routes() const { return routes_; }
    /// On a route.
    Mailbox box(int from, int to) const;

    /// The first reason stays.
    void fail(const std::string& reason) const noexcept;
    bool has_failed() const;
    std::string reason() const;

private:
    struct Board;
    Board& board() const;

    Line* memory_;
    Routes routes_;
    std::map<std::pair<int, int>, std::size_t> begin_;  ///< of a mailbox, by sender and receiver: its line
};

/// A rank that hands borders on in a mailroom.
class MailboxExchange final : public Exchange {
public:
    MailboxExchange(const Mailroom& mailroom, int rank);

    int rank() const override { return rank_; }
    int ranks() const override { return mailroom_.routes().ranks(); }
    std::byte* outbox(int to, std::size_t bytes) override;
    void post(int to) override;
    const std::byte* inbox(int from) override;
    void release(int from) override { link(from).in.take(); }
    void fail(const std::string& reason) noexcept override { mailroom_.fail(reason); }
    void set_patience(std::chrono::duration<double> patience) override { patience_ = patience; }

private:
    /// With another rank, both ways.
    struct Link {
        Mailbox out, in;
        std::size_t capacity;
        std::size_t bytes = 0;  ///< of the message being written
    };
    Link& link(int other) { return links_.at(other); }
    template <class Ready>
    void wait_for(int other, const Ready& ready) const;

    const Mailroom mailroom_;
    const int rank_;
    std::chrono::duration<double> patience_{10};
    std::unordered_map<int, Link> links_;
};

}  // namespace voxspring
