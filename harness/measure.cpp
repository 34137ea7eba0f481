#include "harness/measure.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <sstream>
#include <string>
#include <utility>

#include "harness/divergence.h"
#include "harness/errors.h"
#include "harness/limits.h"
#include "harness/playback.h"

namespace voxspring {
namespace {

/// One contender while Google Benchmark calls it in whatever order it likes.
struct Run {
    Contender* contender;
    std::string name;
    int repetitions_left = 0;
    std::string failure = {};                   ///< empty: none so far
    std::optional<Comparison> comparison = {};  ///< of the state after the last timed batch
    nlohmann::json errors = {};                 ///< the fields of that state
    WorkCount work = {};
    std::vector<double> without_edits =
        {};                      ///< seconds a step of the same batch without edits, one a repetition
    double upload_seconds = 0;   ///< of the first upload, without compiling
    double compile_seconds = 0;  ///< before the first step, of no time that is measured
    nlohmann::json edits = {};   ///< what edits cost, as rows say it; null where a scene has none
};

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Steps from the state that the last batch of `batch` left back to the last rewind().
int steps_in_all(const Batch& batch) {
    return batch.rewind ? batch.steps : batch.steps * (1 + batch.repetitions);
}

std::string describe(const std::exception& error) { return error.what(); }

/// Reads the state that `steps` steps since the last rewind() have left; a run that diverged fails.
State read(Backend& backend, Playback& playback, const Watch& watch, int steps) {
    State state = backend.download();
    if (const auto departure = find_departure(backend, playback, watch, state, steps))
        throw std::runtime_error(describe(*departure, watch));
    return state;
}

/// Uploads and advances once, so that shaders are compiled and clocks are up before anything is timed. The
/// work is that of the step after the batch: right after an upload a backend knows of nothing that rests.
void warm_up(Run& run, Playback& playback, const Watch& watch, const Batch& batch) {
    try {
        Backend& backend = *run.contender->backend;
        backend.watch(watch);
        const auto begin = Clock::now();
        playback.rewind(backend);
        run.compile_seconds = backend.compile_seconds();
        run.upload_seconds = std::max(0.0, seconds_since(begin) - run.compile_seconds);
        playback.run(backend, batch.steps);
        backend.synchronize();
        if (backend.departure()) read(backend, playback, watch, batch.steps);
        // Counting takes a step, which only a rewind takes back.
        if (batch.rewind) run.work = backend.count_work();
    } catch (const std::exception& error) {
        run.failure = describe(error);
    }
}

/// One repetition: Google Benchmark's iteration is one step. It is not told of a failure, since it aborts
/// where some repetitions of a benchmark fail and others do not; measure() drops the rows of who failed.
void repeat(benchmark::State& state, Run& run, const Scene& scene, Playback& playback, const Watch& watch,
            const Truth& truth, std::uint64_t springs, const Batch& batch) {
    Backend& backend = *run.contender->backend;
    const int steps = batch.steps;
    const auto unless_failed = [&](const auto& action) {
        if (!run.failure.empty()) return;
        try {
            action();
        } catch (const std::exception& error) {
            run.failure = describe(error);
        }
    };
    Timing timing{.device_seconds = 1, .host_seconds = 1};  // of no meaning, but statistics of it are finite
    unless_failed([&] {
        if (batch.rewind) playback.rewind(backend);
    });
    while (state.KeepRunningBatch(steps)) {
        unless_failed([&] { timing = backend.timed([&] { playback.run(backend, steps); }); });
        state.SetIterationTime(timing.device_seconds);
    }
    unless_failed([&] {
        const bool last = --run.repetitions_left == 0;
        if (last || backend.departure()) {
            // Judged at once: of a large scene the states of all contenders would not fit into memory.
            const State left = read(backend, playback, watch, truth.steps);
            run.comparison = judge(truth, left, run.contender->spec);
            run.errors = error_fields(truth, left, *run.comparison);
        }
        if (playback.edits_within(steps) > 0) {
            // Beside the batch with edits, so that both meet the same clocks.
            backend.upload(scene.problem, scene.state);
            const Timing plain = backend.timed([&] { backend.step(steps); });
            run.without_edits.push_back(plain.device_seconds / steps);
        }
    });
    using benchmark::Counter;
    state.counters["particle_updates_per_second"] =
        Counter(double(scene.problem.particle_count()) * steps, Counter::kIsRate);
    state.counters["spring_updates_per_second"] = Counter(double(springs) * steps, Counter::kIsRate);
    state.counters["host_seconds_per_step"] = timing.host_seconds / steps;
}

/// The latency of each edit by itself, from a device that waits to one that waits again: the best of three
/// plays, since an edit is far shorter than what may interrupt it.
void measure_edits(Run& run, Playback& playback, int steps) {
    const int count = playback.edits_within(steps);
    if (count == 0 || !run.failure.empty()) return;
    constexpr int plays = 3;
    try {
        Backend& backend = *run.contender->backend;
        std::vector<double> latency(std::size_t(count), INFINITY);
        for (int play = 0; play < plays; ++play) {
            auto next = latency.begin();
            playback.rewind(backend);
            playback.run(backend, steps, [&](const Problem& edited, const SpringEdit& edit) {
                backend.synchronize();
                const auto begin = Clock::now();
                backend.edit(edited, edit);
                backend.synchronize();
                *next = std::min(*next, seconds_since(begin));
                ++next;
            });
            backend.synchronize();
        }
        run.edits = {{"edits", count},
                     {"edit_seconds_median", median(latency)},
                     {"edit_seconds_max", *std::max_element(latency.begin(), latency.end())},
                     {"seconds_per_step_without_edits", median(run.without_edits)}};
    } catch (const std::exception& error) {
        run.failure = describe(error);
    }
}

/// What a user of Google Benchmark would give on its command line. It keeps pointers to the arguments and
/// reads them once a process.
void initialize_google_benchmark() {
    static std::string name = "voxspring";
    static std::string interleave = "--benchmark_enable_random_interleaving=true";
    static char* arguments[] = {name.data(), interleave.data(), nullptr};
    static int count = 2;
    if (count == 2) benchmark::Initialize(&count, arguments);
}

/// Nothing where the row is a measure of spread.
std::optional<double> step_seconds(const nlohmann::json& row) {
    const std::string aggregate = row.value("aggregate_name", "mean");
    if (aggregate != "mean" && aggregate != "median") return std::nullopt;
    return 1e-6 * row.at("real_time").get<double>();
}

}  // namespace

double median(std::vector<double> values) {
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

nlohmann::json row_identity(const std::string& scene, const BackendSpec& spec) {
    return {{"name", scene + "/" + spec.label()},
            {"scene", scene},
            {"backend", spec.entry->name},
            {"formulation", to_string(spec.options.formulation)},
            {"precision", to_string(spec.options.precision)},
            {"tuning", spec.tuning()}};
}

SceneResult measure(const Scene& scene, std::vector<Contender>& contenders, const Batch& batch,
                    References& references, const OnRepetition& on_repetition) {
    initialize_google_benchmark();
    const int steps = batch.steps;
    const int repetitions = batch.repetitions;
    const int all_steps = steps_in_all(batch);
    const Watch watch = watch_of(scene, all_steps);
    const std::uint64_t springs = count_springs(scene.problem).total();

    std::optional<Problem> edited;
    if (!scene.edits.empty()) edited = problem_after(scene, all_steps);
    Truth truth{edited ? *edited : scene.problem, all_steps, {}, {}, {}};
    truth.same_step = references.after(scene, all_steps);
    truth.chaos = references.chaos(scene, all_steps);
    truth.conserved = conserved(truth.problem, truth.same_step);
    if (batch.total_error) {
        truth.refined = references.refined(scene, {scene.problem.time_step, all_steps}, {all_steps});
    } else {
        truth.refined.reason = "the study does not ask for it";
    }

    Playback playback(scene);
    std::vector<Run> runs;
    for (Contender& contender : contenders) {
        const std::string name = row_identity(scene.name, contender.spec).at("name");
        runs.push_back({.contender = &contender, .name = name, .repetitions_left = repetitions});
    }
    int begun = 0;
    benchmark::ClearRegisteredBenchmarks();
    for (Run& run : runs) {
        on_repetition(run.contender->spec.label(), 0, repetitions * int(runs.size()));
        warm_up(run, playback, watch, batch);
        benchmark::RegisterBenchmark(run.name.c_str(),
                                     [&](benchmark::State& state) {
                                         on_repetition(run.contender->spec.label(), ++begun,
                                                       repetitions * int(runs.size()));
                                         repeat(state, run, scene, playback, watch, truth, springs, batch);
                                     })
            ->Iterations(steps)
            ->Repetitions(repetitions)
            ->UseManualTime()
            ->Unit(benchmark::kMicrosecond);
    }
    std::ostringstream output;
    benchmark::JSONReporter reporter;
    reporter.SetOutputStream(&output);
    reporter.SetErrorStream(&output);
    benchmark::RunSpecifiedBenchmarks(&reporter, nullptr, ".");
    benchmark::ClearRegisteredBenchmarks();
    const auto measured = nlohmann::json::parse(output.str());

    for (Run& run : runs) measure_edits(run, playback, steps);

    const std::string reference = References::is_large(scene) ? "cpu_parallel" : reference_backend;
    SceneResult result;
    result.context = measured.at("context");
    result.context.erase("host_name");  // results are published
    for (Run& run : runs) {
        nlohmann::json identity = row_identity(scene.name, run.contender->spec);
        identity["steps"] = steps;
        identity["particles"] = scene.problem.particle_count();
        identity["springs"] = springs;
        identity["voxels"] = scene.problem.lattice.voxel_count();
        identity["reference"] = reference;
        identity["error_steps"] = all_steps;

        if (run.failure.empty()) {
            const Comparison& comparison = run.comparison.value();
            nlohmann::json verified = identity;
            verified.update(run.errors);
            verified["passed"] = comparison.passed();
            verified["finite"] = comparison.finite;
            verified["error_rms"] = number_or_null(comparison.rms);
            verified["tolerance"] = number_or_null(comparison.tolerance);
            if (!run.work.empty()) verified["work"] = run.work;
            if (comparison.passed()) {
                identity.update(run.errors);
            } else {
                verified["reason"] = comparison.reason;
                run.failure = "does not agree with " + reference + ": " + comparison.reason;
            }
            result.lists["verification"].push_back(std::move(verified));
        }
        if (!run.failure.empty()) {
            identity["reason"] = run.failure;
            result.lists["failed"].push_back(std::move(identity));
            continue;
        }
        std::optional<StepLimit> limit;
        if (const auto& limits = run.contender->limits) {
            const StepWork work = run.contender->backend->step_work(scene.problem);
            limit = limit_of(work, *limits, run.contender->spec.options.precision);
        }
        for (nlohmann::json row : measured.at("benchmarks")) {
            const std::string row_name = row.at("run_name");
            if (!row_name.starts_with(run.name + "/iterations:")) continue;
            identity["name"] = row.at("name");  // Google Benchmark's, which goes on after ours
            row.update(identity);
            if (!run.edits.is_null()) row.update(run.edits);
            row["construct_seconds"] = run.contender->construct_seconds;
            row["compile_seconds"] = run.compile_seconds;
            row["upload_seconds"] = run.upload_seconds;
            row["ready_seconds"] =
                run.contender->construct_seconds + run.compile_seconds + run.upload_seconds;
            row.update(limit_fields(limit, step_seconds(row)));
            result.lists["benchmarks"].push_back(std::move(row));
        }
    }
    return result;
}

}  // namespace voxspring
