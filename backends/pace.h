// How many steps a device is given at once, so that none of what it is given keeps it for long: a driver that
// watches a display resets a device that does not answer for a second or two, and until then nothing is
// drawn.
#pragma once

#include <algorithm>

namespace voxspring {

class Pace {
public:
    /// What a device may be kept for, as measured: a fraction of what drivers allow.
    static constexpr double longest_seconds = 0.25;

    /// No more than `most_steps` at once, however short they are.
    explicit Pace(int most_steps) : most_steps_(most_steps) {}

    /// Steps to give at once; one as long as nothing is known.
    int steps() const { return steps_; }
    /// Whether the device is to be waited for, and measured() to be told how long these steps took.
    bool is_unknown() const { return unknown_; }
    /// `steps` steps took `seconds`, from handing them over until the host knew of their end. That is too
    /// long for the first ones, which find caches empty and a device asleep: so some more are measured,
    /// unless that would change nothing.
    void measured(int steps, double seconds) {
        const double fitting = seconds > 0 ? longest_seconds / seconds * steps : most_steps_;
        steps_ = int(std::clamp(fitting, 1.0, double(most_steps_)));
        ++measurements_;
        unknown_ = steps_ > steps && steps_ < most_steps_ && measurements_ < max_measurements;
    }
    /// Steps of another problem are to come.
    void forget() { *this = Pace(most_steps_); }

private:
    /// A caller that takes few steps at a time is not to wait for them for ever.
    static constexpr int max_measurements = 4;

    int most_steps_;
    int steps_ = 1;
    int measurements_ = 0;
    bool unknown_ = true;
};

}  // namespace voxspring
