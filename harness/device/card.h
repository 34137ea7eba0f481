// A graphics card as its driver's management library sees it, outside of any context.
#pragma once

#include <sys/types.h>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// One card, observed through NVML, NVIDIA's management library. Loading NVML opens no device to compute on.
class Card {
public:
    /// The card with this UUID. Throws std::runtime_error, with the reason, if it cannot be watched.
    explicit Card(const std::string& uuid);
    Card(const Card&) = delete;
    Card& operator=(const Card&) = delete;
    ~Card();

    /// The current clock of the card's multiprocessors in MHz; empty if the driver does not report it.
    std::optional<unsigned> clock_mhz() const;
    /// The energy used since the driver was loaded, in joules; empty if the driver does not count it.
    std::optional<double> energy_joules() const;
    /// The power drawn, in watts; since Ampere the mean of the last second. Empty if it is not reported.
    std::optional<double> power_watts() const;
    /// Why the clock is lower than it could be, in the driver's terms. That the card is idle does not count
    /// as a reason.
    std::vector<std::string> throttle_reasons() const;
    /// Settings and temperature of the card: `power_limit_watts`, `ecc`, `mig`, `temperature_celsius`,
    /// without those that the driver does not report.
    nlohmann::json settings() const;
    /// The ids of the processes that compute on the card, as the driver numbers them; empty if not reported.
    std::optional<std::vector<pid_t>> processes() const;

private:
    struct Library;
    std::unique_ptr<Library> library_;
};

}  // namespace voxspring
