// The kind of study `energy`: what a step costs in joules. The state that the batches leave is judged.
#include "harness/device/energy.h"

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/text.h"
#include "harness/results/capabilities.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/measure.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"
#include "harness/verification/divergence.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

/// Time before a measurement, in which clocks settle and samples of power cease to include earlier activity.
constexpr double lead_seconds = 2;
/// How long the power of the idle device is measured.
constexpr double idle_seconds = 3;

struct EnergyRow : Row {
    std::string meter = {};
    std::optional<unsigned> min_mhz = {}, max_mhz = {};
    std::vector<std::string> throttled = {};

    static void fields(auto& row, auto& of) {
        of.required("meter", row.meter);
        of.nullable("min_mhz", row.min_mhz);
        of.nullable("max_mhz", row.max_mhz);
        of.list("throttled", row.throttled);
    }
    std::string clock() const {
        return (max_mhz ? std::to_string(*max_mhz) + " MHz" : "-") + (throttled.empty() ? "" : ", held down");
    }
};

// --- In the process of a case ---------------------------------------------------------------------------

class EnergyRunner final : public CaseRunner {
public:
    EnergyRunner(const BackendSpec&, const Scene& scene, const nlohmann::json& parameters,
                 SharedState* shared)
        : steps_(parameters.at("steps")),
          seconds_(parameters.at("seconds")),
          shared_(*shared),
          monitor_(divergence_monitor(scene, steps_)),
          runner_(scene) {}

    /// Measures the device's power while it idles, with the case's data on it, and then while it steps.
    nlohmann::json answer(Backend& backend, const nlohmann::json&, const OnEvent&) override {
        const auto meter = energy_meter_of(backend.capabilities());
        backend.monitor(monitor_);
        // The return to the start before each batch is part of what is measured, so it is made as cheap as
        // possible.
        runner_.rewind(backend);
        runner_.keep_start(backend);
        run_batch(backend);
        const bool comparable = backend.capabilities().deterministic;
        const std::string first = comparable ? fingerprint_of(backend) : "";
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
        if (comparable && fingerprint_of(backend) != first)
            throw std::runtime_error("the last batch left another state than the first, from the same start");
        EnergyRow row;
        row.meter = meter->name();
        const double step_seconds = all / (double(batches_) * steps_);
        row.counters.add("joules_per_step", use.watts * step_seconds, Unit::joule, Better::less);
        row.counters.add("watts", use.watts, Unit::watt, Better::neither);
        row.counters.add("idle_watts", idle.watts, Unit::watt, Better::neither);
        row.counters.add("seconds_per_step", step_seconds, Unit::second, Better::less);
        row.counters.add("sampled_watts", use.sampled_watts, Unit::watt, Better::neither);
        row.counters.add("seconds", use.seconds, Unit::second, Better::neither);
        row.min_mhz = use.min_mhz;
        row.max_mhz = use.max_mhz;
        row.throttled = use.throttled;
        return {{"row", json_of(row)}, {"left", shared_.put(backend.download())}};
    }

private:
    /// Every batch begins at the scene's start, since a single run of minutes might diverge.
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
    SharedState& shared_;
    const DivergenceMonitor monitor_;
    SceneRunner runner_;
    std::int64_t batches_ = 0;
};

const RegisteredCaseRunner energy_runner("energy", case_runner_of<EnergyRunner>);

// --- In the process of the study ------------------------------------------------------------------------

class EnergyStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        if (const auto seconds = study.find("seconds")) seconds_ = seconds->number(min_seconds, 3600);
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto strained = item.find(StudyScene::strained_key)) (void)strained->boolean();
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene&, const Scene& scene) const override {
        if (!scene.edits.empty())
            throw BadInput("study " + study.name, "scene " + scene.name, counted(scene.edits.size(), "edit"),
                           "no edits in an energy study");
    }
    double steps_of_case(const Study&, const StudyScene& item) const override { return item.steps; }

    void run(StudyBench& bench) override {
        const Scene& scene = bench.scene();
        const int steps = bench.item().steps;
        SharedState shared(scene.problem.particle_count());
        State left;
        std::optional<ReferenceSolution> solution;  // computed when the first state is judged
        int done = 0;
        // One case runs after another, since a card that two processes hold draws more power while it idles.
        for (const BackendSpec& spec : bench.specs()) {
            if (interrupted()) return;
            bench.show(spec.label(), done, bench.expected_cases());
            auto entered = bench.enter(spec, {"energy", {{"steps", steps}, {"seconds", seconds_}}, &shared});
            if (!entered) continue;
            try {
                (void)energy_meter_of(capabilities_of(entered->capabilities()));
            } catch (const UnknownEnergy& error) {
                bench.refuse(spec, error.what());
                continue;
            }
            ++done;
            const nlohmann::json* measured = entered->kept("energy", [&] {
                const nlohmann::json answer = entered->ask({{"do", "measure"}}, "measuring its energy");
                shared.take(answer.at("left"), left);
                if (!solution)
                    solution.emplace(solution_of(bench, scene, scene.problem, steps, bench.specs()));
                auto row = row_of_json<EnergyRow>(answer.at("row"));
                add_verdict(row, *solution, left, spec, 1);
                return json_of(row);
            });
            bench.add_failure(*entered);
            if (measured == nullptr) continue;
            auto row = row_of_json<EnergyRow>(*measured);
            bench.identify(row, spec, steps);
            const double joules = row.counters.at("joules_per_step");
            row.counters.add("springs_per_joule", double(row.workpiece->springs) / joules, Unit::per_joule,
                             Better::more);
            row.counters.add("particles_per_joule", double(row.workpiece->particles) / joules,
                             Unit::per_joule, Better::more);
            bench.add("energy", row);
        }
    }

    void make_lists(Result& result) const override { result.rows<EnergyRow>("energy"); }

    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_rows<EnergyRow>(
            result.rows<EnergyRow>("energy"),
            {{{"steps", 8}, [](const auto& row) { return std::to_string(row.workpiece->steps); }},
             {{"clock", 7}, [](const auto& row) { return row.clock(); }},
             {{"error", 2},
              [](const auto& row) { return error_cell(row.errors ? row.errors->max : std::nullopt); }},
             {{"threshold/motion", 4}, [](const auto& row) { return threshold_text(row.verdict); }}},
            width, out);
        print_unmeasured(result, out);
    }

private:
    // The mean power is computed from one update of the energy counter to another (measure_energy()). Recent
    // cards report power as the mean of a second, so in five seconds there are five independent samples to
    // check it with.
    static constexpr double min_seconds = 5;
    double seconds_ = min_seconds;  ///< how long each case is measured
};

const RegisteredStudyKind energy_kind("energy", [] { return std::make_unique<EnergyStudy>(); });

}  // namespace
}  // namespace voxspring
