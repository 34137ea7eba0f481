// A graphics card as its driver's management library sees it from outside of any context.
#pragma once

#include <sys/types.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// One card, through NVML. Loading that touches no device that a program computes on.
class Card {
public:
    /// Throws std::runtime_error, which says why it cannot be watched, for a card of `uuid`.
    explicit Card(const std::string& uuid);
    Card(const Card&) = delete;
    Card& operator=(const Card&) = delete;
    ~Card();

    /// The clock of its multiprocessors now; nothing where the driver does not tell.
    std::optional<unsigned> clock_mhz() const;
    /// What it has used since its driver was loaded, in joules; nothing where the driver does not count.
    std::optional<double> energy_joules() const;
    /// What it draws, in watts; since Ampere the mean of the last second.
    std::optional<double> power_watts() const;
    /// Why its clock is lower than it could be, the driver's names for that; an idle card's clock is no
    /// reason.
    std::vector<std::string> throttle_reasons() const;
    /// What it is set to: `power_limit_watts`, `ecc`, `mig`, `temperature_celsius`, without what the driver
    /// does not tell.
    nlohmann::json settings() const;
    /// The processes that compute on it, as the driver numbers them; nothing where it does not tell.
    std::optional<std::vector<pid_t>> processes() const;

private:
    struct Library;
    std::unique_ptr<Library> library_;
};

}  // namespace voxspring
