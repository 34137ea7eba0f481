// The host's code for the compute shaders in shaders/, for OpenGL and Vulkan: the state in arrays, steps,
// edits of particles' bits, the tool and the divergence monitor. device.h is the interface of the device.
// implicit.cpp and explicit.cpp add the two ways in which particles find their neighbours.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "backends/glsl/compute.h"
#include "backends/glsl/device.h"

namespace voxspring::glsl {

/// A backend that steps on a Device (device.h).
class OnDevice : public Backend {
public:
    virtual Device& device() = 0;
};

template <class Real>
class ComputeBackend : public OnDevice, public FeedFacet, public LimitsFacet, public ToolFacet {
public:
    ~ComputeBackend() override { device_->abandon(); }
    Device& device() final { return *device_; }

    Capabilities capabilities() const final { return device_->capabilities(); }
    std::string unsupported(const Problem& problem) const final;
    void upload(const Problem& problem, const State& state) final;
    bool keep_start() final;
    void rewind() final;
    void edit(const Problem& edited, const SpringEdit& edit) final;
    void step(int count) final;
    void synchronize() final;
    State download() final;
    std::string state_fingerprint() final;
    void monitor(const DivergenceMonitor& monitor) final { next_monitor_ = monitor; }
    std::optional<Divergence> divergence() final;
    /// Counts "work_groups", and "compute_shader_invocations" if the driver counts them.
    WorkCount count_work() final;
    CompileTime compile_time() const final { return compile_time_; }

    FeedFacet* feeds() final { return device_->has_feeds() ? this : nullptr; }
    std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& particles, std::uint32_t buffer) final;
    ToolFacet* tool() final { return this; }
    void move_tool(const glm::dvec3& displacement) final;
    glm::dvec3 tool_force() final;
    LimitsFacet* limits() final { return this; }
    DeviceLimits measure_limits() final;
    std::optional<double> own_launch_seconds() final;

protected:
    /// Where the particles of a problem lie, and what a step dispatches.
    struct Layout {
        layout::Placement placement;
        std::vector<std::uint32_t> bits;  ///< per particle: the bits in its word (neighbours.h)
        glm::ivec3 groups{0};             ///< work groups of a step, along each axis
    };

    /// `group`: extents of the step's work groups.
    ComputeBackend(const Options& options, std::unique_ptr<Device> device, glm::ivec3 group)
        : options_(options), group_(group), device_(std::move(device)) {}

    const Options& options() const { return options_; }
    Formulation formulation() const { return options_.formulation; }
    /// Whether terms=all: all terms are compiled in, with neutral values for those that the problem lacks.
    bool all_terms() const { return options_.tuning.at("terms") == "all"; }
    const Device& device() const { return *device_; }

    /// Bytes of device memory that upload() takes (BackendEntry::bytes).
    virtual std::uint64_t bytes_needed(const Problem& problem) const = 0;
    /// An empty string, or why a problem cannot be run. Does not check whether its words fit into an array.
    virtual std::string refused_layout(const Problem& problem) const = 0;
    virtual layout::Placement place(const Problem& problem) const = 0;
    /// Returns where particles lie, and uploads what the step's shader reads besides the buffers of
    /// shaders/compute.glsl. No step may be running.
    virtual Layout lay_out(const Problem& problem) = 0;
    /// The step's shader, with values for only those of its constants that are not in shaders/terms.glsl.
    /// Called after lay_out().
    virtual Shader shader(const Problem& problem) const = 0;
    virtual void set_uniforms(Uniforms& uniforms, const Problem& problem) = 0;
    virtual void enqueue_edit(const Problem& edited, const SpringEdit& edit) = 0;

    /// Uploads `values` to an array of the derived class's shader. `binding` is at least first_own_binding.
    template <class T>
    void put_own(unsigned binding, const std::vector<T>& values) {
        addressed_.erase(binding);
        put(own_[binding], std::as_bytes(std::span(values)));
    }
    /// Uploads a list of `slots` slots, which shaders reach by the address of each slot.
    template <class T>
    void put_addressed(unsigned binding, const std::vector<T>& values, std::size_t slots) {
        addressed_.erase(binding);  // frees the old list first
        own_[binding] = nullptr;
        AddressedList& list = addressed_[binding] =
            device_->make_addressed(std::as_bytes(std::span(values)), slots);
        put(own_[binding], std::as_bytes(std::span(list.addresses)));
    }
    const Array* own(unsigned binding) { return own_[binding].get(); }
    /// The arrays that together hold the list with this binding.
    std::vector<const Array*> parts_of(unsigned binding);
    /// Waits for everything enqueued, then makes all lists of the edited problem anew. The particles keep
    /// their places in memory.
    void lay_out_anew();
    /// Writes new bits of particles to the current words. Every step copies the bits from the words that it
    /// reads.
    void write_bits(std::span<const std::uint32_t> particles, std::span<const std::uint32_t> bits);
    /// Replaces squares of rest lengths by rest lengths as the device measures them (physics/inverse_root.h):
    /// `count` elements of the array, the first at `offset`, each `stride` after the one before. Waits until
    /// they are measured.
    void measure(const Array& squares, std::size_t count, int stride, int offset);
    /// Like measure(), for numbers in the host's memory.
    void measure_numbers(std::span<Real> squares);

private:
    void put(std::unique_ptr<Array>& array, std::span<const std::byte> values);
    void upload_state(const Problem& problem, const State& state);
    void make_step();
    void make_tool();
    /// Tells the device which dispatches later steps consist of.
    void tell_steps();
    Dispatches make_check();
    Uniforms tool_uniforms(const glm::dvec3& moved) const;
    void reset_to_step_zero();
    Arrays arrays(std::size_t current) const;
    void mark(Backend::Mark which) final;
    double seconds_between_marks() const final;
    /// The arrays that steps write and later steps read.
    std::array<std::unique_ptr<Array>*, 6> state_arrays() {
        return {&words_[0], &words_[1], &low_[0], &low_[1], &increment_, &increment_low_};
    }

    const Options options_;
    const glm::ivec3 group_;
    std::unique_ptr<Device> device_;  // outlives the arrays
    std::array<std::unique_ptr<Array>, 2> words_, low_;
    std::unique_ptr<Array> increment_, increment_low_, load_, inverse_mass_;
    std::unique_ptr<Array> held_, forces_;  // of the particles that the tool holds; null if there is no tool
    std::unique_ptr<Array> found_;          // number of the first check for divergence that failed
    std::map<unsigned, std::unique_ptr<Array>> own_;
    std::map<unsigned, AddressedList> addressed_;       // the lists whose addresses are in own_
    std::array<std::unique_ptr<Array>, 6> start_;       // for rewind(): copies of state_arrays() at step 0
    std::array<std::shared_ptr<Pass>, 2> step_, tool_;  // index: which of words_ they read

    const Problem* problem_ = nullptr;
    Layout layout_;
    std::uint64_t held_bytes_ = 0;  // bytes_needed() of the problem for which the lists were made
    CompileTime compile_time_;
    DivergenceMonitor monitor_;       // in use since the latest upload() or rewind()
    DivergenceMonitor next_monitor_;  // in use from the next upload() or rewind() on
};
extern template class ComputeBackend<float>;
extern template class ComputeBackend<double>;

/// Backends with implicit addressing (shaders/compute_implicit.comp) and with explicit addressing
/// (shaders/compute_explicit.comp).
std::unique_ptr<Backend> make_implicit(const Options& options, std::unique_ptr<Device> device);
std::unique_ptr<Backend> make_explicit(const Options& options, std::unique_ptr<Device> device);

}  // namespace voxspring::glsl
