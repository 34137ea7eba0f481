#include "harness/study/measure.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <exception>
#include <numeric>
#include <sstream>
#include <string>
#include <utility>

#include "harness/base/interruption.h"
#include "harness/device/limits.h"
#include "harness/device/noise.h"
#include "harness/results/capabilities.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/divergence.h"
#include "harness/verification/errors.h"

namespace voxspring {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// Of this thread, what Google Benchmark calls cpu_time.
double cpu_seconds_of_thread() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return double(time.tv_sec) + 1e-9 * double(time.tv_nsec);
}

/// Steps from the state that the last batch of `batch` left back to the last rewind().
int steps_in_all(const Batch& batch) {
    return batch.rewind ? batch.steps : batch.steps * (1 + batch.repetitions);
}

/// Has every thread of OpenMP run for a moment. Those of a process that has waited for its turn sleep, wake
/// on the core of the thread that wakes them, and share it until the system moves them: for a short batch
/// that is all of its time.
void spread_threads() {
    constexpr double moment = 1e-2;  // several of the system's looks at who runs where
    const auto begin = Clock::now();
#pragma omp parallel
    while (seconds_since(begin) < moment) {
    }
}

/// What is timed of a backend, in its process.
class TimingRunner : public CaseRunner {
public:
    TimingRunner(BackendSpec spec, const Scene& scene, const Batch& batch, SharedState& shared)
        : spec_(std::move(spec)),
          scene_(scene),
          batch_(batch),
          shared_(shared),
          monitor_(divergence_monitor(scene, steps_in_all(batch))),
          runner_(scene) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        const std::string what = question.at("do");
        if (what == "warm up") return warm_up(backend, question.at("batches"));
        if (what == "repeat") return repeat(backend, question.at("last"));
        if (what == "edits") return edits(backend);
        const StepWork work = backend.step_work(scene_.problem);
        return {{"bytes", work.bytes},
                {"operations", work.operations},
                {"launches", work.launches},
                {"exchanges", work.exchanges}};
    }

private:
    /// Reads the state that has been reached; a run that diverged fails.
    nlohmann::json read(Backend& backend, int steps) {
        const State state = backend.download();
        if (const auto divergence = find_divergence(backend, runner_, monitor_, state, steps))
            throw std::runtime_error(describe(*divergence, monitor_));
        return shared_.put(state);
    }

    /// Uploads and advances, so that shaders are compiled and clocks are up before anything is timed; by one
    /// batch, and where batches go on from each other by those that were timed before. The work is that of
    /// the step after the batch: right after an upload a backend knows of nothing that rests.
    nlohmann::json warm_up(Backend& backend, int batches) {
        backend.monitor(monitor_);
        const auto begin = Clock::now();
        runner_.rewind(backend);
        const double compile_seconds = backend.compile_seconds();
        const double upload_seconds = std::max(0.0, seconds_since(begin) - compile_seconds);
        for (int i = 0; i < batches; ++i) runner_.run(backend, batch_.steps);
        backend.synchronize();
        if (backend.divergence()) (void)read(backend, batches * batch_.steps);
        // Counting takes a step, which only a rewind takes back.
        const WorkCount work = batch_.rewind ? backend.count_work() : WorkCount{};
        return {{"compile_seconds", compile_seconds}, {"upload_seconds", upload_seconds}, {"work", work}};
    }

    /// One timed batch, and the state that it leaves if it is the `last` one or has departed from its bounds.
    nlohmann::json repeat(Backend& backend, bool last) {
        if (batch_.rewind) runner_.rewind(backend);
        if (backend.capabilities().family == ApiFamily::cpu) spread_threads();
        const auto waited_begin = waited_seconds();
        const double cpu_begin = cpu_seconds_of_thread();
        const Timing timing = backend.timed([&] { runner_.run(backend, batch_.steps); });
        nlohmann::json answer = {{"cpu_seconds", cpu_seconds_of_thread() - cpu_begin},
                                 {"device_seconds", timing.device_seconds},
                                 {"host_seconds", timing.host_seconds}};
        if (const auto waited_end = waited_seconds(); waited_begin && waited_end) {
            // Of a shorter batch it would be said that this process waited while it read what is read here.
            constexpr double shortest = 5e-3;
            const bool counts = timing.host_seconds >= shortest;
            answer["waiting"] = counts ? (*waited_end - *waited_begin) / timing.host_seconds : 0.0;
        }
        answer["spin_seconds"] = spin_seconds();
        if (last || backend.divergence()) answer["state"] = read(backend, steps_in_all(batch_));
        if (runner_.edits_within(batch_.steps) > 0) {
            // Beside the batch with edits, so that both meet the same clocks.
            backend.upload(scene_.problem, scene_.state);
            const Timing plain = backend.timed([&] { backend.step(batch_.steps); });
            answer["plain_seconds"] = plain.device_seconds;
        }
        return answer;
    }

    /// The latency of each edit by itself, from a device that waits to one that waits again: the best of
    /// three plays, since an edit is far shorter than what may interrupt it.
    nlohmann::json edits(Backend& backend) {
        constexpr int plays = 3;
        std::vector<double> latency(std::size_t(runner_.edits_within(batch_.steps)), INFINITY);
        for (int play = 0; play < plays; ++play) {
            auto next = latency.begin();
            runner_.rewind(backend);
            runner_.run(backend, batch_.steps, [&](const Problem& edited, const SpringEdit& edit) {
                backend.synchronize();
                const auto begin = Clock::now();
                backend.edit(edited, edit);
                backend.synchronize();
                *next = std::min(*next, seconds_since(begin));
                ++next;
            });
            backend.synchronize();
        }
        return {{"edits", latency.size()},
                {"edit_seconds_median", median(latency)},
                {"edit_seconds_max", *std::max_element(latency.begin(), latency.end())}};
    }

    const BackendSpec spec_;
    const Scene& scene_;
    const Batch batch_;
    SharedState& shared_;
    const DivergenceMonitor monitor_;
    SceneRunner runner_;
};

StepWork step_work_of(const nlohmann::json& json) {
    return {.bytes = json.at("bytes"),
            .operations = json.at("operations"),
            .launches = json.at("launches"),
            .exchanges = json.at("exchanges")};
}

/// What all cases of a scene are measured with.
struct Course {
    const Scene& scene;
    const Batch& batch;
    const ReferenceSolution& solution;
    SharedState& state;
    int edits;                       ///< within a batch
    const Card* card;                ///< null: not watched
    const std::vector<Case>& cases;  ///< all of them, each with a process or not yet

    OwnProcesses own_processes() const {
        OwnProcesses own;
        for (const Case& benchmark_case : cases) {
            const auto process = benchmark_case.process();
            if (!process) continue;
            own.all.push_back(*process);
            if (!benchmark_case.capabilities().at("uuid").get<std::string>().empty()) ++own.on_card;
        }
        return own;
    }
};

/// One case while Google Benchmark calls it in whatever order it likes. What the journal has is not asked
/// of its process again.
class Run {
public:
    Run(Case& benchmark_case, const Course& course)
        : case_(benchmark_case),
          course_(course),
          name_(row_identity(course.scene.name, benchmark_case.spec()).at("name")),
          failure_(text_of(benchmark_case.scope().find("failed"))) {}

    Case& benchmark_case() { return case_; }
    const std::string& name() const { return name_; }
    /// Empty: none so far.
    const std::string& failure() const { return failure_; }
    void fail(const std::string& reason) {
        failure_ = reason;
        case_.scope().keep("failed", reason);
    }
    /// Whether there is nothing left to ask.
    bool finished() const {
        return !failure_.empty() || (known("repetition " + std::to_string(course_.batch.repetitions)) &&
                                     (course_.edits == 0 || known("edits")));
    }

    void warm_up() {
        if (finished()) return;
        attempt([&] {
            int done = 0;
            while (known("repetition " + std::to_string(done + 1))) ++done;
            const nlohmann::json warm = case_.ask(
                {{"do", "warm up"}, {"batches", course_.batch.rewind ? 1 : 1 + done}}, "warming up");
            if (known("warm")) return;
            // An earlier session may have been cut short between the two.
            if (!known("step work"))
                case_.scope().keep("step work", case_.ask({{"do", "step work"}}, "counting its work"));
            case_.scope().keep("warm", warm);
        });
    }

    bool is_next_to_run() const {
        return failure_.empty() && !known("repetition " + std::to_string(begun_ + 1));
    }
    /// The next repetition: what it took, or nothing where there is none because of a failure.
    std::optional<nlohmann::json> repeat() {
        const std::string name = "repetition " + std::to_string(++begun_);
        if (!known(name)) attempt([&] { case_.scope().keep(name, timed(name)); });
        if (!known(name)) return std::nullopt;
        return *case_.scope().find(name);
    }

    void measure_edits() {
        if (course_.edits == 0 || finished()) return;
        attempt([&] { case_.scope().keep("edits", case_.ask({{"do", "edits"}}, "timing its edits")); });
    }

    /// Whether its repetitions are of more than one session of the study.
    bool resumed() const {
        const auto session = [&](int number) {
            return case_.scope().session_of("repetition " + std::to_string(number));
        };
        return session(1) != session(course_.batch.repetitions);
    }

    const nlohmann::json& kept(const std::string& name) const { return *case_.scope().find(name); }
    bool known(const std::string& name) const { return case_.scope().find(name) != nullptr; }

private:
    static std::string text_of(const nlohmann::json* text) {
        return text == nullptr ? "" : text->get<std::string>();
    }

    void attempt(const std::function<void()>& action) {
        if (!failure_.empty()) return;
        if (const auto failure = failure_of(action)) fail(*failure);
    }

    nlohmann::json timed(const std::string& name) {
        const bool last = begun_ == course_.batch.repetitions;
        nlohmann::json answer = case_.ask({{"do", "repeat"}, {"last", last}}, "timing " + name);
        for (const char* clock : {"device_seconds", "host_seconds"}) {
            if (!std::isfinite(answer.at(clock).get<double>()))
                throw std::runtime_error(std::string("its clock gave no number of ") + clock);
        }
        look_at_card(answer);
        if (!answer.contains("state")) return answer;
        // Judged at once: of a large scene the states of all cases would not fit into memory.
        const State left = course_.state.take(answer.at("state"));
        answer.erase("state");
        const Comparison comparison = judge(course_.solution, left, case_.spec());
        answer["errors"] = error_fields(course_.solution, left, comparison);
        answer["verified"] = {{"passed", comparison.passed()},
                              {"finite", comparison.finite},
                              {"error_rms", number_or_null(comparison.rms)},
                              {"tolerance", number_or_null(comparison.tolerance)}};
        if (!comparison.passed()) answer["verified"]["reason"] = comparison.reason;
        return answer;
    }

    /// Right after a batch, before the card's clock has had time to fall.
    void look_at_card(nlohmann::json& answer) {
        const std::string uuid = case_.capabilities().at("uuid");
        if (course_.card == nullptr || uuid.empty()) return;
        if (const auto mhz = course_.card->clock_mhz()) answer["card_mhz"] = *mhz;
        if (const auto processes = course_.card->processes())
            answer["other_users"] = other_processes(*processes, course_.own_processes());
    }

    Case& case_;
    const Course& course_;
    std::string name_;
    std::string failure_;
    int begun_ = 0;
};

/// One repetition: Google Benchmark's iteration is one step. It is not told of a failure, since it aborts
/// where some repetitions of a benchmark fail and others do not; measure() drops the rows of who failed.
void repeat(benchmark::State& state, Run& run, const Course& course, std::uint64_t springs,
            std::exception_ptr& stopped) {
    const int steps = course.batch.steps;
    double device_seconds = 1, host_seconds = 1;  // of no meaning, but statistics of it are finite
    try {
        const auto timed = stopped ? std::nullopt : run.repeat();
        if (timed) {
            device_seconds = timed->at("device_seconds");
            host_seconds = timed->at("host_seconds");
        }
    } catch (...) {
        stopped = std::current_exception();
    }
    while (state.KeepRunningBatch(steps)) state.SetIterationTime(device_seconds);
    using benchmark::Counter;
    state.counters["particle_updates_per_second"] =
        Counter(double(course.scene.problem.particle_count()) * steps, Counter::kIsRate);
    state.counters["spring_updates_per_second"] = Counter(double(springs) * steps, Counter::kIsRate);
    state.counters["host_seconds_per_step"] = host_seconds / steps;
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

/// Google Benchmark's statistic of that name.
double statistic(const std::string& name, const std::vector<double>& values) {
    const double count = double(values.size());
    const double mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
    if (name == "mean") return mean;
    if (name == "median") {
        std::vector<double> sorted = values;
        std::sort(sorted.begin(), sorted.end());
        const std::size_t middle = sorted.size() / 2;
        return sorted.size() % 2 == 1 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
    }
    double squares = 0;
    for (const double value : values) squares += (value - mean) * (value - mean);
    const double deviation = std::sqrt(squares / (count - 1));
    return name == "stddev" ? deviation : deviation / mean;
}

/// What Google Benchmark would have said of cpu_time, had it run in the case's process.
double cpu_time(const nlohmann::json& row, const std::vector<double>& step_microseconds) {
    if (row.at("run_type") == "aggregate") return statistic(row.at("aggregate_name"), step_microseconds);
    return step_microseconds.at(row.at("repetition_index").get<std::size_t>());
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

void add_failures(SceneResult& result, const std::string& scene, std::vector<Case>& cases) {
    for (Case& benchmark_case : cases) {
        const nlohmann::json* reason = benchmark_case.scope().find("failed");
        if (reason == nullptr) continue;
        result.lists["failed"].push_back(row_identity(scene, benchmark_case.spec()));
        result.lists["failed"].back()["reason"] = *reason;
    }
}

MakeCaseRunner timing_runner(const Scene& scene, const Batch& batch, SharedState& state) {
    return [&scene, batch, &state](const BackendSpec& spec) {
        return std::make_unique<TimingRunner>(spec, scene, batch, state);
    };
}

namespace {

/// Times all runs, interleaved; Google Benchmark's result.
nlohmann::json run_google_benchmark(std::vector<Run>& runs, const Course& course, std::uint64_t springs,
                                    const OnRepetition& on_repetition) {
    initialize_google_benchmark();
    const int repetitions = course.batch.repetitions;
    const int total = repetitions * int(runs.size());
    int begun = 0;
    // Google Benchmark is not made for exceptions to pass through.
    std::exception_ptr stopped;
    benchmark::ClearRegisteredBenchmarks();
    for (Run& run : runs) {
        if (!run.finished()) on_repetition(run.benchmark_case().spec().label(), 0, total);
        run.warm_up();
        benchmark::RegisterBenchmark(run.name().c_str(),
                                     [&, total](benchmark::State& state) {
                                         ++begun;
                                         if (run.is_next_to_run() && !stopped && !interrupted())
                                             on_repetition(run.benchmark_case().spec().label(), begun, total);
                                         repeat(state, run, course, springs, stopped);
                                     })
            ->Iterations(course.batch.steps)
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
    if (stopped) std::rethrow_exception(stopped);
    return nlohmann::json::parse(output.str());
}

/// What edits cost, as rows say it; empty where a scene has none.
nlohmann::json edit_fields(const Run& run, const Course& course) {
    if (course.edits == 0) return nlohmann::json::object();
    std::vector<double> plain;
    for (int i = 1; i <= course.batch.repetitions; ++i) {
        const nlohmann::json& repetition = run.kept("repetition " + std::to_string(i));
        plain.push_back(repetition.at("plain_seconds").get<double>() / course.batch.steps);
    }
    nlohmann::json fields = run.kept("edits");
    fields["seconds_per_step_without_edits"] = median(plain);
    return fields;
}

/// What all rows of a run say: how long it took to be ready.
nlohmann::json ready_fields(const Run& run) {
    const nlohmann::json& warm = run.kept("warm");
    const double construct = run.kept("introduction").at("construct_seconds");
    const double compile = warm.at("compile_seconds"), upload = warm.at("upload_seconds");
    return {{"construct_seconds", construct},
            {"compile_seconds", compile},
            {"upload_seconds", upload},
            {"ready_seconds", construct + compile + upload}};
}

/// Why its time is not to be trusted.
std::vector<std::string> noise_of(Run& run, const Course& course) {
    // What the processor does says nothing of a card.
    const std::string uuid = run.benchmark_case().capabilities().at("uuid");
    Observed observed;
    for (int i = 1; i <= course.batch.repetitions; ++i) {
        const nlohmann::json& repetition = run.kept("repetition " + std::to_string(i));
        observed.seconds.push_back(repetition.at("device_seconds"));
        if (uuid.empty()) {
            observed.spins.push_back(repetition.at("spin_seconds"));
            if (repetition.contains("waiting")) observed.waits.push_back(repetition.at("waiting"));
        }
        if (repetition.contains("card_mhz")) observed.card_mhz.push_back(repetition.at("card_mhz"));
        if (repetition.contains("other_users")) observed.other_users.push_back(repetition.at("other_users"));
    }
    return reasons_of_noise(observed);
}

/// Google Benchmark's rows of a run that passed, with our fields.
std::vector<nlohmann::json> rows_of(Run& run, const Course& course, const nlohmann::json& measured,
                                    nlohmann::json identity) {
    std::optional<StepLimit> limit;
    if (const auto& limits = run.benchmark_case().limits) {
        limit = limit_of(step_work_of(run.kept("step work")), *limits,
                         run.benchmark_case().spec().options.precision);
    }
    std::vector<double> cpu_microseconds;
    for (int i = 1; i <= course.batch.repetitions; ++i) {
        const nlohmann::json& repetition = run.kept("repetition " + std::to_string(i));
        cpu_microseconds.push_back(1e6 * repetition.at("cpu_seconds").get<double>() / course.batch.steps);
    }
    const std::vector<std::string> noise = noise_of(run, course);
    std::vector<nlohmann::json> rows;
    for (nlohmann::json row : measured.at("benchmarks")) {
        const std::string row_name = row.at("run_name");
        if (!row_name.starts_with(run.name() + "/iterations:")) continue;
        identity["name"] = row.at("name");  // Google Benchmark's, which goes on after ours
        row.update(identity);
        row.update(edit_fields(run, course));
        row.update(ready_fields(run));
        if (run.resumed()) row["resumed"] = true;
        if (!noise.empty()) row["noisy"] = noise;
        row["cpu_time"] = cpu_time(row, cpu_microseconds);
        row.update(limit_fields(limit, step_seconds(row)));
        rows.push_back(std::move(row));
    }
    return rows;
}

/// Adds the rows of a finished run to `result`.
void add_rows(SceneResult& result, Run& run, const Course& course, const nlohmann::json& measured,
              std::uint64_t springs) {
    const Scene& scene = course.scene;
    const std::string reference = References::is_large(scene) ? "cpu_parallel" : reference_backend;
    nlohmann::json identity = row_identity(scene.name, run.benchmark_case().spec());
    identity["steps"] = course.batch.steps;
    identity["particles"] = scene.problem.particle_count();
    identity["springs"] = springs;
    identity["voxels"] = scene.problem.lattice.voxel_count();
    identity["reference"] = reference;
    identity["error_steps"] = course.solution.steps;

    std::string failure = run.failure();
    if (failure.empty()) {
        const nlohmann::json& last = run.kept("repetition " + std::to_string(course.batch.repetitions));
        nlohmann::json verified = identity;
        verified.update(last.at("errors"));
        verified.update(last.at("verified"));
        const nlohmann::json& work = run.kept("warm").at("work");
        if (!work.empty()) verified["work"] = work;
        if (verified.at("passed").get<bool>()) {
            identity.update(last.at("errors"));
        } else {
            failure = "does not agree with " + reference + ": " + verified.at("reason").get<std::string>();
        }
        result.lists["verification"].push_back(std::move(verified));
    }
    if (!failure.empty()) {
        identity["reason"] = failure;
        result.lists["failed"].push_back(std::move(identity));
        return;
    }
    for (nlohmann::json& row : rows_of(run, course, measured, std::move(identity)))
        result.lists["benchmarks"].push_back(std::move(row));
}

}  // namespace

SceneResult measure(const Scene& scene, std::vector<Case>& cases, const Batch& batch, SharedState& state,
                    References& references, const Card* card, const OnRepetition& on_repetition) {
    const int all_steps = steps_in_all(batch);
    const std::uint64_t springs = count_springs(scene.problem).total();

    std::optional<Problem> edited;
    if (!scene.edits.empty()) edited = problem_after(scene, all_steps);
    ReferenceSolution solution{edited ? *edited : scene.problem, all_steps, {}, {}, {}};
    solution.same_step = references.after(scene, all_steps);
    solution.chaos = references.chaos(scene, all_steps);
    solution.conserved = conserved(solution.problem, solution.same_step);
    if (batch.total_error) {
        solution.refined = references.refined(scene, {scene.problem.time_step, all_steps}, {all_steps});
    } else {
        solution.refined.reason = "the study does not ask for it";
    }

    const Course course{scene, batch, solution, state, SceneRunner(scene).edits_within(batch.steps),
                        card,  cases};
    std::vector<Run> runs;
    for (Case& benchmark_case : cases) runs.emplace_back(benchmark_case, course);
    const nlohmann::json measured = run_google_benchmark(runs, course, springs, on_repetition);
    for (Run& run : runs) run.measure_edits();

    SceneResult result;
    result.context = measured.at("context");
    result.context.erase("host_name");  // results are published
    for (Run& run : runs) {
        if (run.finished()) add_rows(result, run, course, measured, springs);
    }
    return result;
}

}  // namespace voxspring
