#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "backends/registry.h"
#include "harness/cli/commands.h"
#include "harness/export/export.h"
#include "harness/export/pictures.h"
#include "harness/scene/scene.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/auto_choice.h"
#include "harness/verification/divergence.h"

namespace voxspring {
namespace {

/// Not finite where any is not.
double largest_displacement(const State& state) {
    double largest = 0;
    for (const glm::dvec3& u : state.displacement) {
        // NaN and infinity stay.
        if (!(glm::length(u) <= largest)) largest = glm::length(u);
        if (!std::isfinite(largest)) break;
    }
    return largest;
}

}  // namespace

int run_scene(const std::string& argument, const RunOptions& options, std::ostream& out) {
    const bool by_rules = asks_for_auto(options.backend);
    BackendSpec spec;
    if (by_rules) {
        check_auto(options.backend);
    } else {
        spec = BackendSpec::parse(options.backend);
    }
    Exports exports(options.out, options.steps);
    const Scene scene = load_scene(argument);
    SceneRunner runner(scene);
    std::unique_ptr<Backend> backend;
    if (by_rules) {
        AutoChoice choice = choose_backend(options.backend, scene, [&](const Backend& candidate) {
            return runner.unsupported(candidate).empty();
        });
        out << "auto: " << choice.reason << "\n";
        spec = choice.spec;
        backend = std::move(choice.backend);
    } else {
        backend = spec.make();
    }
    if (const std::string why = runner.unsupported(*backend); !why.empty()) {
        throw std::runtime_error(spec.entry->name + " cannot run " + scene.name + ": " + why);
    }
    const DivergenceMonitor monitor = divergence_monitor(scene, options.steps);
    backend->monitor(monitor);
    Timing timing;
    double largest = 0;
    const auto play = [&](const auto& take) {
        timing = {};
        runner.rewind(*backend);
        for (int step = 0; step < options.steps;) {
            const int end = exports.next(step);
            const Timing batch = backend->timed([&] { runner.run(*backend, end - step); });
            timing.device_seconds += batch.device_seconds;
            timing.host_seconds += batch.host_seconds;
            step = end;
            const State state = backend->download();
            const auto divergence = find_divergence(*backend, runner, monitor, state, step);
            largest = largest_displacement(state);
            if (divergence || !std::isfinite(largest)) {
                throw std::runtime_error(
                    spec.entry->name + ": " + scene.name + " " +
                    (divergence ? describe(*divergence, monitor) : "is no longer finite") + "; time step " +
                    std::to_string(scene.problem.time_step) + ", stable " +
                    std::to_string(scene.stable_time_step));
            }
            take({scene, runner.problem(), state, step, step * scene.problem.time_step, spec.label()});
        }
    };
    if (exports.looks_ahead()) play([&](const Snapshot& snapshot) { exports.look_at(snapshot); });
    play([&](const Snapshot& snapshot) { exports.write(snapshot); });
    out << scene.name << ": " << options.steps << " steps of " << scene.problem.particle_count()
        << " particles on " << spec.label() << " in " << timing.host_seconds << " s, "
        << timing.device_seconds / options.steps * 1e6 << " us a step; largest displacement " << largest
        << "\n";
    if (const Pictures* pictures = exports.pictures();
        pictures != nullptr && pictures->colouring() == Colouring::error)
        out << "largest error against float64 " << pictures->largest() << "\n";
    return 0;
}

}  // namespace voxspring
