// A body that a user watches, holds, cuts and sews while it steps: a scene on one backend at a time.
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

/// The model behind a window; nothing here depends on the window. Places are rest position plus displacement,
/// in the scene's unit of length.
///
/// A function that returns a text returns the reason why it changed nothing, or an empty text if it did what
/// was asked. A DeviceError passes through. After a DeviceError the backend is unusable: every function that
/// needs it throws the same error again. save() still writes the state that was kept last, and switch_to()
/// goes on from that state. Not thread-safe.
class Simulation {
public:
    /// Begins at the scene's start. `made` is a backend of the specification `spec`, or null: then one is
    /// made. Throws Unavailable, DeviceError and, if the backend refuses the scene, std::runtime_error.
    Simulation(Scene scene, const BackendSpec& spec, std::unique_ptr<Backend> made = {});
    Simulation(const Simulation&) = delete;
    Simulation& operator=(const Simulation&) = delete;

    const Scene& scene() const { return scene_; }
    /// The problem after all edits, cuts and sutures so far, and with the tool that holds now.
    const Problem& problem() const { return problem_; }
    /// The backend, for capabilities() and timed(). Steps and changes must go through this class.
    Backend& backend() { return *main_.backend; }
    std::string backend_label() const { return spec_.label(); }
    std::int64_t steps() const { return steps_; }  ///< number of steps since the scene's start
    /// Grows with each change of springs, so that a painter knows when to rebuild the surface.
    std::uint64_t springs_version() const { return springs_version_; }
    /// Grows with each upload, after which objects that refer to the backend's state (FeedFacet::feed()) must
    /// be made anew. Never 0.
    std::uint64_t uploads() const { return main_.uploads; }

    /// Takes `count` steps, and makes the scene's edits that are due between them. Also moves the scene's
    /// tool, until the hand first takes hold. If springs were cut or joined by hand, only the part of an edit
    /// that still applies is made. May return before the steps have run, as Backend::step() does.
    void step(int count);
    /// The state after the steps so far. It is downloaded, unless no step was taken since the last download.
    /// The reference is valid until the next call of a non-const function. If the state is finite() it is
    /// kept, together with the present springs, for save().
    const State& state();
    void keep_state() { (void)state(); }
    std::int64_t kept_steps() const { return kept_.steps; }  ///< step of the state that was kept last

    // --- The hand ---------------------------------------------------------------------------------------

    /// Takes hold of the particles within `radius` of `place`: at least the nearest one and at most the
    /// nearest max_held. Lets go of what was held before, the scene's tool included. `stiffness`, a force per
    /// length, is the sum over all springs of the hand. It is reduced if the time step would become unstable:
    /// the hand's springs may use at most two fifths of the margin by which omega^2 may grow before that.
    std::string take_hold(const glm::dvec3& place, double radius, double stiffness);
    static constexpr std::size_t max_held = 4096;
    bool holds() const { return holds_; }
    /// Moves the hand to `moved` from where it took hold. Does nothing without a hold.
    void drag(const glm::dvec3& moved);
    /// The force on the hand in the latest step; 0 without a hold, or without a step since it took hold.
    /// Synchronizes.
    glm::dvec3 force();
    /// Removes the hand's tool; does nothing without a hold. Also removes the loads of zero that take_hold()
    /// added if the scene has no loads.
    void let_go();

    // --- Blade and needle -------------------------------------------------------------------------------

    struct Change {
        std::size_t springs = 0;  ///< number of springs cut or joined
        std::string refused;      ///< why the change was refused; empty if it was not
    };
    /// Cuts every spring that passes through the quad that the blade has swept in part of a stroke. At the
    /// beginning of this part the blade's edge lies from swept[0] to swept[1], at the end from swept[2] to
    /// swept[3]. The quad is the two triangles on either side of the line from swept[0] to swept[3].
    Change cut(const std::array<glm::dvec3, 4>& swept);
    /// Restores springs of the scene's start whose two particles are within `radius` of the line from `a` to
    /// `b` and have no spring now. If there is no such spring, a new spring (a stitch) joins the particles
    /// nearest to `a` and to `b`, unless these are one particle or are joined already. A stitch is refused if
    /// the backend does not take springs beyond the lattice, or if all stitches together would take more than
    /// two fifths of the margin that take_hold() describes.
    Change suture(const glm::dvec3& a, const glm::dvec3& b, double radius);

    // --- The whole --------------------------------------------------------------------------------------

    /// Goes back to the scene's start. Undoes all changes by hand, blade and needle.
    void reset();
    /// Goes on with another backend from the present state. After a DeviceError it goes on from the state
    /// that was kept last, with its step and its springs. The hand lets go. Refuses if the backend is
    /// unavailable, fails, or does not support the problem or one of the scene's later edits, or if the state
    /// is not finite.
    std::string switch_to(const BackendSpec& spec);
    /// Writes the state that was kept last, or else the scene's start, as `voxspring run --out FILE.npz`
    /// does. `run --resume` goes on from the file, with the springs in it and with the scene's tool. Throws
    /// std::system_error.
    void save(const std::filesystem::path& npz) const;

    // --- Beside float64 ---------------------------------------------------------------------------------

    /// Turns on or off a second simulation, in float64 on the processor. It starts from the present state and
    /// repeats every step, edit and move of the hand. Refuses bodies of more than max_compared particles and
    /// states that are not finite.
    std::string compare(bool on);
    static constexpr std::size_t max_compared = 250'000;
    bool compares() const { return other_.backend != nullptr; }
    /// Each particle's distance from its place in the float64 simulation; empty if compare() is off.
    /// Downloads both states.
    std::vector<double> errors();

private:
    /// A backend and the problem that was uploaded to it, which must stay unchanged until the next upload().
    struct Running {
        std::unique_ptr<Backend> backend;
        std::shared_ptr<const Problem> uploaded;
        std::uint64_t uploads = 0;

        void upload(std::shared_ptr<const Problem> problem, const State& state);
    };
    /// Everything that is needed to go on from a state.
    struct Kept {
        State state;
        std::int64_t steps = 0;
        std::size_t next_edit = 0;
        std::string label;  ///< label of the backend that computed the state
        std::uint64_t springs_version = 0;
        std::vector<std::uint32_t> mask;  ///< Lattice::mask
        std::vector<Spring> springs;      ///< Problem::springs
    };

    /// Calls use(main backend) and returns the result. After a DeviceError, every call throws this error
    /// again.
    template <class Use>
    decltype(auto) ask(Use use);
    /// Calls `use` with the main backend and then, if compare() is on, with the float64 one.
    template <class Use>
    void tell(Use use);
    /// Empty, or why `backend` cannot run `problem` and the scene's edits from `next_edit` on.
    std::string refusal(const Backend& backend, const Problem& problem, std::size_t next_edit) const;
    /// Resets everything except the backends and `problem_` to the scene's start.
    void reset_to_step_zero();
    bool is_broken();

    void make_next_edit();
    /// Moves the scene's tool to its place at this step.
    void follow_motion();

    Problem without_hand() const;
    /// Uploads, with the present state, a problem that differs from `problem_` only in tool and loads.
    void upload(Problem next);
    void use_tool_of(const Problem& problem);

    Change stitch(const std::pair<std::uint32_t, std::uint32_t>& ends);
    /// Makes the edit that `find(editor)` returns, unless the backend does not support the resulting problem.
    template <class Find>
    Change change_if_supported(Find find);
    template <class Find>
    Change by_hand(Find find);
    /// Passes `edit`, which has been applied to `problem_`, to the backends.
    void tell_of(const SpringEdit& edit);

    const Scene scene_;
    BackendSpec spec_;
    Problem problem_;  ///< after an edit the backends keep a reference to this
    Running main_;
    Running other_;                       ///< the float64 simulation, if compare() has turned it on
    std::optional<std::string> failure_;  ///< the DeviceError of the main backend
    std::int64_t steps_ = 0;
    std::size_t next_edit_ = 0;
    bool edits_as_scheduled_ = true;  ///< whether only the scene's edits have changed springs
    /// Number of the latest move of the scene's tool; -1: the tool is where it took hold.
    std::int64_t tick_ = -1;
    bool follows_motion_ = false;  ///< whether the scene's tool still follows its motion
    std::uint64_t springs_version_ = 0;
    bool holds_ = false;
    glm::dvec3 moved_{0};           ///< how far the hand has moved since it took hold
    std::vector<Spring> stitches_;  ///< new springs by the needle since the start, also those cut later
    Kept kept_;
    /// The latest downloaded state if it is not finite; `kept_` is then an earlier state.
    std::optional<State> broken_;
    /// Whether the state after `steps_` steps has been downloaded, to `broken_` or `kept_`.
    bool is_latest_ = false;
};

}  // namespace voxspring
