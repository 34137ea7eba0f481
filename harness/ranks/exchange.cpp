#include "harness/ranks/exchange.h"

#include <fmt/format.h>

#include <stdexcept>
#include <thread>

namespace voxspring {

Exchange::Exchange(const Mailroom& mailroom, int rank) : mailroom_(mailroom), rank_(rank) {
    for (const int other : mailroom_.routes().from(rank))
        links_.try_emplace(other, Link{.out = mailroom_.box(rank, other),
                                       .in = mailroom_.box(other, rank),
                                       .capacity = mailroom_.routes().capacities().at({rank, other})});
}

/// Spins for some microseconds, and then yields the core to other threads.
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
            fmt::format("rank {} heard nothing of rank {} for {:g} s", rank_, other, patience_.count());
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

// After n rounds a rank has heard, through the ranks between, from all ranks up to n away.
void meet(Exchange& exchange) {
    std::vector<int> beside;
    for (const int other : {exchange.rank() - 1, exchange.rank() + 1}) {
        if (other >= 0 && other < exchange.ranks()) beside.push_back(other);
    }
    for (int round = 1; round < exchange.ranks(); ++round) greet(exchange, beside);
}

}  // namespace voxspring
