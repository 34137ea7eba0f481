// The contract between the harness and everything that can step a mass-spring-damper model.
// Adding a backend: one file that implements Backend and registers itself (registry.h), one roster line
// in CMakeLists.txt.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec4.hpp>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "backends/limits.h"
#include "backends/physics/edit.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring {

enum class Precision : std::uint8_t { float32, float64 };
std::string to_string(Precision precision);

/// How a backend is to be built. Whatever changes the numbers or the speed is here and is recorded in
/// the result.
struct Options {
    Precision precision = Precision::float32;
    Formulation formulation = Formulation::position;
    /// Tuning parameters by name, complete: every name that the backend registered, each with a value
    /// that it registered.
    std::map<std::string, std::string> tuning;
};

/// There is no such device, driver or context here: the backend is skipped with this reason.
class Unavailable : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// The device or its driver failed: the backend's row fails with this reason and the study goes on.
class DeviceError : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// The programming interfaces that backends are written in, whatever their version.
enum class ApiFamily : std::uint8_t { cpu, opengl, vulkan, cuda };

/// What a backend runs on.
struct Capabilities {
    std::string api;     ///< "CPU", "OpenGL 4.5 core", "CUDA 13.0"
    std::string device;  ///< as its driver names it
    std::string driver;  ///< version, or the SIMD target of a CPU backend
    std::string uuid;    ///< of the physical device; empty where there is none
    std::string clock;   ///< what the marks of timed() are: "steady_clock", "GL_TIMESTAMP", "CUDA event"
    bool deterministic = true;  ///< two runs give the same bits
    /// The device's highest clocks by what they drive ("sm", "memory"), where its driver tells.
    std::map<std::string, int> highest_mhz = {};
    /// What compiles kernels when a scene is uploaded, and its options but for the scene's macros. Empty: the
    /// driver, or nothing.
    std::string kernel_compiler = {};
    ApiFamily family = ApiFamily::cpu;
    bool is_software = false;  ///< a graphics API that the processor computes
    /// What measure_limits() is of, as results name it: "CPU", "CUDA", "OpenGL" (draws), "OpenGL compute".
    /// Backends of one name share one measurement. Empty: the measurement is of this API and version alone.
    std::string limits_of = {};
    bool has_borders = false;  ///< Backend::border() gives one
    /// What Backend::device_borders() takes. Empty: borders go through the host's memory alone. Where
    /// has_borders is not set they go by these ways alone.
    std::vector<std::string> border_ways = {};
    int devices = 1;  ///< how many its API shows here, on each of which it could step a part
};

/// One timed batch of steps.
struct Timing {
    double device_seconds = 0;  ///< between the two marks, on the backend's own clock
    double host_seconds = 0;    ///< from before the first call to after the last synchronization
};

/// What a run has to stay within, and how often that is checked.
struct DivergenceMonitor {
    /// The farthest that a particle may move in one step: |x(t) - x(t - dt)|, in units of length.
    double largest_increment = 0;
    /// Checked after a whole number of times that many steps, or as soon after as the backend can without
    /// slowing down; 0: never.
    int every = 0;
};

/// The first check that found a particle not finite or too fast, in steps since upload(): the run left its
/// bounds after step `last_good` and until step `found`.
struct Divergence {
    std::int64_t last_good = 0;
    std::int64_t found = 0;
};

/// What one step did, by name: what the hardware's own counters say ("samples_passed"), or how many of a
/// lattice's tiles were stepped. The evidence that a skip skips.
using WorkCount = std::map<std::string, std::uint64_t>;

/// Values of tuning parameters that a backend chose for a problem, and what they were chosen by.
struct Choice {
    std::string tuning;       ///< "tile=64x16"
    double step_seconds = 0;  ///< of a step, as predicted before any ran
};

/// Seconds of compiling code for a problem.
struct CompileTime {
    double spent = 0;  ///< by the upload; 0 of what was compiled before
    double cold = 0;   ///< where nothing is kept on disk; that what was found there took when it was compiled
    CompileTime& operator+=(const CompileTime& other) {
        spent += other.spent;
        cold += other.cold;
        return *this;
    }
};

/// The places of some particles of a simulation, which is one part of a larger body (layout/decomposition.h):
/// what the springs of the part beside it pull at, in the backend's own numbers, so that nothing is rounded
/// on the way. What one border read another one writes, of a backend with the same options.
class Border {
public:
    Border() = default;
    Border(const Border&) = delete;
    Border& operator=(const Border&) = delete;
    virtual ~Border() = default;

    virtual std::size_t bytes() const = 0;
    /// As the steps enqueued so far leave them; waits for those.
    virtual void read(std::byte* to) const = 0;
    /// From the next step on the particles, which are pinned, are there.
    virtual void write(const std::byte* from) = 0;
};

/// What a part of a body has in common with one beside it: its particles that are ghosts there, and ghosts of
/// its own. Both ascend.
struct SharedParticles {
    int part;  ///< the number of the one beside it
    std::vector<std::uint32_t> sent, received;
};

/// The borders of one part of a body with those beside it, all on devices that this process has, where they
/// travel from device to device and the host waits for none of it.
///
/// Most send and receive between steps. Where they travel within steps, each step of a part takes what the
/// same step of those beside it gave, whatever calls of step() the steps are of.
///
/// Each part is stepped by one thread, which steps no other part. The n-th receive() of a part is called
/// after the n-th send() of those beside it has returned, and their send() n + 2 after it has returned.
/// Either side may be destroyed first.
class DeviceBorders {
public:
    DeviceBorders() = default;
    DeviceBorders(const DeviceBorders&) = delete;
    DeviceBorders& operator=(const DeviceBorders&) = delete;
    virtual ~DeviceBorders() = default;

    /// Bytes that this part sends in a step.
    virtual std::size_t bytes() const = 0;
    /// To be called once before all else, in every part's thread, with what all parts of the body have in
    /// their order; this one is that of `part`. All are of backends with the same options. Throws
    /// Unavailable, with the reason, where the devices have no such way to each other.
    virtual void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) = 0;
    /// Takes over what `before`, the borders of the same part until the latest upload, connected with and
    /// what costs time to begin. To be called before connect(), for all parts or for none.
    virtual void take_over(DeviceBorders& before) { static_cast<void>(before); }
    /// Ends what connect() began and what all parts end together. To be called at the end of a run in which
    /// nothing failed, in every part's thread, once all parts are there. What is not ended so is given up by
    /// the destructor, which waits for no other part.
    virtual void disconnect() {}
    /// How many steps a call of Backend::step() may take where borders travel within them. All parts are then
    /// to be ready for their calls before one of them makes its own, and have made it before one of them asks
    /// for anything else: until then a device that several parts share may wait for one of them, and so may
    /// all that waits for this device. 0: borders travel between steps.
    virtual int steps_a_call() const { return 0; }
    /// Enqueues: the places, as the steps so far leave them, go to the parts beside this one. Nothing where
    /// borders travel within steps, and so does receive().
    virtual void send() = 0;
    /// Enqueues: from the next step on ghosts are where the parts beside this one sent them.
    virtual void receive() = 0;
};

/// The displacements of some particles for a picture of the running simulation, which the device itself puts
/// into an OpenGL buffer: nothing passes through the host.
class Feed {
public:
    Feed() = default;
    Feed(const Feed&) = delete;
    Feed& operator=(const Feed&) = delete;
    virtual ~Feed() = default;

    /// Fills the buffer, whose context is current, as the steps enqueued so far leave the particles, and
    /// waits until it is full. Another context may be current then. Destroyed while the buffer's context is
    /// current.
    virtual void write() = 0;
};

/// Displacements of some particles, as for Feed, which the device itself puts into host memory.
class HostFeed {
public:
    HostFeed() = default;
    HostFeed(const HostFeed&) = delete;
    HostFeed& operator=(const HostFeed&) = delete;
    virtual ~HostFeed() = default;

    /// x, y, z and 0 of each particle as the steps enqueued so far leave it, for which this waits; they stay
    /// until the next call.
    virtual std::span<const glm::vec4> read() = 0;
};

/// One simulation on one device. Constructing acquires the device and throws Unavailable where there is
/// none; destroying gives it back and never throws. Every other member throws DeviceError when the
/// device fails, after which the object is only good for destruction. Not thread-safe.
class Backend {
public:
    Backend() = default;
    Backend(const Backend&) = delete;
    Backend& operator=(const Backend&) = delete;
    virtual ~Backend() = default;

    virtual Capabilities capabilities() const = 0;

    /// Empty, or why this backend cannot run `problem` ("grid of 40000 x 1 exceeds the texture limit of
    /// 16384"). Cheap: allocates nothing on the device. Unless overridden: a problem with a tool, of a
    /// backend that has none.
    virtual std::string unsupported(const Problem& problem) const;

    /// Allocate, copy in, and stand at step 0. May be called again, with the same problem or another.
    /// Blocks until the device has it all. `problem` must outlive its use here, unchanged: until the next
    /// upload() or destruction. An empty list of `state` gives the bits of one of zeros.
    virtual void upload(const Problem& problem, const State& state) = 0;

    /// Keep a copy of the state on the device, for rewind(): right after upload(), until the next. False
    /// where this backend keeps none, or has no room for it.
    virtual bool keep_start() { return false; }
    /// Stand at step 0 as upload() left it, whose state keep_start() kept. What edits have been made since
    /// leave the problem as it was uploaded. Every step gives the bits that it would give after another
    /// upload().
    virtual void rewind() {}

    /// Enqueue a change of springs between the steps before and the steps after; may return before it is
    /// made. `edited` is the uploaded problem with this and all earlier edits since, which unsupported()
    /// accepts; it must outlive its use as `problem` does, changed by nothing but the next edit. From here on
    /// every step gives the bits that it would give had `edited` been uploaded with the state of this moment.
    ///
    /// What travels to the device is what `edit` touched. A backend whose arrays have no room for it, or
    /// whose kernel was chosen for springs of another kind, may build anew what it keeps of springs.
    virtual void edit(const Problem& edited, const SpringEdit& edit) = 0;

    /// The places of `particles`, ascending; to be used until the next upload(). The result is null where
    /// capabilities() say so. Throws Unavailable, with the reason, where it cannot step a part with this
    /// border.
    virtual std::unique_ptr<Border> border(const std::vector<std::uint32_t>& /*particles*/) {
        return nullptr;
    }
    /// The borders with other parts, in ascending order of these; to be used until the next upload(). `way`
    /// is one of Capabilities::border_ways. Throws Unavailable, with the reason, where there is no such way
    /// here, and what border() throws.
    virtual std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& /*borders*/,
                                                          const std::string& /*way*/) {
        return nullptr;
    }
    /// What fills the OpenGL buffer `buffer` with the displacements of `particles`: x, y, z and 0 in float32,
    /// 16 bytes each, in their order. The buffer's context is current; to be used until the next upload().
    /// The result is null where the backend cannot: the caller then uses download().
    virtual std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& /*particles*/,
                                       std::uint32_t /*buffer*/) {
        return nullptr;
    }
    /// What brings the displacements of `particles` to the host, in their order; to be used until the next
    /// upload(). Null where the backend cannot: then download(), which brings the whole state.
    virtual std::unique_ptr<HostFeed> host_feed(const std::vector<std::uint32_t>& /*particles*/) {
        return nullptr;
    }
    /// Whether problems may have a tool; it then overrides the two functions below.
    virtual bool has_tool() const { return false; }
    /// Enqueue a move of the tool between the steps before and the steps after: from here on it has moved by
    /// `displacement` (a length) since it took hold. upload() and rewind() leave it where it took hold. Both
    /// functions are for problems with a tool.
    virtual void move_tool(const glm::dvec3& displacement);
    /// Synchronize; the force on the tool in the latest step: minus the sum of what it did to the particles
    /// that it holds (Problem::tool), each in the backend's precision, added in float64 and in their order.
    /// Zero before the first step.
    virtual glm::dvec3 tool_force();

    /// Enqueue `count` steps; may return before they have run.
    virtual void step(int count) = 0;

    /// From the next upload() or rewind() on, check the state on the device while it steps. A check changes
    /// no bit of it. Until the first call: never.
    virtual void monitor(const DivergenceMonitor&) {}
    /// Where the run since upload() left its bounds, if it has. Synchronizes.
    virtual std::optional<Divergence> divergence() { return std::nullopt; }

    /// Wait for everything enqueued. Late errors surface here.
    virtual void synchronize() = 0;

    /// Synchronize, then copy the state out in canonical order, with one element per particle in both lists.
    virtual State download() = 0;

    /// Advance one step and count what it did, where there is something to count.
    virtual WorkCount count_work() { return {}; }

    /// What compiling code for the problem of the last upload() takes.
    virtual CompileTime compile_time() const { return {}; }

    /// What the last upload() chose by itself, where it predicts times to choose by.
    virtual std::optional<Choice> choice() const { return std::nullopt; }

    /// Measure what the device can do at best, in about a second. Before the first upload().
    virtual DeviceLimits measure_limits() = 0;

    /// Measure DeviceLimits::launch_seconds of this very process, where it differs from process to process;
    /// nothing where it does not. Before the first upload(), or after the last call of any other kind: it
    /// leaves the device as no step expects it.
    virtual std::optional<double> own_launch_seconds() { return std::nullopt; }

    /// The least that a step of `problem` takes. Cheap, and touches no device.
    virtual StepWork step_work(const Problem& problem) const = 0;

    /// The one stopwatch: synchronize, host clock, mark, whatever `run` enqueues, mark, synchronize, host
    /// clock.
    Timing timed(const std::function<void()>& run);

protected:
    enum class Mark : std::uint8_t { begin, end };

private:
    /// Enqueue a time stamp.
    virtual void mark(Mark which) = 0;
    /// Seconds between the two latest marks; called after synchronize().
    virtual double seconds_between_marks() const = 0;
};

}  // namespace voxspring
