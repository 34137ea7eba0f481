#include "harness/study/kernel_trial.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/results/capabilities.h"
#include "harness/verification/random_starts.h"

namespace voxspring {
namespace {

/// Returns the scene. Throws BadInput if it has edits or a tool, since a kernel is not told of these.
std::shared_ptr<const Scene> checked(std::shared_ptr<const Scene> scene) {
    if (!scene->edits.empty() || scene->problem.has_tool())
        throw BadInput("judge()", "body", scene->name,
                       "a body without edits and without a tool, since a kernel is told of neither");
    return scene;
}

int checked_count(const char* name, int count) {
    if (count < 1) throw BadInput("judge()", name, std::to_string(count), "1 or more");
    return count;
}

Kernel checked(Kernel kernel) {
    if (kernel.name.empty() || kernel.name.find_first_of("/ \t\n") != std::string::npos)
        throw BadInput("judge()", "name", kernel.name, "a name without a '/' and without a blank");
    return kernel;
}

}  // namespace

Row judged_row(const ReferenceSolution& solution, const State& left, const BackendSpec& spec,
               double own_share) {
    const JudgedState comparison = judge(solution, left, spec);
    Row row;
    row.errors = errors_of(solution, left, comparison, spec);
    row.verdict = VerdictPart{.passed = comparison.passed(),
                              .finite = comparison.finite,
                              .error_rms = comparison.rms,
                              .tolerance = comparison.tolerance,
                              .tolerance_rms = comparison.tolerance_rms,
                              .error_mean = comparison.mean,
                              .tolerance_mean = comparison.tolerance_mean,
                              .strained_share = own_share};
    if (const Spread* const spread = spread_of(solution, rounding_model_of(spec))) {
        row.verdict->spread_max = spread->max;
        row.verdict->spread_rms = spread->rms;
        row.verdict->motion_max = spread->motion_max;
        row.verdict->motion_rms = spread->motion_rms;
    }
    if (!comparison.passed()) row.reason = comparison.reason;
    return row;
}

Row judged_strained_row(const ReferenceSolution& solution, const State& left, const BackendSpec& spec) {
    const JudgedState comparison = judge(solution, left, spec);
    Row row;
    row.verdict = VerdictPart{.passed = comparison.passed(), .finite = comparison.finite};
    StrainedPart& part = row.verdict->strained_start.emplace();
    part = {.share = strained_share(solution, spec),
            .error_max = comparison.max,
            .error_rms = comparison.rms,
            .error_mean = comparison.mean,
            .tolerance = comparison.tolerance,
            .tolerance_rms = comparison.tolerance_rms,
            .tolerance_mean = comparison.tolerance_mean};
    if (const Spread* const spread = spread_of(solution, rounding_model_of(spec))) {
        part.motion_max = spread->motion_max;
        part.motion_rms = spread->motion_rms;
    }
    if (!comparison.passed()) row.reason = "from a strained start: " + comparison.reason;
    return row;
}

void add_strained(Row& row, const Row& strained) {
    row.verdict->strained_start = strained.verdict->strained_start;
    if (row.verdict->passed && !strained.verdict->passed) {
        row.verdict->passed = false;
        row.reason = strained.reason;
    }
}

KernelTrial::KernelTrial(std::shared_ptr<const Scene> scene, int steps, int repetitions, Kernel kernel,
                         References::OnProgress on_progress)
    : scene_(checked(std::move(scene))),
      steps_(checked_count("steps", steps)),
      asked_(checked_count("repetitions", repetitions)),
      kernel_(checked(std::move(kernel))),
      entry_{.name = kernel_.name,
             .summary = {},
             .precisions = {kernel_.precision},
             .formulations = {kernel_.formulation},
             .tuning = {},
             .make = {},
             .bytes = {}},
      spec_{&entry_, {.precision = kernel_.precision, .formulation = kernel_.formulation, .tuning = {}}},
      references_(DiskCache{}, std::move(on_progress)),
      solution_(solve(*scene_)),
      own_share_(strained_share(solution_, spec_)) {}

ReferenceSolution KernelTrial::solve(const Scene& scene) {
    ReferenceSolution solution{scene.problem, steps_, references_.after(scene, steps_), {}, scene.state};
    const RoundingModel model = rounding_model_of(spec_);
    solution.spreads.emplace_back(model, references_.spread(scene, steps_, solution.same_step, model));
    solution.refined.reason = "the converged solution is not computed for a kernel";
    return solution;
}

void KernelTrial::repeat(const std::function<std::optional<double>()>& run) {
    const auto waited_begin = waited_seconds();
    const double cpu_begin = processor_seconds(CLOCK_PROCESS_CPUTIME_ID);
    const auto begin = Clock::now();
    const std::optional<double> device_seconds = run();
    const double host_seconds = seconds_since(begin);
    const double cpu_seconds = processor_seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu_begin;
    const double seconds = device_seconds.value_or(host_seconds);
    if (!std::isfinite(seconds) || seconds < 0)
        throw std::runtime_error("its clock measured a time that is negative or not finite");
    repetitions_.push_back({seconds, host_seconds, cpu_seconds});
    observed_.seconds.push_back(seconds);
    if (!kernel_.capabilities.steps_on_host()) return;
    if (const auto waited_end = waited_seconds(); waited_begin && waited_end && host_seconds >= 5e-3)
        observed_.waits.push_back((*waited_end - *waited_begin) / host_seconds);
    observed_.spins.push_back(spin_seconds());
}

void KernelTrial::judge_state(const State& left) {
    if (judged_ && !judged_->verdict->passed) return;
    judged_ = judged_row(solution_, left, spec_, own_share_);
    judged_->verdict->repetitions_judged = int(repetitions_.size());
}

const State* KernelTrial::strained_start() {
    if (own_share_ >= min_strained_share) return nullptr;
    if (!strained_scene_) {
        strained_scene_ = *scene_;
        strained_scene_->state = voxspring::strained_start(scene_->problem);
        strained_solution_.emplace(solve(*strained_scene_));
    }
    return &strained_scene_->state;
}

void KernelTrial::judge_strained(const State& left) {
    add_strained(judged_.value(), judged_strained_row(strained_solution_.value(), left, spec_));
}

Result KernelTrial::result() const {
    Result result;
    result.context = google_benchmark_context();
    nlohmann::json& context = result.own_context() = build_context();
    context["gpu"] = context["driver"] = context["gl_renderer"] = nullptr;
    if (!kernel_.capabilities.steps_on_host()) context["gpu"] = kernel_.capabilities.device;
    context["study"] = {{"name", "judge"}, {"kind", "judge"}, {"repetitions", asked_}};
    context["backends"] = {{kernel_.name, to_json(kernel_.capabilities)}};
    context["limits"] = nlohmann::json::object();

    Row row = row_of(scene_->name, spec_);
    row.workpiece = Workpiece{.steps = steps_,
                              .particles = scene_->problem.particle_count(),
                              .springs = count_springs(scene_->problem).total()};
    row.reference = ReferencePart{.voxels = scene_->problem.lattice.voxel_count(),
                                  .error_steps = steps_,
                                  .reference = References::name_of_backend(*scene_, steps_)};
    row.counters = kernel_.counters;
    const Row& judged = judged_.value();
    Row verified = row;
    verified.counters = {};
    verified.errors = judged.errors;
    verified.verdict = judged.verdict;
    verified.reason = judged.reason;
    result.rows("verification").push_back(verified);
    if (!judged.verdict->passed) {
        row.reason = "does not agree with " + row.reference->reference + ": " + judged.reason.value();
        result.rows("failed").push_back(row);
        return result;
    }
    row.errors = judged.errors;
    row.limit = LimitPart{};
    row.noisy = reasons_of_noise(observed_);
    for (const Row& one : google_benchmark_rows(row, repetitions_, 0))
        result.rows("benchmarks").push_back(one);
    return result;
}

}  // namespace voxspring
