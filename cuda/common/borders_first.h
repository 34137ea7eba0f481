// Steps of a part of a body whose borders go first: they are stepped, sent and received in a second stream,
// while the backend's stream steps all else.
#pragma once

#include <utility>

#include "cuda/device/event.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// The order of work in both streams. An arrow is an event that is waited for:
///
///     backend's   begun   interior of step n .................   | begun   interior of n + 1 ...
///                   v                            ^ stepped   ^ arrived
///     stream()      border of step n   send   receive          |  border of n + 1 ...
///
/// So whatever is enqueued in the backend's stream between two steps sees the whole state and need not know
/// of the second stream. A border is sent before the interior of its step ends, unless
/// order_after_main_stream() was called.
class BordersFirst {
public:
    /// `whole`: the backend's stream, which must outlive this. The device prefers the border's work to the
    /// interior's wherever it could begin either.
    explicit BordersFirst(const Stream& whole) : whole_(whole) {}

    /// The stream in which borders are stepped, sent and received.
    const Stream& stream() const { return own_; }

    /// Enqueues a step with enqueue_border(stream) and enqueue_interior(stream). Neither may read what the
    /// other writes.
    template <class EnqueueBorder, class EnqueueInterior>
    void step(EnqueueBorder enqueue_border, EnqueueInterior enqueue_interior) {
        wait_for_main_stream();
        enqueue_border(own_);
        stepped_.record(own_);
        enqueue_interior(whole_);
        stepped_.hold(whole_);
        is_ahead_ = true;
    }
    /// The next send or receive waits for everything that the backend's stream has been given. To be called
    /// when that was something else than a step of this object.
    void order_after_main_stream() { is_ahead_ = false; }

    /// Called before a send is enqueued in stream().
    void begin_send() {
        if (!std::exchange(is_ahead_, false)) wait_for_main_stream();
    }
    /// Called once the receive is enqueued there: what follows in the backend's stream finds the ghosts as
    /// the parts beside this one sent them.
    void end_receive() {
        arrived_.record(own_);
        arrived_.hold(whole_);
    }

private:
    void wait_for_main_stream() {
        begun_.record(whole_);
        begun_.hold(own_);
    }

    const Stream& whole_;
    const Stream own_ = Stream::with_priority();
    Event begun_ = Event::without_time();    ///< in the backend's stream: all before has been done
    Event stepped_ = Event::without_time();  ///< in the second stream: the border of the latest step is done
    Event arrived_ = Event::without_time();  ///< in the second stream: its ghosts have arrived
    bool is_ahead_ = false;                  ///< the latest work that was enqueued is a step
};

}  // namespace voxspring::cuda
