// The clock, energy, settings and processes of a graphics card, read without creating a context on it.
#pragma once

#include <sys/types.h>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace voxspring {

/// One card, observed through NVML, NVIDIA's management library. NVML needs no CUDA context.
class Card {
public:
    /// The card with this UUID. Throws std::runtime_error, with the reason, if NVML cannot observe the card.
    explicit Card(const std::string& uuid);
    Card(const Card&) = delete;
    Card& operator=(const Card&) = delete;
    ~Card();

    /// The current clock of the card's multiprocessors in MHz; empty if the driver does not report it.
    std::optional<unsigned> clock_mhz() const;
    /// The energy used since the driver was loaded, in joules; empty if the driver does not count it.
    std::optional<double> energy_joules() const;
    /// The power drawn, in watts; on Ampere (except GA100) and later cards the mean of the last second. Empty
    /// if the driver does not report it.
    std::optional<double> power_watts() const;
    /// The reasons that the driver reports for a lowered clock, as text for users. An idle card is not
    /// counted as a reason.
    std::vector<std::string> throttle_reasons() const;
    /// Settings and temperature of the card as a JSON object with the keys `power_limit_watts`, `ecc`, `mig`
    /// and `temperature_celsius`. A key that the driver does not report is absent.
    nlohmann::json settings() const;
    /// The process IDs, as the driver numbers processes, of all that compute on the card; empty if the driver
    /// does not report them.
    std::optional<std::vector<pid_t>> processes() const;

private:
    struct Library;
    std::unique_ptr<Library> library_;
};

}  // namespace voxspring
