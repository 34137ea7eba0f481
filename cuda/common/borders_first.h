// Steps of a part of a body whose borders go first: stepped, sent and received in a stream of their own,
// while all else is stepped in the backend's.
#pragma once

#include <utility>

#include "cuda/device/event.h"
#include "cuda/device/stream.h"

namespace voxspring::cuda {

/// The order of both streams, in which an arrow is an event that is waited for:
///
///     backend's   begun   interior of step n .................   | begun   interior of n + 1 ...
///                   v                            ^ stepped   ^ arrived
///     stream()      border of step n   send   receive          |  border of n + 1 ...
///
/// So whatever is enqueued in the backend's stream between two steps sees the whole of the state, and none of
/// it has to know of the other stream. A border is sent before that stream comes to the interior's end,
/// unless stay_behind() was called.
class BordersFirst {
public:
    /// `whole`: the backend's stream, which must outlive this. A border's work goes before the interior's
    /// wherever the device could do either.
    explicit BordersFirst(const Stream& whole) : whole_(whole) {}

    /// Where borders are sent and received.
    const Stream& stream() const { return own_; }

    /// Enqueues a step: enqueue_border(stream) and enqueue_interior(stream), none of which reads what the
    /// other one writes.
    template <class EnqueueBorder, class EnqueueInterior>
    void step(EnqueueBorder enqueue_border, EnqueueInterior enqueue_interior) {
        catch_up();
        enqueue_border(own_);
        stepped_.record(own_);
        enqueue_interior(whole_);
        stepped_.hold(whole_);
        is_ahead_ = true;
    }
    /// What the backend's stream has been given since the latest step is to be done before a border is sent
    /// or received: something else than a step, or a step that was not this one's.
    void stay_behind() { is_ahead_ = false; }

    /// Called before a send is enqueued in stream().
    void begin_send() {
        if (!std::exchange(is_ahead_, false)) catch_up();
    }
    /// Called once what follows it is enqueued there: ghosts are where the parts beside this one sent them.
    void end_receive() {
        arrived_.record(own_);
        arrived_.hold(whole_);
    }

private:
    void catch_up() {
        begun_.record(whole_);
        begun_.hold(own_);
    }

    const Stream& whole_;
    const Stream own_ = Stream::with_priority();
    Event begun_ = Event::without_time();    ///< in the backend's: all before has been done
    Event stepped_ = Event::without_time();  ///< in the own one: the border of the latest step has been
    Event arrived_ = Event::without_time();  ///< in the own one: so have its ghosts
    bool is_ahead_ = false;                  ///< the latest that was enqueued is a step
};

}  // namespace voxspring::cuda
