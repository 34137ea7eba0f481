// Steps the borders of a part of a body before its interior. Borders are stepped, sent and received in a
// second stream, while the backend's stream steps the rest.
#pragma once

#include <utility>

#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// The order of work in both streams. An arrow is an event that is waited for:
///
///     backend's   begun   interior of step n .................   | begun   interior of n + 1 ...
///                   v                            ^ stepped   ^ arrived
///     stream()      border of step n   send   receive          |  border of n + 1 ...
///
/// So work that is enqueued in the backend's stream between two steps finds the whole state complete,
/// although it does not know of the second stream. A border can be sent before the interior of its step ends,
/// unless order_after_main_stream() was called.
class BordersFirst {
public:
    /// `whole`: the backend's stream, which must outlive this object. The second stream has priority: where
    /// the device could begin work of either stream, it begins the border's.
    explicit BordersFirst(const Stream& whole) : whole_(whole) {}

    /// The stream in which borders are stepped, sent and received.
    const Stream& stream() const { return own_; }

    /// Enqueues a step by calling enqueue_border(stream) and enqueue_interior(stream). Neither of the two may
    /// read what the other writes.
    template <class EnqueueBorder, class EnqueueInterior>
    void step(EnqueueBorder enqueue_border, EnqueueInterior enqueue_interior) {
        wait_for_main_stream();
        enqueue_border(own_);
        stepped_.record(own_);
        enqueue_interior(whole_);
        stepped_.hold(whole_);
        is_ahead_ = true;
    }
    /// Makes the next send, and so the receive after it, wait for all work that is in the backend's stream by
    /// then. To be called after anything but a step() was enqueued in that stream.
    void order_after_main_stream() { is_ahead_ = false; }

    /// To be called before a send is enqueued in stream().
    void begin_send() {
        if (!std::exchange(is_ahead_, false)) wait_for_main_stream();
    }
    /// To be called once a receive is enqueued in stream(). Later work in the backend's stream then finds the
    /// ghosts (particles that neighbouring parts step) as they were received, unless the latest call of
    /// step_follows() was step_follows(true).
    void end_receive() {
        if (step_follows_) return;
        arrived_.record(own_);
        arrived_.hold(whole_);
    }
    /// Tells whether each receive from now on is directly followed by a step. The interior of that step then
    /// does not wait for the ghosts, since it reads none.
    void step_follows(bool follows) { step_follows_ = follows; }

private:
    void wait_for_main_stream() {
        begun_.record(whole_);
        begun_.hold(own_);
    }

    const Stream& whole_;
    const Stream own_ = Stream::with_priority();
    Event begun_ = Event::without_time();    ///< in the backend's stream: everything enqueued before is done
    Event stepped_ = Event::without_time();  ///< in the second stream: the border of the latest step is done
    Event arrived_ = Event::without_time();  ///< in the second stream: the ghosts of that step have arrived
    bool step_follows_ = false;
    /// Whether step() was called after the latest call of begin_send() and of order_after_main_stream().
    bool is_ahead_ = false;
};

}  // namespace voxspring::cuda
