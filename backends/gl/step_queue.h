// Limits how many steps a driver may have queued. Without a limit a driver keeps the commands of all enqueued
// steps in memory.
#pragma once

#include <epoxy/gl.h>

#include <deque>

#include "backends/gl/context.h"

namespace voxspring::gl {

/// Puts a fence after every `steps_per_fence` steps. Once there are `max_fences`, the host first waits for
/// the oldest, so at most (max_fences + 1) * steps_per_fence steps are unfinished. While the host waits, the
/// device has hundreds of steps to do. A fence costs less than a thousandth of the time of its steps.
class StepQueue {
public:
    static constexpr int steps_per_fence = 128;
    static constexpr std::size_t max_fences = 4;

    /// `context` must outlive the queue.
    explicit StepQueue(const Context& context) : context_(context) {}
    ~StepQueue();
    StepQueue(const StepQueue&) = delete;
    StepQueue& operator=(const StepQueue&) = delete;

    /// Notes that one more step was enqueued in the context, which is current. May wait. Throws DeviceError.
    void enqueued();

private:
    void wait_for_oldest();

    const Context& context_;
    std::deque<GLsync> fences_;  // the oldest first
    int steps_ = 0;              // since the latest fence
};

}  // namespace voxspring::gl
