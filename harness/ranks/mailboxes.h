// Messages between neighbouring ranks through memory that they share, between threads or between processes.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

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

/// All mailboxes of a run, and why it failed.
class Mailroom {
public:
    /// In `memory` of as many lines(ranks, capacity), which begins as zeros.
    Mailroom(Line* memory, int ranks, std::size_t capacity);
    static std::size_t lines(int ranks, std::size_t capacity);

    int ranks() const { return ranks_; }
    std::size_t capacity() const { return capacity_; }
    /// From a rank to one beside it.
    Mailbox box(int from, int to) const;

    /// The first reason stays.
    void fail(const std::string& reason) const noexcept;
    bool has_failed() const;
    std::string reason() const;

private:
    struct Board;
    Board& board() const;

    Line* memory_;
    int ranks_;
    std::size_t capacity_;
};

/// A rank that hands borders on in a mailroom.
class MailboxExchange final : public Exchange {
public:
    MailboxExchange(const Mailroom& mailroom, int rank) : mailroom_(mailroom), rank_(rank) {}

    int rank() const override { return rank_; }
    int ranks() const override { return mailroom_.ranks(); }
    std::byte* outbox(int to, std::size_t bytes) override;
    void post(int to) override;
    const std::byte* inbox(int from) override;
    void release(int from) override { mailroom_.box(from, rank_).take(); }
    void fail(const std::string& reason) noexcept override { mailroom_.fail(reason); }
    void set_patience(std::chrono::duration<double> patience) override { patience_ = patience; }

private:
    template <class Ready>
    void wait_for(int other, const Ready& ready) const;

    const Mailroom mailroom_;
    const int rank_;
    std::chrono::duration<double> patience_{10};
    std::size_t bytes_[2] = {0, 0};  ///< of the messages being written, down and up
};

}  // namespace voxspring
