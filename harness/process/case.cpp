#include "harness/process/case.h"

#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/device/limits.h"
#include "harness/results/capabilities.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {
namespace {

using Clock = std::chrono::steady_clock;

/// A case in its process.
class Host : public Answerer {
public:
    Host(const BackendSpec& spec, const Scene& scene, const MakeCaseRunner& make_runner)
        : spec_(spec), scene_(scene), make_runner_(make_runner) {}

    nlohmann::json answer(const nlohmann::json& question, const OnEvent& on_event) override {
        if (question.at("do") == "construct") return construct();
        if (question.at("do") == "limits") return to_json(spec_.make()->measure_limits());
        if (runner_ == nullptr) runner_ = make_runner_(spec_);
        return runner_->answer(*backend_, question, on_event);
    }

private:
    nlohmann::json construct() {
        const auto begin = Clock::now();
        backend_ = spec_.make();
        const std::chrono::duration<double> seconds = Clock::now() - begin;
        return {{"capabilities", voxspring::to_json(backend_->capabilities())},
                {"construct_seconds", seconds.count()},
                {"unsupported", SceneRunner(scene_).unsupported(*backend_)}};
    }

    const BackendSpec& spec_;
    const Scene& scene_;
    const MakeCaseRunner& make_runner_;
    std::unique_ptr<Backend> backend_;
    std::unique_ptr<CaseRunner> runner_;
};

/// Says something of a backend.
class Look : public Answerer {
public:
    Look(const BackendSpec& spec, const std::function<nlohmann::json(const Backend&)>& look)
        : spec_(spec), look_(look) {}
    nlohmann::json answer(const nlohmann::json&, const OnEvent&) override { return look_(*spec_.make()); }

private:
    const BackendSpec& spec_;
    const std::function<nlohmann::json(const Backend&)>& look_;
};

}  // namespace

Case::Case(BackendSpec spec, const Scene& scene, MakeCaseRunner make_runner, JournalScope scope,
           std::chrono::duration<double> timeout)
    : spec_(std::move(spec)),
      scene_(scene),
      make_runner_(std::move(make_runner)),
      scope_(std::move(scope)),
      timeout_(timeout) {}

void Case::start() {
    if (interrupted()) throw Interrupted();
    if (process_ != nullptr) return;
    process_ = std::make_unique<Worker>(
        [this] { return std::make_unique<Host>(spec_, scene_, make_runner_); }, timeout_);
    const nlohmann::json introduction =
        process_->ask({{"do", "construct"}}, "constructing " + spec_.entry->name);
    const nlohmann::json* known = scope_.find("introduction");
    if (known == nullptr) {
        scope_.keep("introduction", introduction);
    } else if (known->at("capabilities") != introduction.at("capabilities")) {
        const Difference other = first_difference(known->at("capabilities"), introduction.at("capabilities"));
        throw BadInput("the journal", other.where + " of " + spec_.entry->name, other.here,
                       other.there + ", of the device that was measured before");
    }
}

std::optional<pid_t> Case::process() const {
    if (process_ == nullptr || process_->process() < 0) return std::nullopt;
    return process_->process();
}

nlohmann::json Case::introduce() {
    if (scope_.find("introduction") == nullptr) start();
    return *scope_.find("introduction");
}

nlohmann::json Case::ask(const nlohmann::json& question, const std::string& doing, const OnEvent& on_event) {
    start();
    return process_->ask(question, doing, on_event);
}

DeviceLimits Case::measure_limits(JournalScope scope) {
    const std::string device = capabilities().at("api");
    if (scope.find(device) == nullptr) {
        nlohmann::json measured;
        const auto failure = failure_of([&] {
            measured = ask({{"do", "limits"}}, "measuring the limits of its device");
        });
        if (!failure && measured.is_null()) throw Interrupted();
        scope.keep(device, failure ? nlohmann::json(*failure) : measured);
    }
    const nlohmann::json& known = *scope.find(device);
    if (known.is_string()) throw DeviceError(known.get<std::string>());
    return device_limits_of(known);
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

nlohmann::json look_at(const BackendSpec& spec, const std::function<nlohmann::json(const Backend&)>& look,
                       std::chrono::duration<double> timeout) {
    Worker worker([&] { return std::make_unique<Look>(spec, look); }, timeout);
    return worker.ask({{"do", "look"}}, "constructing " + spec.entry->name);
}

}  // namespace voxspring
