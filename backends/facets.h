// What some backends can do besides what every backend must do (backend.h). A facet is an interface for such
// an ability. A backend returns a pointer to it, or null if it lacks it (class Facets). The other functions
// of Facets do nothing by default.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "backends/limits.h"
#include "backends/physics/problem.h"

namespace voxspring {

/// The limits that a run has to stay within, and how often that is checked.
struct DivergenceMonitor {
    /// The farthest that a particle may move in one step: |x(t) - x(t - dt)|, in units of length.
    double largest_increment = 0;
    /// Checks are due after every multiple of this many steps, or as soon afterwards as the backend can make
    /// them without slowing down. 0: never.
    int every = 0;
};

/// The first check that found a particle not finite or too fast, in steps since upload(). The run left its
/// limits after step `last_good` and no later than step `found`.
struct Divergence {
    std::int64_t last_good = 0;
    std::int64_t found = 0;
};

/// What one step did, by name: what the hardware's counters say ("samples_passed"), or how many of a
/// lattice's tiles were stepped. It shows that skipped work is really skipped.
using WorkCount = std::map<std::string, std::uint64_t>;

/// Values of tuning parameters that a backend chose for a problem.
struct Choice {
    std::string tuning;                                 ///< "interior=vote,registers=64"
    std::optional<double> step_seconds = std::nullopt;  ///< the prediction by which it chose, if it has one
};

/// Seconds of compiling code for a problem.
struct CompileTime {
    double spent = 0;  ///< by the upload; 0 for code that was compiled before
    double cold = 0;   ///< without a disk cache; for code found there, what its compilation once took
    CompileTime& operator+=(const CompileTime& other) {
        spent += other.spent;
        cold += other.cold;
        return *this;
    }
};

/// Reads and writes the places (positions or displacements) of some particles of a simulation that is one
/// part of a larger body (layout/decomposition.h). Springs join these particles to the part beside it. Places
/// stay in the backend's number format, so nothing is rounded on the way. What one border has read another
/// one can write, if both backends have the same options.
class Border {
public:
    Border() = default;
    Border(const Border&) = delete;
    Border& operator=(const Border&) = delete;
    virtual ~Border() = default;

    virtual std::size_t bytes() const = 0;
    /// Reads the places after the steps enqueued so far, and waits for these steps.
    virtual void read(std::byte* to) const = 0;
    /// Puts the particles, which are pinned, at these places from the next step on.
    virtual void write(const std::byte* from) = 0;
};

/// What a part of a body shares with a part beside it. `sent`: particles of this part that are ghosts in the
/// other. `received`: ghosts in this part that the other part steps. Both lists ascend.
struct SharedParticles {
    int part;  ///< the number of the part beside this one
    std::vector<std::uint32_t> sent, received;
};

/// The borders of one part of a body with the parts beside it. All parts are on devices of this process.
/// Borders travel from device to device, and the host does not wait for them.
///
/// Most borders travel between steps. If they travel within steps (steps_per_call()), each step of a part
/// uses what the same step of the parts beside it sent, no matter how many steps one call of step() makes.
///
/// Each part is stepped by one thread, which steps no other part. A part calls its n-th receive() after the
/// parts beside it have returned from their n-th send(). They call send() n + 2 after that receive() has
/// returned. Either side may be destroyed first.
class DeviceBorders {
public:
    DeviceBorders() = default;
    DeviceBorders(const DeviceBorders&) = delete;
    DeviceBorders& operator=(const DeviceBorders&) = delete;
    virtual ~DeviceBorders() = default;

    /// Bytes that this part sends in a step.
    virtual std::size_t bytes() const = 0;
    /// Connects the parts. To be called once before all else, in the thread of every part, with the borders
    /// of all parts of the body in their order; `parts[part]` is this object. All backends have the same
    /// options. Throws Unavailable, with the reason, if the devices cannot reach each other in this way.
    virtual void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) = 0;
    /// Takes over connections that are slow to make from `before`, the borders of the same part until the
    /// latest upload. To be called before connect(), for all parts or for none.
    virtual void take_over(DeviceBorders& before) { static_cast<void>(before); }
    /// Ends what connect() began and what all parts have to end together. To be called at the end of a run
    /// without failure, in the thread of every part, while all parts still exist. The destructor aborts what
    /// was not ended in this way, and waits for no other part.
    virtual void disconnect() {}
    /// How many steps a call of Backend::step() may take if borders travel within steps; 0: borders travel
    /// between steps. If they travel within steps, every part must be ready to call step() before any part
    /// calls it, and must have called it before any part asks for anything else. Until then a device that
    /// several parts share may wait for one of these parts, and everything that waits for this device waits
    /// too.
    virtual int steps_per_call() const { return 0; }
    /// Whether the devices wait for each other, so that the parts may call send() and receive() in any order:
    /// BorderFacet::step_and_exchange() then needs no messages between the hosts.
    virtual bool waits_on_device() const { return false; }
    /// Enqueues the transfer of the places, after the steps enqueued so far, to the parts beside this one. If
    /// borders travel within steps, this and receive() do nothing.
    virtual void send() = 0;
    /// Enqueues the arrival: from the next step on ghosts are where the parts beside this one sent them.
    virtual void receive() = 0;
};

/// Shows a running simulation: the device itself puts the displacements of some particles into an OpenGL
/// buffer, and nothing passes through the host.
class Feed {
public:
    Feed() = default;
    Feed(const Feed&) = delete;
    Feed& operator=(const Feed&) = delete;
    virtual ~Feed() = default;

    /// Fills the buffer, whose context is current, with the particles' displacements after the steps enqueued
    /// so far, and waits until it is full. Another context may be current afterwards. The feed is destroyed
    /// while the buffer's context is current.
    virtual void write() = 0;
};

/// Displacements of some particles, as for Feed, which the device itself puts into host memory.
class HostFeed {
public:
    HostFeed() = default;
    HostFeed(const HostFeed&) = delete;
    HostFeed& operator=(const HostFeed&) = delete;
    virtual ~HostFeed() = default;

    /// Waits for the steps enqueued so far and returns x, y, z and 0 of each particle. The values are valid
    /// until the next call.
    virtual std::span<const glm::vec4> read() = 0;
};

/// Displacements of some particles, as for Feed, which the device writes into its own memory. They pass
/// through no host.
class DeviceFeed {
public:
    DeviceFeed() = default;
    DeviceFeed(const DeviceFeed&) = delete;
    DeviceFeed& operator=(const DeviceFeed&) = delete;
    virtual ~DeviceFeed() = default;

    /// Waits for the steps enqueued so far and returns the device address of x, y, z and 0 of each particle
    /// in float32. Each call writes to the same address.
    virtual const void* read() = 0;
    virtual int device() const = 0;  ///< the device's number in CUDA
};

/// The borders of a simulation that is one part of a larger body. Each is to be used until the next upload().
class BorderFacet {
public:
    /// The places of `particles`, which ascend. The result is null if Capabilities::has_borders is not set.
    /// Throws Unavailable, with the reason, if the backend cannot step a part with this border.
    virtual std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) = 0;
    /// The borders with other parts, in ascending order of these. `way` is one of Capabilities::border_ways.
    /// Throws Unavailable, with the reason, if there is no such way here, and whatever border() throws.
    virtual std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& /*borders*/,
                                                          const std::string& /*way*/) {
        return nullptr;
    }

    /// Whether step_and_exchange() can make the next `count` steps with `borders`, which are the latest of
    /// device_borders(). The answer is the same for all parts of a body. Does everything that
    /// step_and_exchange() must not do while a device waits for another part: it allocates memory and loads
    /// kernels.
    virtual bool prepare_exchanges(DeviceBorders& /*borders*/, int /*count*/) { return false; }
    /// Enqueues `count` steps, each followed by borders.send() and borders.receive(), without waiting for the
    /// hosts of other parts. Every part must have called prepare_exchanges() before any part calls this, and
    /// must have returned from this before any part asks for anything else.
    virtual void step_and_exchange(DeviceBorders& /*borders*/, int /*count*/) {}

protected:
    ~BorderFacet() = default;
};

/// Shows a simulation while it runs. Each feed is to be used until the next upload(). Without feeds the
/// caller uses download(), which brings the whole state.
class FeedFacet {
public:
    /// An object that fills the OpenGL buffer `buffer` with the displacements of `particles`: x, y, z and 0
    /// in float32, 16 bytes each, in their order. The buffer's context is current. The result is null if the
    /// backend cannot.
    virtual std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& /*particles*/,
                                       std::uint32_t /*buffer*/) {
        return nullptr;
    }
    /// An object that brings the displacements of `particles` to the host, in their order. The result is null
    /// if the backend cannot.
    virtual std::unique_ptr<HostFeed> host_feed(const std::vector<std::uint32_t>& /*particles*/) {
        return nullptr;
    }
    /// An object that writes the displacements of `particles` to CUDA's memory, in their order. The result is
    /// null if the backend is not CUDA's or cannot.
    virtual std::unique_ptr<DeviceFeed> device_feed(const std::vector<std::uint32_t>& /*particles*/) {
        return nullptr;
    }

protected:
    ~FeedFacet() = default;
};

/// The tool of a problem that has one.
class ToolFacet {
public:
    /// Enqueues a move of the tool between the steps before and the steps after: from here on it has moved by
    /// `displacement` (a length) since it took hold. upload() and rewind() put it back to where it took hold.
    virtual void move_tool(const glm::dvec3& displacement) = 0;
    /// Synchronizes and returns the force on the tool in the latest step: minus the sum of its forces on the
    /// particles that it holds (Problem::tool), each in the backend's precision, added in float64 and in
    /// their order. Zero before the first step.
    virtual glm::dvec3 tool_force() = 0;

protected:
    ~ToolFacet() = default;
};

/// How fast a step could be on the backend's device (limits.h).
class LimitsFacet {
public:
    /// Measures what the device can do at best, in about a second. To be called before the first upload().
    virtual DeviceLimits measure_limits() = 0;
    /// Measures DeviceLimits::launch_seconds in this very process, if it differs from process to process;
    /// otherwise the result is empty. To be called before the first upload(), or as the last call of all: it
    /// leaves the device in a state that no step expects.
    virtual std::optional<double> own_launch_seconds() { return std::nullopt; }
    /// The least work of a step of `problem`. Cheap, and touches no device.
    virtual StepWork step_work(const Problem& problem) const = 0;

protected:
    ~LimitsFacet() = default;
};

/// A backend's optional abilities, beyond the contract that every backend fulfils (class Backend).
class Facets {
public:
    virtual ~Facets() = default;

    /// Null: the backend does not have this facet.
    virtual BorderFacet* borders() { return nullptr; }
    virtual FeedFacet* feeds() { return nullptr; }
    /// Without this facet the backend refuses problems with a tool.
    virtual ToolFacet* tool() { return nullptr; }
    /// Without this facet, result rows do not say how fast the device could be.
    virtual LimitsFacet* limits() { return nullptr; }

    /// Keeps a copy of the state on the device for rewind(). To be called right after upload(); valid until
    /// the next one. Returns false if this backend keeps no copy or has no room for it.
    virtual bool keep_start() { return false; }
    /// Returns to step 0, to the state that upload() left and keep_start() kept, and to the problem without
    /// the edits made since. Every step gives the bits that it would give after another upload().
    virtual void rewind() {}

    /// A hash of the state. Two runs of this object with the same number of steps give the same text if their
    /// states have the same bits, otherwise different texts but for a collision. Far quicker than download()
    /// of a large body. Empty: the backend has none.
    virtual std::string state_fingerprint() { return {}; }

    /// Makes the device check the state while it steps, from the next upload() or rewind() on. A check
    /// changes no bit of the state. Until the first call nothing is checked.
    virtual void monitor(const DivergenceMonitor&) {}
    /// When the run since upload() left the monitor's limits; empty if it has not. Synchronizes.
    virtual std::optional<Divergence> divergence() { return std::nullopt; }

    /// Makes one step and counts what it did, if there is something to count.
    virtual WorkCount count_work() { return {}; }
    /// The time to compile code for the problem of the last upload().
    virtual CompileTime compile_time() const { return {}; }
    /// What the last upload() chose by itself: every parameter with the value "auto", and what that means for
    /// the problem.
    virtual std::optional<Choice> choice() const { return std::nullopt; }
};

}  // namespace voxspring
