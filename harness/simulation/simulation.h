// An interactive simulation: one scene on one backend at a time. A user holds, cuts and sews the body while
// it steps.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <glm/vec3.hpp>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/scene/scene.h"

namespace voxspring {

/// The model of an interactive simulation, without its window. Places are rest position plus displacement, in
/// the scene's unit of length. Not thread-safe.
///
/// take_hold(), switch_to() and compare() return the reason why they changed nothing, or an empty text if
/// they did what was asked. A DeviceError of the backend passes through, and makes the backend unusable:
/// every function that needs the backend then throws the same error again. save() still writes the state that
/// was kept last (see state()), and switch_to() goes on from that state with another backend.
class Simulation {
public:
    /// Begins at the scene's start. `made` is a backend of the specification `spec`; if it is null, the
    /// constructor makes the backend. Throws Unavailable, DeviceError and, if the backend does not support
    /// the scene, std::runtime_error.
    Simulation(Scene scene, const BackendSpec& spec, std::unique_ptr<Backend> made = {});
    Simulation(const Simulation&) = delete;
    Simulation& operator=(const Simulation&) = delete;

    const Scene& scene() const { return scene_; }
    /// The problem after all edits, cuts and sutures so far, with the present tool (see take_hold()).
    const Problem& problem() const { return problem_; }
    /// The backend, for calls such as Backend::capabilities(), feeds(), synchronize() and timed(). Steps and
    /// changes must be made by functions of Simulation.
    Backend& backend() { return *main_.backend; }
    std::string backend_label() const { return spec_.label(); }
    std::int64_t steps() const { return steps_; }  ///< number of steps since the scene's start
    /// A number that grows with each change of springs: the surface that is drawn must then be built anew.
    std::uint64_t springs_version() const { return springs_version_; }
    /// A number that grows with each upload to the backend, and is never 0. After an upload, objects that
    /// refer to the backend's state (FeedFacet::feed()) must be made anew.
    std::uint64_t uploads() const { return main_.uploads; }

    /// Takes `count` steps, and makes the scene's edits that are due between them. If the user has cut or
    /// joined springs, only the part of an edit that still applies is made. Also moves the scene's tool,
    /// until take_hold() is called. May return before the backend has run the steps, as Backend::step() does.
    void step(int count);
    /// The state after the steps so far. It is downloaded if a step was taken, or reset() or switch_to() was
    /// called, since the last download. The reference is valid until the next call of a non-const function.
    /// If the state is finite(), it is kept, together with the present springs, for save() and switch_to().
    const State& state();
    void keep_state() { (void)state(); }
    std::int64_t kept_steps() const { return kept_.steps; }  ///< step of the state kept last

    // --- The hand ---------------------------------------------------------------------------------------

    /// The hand takes hold, by springs, of the particles within `radius` of `place`: at least of the nearest
    /// particle and at most of the nearest max_held. What was held before, also by the scene's tool, is let
    /// go. `stiffness`, a force per length, is the sum over all springs of the hand. It is reduced where the
    /// time step might become unstable: the hand's springs may use two fifths of the margin by which the
    /// square of the body's largest angular frequency may grow before the time step becomes unstable. Refuses
    /// a negative radius, a stiffness that is not above 0, and NaN. Also refuses if there is no such margin,
    /// if the backend does not support the tool, or if the present state is not finite.
    std::string take_hold(const glm::dvec3& place, double radius, double stiffness);
    static constexpr std::size_t max_held = 4096;
    bool holds() const { return holds_; }
    /// Moves the hand to the place where it took hold plus `moved`. Does nothing unless the hand holds.
    void drag(const glm::dvec3& moved);
    /// The force on the hand in the latest step; 0 if the hand does not hold, or if no step was taken since
    /// it took hold. Waits until the backend has run its steps.
    glm::dvec3 force();
    /// Lets go of what the hand holds. Does nothing unless the hand holds. Also removes the loads of zero
    /// that take_hold() added if the scene has no loads.
    void let_go();

    // --- Blade and needle -------------------------------------------------------------------------------

    struct Change {
        std::size_t springs = 0;  ///< number of springs cut or joined
        std::string refused;      ///< why the change was refused; empty if it was not refused
    };
    /// Cuts every spring that passes through the quad that the blade's edge sweeps during one movement. The
    /// edge lies from swept[0] to swept[1] before the movement, and from swept[2] to swept[3] after it. The
    /// quad consists of the two triangles on either side of the line from swept[0] to swept[3].
    Change cut(const std::array<glm::dvec3, 4>& swept);
    /// Restores the springs of the scene's start whose two particles are within `radius` of the line from `a`
    /// to `b` and are not joined now. If there is no such spring, a new spring (a stitch) joins the particles
    /// nearest to `a` and to `b`, unless these are one particle or are joined already. A stitch is refused if
    /// its ends are not lattice neighbours and the backend does not support such springs, or if all stitches
    /// together might use more than two fifths of the margin that take_hold() describes.
    Change suture(const glm::dvec3& a, const glm::dvec3& b, double radius);

    // --- The whole simulation ---------------------------------------------------------------------------

    /// Goes back to the scene's start. Undoes all that hand, blade and needle have changed.
    void reset();
    /// Goes on with another backend from the present state or, after a DeviceError, from the state that was
    /// kept last, with its step and its springs. The hand lets go. Refuses if the new backend is unavailable,
    /// fails, or does not support the problem or one of the scene's later edits, or if the present state is
    /// not finite. Otherwise calls `before_replaced` while the present backend still exists.
    std::string switch_to(const BackendSpec& spec, const std::function<void()>& before_replaced = {});
    /// Writes the state that was kept last (at first the scene's start) to the file `npz`, as `voxspring run
    /// --out FILE.npz` does. `voxspring run --resume FILE.npz` continues from this state, with the springs in
    /// the file and with the scene's own tool. Throws std::system_error.
    void save(const std::filesystem::path& npz) const;

    // --- Comparison with float64 ------------------------------------------------------------------------

    /// Turns on or off a second simulation, which runs in float64 on the processor. It starts from the
    /// present state and repeats every step, edit and move of the hand. Refuses a body of more than
    /// max_compared particles, and a state that is not finite.
    std::string compare(bool on);
    static constexpr std::size_t max_compared = 250'000;
    bool compares() const { return other_.backend != nullptr; }
    /// Each particle's distance from its place in the float64 simulation; empty if compare() is off.
    /// Downloads both states.
    std::vector<double> errors();

private:
    /// A backend and the problem that was uploaded to it, which stays unchanged until the next upload().
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

    /// Calls `use` with the main backend and returns the result. After a DeviceError of that backend, every
    /// call throws the same error.
    template <class Use>
    decltype(auto) ask(Use use);
    /// Calls `use` with the main backend and then, if compare() is on, with the float64 one.
    template <class Use>
    void tell(Use use);
    /// Why `backend` cannot run `problem` and the scene's edits from `next_edit` on; empty if it can.
    std::string refusal(const Backend& backend, const Problem& problem, std::size_t next_edit) const;
    /// Resets the members that describe how far the simulation is, what the hand holds and what state is kept
    /// to the scene's start.
    void reset_to_step_zero();
    bool is_broken();  ///< whether the present state is not finite

    void make_next_edit();
    /// Moves the scene's tool to the place that its motion has at the present step.
    void follow_motion();

    /// `problem_` without the tool and the loads that take_hold() has added.
    Problem without_hand() const;
    /// Uploads, with the present state, a problem that differs from `problem_` only in tool and loads.
    void upload(Problem next);
    /// Copies tool and loads of `problem` to `problem_`.
    void use_tool_of(const Problem& problem);

    /// Joins two particles by a new spring; see suture().
    Change stitch(const std::pair<std::uint32_t, std::uint32_t>& ends);
    /// Makes the edit that `find(editor)` returns, unless the backend does not support the resulting problem.
    template <class Find>
    Change change_if_supported(Find find);
    /// change_if_supported() for a change by the user.
    template <class Find>
    Change by_hand(Find find);
    /// Passes `edit`, which has been applied to `problem_`, to the backends.
    void tell_of(const SpringEdit& edit);

    const Scene scene_;
    BackendSpec spec_;
    Problem problem_;  ///< the present problem; after Backend::edit() a backend refers to it
    Running main_;
    Running other_;                       ///< the float64 simulation, if compare() has turned it on
    std::optional<std::string> failure_;  ///< the DeviceError of the main backend
    std::int64_t steps_ = 0;
    std::size_t next_edit_ = 0;
    bool edits_as_scheduled_ = true;  ///< whether only the scene's edits have changed springs
    /// Number of the latest move of the scene's tool, from 0; -1: the tool has not been moved yet.
    std::int64_t tick_ = -1;
    bool follows_motion_ = false;  ///< whether the scene's tool still follows its motion
    std::uint64_t springs_version_ = 0;
    bool holds_ = false;
    glm::dvec3 moved_{0};           ///< how far the hand has moved since it took hold
    std::vector<Spring> stitches_;  ///< all new springs since the scene's start, also if cut later
    Kept kept_;
    /// The latest downloaded state if it is not finite; `kept_` is then an earlier state.
    std::optional<State> broken_;
    /// Whether the state after `steps_` steps has been downloaded, to `broken_` or `kept_`.
    bool is_latest_ = false;
};

}  // namespace voxspring
