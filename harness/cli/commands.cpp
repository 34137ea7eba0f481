#include "harness/cli/commands.h"

#include <cmath>
#include <glm/geometric.hpp>
#include <iomanip>
#include <iostream>
#include <memory>
#include <sstream>
#include <utility>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/text.h"
#include "harness/device/limits.h"
#include "harness/export/export.h"
#include "harness/export/pictures.h"
#include "harness/results/result.h"
#include "harness/scene/playback.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"
#include "harness/study/advise.h"
#include "harness/study/auto_choice.h"
#include "harness/study/fastest.h"
#include "harness/study/pareto.h"
#include "harness/study/stability_study.h"
#include "harness/study/stress.h"
#include "harness/verification/divergence.h"

namespace voxspring {
namespace {

nlohmann::json describe_backend(const BackendEntry& entry) {
    nlohmann::json tuning = nlohmann::json::object();
    for (const auto& [key, values] : entry.tuning) {
        tuning[key] = values.empty() ? nlohmann::json{"auto", "positive integer"} : nlohmann::json(values);
    }
    nlohmann::json described = {{"name", entry.name},
                                {"summary", entry.summary},
                                {"formulations", nlohmann::json::array()},
                                {"precisions", nlohmann::json::array()},
                                {"tuning", tuning}};
    for (const Precision precision : entry.precisions)
        described["precisions"].push_back(to_string(precision));
    for (const Formulation formulation : entry.formulations)
        described["formulations"].push_back(to_string(formulation));
    try {
        const Capabilities capabilities = BackendSpec::parse(entry.name).make()->capabilities();
        described["available"] = true;
        described["api"] = capabilities.api;
        described["device"] = capabilities.device;
        described["driver"] = capabilities.driver;
        described["clock"] = capabilities.clock;
    } catch (const std::runtime_error& error) {
        described["available"] = false;
        described["reason"] = error.what();
    }
    return described;
}

std::string bytes_text(std::uint64_t bytes) {
    std::ostringstream text;
    text << std::fixed << std::setprecision(1) << double(bytes) / (1 << 20) << " MiB";
    return text.str();
}

void print_heading(const char* heading, std::ostream& out) { out << heading << "\n"; }

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

void list_everything(bool json, std::ostream& out) {
    nlohmann::json all = {{"backends", nlohmann::json::array()},
                          {"scenes", nlohmann::json::array()},
                          {"studies", nlohmann::json::array()}};
    for (const auto& [name, entry] : registry()) all["backends"].push_back(describe_backend(entry));
    for (const auto& [name, reason] : left_out()) {
        all["backends"].push_back(
            {{"name", name}, {"available", false}, {"reason", "not in this build: " + reason}});
    }
    for (const auto& scene : builtin_scenes()) {
        all["scenes"].push_back({{"name", scene.name}, {"description", scene.description}});
    }
    for (const auto& study : builtin_studies()) {
        all["studies"].push_back({{"name", study.name}, {"description", study.description}});
    }
    if (json) {
        out << all.dump(2) << "\n";
        return;
    }
    print_heading("Backends", out);
    for (const auto& backend : all["backends"]) {
        out << "  " << backend["name"].get<std::string>() << "\n";
        if (backend.contains("summary")) out << "      " << backend["summary"].get<std::string>() << "\n";
        if (backend["available"].get<bool>()) {
            out << "      available: " << backend["api"].get<std::string>() << ", "
                << backend["device"].get<std::string>() << "\n";
        } else {
            out << "      unavailable: " << backend["reason"].get<std::string>() << "\n";
        }
        if (!backend.contains("precisions")) continue;
        const auto values = [](const nlohmann::json& list) {
            std::string text;
            for (const auto& value : list) text += (text.empty() ? "" : "|") + value.get<std::string>();
            return text;
        };
        out << "      precision=" << values(backend["precisions"])
            << " formulation=" << values(backend["formulations"]);
        for (const auto& [key, list] : backend["tuning"].items()) out << " " << key << "=" << values(list);
        out << "\n";
    }
    for (const auto& [heading, key] : {std::pair{"Scenes", "scenes"}, std::pair{"Studies", "studies"}}) {
        print_heading(heading, out);
        for (const auto& item : all[key]) {
            out << "  " << item["name"].get<std::string>() << ": " << item["description"].get<std::string>()
                << "\n";
        }
    }
}

void list_limits(bool json, std::ostream& out) {
    MeasuredLimits limits;
    for (const auto& [name, entry] : registry()) {
        const BackendSpec spec = BackendSpec::parse(name);
        try {
            limits.of(spec.make()->capabilities(), [&] { return spec.make()->measure_limits(); });
        } catch (const std::runtime_error&) {
            // `voxspring list` says why there is no such device.
        }
    }
    if (json) {
        out << limits.json().dump(2) << "\n";
    } else {
        print_limits(limits.json(), out);
    }
}

void describe_scene(const std::string& argument, bool json, std::ostream& out) {
    const Scene scene = load_scene(argument);
    const Problem& problem = scene.problem;
    const SpringCounts springs = count_springs(problem);
    std::size_t pinned = 0;
    for (const auto p : problem.pinned) pinned += p;
    nlohmann::json bytes;
    for (const auto& [name, entry] : registry()) {
        bytes[name] = entry.bytes(problem, BackendSpec::parse(name).options);
    }
    const Problem limiting = with_all_springs(scene);
    const double bound = frequency_bound_squared(limiting);
    const Frequency frequency = true_frequency_squared(limiting);
    nlohmann::json limit;
    if (frequency.squared) limit = stable_time_step(*frequency.squared, problem.damping);
    const glm::ivec3 dims = problem.lattice.dims;
    const glm::dvec3 spacing = problem.lattice.spacing;
    const nlohmann::json all = {
        {"scene", scene.name},
        {"description", scene.description},
        {"dims", {dims.x, dims.y, dims.z}},
        {"spacing", {spacing.x, spacing.y, spacing.z}},
        {"voxels", problem.lattice.voxel_count()},
        {"active_particles", problem.particle_count()},
        {"pinned_particles", pinned},
        {"materials", problem.materials.size()},
        {"springs",
         {{"face", springs.group[0]},
          {"edge", springs.group[1]},
          {"corner", springs.group[2]},
          {"total", springs.total()}}},
        {"time_step", problem.time_step},
        {"stable_time_step", scene.stable_time_step},
        {"stable_time_step_undamped", stable_time_step(bound, 0)},
        {"time_step_limit", limit},
        {"time_step_limit_unknown", frequency.squared ? nlohmann::json() : nlohmann::json(frequency.reason)},
        {"stable_over_limit",
         limit.is_null() ? limit : nlohmann::json(scene.stable_time_step / limit.get<double>())},
        {"fraction_of_stable", problem.time_step / scene.stable_time_step},
        {"damping", problem.damping},
        {"edits", scene.edits.size()},
        {"bytes", bytes},
    };
    if (json) {
        out << all.dump(2) << "\n";
        return;
    }
    const auto row = [&](const std::string& name, const auto& value) {
        out << std::left << std::setw(18) << name << value << "\n";
    };
    const auto triple = [](const auto& v) {
        std::ostringstream text;
        text << v.x << " x " << v.y << " x " << v.z;
        return text.str();
    };
    row("scene", scene.name);
    if (!scene.description.empty()) row("", scene.description);
    row("dims", triple(dims));
    row("spacing", triple(spacing));
    row("voxels", problem.lattice.voxel_count());
    row("active particles", problem.particle_count());
    row("pinned particles", pinned);
    row("materials", problem.materials.size());
    std::ostringstream counts;
    counts << springs.total() << " (face " << springs.group[0] << ", edge " << springs.group[1] << ", corner "
           << springs.group[2] << ")";
    row("springs", counts.str());
    row("damping", problem.damping);
    if (!scene.edits.empty()) {
        std::ostringstream edits;
        edits << scene.edits.size() << ", the last after step " << scene.edits.back().step;
        row("edits", edits.str());
    }
    std::ostringstream step;
    step << problem.time_step << " (" << std::setprecision(3)
         << 100 * problem.time_step / scene.stable_time_step << "% of the stable " << std::setprecision(6)
         << scene.stable_time_step << ")";
    row("time step", step.str());
    std::ostringstream undamped;
    undamped << stable_time_step(bound, 0);
    row("  undamped", undamped.str() + " would be stable");
    std::ostringstream true_limit;
    if (limit.is_null()) {
        true_limit << "unknown: " << frequency.reason;
    } else {
        true_limit << limit.get<double>() << " by Lanczos' iteration, of which the stable one is "
                   << std::setprecision(4) << 100 * scene.stable_time_step / limit.get<double>() << "%";
    }
    row("  limit", true_limit.str());
    out << "memory\n";
    for (const auto& [name, entry] : registry()) {
        out << "  " << std::left << std::setw(26) << name << std::right << std::setw(12)
            << bytes_text(bytes[name].get<std::uint64_t>()) << "\n";
    }
}

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
    Playback playback(scene);
    std::unique_ptr<Backend> backend;
    if (by_rules) {
        AutoChoice choice = choose_backend(options.backend, scene, [&](const Backend& candidate) {
            return playback.unsupported(candidate).empty();
        });
        out << "auto: " << choice.reason << "\n";
        spec = choice.spec;
        backend = std::move(choice.backend);
    } else {
        backend = spec.make();
    }
    if (const std::string why = playback.unsupported(*backend); !why.empty()) {
        throw std::runtime_error(spec.entry->name + " cannot run " + scene.name + ": " + why);
    }
    const Watch watch = watch_of(scene, options.steps);
    backend->watch(watch);
    Timing timing;
    double largest = 0;
    const auto play = [&](const auto& take) {
        timing = {};
        playback.rewind(*backend);
        for (int step = 0; step < options.steps;) {
            const int end = exports.next(step);
            const Timing batch = backend->timed([&] { playback.run(*backend, end - step); });
            timing.device_seconds += batch.device_seconds;
            timing.host_seconds += batch.host_seconds;
            step = end;
            const State state = backend->download();
            const auto departure = find_departure(*backend, playback, watch, state, step);
            largest = largest_displacement(state);
            if (departure || !std::isfinite(largest)) {
                throw std::runtime_error(spec.entry->name + ": " + scene.name + " " +
                                         (departure ? describe(*departure, watch) : "is no longer finite") +
                                         "; time step " + std::to_string(scene.problem.time_step) +
                                         ", stable " + std::to_string(scene.stable_time_step));
            }
            take({scene, playback.problem(), state, step, step * scene.problem.time_step, spec.label()});
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

int run_and_print_study(const std::string& argument, const StudyOptions& options, std::ostream& out) {
    const nlohmann::json result = run_study(load_study(argument), options);
    if (result.contains("pareto")) {
        print_fronts(result, out);
        print_limits(result.at("context").at("voxspring").at("limits"), out);
        print_unmeasured(result, out);
    } else if (result.contains("fastest")) {
        print_fastest(result, out);
    } else if (result.contains("stability")) {
        print_stability(result, out);
        print_unmeasured(result, out);
    } else if (result.contains("stress")) {
        print_stress(result, out);
        print_unmeasured(result, out);
    } else {
        print_table(result, out);
    }
    if (options.out) out << "written: " << options.out->string() << "\n";
    if (is_unfinished(result)) {
        out << "interrupted: this is what was finished"
            << (options.out ? "; the same command with --resume goes on" : "") << "\n";
        return interrupted_exit_code;
    }
    return result.at("failed").empty() ? 0 : 1;
}

int print_advice(const std::string& argument, const AdviseOptions& options, std::ostream& out) {
    std::vector<Candidate> candidates;
    std::string scene;
    if (options.results) {
        scene = argument;
        candidates = candidates_of(read_json(*options.results), scene);
    } else {
        scene = load_scene(argument).name;
        StudyOptions study = options.study;
        study.scenes = {argument};
        const nlohmann::json result = run_study(load_study("pareto"), study);
        if (is_unfinished(result)) return interrupted_exit_code;
        print_unmeasured(result, out);
        candidates = candidates_of(parse_json(result.dump(), "what was measured"), scene);
    }
    if (candidates.empty()) {
        out << "no run of " << scene << " has a total error: float64 does not converge, or all diverged\n";
        return 1;
    }
    const auto print = [&](const std::string& heading, const Candidate& candidate) {
        std::ostringstream text;
        text << std::setprecision(4) << heading << ": " << specification(candidate) << "\n    on "
             << candidate.device << "\n    time step " << candidate.time_step << " ("
             << candidate.fraction_of_stable << " of the stable one): " << si(candidate.seconds, "s")
             << " for " << candidate.steps << " steps to time " << candidate.end_time << "\n    total error "
             << error_text(candidate.total_error) << ", of it rounding "
             << error_text(candidate.rounding_error) << "\n";
        out << text.str();
    };
    const Advice advice = advise(candidates, options.error);
    if (!advice.best) {
        out << scene << ": nothing reaches an error of " << options.error << "\n";
        print("most accurate", advice.most_accurate);
        return 1;
    }
    out << scene << ": an error of " << options.error << " is reached soonest by\n";
    print("best", *advice.best);
    for (const Candidate& candidate : advice.runners_up) print("runner-up", candidate);
    return 0;
}

}  // namespace voxspring
