// The energy that a device uses while it works: its counter, checked against its sampled power.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/backend.h"

namespace voxspring {

/// What counts a device's energy. All throw std::runtime_error once the system no longer tells.
class EnergyMeter {
public:
    EnergyMeter() = default;
    EnergyMeter(const EnergyMeter&) = delete;
    EnergyMeter& operator=(const EnergyMeter&) = delete;
    virtual ~EnergyMeter() = default;

    /// Since some moment in the past, in joules.
    virtual double joules() = 0;
    /// What it draws now, by another way than the counter; nothing where there is none.
    virtual std::optional<double> watts() { return std::nullopt; }
    virtual std::optional<unsigned> clock_mhz() { return std::nullopt; }
    virtual std::vector<std::string> throttle_reasons() { return {}; }
    /// "NVML" or "RAPL".
    virtual std::string name() const = 0;
};

/// That of a device: of a card NVML's, of the processor RAPL's. Throws std::runtime_error, which says why its
/// energy cannot be measured.
std::unique_ptr<EnergyMeter> energy_meter_of(const Capabilities& capabilities);

/// The counters of all processor packages, in the folder where Linux shows them. Throws std::runtime_error
/// where there are none, or none that may be read.
std::unique_ptr<EnergyMeter> rapl_meter(const std::string& folder = "/sys/class/powercap");

/// A device's energy over a stretch of time in which its load did not change.
struct EnergyUse {
    double seconds = 0;
    double watts = 0;                          ///< by the counter
    std::optional<double> sampled_watts = {};  ///< mean of the samples
    std::optional<unsigned> min_mhz = {}, max_mhz = {};
    std::vector<std::string> throttled = {};  ///< why its clock was held down at any moment of it
};

constexpr double max_leap_seconds = 0.5;

/// Calls `work` again and again, for `lead_seconds` first, so that clocks and averages settle, and then until
/// `seconds` are measured. The counter moves in leaps, some tens of milliseconds apart: power is taken from
/// the first leap to the last. Where two are farther apart than max_leap_seconds, less is measured. Throws
/// std::runtime_error if it moved fewer than two times.
EnergyUse measure_energy(EnergyMeter& meter, double lead_seconds, double seconds,
                         const std::function<void()>& work);

/// Counter and samples, two readings of one sensor, agree within that over ten steady seconds: the counter's
/// leaps are 1% of them, and a sample, the mean of a second, knows nothing older once the lead is over.
/// Farther apart one is wrong.
constexpr double max_power_disagreement = 0.05;
/// Whether they do; true where there are no samples.
bool powers_agree(const EnergyUse& use);

}  // namespace voxspring
