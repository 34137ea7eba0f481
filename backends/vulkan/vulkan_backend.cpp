#include "backends/vulkan/vulkan_backend.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <limits>
#include <numeric>

#include "backends/layout/tool.h"
#include "backends/vulkan/limits.h"

namespace voxspring::vulkan {
namespace {

/// The value of found_ until a check fails; then it is the number of the first check that failed, from 1.
constexpr std::uint32_t never_found = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint32_t found_binding = 3;  // as in shaders/divergence_check.comp

/// A recording has at most 2^max_power steps: few enough that it takes little memory, and that recording it
/// pays off soon. A submission has about most_steps_a_submission steps or, if steps are long, fewer (Pace).
constexpr int max_power = 8;
constexpr int most_steps_a_submission = 512;

vk::raii::QueryPool make_marks(const Device& device) {
    return {device.get(), vk::QueryPoolCreateInfo({}, vk::QueryType::eTimestamp, 2)};
}

Commands record_mark(const Queue& queue, vk::QueryPool marks, std::uint32_t which) {
    return queue.record([&](const Commands& commands) {
        commands.resetQueryPool(marks, which, 1);
        commands.writeTimestamp(vk::PipelineStageFlagBits::eBottomOfPipe, marks, which);
    });
}

bool is_single(const Options& options) { return options.precision == Precision::float32; }

}  // namespace

struct VulkanBackend::Stepping {
    std::array<Pass, 2> pass;  ///< starting from words 0 and from words 1
    glm::uvec3 groups;
    std::map<std::pair<int, std::size_t>, Commands> recorded = {};  ///< by power, and the words at first
};

struct VulkanBackend::Holding {
    Buffer held, forces;
    std::vector<Pass> pass = {};  ///< starting from words 0 and from words 1
};

struct VulkanBackend::Checking {
    std::array<Pass, 2> pass;
    Pass next;  ///< gives the next check its number
    std::array<Commands, 2> recorded;
};

VulkanBackend::VulkanBackend(const Options& options, glm::ivec3 group)
    : device_(options.precision),
      options_(options),
      group_(group),
      marks_(guarded("starting", [&] { return make_marks(device_); })),
      nothing_(guarded("starting", [&] { return Buffer(device_, Module::block_alignment, Place::device); })),
      sent_once_(device_),
      queue_(device_),
      pace_(most_steps_a_submission),
      mark_{record_mark(queue_, *marks_, 0), record_mark(queue_, *marks_, 1)} {}

VulkanBackend::~VulkanBackend() { queue_.abandon(); }

std::string VulkanBackend::unsupported(const Problem& problem) const {
    const vk::PhysicalDeviceLimits& limits = device_.limits();
    const auto& extents = limits.maxComputeWorkGroupSize;
    if (std::string why = glsl::work_group_refusal(
            group_, {limits.maxComputeWorkGroupInvocations, {extents[0], extents[1], extents[2]}});
        !why.empty())
        return why;
    if (std::string why = refused_layout(problem); !why.empty()) return why;
    const std::size_t word =
        is_single(options_) ? sizeof(layout::ParticleRecord<float>) : sizeof(layout::ParticleRecord<double>);
    if (std::string why = device_.buffer_limits().too_large("positions", place(problem).words * word);
        !why.empty())
        return why;
    return glsl::memory_refusal(bytes_needed(problem), held_bytes_, device_.free_memory_bytes());
}

std::shared_ptr<const Program> VulkanBackend::program(const std::string& shader,
                                                      const glsl::Constants& constants, glm::ivec3 group) {
    const std::string module = shader + "_" + to_string(options_.precision);
    std::string key = module;
    for (const int extent : {group.x, group.y, group.z}) key += " " + std::to_string(extent);
    for (const auto& [name, value] : constants) key += " " + name + "=" + value;
    if (const auto known = programs_.find(key); known != programs_.end()) return known->second;
    constexpr std::size_t max_programs = 16;
    if (programs_.size() == max_programs) programs_.clear();
    auto made = std::make_shared<const Program>(device_, module, constants, group);
    compile_time_ += made->compile_time();
    return programs_[key] = made;
}

void VulkanBackend::put(Buffer& buffer, std::span<const std::byte> values) {
    if (buffer.bytes() != values.size()) {
        buffer = {};  // frees the old buffer first
        buffer = Buffer(device_, values.size(), Place::device);
    }
    queue_.upload(buffer, values);
}

template <class Real>
void VulkanBackend::upload_state(const Problem& problem, const State& state) {
    const layout::Placement& placement = layout_.placement;
    {
        const layout::PackedState<Real> packed =
            layout::pack<Real>(problem, state, placement, layout_.bits, formulation());
        put(words_[0], packed.current);
        // By increments a step writes every particle's word to this buffer before any step reads it.
        put(words_[1], by_increments(formulation()) ? packed.current : packed.previous);
        for (Buffer& low : low_) put(low, packed.current_low);
        put(increment_, packed.increment);
        put(increment_low_, packed.increment_low);
    }
    const auto operands = glsl::pack_operands<Real>(problem, placement, all_terms());
    put(load_, operands.loads);
    put(inverse_mass_, operands.inverse_masses);
}

void VulkanBackend::upload(const Problem& problem, const State& state) {
    guarded("uploading", [&] {
        queue_.wait();
        problem_ = &problem;
        compile_time_ = {};
        start_ = {};
        const std::size_t words_before = layout_.placement.words;
        layout_ = lay_out(problem);
        // Steps are not measured again for a body of the same size, as when it is uploaded for each
        // repetition.
        if (layout_.placement.words != words_before) pace_.forget();
        if (is_single(options_)) {
            upload_state<float>(problem, state);
        } else {
            upload_state<double>(problem, state);
        }
        make_stepping();
        holding_ = nullptr;
        if (problem.has_tool() && is_single(options_)) make_holding<float>();
        if (problem.has_tool() && !is_single(options_)) make_holding<double>();
        reset_to_step_zero();
        held_bytes_ = bytes_needed(problem);
        queue_.wait();
    });
    device_.check("uploading");
}

Buffers VulkanBackend::buffers(std::size_t current) const {
    Buffers all = {{glsl::words, &words_[current]},         {glsl::next_words, &words_[1 - current]},
                   {glsl::words_low, &low_[current]},       {glsl::next_words_low, &low_[1 - current]},
                   {glsl::increments, &increment_},         {glsl::loads, &load_},
                   {glsl::increments_low, &increment_low_}, {glsl::inverse_masses, &inverse_mass_}};
    for (const auto& [binding, buffer] : own_) all[binding] = &buffer;
    return all;
}

void VulkanBackend::make_stepping() {
    glsl::Constants all = glsl::term_constants(*problem_, formulation(), all_terms());
    all.merge(constants(*problem_));
    const auto program = this->program(shader() + "_" + to_string(formulation()), all, group_);
    Uniforms uniforms(program->module());
    if (is_single(options_)) {
        glsl::set_motion<float>(uniforms, *problem_);
    } else {
        glsl::set_motion<double>(uniforms, *problem_);
    }
    uniforms.set("pitch", int(layout::increment_pitch(layout_.placement)));
    set_uniforms(uniforms, *problem_);
    const auto pass = [&](std::size_t current) {
        return Pass(queue_, program, uniforms, buffers(current), nothing_);
    };
    auto stepping = std::make_shared<Stepping>(Stepping{{pass(0), pass(1)}, glm::uvec3(layout_.groups)});
    if (stepping_) queue_.keep(std::move(stepping_));
    stepping_ = std::move(stepping);
}

template <class Real>
void VulkanBackend::make_holding() {
    const auto held = layout::pack_held<Real>(*problem_, layout_.placement, formulation());
    auto holding = std::make_shared<Holding>();
    put(holding->held, held);
    put(holding->forces, std::vector<layout::HeldForce<Real>>(held.size()));
    const auto pull = program(formulation() == Formulation::compensated ? "tool_compensated" : "tool");
    for (const std::size_t current : {0, 1}) {
        const Buffers buffers = {{glsl::words, &words_[current]},
                                 {glsl::words_low, &low_[current]},
                                 {glsl::loads, &load_},
                                 {glsl::held_words, &holding->held},
                                 {glsl::held_forces, &holding->forces}};
        holding->pass.emplace_back(queue_, pull, tool_uniforms<Real>(pull->module(), glm::dvec3(0)), buffers,
                                   nothing_);
    }
    holding_ = std::move(holding);
}

template <class Real>
Uniforms VulkanBackend::tool_uniforms(const Module& module, const glm::dvec3& moved) const {
    Uniforms uniforms(module);
    uniforms.set("count", int(problem_->tool.particles.size()));
    uniforms.set("stiffness", Real(problem_->tool.stiffness));
    uniforms.set("moved", glm::vec<3, Real>(moved));
    return uniforms;
}

void VulkanBackend::move_tool(const glm::dvec3& displacement) {
    guarded("moving the tool", [&] {
        for (Pass& pass : holding_->pass) {
            pass.set(queue_, is_single(options_) ? tool_uniforms<float>(pass.module(), displacement)
                                                 : tool_uniforms<double>(pass.module(), displacement));
        }
    });
}

template <class Real>
glm::dvec3 VulkanBackend::read_tool_force() {
    std::vector<layout::HeldForce<Real>> forces(problem_->tool.particles.size());
    queue_.download(holding_->forces, std::as_writable_bytes(std::span(forces)));
    return layout::force_on_tool(forces);
}

glm::dvec3 VulkanBackend::tool_force() {
    if (steps_ == 0) return glm::dvec3(0);
    const glm::dvec3 force = guarded("reading the tool's force", [&] {
        return is_single(options_) ? read_tool_force<float>() : read_tool_force<double>();
    });
    device_.check("reading the tool's force");
    return force;
}

void VulkanBackend::make_checking() {
    const std::string shader =
        std::string("divergence_check") + (by_increments(formulation()) ? "_increment" : "_position");
    const auto check = program(shader);
    Uniforms uniforms(check->module());
    if (is_single(options_)) {
        uniforms.set("inverse_largest", float(1 / monitor_.largest_increment));
    } else {
        uniforms.set("inverse_largest", 1 / monitor_.largest_increment);
    }
    if (found_.bytes() == 0) found_ = Buffer(device_, 2 * sizeof(std::uint32_t), Place::device);
    const auto pass = [&](std::size_t current) {
        const Buffers checked = {{glsl::words, &words_[current]},
                                 {glsl::next_words, &words_[1 - current]},
                                 {glsl::increments, &increment_},
                                 {found_binding, &found_}};
        return Pass(queue_, check, uniforms, checked, nothing_);
    };
    const auto next_check = program("next_check");
    std::array passes = {pass(0), pass(1)};
    Pass next(queue_, next_check, Uniforms(next_check->module()), {{found_binding, &found_}}, nothing_);
    const auto record = [&](std::size_t current) {
        return queue_.record([&](const Commands& commands) {
            passes[current].bind_program(commands);
            passes[current].dispatch(commands, {glsl::striding_groups(layout_.placement.words), 1, 1});
            shaders_then_shaders(commands);
            next.bind_program(commands);
            next.dispatch(commands, {1, 1, 1});
            shaders_then_shaders(commands);
        });
    };
    std::array recorded = {record(0), record(1)};
    checking_ = std::make_shared<Checking>(Checking{std::move(passes), std::move(next), std::move(recorded)});
}

void VulkanBackend::reset_to_step_zero() {
    steps_ = 0;
    current_ = 0;
    if (holding_) move_tool(glm::dvec3(0));
    monitor_ = next_monitor_;
    if (checking_) queue_.keep(std::move(checking_));
    checking_ = nullptr;
    if (monitor_.every == 0) return;
    make_checking();
    const std::array<std::uint32_t, 2> none_and_first = {never_found, 1};
    queue_.update(found_, std::as_bytes(std::span(none_and_first)));
}

bool VulkanBackend::keep_start() {
    return guarded("keeping the start", [&] {
        const auto buffers = state_buffers();
        std::uint64_t bytes = 0;
        for (const Buffer* const buffer : buffers) bytes += buffer->bytes();
        if (bytes > device_.free_memory_bytes() / 2) return false;
        queue_.wait();  // a rewind() may still read an earlier copy
        for (std::size_t n = 0; n < buffers.size(); ++n) {
            start_[n] = Buffer(device_, buffers[n]->bytes(), Place::device);
            queue_.copy(*buffers[n], start_[n]);
        }
        queue_.wait();
        return true;
    });
}

void VulkanBackend::rewind() {
    guarded("rewinding", [&] {
        const auto buffers = state_buffers();
        for (std::size_t n = 0; n < buffers.size(); ++n) queue_.copy(start_[n], *buffers[n]);
        reset_to_step_zero();
        queue_.submit();
    });
}

void VulkanBackend::dispatch_step(const Commands& commands, std::size_t current) const {
    if (holding_) {
        const Pass& hold = holding_->pass[current];
        hold.bind_program(commands);
        hold.dispatch(commands, {glsl::striding_groups(problem_->tool.particles.size()), 1, 1});
        shaders_then_shaders(commands);
        stepping_->pass[current].bind_program(commands);
    }
    stepping_->pass[current].dispatch(commands, stepping_->groups);
    shaders_then_shaders(commands);
}

const Commands& VulkanBackend::steps(int power) {
    const std::pair key(power, current_);
    auto found = stepping_->recorded.find(key);
    if (found == stepping_->recorded.end()) {
        Commands recorded = queue_.record([&](const Commands& commands) {
            stepping_->pass[0].bind_program(commands);
            for (std::size_t n = 0; n < std::size_t(1) << power; ++n)
                dispatch_step(commands, (current_ + n) % 2);
        });
        found = stepping_->recorded.emplace(key, std::move(recorded)).first;
    }
    return found->second;
}

void VulkanBackend::have_enqueued(int steps) {
    steps_ += steps;
    current_ = (current_ + std::size_t(steps)) % 2;
    if (monitor_.every > 0 && steps_ % monitor_.every == 0) queue_.enqueue(checking_->recorded[current_]);
}

void VulkanBackend::step(int count) {
    guarded("stepping", [&] {
        while (count > 0 && pace_.is_unknown()) {
            const int steps = std::min(count, pace_.steps());
            queue_.wait();
            const auto begin = std::chrono::steady_clock::now();
            enqueue_steps(steps);
            queue_.wait();
            pace_.measured(steps,
                           std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
            count -= steps;
        }
        enqueue_steps(count);
    });
}

void VulkanBackend::enqueue_steps(int count) {
    int unsubmitted = 0;
    while (count > 0) {
        int most = std::min({count, 1 << max_power, pace_.steps() - unsubmitted});
        if (monitor_.every > 0)
            most = int(std::min<std::int64_t>(most, monitor_.every - steps_ % monitor_.every));
        const int power = int(std::bit_width(unsigned(most))) - 1;
        queue_.enqueue(steps(power));
        have_enqueued(1 << power);
        count -= 1 << power;
        unsubmitted += 1 << power;
        if (unsubmitted < pace_.steps()) continue;
        queue_.submit();
        unsubmitted = 0;
    }
    queue_.submit();
}

std::optional<Divergence> VulkanBackend::divergence() {
    if (monitor_.every == 0) return std::nullopt;
    std::array<std::uint32_t, 2> found{};
    guarded("checking for divergence",
            [&] { queue_.download(found_, std::as_writable_bytes(std::span(found))); });
    device_.check("checking for divergence");
    if (found[0] == never_found) return std::nullopt;
    const std::int64_t at = std::int64_t(found[0]) * monitor_.every;
    return Divergence{at - monitor_.every, at};
}

void VulkanBackend::synchronize() {
    guarded("stepping", [&] { queue_.wait(); });
    device_.check("stepping");
}

template <class Real>
State VulkanBackend::download_state() {
    layout::PackedState<Real> packed;
    const auto out = [&]<class T>(std::vector<T>& values, const Buffer& buffer) {
        values.resize(buffer.bytes() / sizeof(T));
        queue_.download(buffer, std::as_writable_bytes(std::span(values)));
    };
    out(packed.current, words_[current_]);
    if (!by_increments(formulation())) out(packed.previous, words_[1 - current_]);
    out(packed.current_low, low_[current_]);
    out(packed.increment, increment_);
    out(packed.increment_low, increment_low_);
    return layout::unpack<Real>(*problem_, packed, layout_.placement, formulation());
}

State VulkanBackend::download() {
    synchronize();
    State state = guarded("downloading", [&] {
        return is_single(options_) ? download_state<float>() : download_state<double>();
    });
    device_.check("downloading");
    return state;
}

void VulkanBackend::edit(const Problem& edited, const SpringEdit& edit) {
    problem_ = &edited;
    if (edit.empty()) return;
    guarded("editing", [&] { enqueue_edit_of(edited, edit); });
}

void VulkanBackend::lay_out_anew() {
    queue_.wait();
    layout_ = lay_out(*problem_);
    make_stepping();
    std::vector<std::uint32_t> all(problem_->particle_count());
    std::iota(all.begin(), all.end(), 0U);
    write_bits(all, layout_.bits);
}

void VulkanBackend::enqueue_dispatch(const std::shared_ptr<const Program>& program, std::size_t count,
                                     const Uniforms& uniforms, const Buffers& buffers,
                                     const std::vector<std::shared_ptr<const Buffer>>& sent) {
    const auto pass =
        std::make_shared<Pass>(device_, program, sent_once_.holding(uniforms.bytes()), buffers, nothing_);
    queue_.enqueue_once([&](const Commands& commands) {
        pass->bind_program(commands);
        pass->dispatch(commands, {glsl::striding_groups(count), 1, 1});
        shaders_then_shaders(commands);
    });
    queue_.keep(pass);
    for (const auto& buffer : sent) queue_.keep(buffer);
    queue_.submit();
}

void VulkanBackend::write_bits(std::span<const std::uint32_t> particles,
                               std::span<const std::uint32_t> bits) {
    if (particles.empty()) return;
    std::vector<std::uint32_t> edited;
    edited.reserve(2 * particles.size());
    for (std::size_t n = 0; n < particles.size(); ++n) {
        edited.push_back(std::uint32_t(layout_.placement.at(particles[n])));
        edited.push_back(bits[n]);
    }
    const auto program = this->program("edit_bits");
    Uniforms uniforms(program->module());
    uniforms.set("count", int(particles.size()));
    const auto sent = send(edited);
    enqueue_dispatch(program, particles.size(), uniforms, {{0, &words_[current_]}, {1, sent.get()}}, {sent});
}

void VulkanBackend::measure(const Buffer& squares, std::size_t count, int stride, int offset) {
    const auto program = this->program("measure");
    Uniforms uniforms(program->module());
    uniforms.set("count", int(count));
    uniforms.set("stride", stride);
    uniforms.set("offset", offset);
    enqueue_dispatch(program, count, uniforms, {{0, &squares}}, {});
    queue_.wait();
}

WorkCount VulkanBackend::count_work() {
    const glm::ivec3 g = layout_.groups;
    WorkCount work{{"work_groups", std::uint64_t(g.x) * std::uint64_t(g.y) * std::uint64_t(g.z)}};
    if (!device_.has_pipeline_statistics()) {
        step(1);
        return work;
    }
    guarded("counting work", [&] {
        const vk::raii::QueryPool query(
            device_.get(),
            vk::QueryPoolCreateInfo({}, vk::QueryType::ePipelineStatistics, 1,
                                    vk::QueryPipelineStatisticFlagBits::eComputeShaderInvocations));
        queue_.enqueue_once([&](const Commands& commands) {
            commands.resetQueryPool(*query, 0, 1);
            commands.beginQuery(*query, 0, {});
            stepping_->pass[current_].bind_program(commands);
            dispatch_step(commands, current_);
            commands.endQuery(*query, 0);
        });
        have_enqueued(1);
        queue_.wait();
        work["compute_shader_invocations"] =
            query
                .getResult<std::uint64_t>(0, 1, sizeof(std::uint64_t),
                                          vk::QueryResultFlagBits::e64 | vk::QueryResultFlagBits::eWait)
                .second;
    });
    device_.check("counting work");
    return work;
}

DeviceLimits VulkanBackend::measure_limits() {
    DeviceLimits limits = guarded("measuring limits", [&] { return vulkan::measure_limits(queue_); });
    device_.check("measuring limits");
    return limits;
}

void VulkanBackend::mark(Mark which) {
    guarded("timing", [&] {
        queue_.enqueue(mark_[which == Mark::begin ? 0 : 1]);
        // The first mark is submitted together with the first steps.
        if (which == Mark::end) queue_.submit();
    });
}

double VulkanBackend::seconds_between_marks() const {
    return guarded("timing", [&] {
        using Result = vk::QueryResultFlagBits;
        const auto ticks = marks_
                               .getResults<std::uint64_t>(0, 2, 2 * sizeof(std::uint64_t),
                                                          sizeof(std::uint64_t), Result::e64 | Result::eWait)
                               .second;
        const auto families = device_.physical().getQueueFamilyProperties();
        const std::uint32_t bits = families[device_.queue_family()].timestampValidBits;
        const std::uint64_t mask = bits == 64 ? ~std::uint64_t(0) : (std::uint64_t(1) << bits) - 1;
        return 1e-9 * double(device_.limits().timestampPeriod) * double((ticks[1] - ticks[0]) & mask);
    });
}

}  // namespace voxspring::vulkan
