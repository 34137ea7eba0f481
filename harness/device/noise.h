// Whether a time can be trusted: how far repetitions are apart, and what else took the device meanwhile.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// Seconds that a fixed amount of arithmetic on one core takes, the least of some tries: the processor's
/// clock.
double spin_seconds();

/// Seconds for which the threads of this process that are alive have been ready to run and had no core, so
/// far; nothing where the system does not tell.
std::optional<double> waited_seconds();

/// Processes of a study, while one of them has just computed on a card.
struct OwnProcesses {
    std::vector<pid_t> all = {};  ///< that are alive
    unsigned on_card = 0;         ///< of those, how many have the card
};
/// How many of the processes `on_card` are none of the study's. Where the driver numbers processes in another
/// namespace than ours (in a container), which shows in its knowing none of `own`, as many as the study has
/// on the card are taken for its own.
unsigned other_processes(const std::vector<pid_t>& on_card, const OwnProcesses& own);

/// What is known of the repetitions of one case. Where lists are not empty they are of all repetitions.
struct Observed {
    std::vector<double> seconds = {};        ///< of each repetition
    std::vector<double> spins = {};          ///< spin_seconds() beside it
    std::vector<double> waits = {};          ///< of a repetition's time its threads waited for a core
    std::vector<unsigned> card_mhz = {};     ///< after it
    std::vector<unsigned> other_users = {};  ///< processes on the card that are none of the study's
};
/// Why the case's time is not to be trusted, each reason with its figure in parentheses; none: nothing
/// is known against it.
std::vector<std::string> reasons_of_noise(const Observed& observed);

/// Half of the repetitions lie within that part of their median. Two builds that differ by a tenth, which is
/// what results/diff.py is to find, cannot be told apart where they spread over more.
constexpr double max_spread = 0.1;
/// Two kinds of repetitions that are nearer to each other say the same.
constexpr double max_parting = 0.03;
/// A clock that moved by more moves times by as much.
constexpr double max_clock_change = 0.1;
/// Of a repetition's time, in the median. More is time that another process had.
constexpr double max_waiting = 0.1;

}  // namespace voxspring
