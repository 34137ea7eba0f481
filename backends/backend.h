// The contract between the harness and everything that can step a mass-spring-damper model: what every
// backend must do. facets.h has the abilities that only some backends have. To add a backend, write one file
// that implements Backend and registers it (registry.h), and add one line to the CMakeLists.txt of
// backends/ or cuda/.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "backends/facets.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring {

enum class Precision : std::uint8_t { float32, float64 };
std::string to_string(Precision precision);

/// The name (Api::name) of the API whose backends step on threads of the host's processor.
inline constexpr const char* host_api = "cpu";

/// How a backend is to be built, apart from its device (device_choice.h). The result records all of this.
struct Options {
    Precision precision = Precision::float32;
    Formulation formulation = Formulation::position;
    /// Values of tuning parameters by name. There is an accepted value for every parameter that the backend
    /// registered (BackendEntry::tuning).
    std::map<std::string, std::string> tuning;
};

/// Reports which tuning values a backend chose itself. `values` has the values that it uses, by parameter.
/// The result has only those parameters whose value in `options` is "auto". It is empty if there are none.
std::optional<Choice> choice_of_auto(const Options& options,
                                     const std::map<std::string, std::string>& values);

/// There is no such device, driver or context here. The backend is skipped with this reason.
class Unavailable : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// The device or its driver failed. The backend's row fails with this reason and the study goes on.
class DeviceError : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// What a backend runs on, and what it can do.
struct Capabilities {
    std::string api;     ///< "CPU", "OpenGL 4.5 core", "CUDA 13.0"
    std::string device;  ///< as its driver or /proc/cpuinfo names it, with ", software" if is_software
    std::string driver;  ///< the driver's version, or how a CPU backend computes: "AVX3, 16 threads"
    std::string uuid;    ///< UUID of the physical device; empty if none is known
    /// The clock that gives the time stamps of timed(): "steady_clock", "GL_TIMESTAMP", "CUDA event".
    std::string clock;
    bool deterministic = true;  ///< two runs give the same bits
    /// The highest clock rate of each unit of the device ("sm", "memory"), if the driver tells.
    std::map<std::string, int> highest_mhz = {};
    /// The compiler that compiles kernels in upload(), with its options except the macros of the scene. Empty
    /// if the driver compiles them or if there is nothing to compile.
    std::string kernel_compiler = {};
    /// The API, whatever its version (Api::name in api.h). A backend steps on the host's threads if it is
    /// "cpu".
    std::string family = host_api;
    bool is_software = false;  ///< the CPU does the work of a graphics API
    /// The name that results give to what measure_limits() measures: "CPU", "CUDA", "OpenGL" (draws), "OpenGL
    /// compute", "Vulkan". Backends with the same name share one measurement. Empty: only backends with the
    /// same `api` share it.
    std::string limits_of = {};
    bool has_borders = false;  ///< the backend can step one part of a divided body (BorderFacet::border())
    /// The ways in which parts of a divided body can exchange the places of particles at their borders from
    /// device to device (BorderFacet::device_borders()). Empty: only through the host's memory. If
    /// has_borders is not set, only in these ways.
    std::vector<std::string> border_ways = {};
    int devices = 1;  ///< how many devices CUDA shows, each for one part of a body; other APIs: 1

    bool steps_on_host() const { return family == host_api; }
};

/// One timed batch of steps.
struct Timing {
    double device_seconds = 0;  ///< between the two marks of timed(), on the clock Capabilities::clock
    double host_seconds = 0;  ///< on the host's clock, from before the first mark to the last synchronization
};

/// One simulation on one device. The constructor acquires the device and throws Unavailable if there is none;
/// the destructor releases it and never throws. Every other member throws DeviceError if the device fails,
/// after which the object can only be destroyed. Not thread-safe.
class Backend : public Facets {
public:
    virtual Capabilities capabilities() const = 0;

    /// Returns an empty string, or why this backend cannot run `problem` ("grid of 40000 x 1 exceeds the
    /// texture limit of 16384"). Cheap: allocates nothing on the device. Unless overridden, it refuses a
    /// problem with a tool if the backend has none.
    virtual std::string unsupported(const Problem& problem) const;

    /// Allocates memory, copies `problem` and `state` to the device and goes to step 0. May be called again,
    /// with the same problem or another one. Returns when the device has everything. `problem` must exist
    /// unchanged until the next upload() or the backend's destruction. An empty list of `state` gives the
    /// same bits as a list of zeros.
    virtual void upload(const Problem& problem, const State& state) = 0;

    /// Enqueues a change of springs, which is made after the steps enqueued so far and before later ones. May
    /// return before the change is made. `edited` is the uploaded problem with this edit and all earlier
    /// edits since upload(); unsupported() must accept it. `edited` must exist until the next upload() or the
    /// backend's destruction. The caller may change it only to make the next edit. Later steps give the bits
    /// that they would give if `edited` had been uploaded with the present state.
    ///
    /// Only what `edit` touched travels to the device. A backend may rebuild all its data about springs if
    /// its arrays have no room for the edit, or if its kernel cannot handle the new springs. cpu_reference
    /// always does so.
    virtual void edit(const Problem& edited, const SpringEdit& edit) = 0;

    /// Enqueues `count` steps. May return before they have run.
    virtual void step(int count) = 0;

    /// Waits for everything enqueued. Throws for errors of enqueued work that were not thrown before.
    virtual void synchronize() = 0;

    /// Synchronizes, then copies the state out in canonical order, with one element per particle in both
    /// lists.
    virtual State download() = 0;

    /// Times `run` by this sequence: synchronize, read the host's clock, mark, call `run`, mark, synchronize,
    /// read the host's clock.
    Timing timed(const std::function<void()>& run);

protected:
    enum class Mark : std::uint8_t { begin, end };

private:
    /// Enqueues a time stamp.
    virtual void mark(Mark which) = 0;
    /// Seconds between the two latest marks. Called after synchronize().
    virtual double seconds_between_marks() const = 0;
};

}  // namespace voxspring
