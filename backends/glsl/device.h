// What the host code of the compute shaders in shaders/ (compute_backend.h) needs from a device. OpenGL and
// Vulkan implement it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "backends/backend.h"
#include "backends/glsl/terms.h"
#include "backends/glsl/uniforms.h"
#include "backends/layout/records/feed.h"

namespace voxspring::glsl {

/// The limits of a device for a work group.
struct WorkGroupLimits {
    std::uint64_t invocations = 0;
    glm::uvec3 extents{0};
    std::size_t shared_bytes = 0;
};

/// The limits of a device for an array that shaders read and write.
struct BufferLimits {
    std::uint64_t max_bytes = 0;
    std::string limit = {};      ///< the API's name for this limit
    bool has_addresses = false;  ///< shaders can reach arrays by their addresses

    /// An empty string, or why one array cannot have `bytes` bytes. The reason calls the array `what`.
    std::string too_large(const std::string& what, std::uint64_t bytes) const;
};

/// An array of a fixed size in the device's memory.
class Array {
public:
    virtual ~Array() = default;
    std::size_t bytes() const { return bytes_; }

protected:
    explicit Array(std::size_t bytes) : bytes_(bytes) {}

private:
    std::size_t bytes_;
};
inline std::size_t bytes_of(const std::unique_ptr<Array>& array) {
    return array != nullptr ? array->bytes() : 0;
}
/// Arrays by binding. An array is null or absent if the shader has no use for it.
using Arrays = std::map<unsigned, const Array*>;

/// A list of shaders/lists.glsl, slot by slot (a slot has one element per particle), in one or more arrays.
struct AddressedList {
    std::vector<std::unique_ptr<Array>> parts;  ///< each has whole slots
    std::vector<std::uint64_t> addresses;       ///< device address of each slot
};

/// A shader of shaders/.
struct Shader {
    std::string file;                      ///< file name without extension
    std::string variant = {};              ///< what follows `file` in the name of its SPIR-V module
    Defines macros = {};                   ///< the macros of this variant, if it is compiled at run time
    Constants constants = {};              ///< constants that the shader does not have are ignored
    std::optional<glm::ivec3> group{};     ///< extents of a work group, if the shader leaves them open
    std::optional<Precision> precision{};  ///< empty: the backend's
};

/// Keeps compiled programs by a key that tells how they are specialised, since an edit may need an earlier
/// program again.
template <class Program>
class ProgramCache {
public:
    /// The program with this key. If the result is null, the caller has to make the program and assign it to
    /// the result.
    std::shared_ptr<const Program>& of(const std::string& key) {
        constexpr std::size_t max_programs = 16;
        if (programs_.size() == max_programs && !programs_.contains(key)) programs_.clear();
        return programs_[key];
    }

private:
    std::map<std::string, std::shared_ptr<const Program>> programs_;
};

/// A shader, specialised, with its uniforms and arrays.
class Pass {
public:
    virtual ~Pass() = default;
};

struct Dispatch {
    std::shared_ptr<Pass> pass;
    glm::uvec3 groups{1};
};

/// The dispatches of a step in their order. The index says which of the two arrays of words the step reads.
using Dispatches = std::array<std::vector<Dispatch>, 2>;

/// A device with one queue, in which everything happens in the order of the calls. Whatever one dispatch or
/// copy writes, the next one sees. Arrays and passes must exist until what is enqueued with them has run.
/// They must be destroyed before the device.
class Device : public Interface {
public:
    virtual const Capabilities& capabilities() const = 0;
    virtual WorkGroupLimits work_group_limits() const = 0;
    virtual const BufferLimits& buffer_limits() const = 0;
    /// Bytes of memory that may still be taken, if the driver tells.
    virtual std::optional<std::uint64_t> free_memory_bytes() const = 0;
    /// Whether subgroups can vote.
    virtual bool can_vote() const { return true; }
    /// An empty string, or why the device cannot fetch this many words in the way that the options ask for.
    virtual std::string refused_words(std::size_t) const { return {}; }

    /// Runs `work`, which uses the device. If the API throws in `work`, this throws a DeviceError that names
    /// `doing`, for example "uploading".
    virtual void use(const char* doing, const std::function<void()>& work) const = 0;
    /// Throws DeviceError if the device has reported an error since the last call.
    virtual void check(const char* doing) const = 0;
    /// Waits for everything enqueued.
    virtual void wait() = 0;
    /// To be called before arrays and passes are destroyed. Drops what was not submitted and waits for the
    /// rest, so that the device no longer uses any of them. Does nothing if the API itself sees to this.
    virtual void abandon() noexcept {}

    /// Makes an array with these values, of which there is at least one byte.
    virtual std::unique_ptr<Array> make(std::span<const std::byte> values) = 0;
    virtual std::unique_ptr<Array> make_zeros(std::size_t bytes) = 0;
    /// Replaces the values of an array.
    virtual void overwrite(Array& array, std::span<const std::byte> values) = 0;
    /// Copies the first values of an array to `values`, once everything enqueued has run.
    virtual void download(const Array& array, std::span<std::byte> values) = 0;
    /// Makes another array with the same values, and waits until it has them.
    virtual std::unique_ptr<Array> copy_of(const Array& array) = 0;
    virtual void copy(const Array& from, Array& to) = 0;
    /// A list in arrays that shaders reach by the addresses of its slots, if BufferLimits::has_addresses.
    virtual AddressedList make_addressed(std::span<const std::byte> /*values*/, std::size_t /*slots*/) {
        return {};
    }

    /// Makes a pass of `shader` with these values. `arrays` must outlive the pass.
    virtual std::shared_ptr<Pass> pass(const Shader& shader, const Uniforms& uniforms,
                                       const Arrays& arrays) = 0;
    /// Sets other values of the uniforms, for what is enqueued from here on.
    virtual void set(Pass& pass, const Uniforms& uniforms) = 0;
    /// Enqueues work groups of 64 invocations that stride over `count` items. `sent`: the values of further
    /// arrays, by binding, which exist only for this dispatch.
    virtual void dispatch_once(const Shader& shader, std::size_t count, const Uniforms& uniforms,
                               const Arrays& arrays,
                               const std::map<unsigned, std::span<const std::byte>>& sent) = 0;

    /// Whether a check for divergence is recorded once and replayed, so that the device has to count the
    /// checks (shaders/next_check.comp). Otherwise the uniform `check_number` is set before each check.
    virtual bool records_checks() const = 0;
    /// Sets the dispatches that later steps consist of.
    virtual void step_by(Dispatches step) = 0;
    /// Begins to count steps anew. The next step reads the first of the two arrays of words. From here on the
    /// state is checked after every multiple of `every` steps; 0: never.
    void reset_to_step_zero(Dispatches check, int every) {
        steps_ = 0;
        current_ = 0;
        check_every_ = every;
        check_by(std::move(check));
    }
    /// Forgets the measured time of steps. Called before a body of another size is stepped.
    virtual void forget_pace() {}
    virtual void step(int count) = 0;
    /// Makes one step. Returns how many invocations its shaders had; empty if the driver cannot count them.
    virtual std::optional<std::uint64_t> step_counted() = 0;
    std::int64_t steps() const { return steps_; }
    /// Which of the two arrays of words the next step reads.
    std::size_t current() const { return current_; }

    /// The time spent on compiling shaders since the latest call of this function.
    CompileTime take_compile_time() { return std::exchange(compile_time_, {}); }

    /// Seconds, on the host's clock, that `count` dispatches take: those of `cycle`, again and again. All
    /// passes of `cycle` have the same shader.
    virtual double seconds_of(const std::vector<Dispatch>& cycle, int count) = 0;
    virtual bool has_float64() const = 0;
    /// Whether the time of a launch differs from process to process.
    virtual bool launches_differ() const { return false; }

    virtual void mark(bool at_end) = 0;
    virtual double seconds_between_marks() const = 0;

    /// Whether feed() may return an object.
    virtual bool has_feeds() const { return false; }
    /// Does the work of FeedFacet::feed(). `state`: the arrays that the shader reads, indexed by current().
    virtual std::unique_ptr<Feed> feed(const std::vector<layout::FedWord<float>>& /*fed*/,
                                       std::uint32_t /*buffer*/, const Defines& /*macros*/,
                                       const std::array<Arrays, 2>& /*state*/) {
        return nullptr;
    }

protected:
    virtual void check_by(Dispatches check) = 0;
    void count_steps(int count) {
        steps_ += count;
        current_ = (current_ + std::size_t(count)) % 2;
    }
    int check_every() const { return check_every_; }
    /// Whether a check is due after the steps so far.
    bool is_check_due() const { return check_every_ > 0 && steps_ % check_every_ == 0; }
    CompileTime compile_time_;

private:
    int check_every_ = 0;
    std::int64_t steps_ = 0;
    std::size_t current_ = 0;
};

}  // namespace voxspring::glsl
