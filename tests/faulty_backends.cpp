// Backends that end their process in the way that their name says, and one that takes long. Linked with the
// program's main() they make faulty_voxspring, which tests/overnight_test.py runs.
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

using Fault = std::function<void()>;

enum class Where : std::uint8_t { everywhere, not_in_the_lowest_slab };

/// cpu_reference, which calls `fault` in every step.
class Faulty : public MonitoredBackend {
public:
    explicit Faulty(Fault fault, Where where) : fault_(std::move(fault)), where_(where) {}

private:
    void begin(const Problem& problem, const State& state) override {
        spared_ = where_ != Where::everywhere && problem.rest_position.front().z == 0;
        MonitoredBackend::begin(problem, state);
    }
    void integrate(int count) override {
        if (!spared_) fault_();
        MonitoredBackend::integrate(count);
    }

    Fault fault_;
    const Where where_;
    bool spared_ = false;
};

void take_time() { std::this_thread::sleep_for(std::chrono::milliseconds(20)); }

/// Takes time, and says that it steps on no host.
class SlowDevice final : public Faulty {
public:
    SlowDevice() : Faulty(take_time, Where::everywhere) {}
    Capabilities capabilities() const override {
        Capabilities capabilities = Faulty::capabilities();
        capabilities.family = "opengl";
        return capabilities;
    }
};

/// Crashes as a driver does, even under a sanitizer.
void crash() {
    std::signal(SIGSEGV, SIG_DFL);
    (void)std::raise(SIGSEGV);
}

void hang() {
    for (;;) pause();
}

void take_all_memory() {
    // Limits the address space to what is already taken plus 64 MiB.
    std::ifstream statm("/proc/self/statm");
    rlim_t pages = 0;
    statm >> pages;
    const rlim_t most = pages * rlim_t(sysconf(_SC_PAGESIZE)) + (rlim_t(64) << 20);
    const rlimit limit{most, most};
    setrlimit(RLIMIT_AS, &limit);
    std::vector<std::vector<char>> taken;
    for (;;) taken.emplace_back(std::size_t(1) << 20, 'x');
}

void be_killed_for_memory() { (void)std::raise(SIGKILL); }

/// Fails from the hundredth step of a process on.
void wear_out() {
    static int steps = 0;
    if (++steps > 100) throw DeviceError("the card fell off the bus");
}

Registered backend(const std::string& name, const Fault& in_constructor, const Fault& in_step,
                   Where where = Where::everywhere) {
    return registered_for_test(name, [=] {
        in_constructor();
        return std::make_unique<Faulty>(in_step, where);
    });
}

const Fault nothing = [] {};
const Registered backends[] = {
    backend("faulty_crashes", nothing, crash),
    backend("faulty_hangs", nothing, hang),
    backend("faulty_is_killed", nothing, be_killed_for_memory),
    backend("faulty_takes_all_memory", nothing, take_all_memory),
    backend(
        "faulty_aborts_when_constructed", [] { std::abort(); }, nothing),
    backend("faulty_hangs_when_constructed", hang, nothing),
    backend("wears_out", nothing, wear_out),
    backend("slow", nothing, take_time),
    registered_as<SlowDevice>("slow_device"),
    backend("part_crashes", nothing, crash, Where::not_in_the_lowest_slab),
    backend("part_hangs", nothing, hang, Where::not_in_the_lowest_slab),
    registered_for_test("has_threads_per_tile",
                        [] { return std::make_unique<Faulty>(nothing, Where::everywhere); },
                        Formulation::increment, {{"threads", {"auto", "1"}}}),
};

}  // namespace
}  // namespace voxspring::testing
