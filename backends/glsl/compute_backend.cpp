#include "backends/glsl/compute_backend.h"

#include <limits>
#include <numeric>
#include <utility>

#include "backends/glsl/limits.h"
#include "backends/layout/state_hash.h"
#include "backends/physics/huge_pages.h"

namespace voxspring::glsl {
namespace {

/// The value of found_ until a check fails. Then found_ is the number, from 1, of that first failed check.
constexpr std::uint32_t never_found = std::numeric_limits<std::uint32_t>::max();
constexpr unsigned found_binding = 3;  // as in shaders/divergence_check.comp

}  // namespace

template <class Real>
std::string ComputeBackend<Real>::unsupported(const Problem& problem) const {
    std::string why;
    device_->use("reading the device's limits", [&] {
        why = work_group_refusal(group_, device_->work_group_limits());
        if (why.empty()) why = refused_layout(problem);
        if (!why.empty()) return;
        const std::size_t words = place(problem).words;
        why = device_->buffer_limits().too_large("positions", words * sizeof(layout::ParticleRecord<Real>));
        if (why.empty()) why = device_->refused_words(words);
        if (why.empty())
            why = memory_refusal(bytes_needed(problem), held_bytes_, device_->free_memory_bytes());
    });
    return why;
}

template <class Real>
void ComputeBackend<Real>::put(std::unique_ptr<Array>& array, std::span<const std::byte> values) {
    if (bytes_of(array) == values.size()) {
        if (array) device_->overwrite(*array, values);
        return;
    }
    array = nullptr;  // frees the old array first
    if (!values.empty()) array = device_->make(values);
}

template <class Real>
void ComputeBackend<Real>::upload_state(const Problem& problem, const State& state) {
    const layout::Placement& placement = layout_.placement;
    const auto put_vector = [this]<class T>(std::unique_ptr<Array>& array, const std::vector<T>& values) {
        put(array, std::as_bytes(std::span(values)));
    };
    {
        const layout::PackedState<Real> packed =
            layout::pack<Real>(problem, state, placement, layout_.bits, formulation());
        put_vector(words_[0], packed.current);
        // Formulations by increments have no previous state. For them only this array's size and its words
        // without a particle matter: a step writes every particle's word before any step reads it.
        put_vector(words_[1], by_increments(formulation()) ? packed.current : packed.previous);
        for (std::unique_ptr<Array>& low : low_) put_vector(low, packed.current_low);
        put_vector(increment_, packed.increment);
        put_vector(increment_low_, packed.increment_low);
    }
    const auto operands = pack_operands<Real>(problem, placement, all_terms());
    put_vector(load_, operands.loads);
    put_vector(inverse_mass_, operands.inverse_masses);
    const auto held = problem.has_tool() ? layout::pack_held<Real>(problem, placement, formulation())
                                         : std::vector<layout::HeldWord<Real>>();
    put_vector(held_, held);
    put_vector(forces_, std::vector<layout::HeldForce<Real>>(held.size()));
}

template <class Real>
void ComputeBackend<Real>::upload(const Problem& problem, const State& state) {
    device_->use("uploading", [&] {
        device_->wait();
        problem_ = &problem;
        (void)device_->take_compile_time();  // drops the time for earlier problems
        start_ = {};
        const std::size_t words_before = layout_.placement.words;
        layout_ = lay_out(problem);
        // How long steps take is measured again only for a body of another size, not for a body that is
        // uploaded anew for each repetition.
        if (layout_.placement.words != words_before) device_->forget_pace();
        upload_state(problem, state);
        make_step();
        make_tool();
        tell_steps();
        reset_to_step_zero();
        held_bytes_ = bytes_needed(problem);
        device_->wait();
        compile_time_ = device_->take_compile_time();
    });
    device_->check("uploading");
}

template <class Real>
Arrays ComputeBackend<Real>::arrays(std::size_t current) const {
    Arrays all = {{words, words_[current].get()},
                  {next_words, words_[1 - current].get()},
                  {increments, increment_.get()},
                  {words_low, low_[current].get()},
                  {next_words_low, low_[1 - current].get()},
                  {increments_low, increment_low_.get()},
                  {loads, load_.get()},
                  {inverse_masses, inverse_mass_.get()}};
    for (const auto& [binding, array] : own_) all[binding] = array.get();
    return all;
}

template <class Real>
void ComputeBackend<Real>::make_step() {
    Shader all = shader(*problem_);
    all.variant += "_" + to_string(formulation());
    all.macros = formulation_defines(formulation());
    all.constants.merge(term_constants(*problem_, formulation(), all_terms()));
    all.group = group_;
    Uniforms uniforms;
    set_motion<Real>(uniforms, *problem_);
    uniforms.set("pitch", int(layout::increment_pitch(layout_.placement)));
    set_uniforms(uniforms, *problem_);
    for (const std::size_t current : {0, 1}) step_[current] = device_->pass(all, uniforms, arrays(current));
}

template <class Real>
void ComputeBackend<Real>::make_tool() {
    tool_ = {};
    if (!held_) return;
    const char* const variant = formulation() == Formulation::compensated ? "_compensated" : "";
    for (const std::size_t current : {0, 1}) {
        tool_[current] =
            device_->pass({"tool", variant, formulation_defines(formulation())}, tool_uniforms(glm::dvec3(0)),
                          {{words, words_[current].get()},
                           {words_low, low_[current].get()},
                           {loads, load_.get()},
                           {held_words, held_.get()},
                           {held_forces, forces_.get()}});
    }
}

template <class Real>
Dispatches ComputeBackend<Real>::make_check() {
    Dispatches dispatches;
    if (monitor_.every == 0) return dispatches;
    const std::array<std::uint32_t, 2> none_and_first = {never_found, 1};
    put(found_, std::as_bytes(std::span(none_and_first)));
    const Shader check = {"divergence_check", by_increments(formulation()) ? "_increment" : "_position",
                          formulation_defines(formulation())};
    Uniforms uniforms;
    uniforms.set("inverse_largest", Real(inverse_largest(monitor_.largest_increment)));
    for (const std::size_t current : {0, 1}) {
        const Arrays checked = {{words, words_[current].get()},
                                {next_words, words_[1 - current].get()},
                                {increments, increment_.get()},
                                {found_binding, found_.get()}};
        dispatches[current].push_back(
            {device_->pass(check, uniforms, checked), {striding_groups(layout_.placement.words), 1, 1}});
        if (!device_->records_checks()) continue;
        dispatches[current].push_back(
            {device_->pass({"next_check"}, {}, {{found_binding, found_.get()}}), glm::uvec3(1)});
    }
    return dispatches;
}

template <class Real>
void ComputeBackend<Real>::tell_steps() {
    Dispatches step;
    for (const std::size_t current : {0, 1}) {
        if (tool_[current])
            step[current].push_back(
                {tool_[current], {striding_groups(problem_->tool.particles.size()), 1, 1}});
        step[current].push_back({step_[current], glm::uvec3(layout_.groups)});
    }
    device_->step_by(std::move(step));
}

template <class Real>
void ComputeBackend<Real>::reset_to_step_zero() {
    if (held_) move_tool(glm::dvec3(0));
    monitor_ = next_monitor_;
    device_->reset_to_step_zero(make_check(), monitor_.every);
}

template <class Real>
bool ComputeBackend<Real>::keep_start() {
    bool kept = false;
    device_->use("copying the state at step 0", [&] {
        const auto state = state_arrays();
        std::uint64_t bytes = 0;
        for (const auto* const array : state) bytes += bytes_of(*array);
        const auto free = device_->free_memory_bytes();
        if (free && bytes > *free / 2) return;  // half of the free memory is left to other programs
        device_->wait();                        // a rewind() may still read an earlier copy
        start_ = {};
        for (std::size_t n = 0; n < state.size(); ++n) {
            if (*state[n]) start_[n] = device_->copy_of(**state[n]);
        }
        kept = true;
    });
    device_->check("copying the state at step 0");
    return kept;
}

template <class Real>
void ComputeBackend<Real>::rewind() {
    device_->use("rewinding", [&] {
        const auto state = state_arrays();
        for (std::size_t n = 0; n < state.size(); ++n) {
            if (*state[n]) device_->copy(*start_[n], **state[n]);
        }
        reset_to_step_zero();
    });
}

template <class Real>
void ComputeBackend<Real>::step(int count) {
    device_->use("stepping", [&] { device_->step(count); });
}

template <class Real>
void ComputeBackend<Real>::synchronize() {
    device_->use("stepping", [&] { device_->wait(); });
    device_->check("stepping");
}

template <class Real>
State ComputeBackend<Real>::download() {
    synchronize();
    layout::PackedState<Real> packed;
    const auto out = [&]<class T>(std::vector<T>& values, const std::unique_ptr<Array>& array) {
        resize_in_huge_pages(values, bytes_of(array) / sizeof(T));
        if (array) device_->download(*array, std::as_writable_bytes(std::span(values)));
    };
    device_->use("downloading", [&] {
        const std::size_t now = device_->current();
        out(packed.current, words_[now]);
        if (!by_increments(formulation())) out(packed.previous, words_[1 - now]);
        out(packed.current_low, low_[now]);
        out(packed.increment, increment_);
        out(packed.increment_low, increment_low_);
    });
    device_->check("downloading");
    return layout::unpack<Real>(*problem_, packed, layout_.placement, formulation());
}

template <class Real>
std::string ComputeBackend<Real>::state_fingerprint() {
    layout::HashSums hash{};
    device_->use("hashing the state", [&] {
        const std::unique_ptr<Array> sums = device_->make(std::as_bytes(std::span(hash)));
        const std::size_t now = device_->current();
        Array* const before = by_increments(formulation()) ? nullptr : words_[1 - now].get();
        int number = 0;
        for (const Array* const array :
             {words_[now].get(), before, low_[now].get(), increment_.get(), increment_low_.get()}) {
            Uniforms uniforms;
            uniforms.set("array_number", number++);
            if (array == nullptr) continue;
            const std::size_t count = array->bytes() / sizeof(std::uint32_t);
            uniforms.set("count", int(count));
            device_->dispatch_once({"hash"}, count, uniforms, {{0, array}, {1, sums.get()}}, {});
        }
        device_->wait();
        device_->download(*sums, std::as_writable_bytes(std::span(hash)));
    });
    device_->check("hashing the state");
    return layout::text_of(hash);
}

template <class Real>
std::optional<Divergence> ComputeBackend<Real>::divergence() {
    if (monitor_.every == 0) return std::nullopt;
    std::uint32_t check_number = never_found;
    device_->use("checking for divergence",
                 [&] { device_->download(*found_, std::as_writable_bytes(std::span(&check_number, 1))); });
    device_->check("checking for divergence");
    if (check_number == never_found) return std::nullopt;
    const std::int64_t found = std::int64_t(check_number) * monitor_.every;
    return Divergence{found - monitor_.every, found};
}

template <class Real>
WorkCount ComputeBackend<Real>::count_work() {
    const glm::ivec3 g = layout_.groups;
    WorkCount work{{"work_groups", std::uint64_t(g.x) * std::uint64_t(g.y) * std::uint64_t(g.z)}};
    device_->use("counting work", [&] {
        if (const auto invocations = device_->step_counted())
            work["compute_shader_invocations"] = *invocations;
    });
    device_->check("counting work");
    return work;
}

template <class Real>
std::unique_ptr<Feed> ComputeBackend<Real>::feed(const std::vector<std::uint32_t>& particles,
                                                 std::uint32_t buffer) {
    std::unique_ptr<Feed> made;
    if constexpr (std::is_same_v<Real, float>) {
        const auto fed = layout::pack_fed<float>(*problem_, particles, formulation(),
                                                 [&](std::uint32_t i) { return layout_.placement.at(i); });
        const auto state = [&](std::size_t current) -> Arrays {
            return {{words, words_[current].get()}, {words_low, low_[current].get()}};
        };
        device_->use("preparing to show displacements", [&] {
            made = device_->feed(fed, buffer, formulation_defines(formulation()), {state(0), state(1)});
        });
    }
    return made;
}

template <class Real>
Uniforms ComputeBackend<Real>::tool_uniforms(const glm::dvec3& moved) const {
    Uniforms uniforms;
    uniforms.set("count", int(problem_->tool.particles.size()));
    uniforms.set("stiffness", Real(problem_->tool.stiffness));
    uniforms.set("moved", glm::vec<3, Real>(moved));
    return uniforms;
}

template <class Real>
void ComputeBackend<Real>::move_tool(const glm::dvec3& displacement) {
    device_->use("moving the tool", [&] {
        for (const std::shared_ptr<Pass>& pass : tool_) device_->set(*pass, tool_uniforms(displacement));
    });
}

template <class Real>
glm::dvec3 ComputeBackend<Real>::tool_force() {
    if (device_->steps() == 0) return glm::dvec3(0);
    std::vector<layout::HeldForce<Real>> forces(problem_->tool.particles.size());
    device_->use("reading the tool's force",
                 [&] { device_->download(*forces_, std::as_writable_bytes(std::span(forces))); });
    device_->check("reading the tool's force");
    return layout::force_on_tool(forces);
}

template <class Real>
void ComputeBackend<Real>::edit(const Problem& edited, const SpringEdit& edit) {
    problem_ = &edited;
    if (edit.empty()) return;
    device_->use("editing", [&] { enqueue_edit(edited, edit); });
}

template <class Real>
std::vector<const Array*> ComputeBackend<Real>::parts_of(unsigned binding) {
    std::vector<const Array*> parts;
    if (const auto list = addressed_.find(binding); list != addressed_.end()) {
        for (const auto& part : list->second.parts) parts.push_back(part.get());
    } else if (own_[binding]) {
        parts.push_back(own_[binding].get());
    }
    return parts;
}

template <class Real>
void ComputeBackend<Real>::lay_out_anew() {
    device_->wait();
    layout_ = lay_out(*problem_);
    held_bytes_ = bytes_needed(*problem_);
    make_step();
    tell_steps();
    compile_time_ += device_->take_compile_time();
    std::vector<std::uint32_t> all(problem_->particle_count());
    std::iota(all.begin(), all.end(), 0U);
    write_bits(all, layout_.bits);
}

template <class Real>
void ComputeBackend<Real>::write_bits(std::span<const std::uint32_t> particles,
                                      std::span<const std::uint32_t> bits) {
    if (particles.empty()) return;
    std::vector<std::uint32_t> edited;
    edited.reserve(2 * particles.size());
    for (std::size_t n = 0; n < particles.size(); ++n) {
        edited.push_back(std::uint32_t(layout_.placement.at(particles[n])));
        edited.push_back(bits[n]);
    }
    Uniforms uniforms;
    uniforms.set("count", int(particles.size()));
    device_->dispatch_once({"edit_bits"}, particles.size(), uniforms, {{0, words_[device_->current()].get()}},
                           {{1, std::as_bytes(std::span(edited))}});
}

template <class Real>
void ComputeBackend<Real>::measure(const Array& squares, std::size_t count, int stride, int offset) {
    Uniforms uniforms;
    uniforms.set("count", int(count));
    uniforms.set("stride", stride);
    uniforms.set("offset", offset);
    device_->dispatch_once({"measure"}, count, uniforms, {{0, &squares}}, {});
    device_->wait();
}

template <class Real>
void ComputeBackend<Real>::measure_numbers(std::span<Real> squares) {
    const std::unique_ptr<Array> array = device_->make(std::as_bytes(squares));
    measure(*array, squares.size(), 1, 0);
    device_->download(*array, std::as_writable_bytes(squares));
}

template <class Real>
DeviceLimits ComputeBackend<Real>::measure_limits() {
    DeviceLimits limits;
    device_->use("measuring limits", [&] { limits = glsl::measure_limits(*device_); });
    device_->check("measuring limits");
    return limits;
}

template <class Real>
std::optional<double> ComputeBackend<Real>::own_launch_seconds() {
    if (!device_->launches_differ()) return std::nullopt;
    double seconds = 0;
    device_->use("measuring limits", [&] { seconds = measure_launch(*device_); });
    return seconds;
}

template <class Real>
void ComputeBackend<Real>::mark(Backend::Mark which) {
    device_->use("timing", [&] { device_->mark(which == Backend::Mark::end); });
}

template <class Real>
double ComputeBackend<Real>::seconds_between_marks() const {
    double seconds = 0;
    device_->use("timing", [&] { seconds = device_->seconds_between_marks(); });
    return seconds;
}

template class ComputeBackend<float>;
template class ComputeBackend<double>;

}  // namespace voxspring::glsl
