// The kind of study `energy`: what a step costs in joules.
#include "harness/device/energy.h"

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/text.h"
#include "harness/results/capabilities.h"
#include "harness/results/result.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"
#include "harness/verification/divergence.h"

namespace voxspring {
namespace {

/// Within this time clocks settle, and samples of power no longer include what was before.
constexpr double lead_seconds = 2;
/// How long an idle card is watched.
constexpr double idle_seconds = 3;

struct EnergyRow {
    Row row;
    std::string meter = {};
    double seconds = 0, seconds_per_step = 0;
    double watts = 0, idle_watts = 0;
    std::optional<double> sampled_watts = {};
    double joules_per_step = 0, springs_per_joule = 0, particles_per_joule = 0;
    std::optional<unsigned> min_mhz = {}, max_mhz = {};
    std::vector<std::string> throttled = {};
};

template <class Self, class Fields>
void energy_fields(Self& row, Fields& fields) {
    fields.required("meter", row.meter);
    fields.required("seconds", row.seconds);
    fields.required("seconds_per_step", row.seconds_per_step);
    fields.required("watts", row.watts);
    fields.required("idle_watts", row.idle_watts);
    fields.nullable("sampled_watts", row.sampled_watts);
    fields.required("joules_per_step", row.joules_per_step);
    fields.required("springs_per_joule", row.springs_per_joule);
    fields.required("particles_per_joule", row.particles_per_joule);
    fields.nullable("min_mhz", row.min_mhz);
    fields.nullable("max_mhz", row.max_mhz);
    fields.list("throttled", row.throttled);
}

nlohmann::json to_json(const EnergyRow& row) {
    nlohmann::json json = to_json(row.row);
    RowWriter writer(json);
    energy_fields(row, writer);
    return json;
}

EnergyRow energy_row_from_json(const nlohmann::json& json) {
    EnergyRow row{.row = row_from_json(json)};
    RowReader reader(json);
    energy_fields(row, reader);
    return row;
}

// --- In the process of a case ---------------------------------------------------------------------------

class EnergyRunner final : public CaseRunner {
public:
    EnergyRunner(const Scene& scene, const nlohmann::json& parameters)
        : steps_(parameters.at("steps")),
          seconds_(parameters.at("seconds")),
          monitor_(divergence_monitor(scene, steps_)),
          runner_(scene) {}

    /// Watches the device while it idles, with the case's data on it, and then while it steps.
    nlohmann::json answer(Backend& backend, const nlohmann::json&, const OnEvent&) override {
        const auto meter = energy_meter_of(backend.capabilities());
        backend.monitor(monitor_);
        // The return to the start between batches is measured with them, so it is made as cheap as possible.
        runner_.rewind(backend);
        runner_.keep_start(backend);
        run_batch(backend);
        backend.monitor({});  // later batches repeat the checked one, and checks take energy
        const EnergyUse idle = measure_energy(*meter, lead_seconds, idle_seconds, [] {
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        });
        const auto begin = std::chrono::steady_clock::now();
        batches_ = 0;
        const EnergyUse use = measure_energy(*meter, lead_seconds, seconds_, [&] { run_batch(backend); });
        const double all = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        if (!powers_agree(use))
            throw std::runtime_error("its energy is not known: the counter says " + si(use.watts, "W") +
                                     ", the samples of power " + si(*use.sampled_watts, "W"));
        EnergyRow row;
        row.meter = meter->name();
        row.seconds = use.seconds;
        row.seconds_per_step = all / (double(batches_) * steps_);
        row.watts = use.watts;
        row.idle_watts = idle.watts;
        row.sampled_watts = use.sampled_watts;
        row.joules_per_step = use.watts * row.seconds_per_step;
        row.min_mhz = use.min_mhz;
        row.max_mhz = use.max_mhz;
        row.throttled = use.throttled;
        return to_json(row);
    }

private:
    /// Every batch begins at the scene's start: a run of minutes might diverge.
    void run_batch(Backend& backend) {
        runner_.rewind(backend);
        runner_.run(backend, steps_);
        backend.synchronize();
        if (const auto divergence = backend.divergence())
            throw std::runtime_error(describe(*divergence, monitor_));
        ++batches_;
    }

    const int steps_;
    const double seconds_;
    const DivergenceMonitor monitor_;
    SceneRunner runner_;
    std::int64_t batches_ = 0;
};

const RegisteredCaseRunner energy_runner("energy", [](const BackendSpec&, const Scene& scene,
                                                      const nlohmann::json& parameters, SharedState*) {
    return std::make_unique<EnergyRunner>(scene, parameters);
});

// --- In the process of the study ------------------------------------------------------------------------

class EnergyStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        if (const auto seconds = study.find("seconds")) seconds_ = seconds->number(min_seconds, 3600);
    }
    void check(const Study& study, const StudyScene&, const Scene& scene) const override {
        if (!scene.edits.empty())
            throw BadInput("study " + study.name, "scene " + scene.name, counted(scene.edits.size(), "edit"),
                           "none in an energy study");
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 1; }
    double steps_of_case(const Study&, const StudyScene& item) const override { return item.steps; }
    void run(StudyBench& bench) override;
    std::vector<std::string> lists() const override { return {"energy"}; }
    void print(const nlohmann::json& result, std::ostream& out, TableWidth width) const override;

private:
    // The counter leaps at least every tenth of a second, which is 1% of ten seconds.
    static constexpr double min_seconds = 10;
    double seconds_ = min_seconds;  ///< how long each case is measured
};

void EnergyStudy::run(StudyBench& bench) {
    const Scene& scene = bench.scene();
    const std::uint64_t springs = count_springs(scene.problem).total();
    int done = 0;
    // One case after another: a card that two processes hold draws more power while it idles.
    for (const BackendSpec& spec : bench.specs()) {
        if (interrupted()) return;
        bench.show(spec.label(), done, bench.expected_cases());
        auto entered = bench.enter(spec, {"energy", {{"steps", bench.item().steps}, {"seconds", seconds_}}});
        if (!entered) continue;
        try {
            (void)energy_meter_of(capabilities_of(entered->capabilities()));
        } catch (const std::runtime_error& error) {
            bench.refuse(spec, error.what());
            continue;
        }
        ++done;
        JournalScope& scope = entered->scope();
        if (scope.find("energy") == nullptr && scope.find("failed") == nullptr) {
            const auto failure = failure_of([&] {
                scope.keep("energy", entered->ask({{"do", "measure"}}, "measuring its energy"));
            });
            if (failure) scope.keep("failed", *failure);
        }
        bench.add_failure(*entered);
        const nlohmann::json* measured = scope.find("energy");
        if (measured == nullptr) continue;
        EnergyRow row = energy_row_from_json(*measured);
        row.row = row_of(scene.name, spec);
        row.row.workpiece = Workpiece{
            .steps = bench.item().steps, .particles = scene.problem.particle_count(), .springs = springs};
        row.springs_per_joule = double(springs) / row.joules_per_step;
        row.particles_per_joule = double(scene.problem.particle_count()) / row.joules_per_step;
        bench.add("energy", to_json(row));
    }
}

void EnergyStudy::print(const nlohmann::json& result, std::ostream& out, TableWidth width) const {
    const std::vector<Column> columns = {
        {"scene", 0, true}, {"backend", 0, true}, {"energy per step"}, {"springs per joule"},
        {"power"},          {"idle", 1},          {"a step", 2},       {"clock", 3}};
    std::vector<std::vector<std::string>> table;
    for (const auto& json : result.at("energy")) {
        const EnergyRow row = energy_row_from_json(json);
        std::string clock = row.max_mhz ? std::to_string(*row.max_mhz) + " MHz" : "-";
        if (!row.throttled.empty()) clock += ", held down";
        table.push_back({row.row.identity.scene, row.row.label(), si(row.joules_per_step, "J"),
                         si(row.springs_per_joule, "/J"), si(row.watts, "W"), si(row.idle_watts, "W"),
                         si(row.seconds_per_step, "s"), clock});
    }
    print_columns(columns, table, width, out);
    print_unmeasured(result, out);
}

const RegisteredStudyKind energy_kind("energy", [] { return std::make_unique<EnergyStudy>(); });

}  // namespace
}  // namespace voxspring
