// The energy that a device uses while it works: its counter, checked against its sampled power.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/backend.h"

namespace voxspring {

/// Counts a device's energy. All members throw std::runtime_error once the system no longer reports it.
class EnergyMeter {
public:
    EnergyMeter() = default;
    EnergyMeter(const EnergyMeter&) = delete;
    EnergyMeter& operator=(const EnergyMeter&) = delete;
    virtual ~EnergyMeter() = default;

    /// The energy used since some moment in the past, in joules.
    virtual double joules() = 0;
    /// The power drawn now, by another way than the counter; empty if there is no other way.
    virtual std::optional<double> watts() { return std::nullopt; }
    virtual std::optional<unsigned> clock_mhz() { return std::nullopt; }
    virtual std::vector<std::string> throttle_reasons() { return {}; }
    /// The meter's name: "NVML" or "RAPL".
    virtual std::string name() const = 0;
};

/// The meter of a device: NVML for a card, RAPL for the processor. Throws std::runtime_error, with the
/// reason, if the device's energy cannot be measured.
std::unique_ptr<EnergyMeter> energy_meter_of(const Capabilities& capabilities);

/// The counters of all processor packages, in the folder where Linux shows them. Throws std::runtime_error if
/// there are none, or if they may not be read.
std::unique_ptr<EnergyMeter> rapl_meter(const std::string& folder = "/sys/class/powercap");

/// A device's energy over a stretch of time in which its load did not change.
struct EnergyUse {
    double seconds = 0;
    double watts = 0;                          ///< by the counter
    std::optional<double> sampled_watts = {};  ///< mean of the samples
    std::optional<unsigned> min_mhz = {}, max_mhz = {};
    std::vector<std::string> throttled = {};  ///< why the clock was held down, at any moment of that time
};

constexpr double max_leap_seconds = 0.5;

/// Calls `work` repeatedly: first for `lead_seconds`, so that clocks and averages settle, and then until
/// `seconds` are measured. The counter moves in leaps, some tens of milliseconds apart, and power is taken
/// from the first leap to the last. If two leaps are farther apart than max_leap_seconds, less time is
/// measured. Throws std::runtime_error if the counter moved fewer than two times.
EnergyUse measure_energy(EnergyMeter& meter, double lead_seconds, double seconds,
                         const std::function<void()>& work);

/// Counter and samples are two readings of one sensor. Over ten steady seconds they agree within this
/// fraction: a leap of the counter is 1% of that time, and a sample, the mean of one second, holds nothing
/// from before the lead. If they differ by more, one of them is wrong.
constexpr double max_power_disagreement = 0.05;
/// Whether counter and samples agree; true if there are no samples.
bool powers_agree(const EnergyUse& use);

}  // namespace voxspring
