// A scene on a backend: its steps, with its edits between them.
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
/// What a backend is told of an edit takes tens of times the bytes that the scene keeps of it. The first
/// edits, up to max_prepared_bytes, are made ready by the constructor, so that timed steps do not wait for
/// that; later ones when they are due.
class SceneRunner {
public:
    static constexpr std::size_t max_prepared_bytes = std::size_t(16) << 20;

    /// The scene must outlive it.
    explicit SceneRunner(const Scene& scene);
    SceneRunner(const SceneRunner&) = delete;
    SceneRunner& operator=(const SceneRunner&) = delete;

    /// Empty, or why `backend` cannot run the scene from its first edit to its last.
    std::string unsupported(const Backend& backend);

    /// From the next rewind() on the scene starts from `state`, which it reached after `step` steps, instead
    /// of from its own at step 0. `state` must outlive this.
    void start_from(int step, const State& state);
    /// Stands at the state that the scene starts from, with the edits made before it: uploads it, or has the
    /// backend go back to what keep_start() kept.
    void rewind(Backend& backend);
    /// For those who rewind often, right after the first rewind(): later ones of this backend copy the state
    /// on the device where it can, as long as edits leave the springs that there were at the start. Returns
    /// whether it can: of a scene without edits nobody asks for the state at the start any more.
    bool keep_start(Backend& backend);
    /// Goes on from the last rewind() by `steps` steps, the edits due before them and the moves of the tool.
    /// Asynchronous, as step() is. `edit` takes the place of Backend::edit() where somebody has to watch.
    using Edit = std::function<void(const Problem& edited, const SpringEdit& edit)>;
    void run(Backend& backend, int steps, const Edit& edit = {});

    /// The problem as the edits up to here left it.
    const Problem& problem() const { return edited_ ? *edited_ : scene_.problem; }

    /// Edits due within the first `steps` steps.
    int edits_within(int steps) const;

private:
    void prepare();
    void restart();
    const Problem& start_problem() const { return uploaded_ ? *uploaded_ : scene_.problem; }
    bool has_the_springs_of_the_start() const;
    /// Steps up to step `end`; the tool moves as the scene has it.
    void step_to(Backend& backend, int end);

    const Scene& scene_;
    std::optional<Problem> edited_;  ///< the problem as the edits have left it; empty where a scene has none
    std::optional<SpringEditor> editor_;    ///< of `edited_`
    std::vector<SpringEdit> prepared_;      ///< the scene's first edits
    std::optional<Problem> uploaded_;       ///< the problem at a start other than the scene's own; else empty
    const State* start_ = nullptr;          ///< null: the scene's own
    int first_ = 0;                         ///< step of the start
    const Backend* keeps_start_ = nullptr;  ///< null: none
    std::size_t next_ = 0;                  ///< edit
    int step_ = 0;
    int tick_ = -1;  ///< of the tool's motion, which the tool is at; -1: none yet
};

/// The scene's problem as the edits within its first `steps` steps leave it.
Problem problem_after(const Scene& scene, int steps);

}  // namespace voxspring
