// The program voxspring-view, which `voxspring view` starts: a window with the live body. It has every
// command of voxspring as well.
#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <memory>
#include <optional>
#include <ostream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/files.h"
#include "harness/base/interruption.h"
#include "harness/base/progress.h"
#include "harness/choice/auto_choice.h"
#include "harness/cli/arguments.h"
#include "harness/cli/commands.h"
#include "harness/drawing/body_painter.h"
#include "harness/mesh/carried_mesh.h"
#include "harness/scene/parts.h"
#include "harness/simulation/picking.h"
#include "harness/simulation/simulation.h"
#include "harness/viewer/hand.h"
#include "harness/viewer/panel.h"
#include "harness/viewer/window.h"

namespace voxspring {
namespace {

constexpr double frame_seconds = 1.0 / 60;
/// The share of a frame's time that steps may take if the user wants as many steps as fit.
constexpr double stepping_share = 0.6;
constexpr int max_steps_per_frame = 10'000;
/// The largest number of equal moves by which the hand goes from its position in one frame to that in the
/// next.
constexpr int moves_per_frame = 8;
/// Intervals in seconds: between updates of the colours' range, and between states kept in case of a failure.
/// States of more than `large` particles are kept less often.
constexpr double range_seconds = 0.5, keep_seconds = 1, keep_seconds_of_large = 20;
constexpr std::size_t large = 1'000'000;
/// A mesh with more vertices is not moved with its body. To move this many takes some milliseconds per frame.
constexpr std::size_t max_carried_vertices = 200'000;

/// Chooses a backend by the rules of `auto`, among those that support a tool.
AutoChoice choose_for_hand(const std::string& text, const Scene& scene) {
    return choose_backend(text, scene, [&](Backend& candidate) {
        return candidate.tool() != nullptr && candidate.unsupported(scene.problem).empty();
    });
}

std::unique_ptr<Simulation> simulation_of(const std::string& backend, Scene scene, std::ostream& out) {
    if (!asks_for_auto(backend))
        return std::make_unique<Simulation>(std::move(scene), BackendSpec::parse(backend));
    AutoChoice choice = choose_for_hand(backend, scene);
    out << "auto: " << choice.reason << "\n";
    return std::make_unique<Simulation>(std::move(scene), choice.spec, std::move(choice.backend));
}

class Viewer {
public:
    Viewer(Scene scene, const ViewOptions& options, std::ostream& out)
        : options_(options),
          out_(out),
          window_("Voxspring: " + scene.name, options.size),
          simulation_(simulation_of(options.backend, std::move(scene), out)),
          painter_(window_.context()),
          hand_(*simulation_, painter_, orbit_) {
        for (const auto& [name, entry] : registry()) backends_.push_back(name);
        controls_.as_many_as_fit = !options.steps;
        controls_.steps_per_frame = options.steps.value_or(1);
        figures_.scene = simulation_->scene().name;
        name_backend();
        carries_mesh_ = carries_mesh();
        take_mesh();
        orbit_.show(painter_.mesh().low, painter_.mesh().high);
        scale_controls();
    }

    Viewer(const Viewer&) = delete;
    Viewer& operator=(const Viewer&) = delete;
    ~Viewer() { feed_.reset(); }  // the window's context must still be current

    int run() {
        const CaughtInterruptions caught;
        begin_ = Clock::now();
        activity_.begin(figures_.scene + " in a window");
        while (!window_.is_closed() && !interrupted()) {
            frame();
            if (options_.seconds && seconds_since(begin_) >= *options_.seconds) window_.close();
        }
        activity_.end();
        out_ << fmt::format("{}: {} steps on {}, {} frames in {:.1f} s\n", figures_.scene,
                            simulation_->steps(), figures_.backend, frames_, seconds_since(begin_));
        return interrupted() ? interrupted_exit_code : 0;
    }

private:
    /// Calls `use`. If the backend fails in that call, the window stays open and shows the reason.
    template <class Use>
    void guarded(Use use) {
        try {
            use();
        } catch (const DeviceError& error) {
            say(fmt::format(
                    "{} failed: {}. Choose another backend to go on from the state after step {}, or save "
                    "that state.",
                    figures_.backend, error.what(), simulation_->kept_steps()),
                true);
            failed_ = true;
            drop_feed();
            hand_.forget();
        }
    }

    void say(std::string message, bool is_bad = false) {
        if (message.empty()) return;
        // We flush the message, since a pipe would hold it back.
        out_ << "step " << simulation_->steps() << ": " << message << std::endl;
        figures_.message = std::move(message);
        figures_.is_bad = is_bad;
    }

    void name_backend() {
        figures_.backend = simulation_->backend_label();
        const Capabilities can = simulation_->backend().capabilities();
        figures_.device = fmt::format("{}, {}", can.device, can.api);
    }

    // --- The body ---------------------------------------------------------------------------------------

    void take_mesh() {
        drop_feed();  // set_mesh() replaces the buffer that the feed fills
        const Problem& problem = simulation_->problem();
        loose_ = parts_of(problem).loose();
        if (carries_mesh_) {
            bound_.emplace(*simulation_->scene().mesh, problem);
            painter_.set_mesh(mesh_of(bound_->rest, bound_->triangles));
            std::vector<double> looseness(problem.particle_count());
            for (const std::uint32_t i : loose_) looseness[i] = 1;
            loose_.clear();
            const std::vector<double> of_vertices = bound_->at_vertices<double>(looseness);
            for (std::size_t v = 0; v < of_vertices.size(); ++v) {
                if (of_vertices[v] > 0.5) loose_.push_back(std::uint32_t(v));
            }
        } else {
            painter_.set_mesh(mesh_of(problem));
        }
        springs_version_ = simulation_->springs_version();
    }

    /// Whether the window shows the mesh that the body was made of. A large one takes too long per frame.
    bool carries_mesh() {
        const MeshInGrid* const source = simulation_->scene().mesh.get();
        if (source == nullptr) return false;
        if (source->mesh.points.size() <= max_carried_vertices) return true;
        say(fmt::format("the mesh has {} vertices, more than {}: the surface of the voxels is shown",
                        source->mesh.points.size(), max_carried_vertices));
        return false;
    }

    void put_displacements() {
        const std::vector<glm::dvec3>& displacement = simulation_->state().displacement;
        if (bound_)
            painter_.put_displacements(bound_->at_vertices<glm::dvec3>(displacement));
        else
            painter_.put_displacements(displacement);
    }

    /// Colours the body by `values`, one value per particle; by displacement if there are none.
    void put_values(const std::vector<double>& values) {
        if (bound_ && !values.empty())
            painter_.put_values(bound_->at_vertices<double>(values));
        else
            painter_.put_values(values);
    }

    void drop_feed() {
        window_.context().make_current();
        feed_.reset();
        uploads_ = 0;
    }

    /// Updates the displacements, and after an edit the mesh, from the simulation.
    void take_displacements() {
        if (simulation_->springs_version() != springs_version_) take_mesh();
        if (simulation_->uploads() != uploads_) {
            drop_feed();
            // A backend feeds displacements of particles only. The host interpolates the displacements of a
            // bound mesh's vertices.
            FeedFacet* const feeds = bound_ ? nullptr : simulation_->backend().feeds();
            feed_ =
                feeds != nullptr ? feeds->feed(painter_.mesh().particles, painter_.displacements()) : nullptr;
            uploads_ = simulation_->uploads();
            figures_.from_device = feed_ != nullptr;
        }
        if (feed_) {
            window_.context().make_current();
            feed_->write();
        } else {
            put_displacements();
        }
        if (controls_.shown == Shown::tension) {
            put_values(tensions(simulation_->problem(), simulation_->state()));
        } else if (controls_.shown == Shown::error) {
            put_values(simulation_->errors());
        } else {
            put_values({});
        }
    }

    void take_shown() {
        const std::string refused = simulation_->compare(controls_.shown == Shown::error);
        if (refused.empty()) return;
        controls_.shown = Shown::displacement;
        say(refused);
    }

    /// Sets radius, stiffness and depth in the controls, and their largest values, to what suits the scene.
    void scale_controls() {
        const Problem& problem = simulation_->problem();
        const glm::dvec3 extent = painter_.mesh().high - painter_.mesh().low;
        const double size = std::max({extent.x, extent.y, extent.z});
        const double spacing =
            std::max({problem.lattice.spacing.x, problem.lattice.spacing.y, problem.lattice.spacing.z});
        double stiffness = 0;
        for (const double group : problem.group_stiffness) stiffness = std::max(stiffness, group);
        for (const Material& material : problem.materials) {
            if (problem.has_materials()) stiffness = std::max(stiffness, material.stiffness);
        }
        controls_.largest = {float(std::max(size / 4, spacing)), float(1000 * stiffness), float(size)};
        controls_.radius = float(std::min(2 * spacing, size / 4));
        controls_.stiffness = float(10 * stiffness);
        controls_.depth = float(size / 3);
    }

    // --- A frame ----------------------------------------------------------------------------------------

    void frame() {
        const auto frame_begin = Clock::now();
        window_.begin_frame(frame_seconds - last_frame_);
        const auto work_begin = Clock::now();
        const glm::ivec2 size = window_.pixels();
        if (size.x > 0 && size.y > 0) {
            follow_pointer(size);
            Requests requests = draw_panel(figures_, backends_, window_.typed(), controls_);
            guarded([&] { answer(requests); });
            stepping_seconds_ = 0;
            if (!failed_) guarded([&] { advance(requests.step); });
            if (!failed_) guarded([&] { take_displacements(); });
            draw(size);
        } else {
            ImGui::EndFrame();
        }
        last_frame_ = seconds_since(work_begin);
        drawing_seconds_ = 0.8 * drawing_seconds_ + 0.2 * (last_frame_ - stepping_seconds_);
        frame_wall_ = seconds_since(frame_begin);
        figures_.frame_milliseconds.add(1e3 * frame_wall_);
        if (seconds_since(told_) >= range_seconds) tell();
    }

    void follow_pointer(glm::ivec2 size) {
        Pointer pointer{.pixel = window_.pointer()};
        // A drag that begins on the panel belongs to the panel. One that begins on the body goes on over the
        // panel.
        if (!ImGui::GetIO().WantCaptureMouse || was_on_body_) {
            const auto [left, right, middle] = window_.buttons();
            pointer.left = left;
            pointer.right = right;
            pointer.middle = middle;
            pointer.wheel = double(ImGui::GetIO().MouseWheel);
        }
        was_on_body_ = pointer.left || pointer.right || pointer.middle;
        if (failed_) pointer.left = false;
        guarded([&] { say(hand_.follow(pointer, controls_, size)); });
    }

    void answer(const Requests& requests) {
        if (requests.reset && !failed_) {
            simulation_->reset();
            hand_.forget();
            hand_before_ = glm::dvec3(0);
            say("reset");
        }
        if (requests.backend) {
            drop_feed();  // the feed belongs to the old backend
            const std::string refused = simulation_->switch_to(BackendSpec::parse(*requests.backend));
            hand_.forget();
            if (refused.empty()) {
                failed_ = false;
                name_backend();
                say(figures_.backend + " goes on");
            } else {
                say(fmt::format("{}: {}", *requests.backend, refused), true);
            }
        }
        if (requests.shown_changed && !failed_) take_shown();
        if (requests.save) save();
        if (requests.close) window_.close();
    }

    void save() {
        if (!failed_) simulation_->keep_state();
        const auto path = options_.save.value_or(figures_.scene + ".npz");
        try {
            simulation_->save(path);
        } catch (const std::exception& error) {
            // The disk may be full or the folder read-only. The simulation goes on, and a later attempt may
            // succeed.
            say(fmt::format("the state is not saved: {}", error.what()), true);
            return;
        }
        say(fmt::format("the state after step {} is in {}", simulation_->kept_steps(), path.string()));
    }

    int steps_of_frame(bool one) const {
        if (controls_.paused) return one ? 1 : 0;
        if (!controls_.as_many_as_fit) return controls_.steps_per_frame;
        if (step_seconds_ <= 0) return 1;
        // If a picture takes longer than a frame, for example because the processor draws it, steps may take
        // as long as the picture.
        const double budget = std::max(stepping_share * frame_seconds, drawing_seconds_);
        return int(std::clamp(budget / step_seconds_, 1.0, double(max_steps_per_frame)));
    }

    /// Makes the steps of a frame. Meanwhile the hand moves from its place in the previous frame to its
    /// present place.
    void advance(bool one) {
        const int steps = steps_of_frame(one);
        if (steps == 0) return;
        // We wait for the previous picture before we time the steps. If the processor still drew it, it would
        // take threads from the steps; if a card did, the steps would wait for it.
        window_.context().make_current();
        glFinish();
        const auto begin = Clock::now();
        const glm::dvec3 to = hand_.moved().value_or(glm::dvec3(0));
        const int moves = simulation_->holds() ? std::min(steps, moves_per_frame) : 1;
        int done = 0;
        for (int move = 1; move <= moves; ++move) {
            if (simulation_->holds())
                simulation_->drag(hand_before_ + (to - hand_before_) * (double(move) / moves));
            // tick() makes the frame's last step, and times it.
            const int end = move < moves ? int(std::int64_t(steps) * move / moves) : steps - 1;
            if (end > done) simulation_->step(end - done);
            done = end;
        }
        tick();
        hand_before_ = simulation_->holds() ? to : glm::dvec3(0);
        const double seconds = seconds_since(begin);
        stepping_seconds_ = seconds;
        // A running mean over frames, so that one slow frame does not halve the steps of the next.
        step_seconds_ = step_seconds_ <= 0 ? seconds / steps : 0.8 * step_seconds_ + 0.2 * seconds / steps;
        figures_.steps_per_second.add(steps / std::max(seconds, frame_wall_));
    }

    /// Makes one step and times it, from sending the tool's position until its force is back on the host.
    void tick() {
        simulation_->backend().synchronize();
        const auto begin = Clock::now();
        if (simulation_->holds()) simulation_->drag(hand_.moved().value_or(glm::dvec3(0)));
        simulation_->step(1);
        const glm::dvec3 force = simulation_->force();
        simulation_->backend().synchronize();
        figures_.tick_microseconds.add(1e6 * seconds_since(begin));
        figures_.force.add(glm::length(force));
    }

    void draw(glm::ivec2 size) {
        const Shades shades{
            .low = figures_.range[0],
            .high = figures_.range[1],
            .colours = controls_.shown == Shown::error ? Colouring::error : Colouring::displacement};
        painter_.draw(orbit_.view(size), shades);
        painter_.show();
        if (const auto line = hand_.line(size)) {
            const glm::dvec2 scale = window_.pixels_per_unit();
            const auto point = [&](glm::dvec2 pixel) {
                return ImVec2(float(pixel.x / scale.x), float(pixel.y / scale.y));
            };
            ImGui::GetBackgroundDrawList()->AddLine(point(line->from), point(line->to),
                                                    IM_COL32(255, 255, 255, 220), 2);
            ImGui::GetBackgroundDrawList()->AddCircleFilled(point(line->to), 4, IM_COL32(255, 255, 255, 255));
        }
        window_.draw_panels();
        window_.swap();
        ++frames_;
    }

    /// Called twice per second. Updates the range of the colours and the figures of the run. Every second, or
    /// more rarely for a large body, also keeps the state, from which another backend can go on after a
    /// failure.
    void tell() {
        figures_.steps = simulation_->steps();
        figures_.time = double(figures_.steps) * simulation_->problem().time_step;
        if (!failed_) {
            const auto [low, high] = painter_.range(loose_);
            const double both = std::max(std::abs(low), std::abs(high));
            figures_.range =
                controls_.shown == Shown::tension ? std::array{-both, both} : std::array{0.0, high};
            const bool is_large = simulation_->problem().particle_count() > large;
            if (seconds_since(kept_) >= (is_large ? keep_seconds_of_large : keep_seconds)) {
                guarded([&] { simulation_->keep_state(); });
                kept_ = Clock::now();
            }
        }
        const double seconds = seconds_since(told_);
        activity_.done(0, fmt::format("step {}, {:.0f} frames per second", figures_.steps,
                                      double(frames_ - told_frames_) / seconds));
        told_frames_ = frames_;
        told_ = Clock::now();
    }

    const ViewOptions& options_;
    std::ostream& out_;
    Window window_;
    std::unique_ptr<Simulation> simulation_;
    BodyPainter painter_;
    Orbit orbit_;
    Hand hand_;
    Controls controls_;
    Figures figures_;
    std::vector<std::string> backends_;
    std::unique_ptr<Feed> feed_;  ///< null: displacements are copied through the host
    std::uint64_t springs_version_ = 0, uploads_ = 0;
    bool carries_mesh_ = false;
    std::optional<BoundMesh> bound_;  ///< the mesh on screen, if it is the one that the body was made of
    /// Particles of parts that nothing holds, or vertices that follow such particles. They may fall for ever,
    /// and do not count for the colours' range.
    std::vector<std::uint32_t> loose_;
    bool failed_ = false, was_on_body_ = false;
    glm::dvec3 hand_before_{0};
    double step_seconds_ = 0, stepping_seconds_ = 0, drawing_seconds_ = 0, last_frame_ = 0,
           frame_wall_ = frame_seconds;
    std::int64_t frames_ = 0, told_frames_ = 0;
    Clock::time_point begin_ = Clock::now(), told_ = begin_, kept_ = begin_;
    Activity activity_;
};

/// Shows the scene and returns the exit code once the window is closed. Throws BadInput, BadSpecification,
/// Unavailable if there is no display, and DeviceError if the card that draws the window fails.
int view_scene(const std::string& scene, const ViewOptions& options, std::ostream& out) {
    // Bad arguments are refused before a window opens.
    if (options.save) check_writable(*options.save, "--save", ".npz");
    if (asks_for_auto(options.backend)) {
        check_auto(options.backend);
    } else {
        (void)BackendSpec::parse(options.backend);
    }
    Scene loaded = load_scene(scene, options.volume);
    say_notes(loaded);
    try {
        return Viewer(std::move(loaded), options, out).run();
    } catch (const NoWindow& absent) {
        throw Unavailable(
            fmt::format("view: {}\nWithout a display: {} --frames frames draws pictures of a run.",
                        absent.what(), run_command_of(scene, options.volume, options.backend)));
    }
}

}  // namespace
}  // namespace voxspring

int main(int argc, char** argv) { return voxspring::run_program(argc, argv, voxspring::view_scene); }
