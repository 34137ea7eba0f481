// Limits how many steps are handed to a device at once, so that they do not keep it busy for long: a driver
// that watches a display resets a device that does not answer for a second or two, and until then nothing is
// drawn.
#pragma once

#include <algorithm>

namespace voxspring {

class Pace {
public:
    /// The longest time that the steps given at once may take: a fraction of what drivers allow.
    static constexpr double longest_seconds = 0.25;

    /// `most_steps`: the most steps to give at once, however short they are.
    explicit Pace(int most_steps) : most_steps_(most_steps) {}

    /// How many steps to give at once: one until measured() has been called.
    int steps() const { return steps_; }
    /// Whether the caller has to wait for the steps that it gives, and to tell measured() how long they took.
    bool is_unknown() const { return unknown_; }
    /// Tells that `steps` steps took `seconds`, from handing them over until the host knew that they had
    /// ended. The first steps take longer than later ones, because caches are empty, the device is asleep and
    /// a driver may still compile. So the first measurement alone never decides that steps are long.
    /// Measuring goes on, up to max_measurements times, while more steps fit into longest_seconds than were
    /// measured, but fewer than most_steps.
    void measured(int steps, double seconds) {
        const double fitting = seconds > 0 ? longest_seconds / seconds * steps : most_steps_;
        steps_ = int(std::clamp(fitting, 1.0, double(most_steps_)));
        ++measurements_;
        unknown_ = (steps_ > steps || measurements_ == 1) && steps_ < most_steps_ &&
                   measurements_ < max_measurements;
    }
    /// Forgets all measurements. To be called before steps of another problem.
    void forget() { *this = Pace(most_steps_); }

private:
    /// The most measurements. Without this limit, a caller that takes few steps at a time would wait for the
    /// device after every call.
    static constexpr int max_measurements = 4;

    int most_steps_;
    int steps_ = 1;
    int measurements_ = 0;
    bool unknown_ = true;
};

}  // namespace voxspring
