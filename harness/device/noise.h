// Whether a time can be trusted: how far repetitions are apart, and what else took the device meanwhile.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace voxspring {

/// Seconds that a fixed amount of arithmetic on one core takes, the least of some tries: the processor's
/// clock.
double spin_seconds();

/// Seconds for which the threads of this process that are alive have been ready to run and had no core, so
/// far; nothing where the system does not tell.
std::optional<double> waited_seconds();

/// A graphics card as its driver's management library (NVML) sees it from outside of any context. Loading it
/// touches no device that a program computes on.
class Card {
public:
    /// Throws std::runtime_error, which says why it cannot be watched, for a card of `uuid`.
    explicit Card(const std::string& uuid);
    Card(const Card&) = delete;
    Card& operator=(const Card&) = delete;
    ~Card();

    /// The clock of its multiprocessors now; nothing where the driver does not tell.
    std::optional<unsigned> clock_mhz() const;
    /// How many processes compute on it; nothing where the driver does not tell.
    std::optional<unsigned> process_count() const;

private:
    struct Library;
    std::unique_ptr<Library> library_;
};

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
constexpr double most_spread = 0.1;
/// A clock that moved by more moves times by as much.
constexpr double most_clock_change = 0.1;
/// Of a repetition's time, in the median. More is time that another process had.
constexpr double most_waiting = 0.1;

}  // namespace voxspring
