// How many steps a driver may have queued: without a bound it keeps commands, and memory, for all that are
// enqueued.
#pragma once

#include <epoxy/gl.h>

#include <deque>

#include "backends/gl/context.h"

namespace voxspring::gl {

/// Puts a fence behind every so many steps and lets the host wait for an old one, so that no more than
/// `max_fences` * `steps_a_fence` steps are enqueued and not finished. The device keeps hundreds of steps to
/// do meanwhile, and a fence costs it less than a thousandth of them.
class StepQueue {
public:
    static constexpr int steps_a_fence = 128;
    static constexpr std::size_t max_fences = 4;

    /// `context` must outlive the queue.
    explicit StepQueue(const Context& context) : context_(context) {}
    ~StepQueue();
    StepQueue(const StepQueue&) = delete;
    StepQueue& operator=(const StepQueue&) = delete;

    /// One more step was enqueued in the context, which is current. May wait. Throws DeviceError.
    void enqueued();

private:
    void wait_for_oldest();

    const Context& context_;
    std::deque<GLsync> fences_;  // the oldest first
    int steps_ = 0;              // since the latest fence
};

}  // namespace voxspring::gl
