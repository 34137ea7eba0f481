// A body that somebody watches, holds, cuts and sews while it steps: a scene on one backend after another.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// What a window shows, apart from how: nothing here knows of a window. Places are rest position plus
/// displacement, in the scene's unit of length.
///
/// Where something cannot be done nothing changes, and a text says why; empty: done. A DeviceError passes
/// through. After one the backend is good for nothing more: whatever asks it throws the same again. save()
/// still writes the state that was kept last, and switch_to() goes on from there. Not thread-safe.
class Simulation {
public:
    /// Stands at the scene's start. `made`: a backend of that specification, where there is one already
    /// (AutoChoice); else it is made. Throws Unavailable, DeviceError and, where the backend refuses the
    /// scene, std::runtime_error.
    Simulation(Scene scene, const BackendSpec& spec, std::unique_ptr<Backend> made = {});
    Simulation(const Simulation&) = delete;
    Simulation& operator=(const Simulation&) = delete;

    const Scene& scene() const { return scene_; }
    /// As cuts, sutures and the hand have left it so far.
    const Problem& problem() const { return problem_; }
    /// For capabilities() and timed(); what steps or changes it goes through here.
    Backend& backend() { return *main_.backend; }
    std::string backend_label() const { return spec_.label(); }
    std::int64_t steps() const { return steps_; }  ///< since the scene's start
    /// Grows with each change of springs, so that who draws the surface knows when to find it anew.
    std::uint64_t springs_version() const { return springs_version_; }
    /// Grows with each upload, after which what refers to the backend's state (Backend::feed()) is made anew;
    /// never 0.
    std::uint64_t uploads() const { return main_.uploads; }

    /// Takes steps, with the scene's edits that are due between them and, until the hand first takes hold,
    /// the moves of the scene's own tool. Of an edit that finds springs cut or joined by hand only what still
    /// applies is made. May return before they have run, as Backend::step() does.
    void step(int count);
    /// As the steps so far leave it: downloaded, unless nothing has stepped since. To be used until the next
    /// call of anything that is not const. Where it is finite() it is kept, with the springs of now, see
    /// save().
    const State& state();
    void keep_state() { (void)state(); }
    std::int64_t kept_steps() const { return kept_.steps; }  ///< of the state that was kept last

    // --- The hand ---------------------------------------------------------------------------------------

    /// Takes hold of the particles within `radius` of `place`, of the nearest one at least and of the nearest
    /// max_held at most. What was held before is let go, the scene's own tool too. `stiffness`, force per
    /// length, is that of all of the hand's springs together; less where the time step would not bear it:
    /// each particle gets no more than two fifths of what the scene's stable time step leaves for springs
    /// beside its own.
    std::string take_hold(const glm::dvec3& place, double radius, double stiffness);
    static constexpr std::size_t max_held = 4096;
    bool holds() const { return holds_; }
    /// The hand has moved by that since it took hold. Nothing without a hold.
    void drag(const glm::dvec3& moved);
    /// On the hand, in the latest step; 0 without a hold or a step since it took hold. Synchronizes.
    glm::dvec3 force();
    /// Takes the tool away, and the loads where the scene has none of its own.
    void let_go();

    // --- Blade and needle -------------------------------------------------------------------------------

    struct Change {
        std::size_t springs = 0;  ///< cut, or joined
        std::string refused;      ///< why none was; empty where there was none to change
    };
    /// Cuts every spring that goes through what one stretch of a stroke has swept: the blade's edge from
    /// swept[0] to swept[1] at its beginning and from swept[2] to swept[3] at its end, places. The quad is
    /// the two triangles on either side of the line from swept[0] to swept[3].
    Change cut(const std::array<glm::dvec3, 4>& swept);
    /// Joins again what joined particles at the scene's start, where both are within `radius` of the line
    /// from `a` to `b`, places, and no spring joins them now. Where there is nothing of that kind it joins
    /// the two particles nearest to `a` and to `b` by a spring of its own, unless they are one or are joined.
    /// Refuses that where the backend takes no springs beyond the lattice, or where the stitches of the
    /// needle would take more than two fifths of what the scene's stable time step leaves.
    Change suture(const glm::dvec3& a, const glm::dvec3& b, double radius);

    // --- The whole --------------------------------------------------------------------------------------

    /// Back to the scene's start, without what the hand has done.
    void reset();
    /// Goes on with another backend, from the state of now; or, after a DeviceError, from the state that was
    /// kept last, its step and its springs. What the hand held is let go. Refuses where the backend is
    /// unavailable, fails, or refuses the problem or one of the scene's edits to come, and where the state is
    /// not finite.
    std::string switch_to(const BackendSpec& spec);
    /// Writes the state that was kept last as `voxspring run --out FILE.npz` does; the scene's start before
    /// any. `run --resume` goes on from it with its springs, and with the scene's own tool. Throws
    /// std::system_error.
    void save(const std::filesystem::path& npz) const;

    // --- Beside float64 ---------------------------------------------------------------------------------

    /// From here on, until it is turned off, a float64 simulation on the processor goes along with every
    /// step, edit and move of the hand, from the state of now. Refuses bodies of more than max_compared
    /// particles and states that are not finite.
    std::string compare(bool on);
    static constexpr std::size_t max_compared = 250'000;
    bool compares() const { return other_.backend != nullptr; }
    /// Each particle's distance from that simulation; empty without one. Downloads both.
    std::vector<double> errors();

private:
    /// A backend and what it was uploaded with, which has to stay as it was until the next upload().
    struct Running {
        std::unique_ptr<Backend> backend;
        std::shared_ptr<const Problem> uploaded;
        std::uint64_t uploads = 0;

        void upload(std::shared_ptr<const Problem> problem, const State& state);
    };
    /// All that is needed to go on from a state.
    struct Kept {
        State state;
        std::int64_t steps = 0;
        std::size_t next_edit = 0;
        std::string label;  ///< of the backend that it is of
        std::uint64_t springs_version = 0;
        std::vector<std::uint32_t> mask;  ///< Lattice::mask
        std::vector<Spring> springs;      ///< Problem::springs
    };

    /// What `use` gives of the main backend. Throws what it throws, and after a DeviceError always that.
    template <class Use>
    decltype(auto) ask(Use use);
    /// The same of both backends, one after the other.
    template <class Use>
    void tell(Use use);
    /// Empty, or why `backend` cannot run `problem` and the scene's edits from `next_edit` on.
    std::string refusal(const Backend& backend, const Problem& problem, std::size_t next_edit) const;
    /// Puts everything but the backends and `problem_` at the scene's start.
    void stand_at_start();
    bool is_broken();

    void make_next_edit();
    /// Puts the scene's tool where it is at this step.
    void follow_motion();

    Problem without_hand() const;
    /// Uploads a problem that differs from `problem_` in its tool, at the state of now.
    void upload(Problem next);
    void use_tool_of(const Problem& problem);

    Change stitch(const std::pair<std::uint32_t, std::uint32_t>& ends);
    /// Makes the edit that `find` makes with an editor, unless the backend refuses what it leads to.
    template <class Find>
    Change change_if_supported(Find find);
    template <class Find>
    Change by_hand(Find find);
    /// Has the backends make the edit that `problem_` has by now.
    void tell_of(const SpringEdit& edit);

    const Scene scene_;
    BackendSpec spec_;
    Problem problem_;  ///< after an edit backends refer to it
    Running main_;
    Running other_;                       ///< in float64; none unless there is something to compare with
    std::optional<std::string> failure_;  ///< of the main backend
    std::int64_t steps_ = 0;
    std::size_t next_edit_ = 0;
    bool edits_as_scheduled_ = true;  ///< only the scene has changed springs so far
    std::int64_t tick_ = -1;          ///< of the scene's tool, which is there; -1: where it took hold
    bool follows_motion_ = false;     ///< nobody has taken the tool from the scene
    std::uint64_t springs_version_ = 0;
    bool holds_ = false;
    glm::dvec3 moved_{0};           ///< by the hand
    std::vector<Spring> stitches_;  ///< springs of its own that the needle has ever made
    Kept kept_;
    std::optional<State> broken_;  ///< the state where it is not finite, which is not kept
    bool is_latest_ = false;       ///< the state, `broken_` or else the kept one, is that of now
};

}  // namespace voxspring
