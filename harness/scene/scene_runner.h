// Runs a scene on a backend: its steps, and its edits between them.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/physics/edit.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// Runs a scene on one backend at a time.
///
/// A backend receives an edit as a SpringEdit, which takes tens of times as much memory as the
/// SpringDifference that the scene keeps. The constructor makes the SpringEdits of the first edits, up to
/// max_prepared_bytes, so that timed steps do not wait for them. Later ones are made when they are due.
class SceneRunner {
public:
    static constexpr std::size_t max_prepared_bytes = std::size_t(16) << 20;

    /// The scene must outlive this.
    explicit SceneRunner(const Scene& scene);
    SceneRunner(const SceneRunner&) = delete;
    SceneRunner& operator=(const SceneRunner&) = delete;

    /// Returns an empty text, or why `backend` cannot run the scene with all its edits. The caller must call
    /// rewind() before the next run().
    std::string unsupported(const Backend& backend);

    /// Replaces the scene's start, from the next rewind() on, by `state`, which the scene reached after
    /// `step` steps. `state` must outlive this.
    void start_from(int step, const State& state);
    /// Goes back to the start, and makes the edits that are due before the start (start_from()). Uploads the
    /// state, or lets the backend restore the state that keep_start() kept.
    void rewind(Backend& backend);
    /// Speeds up frequent rewinds: later rewinds of this backend copy the state on the device, as long as the
    /// springs are those of the start. To be called right after the first rewind(). Returns whether the
    /// backend can do so. If it can and the scene has no edits, the state at the start is not read any more.
    bool keep_start(Backend& backend);
    /// A function that run() calls instead of Backend::edit(), for callers that have to observe edits.
    using Edit = std::function<void(const Problem& edited, const SpringEdit& edit)>;
    /// Runs `steps` further steps, makes the edits that are due before each of them, and moves the tool. May
    /// return before the steps have run, as Backend::step() does.
    void run(Backend& backend, int steps, const Edit& edit = {});

    /// The problem as the edits so far left it.
    const Problem& problem() const { return edited_ ? *edited_ : scene_.problem; }

    /// The number of edits that are due within the first `steps` steps.
    int edits_within(int steps) const;

private:
    void restart();
    const Problem& start_problem() const { return uploaded_ ? *uploaded_ : scene_.problem; }
    bool has_the_springs_of_the_start() const;
    /// Steps until `end` steps are done, and moves the tool as the scene says.
    void step_to(Backend& backend, int end);

    const Scene& scene_;
    std::optional<Problem> edited_;       ///< problem after the edits so far; empty if the scene has no edits
    std::optional<SpringEditor> editor_;  ///< changes `edited_`
    std::vector<SpringEdit> prepared_;    ///< the scene's first edits, as a backend receives them
    /// The problem after the edits before step `first_`; empty: the scene's problem.
    std::optional<Problem> uploaded_;
    const State* start_ = nullptr;          ///< the state to start from; null: the scene's state
    int first_ = 0;                         ///< number of steps before the start
    const Backend* keeps_start_ = nullptr;  ///< the backend that keeps the start; null: none
    std::size_t next_ = 0;                  ///< index of the next edit
    int step_ = 0;
    int tick_ = -1;  ///< number of the tool's latest move; -1: it has not moved yet
};

/// The scene's problem as the edits within the first `steps` steps leave it.
Problem problem_after(const Scene& scene, int steps);

}  // namespace voxspring
