#include "harness/device/energy.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <stdexcept>
#include <stop_token>
#include <thread>

#include "harness/base/clock.h"
#include "harness/base/statistics.h"
#include "harness/device/card.h"

namespace voxspring {
namespace {

class CardMeter final : public EnergyMeter {
public:
    explicit CardMeter(const std::string& uuid) : card_(uuid) { (void)joules(); }

    double joules() override {
        const auto joules = card_.energy_joules();
        if (!joules) throw UnknownEnergy("the driver does not count this card's energy");
        return *joules;
    }
    std::optional<double> watts() override { return card_.power_watts(); }
    std::optional<unsigned> clock_mhz() override { return card_.clock_mhz(); }
    std::vector<std::string> throttle_reasons() override { return card_.throttle_reasons(); }
    std::string name() const override { return "NVML"; }

private:
    const Card card_;
};

/// The energy counter of one processor package. It wraps to zero after `range` microjoules.
struct Package {
    std::filesystem::path counter;
    /// All in microjoules: `last` is the latest value, `before` is `range` times the number of wraps so far.
    std::uint64_t range = 0, last = 0, before = 0;
};

std::optional<std::uint64_t> number_in(const std::filesystem::path& path) {
    std::ifstream file(path);
    std::uint64_t number = 0;
    if (!(file >> number)) return std::nullopt;
    return number;
}

/// The folder of each processor package's energy counter, by the package's name. Linux may show the counter
/// of a package twice: read through the processor's registers (intel-rapl) and read through memory
/// (intel-rapl-mmio). In that case the result has the folder of intel-rapl.
std::map<std::string, std::filesystem::path> package_folders(const std::string& folder) {
    std::map<std::string, std::filesystem::path> packages;
    std::error_code none;
    for (const auto& domain : std::filesystem::directory_iterator(folder, none)) {
        std::ifstream file(domain.path() / "name");
        std::string name;
        if (!(file >> name) || !name.starts_with("package")) continue;
        const bool by_memory = domain.path().filename().string().starts_with("intel-rapl-mmio");
        if (by_memory) {
            packages.emplace(name, domain.path());
        } else {
            packages[name] = domain.path();
        }
    }
    return packages;
}

class RaplMeter final : public EnergyMeter {
public:
    explicit RaplMeter(const std::string& folder) {
        for (const auto& [name, domain] : package_folders(folder)) {
            const auto range = number_in(domain / "max_energy_range_uj");
            const auto now = number_in(domain / "energy_uj");
            if (!range || !now)
                throw UnknownEnergy("the processor's energy counter cannot be read; usually only root may");
            packages_.push_back({.counter = domain / "energy_uj", .range = *range, .last = *now});
        }
        if (packages_.empty()) throw UnknownEnergy("the processor has no energy counter here");
    }

    double joules() override {
        double sum = 0;
        for (Package& package : packages_) {
            const auto now = number_in(package.counter);
            if (!now) throw UnknownEnergy("cannot read " + package.counter.string());
            if (*now < package.last) package.before += package.range;
            package.last = *now;
            sum += 1e-6 * double(package.before + *now);
        }
        return sum;
    }
    std::string name() const override { return "RAPL"; }

private:
    std::vector<Package> packages_;
};

/// Reads a meter about every 10 ms, on a separate thread, until end() is called.
class Sampling {
public:
    explicit Sampling(EnergyMeter& meter)
        : meter_(meter),
          begin_(Clock::now()),
          thread_([this](const std::stop_token& stopped) { run(stopped); }) {}

    /// The seconds between the first and the latest change of the energy counter.
    double measured_seconds() const { return measured_; }
    /// Stops reading, and returns what was measured. Rethrows an exception of the meter. Throws
    /// UnknownEnergy if the counter changed fewer than two times.
    EnergyUse end() {
        thread_ = {};
        if (error_) std::rethrow_exception(error_);
        if (leaps_.size() < 2) throw UnknownEnergy("the energy counter was updated fewer than two times");
        EnergyUse use;
        use.seconds = leaps_.back().seconds - leaps_.front().seconds;
        use.watts = (leaps_.back().joules - leaps_.front().joules) / use.seconds;
        if (!watts_.empty()) use.sampled_watts = mean(watts_);
        if (!mhz_.empty()) {
            use.min_mhz = *mhz_.begin();
            use.max_mhz = *mhz_.rbegin();
        }
        use.throttled.assign(throttled_.begin(), throttled_.end());
        return use;
    }

private:
    static constexpr std::chrono::milliseconds interval{10};

    struct Leap {
        double seconds, joules;
    };

    void run(const std::stop_token& stopped) {
        try {
            double last = meter_.joules();
            while (!stopped.stop_requested()) {
                std::this_thread::sleep_for(interval);
                const double joules = meter_.joules();
                if (joules != last) {
                    leaps_.push_back({seconds_since(begin_), joules});
                    measured_ = leaps_.back().seconds - leaps_.front().seconds;
                }
                last = joules;
                if (const auto watts = meter_.watts()) watts_.push_back(*watts);
                if (const auto mhz = meter_.clock_mhz()) mhz_.insert(*mhz);
                for (const std::string& reason : meter_.throttle_reasons()) throttled_.insert(reason);
            }
        } catch (...) {
            error_ = std::current_exception();
        }
    }
    EnergyMeter& meter_;
    const Clock::time_point begin_;
    std::atomic<double> measured_ = 0;
    std::vector<Leap> leaps_;
    std::vector<double> watts_;
    std::set<unsigned> mhz_;
    std::set<std::string> throttled_;
    std::exception_ptr error_;
    std::jthread thread_;  // declared last: it ends before the members that it uses are destroyed
};

}  // namespace

std::unique_ptr<EnergyMeter> rapl_meter(const std::string& folder) {
    return std::make_unique<RaplMeter>(folder);
}

std::unique_ptr<EnergyMeter> energy_meter_of(const Capabilities& capabilities) {
    if (capabilities.steps_on_host() || capabilities.is_software) return rapl_meter();
    if (capabilities.uuid.empty())
        throw UnknownEnergy(capabilities.device + " has no UUID, by which NVML finds a card");
    try {
        return std::make_unique<CardMeter>(capabilities.uuid);
    } catch (const std::runtime_error& reason) {
        throw UnknownEnergy(reason.what());  // the card cannot be watched
    }
}

EnergyUse measure_energy(EnergyMeter& meter, double lead_seconds, double seconds,
                         const std::function<void()>& work) {
    const auto work_for = [&](double limit) {
        for (const auto begin = Clock::now(); seconds_since(begin) < limit;) work();
    };
    work_for(lead_seconds);
    Sampling sampling(meter);
    work_for(seconds);
    // The time before the counter's first change and after its last one is not measured. So a little more
    // work is needed until `seconds` are measured.
    for (const auto begin = Clock::now();
         sampling.measured_seconds() < seconds && seconds_since(begin) < max_leap_seconds;)
        work();
    return sampling.end();
}

bool powers_agree(const EnergyUse& use) {
    return !use.sampled_watts ||
           std::abs(*use.sampled_watts - use.watts) <= max_power_disagreement * use.watts;
}

}  // namespace voxspring
