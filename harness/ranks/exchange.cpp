#include "harness/ranks/exchange.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <stdexcept>
#include <thread>

namespace voxspring {
namespace {

std::size_t lines_of(std::size_t bytes) { return (bytes + sizeof(Line) - 1) / sizeof(Line); }

}  // namespace

/// Counts of messages sent and taken so far, and the sizes of the two latest messages. All zeros mean an
/// empty mailbox.
struct Mailbox::Head {
    alignas(Line) std::atomic<std::uint64_t> sent;
    std::array<std::uint64_t, 2> bytes;
    alignas(Line) std::atomic<std::uint64_t> taken;
};

// Only lock-free atomics work between processes.
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

Mailbox::Mailbox(Line* memory, std::size_t capacity) : memory_(memory), slot_lines_(lines_of(capacity)) {}

std::size_t Mailbox::lines(std::size_t capacity) { return lines_of(sizeof(Head)) + 2 * lines_of(capacity); }

Mailbox::Head& Mailbox::head() const { return *reinterpret_cast<Head*>(memory_); }

std::byte* Mailbox::slot(std::uint64_t number) const {
    return memory_[lines_of(sizeof(Head)) + number % 2 * slot_lines_].bytes;
}

bool Mailbox::has_room() const {
    return head().sent.load(std::memory_order_relaxed) - head().taken.load(std::memory_order_acquire) < 2;
}
std::byte* Mailbox::room() const { return slot(head().sent.load(std::memory_order_relaxed)); }
void Mailbox::send(std::size_t bytes) {
    const std::uint64_t number = head().sent.load(std::memory_order_relaxed);
    head().bytes[number % 2] = bytes;
    head().sent.store(number + 1, std::memory_order_release);
}
bool Mailbox::has_message() const {
    return head().sent.load(std::memory_order_acquire) != head().taken.load(std::memory_order_relaxed);
}
const std::byte* Mailbox::message() const { return slot(head().taken.load(std::memory_order_relaxed)); }
std::size_t Mailbox::message_bytes() const {
    return head().bytes[head().taken.load(std::memory_order_relaxed) % 2];
}
void Mailbox::take() {
    head().taken.store(head().taken.load(std::memory_order_relaxed) + 1, std::memory_order_release);
}

struct Mailroom::Board {
    enum State : int { good, being_written, failed };
    alignas(Line) std::atomic<int> state;
    std::array<char, 1024> reason;
};

Routes::Routes(int ranks) : ranks_(ranks) {
    for (int rank = 0; rank + 1 < ranks; ++rank) add(rank, rank + 1, 0);
}

void Routes::add(int from, int to, std::size_t capacity) {
    std::size_t& there = capacity_[{from, to}];
    there = std::max(there, capacity);
    capacity_.try_emplace({to, from}, 0);
}

std::vector<int> Routes::from(int rank) const {
    std::vector<int> others;
    for (auto route = capacity_.lower_bound({rank, 0}); route != capacity_.end(); ++route) {
        if (route->first.first != rank) break;
        others.push_back(route->first.second);
    }
    return others;
}

Mailroom::Mailroom(Line* memory, const Routes& routes) : memory_(memory), routes_(routes) {
    std::size_t line = lines_of(sizeof(Board));
    for (const auto& [ends, capacity] : routes_.capacities()) {
        begin_[ends] = line;
        line += Mailbox::lines(capacity);
    }
}

std::size_t Mailroom::lines(const Routes& routes) {
    std::size_t lines = lines_of(sizeof(Board));
    for (const auto& [ends, capacity] : routes.capacities()) lines += Mailbox::lines(capacity);
    return lines;
}

Mailroom::Board& Mailroom::board() const { return *reinterpret_cast<Board*>(memory_); }

Mailbox Mailroom::box(int from, int to) const {
    return {memory_ + begin_.at({from, to}), routes_.capacities().at({from, to})};
}

bool Mailroom::fail(const std::string& reason) const noexcept {
    int good = Board::good;
    if (!board().state.compare_exchange_strong(good, Board::being_written)) return false;
    const std::size_t length = std::min(reason.size(), board().reason.size() - 1);
    std::copy_n(reason.data(), length, board().reason.data());
    board().reason[length] = 0;
    board().state.store(Board::failed, std::memory_order_release);
    return true;
}

bool Mailroom::has_failed() const { return board().state.load(std::memory_order_acquire) == Board::failed; }

std::string Mailroom::reason() const { return board().reason.data(); }

Exchange::Exchange(const Mailroom& mailroom, int rank) : mailroom_(mailroom), rank_(rank) {
    for (const int other : mailroom_.routes().from(rank))
        links_.try_emplace(other, Link{.out = mailroom_.box(rank, other),
                                       .in = mailroom_.box(other, rank),
                                       .capacity = mailroom_.routes().capacities().at({rank, other})});
}

/// Waits until ready(). Spins for some microseconds, and then yields the core to other threads.
template <class Ready>
void Exchange::wait_for(int other, const Ready& ready) const {
    constexpr int spins = 2000, between_looks = 64;
    for (int i = 0; i < spins; ++i) {
        if (ready()) return;
    }
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 1;; ++i) {
        if (ready()) return;
        std::this_thread::yield();
        if (i % between_looks != 0) continue;
        if (mailroom_.has_failed()) throw RankLost(mailroom_.reason());
        if (std::chrono::steady_clock::now() - begin < patience_) continue;
        const std::string reason =
            fmt::format("rank {} waited for rank {} for {:g} s", rank_, other, patience_.count());
        mailroom_.fail(reason);
        throw RankLost(mailroom_.has_failed() ? mailroom_.reason() : reason);
    }
}

std::byte* Exchange::outbox(int to, std::size_t bytes) {
    Link& link = links_.at(to);
    if (bytes > link.capacity) throw std::logic_error("a message is longer than its mailbox");
    wait_for(to, [&] { return link.out.has_room(); });
    link.bytes = bytes;
    return link.out.room();
}

void Exchange::post(int to) {
    Link& link = links_.at(to);
    link.out.send(link.bytes);
}

const std::byte* Exchange::inbox(int from) {
    const Mailbox& box = links_.at(from).in;
    wait_for(from, [&] { return box.has_message(); });
    return box.message();
}

void greet(Exchange& exchange, const std::vector<int>& others) {
    for (const int other : others) {
        (void)exchange.outbox(other, 0);
        exchange.post(other);
    }
    for (const int other : others) {
        (void)exchange.inbox(other);
        exchange.release(other);
    }
}

// After n rounds a rank has heard, directly or through other ranks, from all ranks whose number differs from
// its number by up to n.
void meet(Exchange& exchange) {
    std::vector<int> beside;
    for (const int other : {exchange.rank() - 1, exchange.rank() + 1}) {
        if (other >= 0 && other < exchange.ranks()) beside.push_back(other);
    }
    for (int round = 1; round < exchange.ranks(); ++round) greet(exchange, beside);
}

}  // namespace voxspring
