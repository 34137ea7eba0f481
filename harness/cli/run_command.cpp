#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "backends/api.h"
#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/progress.h"
#include "harness/base/text.h"
#include "harness/choice/auto_choice.h"
#include "harness/cli/commands.h"
#include "harness/export/export.h"
#include "harness/export/pictures.h"
#include "harness/export/saved_state.h"
#include "harness/scene/parts.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/divergence.h"
#include "harness/verification/reference.h"

namespace voxspring {
namespace {

/// The options that choose the devices which the command line or an environment variable asks for: of the API
/// of `backend`, or of each API if the backend is `auto` or of another build.
std::string device_options_for(const std::string& backend) {
    const auto entry = registry().find(backend.substr(0, backend.find(':')));
    std::string text;
    for (const auto& [name, api] : apis()) {
        const std::string asked = asked_device(name);
        if (!api.devices || asked.empty()) continue;
        if (entry == registry().end() || entry->second.api == name)
            text += " " + device_option(name) + " " + shell_word(asked);
    }
    return text;
}

/// The largest displacements from rest: `loose` in parts of the body of which no particle is held
/// (BodyParts::loose()), `held` in all other parts. Both are not finite if any displacement is not
/// finite.
struct Largest {
    double held = 0, loose = 0;
};

/// The largest displacements in `state`. `loose` are the particles of parts that nothing holds, ascending.
Largest largest_displacement(const State& state, const std::vector<std::uint32_t>& loose) {
    Largest largest;
    auto next = loose.begin();
    for (std::size_t i = 0; i < state.displacement.size(); ++i) {
        const bool is_loose = next != loose.end() && *next == i;
        if (is_loose) ++next;
        double& of_kind = is_loose ? largest.loose : largest.held;
        const double length = glm::length(state.displacement[i]);
        if (!std::isfinite(length)) return {length, length};
        of_kind = std::max(of_kind, length);
    }
    return largest;
}

/// The number of steps, at least one, whose end is nearest to `time`. Prints a note if it is not at `time`.
int steps_to(double time, const Scene& scene, std::ostream& out) {
    const double time_step = scene.problem.time_step;
    const double steps = std::max(1.0, std::round(time / time_step));
    if (steps > max_run_steps) {
        throw BadInput("command line", "--time", fmt::format("{:g}", time),
                       fmt::format("the time of at most {} time steps; a time step of the scene {} is {:g}",
                                   max_run_steps, scene.name, time_step));
    }
    constexpr double rounding = 1e-9;
    if (std::abs(steps * time_step - time) > rounding * time)
        out << fmt::format(
            "time {:g} is not a multiple of the time step {:g}: the run takes {}, to time {:g}\n", time,
            time_step, counted(std::uint64_t(steps), "step"), steps * time_step);
    return int(steps);
}

/// One run: a scene, the backend that runs it and the files to write.
class Run {
public:
    Run(const std::string& argument, const RunOptions& options, std::ostream& out)
        : options_(options), out_(out), steps_(options.steps) {
        const bool by_rules = asks_for_auto(options.backend);
        if (by_rules) {
            check_auto(options.backend);
        } else {
            spec_ = BackendSpec::parse(options.backend);
        }
        if (!options.time) exports_ = std::make_unique<Exports>(options.out, steps_);
        activity_.begin("reading " + argument);
        scene_ = std::make_unique<Scene>(load_scene(argument, options.volume));
        activity_.end();
        say_notes(*scene_);
        if (options.time_step) take_time_step(*options.time_step);
        if (options.time) {
            steps_ = steps_to(*options.time, *scene_, out);
            exports_ = std::make_unique<Exports>(options.out, steps_);
        }
        if (options.out.tool_force)
            forces_ =
                std::make_unique<ToolForces>(*options.out.tool_force, *scene_, options.out.every, steps_);
        if (options.resume) resume(*options.resume);
        loose_ = parts_of(scene_->problem).loose();
        runner_ = std::make_unique<SceneRunner>(*scene_);
        if (saved_) runner_->start_from(first_, saved_->state);
        activity_.begin(scene_->name + ": starting " + options.backend);
        make_backend(by_rules);
        if (saved_) say_whether_bits_are_kept();
        monitor_ = divergence_monitor(*scene_, steps_, saved_ ? saved_->state : scene_->state);
        backend_->monitor(monitor_);
    }

    int exit_code() {
        const CaughtInterruptions caught;
        if (exports_->looks_ahead()) {
            in_first_pass_ = true;
            play([&](const Snapshot& snapshot) { exports_->look_at(snapshot); });
        }
        if (!interrupted()) {
            in_first_pass_ = false;
            play([&](const Snapshot& snapshot) { exports_->write(snapshot); });
        }
        return in_first_pass_ || reached_ < steps_ ? stop() : finish();
    }

private:
    /// Sets the scene's time step and adapts its damping, so that the motion stays the same. Throws BadInput
    /// if the scene has edits or a tool.
    void take_time_step(double time_step) {
        if (time_step == scene_->problem.time_step) return;
        const bool edited = !scene_->edits.empty();
        if (edited || scene_->problem.has_tool())
            throw BadInput(
                "command line", "--time-step", fmt::format("{:g}", time_step),
                fmt::format("no --time-step: {} has {} at given numbers of steps, whose times would change",
                            scene_->name, edited ? "edits" : "moves of the tool"));
        const Problem& problem = scene_->problem;
        const double before = problem.time_step, damping = problem.damping;
        *scene_ = at_time_step(*scene_, time_step);
        activity_.end();
        out_ << fmt::format("{}: time step {:g} instead of {:g}, damping {:g} per step instead of {:g}\n",
                            scene_->name, time_step, before, problem.damping, damping);
    }

    void resume(const std::filesystem::path& file) {
        saved_ = read_saved_state(file, *scene_);
        if (saved_->step >= steps_)
            throw BadInput("command line", options_.time ? "--time" : "--steps",
                           counted(std::uint64_t(steps_), "step"),
                           "more than the " + std::to_string(saved_->step) + " that " + file.string() +
                               " has reached: steps count from the scene's start");
        first_ = saved_->step;
        exports_->resume_from(first_);
        activity_.end();
        if (!saved_->differs.empty()) out_ << file.string() << ": " << saved_->differs << "\n";
        take_springs_of(file);
    }

    /// If the springs in the file differ from those of the scene at that step, takes them into the scene and
    /// prints a note.
    void take_springs_of(const std::filesystem::path& file) {
        const std::size_t others = springs_that_differ(*scene_, *saved_);
        if (others == 0) return;
        const Pictures* pictures = exports_->pictures();
        if (pictures != nullptr && pictures->colouring() == Colouring::error)
            throw BadInput("command line", "--colour", "error",
                           fmt::format("displacement: {} springs of {} differ from those of {} after step {}",
                                       others, file.string(), scene_->name, first_));
        const std::size_t before = scene_->edits.size();
        take_springs(*scene_, *saved_);
        out_ << fmt::format(
            "{}: {} springs are not as in scene {} after step {}; the run uses the file's springs{}\n",
            file.string(), others, scene_->name, first_,
            before > 0 ? ", and later edits apply to these" : "");
    }

    /// Prints a note if the bits may differ from those of an uninterrupted run. The file has displacement and
    /// increment in float64. That is exact for the formulation `increment` and, with float32, for every
    /// formulation except `compensated`.
    void say_whether_bits_are_kept() {
        const Options& options = spec_.options;
        const bool kept =
            options.formulation == Formulation::increment ||
            (options.precision == Precision::float32 && options.formulation != Formulation::compensated);
        if (kept) return;
        activity_.end();
        out_ << to_string(options.formulation) << " in " << to_string(options.precision)
             << " has more digits than the file: bits may differ from those of an uninterrupted run\n";
    }

    void make_backend(bool by_rules) {
        if (by_rules) {
            AutoChoice choice = choose_backend(options_.backend, *scene_, [&](const Backend& candidate) {
                return runner_->unsupported(candidate).empty();
            });
            activity_.end();
            out_ << "auto: " << choice.reason << "\n";
            spec_ = choice.spec;
            backend_ = std::move(choice.backend);
        } else {
            backend_ = spec_.make();
        }
        if (const std::string why = runner_->unsupported(*backend_); !why.empty())
            throw std::runtime_error(spec_.entry->name + " cannot run " + scene_->name + ": " + why);
    }

    std::string subject() const { return scene_->name + " on " + spec_.label(); }

    Snapshot snapshot_of(const State& state) const {
        return {*scene_,      runner_->problem(), state, reached_, reached_ * scene_->problem.time_step,
                spec_.label()};
    }

    /// Takes all steps, or stops at an interruption. Calls `take` with the state after each step at which a
    /// file is due.
    template <class Take>
    void play(const Take& take) {
        const std::string what =
            subject() + (in_first_pass_ ? ", first pass, to find one colour scale for all pictures" : "");
        timing_ = {};
        activity_.begin(what + ": uploading");
        runner_->rewind(*backend_);
        activity_.begin(what);
        // The first strides take a tenth of a second on a slow machine.
        stride_ = int(std::bit_floor(std::size_t(1'000'000) / scene_->problem.particle_count() | 1));
        reached_ = first_;
        while (reached_ < steps_) {
            const int file = exports_->next(reached_);
            const int force = forces_ ? forces_->next(reached_) : file;
            const int end = std::min(file, force);
            while (reached_ < end && !interrupted()) step_on(std::min(stride_, end - reached_));
            if (reached_ < end || (interrupted() && reached_ < steps_)) return;
            if (forces_ && reached_ == force) forces_->add(reached_, backend_->tool()->tool_force());
            if (reached_ < file) continue;
            const State state = checked_state();
            take(snapshot_of(state));
        }
    }

    void step_on(int steps) {
        const Timing batch = backend_->timed([&] { runner_->run(*backend_, steps); });
        timing_.device_seconds += batch.device_seconds;
        timing_.host_seconds += batch.host_seconds;
        // Only a whole stride tells the speed. A shorter one was cut off by a step at which a file or a force
        // is due.
        if (steps == stride_ && batch.host_seconds < 0.1 && stride_ < 1'000'000) {
            stride_ *= 4;
        } else if (steps == stride_ && batch.host_seconds > 0.4 && stride_ > 1) {
            stride_ /= 2;
        }
        reached_ += steps;
        activity_.done(double(reached_ - first_) / (steps_ - first_),
                       "step " + std::to_string(reached_) + " of " + std::to_string(steps_));
    }

    /// Downloads the present state and updates `largest_`. Throws std::runtime_error if the run has diverged.
    State checked_state() {
        State state = backend_->download();
        auto divergence = find_divergence(*backend_, *runner_, monitor_, state, reached_ - first_);
        largest_ = largest_displacement(state, loose_);
        if (!divergence && std::isfinite(largest_.held + largest_.loose)) return state;
        if (divergence) {
            divergence->last_good += first_;
            divergence->found += first_;
        }
        throw std::runtime_error(spec_.entry->name + ": " + scene_->name + " " +
                                 (divergence ? describe(*divergence, monitor_) : "is no longer finite") +
                                 fmt::format("; time step {:g}, stable {:g}", scene_->problem.time_step,
                                             scene_->stable_time_step));
    }

    int finish() {
        if (forces_) forces_->write();
        activity_.end();
        const int steps = steps_ - first_;
        out_ << scene_->name << ": " << counted(std::uint64_t(steps), "step");
        if (first_ > 0) out_ << ", " << first_ + 1 << " to " << steps_ << ",";
        out_ << " of " << counted(scene_->problem.particle_count(), "particle") << " on " << spec_.label()
             << " in " << timing_.host_seconds << " s, " << timing_.device_seconds / steps * 1e6
             << " us per step; largest displacement " << largest_.held;
        if (scene_->world)
            out_ << fmt::format(" {}; {:.3g} s of simulated time per second", scene_->world->length,
                                scene_->problem.time_step * steps / timing_.host_seconds);
        if (!loose_.empty())
            out_ << ", and " << largest_.loose << " of the " << loose_.size()
                 << " particles that nothing pins";
        out_ << "\n";
        if (const Pictures* pictures = exports_->pictures();
            pictures != nullptr && pictures->colouring() == Colouring::error)
            out_ << "largest displacement error in the last picture, against float64: " << pictures->largest()
                 << "\n";
        return 0;
    }

    /// Ends an interrupted run: writes the present state and forces to the files asked for, and prints their
    /// names.
    int stop() {
        const bool leaves = reached_ > first_ && (!options_.out.out.empty() || options_.out.frames);
        if (leaves) {
            activity_.begin(subject() + ": writing the state after step " + std::to_string(reached_));
            const State state = checked_state();
            exports_->end_at(reached_);
            if (in_first_pass_) exports_->look_at(snapshot_of(state));
            exports_->write(snapshot_of(state));
        }
        const bool leaves_forces = forces_ && reached_ > first_;
        if (leaves_forces) {
            forces_->add(reached_, backend_->tool()->tool_force());
            forces_->write();
        }
        activity_.end();
        out_ << scene_->name << ": interrupted after step " << reached_ << " of " << steps_;
        if (leaves_forces) out_ << "; the forces until then are in " << forces_->path().string();
        if (!leaves) {
            out_ << (reached_ == first_ ? "; nothing is written\n"
                     : leaves_forces    ? "\n"
                                        : "; without --out nothing is written\n");
            return interrupted_exit_code;
        }
        std::string states, resumable;
        for (const auto& path : exports_->written()) {
            states += (states.empty() ? "" : ", ") + path.string();
            if (path.extension() == ".npz") resumable = path.string();
        }
        out_ << "; its state is in " << states << "\n";
        if (!resumable.empty() && reached_ < steps_)
            out_ << "the same command with --resume " << shell_word(resumable) << " goes on\n";
        return interrupted_exit_code;
    }

    const RunOptions& options_;
    std::ostream& out_;
    int steps_;
    int first_ = 0;               ///< the step from which a resumed run continues; otherwise 0
    int reached_ = 0;             ///< the last step that was taken
    bool in_first_pass_ = false;  ///< whether the first of two passes, which writes no file, runs
    /// How many steps to take between two checks for an interruption: about as many as take a fifth of a
    /// second. Progress is reported as often. The number is a power of two: CUDA backends take it in graphs
    /// of 2^k steps, and so make few.
    int stride_ = 1;
    BackendSpec spec_;
    std::unique_ptr<Exports> exports_;
    std::unique_ptr<Scene> scene_;
    std::optional<SavedState> saved_;
    std::unique_ptr<ToolForces> forces_;  ///< null if --tool-force is not given
    std::unique_ptr<SceneRunner> runner_;
    std::unique_ptr<Backend> backend_;
    DivergenceMonitor monitor_;
    Timing timing_;
    std::vector<std::uint32_t> loose_;  ///< particles of parts that nothing holds, ascending
    Largest largest_;
    Activity activity_;
};

}  // namespace

std::string run_command_of(const std::string& scene, const VolumeOptions& volume,
                           const std::string& backend) {
    return fmt::format("voxspring run {}{} --backend {}{}", shell_word(scene), volume.text(),
                       shell_word(backend), device_options_for(backend));
}

int run_scene(const std::string& argument, const RunOptions& options, std::ostream& out) {
    return Run(argument, options, out).exit_code();
}

}  // namespace voxspring
