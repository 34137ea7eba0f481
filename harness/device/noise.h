// Finds out whether a measured time can be trusted: how much its repetitions differ, and what else used the
// device at the same time.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// The seconds that a fixed amount of arithmetic takes on one core, the least of three tries. They tell how
/// fast the processor's clock is.
double spin_seconds();

/// The seconds that the threads of this process have been ready to run but had no core, since they began and
/// summed over the threads that still exist; empty if the system does not report them.
std::optional<double> waited_seconds();

/// The processes of a study at the moment at which other processes on a card are looked for.
struct OwnProcesses {
    std::vector<pid_t> all = {};  ///< the processes that are alive
    unsigned on_card = 0;         ///< how many processes of `all` have opened the card
};
/// How many of the processes `on_card` do not belong to the study, whose processes are `own`. In a container
/// the driver may number processes differently. Then no process of `own.all` is in `on_card`, and the result
/// is the number of `on_card` less `own.on_card`.
unsigned other_processes(const std::vector<pid_t>& on_card, const OwnProcesses& own);

/// What is known about the repetitions of one case. Each list has at most one element per repetition.
struct Observed {
    std::vector<double> seconds = {};        ///< time of each repetition, in the order of execution
    std::vector<double> spins = {};          ///< spin_seconds() after each repetition
    std::vector<double> waits = {};          ///< change of waited_seconds() per second
    std::vector<unsigned> card_mhz = {};     ///< the card's clock after each repetition
    std::vector<unsigned> other_users = {};  ///< how many other_processes() use the card
};
/// The reasons not to trust the time of the case, each with a figure in parentheses. Empty: no such reason.
std::vector<std::string> reasons_of_noise(const Observed& observed);

/// The largest accepted interquartile range of repetitions, as a fraction of their median. results/diff.py
/// has to detect that two builds differ by a tenth, which is impossible if the repetitions of one spread
/// further.
constexpr double max_spread = 0.1;
/// The largest accepted gap between two groups into which repetitions fall, as a fraction of their median. A
/// wider gap means that the repetitions ran under two different conditions.
constexpr double max_parting = 0.03;
/// The largest accepted change from the first third of the repetitions to the last one, as a fraction.
constexpr double max_drift = 0.05;
/// The largest accepted change of a clock, as a fraction. Times change by about the same fraction.
constexpr double max_clock_change = 0.1;
/// The largest accepted median of Observed::waits. If it is larger, other processes used the cores, or there
/// were more threads than cores.
constexpr double max_waiting = 0.1;

}  // namespace voxspring
