// The kind of study `haptic`: a recorded motion of a hand in real time, and when the force comes back.
#include <sched.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/results/result.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

/// From one edit to the next, where a motion is played with edits.
constexpr double edit_seconds = 0.1;
/// How often the force is compared with that of the reference, at even intervals of a case's steps.
constexpr int compared_forces = 20;

struct HapticRow {
    Row row;
    double hertz = 0;
    bool edited = false;
    int ticks = 0;
    double median_seconds = 0, p99_seconds = 0, p999_seconds = 0, worst_seconds = 0;
    int missed = 0, steps_that_fit = 0;
    std::optional<double> force_error = {};
    bool real_time = false;
};

template <class Self, class Fields>
void haptic_fields(Self& row, Fields& fields) {
    fields.required("hertz", row.hertz);
    fields.required("edited", row.edited);
    fields.required("ticks", row.ticks);
    fields.required("median_seconds", row.median_seconds);
    fields.required("p99_seconds", row.p99_seconds);
    fields.required("p999_seconds", row.p999_seconds);
    fields.required("worst_seconds", row.worst_seconds);
    fields.required("missed", row.missed);
    fields.required("steps_that_fit", row.steps_that_fit);
    fields.nullable("force_error", row.force_error);
    fields.required("real_time", row.real_time);
}

nlohmann::json to_json(const HapticRow& row) {
    nlohmann::json json = to_json(row.row);
    RowWriter writer(json);
    haptic_fields(row, writer);
    return json;
}

HapticRow haptic_row_from_json(const nlohmann::json& json) {
    HapticRow row{.row = row_from_json(json)};
    RowReader reader(json);
    haptic_fields(row, reader);
    return row;
}

/// The forces on the tool on the way through a scene.
std::vector<glm::dvec3> forces_of(SceneRunner& runner, Backend& backend, int steps) {
    std::vector<glm::dvec3> forces;
    runner.rewind(backend);
    for (int n = 1, done = 0; n <= compared_forces; ++n) {
        const int end = int(std::int64_t(steps) * n / compared_forces);
        if (end == done) continue;
        runner.run(backend, end - done);
        forces.push_back(backend.tool_force());
        done = end;
    }
    return forces;
}

// --- In the process of a case ---------------------------------------------------------------------------

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

double seconds_between(Clock::time_point begin, Clock::time_point end) {
    return Seconds(end - begin).count();
}

/// This thread, and those that it begins, before all that are not real-time; where that is permitted, for as
/// long as this lives.
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

/// Sleeps until shortly before, and asks the clock from there on: a sleep ends late.
void wait_until(Clock::time_point when) {
    constexpr auto late = std::chrono::microseconds(200);
    if (when - Clock::now() > late) std::this_thread::sleep_until(when - late);
    while (Clock::now() < when) continue;
}

/// The value that a fraction of them does not exceed. `sorted`: ascending, not empty.
double percentile(const std::vector<double>& sorted, double fraction) {
    const auto rank = std::size_t(std::ceil(fraction * double(sorted.size())));
    return sorted[std::max<std::size_t>(rank, 1) - 1];
}

class HapticRunner final : public CaseRunner {
public:
    HapticRunner(const Scene& scene, const nlohmann::json& parameters)
        : scene_(scene),
          steps_(parameters.at("steps")),
          seconds_(parameters.at("seconds")),
          edited_(scene.problem),
          runner_(scene) {
        find_edits();
    }

    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        if (question.at("do") == "play")
            return to_json(play(backend, question.at("hertz"), question.at("edited")));
        nlohmann::json forces = nlohmann::json::array();
        for (const glm::dvec3& f : forces_of(runner_, backend, steps_)) forces.push_back({f.x, f.y, f.z});
        return forces;
    }

private:
    /// A cut beside what the tool holds, and the suture that undoes it.
    void find_edits() {
        Problem problem = scene_.problem;
        SpringEditor editor(problem);
        const auto& held = problem.tool.particles;
        const glm::dvec3 spacing = problem.lattice.spacing;
        const double longest = std::max({spacing.x, spacing.y, spacing.z});
        edits_[0] = editor.cut(Ball{problem.rest_position[held[held.size() / 2]], 1.5 * longest});
        std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
        for (const ChangedSpring& removed : edits_[0].removed)
            pairs.emplace_back(removed.spring.first, removed.spring.second);
        edits_[1] = editor.suture(pairs);
    }

    /// The whole motion in seconds_, a tick every 1 / `hertz`: where the tool is goes out, a step is taken,
    /// the force comes back. A tick that begins late is left out, and so are those whose time is over.
    HapticRow play(Backend& backend, double hertz, bool edited) {
        HapticRow row{.row = {}, .hertz = hertz, .edited = edited};
        const int ticks = std::max(1, int(std::lround(seconds_ * hertz)));
        const int ticks_an_edit = std::max(1, int(std::lround(edit_seconds * hertz)));
        warm_up(backend);
        runner_.rewind(backend);
        edited_ = scene_.problem;
        backend.synchronize();
        std::size_t next_edit = 0;
        std::vector<double> latencies;
        const auto start = Clock::now();
        for (int tick = 0; tick < ticks;) {
            const SpringEdit* edit = nullptr;
            if (edited && tick / ticks_an_edit >= int(next_edit)) {
                edit = &edits_[next_edit++ % 2];
                apply(edited_, *edit);
            }
            const Seconds due(tick / hertz);
            wait_until(start + std::chrono::duration_cast<Clock::duration>(due));
            const auto begin = Clock::now();
            if (edit != nullptr) backend.edit(edited_, *edit);
            const glm::dvec3 force = tick_once(backend, double(tick) / ticks, 1);
            const auto end = Clock::now();
            if (!std::isfinite(glm::length(force))) throw std::runtime_error("the force is not finite");
            latencies.push_back(seconds_between(begin, end));
            const int late = int(std::ceil(seconds_between(start, end) * hertz));
            const int next = std::clamp(late, tick + 1, ticks);
            row.missed += next - tick - 1;
            tick = next;
        }
        row.ticks = int(latencies.size());
        std::sort(latencies.begin(), latencies.end());
        row.median_seconds = percentile(latencies, 0.5);
        row.p99_seconds = percentile(latencies, 0.99);
        row.p999_seconds = percentile(latencies, 0.999);
        row.worst_seconds = latencies.back();
        row.steps_that_fit = steps_that_fit(backend, 1 / hertz);
        row.real_time = real_time_.granted();
        return row;
    }

    /// Compiles and captures what the first tick would.
    void warm_up(Backend& backend) {
        runner_.rewind(backend);
        edited_ = scene_.problem;
        for (const SpringEdit& edit : edits_) {
            apply(edited_, edit);
            if (!edit.empty()) backend.edit(edited_, edit);
            for (int n = 0; n < 2; ++n) (void)tick_once(backend, 0, 1);
        }
    }

    /// `part` of the motion is over.
    glm::dvec3 tick_once(Backend& backend, double part, int steps) const {
        const ToolMotion& motion = scene_.tool_motion;
        backend.move_tool(motion.at(part * motion.time.back()));
        backend.step(steps);
        return backend.tool_force();
    }

    /// The most whose median time, with the tool's way in and the force's way out, is within the period.
    int steps_that_fit(Backend& backend, double period) const {
        constexpr int most = 1 << 16;
        const auto fits = [&](int steps) {
            std::vector<double> times;
            for (int n = 0; n < 10; ++n) {
                const auto begin = Clock::now();
                (void)tick_once(backend, 1, steps);
                // The first may have to capture or record so many steps.
                if (n > 0) times.push_back(seconds_between(begin, Clock::now()));
            }
            return median(times) <= period;
        };
        if (!fits(1)) return 0;
        int low = 1, high = 2;
        for (; high <= most && fits(high); high *= 2) low = high;
        while (high - low > std::max(1, low / 32)) {
            const int middle = (low + high) / 2;
            (fits(middle) ? low : high) = middle;
        }
        return low;
    }

    const RealTime real_time_;  // before the threads of the first step
    const Scene& scene_;
    const int steps_;
    const double seconds_;
    std::array<SpringEdit, 2> edits_;
    Problem edited_;
    SceneRunner runner_;
};

const RegisteredCaseRunner haptic_runner("haptic", [](const BackendSpec&, const Scene& scene,
                                                      const nlohmann::json& parameters, SharedState*) {
    return std::make_unique<HapticRunner>(scene, parameters);
});

// --- In the process of the study ------------------------------------------------------------------------

class HapticStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        if (const auto rates = study.find("rates")) {
            rates_.clear();
            for (const JsonValue& rate : rates->array(1, 16)) rates_.push_back(rate.number(1, 1e5));
        }
        if (const auto seconds = study.find("motion_seconds")) seconds_ = seconds->number(0.1, 3600);
    }
    void check(const Study& study, const StudyScene&, const Scene& scene) const override {
        const std::string where = "study " + study.name, what = "scene " + scene.name;
        if (!scene.problem.has_tool() || scene.tool_motion.empty())
            throw BadInput(where, what, "no tool", "a tool that moves in a haptic study");
        if (!scene.edits.empty())
            throw BadInput(where, what, std::to_string(scene.edits.size()) + " edits",
                           "none in a haptic study, which makes its own");
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 2 * int(rates_.size()); }
    double steps_of_case(const Study&, const StudyScene& item) const override { return item.steps; }
    void run(StudyBench& bench) override;
    std::vector<std::string> lists() const override { return {"haptic"}; }
    void print(const nlohmann::json& result, std::ostream& out, TableWidth width) const override;

private:
    void measure(StudyBench& bench, Case& entered, const std::vector<glm::dvec3>& reference) const;
    void add_rows(StudyBench& bench, Case& entered, std::optional<double> force_error) const;

    std::vector<double> rates_{1000, 5000, 10000};
    double seconds_ = 2;  ///< in which the motion is played
};

std::string key_of(double rate, bool edited) {
    return fixed_text(rate, 3) + " Hz" + (edited ? ", edited" : "");
}

/// The largest difference of two lists of forces, relative to the largest force.
std::optional<double> force_error(const nlohmann::json& forces, const std::vector<glm::dvec3>& reference) {
    double difference = 0, largest = 0;
    for (std::size_t n = 0; n < reference.size(); ++n) {
        const nlohmann::json& f = forces.at(n);
        difference = std::max(difference, glm::distance(glm::dvec3(f.at(0), f.at(1), f.at(2)), reference[n]));
        largest = std::max(largest, glm::length(reference[n]));
    }
    if (largest == 0) return std::nullopt;
    return difference / largest;
}

void HapticStudy::run(StudyBench& bench) {
    const Scene& scene = bench.scene();
    const auto float64 = References::backend_of(scene, bench.item().steps);
    SceneRunner reference_runner(scene);
    bench.show("float64 reference", 0, 1);
    const std::vector<glm::dvec3> reference = forces_of(reference_runner, *float64, bench.item().steps);
    const int total = int(bench.specs().size());
    int begun = 0;
    // One after another: nothing else is to ask the host or the device for anything.
    for (const BackendSpec& spec : bench.specs()) {
        if (interrupted()) return;
        bench.show(spec.label(), begun++, total);
        auto entered = bench.enter(spec, {"haptic", {{"steps", bench.item().steps}, {"seconds", seconds_}}});
        if (entered) measure(bench, *entered, reference);
    }
}

void HapticStudy::measure(StudyBench& bench, Case& entered, const std::vector<glm::dvec3>& reference) const {
    JournalScope& scope = entered.scope();
    const auto once = [&](const std::string& key, const nlohmann::json& question) {
        if (scope.find(key) != nullptr || scope.find("failed") != nullptr) return;
        const auto failure =
            failure_of([&] { scope.keep(key, entered.ask(question, "playing the motion")); });
        if (failure) scope.keep("failed", *failure);
    };
    once("forces", {{"do", "forces"}});
    for (const double rate : rates_) {
        for (const bool edited : {false, true})
            once(key_of(rate, edited), {{"do", "play"}, {"hertz", rate}, {"edited", edited}});
    }
    const nlohmann::json* forces = scope.find("forces");
    add_rows(bench, entered, forces == nullptr ? std::nullopt : force_error(*forces, reference));
    bench.add_failure(entered);
}

void HapticStudy::add_rows(StudyBench& bench, Case& entered, std::optional<double> force_error) const {
    const Scene& scene = bench.scene();
    for (const double rate : rates_) {
        for (const bool edited : {false, true}) {
            const nlohmann::json* measured = entered.scope().find(key_of(rate, edited));
            if (measured == nullptr) continue;
            HapticRow row = haptic_row_from_json(*measured);
            row.row = row_of(scene.name, entered.spec());
            row.row.workpiece = Workpiece{.steps = bench.item().steps,
                                          .particles = scene.problem.particle_count(),
                                          .springs = count_springs(scene.problem).total()};
            row.force_error = force_error;
            bench.add("haptic", to_json(row));
        }
    }
}

void HapticStudy::print(const nlohmann::json& result, std::ostream& out, TableWidth width) const {
    const std::vector<Column> columns = {
        {"scene", 0, true}, {"backend", 0, true}, {"rate"},   {"edits", 3},  {"median"},        {"p99", 1},
        {"p99.9"},          {"worst", 1},         {"missed"}, {"steps fit"}, {"force error", 2}};
    std::vector<std::vector<std::string>> table;
    bool real_time = true;
    for (const auto& json : result.at("haptic")) {
        const HapticRow row = haptic_row_from_json(json);
        real_time = real_time && row.real_time;
        table.push_back({row.row.identity.scene, row.row.label(), si(row.hertz, "Hz"),
                         row.edited ? "yes" : "no", si(row.median_seconds, "s"), si(row.p99_seconds, "s"),
                         si(row.p999_seconds, "s"), si(row.worst_seconds, "s"), std::to_string(row.missed),
                         std::to_string(row.steps_that_fit), error_text(json.at("force_error"))});
    }
    print_columns(columns, table, width, out);
    if (!table.empty())
        out << "The host's thread was " << (real_time ? "" : "not ")
            << "real-time (SCHED_FIFO). Missed: ticks that began before the force of the one before was "
               "there.\n";
    print_unmeasured(result, out);
}

const RegisteredStudyKind haptic_kind("haptic", [] { return std::make_unique<HapticStudy>(); });

}  // namespace
}  // namespace voxspring
