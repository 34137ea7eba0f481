#include "harness/process/case.h"

#include <omp.h>

#include <cstdlib>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "backends/outpaced.h"
#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/interruption.h"
#include "harness/base/thread_count.h"
#include "harness/device/limits.h"
#include "harness/results/capabilities.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DeviceNumber, number, wraps, parts)

namespace {

/// The factories of all registered case runners, by name.
std::map<std::string, CaseRunnerFactory>& factories() {
    static std::map<std::string, CaseRunnerFactory> all;
    return all;
}

/// The part of a case that lives in the worker process. It answers the questions of the study.
class CaseInWorker {
public:
    CaseInWorker(const nlohmann::json& description, const Scene* scene)
        : spec_(BackendSpec::parse(description.at("backend"))),
          scene_(scene),
          program_(description.at("program")),
          device_(program_.at("device").get<DeviceNumber>()) {
        // This folder cannot be created. So the cache on disk finds nothing and keeps nothing.
        if (program_.at("cold")) setenv("VOXSPRING_CACHE", "/dev/null/none", 1);
        const int threads = program_.at("threads");
        omp_set_num_threads(threads > 0 ? threads : omp_get_num_procs());
    }

    nlohmann::json answer(const nlohmann::json& question, const OnEvent& on_event) {
        if (question.at("do") == "construct") return construct();
        if (question.at("do") == "limits") return limits();
        if (runner_ == nullptr) make_runner();
        return runner_->answer(*backend_, question, on_event);
    }

private:
    nlohmann::json limits() const {
        const std::unique_ptr<Backend> backend = spec_.make();
        if (backend->limits() == nullptr) throw Unavailable("the backend measures no limits");
        // The limits are those of the whole processor, even if this case works with a share of its threads.
        const ThreadCount all(omp_get_num_procs());
        return voxspring::to_json(backend->limits()->measure_limits());
    }
    nlohmann::json construct() {
        const auto begin = Clock::now();
        backend_ = spec_.make();
        const double seconds = seconds_since(begin);
        const std::string unsupported = scene_ != nullptr ? SceneRunner(*scene_).unsupported(*backend_) : "";
        const bool runs = scene_ != nullptr && unsupported.empty();
        return {{"capabilities", voxspring::to_json(backend_->capabilities())},
                {"construct_seconds", seconds},
                {"unsupported", unsupported},
                {"outpaced", runs ? outpaced_by_another(*backend_, scene_->problem) : ""}};
    }
    void make_runner() {
        if (!program_.at("shared").is_null()) shared_.emplace(program_.at("shared"));
        const std::string name = program_.at("runner");
        const auto found = factories().find(name);
        if (found == factories().end()) throw std::logic_error("no case runner is registered as " + name);
        runner_ = found->second(spec_, *scene_, program_.at("parameters"), shared_ ? &*shared_ : nullptr);
    }

    const BackendSpec spec_;
    const Scene* const scene_;
    const nlohmann::json program_;
    const DeviceOfThread device_;
    std::optional<SharedState> shared_;
    std::unique_ptr<Backend> backend_;
    std::unique_ptr<CaseRunner> runner_;
};

const nlohmann::json construct_question = {{"do", "construct"}};
std::string constructing(const BackendSpec& spec) { return "constructing " + spec.entry->name; }

nlohmann::json introduction_by(Worker& worker, const BackendSpec& spec) {
    return worker.ask(construct_question, constructing(spec));
}

}  // namespace

RegisteredCaseRunner::RegisteredCaseRunner(const std::string& name, CaseRunnerFactory factory) {
    factories().emplace(name, std::move(factory));
}

Case::Case(BackendSpec spec, Workers& workers, CaseProgram program, JournalScope scope,
           std::chrono::duration<double> timeout, std::shared_ptr<SharedProcess> shared)
    : spec_(std::move(spec)),
      workers_(&workers),
      program_(std::move(program)),
      scope_(std::move(scope)),
      timeout_(timeout),
      shared_(std::move(shared)) {}

void Case::say_measured_again(const std::string& reason) const {
    std::cerr << "voxspring: " << spec_.label() << " failed beside other backends in a process: " << reason
              << "; it is measured again alone\n";
}

void Case::start() {
    if (interrupted()) throw Interrupted();
    if (const std::exception_ptr failure = std::exchange(too_early_, nullptr))
        std::rethrow_exception(failure);
    if (process_ != nullptr) return;
    make_process();
    take_introduction(introduction_by(*process_, spec_));
}

void Case::make_process() {
    std::shared_ptr<WorkerProcess> process = shared_ != nullptr ? shared_->process.lock() : nullptr;
    process_ =
        std::make_unique<Worker>(*workers_, case_description(spec_, program_), timeout_, std::move(process));
    if (shared_ != nullptr) shared_->process = process_->shared_process();
}

void Case::begin_introduction() {
    if (interrupted() || process_ != nullptr) return;
    if (scope_.find("introduction") != nullptr || scope_.find("not entered") != nullptr) return;
    try {
        make_process();
        process_->begin(construct_question);
        introducing_ = true;
    } catch (...) {
        too_early_ = std::current_exception();
    }
}

void Case::await_introduction() {
    if (!std::exchange(introducing_, false)) return;
    try {
        take_introduction(process_->finish(constructing(spec_)));
    } catch (...) {
        too_early_ = std::current_exception();
    }
}

void Case::take_introduction(const nlohmann::json& introduction) {
    const nlohmann::json* known = scope_.find("introduction");
    if (known == nullptr) {
        scope_.keep("introduction", introduction);
    } else if (known->at("capabilities") != introduction.at("capabilities")) {
        const Difference other = first_difference(known->at("capabilities"), introduction.at("capabilities"));
        throw BadInput("the journal", other.where + " of " + spec_.entry->name, other.here,
                       other.there + ", as on the device that was measured before");
    }
}

void Case::dismiss() {
    if (process_ != nullptr) process_->dismiss();
}

std::optional<pid_t> Case::process() const {
    return process_ != nullptr ? process_->process() : std::nullopt;
}

nlohmann::json Case::introduce() {
    if (scope_.find("introduction") == nullptr) start();
    return *scope_.find("introduction");
}

nlohmann::json Case::ask(const nlohmann::json& question, const std::string& doing, const OnEvent& on_event) {
    start();
    return process_->ask(question, doing, on_event);
}

const nlohmann::json* Case::kept(const std::string& name, const std::function<nlohmann::json()>& make,
                                 const std::string& at) {
    if (scope_.find(name) == nullptr && scope_.find("failed") == nullptr) {
        const auto measure = [&] { scope_.keep(name, make()); };
        auto failure = failure_of(measure);
        if (failure && shares_process()) {
            say_measured_again(*failure);
            *this = alone();
            failure = failure_of(measure);
        }
        if (failure) scope_.keep("failed", at + *failure);
    }
    return scope_.find(name);
}

void Case::begin(const nlohmann::json& question) {
    start();
    process_->begin(question);
}

nlohmann::json Case::finish(const std::string& doing, const OnEvent& on_event) {
    return process_->finish(doing, on_event);
}

std::vector<nlohmann::json> Case::afresh(const std::vector<nlohmann::json>& questions,
                                         const std::string& doing, bool cold) {
    if (interrupted()) throw Interrupted();
    CaseProgram program = program_;
    program.cold = cold;
    Worker worker(*workers_, case_description(spec_, program), timeout_);
    std::vector<nlohmann::json> answers = {introduction_by(worker, spec_)};
    for (const nlohmann::json& question : questions) answers.push_back(worker.ask(question, doing));
    return answers;
}

const nlohmann::json& Case::capabilities() const { return scope_.find("introduction")->at("capabilities"); }

DeviceLimits Case::measure_limits(JournalScope scope) {
    const std::string device = capabilities().at("api");
    if (scope.find(device) == nullptr) {
        nlohmann::json measured;
        const auto failure = failure_of([&] {
            const nlohmann::json question = {{"do", "limits"}};
            const std::string doing = "measuring the limits of its device";
            const Capabilities of = capabilities_of(capabilities());
            const std::optional<BestLimits> known = best_so_far(of);
            const int processes = known ? known->processes : 0;
            // A study measures a card in one process, and the next studies in further ones. The rates of a
            // host depend on what else runs on it, so every study measures them.
            const int wanted = of.steps_on_host() ? std::max(limits_processes, processes + 1)
                                                  : std::min(processes + 1, limits_processes);
            DeviceLimits best = known ? known->limits : DeviceLimits();
            for (int n = processes; n < wanted; ++n) {
                const nlohmann::json answer =
                    n == processes ? ask(question, doing) : afresh({question}, doing).back();
                best = best_so_far(of, device_limits_of(answer));
            }
            measured = voxspring::to_json(best);
        });
        if (!failure && measured.is_null()) throw Interrupted();
        scope.keep(device, failure ? nlohmann::json(*failure) : measured);
    }
    const nlohmann::json& known = *scope.find(device);
    if (known.is_string()) throw DeviceError(known.get<std::string>());
    return device_limits_of(known);
}

std::vector<BackendSpec> specs_of(const std::vector<Case>& cases) {
    std::vector<BackendSpec> specs;
    for (const Case& one : cases) specs.push_back(one.spec());
    return specs;
}

std::optional<std::string> failure_of(const std::function<void()>& action) {
    try {
        action();
    } catch (const Interrupted&) {
        return std::nullopt;
    } catch (const BadInput&) {
        throw;
    } catch (const Unwritten&) {
        throw;
    } catch (const std::exception& error) {
        return error.what();
    }
    return std::nullopt;
}

nlohmann::json introduce(const BackendSpec& spec, Workers& workers, std::chrono::duration<double> timeout,
                         DeviceNumber device) {
    Worker worker(workers, case_description(spec, {.runner = "", .device = device}), timeout);
    return introduction_by(worker, spec);
}

nlohmann::json case_description(const BackendSpec& spec, const CaseProgram& program) {
    return {{"backend", spec.text()},
            {"program",
             {{"runner", program.runner},
              {"parameters", program.parameters},
              {"shared", program.shared != nullptr ? program.shared->description() : nlohmann::json()},
              {"threads", program.threads},
              {"cold", program.cold},
              {"device", program.device}}}};
}

Answerer case_answerer(const nlohmann::json& description, const Scene* scene) {
    const auto one = std::make_shared<CaseInWorker>(description, scene);
    return [one](const nlohmann::json& question, const OnEvent& on_event) {
        return one->answer(question, on_event);
    };
}

}  // namespace voxspring
