// The kind of study `haptic`: plays a recorded motion of a hand in real time, in ticks (the tool moves, a
// step is made, the force is read), and measures when the force comes back. Before that, steps of the same
// motion are compared with float64. After it, if the backend is deterministic, the state that was left is
// compared with that of the same ticks without waiting.
#include <sched.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/geometric.hpp>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/gl/context.h"
#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/interruption.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/drawing/live_drawing.h"
#include "harness/results/capabilities.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/measure.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

/// Seconds from one edit to the next, if a motion is played with edits.
constexpr double edit_seconds = 0.1;
/// The most forces of a run that are compared with the reference, at even intervals of its steps.
constexpr int compared_forces = 20;

/// One playing of the motion: `hertz` ticks per second for `seconds`. `edited`: springs are cut and sutured
/// meanwhile. `drawn`: pictures of the body are drawn meanwhile.
struct Playing {
    double hertz = 0;
    bool edited = false, drawn = false;
    double seconds = 0;

    std::string key() const {
        return fixed_text(hertz, 3) + " Hz" + (edited ? ", edited" : "") + (drawn ? ", drawn" : "");
    }
    nlohmann::json question() const {
        return {{"do", "play"}, {"hertz", hertz}, {"edited", edited}, {"drawn", drawn}, {"seconds", seconds}};
    }
};

struct HapticRow : Row {
    Playing playing = {};
    int ticks = 0;
    double median_seconds = 0, worst_seconds = 0;
    std::optional<double> p99_seconds = {}, p999_seconds = {};  ///< empty: there were too few ticks
    /// Always true: a latency is measured from when its tick is due. Absent in older files, which measured it
    /// from when the tick began.
    std::optional<bool> from_due = {};
    int missed = 0, steps_that_fit = 0;
    std::optional<double> force_error = {}, force_tolerance = {};
    bool real_time = false;
    Histogram histogram = {};
    double waited_seconds = 0;
    Histogram pauses = {};
    std::optional<double> pictures_per_second = {}, hand_over_seconds = {}, picture_seconds = {};
    std::optional<std::string> displacements_by = {}, renderer = {};

    static void fields(auto& row, auto& of) {
        of.required("hertz", row.playing.hertz);
        of.required("edited", row.playing.edited);
        of.required("drawn", row.playing.drawn);
        of.required("ticks", row.ticks);
        of.required("median_seconds", row.median_seconds);
        of.nullable("p99_seconds", row.p99_seconds);
        of.nullable("p999_seconds", row.p999_seconds);
        of.required("worst_seconds", row.worst_seconds);
        of.optional("from_due", row.from_due);
        of.required("missed", row.missed);
        of.required("steps_that_fit", row.steps_that_fit);
        of.nullable("force_error", row.force_error);
        of.nullable("force_tolerance", row.force_tolerance);
        of.required("real_time", row.real_time);
        of.required("histogram", row.histogram);
        of.required("waited_seconds", row.waited_seconds);
        of.required("pauses", row.pauses);
        of.nullable("pictures_per_second", row.pictures_per_second);
        of.nullable("hand_over_seconds", row.hand_over_seconds);
        of.nullable("picture_seconds", row.picture_seconds);
        of.nullable("displacements_by", row.displacements_by);
        of.nullable("renderer", row.renderer);
    }
};

/// The percentile, if about ten values or more exceed it; otherwise empty, since it would just be one of the
/// largest values.
std::optional<double> percentile_of_many(const std::vector<double>& sorted, double fraction) {
    constexpr long least_beyond = 10;
    const bool enough = std::lround(double(sorted.size()) * (1 - fraction)) >= least_beyond;
    return enough ? std::optional(percentile(sorted, fraction)) : std::nullopt;
}

/// A cut around one of the particles that the tool holds, and the suture that undoes it.
using CutAndSuture = std::array<SpringEdit, 2>;
CutAndSuture cut_and_suture_of(const Scene& scene) {
    Problem problem = scene.problem;
    SpringEditor editor(problem);
    const auto& held = problem.tool.particles;
    const glm::dvec3 spacing = problem.lattice.spacing;
    const double longest = std::max({spacing.x, spacing.y, spacing.z});
    CutAndSuture edits;
    edits[0] = editor.cut(Ball{problem.rest_position[held[held.size() / 2]], 1.5 * longest});
    std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
    for (const ChangedSpring& removed : edits[0].removed)
        pairs.emplace_back(removed.spring.first, removed.spring.second);
    edits[1] = editor.suture(pairs);
    return edits;
}

/// The scene whose `steps` steps are judged. The tool moves in each step, as it does while a motion is
/// played. If `edited`, the springs are cut, sutured and cut again, so that at the end a cut is open.
Scene judged_scene(const Scene& scene, bool edited, int steps) {
    Scene judged = scene;
    judged.tool_motion.every = 1;
    if (!edited) return judged;
    const CutAndSuture edits = cut_and_suture_of(scene);
    for (int n = 0; n < 3; ++n) {
        const SpringEdit& edit = edits[std::size_t(n % 2)];
        if (!edit.empty()) judged.edits.push_back({int(std::int64_t(steps) * (n + 1) / 4), edit});
    }
    return judged;
}

/// The forces on the tool at even intervals of a run through the scene.
std::vector<glm::dvec3> forces_of(SceneRunner& runner, Backend& backend, int steps) {
    std::vector<glm::dvec3> forces;
    runner.rewind(backend);
    for (int n = 1, done = 0; n <= compared_forces; ++n) {
        const int end = int(std::int64_t(steps) * n / compared_forces);
        if (end == done) continue;
        runner.run(backend, end - done);
        forces.push_back(backend.tool()->tool_force());
        done = end;
    }
    return forces;
}

// --- In the process of a case ---------------------------------------------------------------------------

double seconds_between(Clock::time_point begin, Clock::time_point end) {
    return Seconds(end - begin).count();
}

/// While this object lives, this thread and the threads that it starts have real-time priority, if that is
/// permitted.
class RealTime {
public:
    RealTime() {
        const sched_param priority{.sched_priority = sched_get_priority_min(SCHED_FIFO)};
        granted_ = sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
    }
    RealTime(const RealTime&) = delete;
    RealTime& operator=(const RealTime&) = delete;
    ~RealTime() {
        const sched_param normal{.sched_priority = 0};
        if (granted_) sched_setscheduler(0, SCHED_OTHER, &normal);
    }
    bool granted() const { return granted_; }

private:
    bool granted_ = false;
};

/// Waits until ticks are due. Notes how long the thread was off its processor during waits, since ticks are
/// interrupted in the same way.
class Waiting {
public:
    /// Sleeps until shortly before `when`, and then polls the clock, since a sleep ends late.
    void until(Clock::time_point when) {
        constexpr auto late = std::chrono::microseconds(200);
        auto before = Clock::now();
        if (when - before > late) {
            std::this_thread::sleep_until(when - late);
            before = Clock::now();
        }
        const auto begin = before;
        while (before < when) {
            const auto now = Clock::now();
            if (now - before >= shortest_pause) pauses_.push_back(seconds_between(before, now));
            before = now;
        }
        seconds_ += seconds_between(begin, before);
    }

    /// How long the clock was polled.
    double seconds() const { return seconds_; }
    /// The pauses, of at least shortest_pause, between two readings of the clock.
    Histogram pauses() {
        std::sort(pauses_.begin(), pauses_.end());
        return histogram_of(pauses_);
    }

private:
    /// The shortest pause that counts: many times as long as one reading of the clock.
    static constexpr std::chrono::microseconds shortest_pause{1};

    double seconds_ = 0;
    std::vector<double> pauses_;
};

/// What only a drawn case has: an OpenGL context, and a backend made after it. The contexts of that backend
/// and of the drawing share buffers with this context.
struct Shared {
    explicit Shared(const BackendSpec& spec) : backend(spec.make()) {
        const Capabilities on = backend->capabilities();
        if (context.capabilities().is_software && !on.steps_on_host() && !on.is_software)
            throw Unavailable("OpenGL is software here, which draws on the processor and not on " +
                              on.device);
    }
    gl::Context context;
    gl::Sharing sharing{context};
    std::unique_ptr<Backend> backend;
};

class HapticRunner final : public CaseRunner {
public:
    HapticRunner(const BackendSpec& spec, const Scene& scene, const nlohmann::json& parameters,
                 SharedState* shared_state)
        : shared_(parameters.at("drawn") ? std::make_unique<Shared>(spec) : nullptr),
          scene_(scene),
          steps_(parameters.at("steps")),
          edits_(cut_and_suture_of(scene)),
          edited_(scene.problem),
          runner_(scene),
          shared_state_(*shared_state) {}

    nlohmann::json answer(Backend& own, const nlohmann::json& question, const OnEvent&) override {
        Backend& backend = shared_ ? *shared_->backend : own;
        if (question.at("do") == "play") {
            const Playing playing{question.at("hertz"), question.at("edited"), question.at("drawn"),
                                  question.at("seconds")};
            Played played;
            HapticRow row = play(backend, playing, played);
            // steps_that_fit() makes no edits, so motions played with and without edits share its result.
            const auto [fit, is_new] = fit_.try_emplace(playing.hertz, 0);
            if (is_new) fit->second = steps_that_fit(backend, 1 / playing.hertz);
            row.steps_that_fit = fit->second;
            drawing_.reset();
            check(backend, played);
            return json_of(row);
        }
        const Scene judged = judged_scene(scene_, question.at("edited"), steps_);
        SceneRunner runner(judged);
        nlohmann::json forces = nlohmann::json::array();
        for (const glm::dvec3& f : forces_of(runner, backend, steps_)) forces.push_back({f.x, f.y, f.z});
        nlohmann::json left = shared_state_.put(backend.download());
        // The backend reads the problem of `runner`, which is destroyed now. So it gets the scene's problem
        // again.
        runner_.rewind(backend);
        return {{"forces", std::move(forces)}, {"left", std::move(left)}};
    }

private:
    /// What a playing did. `places`: for each tick, where the tool was, as a fraction of the motion.
    /// `edited`: the indices of the ticks that began with an edit. `left`: a hash of the state in the end;
    /// empty unless the backend is deterministic.
    struct Played {
        std::vector<double> places;
        std::vector<std::size_t> edited;
        std::string left;
    };

    /// Plays the whole motion in `playing.seconds`, with one tick every 1 / hertz seconds. In a tick the tool
    /// is moved, one step is made, and the force is read. Ticks that are due before the previous tick has
    /// ended are left out.
    ///
    /// The latency of a tick, played or left out, is the time from when it is due until the next force is
    /// there or, if no tick follows, until the last tick has ended. If only played ticks counted, one long
    /// tick would hide the delay of the ticks that are left out because of it.
    HapticRow play(Backend& backend, const Playing& playing, Played& played) {
        HapticRow row;
        row.playing = playing;
        const double hertz = playing.hertz;
        const int ticks = std::max(1, int(std::lround(playing.seconds * hertz)));
        const int ticks_per_edit = std::max(1, int(std::lround(edit_seconds * hertz)));
        stand_at_start(backend, playing.drawn);
        played.places.reserve(std::size_t(ticks));
        std::size_t next_edit = 0;
        std::vector<double> latencies;
        Waiting waiting;
        const std::int64_t drawn_before = drawing_ ? drawing_->pictures() : 0;
        const auto start = Clock::now();
        const auto due = [&](int tick) {
            return start + std::chrono::duration_cast<Clock::duration>(Seconds(tick / hertz));
        };
        const auto answer = [&](int end, Clock::time_point force_there) {
            for (int tick = int(latencies.size()); tick < end; ++tick)
                latencies.push_back(seconds_between(due(tick), force_there));
        };
        for (int tick = 0; tick < ticks;) {
            const SpringEdit* edit = nullptr;
            if (playing.edited && tick / ticks_per_edit >= int(next_edit)) {
                edit = &edits_[next_edit++ % 2];
                apply(edited_, *edit);
            }
            waiting.until(due(tick));
            if (edit != nullptr) backend.edit(edited_, *edit);
            const glm::dvec3 force = tick_once(backend, double(tick) / ticks, 1);
            const auto force_there = Clock::now();
            if (!std::isfinite(glm::length(force))) throw std::runtime_error("the force is not finite");
            answer(tick + 1, force_there);
            ++row.ticks;
            if (edit != nullptr) played.edited.push_back(played.places.size());
            played.places.push_back(double(tick) / ticks);
            if (drawing_ && edit != nullptr) drawing_->follow(*edit);
            if (drawing_) drawing_->follow_mesh();
            const int late = int(std::ceil(seconds_between(start, Clock::now()) * hertz));
            const int next = std::clamp(late, tick + 1, ticks);
            row.missed += next - tick - 1;
            tick = next;
        }
        answer(ticks, Clock::now());
        if (backend.capabilities().deterministic) played.left = fingerprint_of(backend);
        if (drawing_) {
            const auto drawn = double(drawing_->pictures() - drawn_before);
            row.pictures_per_second = drawn / seconds_between(start, Clock::now());
            row.hand_over_seconds = drawing_->hand_over_seconds();
            row.picture_seconds = drawing_->picture_seconds();
            row.displacements_by = drawing_->displacements_by();
            row.renderer = shared_->context.capabilities().device;
        }
        std::sort(latencies.begin(), latencies.end());
        row.median_seconds = percentile(latencies, 0.5);
        row.p99_seconds = percentile_of_many(latencies, 0.99);
        row.p999_seconds = percentile_of_many(latencies, 0.999);
        row.from_due = true;
        row.worst_seconds = latencies.back();
        row.histogram = histogram_of(latencies);
        row.waited_seconds = waiting.seconds();
        row.pauses = waiting.pauses();
        row.real_time = real_time_.granted();
        return row;
    }

    /// If the backend is deterministic, plays the same ticks without waiting and without drawing, and throws
    /// unless they leave the same state.
    void check(Backend& backend, const Played& played) {
        if (played.left.empty()) return;
        stand_at_start(backend, false);
        std::size_t edits = 0;
        for (std::size_t n = 0; n < played.places.size(); ++n) {
            if (edits < played.edited.size() && played.edited[edits] == n) {
                const SpringEdit& edit = edits_[edits++ % 2];
                apply(edited_, edit);
                backend.edit(edited_, edit);
            }
            (void)tick_once(backend, played.places[n], 1);
        }
        if (fingerprint_of(backend) != played.left)
            throw std::runtime_error("the motion left another state than the same ticks without waiting");
    }

    /// Returns to the start of the motion. If `drawn`, drawing begins here.
    void stand_at_start(Backend& backend, bool drawn) {
        drawing_.reset();
        warm_up(backend);
        runner_.rewind(backend);
        edited_ = scene_.problem;
        backend.synchronize();
        if (!drawn) return;
        drawing_.emplace(shared_->context, backend, scene_.problem);
        // The first picture makes the card allocate memory, so it is drawn before the first tick.
        while (drawing_->pictures() == 0) {
            drawing_->hand_over_if_due();
            std::this_thread::sleep_for(std::chrono::milliseconds(1));  // lets other threads run
        }
    }

    /// Runs each edit and some ticks once, so that kernels are compiled and CUDA graphs recorded before the
    /// first tick.
    void warm_up(Backend& backend) {
        runner_.rewind(backend);
        edited_ = scene_.problem;
        for (const SpringEdit& edit : edits_) {
            apply(edited_, edit);
            if (!edit.empty()) backend.edit(edited_, edit);
            for (int n = 0; n < 2; ++n) (void)tick_once(backend, 0, 1);
        }
    }

    /// Plays one tick, at the fraction `part` of the motion's duration. If a picture is due, the tick begins
    /// by handing over the data that the picture needs. If the tick ended with that, the next tick would
    /// begin late.
    glm::dvec3 tick_once(Backend& backend, double part, int steps) {
        const ToolMotion& motion = scene_.tool_motion;
        if (drawing_) drawing_->hand_over_if_due();
        backend.tool()->move_tool(motion.at(part * motion.time.back()));
        backend.step(steps);
        return backend.tool()->tool_force();
    }

    /// The largest number of steps per tick, within a few percent and up to 65536, for which a tick takes at
    /// most `period` seconds; 0 if one step takes longer. Ticks run back to back, with pictures if the motion
    /// had some. The median of a few ticks brackets the number. Within the bracket the mean over a longer
    /// time, in which pictures are drawn, decides.
    int steps_that_fit(Backend& backend, double period) {
        constexpr int most = 1 << 16, least_ticks = 9;
        const double long_enough = drawing_ ? 0.1 : 0.03;
        const auto ticks = [&](int steps, double seconds) {
            std::vector<double> times;
            // Not timed: the first tick may have to record this number of steps, as a CUDA graph for example.
            (void)tick_once(backend, 1, steps);
            const auto start = Clock::now();
            for (auto end = start;
                 int(times.size()) < least_ticks || seconds_between(start, end) < seconds;) {
                const auto begin = end;
                (void)tick_once(backend, 1, steps);
                end = Clock::now();
                times.push_back(seconds_between(begin, end));
            }
            return times;
        };
        int high = 1;
        while (high <= most && median(ticks(high, 0)) <= period) high *= 2;
        int low = high / 2;
        if (low > 0 && mean(ticks(low, long_enough)) > period) {
            high = low;
            low /= 2;
        }
        while (high - low > std::max(1, low / 32)) {
            const int middle = (low + high) / 2;
            (mean(ticks(middle, long_enough)) <= period ? low : high) = middle;
        }
        return std::min(low, most);
    }

    /// Null unless the case is drawn. Declared before real_time_, so that the threads of `shared_` have
    /// normal priority.
    const std::unique_ptr<Shared> shared_;
    const RealTime real_time_;  // declared before all members that start threads for steps
    const Scene& scene_;
    const int steps_;
    const CutAndSuture edits_;
    Problem edited_;
    SceneRunner runner_;
    SharedState& shared_state_;
    std::map<double, int> fit_;           ///< steps that fit into a tick, by ticks per second
    std::optional<LiveDrawing> drawing_;  ///< exists while a drawn motion is played
};

const RegisteredCaseRunner haptic_runner("haptic", case_runner_of<HapticRunner>);

// --- In the process of the study ------------------------------------------------------------------------

/// The float64 reference, with edits or without, for the steps that a case makes before its playings.
struct Judgement {
    Judgement(StudyBench& bench, bool with_edits)
        : edited(with_edits),
          scene(judged_scene(bench.scene(), edited, bench.item().steps)),
          last(problem_after(scene, bench.item().steps)),
          solution(solution_of(bench, scene, last, bench.item().steps, bench.specs())) {
        SceneRunner runner(scene);
        forces = forces_of(runner, *References::backend_of(scene, bench.item().steps), bench.item().steps);
    }
    Judgement(const Judgement&) = delete;  // `solution` refers to the other members
    Judgement& operator=(const Judgement&) = delete;
    ~Judgement() = default;

    const bool edited;
    const Scene scene;
    const Problem last;
    const ReferenceSolution solution;
    std::vector<glm::dvec3> forces;
};

/// Sets in `row` the largest difference of the forces from the reference's, relative to the largest force,
/// and its bound. The bound is the change of the force if all particles that the tool holds are off by the
/// largest accepted error, but no more than max_share_of_motion. Where the reference's forces are all zero
/// `row` gets no figures, and the bound is that change. Throws if a force is not finite, or if the difference
/// exceeds the bound.
void judge_force(HapticRow& row, const nlohmann::json& forces, const Judgement& by) {
    const std::string disagreement = "its force does not agree with float64: ";
    double difference = 0, largest = 0;
    for (std::size_t n = 0; n < by.forces.size(); ++n) {
        const nlohmann::json& f = forces.at(n);
        const double apart = glm::distance(glm::dvec3(f.at(0), f.at(1), f.at(2)), by.forces[n]);
        // std::max() would drop NaN.
        if (!std::isfinite(apart)) throw std::runtime_error(disagreement + "it is not finite");
        difference = std::max(difference, apart);
        largest = std::max(largest, glm::length(by.forces[n]));
    }
    if (largest > 0) row.force_error = difference / largest;
    if (!row.verdict->tolerance) return;
    const Tool& tool = by.scene.problem.tool;
    const double of_springs = tool.stiffness * double(tool.particles.size()) * *row.verdict->tolerance;
    if (largest == 0) {
        if (difference > of_springs)
            throw std::runtime_error(disagreement + error_text(difference) + ", where there is none");
        return;
    }
    row.force_tolerance = std::min(of_springs / largest, max_share_of_motion);
    if (*row.force_error > *row.force_tolerance)
        throw std::runtime_error(disagreement + "error " + error_text(*row.force_error) +
                                 " of the largest force, tolerance " + error_text(*row.force_tolerance));
}

/// How the motion is played: settings of the study, which a scene may override.
struct Motions {
    std::vector<double> rates{1000, 5000, 10000};
    double seconds = 2;  ///< how long the motion is played
    /// Replaces `seconds` for the playing at the highest rate without edits and without drawing.
    std::optional<double> longest_seconds;

    void read(JsonObject& from) {
        if (const auto listed = from.find("rates")) {
            rates.clear();
            for (const JsonValue& item : listed->array(1, 16)) {
                const double rate = item.number(1, 1e5);
                // The journal names a rate with three decimals.
                if (std::any_of(rates.begin(), rates.end(),
                                [&](double other) { return std::abs(other - rate) < 1e-3; }))
                    item.refuse("a rate that differs by 0.001 or more from those before it");
                rates.push_back(rate);
            }
        }
        if (const auto given = from.find("motion_seconds")) seconds = given->number(0.1, 3600);
        if (const auto given = from.find("longest_seconds")) longest_seconds = given->number(0.1, 3600);
    }
    /// The playings, in the order of a case's rows.
    std::vector<Playing> playings() const {
        const auto [lowest, highest] = std::minmax_element(rates.begin(), rates.end());
        std::vector<Playing> all;
        for (const double& rate : rates) {
            const bool is_long = &rate == &*highest;
            all.push_back({rate, false, false, is_long ? longest_seconds.value_or(seconds) : seconds});
            all.push_back({rate, true, false, seconds});
        }
        // After an edit the drawing thread builds a new mesh, equally often at any rate. So playings with
        // edits are drawn at the lowest rate only.
        for (const double& rate : rates) {
            all.push_back({rate, false, true, seconds});
            if (&rate == &*lowest) all.push_back({rate, true, true, seconds});
        }
        return all;
    }
};

class HapticStudy final : public StudyKind {
public:
    void read(JsonObject& study) override { motions_.read(study); }
    std::string read_scene(JsonObject& item) const override {
        Motions().read(item);
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene&, const Scene& scene) const override {
        const std::string where = "study " + study.name, what = "scene " + scene.name;
        if (!scene.problem.has_tool() || scene.tool_motion.empty())
            throw BadInput(where, "tool of " + what, missing, "a tool that moves, in a haptic study");
        if (!scene.edits.empty())
            throw BadInput(where, what, counted(scene.edits.size(), "edit"),
                           "no edits in a haptic study, which makes its own");
    }
    int rows_of_case(const Study&, const StudyScene& item) const override {
        return int(motions_of(item).playings().size());
    }
    double steps_of_case(const Study&, const StudyScene& item) const override { return item.steps; }
    void run(StudyBench& bench) override;
    void make_lists(Result& result) const override { result.rows<HapticRow>("haptic"); }
    void print(const Result& result, std::ostream& out, TableWidth width) const override;

private:
    Motions motions_of(const StudyScene& item) const;
    /// Measures a backend. Returns whether it runs the scene.
    bool measure(StudyBench& bench, const BackendSpec& spec,
                 const std::array<Judgement, 2>& judgements) const;
    void add_rows(StudyBench& bench, const BackendSpec& spec, const JournalScope& scope) const;

    Motions motions_;
};

Motions HapticStudy::motions_of(const StudyScene& item) const {
    Motions motions = motions_;
    motions.rates = item.settings.value("rates", motions.rates);
    motions.seconds = item.settings.value("motion_seconds", motions.seconds);
    if (const auto longest = item.settings.find("longest_seconds"); longest != item.settings.end())
        motions.longest_seconds = longest->get<double>();
    return motions;
}

std::string key_of_judged(bool edited, bool drawn) {
    return std::string("judged") + (edited ? ", edited" : "") + (drawn ? ", drawn" : "");
}

void HapticStudy::run(StudyBench& bench) {
    bench.show("float64 reference", 0, 1);
    const std::array<Judgement, 2> judgements{Judgement(bench, false), Judgement(bench, true)};
    int done = 0;
    // One case runs after another, since nothing else may use the host or the device meanwhile.
    for (const BackendSpec& spec : bench.specs()) {
        if (interrupted()) return;
        bench.show(spec.label(), done, bench.expected_cases());
        if (measure(bench, spec, judgements)) ++done;
    }
}

bool HapticStudy::measure(StudyBench& bench, const BackendSpec& spec,
                          const std::array<Judgement, 2>& judgements) const {
    const Motions motions = motions_of(bench.item());
    std::optional<JournalScope> scope;
    SharedState shared(bench.scene().problem.particle_count());
    State left;
    // The motion is played with and without drawing in two processes, since a drawing context that shares
    // buffers may slow down the steps even while it draws nothing.
    for (const bool drawn : {false, true}) {
        auto entered =
            bench.enter(spec, {"haptic", {{"steps", bench.item().steps}, {"drawn", drawn}}, &shared});
        if (!entered) break;
        scope = entered->scope();
        const auto once = [&](const std::string& key, const std::function<nlohmann::json()>& make) {
            for (const char* over : {key.c_str(), "not drawn", "failed"}) {
                if (scope->find(over) != nullptr) return;
            }
            const auto failure = failure_of([&] {
                try {
                    scope->keep(key, make());
                } catch (const Unavailable& absent) {
                    scope->keep(drawn ? "not drawn" : "failed", absent.what());
                }
            });
            if (failure) scope->keep("failed", *failure);
        };
        for (const Judgement& by : judgements) {
            once(key_of_judged(by.edited, drawn), [&] {
                const nlohmann::json answer = entered->ask({{"do", "judge"}, {"edited", by.edited}},
                                                           "making the steps that are judged");
                shared.take(answer.at("left"), left);
                HapticRow row;
                add_verdict(row, by.solution, left, spec, 1);
                judge_force(row, answer.at("forces"), by);
                return json_of(row);
            });
        }
        for (const Playing& playing : motions.playings()) {
            if (playing.drawn == drawn)
                once(playing.key(), [&] { return entered->ask(playing.question(), "playing the motion"); });
        }
    }
    if (!scope) return false;
    add_rows(bench, spec, *scope);
    if (const nlohmann::json* why = scope->find("not drawn"))
        bench.skip(spec, "while it is drawn: " + why->get<std::string>());
    if (const nlohmann::json* why = scope->find("failed")) bench.fail(spec, *why);
    return true;
}

void HapticStudy::add_rows(StudyBench& bench, const BackendSpec& spec, const JournalScope& scope) const {
    for (const Playing& playing : motions_of(bench.item()).playings()) {
        const nlohmann::json* measured = scope.find(playing.key());
        const nlohmann::json* judged = scope.find(key_of_judged(playing.edited, playing.drawn));
        if (measured == nullptr || judged == nullptr) continue;
        auto row = row_of_json<HapticRow>(*measured);
        const auto by = row_of_json<HapticRow>(*judged);
        bench.identify(row, spec, bench.item().steps);
        row.errors = by.errors;
        row.verdict = by.verdict;
        row.force_error = by.force_error;
        row.force_tolerance = by.force_tolerance;
        bench.add("haptic", row);
    }
}

void HapticStudy::print(const Result& result, std::ostream& out, TableWidth width) const {
    const auto& rows = result.rows<HapticRow>("haptic");
    std::size_t real_time = 0;
    std::vector<double> hand_overs, pictures;
    for (const HapticRow& row : rows) {
        real_time += row.real_time ? 1 : 0;
        if (row.hand_over_seconds) hand_overs.push_back(*row.hand_over_seconds);
        if (row.picture_seconds) pictures.push_back(*row.picture_seconds);
    }
    const auto seconds = [](auto figure) {
        return [figure](const HapticRow& row) {
            const std::optional<double> found = row.*figure;
            return found ? si(*found, "s") : "-";
        };
    };
    print_rows<HapticRow>(
        rows,
        {{{"rate"}, [](const auto& row) { return si(row.playing.hertz, "Hz"); }},
         {{"edits", 3}, [](const auto& row) { return row.playing.edited ? "yes" : "no"; }},
         {{"pictures/s", 2},
          [](const auto& row) {
              return row.pictures_per_second ? fixed_text(*row.pictures_per_second, 0) : "-";
          }},
         {{"median"}, seconds(&HapticRow::median_seconds)},
         {{"p99", 1}, seconds(&HapticRow::p99_seconds)},
         {{"p99.9"}, seconds(&HapticRow::p999_seconds)},
         {{"worst", 1}, seconds(&HapticRow::worst_seconds)},
         {{"missed"}, [](const auto& row) { return std::to_string(row.missed); }},
         {{"steps fit"}, [](const auto& row) { return std::to_string(row.steps_that_fit); }},
         {{"force error", 2}, [](const auto& row) { return error_cell(row.force_error); }},
         {{"threshold/motion", 4}, [](const auto& row) { return threshold_text(row.verdict); }}},
        width, out);
    if (!rows.empty())
        out << "The thread that steps was real-time (SCHED_FIFO) in " << real_time << " of "
            << counted(rows.size(), "row")
            << ". Missed: ticks that were left out, since they were due before "
               "the tick before had ended. Pictures/s: of the body, drawn by OpenGL at the same time.\n";
    if (!pictures.empty())
        out << "A picture takes " << si(median(pictures), "s")
            << ", and handing its displacements over takes " << si(median(hand_overs), "s")
            << " of the thread that steps (medians over the rows).\n";
    print_unmeasured(result, out);
}

const RegisteredStudyKind haptic_kind("haptic", [] { return std::make_unique<HapticStudy>(); });

}  // namespace
}  // namespace voxspring
