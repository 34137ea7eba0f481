// Which tiles (small parts of a lattice) may be left out of a step, and whether it pays to find out: the
// rules of the tuning parameter `rest`, for every backend that has it. How such tiles are found is up to each
// backend.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "backends/backend.h"

namespace voxspring {

/// What `rest` does with a tile at rest: in the latest step neither its state nor that of a tile beside it
/// changed.
enum class Rest : std::uint8_t {
    step,    ///< the tile is stepped like all others
    choose,  ///< rest=auto: like `step` or like `skip`, whichever should take less time
    skip,    ///< the tile is left out, which changes no bit
    /// Like `skip`, and displacements and increments below flushed_below become zero. cpu_parallel takes that
    /// number in lattice spacings.
    flush,
};

/// The value of the tuning parameter `rest`. rest=auto means `step` with terms=all, otherwise `choose`.
Rest rest_of(const Options& options);

/// An empty string, or why `rest` does not go with the formulation (BackendEntry::refused_options).
std::string refused_rest(const Options& options);

/// Whether a body at rest stays at rest, because neither gravity nor a load acts on it.
bool stays_at_rest(const Problem& problem);

/// Decides from step to step whether tiles are checked for rest, which costs a little. Tiles are checked for
/// a period. Then the policy asks how many tiles were active, and pauses if too few rested. Each further
/// pause in a row is twice as long, up to max_pause steps.
class RestPolicy {
public:
    struct Parameters {
        int period;  ///< steps between two decisions while tiles are checked
        /// The shortest and the longest pause: steps without checks.
        int min_pause, max_pause;
        /// Checks pay if active tiles are at most this fraction of all tiles.
        std::size_t paying_numerator, paying_denominator;
    };

    explicit RestPolicy(const Parameters& parameters) : parameters_(parameters) {}

    /// To be called before the first step. `checks`: whether tiles are checked at first. `chooses`: whether
    /// the policy may change this later.
    void start(bool checks, bool chooses);

    /// What a step does with tiles at rest: "step", "skip", or "skip_or_step" if that may change.
    std::string choice() const {
        if (chooses_) return "skip_or_step";
        return checks_ ? "skip" : "step";
    }
    /// Whether tiles are checked now or may be checked later.
    bool may_check() const { return checks_ || chooses_; }
    /// Whether the next step checks tiles.
    bool checks() const { return checks_; }
    bool pays(std::size_t active, std::size_t tiles) const {
        return parameters_.paying_denominator * active <= parameters_.paying_numerator * tiles;
    }

    /// The most steps that may be made before is_due() is asked again.
    int steps_to_decision() const { return chooses_ ? left_ : std::numeric_limits<int>::max(); }
    void stepped(int steps) { left_ -= chooses_ ? steps : 0; }
    /// Whether the caller has to call begin_checks(), decide() or go_on().
    bool is_due() const { return chooses_ && left_ <= 0; }

    /// Begins checks, for example at the end of a pause. The caller must mark every tile as active.
    void begin_checks();
    /// Decides whether checks go on. `active`: how many of `tiles` tiles were active lately.
    void decide(std::size_t active, std::size_t tiles);
    /// To be called instead of decide() if the number of active tiles is not known yet. Checks go on for a
    /// period.
    void go_on() { left_ = parameters_.period; }

private:
    const Parameters parameters_;
    bool checks_ = false, chooses_ = false;
    int left_ = 0;   ///< steps until the next decision whether tiles are checked
    int pause_ = 0;  ///< steps of the next pause
};

}  // namespace voxspring
