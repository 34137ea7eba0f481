// A stand-in API, whose devices are plain memory of the host, in the places that CONTRIBUTING names for a new
// API: this file has them all, apart from the build. The program, a study and its result know it from there.
#include "backends/api.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "backends/registry.h"
#include "harness/cli/arguments.h"
#include "harness/study/study.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;

// --- The API: its devices ----------------------------------------------------------------------------------

std::vector<ListedDevice> devices() {
    return {{"Small memory", DeviceKind::integrated}, {"Large memory", DeviceKind::discrete}};
}

const RegisteredApi api({.name = "standin", .title = "Stand-in", .device_field = {}, .devices = devices});

// --- Its backends: what all of them have, and one of them --------------------------------------------------

class StandIn final : public Backend, public LimitsFacet {
public:
    StandIn() {
        const std::vector<std::size_t> tried = devices_to_try(devices(), asked_device("standin"));
        if (tried.empty()) throw Unavailable("no stand-in device has this name");
        device_ = devices()[tried.front()].name;
    }
    Capabilities capabilities() const override {
        return {.api = "Stand-in 1.0",
                .device = device_,
                .driver = "memory",
                .uuid = {},
                .clock = "steady_clock",
                .family = "standin",
                .limits_of = "Stand-in"};
    }
    void upload(const Problem& problem, const State& state) override { steps_->upload(problem, state); }
    void edit(const Problem& edited, const SpringEdit& edit) override { steps_->edit(edited, edit); }
    void step(int count) override { steps_->step(count); }
    void synchronize() override {}
    State download() override { return steps_->download(); }

    LimitsFacet* limits() override { return this; }
    DeviceLimits measure_limits() override {
        DeviceLimits limits;
        limits.copy_bytes_per_second = limits.cached_copy_bytes_per_second = 1e9;
        limits.float32_operations_per_second = 1e9;
        limits.float64_operations_per_second = 1e9;
        return limits;
    }
    StepWork step_work(const Problem& problem) const override { return {.bytes = problem.particle_count()}; }

private:
    using Clock = std::chrono::steady_clock;
    void mark(Mark which) override { (which == Mark::begin ? begin_ : end_) = Clock::now(); }
    double seconds_between_marks() const override {
        return std::chrono::duration<double>(end_ - begin_).count();
    }

    std::string device_;
    Clock::time_point begin_, end_;
    std::unique_ptr<Backend> steps_ = BackendSpec::parse("cpu_reference").make();
};

const Registered entry({
    .name = "standin_lists",
    .api = "standin",
    .summary = "Memory of the host.",
    .precisions = {Precision::float64},
    .formulations = {Formulation::position},
    .tuning = {},
    .make = [](const Options&) { return std::make_unique<StandIn>(); },
    .bytes = [](const Problem&, const Options&) { return std::uint64_t(0); },
});

// --- What the harness knows from there ---------------------------------------------------------------------

std::string said(std::vector<std::string> arguments) {
    std::vector<char*> words;
    arguments.insert(arguments.begin(), "voxspring");
    for (std::string& argument : arguments) words.push_back(argument.data());
    std::ostringstream out;
    EXPECT_EQ(run_command_line(int(words.size()), words.data(), out, {}), 0);
    return out.str();
}

TEST(NewApi, ItsDevicesAreListedAndChosen) {
    EXPECT_THAT(said({"list"}),
                HasSubstr("Stand-in devices, for --standin-device\n  0 Small memory, integrated\n"));
    const auto listed = nlohmann::json::parse(said({"list", "--json", "--standin-device", "small"}));
    EXPECT_EQ(listed.at("standin_devices").at(1).at("name"), "Large memory");
    std::string device;
    for (const auto& backend : listed.at("backends")) {
        if (backend.at("name") == "standin_lists") device = backend.at("device");
    }
    EXPECT_EQ(device, "Small memory");
    unsetenv(device_variable("standin").c_str());
    EXPECT_EQ(BackendSpec::parse("standin_lists").make()->capabilities().device, "Large memory");
}

TEST(NewApi, AStudyMeasuresItAndItsResultDescribesIt) {
    Study study;
    study.name = "test";
    study.repetitions = 2;
    study.steps = 2;
    study.backends = {"standin_*"};
    study.scenes = {{"box@5", 2, {}}};
    const nlohmann::json result = run_study(study, {});
    const nlohmann::json& context = result.at("context").at("voxspring");
    const nlohmann::json& known = context.at("backends").at("standin_lists");
    for (const auto& [key, value] :
         {std::pair{"family", "standin"}, std::pair{"title", "Stand-in"}, std::pair{"addressing", "explicit"},
          std::pair{"device", "Large memory"}})
        EXPECT_EQ(known.at(key), value) << key;
    EXPECT_EQ(context.at("driver"), "memory");
    EXPECT_EQ(context.at("limits").at("Stand-in").at("copy_bytes_per_second"), 1e9);
    ASSERT_FALSE(result.at("benchmarks").empty());
    EXPECT_GT(result.at("benchmarks").at(0).at("limit_seconds"), 0);
    EXPECT_TRUE(result.at("failed").empty());
}

}  // namespace
}  // namespace voxspring::testing
