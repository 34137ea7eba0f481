// The base of the backends that step by drawing (Mosegaard and Sorensen 2005): particles in texels, one
// fragment per particle and step, ping-pong over frames, and the stencil buffer as mask.
//
// A frame is the output of one step: one texture or several of the same size, its targets. x is a particle's
// position, u its displacement and v its increment. By formulation:
//
//     paper, position   three frames of x
//     displacement      three frames of u
//     increment         two frames of u and v
//     compensated       two frames of u, v, and the low parts of u and v
//
// Each particle has a texel in each target: a vector in xyz and, in w of the first target, the particle's
// bits, ACTIVE_BIT among them (neighbours.h). Texels without a particle carry NaN and zero bits, so that an
// accidental read shows in the result.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec4.hpp>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "backends/gl/context.h"
#include "backends/gl/handles.h"
#include "backends/gl/program.h"
#include "backends/gl/step_queue.h"
#include "backends/gl/storage_buffer.h"
#include "backends/registry.h"

namespace voxspring::gl {

class FragmentBackend : public Backend, public FeedFacet, public LimitsFacet, public ToolFacet {
public:
    Capabilities capabilities() const final { return context_.capabilities(); }
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
    /// Makes one step and counts "samples_passed" in it, and "fragment_shader_invocations" if the driver can
    /// count them.
    WorkCount count_work() final;

    FeedFacet* feeds() final { return this; }
    std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& particles, std::uint32_t buffer) final;
    LimitsFacet* limits() final { return this; }
    DeviceLimits measure_limits() final;
    std::optional<double> own_launch_seconds() final;
    ToolFacet* tool() final { return this; }
    void move_tool(const glm::dvec3& displacement) final;
    glm::dvec3 tool_force() final;

    std::size_t frame_count() const { return frames_.size(); }
    std::size_t target_count() const { return frames_[0].targets.size(); }
    /// All texels, row by row, of a target of the frame with the state at t - age dt. The oldest frame is the
    /// one that the next step writes.
    std::vector<glm::vec4> texels(std::size_t age, std::size_t target = 0);

protected:
    /// Where in a frame the particles of a problem lie.
    struct Layout {
        glm::ivec2 size{0};                ///< texels of a frame along x and y
        std::vector<std::uint32_t> texel;  ///< per particle: index of its texel, row by row
        std::vector<std::uint32_t> bits;   ///< per particle: what its texel's w holds
    };

    /// New contents of some particles' texels, as shaders/edit.comp reads them.
    struct TexelEdit {
        struct Particle {
            std::uint32_t texel;       ///< x in the lower 16 bits, y in the upper 16
            std::uint32_t bits;        ///< what the texel's w holds
            std::uint32_t begin, end;  ///< range of its neighbours in `neighbour`
        };
        std::vector<Particle> particles;
        std::vector<std::uint32_t> neighbour;  ///< list entries (neighbours.h)
        std::vector<glm::vec2> spring;  ///< as in `spring` of shaders/gl_fragment_explicit.frag, or empty
        std::vector<glm::vec4> off_lattice_rest;  ///< per neighbour; empty if the shader reads none
    };

    /// `fragment_shader`: the name of the file in shaders/.
    FragmentBackend(const Options& options, std::string fragment_shader);

    const Context& context() const { return context_; }
    const Options& options() const { return options_; }
    Formulation formulation() const { return options_.formulation; }
    /// Whether terms=all: all terms are compiled in, with neutral values for those that the problem lacks.
    bool all_terms() const { return options_.tuning.at("terms") == "all"; }

    /// Bytes of device memory that upload() takes (BackendEntry::bytes).
    virtual std::uint64_t bytes_needed(const Problem& problem) const = 0;
    /// An empty string, or why the backend cannot run `problem`, however much memory the device has.
    virtual std::string refused(const Problem& problem) const = 0;
    /// Returns where particles lie. Also creates the textures that the fragment shader reads besides the
    /// state, loads and materials, and binds them to texture units from first_own_unit on.
    virtual Layout lay_out(const Problem& problem) = 0;
    /// Macros that specialise the fragment shader, besides those that all of these backends share
    /// (shaders/terms.glsl, shaders/motion.glsl).
    virtual Defines specialise(const Problem& problem) const = 0;
    virtual void set_uniforms(const Program& program, const Problem& problem) = 0;
    /// Whether the lists have room for `edited`, and specialise() would return the same macros as before.
    virtual bool has_room(const Problem& edited, const SpringEdit& edit) const = 0;
    /// The particles that `edit` touched, in the layout that lay_out() made.
    virtual TexelEdit edited_texels(const Problem& edited, const SpringEdit& edit) const = 0;
    /// Binds the lists to image units 1 to 3 of shaders/edit.comp. Returns the macros for that shader.
    virtual Defines bind_lists() const { return {}; }

    /// The coordinates of a particle's texel, x in the lower 16 bits and y in the upper 16.
    std::uint32_t texel_of(std::uint32_t particle) const {
        const auto width = std::uint32_t(size_.x);
        return texel_[particle] % width | texel_[particle] / width << 16;
    }

    /// Turns squares of rest lengths into rest lengths as the device measures them (physics/inverse_root.h).
    void measure(std::span<float> squares);

    static constexpr GLuint first_own_unit = 6;
    /// The work of a step, including the arithmetic of the springs. A step has one fragment per particle or,
    /// without a stencil mask, `unmasked` fragments in all. Each backend adds the reads of data about
    /// springs.
    StepWork fragment_work(const Problem& problem, std::uint64_t unmasked) const;

private:
    void mark(Mark which) final;
    double seconds_between_marks() const final;
    /// Returns to step 0. From here on the state is checked as the latest call of monitor() says.
    void reset_to_step_zero();
    void enqueue_step();
    void enqueue_tool() const;
    void make_tool(const Problem& problem);
    void check_divergence();

    struct Frame {
        std::vector<Texture> targets;
        Framebuffer framebuffer;
    };

    /// How many frames hold the state at step 0.
    std::size_t start_frames() const { return frames_.size() - 1; }
    void make_frames(const Problem& problem, const State& state, const Layout& layout);
    void make_stencil(const Layout& layout);
    void make_particle_textures(const Problem& problem, const Layout& layout);
    void make_program(const Problem& problem);
    void write(const TexelEdit& edit);
    /// The textures that together hold the state.
    struct StateTextures {
        std::array<GLuint, 4> name{};
        std::size_t count = 0;
    };
    StateTextures state_textures() const;
    /// Binds the textures of the state to the texture units from 0 on.
    void bind_state() const;
    const Frame& frame(std::size_t age) const {
        return frames_[(current_ + frames_.size() - age) % frames_.size()];
    }

    Context context_;
    const Options options_;
    StepQueue queue_;
    Query begin_, end_;
    bool masked_;
    std::string fragment_shader_;

    VertexArray no_vertices_;  // empty; the core profile cannot draw without one
    std::vector<Frame> frames_;
    std::vector<Texture> start_;  ///< for rewind(): copies of the targets that hold step 0
    Texture stencil_;
    Texture load_, material_;
    Program program_;
    std::string fragment_text_;  // the text that program_ was made from
    Program edit_program_;
    Defines edit_defines_;                       // the defines that edit_program_ was made with
    std::array<StorageBuffer, 4> edit_buffers_;  // for shaders/edit.comp, of the latest edit

    StorageBuffer held_, held_forces_;  // of the particles that the tool holds; empty if there is no tool
    // These programs are made when they are first needed, and kept over uploads.
    Program measure_program_, monitor_program_, feed_program_, tool_program_, hash_program_;
    Buffer found_;  // number of the first check for divergence that failed

    const Problem* problem_ = nullptr;
    std::uint64_t held_bytes_ = 0;    // bytes_needed() of the problem for which the lists were made
    std::int64_t steps_ = 0;          // since upload() or rewind()
    DivergenceMonitor monitor_;       // in use since the latest upload() or rewind()
    DivergenceMonitor next_monitor_;  // in use from the next upload() or rewind() on
    glm::ivec2 size_{0};
    std::vector<std::uint32_t> texel_;
    std::size_t current_ = 0;
};

/// The tuning parameters of every FragmentBackend.
std::map<std::string, TuningValues> fragment_tuning();

/// Bytes that FragmentBackend itself uploads, with `texels` texels per frame.
std::uint64_t fragment_bytes(const Problem& problem, const Options& options, std::uint64_t texels);

}  // namespace voxspring::gl
