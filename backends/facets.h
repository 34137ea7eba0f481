// Abilities that only some backends have; backend.h has those of every backend. A facet is the interface of
// one such ability. Class Facets returns a pointer to each facet, or null if the backend does not have it.
// The other functions of Facets do nothing by default.
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

/// The base of interfaces: their objects are neither copied nor moved.
class Interface {
public:
    Interface() = default;
    Interface(const Interface&) = delete;
    Interface& operator=(const Interface&) = delete;
    virtual ~Interface() = default;
};

/// The limits that a run has to stay within, and how often this is checked.
struct DivergenceMonitor {
    /// The farthest that a particle may move in one step: |x(t) - x(t - dt)|, in units of length.
    double largest_increment = 0;
    /// A check is due whenever the number of steps is a multiple of this; 0: never. Where a check at that
    /// step would cost time, a backend makes it later and counts this number of steps from there on.
    int every = 0;
};

/// When a run left the limits of its DivergenceMonitor: after step `last_good` and no later than step
/// `found`, where a check first found a particle not finite or too fast. Steps count from upload() or
/// rewind().
struct Divergence {
    std::int64_t last_good = 0;
    std::int64_t found = 0;
};

/// Counts of what one step did, by name: values of hardware counters ("samples_passed"), how many work groups
/// were dispatched, or how many of a lattice's tiles were stepped. They show whether skipped work is really
/// skipped.
using WorkCount = std::map<std::string, std::uint64_t>;

/// Values of tuning parameters that a backend chose for a problem.
struct Choice {
    std::string tuning;                                 ///< "interior=vote,registers=64"
    std::optional<double> step_seconds = std::nullopt;  ///< predicted seconds per step; empty: not predicted
};

/// Seconds that compiling code for a problem takes.
struct CompileTime {
    double spent = 0;  ///< in this upload and later edits; 0 for code that is still loaded
    /// Without a disk cache: code that was found in the cache counts with the time that compiling it took.
    double cold = 0;
    CompileTime& operator+=(const CompileTime& other) {
        spent += other.spent;
        cold += other.cold;
        return *this;
    }
};

/// Reads and writes the places (positions or displacements) of some particles of a simulation that is one
/// part of a larger body (layout/decomposition.h). Springs join these particles to a neighbouring part.
/// Places stay in the backend's number format, so nothing is rounded on the way. A border can write what
/// another one has read, if both belong to the same kind of backend with the same options.
class Border : public Interface {
public:
    virtual std::size_t bytes() const = 0;
    /// Waits for the steps enqueued so far, then copies the places, bytes() bytes, to `to`.
    virtual void read(std::byte* to) const = 0;
    /// From the next step on the particles, which are pinned, are at the places in `from`.
    virtual void write(const std::byte* from) = 0;
};

/// The particles that a part of a body shares with a neighbouring part. `sent`: particles that this part
/// steps and that are ghosts in the neighbour (Problem::ghosts). `received`: ghosts of this part, which the
/// neighbour steps. Both lists ascend.
struct SharedParticles {
    int part;  ///< the number of the neighbouring part
    std::vector<std::uint32_t> sent, received;
};

/// Exchanges the borders of one part of a body with the neighbouring parts. All parts are on devices of this
/// process. Borders travel from device to device, and the host does not wait for them.
///
/// Most backends exchange borders between steps. If borders travel within steps (steps_per_call()), a step of
/// a part uses what the same step of the neighbours sent, however many steps one call of step() makes.
///
/// Each part is stepped by one thread, which steps no other part. Unless waits_on_device(), the callers keep
/// this order: a part makes its n-th call of receive() after its neighbours have returned from their n-th
/// call of send(). The neighbours' call n + 2 of send() comes only after that receive() has returned. Parts
/// may be destroyed in any order.
class DeviceBorders : public Interface {
public:
    /// Bytes that this part sends per step.
    virtual std::size_t bytes() const = 0;
    /// Connects the parts. To be called once before any exchange, in the thread of every part. `parts` has
    /// the borders of all parts of the body, by number; `parts[part]` is this object. All backends have the
    /// same options. Throws Unavailable, with the reason, if the devices cannot reach each other in this way.
    virtual void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) = 0;
    /// Takes over those connections of `before` that are slow to make. `before` is this part's object from
    /// before the latest upload. To be called before connect(), for all parts or for none.
    virtual void take_over(DeviceBorders& before) { static_cast<void>(before); }
    /// Closes those connections that all parts have to close together. To be called at the end of a run
    /// without failure, in the thread of every part, while all parts still exist. The destructor aborts
    /// connections that are still open, and waits for no other part.
    virtual void disconnect() {}
    /// The most steps that a call of Backend::step() may make if borders travel within steps; 0: borders
    /// travel between steps. If they travel within steps, every part must be ready to call step() before any
    /// part calls it. Every part must have called step() before any part calls anything else. Until then a
    /// device that several parts share may be waiting for a part, and another call would wait for that
    /// device.
    virtual int steps_per_call() const { return 0; }
    /// Whether the devices wait for each other, so that the parts may call send() and receive() in any order:
    /// BorderFacet::step_and_exchange() then needs no messages between the hosts.
    virtual bool waits_on_device() const { return false; }
    /// Enqueues the transfer of places to the neighbouring parts, after the steps enqueued so far. If borders
    /// travel within steps, send() and receive() do nothing.
    virtual void send() = 0;
    /// Enqueues the arrival of what the neighbours sent: from the next step on, ghosts are at these places.
    virtual void receive() = 0;
};

/// Shows a running simulation: the device itself puts the displacements of some particles into an OpenGL
/// buffer, and nothing passes through the host.
class Feed : public Interface {
public:
    /// Fills the buffer, whose context must be current, with the particles' displacements after the steps
    /// enqueued so far, and waits until it is full. Another context may be current afterwards. The feed must
    /// be destroyed while the buffer's context is current.
    virtual void write() = 0;
};

/// Like Feed, but the device puts the displacements into host memory.
class HostFeed : public Interface {
public:
    /// Waits for the steps enqueued so far and returns each particle's displacement as (x, y, z, 0). The
    /// values are valid until the next call.
    virtual std::span<const glm::vec4> read() = 0;
};

/// Like Feed, but the device puts the displacements into its own memory. They do not pass through the host.
class DeviceFeed : public Interface {
public:
    /// Waits for the steps enqueued so far and returns the device address of the displacements: (x, y, z, 0)
    /// in float32 for each particle. Each call writes to the same address.
    virtual const void* read() = 0;
    virtual int device() const = 0;  ///< the device's number in CUDA
};

/// Makes the borders of a simulation of one part of a larger body. They are valid until the next upload().
class BorderFacet {
public:
    /// A border of `particles`, which ascend. Null if Capabilities::has_borders is not set. Throws
    /// Unavailable, with the reason, if the backend cannot step a part with this border.
    virtual std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) = 0;
    /// The borders with the parts that `borders` lists, in ascending order. `way` is one of
    /// Capabilities::border_ways. Throws Unavailable, with the reason, if that way does not work here or
    /// border() would throw.
    virtual std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& /*borders*/,
                                                          const std::string& /*way*/) {
        return nullptr;
    }

    /// Whether step_and_exchange() can make the next `count` steps with `borders`, the latest result of
    /// device_borders(). The answer is the same for all parts of a body. Also allocates memory and loads
    /// kernels, which step_and_exchange() must not do while a device waits for another part.
    virtual bool prepare_exchanges(DeviceBorders& /*borders*/, int /*count*/) { return false; }
    /// Enqueues `count` steps, each followed by borders.send() and borders.receive(), without waiting for the
    /// hosts of other parts. Every part must have called prepare_exchanges() before any part calls this
    /// function. Every part must have returned from it before any part calls anything else.
    virtual void step_and_exchange(DeviceBorders& /*borders*/, int /*count*/) {}

protected:
    ~BorderFacet() = default;
};

/// Shows a simulation while it runs. A feed is valid until the next upload(). If a backend has no feeds,
/// callers use download(), which brings the whole state.
class FeedFacet {
public:
    /// A feed that fills the OpenGL buffer `buffer` with the displacements of `particles`, in that order: x,
    /// y, z and 0 in float32, 16 bytes per particle. The buffer's context must be current. Null if the
    /// backend cannot do this.
    virtual std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& /*particles*/,
                                       std::uint32_t /*buffer*/) {
        return nullptr;
    }
    /// A feed that brings the displacements of `particles`, in that order, to the host. Null if the backend
    /// cannot do this.
    virtual std::unique_ptr<HostFeed> host_feed(const std::vector<std::uint32_t>& /*particles*/) {
        return nullptr;
    }
    /// A feed that writes the displacements of `particles`, in that order, to CUDA's memory. Null if the
    /// backend is not one of CUDA's, or cannot do this.
    virtual std::unique_ptr<DeviceFeed> device_feed(const std::vector<std::uint32_t>& /*particles*/) {
        return nullptr;
    }

protected:
    ~FeedFacet() = default;
};

/// Moves the tool of a problem (Problem::tool), which pulls the particles that it holds by springs, and tells
/// the force on it.
class ToolFacet {
public:
    /// Enqueues a move of the tool. In steps enqueued later, the tool is `displacement`, in units of length,
    /// away from where it was when it took hold of its particles. upload() and rewind() put it back there.
    virtual void move_tool(const glm::dvec3& displacement) = 0;
    /// Synchronizes and returns the force on the tool in the latest step: minus the sum of its forces on the
    /// particles that it holds. Each force is computed in the backend's precision. The forces are added in
    /// float64, in the order of Tool::particles. Zero before the first step.
    virtual glm::dvec3 tool_force() = 0;

protected:
    ~ToolFacet() = default;
};

/// How fast a step could be on the backend's device (limits.h).
class LimitsFacet {
public:
    /// Measures what the device can do at best. Takes about a second. To be called before the first upload().
    virtual DeviceLimits measure_limits() = 0;
    /// Measures DeviceLimits::launch_seconds in this process. Empty if that time is the same in every
    /// process. To be called before the first upload(), or as the last call of all, since no step is possible
    /// afterwards.
    virtual std::optional<double> own_launch_seconds() { return std::nullopt; }
    /// The least work of a step of `problem`. Cheap, and touches no device.
    virtual StepWork step_work(const Problem& problem) const = 0;

protected:
    ~LimitsFacet() = default;
};

/// A backend's optional abilities, beyond the contract that every backend fulfils (class Backend).
class Facets : public Interface {
public:
    /// Each of these functions returns null if the backend does not have the facet.
    virtual BorderFacet* borders() { return nullptr; }
    virtual FeedFacet* feeds() { return nullptr; }
    /// Without this facet the backend refuses problems with a tool.
    virtual ToolFacet* tool() { return nullptr; }
    /// Without this facet, result rows do not say how fast the device could be.
    virtual LimitsFacet* limits() { return nullptr; }

    /// Keeps a copy of the state on the device for rewind(). To be called right after upload(); the copy is
    /// valid until the next upload(). Returns false if this backend keeps no copy or has no room for it.
    virtual bool keep_start() { return false; }
    /// Returns to step 0 and to the state that keep_start() kept. Edits are not undone: the caller has to
    /// undo them by further edits first, so that the springs are those of the uploaded problem. Every step
    /// gives the bits that it would give after another upload().
    virtual void rewind() {}

    /// A hash of the state. After equally many steps, two runs of this object have equal hashes if their
    /// states have the same bits, and almost certainly different ones if not. Far quicker than download() of
    /// a large body. Empty: the backend has no such hash.
    virtual std::string state_fingerprint() { return {}; }

    /// Makes the device check the state while it steps, from the next upload() or rewind() on. A check
    /// changes no bit of the state. Until the first call nothing is checked.
    virtual void monitor(const DivergenceMonitor&) {}
    /// Between which steps the run left the limits that monitor() set. Empty if no check found a violation.
    /// Synchronizes.
    virtual std::optional<Divergence> divergence() { return std::nullopt; }

    /// Makes one step and counts what it did. If the backend counts nothing, it makes no step, and the result
    /// is empty.
    virtual WorkCount count_work() { return {}; }
    /// The time to compile code for the problem of the last upload(); 0 if the backend does not measure it.
    virtual CompileTime compile_time() const { return {}; }
    /// The values that the last upload() chose for all tuning parameters whose value is "auto". Empty if
    /// there are none.
    virtual std::optional<Choice> choice() const { return std::nullopt; }
};

}  // namespace voxspring
