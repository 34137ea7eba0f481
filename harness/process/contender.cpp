#include "harness/process/contender.h"

#include <utility>

#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/device/limits.h"
#include "harness/results/capabilities.h"
#include "harness/scene/scene_runner.h"

namespace voxspring {
namespace {

using Clock = std::chrono::steady_clock;

/// A contender in its process.
class Host : public Answerer {
public:
    Host(const BackendSpec& spec, const Scene& scene, const MakeTask& make_task)
        : spec_(spec), scene_(scene), make_task_(make_task) {}

    nlohmann::json answer(const nlohmann::json& question, const Post& post) override {
        if (question.at("do") == "construct") return construct();
        if (question.at("do") == "limits") return to_json(spec_.make()->measure_limits());
        if (task_ == nullptr) task_ = make_task_(spec_);
        return task_->answer(*backend_, question, post);
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
    const MakeTask& make_task_;
    std::unique_ptr<Backend> backend_;
    std::unique_ptr<Task> task_;
};

/// Says something of a backend.
class Look : public Answerer {
public:
    Look(const BackendSpec& spec, const std::function<nlohmann::json(const Backend&)>& look)
        : spec_(spec), look_(look) {}
    nlohmann::json answer(const nlohmann::json&, const Post&) override { return look_(*spec_.make()); }

private:
    const BackendSpec& spec_;
    const std::function<nlohmann::json(const Backend&)>& look_;
};

}  // namespace

Contender::Contender(BackendSpec spec, const Scene& scene, MakeTask make_task, Record record,
                     std::chrono::duration<double> timeout)
    : spec_(std::move(spec)),
      scene_(scene),
      make_task_(std::move(make_task)),
      record_(std::move(record)),
      timeout_(timeout) {}

void Contender::start() {
    if (interrupted()) throw Interrupted();
    if (process_ != nullptr) return;
    process_ = std::make_unique<Worker>([this] { return std::make_unique<Host>(spec_, scene_, make_task_); },
                                        timeout_);
    const nlohmann::json introduction =
        process_->ask({{"do", "construct"}}, "constructing " + spec_.entry->name);
    const nlohmann::json* known = record_.find("introduction");
    if (known == nullptr) {
        record_.keep("introduction", introduction);
    } else if (known->at("capabilities") != introduction.at("capabilities")) {
        throw BadInput("the journal", spec_.entry->name, introduction.at("capabilities").dump(),
                       "the device that was measured before, " + known->at("capabilities").dump());
    }
}

nlohmann::json Contender::introduce() {
    if (record_.find("introduction") == nullptr) start();
    return *record_.find("introduction");
}

nlohmann::json Contender::ask(const nlohmann::json& question, const std::string& doing, const Post& on_news) {
    start();
    return process_->ask(question, doing, on_news);
}

DeviceLimits Contender::measure_limits(Record record) {
    const std::string device = capabilities().at("api");
    if (record.find(device) == nullptr) {
        nlohmann::json measured;
        const auto failure = failure_of([&] {
            measured = ask({{"do", "limits"}}, "measuring the limits of its device");
        });
        if (!failure && measured.is_null()) throw Interrupted();
        record.keep(device, failure ? nlohmann::json(*failure) : measured);
    }
    const nlohmann::json& known = *record.find(device);
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
