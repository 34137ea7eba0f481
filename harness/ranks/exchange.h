// How the parts of one body exchange their borders (the particles near other parts, which springs join to
// these) after each step. Backends whose borders travel within steps exchange them in each step.
//
// A rank is one part of a run: a subdomain (backends/layout/decomposition.h), its backend and one Exchange.
// Messages go through memory of the host that threads or processes share. If borders move from device to
// device (DeviceBorders of backends/facets.h: copies between peers, stores into the neighbour's memory,
// NCCL), only empty messages are sent, which say that a transfer has been enqueued or that a rank has called
// meet(). So ranks wait, meet and fail in the same way in both cases.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

namespace voxspring {

/// The unit of shared memory. Data that different ranks write lies in different Lines. A Line is two cache
/// lines, since the prefetcher fetches them in pairs.
struct alignas(128) Line {
    std::byte bytes[128];
};

/// Messages from one rank to another. There is room for two messages, so that one can be written while the
/// one before is read. One rank sends, and the other takes.
class Mailbox {
public:
    /// `memory` has lines(capacity) Lines. A message has at most `capacity` bytes.
    Mailbox(Line* memory, std::size_t capacity);
    static std::size_t lines(std::size_t capacity);

    bool has_room() const;
    std::byte* room() const;       ///< where to write the next message; requires has_room()
    void send(std::size_t bytes);  ///< sends what was written to room()
    bool has_message() const;
    const std::byte* message() const;  ///< the oldest message not yet taken; requires has_message()
    std::size_t message_bytes() const;
    void take();

private:
    struct Head;
    Head& head() const;
    std::byte* slot(std::uint64_t number) const;

    Line* memory_;
    std::size_t slot_lines_;
};

/// Which ranks send each other messages, and how large the messages may be.
class Routes {
public:
    /// Rank r always has routes to the ranks r - 1 and r + 1, if these exist, since meet() needs them.
    explicit Routes(int ranks = 1);

    /// Adds a route from one rank to another, for messages of up to `capacity` bytes. If there is no route
    /// back, adds one for empty messages.
    void add(int from, int to, std::size_t capacity);

    int ranks() const { return ranks_; }
    /// The ranks to which `rank` has a route, ascending.
    std::vector<int> from(int rank) const;
    /// The size of the largest message, in bytes, by {sender, receiver}.
    const std::map<std::pair<int, int>, std::size_t>& capacities() const { return capacity_; }

    NLOHMANN_DEFINE_TYPE_INTRUSIVE(Routes, ranks_, capacity_)

private:
    int ranks_;
    std::map<std::pair<int, int>, std::size_t> capacity_;
};

/// All mailboxes of a run, and the reason if the run failed.
class Mailroom {
public:
    /// `memory`, which the ranks share, is an array of lines(routes) Lines. It must be zero before a rank
    /// uses it.
    Mailroom(Line* memory, const Routes& routes);
    static std::size_t lines(const Routes& routes);

    const Routes& routes() const { return routes_; }
    /// The mailbox of a route, which must exist.
    Mailbox box(int from, int to) const;

    /// Notes why the run failed. Only the first reason is kept, cut to 1023 bytes. Returns whether this one
    /// was the first.
    bool fail(const std::string& reason) const noexcept;
    bool has_failed() const;
    std::string reason() const;

private:
    struct Board;
    Board& board() const;

    Line* memory_;
    Routes routes_;
    std::map<std::pair<int, int>, std::size_t> begin_;  ///< first Line of a mailbox, by {sender, receiver}
};

/// Another rank failed, or a rank waited too long for another, so this rank cannot go on. The message says
/// which rank it was, and why it failed.
class RankLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// One rank's side of the exchange, through a mailroom. Messages between two ranks arrive in the order in
/// which they were sent. A call that waits throws RankLost once any rank has failed, or if it has waited too
/// long for the other side.
class Exchange {
public:
    Exchange(const Mailroom& mailroom, int rank);
    Exchange(const Exchange&) = delete;
    Exchange& operator=(const Exchange&) = delete;

    int rank() const { return rank_; }
    int ranks() const { return mailroom_.routes().ranks(); }

    /// outbox() waits until there is room, and returns where to write the next message to rank `to`. post()
    /// then sends it.
    std::byte* outbox(int to, std::size_t bytes);
    void post(int to);
    /// inbox() waits for the next message from rank `from` and returns it. release() then frees its room.
    const std::byte* inbox(int from);
    void release(int from) { links_.at(from).in.take(); }

    /// Makes every rank that waits throw RankLost with this reason, or with an earlier reason if the run has
    /// already failed. Returns whether this reason was the first.
    bool fail(const std::string& reason) noexcept { return mailroom_.fail(reason); }
    /// A rank for which a call has waited this long counts as lost. The initial value is 10 s.
    void set_patience(std::chrono::duration<double> patience) { patience_ = patience; }

private:
    /// The mailboxes to and from another rank.
    struct Link {
        Mailbox out, in;
        std::size_t capacity;
        std::size_t bytes = 0;  ///< size of the message being written
    };
    template <class Ready>
    void wait_for(int other, const Ready& ready) const;

    const Mailroom mailroom_;
    const int rank_;
    std::chrono::duration<double> patience_{10};
    std::unordered_map<int, Link> links_;
};

/// Sends an empty message to each rank of `others`, and waits for a message from each.
void greet(Exchange& exchange, const std::vector<int>& others);
/// A barrier: returns once every rank has called it. Rank r exchanges messages only with r - 1 and r + 1.
void meet(Exchange& exchange);

}  // namespace voxspring
