// How the parts of one body exchange their borders after each step.
//
// A rank is one part of a run: a subdomain (backends/layout/decomposition.h), its backend and one Exchange.
// Messages go through the host's memory here. If borders move from device to device (DeviceBorders of
// backends/backend.h: copies between peers, stores into the neighbour's memory, NCCL), empty messages say
// that a transfer has been enqueued. Waiting, meeting and failures then work in the same way.
#pragma once

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "harness/ranks/mailboxes.h"

namespace voxspring {

/// Another rank failed or sent nothing for too long, so that this rank cannot go on. The message names the
/// rank and the reason.
class RankLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// One rank's side of the exchange, through a mailroom. Messages between two ranks arrive in the order in
/// which they were sent. A call that waits throws RankLost once any rank has failed, or if the other side
/// sends nothing for too long.
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

    /// Makes every rank that waits throw RankLost with this reason. The first reason counts.
    void fail(const std::string& reason) noexcept { mailroom_.fail(reason); }
    /// A rank that sends nothing for this long counts as lost. The initial value is 10 s.
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

/// Sends an empty message to each of the others, and waits for theirs.
void greet(Exchange& exchange, const std::vector<int>& others);
/// A barrier: returns once every rank has called it. Each rank exchanges messages only with the ranks before
/// and behind it.
void meet(Exchange& exchange);

}  // namespace voxspring
