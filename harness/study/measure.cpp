#include "harness/study/measure.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/interruption.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/device/noise.h"
#include "harness/results/capabilities.h"
#include "harness/results/google_benchmark.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/kernel_trial.h"
#include "harness/verification/random_starts.h"

namespace voxspring {
namespace {

/// A run of a batch's steps from a start in which every spring is strained. It verifies backends for which
/// the scene's own start strains too few springs: in few steps most of a large body falls freely.
struct StrainedRun {
    Scene scene;
    std::optional<ReferenceSolution> solution;  ///< empty: no case has needed it yet
};

/// What the measurements of all cases of a scene share.
struct MeasurementContext {
    const Scene& scene;
    const Batch& batch;
    const std::optional<ReferenceSolution>& solution;  ///< present once the first warm-up has ended
    SharedState& state;
    State& left;  ///< receives the state that a case left
    int edits;    ///< number of edits within a batch
    const StrainedRun& strained;
    const Card* card;                ///< null: no card is watched
    const std::vector<Case>& cases;  ///< all cases, whether they have a process yet or not

    OwnProcesses own_processes() const {
        OwnProcesses own;
        for (const Case& one : cases) {
            const auto process = one.process();
            if (!process || std::find(own.all.begin(), own.all.end(), *process) != own.all.end()) continue;
            own.all.push_back(*process);
            if (!capabilities_of(one.capabilities()).uuid.empty()) ++own.on_card;
        }
        return own;
    }
};

/// How many starts of a backend (construction, compilation, upload) are measured. After max_start_seconds no
/// further start is begun.
constexpr std::size_t starts = 3;
constexpr double max_start_seconds = 5;
constexpr const char* launch_before = "launch";
constexpr const char* launch_after = "launch afterwards";
std::string name_of_repetition(int number) { return "repetition " + std::to_string(number); }

/// One case while it is timed. Results that the journal already has are not measured again.
class TimedCase {
public:
    TimedCase(Case& benchmark_case, const MeasurementContext& context)
        : case_(benchmark_case), context_(context) {
        if (const nlohmann::json* reason = case_.scope().find("failed")) failure_ = *reason;
        if (known("repetitions")) {
            for (const nlohmann::json& one : kept("repetitions")) count(one);
        }
    }

    const BackendSpec& spec() const { return case_.spec(); }
    std::string label() const { return spec().label(); }
    /// Whether the journal has neither the repetitions of this case nor a failure.
    bool is_new() const { return !known("repetitions") && failure_.empty(); }
    /// Whether the case failed in a process that it shares with others. Then another one may be at fault: it
    /// may have ended the process, or written into this case's memory. The case has to be measured again,
    /// alone.
    bool failed_beside_others() const { return failed_beside_others_; }
    /// How many repetitions are missing; 0 if the case has failed.
    int missing() const {
        constexpr int least = 2;
        const Batch& batch = context_.batch;
        const bool took_long = done() >= least && seconds_ >= batch.most_seconds;
        return has_failed() || took_long ? 0 : batch.repetitions - done();
    }
    /// Whether the case has all that its rows need. Needs the reference only if no repetition is missing.
    bool finished() const {
        if (failed_beside_others_) return false;
        return has_failed() || (missing() == 0 && !unjudged_ && (context_.edits == 0 || known("edits")) &&
                                !lacks_strained_start());
    }

    /// Starts a compilation in the case's process, if that saves time, and returns whether it was started. It
    /// saves none for a large scene, since compiling requires an upload, which takes longer than the
    /// compilation. It saves none for APIs other than CUDA either: they compile faster than a second backend
    /// is constructed.
    bool begin_compiling() {
        const bool compiles = !capabilities_of(case_.capabilities()).kernel_compiler.empty();
        if (!compiles || known("warm") || is_heavy(context_.scene)) return false;
        return begin({{"do", "compile"}}, compiling_);
    }
    void finish_compiling() {
        if (!std::exchange(compiling_, false)) return;
        attempt([&] { case_.finish("compiling"); });
    }

    /// Starts to count the work of a step in the case's process, before the first upload.
    void begin_counting() {
        if (!finished() && !known("step work")) begin({{"do", "step work"}}, counting_);
    }
    void finish_counting() {
        if (!std::exchange(counting_, false)) return;
        attempt([&] { case_.scope().keep("step work", case_.finish("counting its work")); });
    }
    /// Measures the time of a kernel launch in the case's process, if launches limit the speed of its steps.
    /// It is measured before and after the repetitions, and the shorter time counts: other activity of the
    /// processor may last for seconds, and must not raise the limit of a step.
    void measure_launch(const char* when) {
        if (has_failed() || !case_.process() || known(when)) return;
        if (bound(launch_seconds(), {}).longest.limited_by != "launch") return;
        attempt([&] { case_.scope().keep(when, case_.ask({{"do", "launch"}}, "measuring a launch")); });
    }
    /// The shortest time of a launch that the case's process measured; empty if it measured none.
    std::optional<double> launch_seconds() const {
        std::optional<double> least;
        for (const char* when : {launch_before, launch_after}) {
            if (known(when) && kept(when).is_number())
                least = std::min(least.value_or(INFINITY), kept(when).get<double>());
        }
        return least;
    }
    /// Starts the warm-up in the case's process, unless the case is finished. Returns whether it was started.
    bool begin_warming_up() { return !finished() && begin({{"do", "warm up"}, {"batches", 1}}, warming_up_); }
    void finish_warming_up() {
        if (!std::exchange(warming_up_, false)) return;
        attempt([&] {
            nlohmann::json warm = case_.finish("warming up");
            if (case_.shares_process()) warm["shared_process"] = true;
            if (!known("warm")) case_.scope().keep("warm", warm);
        });
    }

    /// Starts the backend some more times, each in a separate process, since a single start says nothing
    /// about how much starts vary.
    void measure_starts(StudyBench& bench) {
        if (finished() || !context_.batch.start_times || known("starts")) return;
        bench.show("starting " + label() + " once more", 0, 1);
        attempt([&] {
            nlohmann::json samples = nlohmann::json::array();
            const auto begin = Clock::now();
            while (samples.size() + 1 < starts && seconds_since(begin) < max_start_seconds) {
                const auto answers = case_.afresh({nlohmann::json{{"do", "warm up"}, {"batches", 0}}},
                                                  "starting once more", true);
                samples.push_back({{"construct_seconds", answers.front().at("construct_seconds")},
                                   {"compile_seconds", answers.back().at("compile_seconds")},
                                   {"upload_seconds", answers.back().at("upload_seconds")}});
            }
            case_.scope().keep("starts", samples);
        });
    }

    /// Makes the next repetition, unless the case has failed. The journal gets all repetitions of a case
    /// together, once the state after the last one has been judged: a device's hashes of states can be
    /// compared only within a process.
    void repeat() {
        attempt([&] {
            if (done() > 0 && process_of(done()) != process_of(done() - 1)) {
                case_.restart();
                (void)case_.ask({{"do", "warm up"}, {"batches", 1}}, "warming up");
            }
            count(timed());
            unjudged_ = missing() == 0;
            if (context_.batch.rewind) look_at_state(repetitions_.back());
        });
    }

    /// Starts to read the state that the last repetition left in the case's process.
    void begin_reading() {
        if (unjudged_) begin({{"do", "state"}}, reading_);
    }
    bool is_reading() const { return reading_; }
    /// Waits for the state that is being read, and takes it.
    void finish_reading() {
        if (!std::exchange(reading_, false)) return;
        attempt([&] {
            context_.state.take(case_.finish("reading the state that it left"), context_.left);
            read_ = true;
        });
    }
    /// Judges the state that finish_reading() took.
    void judge_state() {
        if (!std::exchange(read_, false)) return;
        attempt([&] {
            Row verified = judged();
            const std::string reason = other_repetition();
            if (verified.verdict->passed && !reason.empty()) {
                verified.verdict->passed = false;
                verified.reason = reason;
            }
            refuse_beside_others(verified);
            verified.verdict->repetitions_judged = done();
            repetitions_.back()["verified"] = to_json(verified);
            case_.scope().keep("repetitions", repetitions_);
            unjudged_ = false;
        });
    }

    void measure_edits() {
        if (context_.edits == 0 || known("edits")) return;
        attempt([&] { case_.scope().keep("edits", case_.ask({{"do", "edits"}}, "timing its edits")); });
    }

    /// Whether the case is finished, has not failed, and left states that agree with the reference.
    bool passed() const { return !has_failed() && finished() && verified().verdict->passed; }
    /// The time of a batch by which a case that passed is chosen as the fastest, in seconds.
    double seconds() const { return medians_of_halves(observed().seconds).first; }
    bool on_host() const { return capabilities_of(case_.capabilities()).steps_on_host(); }
    /// Steps without a pause in the case's process, after everything else that is measured in it. The
    /// processes of other cases do nothing meanwhile.
    void sustain() {
        if (known("sustained")) return;
        attempt([&] {
            const nlohmann::json question = {{"do", "sustain"},
                                             {"seconds", context_.batch.sustained_seconds}};
            case_.scope().keep("sustained", case_.ask(question, "stepping without a pause"));
        });
    }

    /// Whether the scene's own start strains too few springs to verify the case.
    bool needs_strained_start() const { return own_share() < min_strained_share; }
    bool lacks_strained_start() const {
        return !has_failed() && needs_strained_start() && !known("strained");
    }
    /// Starts a batch from the strained start in the case's process, after everything that is timed but
    /// sustain().
    void begin_strained_start() {
        if (lacks_strained_start()) begin({{"do", "strained"}}, reading_);
    }
    /// Judges the state that finish_reading() took.
    void judge_strained_start();

    /// Adds the rows of the case. `number` is the index of the case among the cases of the scene.
    void add_rows(StudyBench& bench, int number);
    /// Reports launch_seconds() to the bench.
    void tell_launch(StudyBench& bench) const {
        if (const auto seconds = launch_seconds())
            bench.limits().improve_launch(capabilities_of(case_.capabilities()), *seconds);
    }

private:
    bool known(const std::string& name) const { return case_.scope().find(name) != nullptr; }
    const nlohmann::json& kept(const std::string& name) const { return *case_.scope().find(name); }
    int done() const { return int(repetitions_.size()); }

    bool has_failed() const { return failed_beside_others_ || !failure_.empty(); }

    void attempt(const std::function<void()>& action) {
        if (has_failed()) return;
        const auto failure = failure_of(action);
        if (!failure) return;
        if (case_.shares_process()) {
            case_.say_measured_again(*failure);
            failed_beside_others_ = true;
            return;
        }
        failure_ = *failure;
        case_.scope().keep("failed", *failure);
    }
    /// Asks the case's process `question`, without waiting for the answer. Sets `begun` if that did not fail,
    /// and returns it.
    bool begin(const nlohmann::json& question, bool& begun) {
        attempt([&] {
            case_.begin(question);
            begun = true;
        });
        return begun;
    }

    /// Throws if a state that was left in a shared process does not agree with the reference.
    void refuse_beside_others(const Row& verified) const {
        if (case_.shares_process() && !verified.verdict->passed)
            throw std::runtime_error(verified.reason.value_or(""));
    }

    void count(nlohmann::json repetition) {
        seconds_ += repetition.at("host_seconds").get<double>();
        repetitions_.push_back(std::move(repetition));
    }
    /// The index of the process that makes a repetition. A backend that steps on the host is timed in several
    /// processes if batches rewind, since its time depends on where a process's memory and threads lie.
    int process_of(int repetition) const {
        const int processes = on_host() && context_.batch.rewind ? host_processes : 1;
        return repetition * processes / std::max(processes, context_.batch.repetitions);
    }
    nlohmann::json timed();
    /// The share of the springs that the scene's own start strains.
    double own_share() const { return strained_share(*context_.solution, spec()); }
    Row judged() const { return judged_row(*context_.solution, context_.left, case_.spec(), own_share()); }
    /// Errors and verdict of a case that is finished and has not failed.
    Row verified() const {
        Row row = row_from_json(repetitions_.back().at("verified"));
        if (needs_strained_start()) add_strained(row, row_from_json(kept("strained")));
        return row;
    }
    void look_at_state(nlohmann::json& answer);
    std::string other_repetition() const;
    void look_at_card(nlohmann::json& answer);

    EditPart edit_part() const;
    StartPart start_part(Counters& counters) const;
    bool leaves_out_tiles() const;
    StepBound bound(std::optional<double> launch, const std::vector<DeviceLimits>& of_card) const;
    LimitPart limit_part(StudyBench& bench, Counters& counters) const;
    void count_processes(const Observed& seen, Counters& counters) const;
    Observed observed() const;
    Row common_row(const StudyBench& bench) const;

    Case& case_;
    const MeasurementContext& context_;
    std::string failure_;  ///< empty: no failure so far
    bool failed_beside_others_ = false;
    std::vector<nlohmann::json> repetitions_;
    double seconds_ = 0;  ///< time of all repetitions together
    bool compiling_ = false, counting_ = false, warming_up_ = false, reading_ = false, read_ = false;
    bool unjudged_ = false;  ///< the last repetition has been made and not been judged
};

nlohmann::json TimedCase::timed() {
    nlohmann::json answer = case_.ask({{"do", "repeat"}}, "timing " + name_of_repetition(done() + 1));
    for (const std::string clock : {"device", "host"}) {
        if (!std::isfinite(answer.at(clock + "_seconds").get<double>()))
            throw std::runtime_error("its " + clock + " clock measured a time that is not finite");
    }
    look_at_card(answer);
    return answer;
}

void TimedCase::judge_strained_start() {
    if (!std::exchange(read_, false)) return;
    attempt([&] {
        const ReferenceSolution& solution = *context_.strained.solution;
        const Row verified = judged_strained_row(solution, context_.left, case_.spec());
        refuse_beside_others(verified);
        case_.scope().keep("strained", to_json(verified));
    });
}

/// Adds to `answer` facts about the state that a repetition left, before the next one overwrites it. All
/// repetitions begin at the same state, so a deterministic backend leaves the same bits each time: a hash is
/// enough, and the last state is judged later. For other backends each state before the last is judged here.
void TimedCase::look_at_state(nlohmann::json& answer) {
    const std::string doing = "reading the state that it left";
    if (capabilities_of(case_.capabilities()).deterministic) {
        answer["fingerprint"] = case_.ask({{"do", "fingerprint"}}, doing);
    } else if (!unjudged_) {
        context_.state.take(case_.ask({{"do", "state"}}, doing), context_.left);
        answer["verified"] = to_json(judged());
    }
}

/// Why a repetition before the last one is wrong; empty if none is. Also empty if each batch continues from
/// the previous one, since the last state then depends on all batches, and judging that state is enough.
std::string TimedCase::other_repetition() const {
    if (!context_.batch.rewind) return {};
    for (int n = 1; n < done(); ++n) {
        const std::string name = name_of_repetition(n) + " of " + std::to_string(done());
        const nlohmann::json& one = repetitions_[std::size_t(n - 1)];
        if (one.contains("verified")) {
            const Row verified = row_from_json(one.at("verified"));
            if (!verified.verdict->passed) return name + ": " + verified.reason.value_or("");
        } else if (one.at("fingerprint") != repetitions_.back().at("fingerprint")) {
            return name + " left another state than the last one, from the same start";
        }
    }
    return {};
}

/// Adds the card's clock and the number of other programs' processes on the card to `answer`. Call it right
/// after a batch: later the clock falls.
void TimedCase::look_at_card(nlohmann::json& answer) {
    if (context_.card == nullptr || capabilities_of(case_.capabilities()).uuid.empty()) return;
    if (const auto mhz = context_.card->clock_mhz()) answer["card_mhz"] = *mhz;
    if (const auto processes = context_.card->processes())
        answer["other_users"] = other_processes(*processes, context_.own_processes());
}

EditPart TimedCase::edit_part() const {
    std::vector<double> plain;
    for (const nlohmann::json& one : repetitions_)
        plain.push_back(one.at("plain_seconds").get<double>() / context_.batch.steps);
    const nlohmann::json& edits = kept("edits");
    return {.edits = edits.at("edits"),
            .median_seconds = edits.at("edit_seconds_median"),
            .max_seconds = edits.at("edit_seconds_max"),
            .seconds_per_step_without = median(plain)};
}

/// The median times of the starts. Adds counters that say by how much the starts differ.
StartPart TimedCase::start_part(Counters& counters) const {
    std::vector<double> construct, compile, upload, warm, cold;
    const auto add = [&](double constructed, const nlohmann::json& of) {
        construct.push_back(constructed);
        compile.push_back(of.at("compile_seconds"));
        upload.push_back(of.at("upload_seconds"));
        warm.push_back(construct.back() + upload.back());
        cold.push_back(warm.back() + compile.back());
    };
    add(kept("introduction").at("construct_seconds"), kept("warm"));
    if (known("starts")) {
        for (const nlohmann::json& one : kept("starts")) add(one.at("construct_seconds"), one);
    }
    const auto spread = [](const std::vector<double>& samples) -> std::optional<double> {
        if (samples.size() < 2) return std::nullopt;
        const auto [least, most] = std::minmax_element(samples.begin(), samples.end());
        return (*most - *least) / 2 / median(samples);
    };
    counters.add("starts", double(cold.size()), Unit::number, Better::neither);
    counters.add("ready_spread", spread(cold), Unit::number, Better::neither);
    counters.add("warm_ready_spread", spread(warm), Unit::number, Better::neither);
    StartPart start{.construct_seconds = median(construct),
                    .compile_seconds = median(compile),
                    .upload_seconds = median(upload)};
    start.warm_ready_seconds = start.construct_seconds + start.upload_seconds;
    start.ready_seconds = *start.warm_ready_seconds + start.compile_seconds;
    return start;
}

bool TimedCase::leaves_out_tiles() const {
    const nlohmann::json& work = kept("warm").at("work");
    return work.contains("tiles_stepped") && work.at("tiles_stepped") < work.at("tiles");
}

/// The shortest possible time of a step of the whole body. A launch takes `launch` seconds, or what the
/// device's limits say if that is less. `limited_by` is empty if the time is not known.
StepBound TimedCase::bound(std::optional<double> launch, const std::vector<DeviceLimits>& of_card) const {
    if (!case_.limits || kept("step work").is_null()) return {};
    DeviceLimits own = *case_.limits;
    own.launch_seconds = std::min(own.launch_seconds, launch.value_or(own.launch_seconds));
    return bound_of(kept("step work").get<StepWork>(), case_.spec().options.precision, own, of_card);
}

/// The limit of a step. Empty if the backend does not tell the step's work, or if steps leave out tiles at
/// rest, since the limit is known only for steps of the whole body.
LimitPart TimedCase::limit_part(StudyBench& bench, Counters& counters) const {
    if (kept("step work").is_null() || leaves_out_tiles()) return {};
    const StepWork work = kept("step work").get<StepWork>();
    LimitPart part{.bytes = work.bytes,
                   .written_bytes = work.written_bytes,
                   .footprint_bytes = work.footprint_bytes,
                   .operations = work.operations};
    const auto of_card = bench.limits().on_card_of(capabilities_of(case_.capabilities()));
    if (const StepBound one = bound(launch_seconds(), of_card); !one.longest.limited_by.empty()) {
        part.seconds = one.longest.seconds;
        part.limited_by = one.longest.limited_by;
        counters.add("limit_sum_seconds", one.sum_seconds, Unit::second, Better::neither);
    }
    return part;
}

/// Adds counters, if several processes made the repetitions: how many, and by how much their medians differ.
void TimedCase::count_processes(const Observed& seen, Counters& counters) const {
    std::vector<std::vector<double>> of_process(1);
    for (int n = 0; n < done(); ++n) {
        of_process.resize(std::size_t(process_of(n)) + 1);
        of_process.back().push_back(seen.seconds[std::size_t(n)]);
    }
    if (of_process.size() < 2) return;
    std::vector<double> medians;
    for (const std::vector<double>& times : of_process) medians.push_back(median(times));
    const auto [least, most] = std::minmax_element(medians.begin(), medians.end());
    counters.add("processes", double(medians.size()), Unit::number, Better::neither);
    counters.add("process_spread", (*most - *least) / 2 / median(medians), Unit::number, Better::neither);
}

Observed TimedCase::observed() const {
    // The processor's activity says nothing about a case on a card.
    const bool on_card = !capabilities_of(case_.capabilities()).uuid.empty();
    Observed observed;
    for (const nlohmann::json& one : repetitions_) {
        observed.seconds.push_back(one.at("device_seconds"));
        if (!on_card) {
            observed.spins.push_back(one.at("spin_seconds"));
            if (one.contains("waiting")) observed.waits.push_back(one.at("waiting"));
        }
        if (one.contains("card_mhz")) observed.card_mhz.push_back(one.at("card_mhz"));
        if (one.contains("other_users")) observed.other_users.push_back(one.at("other_users"));
    }
    return observed;
}

Row TimedCase::common_row(const StudyBench& bench) const {
    const Scene& scene = context_.scene;
    Row row;
    bench.identify(row, case_.spec(), context_.batch.steps);
    row.reference =
        ReferencePart{.voxels = std::uint64_t(scene.problem.lattice.voxel_count()),
                      .error_steps = steps_in_all(context_.batch),
                      .reference = References::name_of_backend(scene, steps_in_all(context_.batch))};
    return row;
}

void TimedCase::add_rows(StudyBench& bench, int number) {
    Row row = common_row(bench);
    if (failure_.empty()) {
        const Row verified = this->verified();
        row.errors = verified.errors;
        row.verdict = verified.verdict;
        row.reason = verified.reason;
        const nlohmann::json& work = kept("warm").at("work");
        if (!work.empty()) row.verdict->work = work.get<WorkCount>();
        bench.add("verification", row);
        if (!row.verdict->passed)
            failure_ = "does not agree with " + row.reference->reference + ": " + *row.reason;
        row.verdict.reset();
        row.reason.reset();
    }
    if (!failure_.empty()) {
        row.errors.reset();
        row.reason = failure_;
        bench.add("failed", row);
        return;
    }
    if (known("sustained")) {
        const nlohmann::json& sustained = kept("sustained");
        const auto figure = [&](const char* key, double scale = 1) -> std::optional<double> {
            if (!sustained.contains(key)) return std::nullopt;
            return scale * sustained.at(key).get<double>();
        };
        row.counters.add("sustained_seconds_per_step", figure("seconds_per_step"), Unit::second,
                         Better::less);
        row.counters.add("sustained_watts", figure("watts"), Unit::watt, Better::neither);
        row.counters.add("sustained_hertz", figure("min_mhz", 1e6), Unit::hertz, Better::neither);
    }
    row.limit = limit_part(bench, row.counters);
    if (context_.batch.start_times) row.start = start_part(row.counters);
    const nlohmann::json& warm = kept("warm");
    if (warm.contains("shared_process")) row.shared_process = true;
    if (warm.contains("chosen"))
        row.choice = ChoicePart{warm.at("chosen"), warm.contains("predicted_seconds")
                                                       ? std::optional<double>(warm.at("predicted_seconds"))
                                                       : std::nullopt};
    if (context_.edits > 0) row.edits = edit_part();
    const Observed seen = observed();
    count_processes(seen, row.counters);
    row.noisy = reasons_of_noise(seen);
    if (!seen.card_mhz.empty()) {
        const auto [least, most] = std::minmax_element(seen.card_mhz.begin(), seen.card_mhz.end());
        row.min_card_mhz = *least;
        row.max_card_mhz = *most;
    }
    std::vector<Repetition> repetitions;
    for (const nlohmann::json& one : repetitions_)
        repetitions.push_back({one.at("device_seconds"), one.at("host_seconds"), one.at("cpu_seconds")});
    for (const Row& one : google_benchmark_rows(row, repetitions, number)) bench.add("benchmarks", one);
}

/// Makes the cases compile for which begin_compiling() saves time, several at once, since a compiler uses one
/// thread only.
void compile_together(StudyBench& bench, std::vector<TimedCase>& cases) {
    at_once(
        cases.size(), bench.side_by_side(),
        [&](std::size_t n) {
            if (!interrupted() && cases[n].begin_compiling())
                bench.show("compiling " + cases[n].label(), 0, 1);
        },
        [&](std::size_t n) { cases[n].finish_compiling(); });
}

/// Makes every case warm up: one by one if the rows report start times, otherwise several at once. Calls
/// `meanwhile` once the first warm-ups have begun.
void warm_up_all(StudyBench& bench, std::vector<TimedCase>& cases, bool start_times,
                 const std::function<void()>& meanwhile) {
    at_once(
        cases.size(), bench.side_by_side(),
        [&](std::size_t n) {
            if (!interrupted()) cases[n].begin_counting();
        },
        [&](std::size_t n) { cases[n].finish_counting(); });
    int missing = 0;
    for (TimedCase& one : cases) {
        if (!interrupted()) one.measure_launch(launch_before);
        missing += one.missing();
    }
    const std::size_t most = start_times ? 1 : bench.uploads_side_by_side();
    at_once(
        cases.size(), most,
        [&](std::size_t n) {
            if (interrupted()) return;
            if (cases[n].begin_warming_up()) bench.show(cases[n].label(), 0, missing);
        },
        [&](std::size_t n) {
            if (n == 0) meanwhile();
            cases[n].finish_warming_up();
        });
}

/// Makes the repetitions of all cases, interleaved in random order, so that changes of the machine over time
/// affect all cases alike. Returns how many were due.
int repeat_interleaved(StudyBench& bench, std::vector<TimedCase>& cases) {
    std::vector<TimedCase*> order;
    for (TimedCase& one : cases) order.insert(order.end(), std::size_t(one.missing()), &one);
    std::shuffle(order.begin(), order.end(), bench.order());
    const int total = int(order.size());
    int done = 0;
    for (TimedCase* one : order) {
        if (interrupted()) return total;
        if (one->missing() > 0) {
            bench.show(one->label(), done, total);
            one->repeat();
        }
        ++done;
    }
    return total;
}

/// Judges by `finish` the states that `begin` starts to read: those that the cases' last repetitions left, or
/// those after a strained start, from which `begin` runs every case that needs it. This is done after all
/// `total` repetitions, since it takes all cores and gigabytes of memory. Until then each state stays in its
/// case's backend, which does nothing else. While one state is judged, the next one is read; more states of a
/// large scene would not fit into memory.
void judge_each(StudyBench& bench, std::vector<TimedCase>& cases, int total, const char* from,
                void (TimedCase::*begin)(), void (TimedCase::*finish)()) {
    if (!cases.empty() && !interrupted()) (cases.front().*begin)();
    for (std::size_t n = 0; n < cases.size() && !interrupted(); ++n) {
        if (cases[n].is_reading()) bench.show("judging " + cases[n].label() + from, total, total);
        cases[n].finish_reading();
        if (n + 1 < cases.size()) (cases[n + 1].*begin)();
        (cases[n].*finish)();
    }
}

}  // namespace

ReferenceSolution solution_of(StudyBench& bench, const Scene& scene, const Problem& last, int steps,
                              const std::vector<BackendSpec>& specs) {
    ReferenceSolution solution{last, steps, bench.references().after(scene, steps), {}, scene.state};
    solution.refined.reason = "the study does not ask for the converged solution";
    add_spreads(bench, scene, specs, solution);
    return solution;
}

void add_verdict(Row& row, const ReferenceSolution& solution, const State& left, const BackendSpec& spec,
                 int repetitions_judged) {
    Row judged = judged_row(solution, left, spec, strained_share(solution, spec));
    if (!judged.verdict->passed)
        throw std::runtime_error("does not agree with float64: " + judged.reason.value_or(""));
    row.errors = std::move(judged.errors);
    row.verdict = std::move(judged.verdict);
    row.verdict->repetitions_judged = repetitions_judged;
}

void add_spreads(StudyBench& bench, const Scene& scene, const std::vector<BackendSpec>& specs,
                 ReferenceSolution& solution) {
    std::vector<RoundingModel> models;
    for (const BackendSpec& spec : specs) {
        const RoundingModel model = rounding_model_of(spec);
        if (spread_of(solution, model) == nullptr &&
            std::find(models.begin(), models.end(), model) == models.end())
            models.push_back(model);
    }
    const std::vector<Spread> spreads =
        bench.references().spreads(scene, solution.steps, solution.same_step, models);
    for (std::size_t n = 0; n < models.size(); ++n) solution.spreads.emplace_back(models[n], spreads[n]);
}

void check_batch(const Study& study, const Scene& scene, const Batch& batch) {
    const std::string where = "study " + study.name;
    if (!batch.rewind && !scene.edits.empty())
        throw BadInput(where, "rewind of " + scene.name, "false",
                       "true, since the scene has edits, which are made at given steps after the start");
    const std::int64_t steps =
        batch.rewind ? batch.steps : std::int64_t(batch.steps) * (1 + batch.repetitions);
    if (steps > max_steps_in_all)
        throw BadInput(where, "steps of " + scene.name, std::to_string(batch.steps),
                       "at most " + std::to_string(max_steps_in_all) + " steps in the warm-up and " +
                           counted(std::uint64_t(batch.repetitions), "repetition") + " together");
}

/// Computes the reference for runs from the strained start, for those of `cases` that need such a run.
void solve_strained_start(StudyBench& bench, const ReferenceSolution& own, const Batch& batch,
                          const std::vector<TimedCase>& cases, StrainedRun& run) {
    std::vector<BackendSpec> specs;
    for (const TimedCase& one : cases) {
        if (one.lacks_strained_start()) specs.push_back(one.spec());
    }
    if (specs.empty() || interrupted()) return;
    if (!run.solution) {
        run.scene = bench.scene();
        run.scene.state = strained_start(run.scene.problem);
        run.solution.emplace(ReferenceSolution{
            own.problem, batch.steps, bench.references().after(run.scene, batch.steps), {}, run.scene.state});
    }
    add_spreads(bench, run.scene, specs, *run.solution);
}

namespace {

/// A group of cases that are measured in turns.
struct TimedGroup {
    std::vector<Case> entered;
    std::optional<MeasurementContext> context;
    std::vector<TimedCase> cases;
};

/// What makes a case a better candidate for a sustained time than another: a device before the host, then
/// TimedCase::seconds(), by which the fastest row is chosen.
using Rank = std::pair<bool, double>;
/// The best rank that has a sustained time so far, per formulation and precision.
using SustainedRanks = std::map<std::pair<Formulation, Precision>, Rank>;

/// Makes the fastest of `cases` in each formulation and precision step without a pause, unless a case of an
/// earlier group was faster. A case on the host counts only if none on a device was measured in that
/// formulation and precision: where a result has a device, nobody asks for the host's sustained speed. If the
/// case fails meanwhile its row is in `failed`, and the next one takes its place.
void sustain_fastest(StudyBench& bench, std::vector<TimedCase>& cases, int total, SustainedRanks& best) {
    std::vector<std::pair<Rank, TimedCase*>> order;
    for (TimedCase& one : cases) {
        if (one.passed()) order.emplace_back(Rank{one.on_host(), one.seconds()}, &one);
    }
    std::stable_sort(order.begin(), order.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [rank, one] : order) {
        if (interrupted()) return;
        const Options& options = one->spec().options;
        const std::pair key(options.formulation, options.precision);
        if (const auto found = best.find(key); found != best.end() && found->second <= rank) continue;
        bench.show(one->label() + " without a pause", total, total);
        one->sustain();
        if (one->passed()) best.insert_or_assign(key, rank);
    }
}

/// The measurement of all cases of one scene.
class SceneMeasurement {
public:
    SceneMeasurement(StudyBench& bench, const Batch& batch)
        : bench_(bench), batch_(batch), scene_(bench.scene()), state_(scene_.problem.particle_count()) {
        if (!scene_.edits.empty()) edited_ = problem_after(scene_, steps_in_all(batch));
    }

    /// Measures the cases of `specs` in turns. Returns those that failed in a process that they shared.
    std::vector<BackendSpec> measure(const std::vector<BackendSpec>& specs, bool alone);

    /// Adds the rows of the cases that are finished. This is done after all groups, since a row is compared
    /// with the limits of its card, which measurements of a later group may change.
    void add_rows() {
        int number = 0;
        for (TimedGroup& group : groups_) {
            for (TimedCase& one : group.cases) one.tell_launch(bench_);
        }
        for (TimedGroup& group : groups_) {
            for (TimedCase& one : group.cases) {
                if (one.finished()) one.add_rows(bench_, number);
                ++number;
            }
        }
    }

private:
    /// Computes what is missing of the reference and of the spreads for `specs`.
    void solve(const std::vector<BackendSpec>& specs) {
        if (solution_) return add_spreads(bench_, scene_, specs, *solution_);
        const Problem& last = edited_ ? *edited_ : scene_.problem;
        const int steps = steps_in_all(batch_);
        ReferenceSolution solution = solution_of(bench_, scene_, last, steps, specs);
        if (batch_.total_error)
            solution.refined =
                bench_.references().refined(scene_, {scene_.problem.time_step, steps}, {steps});
        solution_.emplace(std::move(solution));
    }
    TimedGroup& new_group(std::vector<Case> entered) {
        TimedGroup& group = groups_.emplace_back();
        group.entered = std::move(entered);
        group.context.emplace(MeasurementContext{scene_, batch_, solution_, state_, left_,
                                                 SceneRunner(scene_).edits_within(batch_.steps), strained_,
                                                 bench_.card(), group.entered});
        group.cases.reserve(group.entered.size());
        for (Case& one : group.entered) group.cases.emplace_back(one, *group.context);
        return group;
    }

    StudyBench& bench_;
    const Batch& batch_;
    const Scene& scene_;
    SharedState state_;
    std::optional<Problem> edited_;  ///< the problem after the batches; empty if the scene has no edits
    std::optional<ReferenceSolution> solution_;
    StrainedRun strained_;
    State left_;
    std::deque<TimedGroup> groups_;
    SustainedRanks sustained_;
};

std::vector<BackendSpec> SceneMeasurement::measure(const std::vector<BackendSpec>& specs, bool alone) {
    std::vector<BackendSpec> again;
    std::vector<Case> entered =
        bench_.enter_all(specs, timing_program(batch_, state_),
                         {.limits = true, .at_once = !batch_.start_times, .alone = alone});
    if (entered.empty()) return again;
    TimedGroup& group = new_group(std::move(entered));
    std::vector<TimedCase>& cases = group.cases;
    // The reference is computed while kernels are compiled, unless these are timed, the scene needs much
    // memory, or a resumed study has to know first what is finished.
    const bool while_compiling =
        !batch_.start_times && !is_heavy(scene_) &&
        std::all_of(cases.begin(), cases.end(), [](const auto& one) { return one.is_new(); });
    const auto solve_for_group = [&] { solve(specs_of(group.entered)); };
    if (!while_compiling) solve_for_group();
    if (batch_.start_times) compile_together(bench_, cases);
    warm_up_all(
        bench_, cases, batch_.start_times, while_compiling ? std::function<void()>(solve_for_group) : [] {});
    for (TimedCase& one : cases) {
        if (!interrupted()) one.measure_starts(bench_);
    }
    const int total = repeat_interleaved(bench_, cases);
    judge_each(bench_, cases, total, "", &TimedCase::begin_reading, &TimedCase::judge_state);
    for (TimedCase& one : cases) {
        if (!interrupted()) one.measure_edits();
        if (!interrupted()) one.measure_launch(launch_after);
    }
    solve_strained_start(bench_, *solution_, batch_, cases, strained_);
    judge_each(bench_, cases, total, " from a strained start", &TimedCase::begin_strained_start,
               &TimedCase::judge_strained_start);
    if (batch_.sustained_seconds > 0) sustain_fastest(bench_, cases, total, sustained_);
    for (const TimedCase& one : cases) {
        if (one.failed_beside_others()) again.push_back(one.spec());
    }
    // All processes of this group end now, at the same time, so that none of them runs while a later group is
    // timed: for example backends on the host.
    for (Case& one : group.entered) one.dismiss();
    for (Case& one : group.entered) one.restart();
    return again;
}

}  // namespace

void measure(StudyBench& bench, const Batch& batch) {
    SceneMeasurement scene(bench, batch);
    try {
        for (const std::vector<BackendSpec>& group : bench.groups()) {
            const std::vector<BackendSpec> again = scene.measure(group, false);
            if (!again.empty() && !interrupted()) (void)scene.measure(again, true);
        }
    } catch (const Interrupted&) {
        scene.add_rows();
        throw;
    }
    scene.add_rows();
}

}  // namespace voxspring
