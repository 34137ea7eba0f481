#include "harness/scene/scene_runner.h"

#include <algorithm>
#include <utility>

namespace voxspring {

namespace {

std::size_t bytes_of(const SpringEdit& edit) {
    return edit.removed.capacity() * sizeof(ChangedSpring) + edit.added.capacity() * sizeof(ChangedSpring) +
           edit.touched.capacity() * sizeof(SpringEdit::Touched) +
           edit.listed.capacity() * sizeof(ListedSpring);
}

}  // namespace

SceneRunner::SceneRunner(const Scene& scene) : scene_(scene) {
    if (scene.edits.empty()) return;
    edited_ = scene.problem;
    editor_.emplace(*edited_);
    std::size_t bytes = 0;
    for (const ScheduledEdit& scheduled : scene.edits) {
        SpringEdit edit = editor_->make(scheduled.edit);
        bytes += bytes_of(edit);
        if (bytes > max_prepared_bytes) break;
        prepared_.push_back(std::move(edit));
    }
    restart();
}

void SceneRunner::restart() {
    step_ = 0;
    next_ = 0;
    tick_ = -1;
    if (!edited_) return;
    edited_->lattice.mask = scene_.problem.lattice.mask;
    edited_->springs = scene_.problem.springs;
}

std::string SceneRunner::unsupported(const Backend& backend) {
    std::string reason = backend.unsupported(scene_.problem);
    restart();
    for (const ScheduledEdit& scheduled : scene_.edits) {
        if (!reason.empty()) break;
        apply(*edited_, scheduled.edit);
        // A backend that supports the scene's start also supports edits that stay within the lattice.
        if (!scheduled.edit.leaves_lattice()) continue;
        reason = backend.unsupported(*edited_);
        if (!reason.empty()) reason += " (edit after step " + std::to_string(scheduled.step) + ")";
    }
    return reason;
}

void SceneRunner::start_from(int step, const State& state) {
    first_ = step;
    start_ = &state;
    keeps_start_ = nullptr;
    uploaded_.reset();
    if (edited_) uploaded_ = problem_after(scene_, step);
}

bool SceneRunner::has_the_springs_of_the_start() const {
    if (!edited_) return true;
    const Problem& start = start_problem();
    return edited_->lattice.mask == start.lattice.mask && edited_->springs == start.springs;
}

void SceneRunner::rewind(Backend& backend) {
    const bool copies = keeps_start_ == &backend && has_the_springs_of_the_start();
    restart();
    for (; next_ < scene_.edits.size() && scene_.edits[next_].step < first_; ++next_)
        apply(*edited_, scene_.edits[next_].edit);
    step_ = first_;
    if (copies) {
        backend.rewind();
        return;
    }
    // We do not upload edited_, which later edits change: a backend reads the uploaded problem until the next
    // upload.
    backend.upload(start_problem(), start_ != nullptr ? *start_ : scene_.state);
    if (keeps_start_ == &backend && !backend.keep_start()) keeps_start_ = nullptr;
}

bool SceneRunner::keep_start(Backend& backend) {
    if (backend.keep_start()) keeps_start_ = &backend;
    return keeps_start_ == &backend;
}

void SceneRunner::run(Backend& backend, int steps, const Edit& edit) {
    const int end = step_ + steps;
    for (; next_ < scene_.edits.size() && scene_.edits[next_].step < end; ++next_) {
        const ScheduledEdit& scheduled = scene_.edits[next_];
        step_to(backend, scheduled.step);
        SpringEdit made_now;
        const bool is_prepared = next_ < prepared_.size();
        if (is_prepared) {
            apply(*edited_, prepared_[next_]);
        } else {
            made_now = editor_->make(scheduled.edit);
        }
        const SpringEdit& made = is_prepared ? prepared_[next_] : made_now;
        if (edit) {
            edit(*edited_, made);
        } else {
            backend.edit(*edited_, made);
        }
    }
    step_to(backend, end);
}

void SceneRunner::step_to(Backend& backend, int end) {
    const ToolMotion& motion = scene_.tool_motion;
    while (!motion.empty() && step_ < end) {
        if (const int tick = step_ / motion.every; tick != tick_) {
            backend.tool()->move_tool(motion.at_step(step_, scene_.problem.time_step));
            tick_ = tick;
        }
        const int steps = std::min(end - step_, motion.every - step_ % motion.every);
        backend.step(steps);
        step_ += steps;
    }
    if (motion.empty()) backend.step(end - step_);
    step_ = end;
}

int SceneRunner::edits_within(int steps) const {
    return int(std::count_if(scene_.edits.begin(), scene_.edits.end(),
                             [=](const ScheduledEdit& scheduled) { return scheduled.step < steps; }));
}

Problem problem_after(const Scene& scene, int steps) {
    Problem problem = scene.problem;
    for (const ScheduledEdit& scheduled : scene.edits) {
        if (scheduled.step < steps) apply(problem, scheduled.edit);
    }
    return problem;
}

}  // namespace voxspring
