// Whether a time can be trusted: how far repetitions are apart, and what else used the device meanwhile.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// Seconds for a fixed amount of arithmetic on one core, the least of some tries: a measure of the
/// processor's clock.
double spin_seconds();

/// Seconds for which the living threads of this process have so far been ready to run but had no core; empty
/// if the system does not report it.
std::optional<double> waited_seconds();

/// The processes of a study, just after one of them computed on a card.
struct OwnProcesses {
    std::vector<pid_t> all = {};  ///< the processes that are alive
    unsigned on_card = 0;         ///< how many of those have opened the card
};
/// How many of the processes `on_card` do not belong to the study. In a container the driver may number
/// processes in another namespace: then `on_card` has none of `own.all`, and `own.on_card` is subtracted.
unsigned other_processes(const std::vector<pid_t>& on_card, const OwnProcesses& own);

/// What is known about the repetitions of one case. A list is empty or has one element per repetition.
struct Observed {
    std::vector<double> seconds = {};        ///< time of each repetition, in the order of execution
    std::vector<double> spins = {};          ///< spin_seconds() after each repetition
    std::vector<double> waits = {};          ///< seconds that threads waited for a core, per second
    std::vector<unsigned> card_mhz = {};     ///< the card's clock after each repetition
    std::vector<unsigned> other_users = {};  ///< other programs' processes on the card
};
/// The reasons not to trust the case's time, each with its figure in parentheses. Empty if none is known.
std::vector<std::string> reasons_of_noise(const Observed& observed);

/// The largest accepted interquartile range, as a fraction of the median. results/diff.py is to find builds
/// that differ by a tenth, which is impossible if repetitions spread over more.
constexpr double max_spread = 0.1;
/// The largest accepted gap between two groups of repetitions, as a fraction of their median. With a wider
/// gap the repetitions count as two different kinds.
constexpr double max_parting = 0.03;
/// The largest accepted change from the first third of the repetitions to the last one, as a fraction.
constexpr double max_drift = 0.05;
/// The largest accepted change of a clock. Times change by as much as the clock does.
constexpr double max_clock_change = 0.1;
/// The largest accepted median of Observed::waits. More waiting means that another process had the cores.
constexpr double max_waiting = 0.1;

}  // namespace voxspring
