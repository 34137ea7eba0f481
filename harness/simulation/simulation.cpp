#include "harness/simulation/simulation.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <stdexcept>
#include <utility>

#include "backends/cpu/perturbed_reference.h"
#include "harness/base/files.h"
#include "harness/export/export_formats.h"
#include "harness/scene/stability.h"
#include "harness/simulation/picking.h"

namespace voxspring {
namespace {

constexpr const char* not_finite = "the state is no longer finite";

/// The springs of the hand, and the stitches, may each use this fraction of room_for_springs(). The fraction
/// is less than half, so that the time step stays stable with both.
constexpr double share_of_room = 0.4;

/// The largest omega^2 for which `time_step` is stable, where omega is the largest angular frequency of a
/// body. `damping` is the share of the velocity that is lost per step.
double frequency_squared_at(double time_step, double damping) {
    return 4 * (1 - damping / 2) / (time_step * time_step);
}

/// By how much omega^2 may grow before the scene's time step becomes unstable. A spring between a particle of
/// mass m and a fixed point adds at most its stiffness divided by m. The result is 0 if the scene's time step
/// is the stable one, and negative if it is larger.
double room_for_springs(const Scene& scene) {
    const double damping = scene.problem.damping;
    return frequency_squared_at(scene.problem.time_step, damping) -
           frequency_squared_at(scene.stable_time_step, damping);
}

/// The loads of `problem`. The result is empty if `problem` has a tool and all loads are 0, since take_hold()
/// adds such loads.
std::vector<glm::dvec3> loads_without_tool(const Problem& problem) {
    if (!problem.has_tool()) return problem.load;
    const bool none = std::all_of(problem.load.begin(), problem.load.end(),
                                  [](const glm::dvec3& load) { return load == glm::dvec3(0); });
    return none ? std::vector<glm::dvec3>{} : problem.load;
}

/// A pointer to `problem` that does not own it. `problem` must outlive all copies of the pointer.
std::shared_ptr<const Problem> not_owned(const Problem& problem) {
    return {std::shared_ptr<const Problem>{}, &problem};
}

}  // namespace

void Simulation::Running::upload(std::shared_ptr<const Problem> problem, const State& state) {
    backend->upload(*problem, state);
    uploaded = std::move(problem);
    ++uploads;
}

template <class Use>
decltype(auto) Simulation::ask(Use use) {
    if (failure_) throw DeviceError(*failure_);
    try {
        return use(*main_.backend);
    } catch (const DeviceError& error) {
        failure_ = error.what();
        throw;
    }
}

template <class Use>
void Simulation::tell(Use use) {
    ask(use);
    if (compares()) use(*other_.backend);
}

Simulation::Simulation(Scene scene, const BackendSpec& spec, std::unique_ptr<Backend> made)
    : scene_(std::move(scene)), spec_(spec), problem_(scene_.problem) {
    main_.backend = made ? std::move(made) : spec.make();
    if (const std::string why = refusal(*main_.backend, problem_, 0); !why.empty())
        throw std::runtime_error(spec.entry->name + " cannot run " + scene_.name + ": " + why);
    main_.upload(not_owned(scene_.problem), scene_.state);
    reset_to_step_zero();
}

std::string Simulation::refusal(const Backend& backend, const Problem& problem, std::size_t next_edit) const {
    std::string why = backend.unsupported(problem);
    const auto leaves = [](const ScheduledEdit& scheduled) { return scheduled.edit.leaves_lattice(); };
    const auto first =
        std::find_if(scene_.edits.begin() + std::ptrdiff_t(next_edit), scene_.edits.end(), leaves);
    // A backend that supports the problem also supports all edits that add lattice springs only.
    if (!why.empty() || first == scene_.edits.end()) return why;
    Problem joined = problem;
    for (auto scheduled = first; scheduled != scene_.edits.end(); ++scheduled) {
        const std::vector<Spring>& beyond = scheduled->edit.added.beyond;
        joined.springs.insert(joined.springs.end(), beyond.begin(), beyond.end());
    }
    why = backend.unsupported(joined);
    if (!why.empty()) why += fmt::format(" (edit after step {})", first->step);
    return why;
}

void Simulation::reset_to_step_zero() {
    steps_ = 0;
    next_edit_ = 0;
    edits_as_scheduled_ = true;
    tick_ = -1;
    follows_motion_ = !scene_.tool_motion.empty();
    holds_ = false;
    moved_ = glm::dvec3(0);
    stitches_.clear();
    kept_ = {.state = scene_.state.in_full(scene_.problem.particle_count()),
             .label = spec_.label(),
             .springs_version = springs_version_,
             .mask = scene_.problem.lattice.mask,
             .springs = scene_.problem.springs};
    is_latest_ = false;
}

// --- Steps ------------------------------------------------------------------------------------------------

void Simulation::step(int count) {
    const std::int64_t end = steps_ + count;
    while (steps_ < end) {
        while (next_edit_ < scene_.edits.size() && scene_.edits[next_edit_].step <= steps_) make_next_edit();
        follow_motion();
        std::int64_t until = end;
        if (next_edit_ < scene_.edits.size())
            until = std::min<std::int64_t>(until, scene_.edits[next_edit_].step);
        if (follows_motion_) until = std::min(until, (tick_ + 1) * scene_.tool_motion.every);
        tell([&](Backend& backend) { backend.step(int(until - steps_)); });
        steps_ = until;
        is_latest_ = false;
    }
}

void Simulation::make_next_edit() {
    const SpringDifference& edit = scene_.edits[next_edit_++].edit;
    if (edits_as_scheduled_) {
        tell_of(SpringEditor(problem_).make(edit));
        return;
    }
    std::vector<std::pair<std::uint32_t, std::uint32_t>> removed;
    for (const ChangedSpring& changed : changed_springs(scene_.problem, edit.removed))
        removed.emplace_back(changed.spring.first, changed.spring.second);
    if (!removed.empty()) change_if_supported([&](SpringEditor& editor) { return editor.cut(removed); });
    const std::vector<ChangedSpring> added = changed_springs(scene_.problem, edit.added);
    if (!added.empty()) change_if_supported([&](SpringEditor& editor) { return editor.join(added); });
}

void Simulation::follow_motion() {
    if (!follows_motion_) return;
    const ToolMotion& motion = scene_.tool_motion;
    const std::int64_t tick = steps_ / motion.every;
    if (tick == tick_) return;
    const glm::dvec3 at = motion.at_step(steps_, scene_.problem.time_step);
    tell([&](Backend& backend) { backend.tool()->move_tool(at); });
    tick_ = tick;
}

const State& Simulation::state() {
    if (!is_latest_) {
        State now = ask([](Backend& backend) { return backend.download(); });
        if (finite(now)) {
            broken_.reset();
            kept_.state = std::move(now);
            kept_.steps = steps_;
            kept_.label = spec_.label();
        } else {
            broken_ = std::move(now);
        }
        is_latest_ = true;
    }
    if (broken_) return *broken_;
    if (kept_.springs_version != springs_version_) {
        kept_.springs_version = springs_version_;
        kept_.mask = problem_.lattice.mask;
        kept_.springs = problem_.springs;
    }
    kept_.next_edit = next_edit_;
    return kept_.state;
}

bool Simulation::is_broken() {
    (void)state();
    return broken_.has_value();
}

// --- The hand ---------------------------------------------------------------------------------------------

std::string Simulation::take_hold(const glm::dvec3& place, double radius, double stiffness) {
    // Written so that NaN, which fails every comparison, is refused.
    if (!(radius >= 0 && stiffness > 0))
        return fmt::format("a hand needs a radius of at least 0 and a stiffness above 0, not {:g} and {:g}",
                           radius, stiffness);
    const double room = room_for_springs(scene_);
    if (room <= 0) {
        return fmt::format(
            "the time step {:g} is too large to add a hand's springs: without them {:g} is stable",
            scene_.problem.time_step, scene_.stable_time_step);
    }
    if (is_broken()) return not_finite;
    Tool tool;
    tool.particles = Places(problem_, state()).near(place, radius, max_held);
    tool.stiffness = stiffness / double(tool.particles.size());
    for (const std::uint32_t i : tool.particles) {
        tool.held.push_back(state().displacement[i]);
        tool.stiffness = std::min(tool.stiffness, share_of_room * room * problem_.material_of(i).mass);
    }
    Problem next = problem_;
    voxspring::take_hold(next, std::move(tool));
    std::string why = ask([&](const Backend& backend) { return refusal(backend, next, next_edit_); });
    if (!why.empty()) return why;
    upload(std::move(next));
    holds_ = true;
    moved_ = glm::dvec3(0);
    follows_motion_ = false;
    return {};
}

void Simulation::drag(const glm::dvec3& moved) {
    if (!holds_) return;
    moved_ = moved;
    tell([&](Backend& backend) { backend.tool()->move_tool(moved); });
}

glm::dvec3 Simulation::force() {
    if (!holds_) return glm::dvec3(0);
    return ask([](Backend& backend) { return backend.tool()->tool_force(); });
}

void Simulation::let_go() {
    if (!holds_) return;
    upload(without_hand());
    holds_ = false;
}

Problem Simulation::without_hand() const {
    Problem problem = problem_;
    if (holds_) {
        problem.tool = {};
        problem.load = loads_without_tool(scene_.problem);
    }
    return problem;
}

void Simulation::upload(Problem next) {
    const auto uploaded = std::make_shared<const Problem>(std::move(next));
    const State& now = state();
    ask([&](Backend&) { main_.upload(uploaded, now); });
    if (compares()) other_.upload(uploaded, other_.backend->download());
    use_tool_of(*uploaded);
}

void Simulation::use_tool_of(const Problem& problem) {
    problem_.tool = problem.tool;
    problem_.load = problem.load;
}

// --- Blade and needle -------------------------------------------------------------------------------------

Simulation::Change Simulation::cut(const std::array<glm::dvec3, 4>& swept) {
    if (is_broken()) return {0, not_finite};
    const auto pairs = Places(problem_, state()).springs_through(swept);
    if (pairs.empty()) return {};
    return by_hand([&](SpringEditor& editor) { return editor.cut(pairs); });
}

Simulation::Change Simulation::suture(const glm::dvec3& a, const glm::dvec3& b, double radius) {
    if (is_broken()) return {0, not_finite};
    const Places places(problem_, state());
    const auto lost = places.lost_springs(scene_.problem, a, b, radius);
    if (!lost.empty()) return by_hand([&](SpringEditor& editor) { return editor.join(lost); });
    const std::pair ends(places.nearest_to(a), places.nearest_to(b));
    if (ends.first == ends.second) return {};
    return stitch(ends);
}

Simulation::Change Simulation::stitch(const std::pair<std::uint32_t, std::uint32_t>& ends) {
    Problem sewn = problem_;
    const SpringEdit edit = SpringEditor(sewn).suture(std::span(&ends, 1));
    if (edit.empty()) return {};
    // `all` has every spring that the problem can have later, whatever is cut and joined.
    Problem all = with_all_springs(scene_);
    all.springs.insert(all.springs.end(), stitches_.begin(), stitches_.end());
    const ChangedSpring& added = edit.added.front();
    const bool is_the_scenes =
        added.bit >= 0 && (scene_.problem.lattice.mask[added.spring.first] >> added.bit & 1U) != 0;
    const bool is_known = std::any_of(stitches_.begin(), stitches_.end(), [&](const Spring& stitch) {
        return stitch.first == added.spring.first && stitch.second == added.spring.second;
    });
    const bool is_new = !is_the_scenes && !is_known;
    if (is_new) {
        const double room = room_for_springs(scene_);
        all.springs.push_back(added.spring);
        const double stable = frequency_squared_at(scene_.stable_time_step, scene_.problem.damping);
        if (frequency_bound_squared(all) > stable + share_of_room * room)
            return {0, "another stitch between these particles could make the time step unstable"};
    }
    Change change = by_hand([&](SpringEditor& editor) { return editor.join(edit.added); });
    if (is_new && change.springs > 0) stitches_.push_back(added.spring);
    return change;
}

template <class Find>
Simulation::Change Simulation::by_hand(Find find) {
    Change change = change_if_supported(find);
    if (change.springs > 0) edits_as_scheduled_ = false;
    return change;
}

template <class Find>
Simulation::Change Simulation::change_if_supported(Find find) {
    Problem edited = problem_;
    SpringEditor editor(edited);
    const SpringEdit edit = find(editor);
    if (edit.empty()) return {};
    std::string why = ask([&](const Backend& backend) { return refusal(backend, edited, next_edit_); });
    if (!why.empty()) return {0, std::move(why)};
    apply(problem_, edit);
    tell_of(edit);
    return {edit.removed.size() + edit.added.size(), {}};
}

void Simulation::tell_of(const SpringEdit& edit) {
    ++springs_version_;
    tell([&](Backend& backend) { backend.edit(problem_, edit); });
}

// --- The whole simulation ---------------------------------------------------------------------------------

void Simulation::reset() {
    ask([&](Backend&) { main_.upload(not_owned(scene_.problem), scene_.state); });
    problem_.lattice.mask = scene_.problem.lattice.mask;
    problem_.springs = scene_.problem.springs;
    use_tool_of(scene_.problem);
    ++springs_version_;
    reset_to_step_zero();
    if (compares()) other_.upload(not_owned(scene_.problem), state());
}

std::string Simulation::switch_to(const BackendSpec& spec, const std::function<void()>& before_replaced) {
    if (!failure_) {
        try {
            if (is_broken()) return not_finite;
        } catch (const DeviceError&) {
            // The new backend goes on from the state that was kept last, as after an earlier DeviceError.
        }
    }
    Problem problem = without_hand();
    problem.lattice.mask = kept_.mask;
    problem.springs = kept_.springs;
    const auto uploaded = std::make_shared<const Problem>(std::move(problem));
    Running next{.backend = nullptr, .uploaded = nullptr, .uploads = main_.uploads};
    try {
        next.backend = spec.make();
        std::string why = refusal(*next.backend, *uploaded, kept_.next_edit);
        if (!why.empty()) return why;
        next.upload(uploaded, kept_.state);
    } catch (const std::exception& error) {
        return error.what();
    }
    if (compares()) other_.upload(uploaded, failure_ ? kept_.state : other_.backend->download());
    if (before_replaced) before_replaced();
    main_ = std::move(next);
    spec_ = spec;
    failure_.reset();
    is_latest_ = false;
    use_tool_of(*uploaded);
    holds_ = false;
    tick_ = -1;  // the upload has put the scene's tool to the place where it took hold
    steps_ = kept_.steps;
    next_edit_ = kept_.next_edit;
    if (kept_.springs_version != springs_version_) {
        problem_.lattice.mask = kept_.mask;
        problem_.springs = kept_.springs;
        kept_.springs_version = ++springs_version_;
    }
    return {};
}

void Simulation::save(const std::filesystem::path& file) const {
    Problem problem = scene_.problem;
    problem.lattice.mask = kept_.mask;
    problem.springs = kept_.springs;
    const double time = double(kept_.steps) * problem.time_step;
    write_atomically(file, npz({scene_, problem, kept_.state, kept_.steps, time, kept_.label}));
}

// --- Comparison with float64 ------------------------------------------------------------------------------

std::string Simulation::compare(bool on) {
    if (on == compares()) return {};
    if (!on) {
        other_ = {};
        return {};
    }
    if (problem_.particle_count() > max_compared) {
        return fmt::format(
            "a body of {} particles is too large to compare with float64: at most {} are accepted",
            problem_.particle_count(), max_compared);
    }
    if (is_broken()) return not_finite;
    Running other;
    other.backend = make_perturbed_reference({});  // float64 without perturbations; accepts every problem
    other.upload(std::make_shared<const Problem>(problem_), state());
    if (holds_) other.backend->tool()->move_tool(moved_);
    tick_ = -1;  // makes the next step() move the scene's tool again, now on both backends
    other_ = std::move(other);
    return {};
}

std::vector<double> Simulation::errors() {
    if (!compares()) return {};
    const std::vector<glm::dvec3>& here = state().displacement;
    const State there = other_.backend->download();
    std::vector<double> errors(here.size());
#pragma omp parallel for schedule(static)
    for (std::size_t i = 0; i < errors.size(); ++i) errors[i] = glm::distance(here[i], there.displacement[i]);
    return errors;
}

}  // namespace voxspring
