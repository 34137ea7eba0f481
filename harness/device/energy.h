// Measures the energy that a device uses while it works: by its energy counter, which is checked against
// samples of its power if the device reports that.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "backends/backend.h"

namespace voxspring {

/// The energy that a device uses cannot be measured here, or the meter failed; the message says why.
class UnknownEnergy : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Counts the energy that a device uses.
class EnergyMeter {
public:
    EnergyMeter() = default;
    EnergyMeter(const EnergyMeter&) = delete;
    EnergyMeter& operator=(const EnergyMeter&) = delete;
    virtual ~EnergyMeter() = default;

    /// The energy used since some past moment, in joules. Throws UnknownEnergy if it is not reported.
    virtual double joules() = 0;
    /// The power drawn now or, on some cards, in the last second, in watts, as the device itself reports it
    /// (not derived from joules()). Empty if it reports none.
    virtual std::optional<double> watts() { return std::nullopt; }
    virtual std::optional<unsigned> clock_mhz() { return std::nullopt; }
    virtual std::vector<std::string> throttle_reasons() { return {}; }
    /// The meter's name: "NVML" or "RAPL".
    virtual std::string name() const = 0;
};

/// The meter of a device: NVML if it has a UUID (a card), otherwise RAPL (the processor). Throws
/// UnknownEnergy if there is none.
std::unique_ptr<EnergyMeter> energy_meter_of(const Capabilities& capabilities);

/// A meter for the sum of all processor packages. `folder` is where Linux shows their counters. Throws
/// UnknownEnergy if there are none, or if they may not be read.
std::unique_ptr<EnergyMeter> rapl_meter(const std::string& folder = "/sys/class/powercap");

/// A device's power and clock over a stretch of time in which its load did not change.
struct EnergyUse {
    double seconds = 0;
    double watts = 0;                          ///< mean, from the energy counter
    std::optional<double> sampled_watts = {};  ///< mean of EnergyMeter::watts(); empty: no samples
    std::optional<unsigned> min_mhz = {}, max_mhz = {};
    std::vector<std::string> throttled = {};  ///< all reasons for a lowered clock that were seen
};

/// How long measure_energy() may work beyond the time asked for, to see a further update of the counter.
constexpr double max_leap_seconds = 0.5;

/// Calls `work` repeatedly: first for `lead_seconds` without measuring, so that clocks and averages settle,
/// and then until `seconds` are measured. A card's energy counter is updated only every few tens of
/// milliseconds, so the mean power is computed from the first update to the last one. If updates are more
/// than half of max_leap_seconds apart, the measured time may be shorter than `seconds`. Throws what `work`
/// throws. After all work has been done, throws UnknownEnergy if the meter failed or if its counter changed
/// fewer than two times.
EnergyUse measure_energy(EnergyMeter& meter, double lead_seconds, double seconds,
                         const std::function<void()>& work);

/// The largest accepted difference between EnergyUse::sampled_watts and EnergyUse::watts, as a fraction of
/// the latter. Both come from one sensor. Over five seconds of constant load they agree within this fraction:
/// the counter is updated at least fifty times, and each sample is the mean power of a second on the cards
/// that Card::power_watts() names. If they differ by more, one of them is wrong.
constexpr double max_power_disagreement = 0.05;
/// Whether the powers from counter and samples agree; true if there are no samples.
bool powers_agree(const EnergyUse& use);

}  // namespace voxspring
