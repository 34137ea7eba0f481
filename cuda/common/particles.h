// The base class of backends that store particles as words (ParticleRecord): its buffers, borders, feeds and
// tool, and the launch of a step.
#pragma once

#include <algorithm>
#include <array>
#include <initializer_list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backends/layout/particles.h"
#include "backends/layout/rounding.h"
#include "backends/layout/vectors.h"
#include "backends/physics/huge_pages.h"
#include "backends/registry.h"
#include "cuda/common/between_steps.h"
#include "cuda/common/border.h"
#include "cuda/common/cuda_backend.h"
#include "cuda/common/device_borders.h"
#include "cuda/common/edit.h"
#include "cuda/common/feed.h"
#include "cuda/device/kernel.h"
#include "cuda/device/texture.h"
#include "cuda/kernels/tool.h"

namespace voxspring::cuda {

/// How many blocks of `block` threads are needed for `count` threads.
inline unsigned blocks_for(std::size_t count, unsigned block) {
    return unsigned(units_of(count, std::size_t(block)));
}

/// How kernels read positions: one value per type of kernels/fetch.h.
enum class Fetch : std::uint8_t { past_l1, through_l1, texture };
/// `tuned`: the value "cg", "l1" or "texture" of the tuning parameter `fetch`.
Fetch fetch_path(const std::string& tuned);

/// Texels of 16 bytes per word. One texture fetch reads one texel.
template <class Real>
inline constexpr std::size_t texels_per_word = sizeof(ParticleRecord<Real>) / 16;

/// Adds to `own` the tuning parameters that all backends with a KernelFamily have.
inline std::map<std::string, TuningValues> tuning(std::map<std::string, TuningValues> own) {
    // Which terms (damping, loads, pins ...) a kernel has. `needed`: those of the scene. `all`: all of them.
    // Then the kernel tests at run time which the scene has, but always computes damping and gravity.
    own["terms"] = {"needed", "all"};
    return own;
}

/// What the kernels of one backend specification have in common.
struct KernelFamily {
    Precision precision;
    Formulation formulation;
    Fetch fetch;
    bool all_terms;         ///< compile in all terms, and test most of them at run time
    bool dependent_launch;  ///< let a step begin while the previous one still runs
    bool may_be_dependent;  ///< tuning `dependent_launch` is "auto": on if the device can
    bool replays;           ///< replay steps from graphs, unless tuning `graph` is "off"

    explicit KernelFamily(const Options& options, Fetch path);
    /// This family for `device`, which decides about dependent launches if the tuning is "auto".
    KernelFamily on(const Device& device) const;
    /// The source of the kernel in `file` for a scene, for at most `threads` threads per block and at least
    /// `blocks` blocks per SM. `more_terms`: terms to compile in beyond terms_of(problem).
    KernelSource source(const std::string& file, const Problem& problem, int threads, int blocks,
                        std::uint32_t more_terms = 0) const;
};

/// Registers per thread in float32, by formulation, for bodies whose threads do not all run at once.
/// Backends use the numbers that were the fastest on an H200.
struct RegisterChoice {
    int on_positions, displacement, increment, compensated;
    int of(Formulation formulation) const {
        if (voxspring::on_positions(formulation)) return on_positions;
        if (formulation == Formulation::displacement) return displacement;
        return formulation == Formulation::increment ? increment : compensated;
    }
};

/// Empty, or why kernels cannot index an array of `words` words, or cannot fetch it by `fetch`.
template <class Real>
std::string too_many_words(std::size_t words, const Device& device, Fetch fetch);
/// Empty, or why the device cannot launch the family's kernels for an array of `words` words.
template <class Real>
std::string launch_refusal(std::size_t words, const Device& device, const KernelFamily& family);

/// A backend with a kernel that reads positions and moves particles by one step. `Step` is that kernel's
/// first argument and has a member `motion`. The next arguments are a reader of positions, a reader of their
/// low parts, and the arrays that the step writes (kernels/*.cu). A kernel that takes many steps in one
/// launch has other arguments (launch_words_together()).
template <class Real, class Step>
class ParticleBackend : public CudaBackend, public FeedFacet, public ToolFacet {
public:
    State download() final {
        this->synchronize();
        PackedState<Real> packed;
        const auto out = [&](auto& values, const auto& buffer) {
            resize_in_huge_pages(values, buffer.size());
            buffer.download(values, stream());
        };
        out(packed.current, words_[std::size_t(current())]);
        if (!by_increments(family_.formulation)) out(packed.previous, words_[std::size_t(1 - current())]);
        out(packed.current_low, low_[std::size_t(current())]);
        out(packed.increment, increment_);
        out(packed.increment_low, increment_low_);
        return unpack(problem(), packed, placement_, family_.formulation);
    }
    std::string state_fingerprint() final {
        this->synchronize();
        StateHash hash(stream());
        hash.add(words_[std::size_t(current())]);
        if (!by_increments(family_.formulation)) hash.add(words_[std::size_t(1 - current())]);
        hash.add(low_[std::size_t(current())]);
        hash.add(increment_);
        hash.add(increment_low_);
        return hash.text();
    }

    FeedFacet* feeds() override { return this; }
    std::unique_ptr<Feed> feed(const std::vector<std::uint32_t>& particles, std::uint32_t buffer) override {
        let_end();
        return make_feed<Real>(fed_words(particles), buffer, stream(), [this] { return feeding(); });
    }
    std::unique_ptr<HostFeed> host_feed(const std::vector<std::uint32_t>& particles) override {
        let_end();
        return make_host_feed<Real>(fed_words(particles), stream(), [this] { return feeding(); });
    }
    std::unique_ptr<DeviceFeed> device_feed(const std::vector<std::uint32_t>& particles) override {
        let_end();
        return make_device_feed<Real>(fed_words(particles), stream(), [this] { return feeding(); });
    }

    BorderFacet* borders() override { return this; }
    std::unique_ptr<Border> border(const std::vector<std::uint32_t>& particles) override {
        if (!this->gives_borders()) return nullptr;
        return make_border(elements_of(particles, [this](std::uint32_t i) { return placement_.at(i); }),
                           border_state());
    }
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& borders,
                                                  const std::string& way) override {
        const auto elements = in_elements(borders, [this](std::uint32_t i) { return placement_.at(i); });
        return make_device_borders(elements, way, this->device(),
                                   border_state(enable_border_stream(borders, way)));
    }

    ToolFacet* tool() override { return this; }
    void move_tool(const glm::dvec3& displacement) override {
        const ToolState<Real> now{vector_of<Real>(displacement), Real(problem().tool.stiffness)};
        tool_.send(std::span(&now, 1), stream());
    }
    glm::dvec3 tool_force() override {
        if (steps() == 0) return glm::dvec3(0);
        std::vector<HeldForce<Real>> forces(held_forces_.size());
        held_forces_.download(forces, stream());
        this->check_waits();
        return force_on_tool(forces);
    }

protected:
    explicit ParticleBackend(const KernelFamily& family) : family_(family.on(this->device())) {}

    struct Launch {
        KernelSource source = {};  ///< the source of `kernel`; set only if it supports LISTED_BLOCKS
        std::shared_ptr<const Kernel> kernel;
        dim3 grid, block;
        std::size_t shared_bytes = 0;
        Step step;
    };

    const KernelFamily& family() const { return family_; }
    Formulation formulation() const { return family_.formulation; }

    /// How many blocks of `threads` threads fit on an SM if a thread has `registers` registers in float32 and
    /// twice as many in float64.
    int blocks_with(int registers, int threads) const {
        constexpr int registers_per_sm = 65536;  // on every architecture
        const int at_most = device().threads_per_multiprocessor / threads;
        const int width = sizeof(Real) / sizeof(float);
        return std::clamp(registers_per_sm / (threads * registers * width), 1, at_most);
    }

    /// Whether all of `threads` threads run at once, in blocks of `block` with `registers` registers per
    /// thread.
    bool run_at_once(std::size_t threads, int registers, int block) const {
        return threads <= std::size_t(device().multiprocessors) * std::size_t(block) *
                              std::size_t(blocks_with(registers, block));
    }
    /// Registers per thread: `tuned`, unless that is "auto". With "auto" the result is the first number of
    /// `plenty` with which all threads run at once, since fewer registers would make room for threads that do
    /// not exist. If there is no such number, `choice` decides.
    int registers_for(const std::string& tuned, std::size_t threads, int block,
                      std::initializer_list<int> plenty, const RegisterChoice& choice) const {
        if (tuned != "auto") return std::stoi(tuned);
        for (const int many : plenty) {
            if (run_at_once(threads, many, block)) return many;
        }
        return choice.of(family_.formulation);
    }

    /// Uploads the state, goes to step 0 and makes the next steps use `launch`, after pointing its step's
    /// motion at the arrays of this backend. `bits`: one ParticleRecord::bits per particle.
    void start(const Problem& problem, const State& state, const Placement& placement,
               std::span<const std::uint32_t> bits, Launch launch) {
        set_problem(problem);
        placement_ = placement;
        bool moved = false;
        {
            PackedState<Real> packed = pack<Real>(problem, state, placement, bits, family_.formulation);
            const bool increments = by_increments(family_.formulation);
            moved = upload_words(words_, 0, packed.current) || moved;
            // In formulations by increments there is no previous state. The other buffer starts as a copy of
            // the current one: the first step may leave out blocks at rest (kernels/resting.h), whose words
            // the next step reads there.
            moved = upload_words(words_, 1, increments ? packed.current : packed.previous) || moved;
            moved = upload_words(low_, 0, packed.current_low) || moved;
            moved = upload_words(low_, 1, packed.current_low) || moved;
            moved = upload_axes(increment_, packed.increment) || moved;
            moved = upload_axes(increment_low_, packed.increment_low) || moved;
        }
        moved = upload_held(pack_held<Real>(problem, placement, family_.formulation)) || moved;
        load_.upload(pack_load<Real>(problem, placement), stream());
        inverse_masses_.upload(pack_inverse_masses<Real>(problem, placement), stream());
        launch.step.motion.load = load_.data();
        launch.step.motion.inverse_masses = inverse_masses_.data();
        reset_to_step_zero();
        resume(launch, moved);
    }

    /// Makes the next steps use `launch`, whose motion points at this backend's arrays. `words_moved`:
    /// particles are in other memory than before.
    void resume(const Launch& launch, bool words_moved = false) {
        const bool changed = words_moved || launch.kernel != launch_.kernel ||
                             !same(launch.grid, launch_.grid) || !same(launch.block, launch_.block) ||
                             !(launch.step == launch_.step);
        launch_ = launch;
        if (is_split()) compile_for_parts();
        if (!changed) return;
        launch.kernel->allow_shared(launch.shared_bytes);
        this->forget_graphs();
    }
    const Launch& launch() const { return launch_; }
    /// Compiles the kernel for the two launches of a split step. Overridden if the kernel of whole steps can
    /// make these as well.
    virtual void compile_for_parts() {
        KernelSource source = launch_.source;
        source.macros["LISTED_BLOCKS"] = "1";
        part_kernel_ = this->kernel(source);
    }

    /// The particles that the tool holds, and memory for its forces on them.
    const Buffer<HeldWord<Real>>& held() const { return held_; }
    HeldForce<Real>* held_forces() const { return held_forces_.data(); }

    /// The words that hold the particles' places (positions or displacements) at t.
    ParticleRecord<Real>* current_words() const { return words_[std::size_t(current())].data(); }

    /// Writes new bits of `particles` to the current state. Every step copies the bits from the buffer that
    /// it reads to the other one.
    void write_particle_bits(std::span<const std::uint32_t> particles, std::span<const std::uint32_t> bits) {
        std::vector<EditedWord> edited;
        edited.reserve(particles.size());
        for (std::size_t n = 0; n < particles.size(); ++n)
            edited.push_back({std::uint32_t(placement_.at(particles[n])), bits[n]});
        launch_for_each(*support_kernels<Real>().write_particle_bits, edited.size(), stream(),
                        current_words(), edited_words_.send(std::span<const EditedWord>(edited), stream()),
                        edited.size());
    }

    /// Writes the masks of the particles that `edit` touched.
    void write_masks(const SpringEdit& edit) {
        std::vector<std::uint32_t> particles, masks;
        for (const SpringEdit::Touched& touched : edit.touched) {
            particles.push_back(touched.particle);
            masks.push_back(touched.mask);
        }
        write_particle_bits(particles, masks);
    }

    std::uint64_t particle_bytes_held() const {
        return words_[0].bytes() + words_[1].bytes() + low_[0].bytes() + low_[1].bytes() +
               increment_.bytes() + increment_low_.bytes() + load_.bytes() + inverse_masses_.bytes() +
               edited_words_.bytes() + blocks_.bytes() + held_.bytes() + held_forces_.bytes() + tool_.bytes();
    }

    /// Enqueues a kernel with the arguments that all kernels for one step have, followed by `more`.
    template <class... More>
    void launch_kernel(const Stream& in, const Kernel& kernel, dim3 grid, dim3 block,
                       std::size_t shared_bytes, const Step& step, int reading, const More&... more) const {
        with_arguments(step, reading, [&](const auto&... arguments) {
            kernel.launch(in, grid, block, shared_bytes, arguments..., more...);
        });
    }
    /// Calls `launch` with the arguments that all kernels for one step have.
    template <class DoLaunch>
    void with_arguments(const Step& step, int reading, const DoLaunch& launch) const {
        const auto from = std::size_t(reading), to = std::size_t(1 - reading);
        const Output<Real> output{words_[to].data(), low_[to].data(), increment_.data(),
                                  increment_low_.data(), increment_pitch(placement_)};
        launch(step, source(words_[from], textures_[0][from]), source(low_[from], textures_[1][from]),
               output);
    }

    /// Enqueues a kernel that takes many steps in one launch and leaves the state in the same buffers
    /// (kernels/resident.cu). `step` may be of a class derived from Step. `launch`: its kernel and shape.
    template <class AnyStep, class... Arguments>
    void launch_words_together(const Launch& launch, const AnyStep& step,
                               const Arguments&... arguments) const {
        ParticleRecord<Real>* const words = words_[std::size_t(current())].data();
        ParticleRecord<Real>* const previous = words_[std::size_t(1 - current())].data();
        Real* const increment = increment_.data();
        const std::size_t pitch = increment_pitch(placement_);
        launch.kernel->launch_together(stream(), launch.grid, launch.block, launch.shared_bytes, step, words,
                                       previous, increment, pitch, arguments...);
    }

    void enqueue_step(int reading) override {
        with_arguments(launch_.step, reading, [&](const auto&... arguments) {
            launch_.kernel->launch_dependent_if(family_.dependent_launch, stream(), launch_.grid,
                                                launch_.block, launch_.shared_bytes, arguments...);
        });
    }

    /// Splits the blocks of a step into those with particles of `border` and the others, for kernels that can
    /// take a list of blocks. Particles are in canonical order, so block n has those from n * launch_.block.x
    /// on.
    bool split_steps(const std::vector<std::uint32_t>& border) override {
        parts_ = part_blocks(problem().particle_count(), launch_.block.x, border);
        blocks_.upload(parts_.blocks, stream());
        compile_for_parts();
        return parts_.count_of(StepPart::interior) > 0;
    }
    void enqueue_part(int reading, StepPart part, const Stream& in) override {
        const std::size_t count = parts_.count_of(part);
        if (count == 0) return;
        const std::uint32_t* const blocks = blocks_.data() + parts_.begin_of(part);
        launch_kernel(in, *part_kernel_, dim3(unsigned(count)), launch_.block, launch_.shared_bytes,
                      launch_.step, reading, blocks);
    }

    bool replays_steps() const final { return family_.replays; }

    bool gives_borders() const override { return true; }
    /// Called once the writing of a message over a border into the state, between two steps, is enqueued.
    virtual void border_written() {}

private:
    static bool same(dim3 a, dim3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

    using Pair = std::array<Buffer<ParticleRecord<Real>>, 2>;

    // Returns whether the words are in other memory than before.
    bool upload_words(Pair& pair, std::size_t which, const std::vector<ParticleRecord<Real>>& words) {
        Buffer<ParticleRecord<Real>>& buffer = pair[which];
        const bool moved = buffer.size() != words.size();
        Texture& texture = textures_[&pair == &words_ ? 0 : 1][which];
        if (moved) texture = {};
        buffer.upload(words, stream());
        if (moved && !words.empty() && family_.fetch == Fetch::texture)
            texture = make_texture(buffer, sizeof(Real) == sizeof(float) ? cudaChannelFormatKindFloat
                                                                         : cudaChannelFormatKindSigned);
        return moved;
    }
    bool upload_held(const std::vector<HeldWord<Real>>& held) {
        const bool moved = held_.size() != held.size();
        held_.upload(held, stream());
        held_forces_.resize(held.size());
        return moved;
    }
    bool upload_axes(Buffer<Real>& buffer, const std::vector<Real>& values) {
        const bool moved = buffer.size() != values.size();
        buffer.upload(values, stream());
        return moved;
    }

    /// The handle that the types of kernels/fetch.h hold: a texture or an address.
    std::uint64_t source(const Buffer<ParticleRecord<Real>>& buffer, const Texture& texture) const {
        return family_.fetch == Fetch::texture ? texture.get()
                                               : reinterpret_cast<std::uintptr_t>(buffer.data());
    }

    std::vector<FedWord<Real>> fed_words(const std::vector<std::uint32_t>& particles) const {
        return pack_fed<Real>(problem(), particles, family_.formulation,
                              [&](std::uint32_t i) { return placement_.at(i); });
    }
    /// Where particles are after the steps so far, for which it waits. Throws DeviceError if a launch has
    /// waited in vain, which leaves them in the wrong places. The caller sets `fed` and `count`, which say
    /// which particles it wants.
    Feeding<Real> feeding() {
        this->synchronize();
        const auto now = std::size_t(current());
        return {.fed = nullptr,
                .count = 0,
                .words = words_[now].data(),
                .words_low = low_[now].size() == 0 ? nullptr : low_[now].data()};
    }
    BorderState<Real> border_state(BordersFirst* first = nullptr) {
        const auto reals = [](const Buffer<ParticleRecord<Real>>& words) {
            return words.size() == 0 ? nullptr : &words.data()->position.x;
        };
        return {.stream = stream(),
                .now =
                    [this, reals] {
                        const auto now = std::size_t(current());
                        return BorderPlaces<Real>{
                            .element = nullptr,
                            .count = 0,
                            .at = reals(words_[now]),
                            .low = reals(low_[now]),
                            .element_pitch = sizeof(ParticleRecord<Real>) / sizeof(Real),
                            .axis_pitch = 1};
                    },
                .written = [this] { border_written(); },
                .wait = border_wait(),
                .first = first};
    }

    std::vector<StateArray> state_arrays() const final {
        return {state_array(words_[0]), state_array(words_[1]),  state_array(low_[0]),
                state_array(low_[1]),   state_array(increment_), state_array(increment_low_)};
    }

    void enqueue_tool(int reading) final {
        const auto from = std::size_t(reading);
        const Holding<Real> holding{held_.data(),      held_.size(), tool_.data(),       words_[from].data(),
                                    low_[from].data(), load_.data(), held_forces_.data()};
        launch_for_each(*support_kernels<Real>().pull_held_particles, held_.size(), stream(), holding);
    }
    void rest_tool() final {
        if (held_.size() > 0) move_tool(glm::dvec3(0));
    }

    void enqueue_divergence_check(const DivergenceCheck& parameters, FirstDivergence* first) override {
        const auto now = std::size_t(current());
        const ParticleRecord<Real>* const before =
            by_increments(family_.formulation) ? nullptr : words_[1 - now].data();
        const ParticlesInWords<Real> particles{words_[now].data(), before, increment_.data(),
                                               increment_pitch(placement_)};
        launch_divergence_check(*support_kernels<Real>().check_words, particles, placement_.words, parameters,
                                first, stream());
    }

    const KernelFamily family_;
    Placement placement_;
    Pair words_, low_;
    std::array<std::array<Texture, 2>, 2> textures_;  // [0]: of words_, [1]: of low_
    Buffer<Real> increment_, increment_low_;
    Buffer<Vector<Real>> load_;
    Buffer<Real> inverse_masses_;
    Staging<EditedWord> edited_words_;
    Buffer<HeldWord<Real>> held_;
    Buffer<HeldForce<Real>> held_forces_;
    Staging<ToolState<Real>> tool_;  // one element at a fixed address, which graphs hold
    Launch launch_{};
    // For split steps, which have two launches: the border, and the interior.
    std::shared_ptr<const Kernel> part_kernel_;
    BlockParts<std::uint32_t> parts_;
    Buffer<std::uint32_t> blocks_;
};

}  // namespace voxspring::cuda
