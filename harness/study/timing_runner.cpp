#include "harness/study/timing_runner.h"

#include <omp.h>
#include <sched.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/clock.h"
#include "harness/base/statistics.h"
#include "harness/base/thread_count.h"
#include "harness/device/energy.h"
#include "harness/device/noise.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/divergence.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

/// Lets every OpenMP thread run for a moment before a timing. While the process waits for its turn the
/// threads sleep. They wake on the core of the thread that wakes them, and share it until the system moves
/// them, which may take as long as a short batch.
void spread_threads() {
    constexpr double moment = 1e-2;  // several periods of the system's scheduler
    const auto begin = Clock::now();
#pragma omp parallel
    while (seconds_since(begin) < moment) {
    }
}

/// The number of threads that the user has chosen for a backend on the processor; 0: none.
int threads_of(const BackendSpec& spec) {
    const auto chosen = spec.options.tuning.find("threads");
    return chosen == spec.options.tuning.end() || chosen->second == "auto" ? 0 : std::stoi(chosen->second);
}

/// While this object lives, each OpenMP thread is pinned to a processor that no other OpenMP thread uses,
/// unless there are more threads than processors. The system would otherwise move threads, or let two share a
/// core, in some batches and not in others.
class PinnedThreads {
public:
    /// `threads`: how many threads step, if that is more than OpenMP's default. Threads that start later
    /// would share the processor of the thread that starts them.
    explicit PinnedThreads(int threads) {
        std::vector<int> processors;
        if (sched_getaffinity(0, sizeof before_, &before_) != 0) return;
        for (int n = 0; n < CPU_SETSIZE; ++n) {
            if (CPU_ISSET(n, &before_)) processors.push_back(n);
        }
        if (std::size_t(std::max(threads, omp_get_max_threads())) > processors.size()) return;
        pinned_ = true;
#pragma omp parallel
        {
            cpu_set_t one;
            CPU_ZERO(&one);
            CPU_SET(processors[std::size_t(omp_get_thread_num())], &one);
            (void)sched_setaffinity(0, sizeof one, &one);
        }
    }
    PinnedThreads(const PinnedThreads&) = delete;
    PinnedThreads& operator=(const PinnedThreads&) = delete;
    ~PinnedThreads() {
        if (!pinned_) return;
#pragma omp parallel
        (void)sched_setaffinity(0, sizeof before_, &before_);
    }

private:
    cpu_set_t before_ = {};
    bool pinned_ = false;
};

/// While this object lives, the process has one thread per processor, as a program that edits a body would
/// have. Some backends rebuild tables on the host at an edit, and edits are timed. No other case is being
/// prepared meanwhile.
class AllProcessors {
public:
    AllProcessors() {
#pragma omp parallel
        {}  // starts the threads before anything is timed
    }

private:
    const ThreadCount all_{omp_get_num_procs()};
};

class TimingRunner : public CaseRunner {
public:
    TimingRunner(BackendSpec spec, const Scene& scene, const nlohmann::json& parameters, SharedState* shared)
        : spec_(std::move(spec)),
          scene_(scene),
          batch_(parameters.get<Batch>()),
          shared_(*shared),
          monitor_(divergence_monitor(scene, steps_in_all(batch_))),
          runner_(scene) {}

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        const std::string what = question.at("do");
        if (what == "warm up") return warm_up(backend, question.at("batches"));
        if (what == "repeat") return repeat(backend);
        if (what == "state") return read(backend, steps_in_all(batch_));
        if (what == "fingerprint") return batch_left_ = fingerprint_of(backend);
        if (what == "edits") return edits(backend);
        if (what == "sustain") return sustain(backend, question.at("seconds"));
        if (what == "strained") return strained(backend);
        if (what == "compile") return compile();
        if (what == "launch") {
            const std::optional<double> seconds = backend.limits()->own_launch_seconds();
            return seconds ? nlohmann::json(*seconds) : nlohmann::json();
        }
        if (backend.limits() == nullptr) return nullptr;
        return backend.limits()->step_work(scene_.problem);
    }

private:
    /// Downloads the backend's present state into the shared memory. Returns the sizes of its lists. Throws
    /// if the run diverged.
    nlohmann::json read(Backend& backend, int steps) {
        const State state = backend.download();
        if (const auto divergence = find_divergence(backend, runner_, monitor_, state, steps))
            throw std::runtime_error(describe(*divergence, monitor_));
        return shared_.put(state);
    }

    /// Uploads to a second backend of the same kind, which compiles kernels for the whole process. The case's
    /// own backend must not be used for that, since its first upload will be timed.
    nlohmann::json compile() {
        const std::unique_ptr<Backend> other = spec_.make();
        SceneRunner(scene_).rewind(*other);
        compiled_seconds_ = other->compile_time().cold;
        return nullptr;
    }

    /// Uploads and makes steps, so that shaders are compiled and the device's clocks are high before a batch
    /// is timed. The work is counted for the step after the batches, since right after an upload a backend
    /// does not know yet which tiles rest.
    nlohmann::json warm_up(Backend& backend, int batches) {
        backend.monitor(monitor_);
        const auto begin = Clock::now();
        runner_.rewind(backend);
        const CompileTime compiling = backend.compile_time();
        const double upload_seconds = std::max(0.0, seconds_since(begin) - compiling.spent);
        if (batch_.rewind) runner_.keep_start(backend);
        for (int i = 0; i < batches; ++i) runner_.run(backend, batch_.steps);
        backend.synchronize();
        if (backend.divergence()) (void)read(backend, batches * batch_.steps);
        // Batches that begin at the start repeat the steps checked here, so they are timed without checks,
        // which are more frequent in some APIs than in others.
        if (batch_.rewind) backend.monitor({});
        // Counting makes a step, which only a rewind can undo.
        const WorkCount work = batch_.rewind ? backend.count_work() : WorkCount{};
        nlohmann::json answer = {{"compile_seconds", std::max(compiled_seconds_, compiling.cold)},
                                 {"upload_seconds", upload_seconds},
                                 {"work", work}};
        if (const auto choice = backend.choice()) {
            answer["chosen"] = choice->tuning;
            if (choice->step_seconds) answer["predicted_seconds"] = *choice->step_seconds;
        }
        return answer;
    }

    /// For a scene with edits: times a batch without them, rewinds, and returns the time. This is done right
    /// before the batch with edits, so that both run at the same clocks. Empty if the scene has no edits.
    std::optional<double> plain(Backend& backend) {
        if (runner_.edits_within(batch_.steps) == 0) return std::nullopt;
        const Timing timing = backend.timed([&] { backend.step(batch_.steps); });
        runner_.rewind(backend);
        return timing.device_seconds;
    }

    /// Runs one timed batch and returns its times.
    nlohmann::json repeat(Backend& backend) {
        if (batch_.rewind) runner_.rewind(backend);
        std::optional<AllProcessors> all;
        if (runner_.edits_within(batch_.steps) > 0) all.emplace();
        std::optional<PinnedThreads> pinned;
        if (backend.capabilities().steps_on_host()) {
            pinned.emplace(threads_of(spec_));
            spread_threads();
        }
        const std::optional<double> plain_seconds = plain(backend);
        const auto waited_begin = waited_seconds();
        const double cpu_begin = processor_seconds(CLOCK_THREAD_CPUTIME_ID);
        const Timing timing = backend.timed([&] { runner_.run(backend, batch_.steps); });
        nlohmann::json answer = {{"cpu_seconds", processor_seconds(CLOCK_THREAD_CPUTIME_ID) - cpu_begin},
                                 {"device_seconds", timing.device_seconds},
                                 {"host_seconds", timing.host_seconds}};
        if (plain_seconds) answer["plain_seconds"] = *plain_seconds;
        if (const auto waited_end = waited_seconds(); waited_begin && waited_end) {
            // In a shorter batch the time for reading these figures would itself count as waiting.
            constexpr double shortest = 5e-3;
            const bool counts = timing.host_seconds >= shortest;
            answer["waiting"] = counts ? (*waited_end - *waited_begin) / timing.host_seconds : 0.0;
        }
        answer["spin_seconds"] = spin_seconds();
        // Batches that continue from each other are still monitored.
        if (backend.divergence()) (void)read(backend, steps_in_all(batch_));
        return answer;
    }

    /// Uploads and runs batches without a pause: for a third of `seconds` until clocks settle, and then for
    /// `seconds`. Returns for those `seconds` the mean time of a step by the backend's clock, and what the
    /// device's meter says, if it has one. If the backend is deterministic and batches rewind, the last batch
    /// must leave the same state as the repetitions.
    nlohmann::json sustain(Backend& backend, double seconds) {
        std::optional<PinnedThreads> pinned;
        if (backend.capabilities().steps_on_host()) pinned.emplace(threads_of(spec_));
        const bool comparable = batch_.rewind && backend.capabilities().deterministic;
        SceneRunner& runner = sustained_.emplace(scene_);
        runner.rewind(backend);
        if (batch_.rewind) runner.keep_start(backend);
        double stepped = 0;
        std::int64_t batches = 0;
        const auto batch = [&] {
            if (batch_.rewind) runner.rewind(backend);
            stepped += backend.timed([&] { runner.run(backend, batch_.steps); }).device_seconds;
            ++batches;
        };
        batch();
        // The repetitions of a resumed study were made by another process, and batch_left_ is empty.
        if (comparable && batch_left_.empty()) batch_left_ = fingerprint_of(backend);
        for (const auto begin = Clock::now(); seconds_since(begin) < seconds / 3;) batch();
        stepped = 0;
        batches = 0;
        nlohmann::json answer;
        try {
            const auto meter = energy_meter_of(backend.capabilities());
            const EnergyUse use = measure_energy(*meter, 0, seconds, batch);
            answer["watts"] = use.watts;
            if (use.min_mhz) answer["min_mhz"] = *use.min_mhz;
        } catch (const UnknownEnergy&) {
            // Only the time is measured. A meter that failed did so after all batches.
        }
        if (batches == 0) {
            const auto begin = Clock::now();
            do {
                batch();
            } while (seconds_since(begin) < seconds);
        }
        answer["seconds_per_step"] = stepped / (double(batches) * batch_.steps);
        if (comparable && fingerprint_of(backend) != batch_left_)
            throw std::runtime_error("batches without a pause left another state than a batch by itself");
        return answer;
    }

    /// The latency of each edit by itself, from an idle device until it is idle again. Of three runs the
    /// shortest latency counts, since an edit is far shorter than what may interrupt it. If the backend is
    /// deterministic, the last run must leave the same state as a batch that does not wait for its edits,
    /// since only such a batch is judged.
    nlohmann::json edits(Backend& backend) {
        constexpr int plays = 3;
        const AllProcessors all;
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
        if (backend.capabilities().deterministic) {
            const std::string left = fingerprint_of(backend);
            if (batch_left_.empty()) {  // the repetitions of a resumed study were made by another process
                runner_.rewind(backend);
                runner_.run(backend, batch_.steps);
                batch_left_ = fingerprint_of(backend);
            }
            if (left != batch_left_)
                throw std::runtime_error(
                    "edits timed by themselves left another state than the same edits in a batch");
        }
        return {{"edits", latency.size()},
                {"edit_seconds_median", median(latency)},
                {"edit_seconds_max", *std::max_element(latency.begin(), latency.end())}};
    }

    /// Runs a batch from a start in which every spring is strained. Afterwards the case's process must not be
    /// asked for a run with runner_.
    nlohmann::json strained(Backend& backend) {
        const State start = strained_start(scene_.problem);
        backend.monitor({});
        strained_.emplace(scene_).start_from(0, start);
        strained_->rewind(backend);
        strained_->run(backend, batch_.steps);
        return shared_.put(backend.download());
    }

    const BackendSpec spec_;
    const Scene& scene_;
    const Batch batch_;
    SharedState& shared_;
    const DivergenceMonitor monitor_;
    SceneRunner runner_;
    std::optional<SceneRunner> strained_, sustained_;  ///< keep the problem that the backend reads
    double compiled_seconds_ = 0;                      ///< time of compile(), before the warm-up
    std::string batch_left_;  ///< hash of the state that a batch left; empty: not known
};

const RegisteredCaseRunner registered("timing", case_runner_of<TimingRunner>);

}  // namespace

int steps_in_all(const Batch& batch) {
    return batch.rewind ? batch.steps : batch.steps * (1 + batch.repetitions);
}

CaseProgram timing_program(const Batch& batch, SharedState& shared) { return {"timing", batch, &shared}; }

}  // namespace voxspring
