#include "cuda/common/ticks.h"

#include <chrono>

namespace voxspring::cuda {

void Ticks::open(std::size_t held) {
    asked_.resize(1);
    answers_.resize(held);
    handed_on_.resize(1);
    handed_on_.fill_with_zeros(stream_);
    taken_blocks_.resize(1);
    desk_.open(asked_.data(), {answers_.data(), held});
}

void Ticks::order(Vector<float> moved, std::uint32_t steps) {
    wait();
    desk_.order(moved, steps);
    if (!running_) begin(0);
}

void Ticks::end() {
    if (!running_) return;
    wait();
    desk_.order_end();
    running_ = false;
    // Wait for the end of the launch: until the launch has read this order, no other order may replace it.
    wait_for_stream_();
}

const std::vector<HeldForce<float>>& Ticks::forces() {
    wait();
    return desk_.forces();
}

void Ticks::begin(std::uint32_t again) {
    taken_blocks_.fill_with_zeros(stream_);
    launch_({asked_.data(), handed_on_.data(), taken_blocks_.data(), answers_.data(), desk_.tick(),
             max_idle_nanoseconds},
            again);
    running_ = true;
}

void Ticks::wait() {
    using Clock = std::chrono::steady_clock;
    // An answer usually takes microseconds. Asking the driver at every look whether the launch has ended
    // would delay the next look.
    constexpr auto patience = std::chrono::milliseconds(1);
    bool again = false;
    for (auto look = Clock::now() + patience; !desk_.answered();) {
        if (Clock::now() < look) continue;
        look = Clock::now() + patience;
        // The answer may have come after the last look at desk_.
        if (!stream_.has_ended() || desk_.answered()) continue;
        running_ = false;
        wait_for_stream_();
        if (again) throw DeviceError("the resident kernel ended twice without receiving the host's order");
        again = true;
        desk_.order_again();
        begin(desk_.steps());
    }
}

}  // namespace voxspring::cuda
