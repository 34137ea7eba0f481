// How the parts of one body hand each other their borders, step after step.
//
// A rank is one part of a run: a subdomain (backends/layout/decomposition.h), its backend and one Exchange.
// Messages go through the host's memory here. Where borders move from device to device (DeviceBorders of
// backends/backend.h: copies between peers, stores into the neighbour's memory, NCCL) empty messages say that
// one has been enqueued, so that waiting, meeting and faults are the same.
#pragma once

#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

namespace voxspring {

/// Another rank failed or says nothing, so that this one cannot go on: the message names it and the reason.
class RankLost : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// One rank's side. From one rank to another messages arrive in the order in which they were sent. Whatever
/// waits throws RankLost once any rank has failed, or the other side has let it wait for too long.
class Exchange {
public:
    Exchange() = default;
    Exchange(const Exchange&) = delete;
    Exchange& operator=(const Exchange&) = delete;
    virtual ~Exchange() = default;

    virtual int rank() const = 0;
    virtual int ranks() const = 0;

    /// Where the next message to the rank `to` is to be written; waits until there is room. Then sends it.
    virtual std::byte* outbox(int to, std::size_t bytes) = 0;
    virtual void post(int to) = 0;
    /// The next message from the rank `from`; waits for it. Then gives its room back.
    virtual const std::byte* inbox(int from) = 0;
    virtual void release(int from) = 0;

    /// Has every rank that waits for anything throw with this reason; the first reason counts.
    virtual void fail(const std::string& reason) noexcept = 0;
    /// A rank that says nothing for so long is lost; at first 10 s.
    virtual void set_patience(std::chrono::duration<double> patience) = 0;
};

/// Sends each of the others an empty message, and waits for theirs.
void greet(Exchange& exchange, const std::vector<int>& others);
/// Returns once every rank is here. Each hears of all by way of the ranks before and behind it.
void meet(Exchange& exchange);

}  // namespace voxspring
