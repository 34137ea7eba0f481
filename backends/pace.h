// Limits how many steps are handed to a device at once, so that they do not keep it busy for long: a driver
// that watches a display resets a device that does not answer for a second or two, and until then nothing is
// drawn.
#pragma once

#include <algorithm>

namespace voxspring {

class Pace {
public:
    /// The longest time that a device may be busy, as measured: a fraction of what drivers allow.
    static constexpr double longest_seconds = 0.25;

    /// Gives at most `most_steps` at once, however short they are.
    explicit Pace(int most_steps) : most_steps_(most_steps) {}

    /// How many steps to give at once. It is one step as long as nothing is known.
    int steps() const { return steps_; }
    /// Whether the caller has to wait for the device and tell measured() how long these steps took.
    bool is_unknown() const { return unknown_; }
    /// Tells that `steps` steps took `seconds`, from handing them over until the host knew that they had
    /// ended. The first steps take longer than later ones, because caches are empty and the device is asleep.
    /// So some more are measured, unless a shorter time would not change the number of steps to give at once.
    void measured(int steps, double seconds) {
        const double fitting = seconds > 0 ? longest_seconds / seconds * steps : most_steps_;
        steps_ = int(std::clamp(fitting, 1.0, double(most_steps_)));
        ++measurements_;
        unknown_ = steps_ > steps && steps_ < most_steps_ && measurements_ < max_measurements;
    }
    /// Called before steps of another problem.
    void forget() { *this = Pace(most_steps_); }

private:
    /// The most measurements. A caller that takes few steps at a time must not wait for the device after each
    /// of them for ever.
    static constexpr int max_measurements = 4;

    int most_steps_;
    int steps_ = 1;
    int measurements_ = 0;
    bool unknown_ = true;
};

}  // namespace voxspring
