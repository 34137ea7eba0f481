// Studies on backends that misbehave: each of them loses only its own row.
#include "harness/study/study.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>
#include <sys/shm.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <future>
#include <limits>
#include <map>
#include <mutex>
#include <new>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <system_error>
#include <thread>

#include "backends/api.h"
#include "harness/base/bad_input.h"
#include "harness/base/files.h"
#include "harness/cli/commands.h"
#include "harness/device/limits.h"
#include "harness/process/case.h"
#include "harness/process/journal.h"
#include "harness/process/message.h"
#include "harness/process/shared_state.h"
#include "harness/process/signal_process.h"
#include "harness/process/worker.h"
#include "harness/process/worker_main.h"
#include "harness/study/selection.h"
#include "harness/study/timing_runner.h"
#include "harness/verification/reference.h"
#include "harness/verification/verify.h"
#include "tests/volume_files.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// cpu_reference with a fault.
class Faulty : public MonitoredBackend {
public:
    enum class Fault {
        none,
        unavailable,
        unsupported,
        device_error_in_upload,
        device_error_in_step,
        device_error_in_limits,
        wrong,
        nan,
        departs,            ///< in step 3
        launches_in_hours,  ///< and by itself in half of the time, in a quarter after all else
        compiles,           ///< as CUDA does: once a process
        checked_late,       ///< fails where its state is checked after its second start
        closes_its_files,   ///< in a step, and hangs
    };

    explicit Faulty(Fault fault, std::string uuid = "") : fault_(fault), uuid_(std::move(uuid)) {
        if (fault == Fault::unavailable) throw Unavailable("no such device");
    }
    Capabilities capabilities() const override {
        Capabilities capabilities = cpu_capabilities("scalar", 1);
        capabilities.uuid = uuid_;
        if (fault_ == Fault::compiles) capabilities.kernel_compiler = "a compiler";
        // Their limits are kept apart from the processor's.
        if (fault_ == Fault::launches_in_hours) capabilities.driver = "waits";
        if (fault_ == Fault::device_error_in_limits) capabilities.driver = "has no counters";
        return capabilities;
    }
    std::string unsupported(const Problem&) const override {
        return fault_ == Fault::unsupported ? "grid of 8 exceeds the limit of 7" : "";
    }
    void edit(const Problem&, const SpringEdit&) override {}
    DeviceLimits measure_limits() override {
        if (fault_ == Fault::device_error_in_limits) throw DeviceError("no counters");
        DeviceLimits limits = CpuBackend::measure_limits();
        if (fault_ == Fault::launches_in_hours) limits.launch_seconds = 3600;
        return limits;
    }
    CompileTime compile_time() const override { return {compiled_, compiled_}; }
    std::optional<double> own_launch_seconds() override {
        if (uploads_ != 0 && !left_) throw DeviceError("a launch is measured before all else or after it");
        if (fault_ != Fault::launches_in_hours) return std::nullopt;
        return left_ ? 900.0 : 1800.0;
    }
    State download() override {
        State state = MonitoredBackend::download();
        left_ = true;
        if (fault_ == Fault::wrong) state.displacement.back().x += 0.1;
        if (fault_ == Fault::nan) state.displacement.front().y = std::numeric_limits<double>::quiet_NaN();
        return state;
    }

protected:
    void integrate(int count) override {
        // The third upload is the second timed repetition.
        if (fault_ == Fault::device_error_in_step && uploads_ == 2) throw DeviceError("device lost");
        if (fault_ == Fault::closes_its_files) {
            for (int file = 3; file < 256; ++file) close(file);
            std::this_thread::sleep_for(std::chrono::minutes(1));
        }
        MonitoredBackend::integrate(count);
        steps_ += count;
    }

private:
    void begin(const Problem& problem, const State& state) override {
        if (fault_ == Fault::device_error_in_upload) throw DeviceError("out of memory");
        static bool is_compiled = false;
        compiled_ = fault_ == Fault::compiles && !std::exchange(is_compiled, true) ? 1000 : 0;
        MonitoredBackend::begin(problem, state);
        ++uploads_;
        steps_ = 0;
    }
    bool within(double) override {
        if (fault_ == Fault::checked_late && uploads_ > 1) throw DeviceError("checked while it is timed");
        return fault_ != Fault::departs || steps_ < 3;
    }

    Fault fault_;
    std::string uuid_;
    int uploads_ = 0, steps_ = 0;
    bool left_ = false;    ///< whether its state was asked for
    double compiled_ = 0;  ///< seconds
};

/// A device that is lost in one of the calls to it. Every later call fails, as with a card that has fallen
/// off its bus. The processes of all cases share the device.
struct Device {
    std::array<char, 16> lost_in = {};
    int calls_left = 0;
    bool lost = false;
    int downloads = 0, steps_after_one = 0;
    int constructing = 0, stepping = 0;
    pid_t process = 0;           ///< in which a backend that may share one made the latest step
    int changes_of_process = 0;  ///< one for the first step
    void call(const std::string& name) {
        if (name == "download") ++downloads;
        if (name == "step" && downloads > 0) ++steps_after_one;
        if (name == lost_in.data() && --calls_left == 0) lost = true;
        if (lost) throw DeviceError("device lost, seen in " + name);
    }
};
/// The test's device in System V shared memory, which an environment variable names to its processes.
Device& shared_device() {
    constexpr const char* name = "STUDY_TEST_DEVICE";
    const char* known = std::getenv(name);
    const int segment = known != nullptr ? std::atoi(known) : shmget(IPC_PRIVATE, sizeof(Device), 0600);
    void* memory = shmat(segment, nullptr, 0);
    if (known != nullptr) return *static_cast<Device*>(memory);
    shmctl(segment, IPC_RMID, nullptr);
    setenv(name, std::to_string(segment).c_str(), 1);
    return *new (memory) Device;
}
Device& device = shared_device();

/// cpu_reference on that device.
class Losing : public MonitoredBackend {
public:
    Losing() {
        if (device.lost) throw Unavailable("no context: device lost");
    }
    Capabilities capabilities() const override { return cpu_capabilities("scalar", 1); }
    void edit(const Problem& edited, const SpringEdit& edit) override {
        device.call("edit");
        MonitoredBackend::edit(edited, edit);
    }
    void synchronize() override { device.call("synchronize"); }
    State download() override {
        device.call("download");
        return MonitoredBackend::download();
    }
    std::string state_fingerprint() override { return fingerprint_of(MonitoredBackend::download()); }

private:
    void begin(const Problem& problem, const State& state) override {
        device.call("upload");
        MonitoredBackend::begin(problem, state);
    }
    void integrate(int count) override {
        device.call("step");
        MonitoredBackend::integrate(count);
    }
};

Registered fake(const std::string& name, std::function<std::unique_ptr<Backend>()> make) {
    return registered_for_test(name, std::move(make), Formulation::position);
}

Registered faulty(const std::string& name, Faulty::Fault fault) {
    return fake(name, [fault] { return std::make_unique<Faulty>(fault); });
}

Registered on_card(const std::string& name, const std::string& uuid) {
    return fake(name, [uuid] { return std::make_unique<Faulty>(Faulty::Fault::none, uuid); });
}

const Registered test_backends[] = {
    faulty("test_sound", Faulty::Fault::none),
    faulty("test_unavailable", Faulty::Fault::unavailable),
    faulty("test_unsupported", Faulty::Fault::unsupported),
    faulty("test_device_error_in_upload", Faulty::Fault::device_error_in_upload),
    faulty("test_device_error_in_step", Faulty::Fault::device_error_in_step),
    faulty("unmeasured", Faulty::Fault::device_error_in_limits),
    faulty("compiling", Faulty::Fault::compiles),
    faulty("waiting", Faulty::Fault::launches_in_hours),
    faulty("test_wrong", Faulty::Fault::wrong),
    faulty("test_nan", Faulty::Fault::nan),
    faulty("departs", Faulty::Fault::departs),
    faulty("checked", Faulty::Fault::checked_late),
    faulty("closing", Faulty::Fault::closes_its_files),
    on_card("card_a", "GPU-a"),
    on_card("card_b", "GPU-b"),
    on_card("card_c", "GPU-a"),
    fake("losing_one", [] { return std::make_unique<Losing>(); }),
    fake("losing_two", [] { return std::make_unique<Losing>(); }),
};

/// A lock of a library of the program.
std::mutex in_use;
std::FILE* const log_file = std::fopen("/dev/null", "w");

std::unique_ptr<Backend> make_with_locks() {
    const std::lock_guard lock(in_use);
    std::fputs("constructing\n", log_file);
    return std::make_unique<Faulty>(Faulty::Fault::none);
}

/// Kills the launcher, which forks this backend's process, as the system does when memory runs out.
class LauncherKilled : public Faulty {
public:
    LauncherKilled() : Faulty(Fault::none) {}

private:
    void integrate(int) override {
        signal_process(getppid(), SIGKILL);
        for (;;) pause();
    }
};

/// A device whose constructor waits until three processes are in it at once, and its first step likewise.
class Together : public Faulty {
public:
    Together() : Faulty(Fault::none) { wait_for_others(device.constructing, "constructed"); }

private:
    void integrate(int count) override {
        if (!std::exchange(has_stepped_, true)) wait_for_others(device.stepping, "stepped");
        Faulty::integrate(count);
    }
    bool has_stepped_ = false;

    static void wait_for_others(int& count, const char* doing) {
        using Clock = std::chrono::steady_clock;
        const auto patience = Clock::now() + std::chrono::seconds(60);
        const std::atomic_ref together(count);
        for (++together; together < 3;) {
            if (Clock::now() > patience)
                throw DeviceError(std::string("the others are not ") + doing + " meanwhile");
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    }
};

/// A device that no other process of the study may have while it steps.
class Alone : public Faulty {
public:
    Alone() : Faulty(Fault::none) {}

private:
    void integrate(int count) override {
        const std::string parent = "PPid:\t" + std::to_string(getppid()) + "\n";
        int processes = 0;
        std::error_code none;
        for (const auto& process : std::filesystem::directory_iterator("/proc", none)) {
            if (process.is_symlink()) continue;  // `self`, which names a process too
            std::stringstream status;
            status << std::ifstream(process.path() / "status").rdbuf();
            processes += int(status.str().find(parent) != std::string::npos);
        }
        if (processes > 1) throw DeviceError(std::to_string(processes) + " processes");
        Faulty::integrate(count);
    }
};

/// A driver that gives each process its device only once.
class GivenOnce : public Faulty {
public:
    GivenOnce() : Faulty(Fault::none) {
        static bool is_given = false;
        if (std::exchange(is_given, true)) throw DeviceError("the device has an error from before");
    }
};

const RegisteredApi sharing({.name = "sharing",
                             .title = "An API whose backends share",
                             .shares_process = true});

/// A backend whose process may have others.
class Sharing : public Faulty {
public:
    enum class Harm { none, ends_its_process, spoils_states };

    explicit Sharing(Harm harm) : Faulty(Fault::none), harm_(harm) {}
    State download() override {
        State state = Faulty::download();
        if (are_spoilt && harm_ == Harm::none) state.displacement.back().x += 0.1;
        return state;
    }

private:
    void integrate(int count) override {
        if (std::exchange(device.process, getpid()) != getpid()) ++device.changes_of_process;
        if (harm_ == Harm::ends_its_process) raise(SIGKILL);
        if (harm_ == Harm::spoils_states) are_spoilt = true;
        Faulty::integrate(count);
    }
    static inline bool are_spoilt = false;  ///< states of other backends in this process
    const Harm harm_;
};

Registered sharing_backend(const std::string& name, Sharing::Harm harm) {
    return fake(name, [harm] { return std::make_unique<Sharing>(harm); });
}

const Registered host_backends[] = {
    sharing_backend("sharing_one", Sharing::Harm::none),
    sharing_backend("sharing_two", Sharing::Harm::none),
    sharing_backend("sharing_ends", Sharing::Harm::ends_its_process),
    sharing_backend("sharing_spoils", Sharing::Harm::spoils_states),
    fake("alone", [] { return std::make_unique<Alone>(); }),
    fake("given_once", [] { return std::make_unique<GivenOnce>(); }),
    fake("together_one", [] { return std::make_unique<Together>(); }),
    fake("together_two", [] { return std::make_unique<Together>(); }),
    fake("together_three", [] { return std::make_unique<Together>(); }),
    fake("with_locks", make_with_locks),
    fake("launcher_killed", [] { return std::make_unique<LauncherKilled>(); }),
    fake("launcher_killed_early",
         []() -> std::unique_ptr<Backend> {
             signal_process(getppid(), SIGKILL);
             for (;;) pause();
         }),
};

Study study_of(const std::vector<std::string>& backends) {
    Study study;
    study.name = "test";
    study.repetitions = 3;
    study.steps = 4;
    study.backends = backends;
    study.scenes = {{"box@5", 4, {}}};
    return study;
}

const nlohmann::json& row_of(const nlohmann::json& list, const std::string& backend) {
    for (const auto& row : list) {
        if (row.at("backend") == backend) return row;
    }
    throw std::runtime_error("no row of " + backend);
}

/// Each value of `key` in a list of rows, once.
std::set<std::string> values_of(const nlohmann::json& list, const std::string& key) {
    std::set<std::string> values;
    for (const auto& row : list) values.insert(row.at(key));
    return values;
}

std::string reason_of(const nlohmann::json& list, const std::string& backend) {
    return row_of(list, backend).at("reason");
}

TEST(Study, AFaultTakesDownItsOwnRowOnly) {
    const nlohmann::json result = run_study(study_of({"test_*"}), {});

    const nlohmann::json& skipped = result.at("skipped");
    EXPECT_EQ(skipped.size(), 2u);
    EXPECT_EQ(reason_of(skipped, "test_unavailable"), "no such device");
    EXPECT_THAT(reason_of(skipped, "test_unsupported"), HasSubstr("limit of 7"));

    const nlohmann::json& failed = result.at("failed");
    EXPECT_EQ(failed.size(), 4u);
    EXPECT_EQ(reason_of(failed, "test_device_error_in_upload"), "out of memory");
    EXPECT_EQ(reason_of(failed, "test_device_error_in_step"), "device lost");
    EXPECT_THAT(reason_of(failed, "test_wrong"), HasSubstr("particle 124"));
    EXPECT_THAT(reason_of(failed, "test_nan"), HasSubstr("particle 0 is not finite"));

    EXPECT_THAT(values_of(result.at("benchmarks"), "backend"), ElementsAre("test_sound"));
    EXPECT_EQ(result.at("benchmarks").size(), 3u + 4u) << "3 repetitions, mean, median, stddev, cv";
    // float64 positions of up to 4 against float64 displacements.
    EXPECT_LT(row_of(result.at("verification"), "test_sound").at("error_max"), 1e-14);
    EXPECT_EQ(row_of(result.at("verification"), "test_wrong").at("passed"), false);
    EXPECT_TRUE(row_of(result.at("verification"), "test_nan").at("error_max").is_null());
}

TEST(Study, LeavesOutWhatTheCommandLineDoesNotWant) {
    const auto measured = [](std::vector<std::string> globs) {
        StudyOptions options;
        options.backends = std::move(globs);
        const nlohmann::json result = run_study(study_of({"test_s*", "cpu_reference"}), options);
        return values_of(result.at("verification"), "backend");
    };
    EXPECT_EQ(measured({"!cpu_*"}), std::set<std::string>{"test_sound"});
    // They come in any order, and nothing is added for them.
    EXPECT_EQ(measured({"cpu_reference", "!test_sound"}), std::set<std::string>{"cpu_reference"});
    EXPECT_EQ(measured({"!cpu_reference/*"}), std::set<std::string>{"test_sound"});
    EXPECT_THAT([&] { measured({"!cpu_refrence"}); },
                ::testing::ThrowsMessage<BadInput>(HasSubstr("did you mean cpu_reference?")));
    // Labels, which globs are compared with, have no options.
    EXPECT_THAT([&] { measured({"!cpu_reference:precision=float64"}); },
                ::testing::ThrowsMessage<BadInput>(HasSubstr("such as !cpu_parallel/increment/float64")));
    const auto said = [&](const std::vector<std::string>& globs) {
        ::testing::internal::CaptureStderr();
        measured(globs);
        return ::testing::internal::GetCapturedStderr();
    };
    const std::string without_effect = " leaves nothing out: no backend of the study matches";
    EXPECT_THAT(said({"!cpu_parallel", "!cpu_reference"}),
                ::testing::AllOf(HasSubstr("voxspring: --backend !cpu_parallel" + without_effect),
                                 Not(HasSubstr("!cpu_reference" + without_effect))));
    EXPECT_THAT(said({"cpu_*", "!cpu_parallel*"}), Not(HasSubstr(without_effect)));
    for (const std::vector<std::string>& none : {std::vector<std::string>{"!cpu_*", "!test_*"},
                                                 std::vector<std::string>{"cpu_reference", "!cpu_*"}}) {
        EXPECT_THAT([&] { measured(none); }, ::testing::ThrowsMessage<BadInput>(
                                                 HasSubstr("expected globs that leave the study a backend")));
    }
}

TEST(Study, ARunThatDivergesIsNotTimed) {
    Study study = study_of({"departs", "test_sound"});
    study.scenes = {{"box@5", 70, {}}};
    const nlohmann::json result = run_study(study, {});
    ASSERT_EQ(result.at("failed").size(), 1u);
    EXPECT_THAT(std::string(result.at("failed")[0].at("reason")),
                HasSubstr("diverged at step 3: a particle is not finite or moved by more than"));
    EXPECT_THAT(values_of(result.at("benchmarks"), "backend"), ElementsAre("test_sound"));
    // Fewer steps than lie between two checks: only the backend could detect it, and it did not check.
    study.scenes = {{"box@5", 4, {}}};
    EXPECT_TRUE(run_study(study, {}).rows("failed").empty());
}

// One API checks more often than another.
TEST(Study, NoCheckForDivergenceIsTimed) {
    Study study = study_of({"checked"});
    study.scenes = {{"box@5", 70, {}}};
    const nlohmann::json result = run_study(study, {});
    EXPECT_TRUE(result.at("failed").empty()) << result.at("failed");
    EXPECT_FALSE(result.at("benchmarks").empty());
    study.kind = "pareto";
    study.settings = {{"time_steps", {0.5}}};
    const nlohmann::json runs = run_study(study, {});
    EXPECT_TRUE(runs.at("failed").empty()) << runs.at("failed");
    ASSERT_EQ(runs.at("pareto").size(), 1u);
    EXPECT_EQ(runs.at("pareto")[0].at("repetitions"), study.repetitions);
}

TEST(Study, EveryRowHasItsErrors) {
    Study study = study_of({"cpu_parallel"});
    const nlohmann::json result = run_study(study, {});
    ASSERT_FALSE(result.at("benchmarks").empty());
    for (const auto& row : result.at("benchmarks")) {
        EXPECT_GT(row.at("error_relative_l2").get<double>(), 0);
        EXPECT_LT(row.at("error_relative_l2"), row.at("total_error_relative_l2"));
        EXPECT_GT(row.at("total_error_max").get<double>(), 0);
        EXPECT_LT(row.at("total_error_uncertainty"), row.at("total_error_relative_l2"));
        EXPECT_TRUE(row.at("total_error_reason").is_null());
        EXPECT_LT(row.at("momentum_error").get<double>(), 1e-4);
        EXPECT_LT(std::abs(row.at("energy_error").get<double>()), 1e-3);
        EXPECT_EQ(row.at("chaotic"), false);
        EXPECT_LT(row.at("spread").get<double>(), 1e-4);
        EXPECT_GT(row.at("spread").get<double>(), 0);
    }
    for (const auto& row : result.at("verification")) {
        EXPECT_LE(row.at("error_max"), row.at("tolerance"));
        EXPECT_LE(row.at("error_rms"), row.at("tolerance_rms"));
        EXPECT_LE(row.at("tolerance").get<double>(), 4 * row.at("spread_max").get<double>());
        EXPECT_LE(row.at("tolerance").get<double>(), 0.1 * row.at("motion_max").get<double>());
        EXPECT_LE(row.at("spread_rms"), row.at("spread_max"));
        EXPECT_LE(row.at("motion_rms"), row.at("motion_max"));
    }
    study.settings = {{"total_error", false}};
    const nlohmann::json without = run_study(study, {});
    for (const auto& row : without.at("benchmarks")) {
        EXPECT_TRUE(row.at("total_error_relative_l2").is_null());
        EXPECT_THAT(std::string(row.at("total_error_reason")), HasSubstr("does not ask"));
    }
}

TEST(Study, TwoCardsAreNotComparedAsOne) {
    Study study = study_of({"card_*", "test_sound"});
    study.scenes.push_back({"box@4", 4, {"card_b", "card_c"}});
    const nlohmann::json result = run_study(study, {});
    EXPECT_THAT(values_of(result.at("benchmarks"), "backend"), ElementsAre("card_a", "card_c", "test_sound"));
    ASSERT_EQ(result.at("skipped").size(), 2u) << "card_b, on both scenes";
    for (const auto& row : result.at("skipped")) {
        EXPECT_THAT(std::string(row.at("reason")),
                    AllOf(HasSubstr("GPU-b"), HasSubstr("card_a"), HasSubstr("GPU-a")));
    }
}

TEST(Study, RatesFollowFromTimes) {
    const nlohmann::json result = run_study(study_of({"test_sound"}), {});
    for (const auto& row : result.at("benchmarks")) {
        if (row.at("run_type") != "iteration") continue;
        EXPECT_EQ(row.at("iterations"), 4);
        EXPECT_EQ(row.at("particles"), 125);
        EXPECT_EQ(row.at("springs"), 3 * 4 * 25 + 6 * 16 * 5);
        const double seconds = row.at("real_time").get<double>() * 1e-6;
        EXPECT_NEAR(row.at("particle_updates_per_second").get<double>() * seconds, 125, 1e-6);
        EXPECT_NEAR(row.at("spring_updates_per_second").get<double>() * seconds, 780, 1e-6);
        EXPECT_GE(row.at("host_seconds_per_step").get<double>(), seconds);
    }
}

TEST(Study, ARowSaysWhatAutoMeans) {
    const nlohmann::json result = run_study(study_of({"cpu_explicit", "cpu_explicit:threads=2"}), {});
    ASSERT_EQ(result.at("benchmarks").size(), 2 * (3u + 4u));
    for (const auto& row : result.at("benchmarks")) {
        if (row.at("tuning") == "threads=2") {
            EXPECT_FALSE(row.contains("chosen"));
        } else {
            EXPECT_EQ(row.at("chosen"), "threads=1") << "125 particles";
        }
    }
}

TEST(Study, FractionsFollowFromLimits) {
    const nlohmann::json result = run_study(study_of({"test_sound"}), {});
    const auto& limits = result.at("context").at("voxspring").at("limits");
    ASSERT_EQ(limits.size(), 1u);
    // 125 particles and 780 springs as cpu_reference reads and writes them.
    const StepWork work{.bytes = 125 * 9 * 24 + 780 * (24 + 40),
                        .written_bytes = 125 * 4 * 24,
                        .footprint_bytes = 125 * 3 * 24 + 780 * (24 + 40),
                        .operations = 780 * 35 + 125 * 22};
    const DeviceLimits cpu = device_limits_of(limits.at("CPU"));
    EXPECT_FALSE(cpu.bandwidth.empty());
    const double expected = std::max(double(work.bytes) / bytes_per_second_of(work, cpu),
                                     double(work.operations) / cpu.float64_operations_per_second.value());
    for (const auto& row : result.at("benchmarks")) {
        EXPECT_DOUBLE_EQ(row.at("limit_seconds"), expected);
        EXPECT_EQ(row.at("step_bytes"), work.bytes);
        EXPECT_EQ(row.at("step_written_bytes"), work.written_bytes);
        EXPECT_EQ(row.at("step_footprint_bytes"), work.footprint_bytes);
        EXPECT_EQ(row.at("step_operations"), work.operations);
        const std::string aggregate = row.value("aggregate_name", "");
        if (aggregate == "stddev" || aggregate == "cv") {
            EXPECT_TRUE(row.at("fraction_of_limit").is_null()) << aggregate;
        } else {
            const double seconds = row.at("real_time").get<double>() * 1e-6;
            EXPECT_DOUBLE_EQ(row.at("fraction_of_limit").get<double>(), expected / seconds) << aggregate;
        }
    }
}

TEST(Study, ARowThatWaitsForLaunchesIsHeldAgainstThoseOfItsOwnProcess) {
    const nlohmann::json result = run_study(study_of({"waiting"}), {});
    EXPECT_EQ(result.at("context").at("voxspring").at("limits").at("CPU").at("launch_seconds"), 900)
        << "the best of all processes";
    ASSERT_FALSE(result.at("benchmarks").empty());
    for (const auto& row : result.at("benchmarks")) {
        EXPECT_EQ(row.at("limited_by"), "launch");
        EXPECT_EQ(row.at("limit_seconds"), 900) << "the best of before and after";
    }
}

TEST(Study, WhatIsCompiledAheadCountsAsCompiled) {
    const nlohmann::json result = run_study(study_of({"compiling"}), {});
    EXPECT_TRUE(result.at("failed").empty());
    ASSERT_FALSE(result.at("benchmarks").empty());
    for (const auto& row : result.at("benchmarks")) {
        EXPECT_EQ(row.at("compile_seconds"), 1000);
        // The median of three starts, two of which upload in less than these 1000 s of compiling.
        EXPECT_GE(row.at("upload_seconds"), 0);
        EXPECT_LT(row.at("upload_seconds"), 1000);
    }
}

TEST(Study, ACaseHasItsThreadsAgainAfterLimitsCouldNotBeMeasured) {
    const int threads = omp_get_max_threads(), share = omp_get_num_procs() + 1;
    CaseProgram program{"timing"};
    program.threads = share;
    const Answerer answer =
        case_answerer(case_description(BackendSpec::parse("unmeasured"), program), nullptr);
    EXPECT_THROW(answer({{"do", "limits"}}, {}), DeviceError);
    EXPECT_EQ(omp_get_max_threads(), share);
    omp_set_num_threads(threads);
}

TEST(Study, GoesOnWithoutLimits) {
    const nlohmann::json result = run_study(study_of({"unmeasured"}), {});
    EXPECT_EQ(result.at("context").at("voxspring").at("limits").at("CPU"), "no counters");
    EXPECT_TRUE(result.at("failed").empty());
    ASSERT_EQ(result.at("benchmarks").size(), 3u + 4u);
    for (const auto& row : result.at("benchmarks")) {
        for (const char* field : {"limit_seconds", "limited_by", "fraction_of_limit"})
            EXPECT_TRUE(row.at(field).is_null()) << field;
    }
}

TEST(Study, SelectsAndAdds) {
    StudyOptions options;
    options.backends = {"*reference", "test_sound"};
    options.scenes = {"beam@3x3x5"};
    options.repetitions = 1;
    const nlohmann::json result = run_study(study_of({"test_sound", "test_wrong"}), options);
    EXPECT_TRUE(result.at("failed").empty());
    ASSERT_EQ(result.at("benchmarks").size(), 2u);
    EXPECT_EQ(result.at("benchmarks")[0].at("scene"), "beam@3x3x5");

    const auto expect_refused = [](const Study& study, const std::vector<std::string>& backends,
                                   const std::vector<std::string>& scenes) {
        StudyOptions of;
        of.backends = backends;
        of.scenes = scenes;
        EXPECT_THROW(run_study(study, of), BadInput);
    };
    expect_refused(study_of({"test_sound"}), {"no_such_*"}, {});
    expect_refused(study_of({"test_sound"}), {}, {"no_such_scene"});
    expect_refused(load_study("stress"), {}, {"box"});
    expect_refused(study_of({"left_out_*"}), {}, {});
}

// Otherwise a scene that is too large would have a row for each backend of the study, which nobody asked for.
TEST(Study, BesidesAutoNoBackendIsKnown) {
    const Study study = study_of({"test_*", "cpu_*"});
    const auto known = [&](const std::vector<std::string>& globs) {
        return known_specs(study, {.scene = "box@5", .steps = 4, .backends = {}, .only = globs}).size();
    };
    EXPECT_EQ(known({"auto"}), 0u);
    EXPECT_EQ(known({"auto:formulation=position", "!cpu_parallel"}), 0u);
    EXPECT_EQ(known({"auto", "cpu_reference"}), 1u);

    Study of_auto = study_of({"auto"});
    of_auto.scenes.insert(of_auto.scenes.begin(), {"box@2000", 4, {}});
    ::testing::internal::CaptureStderr();
    const nlohmann::json result = run_study(of_auto, {});
    EXPECT_THAT(::testing::internal::GetCapturedStderr(),
                HasSubstr("voxspring: a scene is left out: box@2000: dataset.dims"));
    EXPECT_EQ(values_of(result.at("verification"), "scene"), std::set<std::string>{"box@5"});
}

TEST(Study, APatternStandsForTheBackendsThatHaveItsOptions) {
    const nlohmann::json result = run_study(study_of({"cpu_*:precision=float32"}), {});
    EXPECT_THAT(values_of(result.at("benchmarks"), "backend"), ElementsAre("cpu_explicit", "cpu_parallel"))
        << "cpu_reference has no float32";
}

TEST(Study, AStarStandsForEachValueThatTheBackendHas) {
    std::set<std::string> measured;
    const nlohmann::json result = run_study(study_of({"cpu_parallel:formulation=*,precision=*"}), {});
    for (const auto& row : result.at("verification"))
        measured.insert(std::string(row.at("formulation")) + "/" + std::string(row.at("precision")));
    const BackendEntry& entry = registry().at("cpu_parallel");
    EXPECT_EQ(measured.size(), entry.formulations.size() * entry.precisions.size());
}

TEST(Study, MeasuresInGroupsWhereThereAreManyBackends) {
    const std::string every = "cpu_parallel:formulation=*";
    const std::size_t backends = registry().at("cpu_parallel").formulations.size();
    StudyOptions options;
    options.together = 2;  // of five: two, then three in two groups
    const nlohmann::json result = run_study(study_of({every}), options);
    EXPECT_EQ(result.at("verification").size(), backends);
    std::set<int> families;
    for (const auto& row : result.at("benchmarks")) families.insert(row.at("family_index").get<int>());
    EXPECT_EQ(families.size(), backends);
    EXPECT_EQ(*families.rbegin(), int(backends) - 1);
    EXPECT_TRUE(result.at("failed").empty());
}

TEST(Study, TakesAProblemThatIsAtHand) {
    Problem chain;
    for (int i = 0; i < 5; ++i) chain.rest_position.emplace_back(i, 0, 0);
    for (std::uint32_t i = 0; i < 4; ++i) chain.springs.push_back({i, i + 1, 1.0, 1.0});
    chain.gravity = {0.01, 0, 0};
    Study study = study_of({"cpu_reference", "cpu_parallel"});
    study.scenes = {{.scene = "chain",
                     .steps = 6,
                     .backends = {},
                     .built = std::make_shared<const Scene>(scene_of("chain", chain))}};
    const nlohmann::json result = run_study(study, {});
    const auto& row = row_of(result.at("verification"), "cpu_reference");
    EXPECT_EQ(row.at("scene"), "chain");
    EXPECT_EQ(row.at("particles"), 5);
    EXPECT_EQ(row.at("springs"), 4);
    EXPECT_EQ(row.at("passed"), true);
    // The scene needs a lattice: it is skipped with a reason rather than run on a scene of another name.
    EXPECT_EQ(row_of(result.at("skipped"), "cpu_parallel").at("scene"), "chain");
}

class StudyFile : public ::testing::Test {
protected:
    TemporaryFolder folder_;
    std::string write(const std::string& text) const { return folder_.write("study_test.json", text); }
    Result run(const std::string& text, const StudyOptions& options = {}) const {
        return run_study(load_study(write(text)), options);
    }
};

TEST_F(StudyFile, IsRefusedWithFileKeyValueAndWhatIsAccepted) {
    using Words = std::vector<std::string>;
    const Words accepted = {"accepted"};
    const std::string box = R"("scenes": [{"scene": "box"}])", any = R"("backends": ["*"], )",
                      of_box = any + box, pareto = R"("kind": "pareto", )",
                      target = R"("kind": "fastest", )" + of_box +
                               R"(, "targets": [{"scene": "box", "formulation": "position", )";
    const auto backend = [&](const std::string& spec) { return R"("backends": [")" + spec + "\"], " + box; };
    const auto scene = [&](const std::string& keys) {
        return any + R"("scenes": [{"scene": "box", )" + keys + "}]";
    };
    const std::vector<std::pair<std::string, Words>> cases = {
        {R"("backends": ["cpu_*"], "scenes": [])", {"scenes"}},
        {backend("opencl_*"), {"study_test.json", "backends[0]", "opencl_*", "cpu_reference"}},
        {backend("cpu_reference:precision=float16"), {"float16", "float64"}},
        {backend("cpu_*:precision=float16"), {"float16"}},  // no backend has it
        {backend("cuda_*:fetch=l1"), accepted},             // in a build without CUDA too
        {backend("auto:mask=none"), {"backends[0]", "mask"}},
        {of_box, accepted},
        {scene(R"("step": 3)"), {"scenes[0]", "step", "steps"}},
        {scene(R"("steps": 0)"), {"scenes[0].steps", "0"}},
        {scene(R"("rewind": false)"), {"scenes[0].rewind"}},
        {scene(R"("map": true)"), {"scenes[0].map"}},
        {R"("kind": "stability", )" + scene(R"("map": true)"), accepted},
        {of_box + R"(, "repetitions": 2.5)", {"repetitions", "2.5"}},
        {R"("kind": "speed", )" + of_box, {"kind", "speed", "pareto"}},
        {pareto + of_box, {"time_steps"}},
        {pareto + of_box + R"(, "time_steps": [0.5, 0.5])", {"time_steps[1]", "descending"}},
        {pareto + of_box + R"(, "time_steps": [2])", {"time_steps[0]", "2"}},
        {of_box + R"(, "time_steps": [0.5])", {"time_steps"}},  // of no use to a timing study
        {pareto + backend("cpu_*:formulation=*,precision=*") + R"(, "time_steps": [0.5])", accepted},
        {R"("kind": "fastest", "backends": ["auto:formulation=position"],
            "scenes": [{"scene": "box", "rewind": false}],
            "targets": [{"scene": "box", "formulation": "position", "speed_ratio": 2, "over": "gl_*"}])",
         accepted},
        {target + R"("seconds_per_step": 1, "fraction_of_limit": 0.5}])", {"targets[0]"}},
        {target + R"("backends": "*"}])", {"targets[0]"}},
        {target + R"("speed_ratio": 2}])", {"targets[0]"}},
        {target + R"("seconds_per_step": 0}])", {"targets[0]"}},
        {target + R"("seconds_per_step": 1, "over": "gl_*"}])", {"targets[0]"}},
        {R"("kind": "fastest", )" + of_box +
             R"(, "targets": [{"scene": "bxo", "formulation": "position", "seconds_per_step": 1}])",
         {"targets[0].scene", "bxo", "one of box"}},
        // No file can have such a name.
        {any + R"("scenes": [{"scene": ")" + std::string(300, 'a') + R"("}])", accepted},
        {R"("kind": "haptic", "rates": [1000, 1000.0001], )" + of_box, {"rates[1]", "1000.0001", "differs"}},
        {R"("kind": "haptic", "rates": [1000, 2000], )" + of_box, accepted},
        {R"("kind": "stress", )" + of_box, {"suites"}},
        {R"("kind": "stress", "backends": ["*"], "suites": [{"lengths": "long"}])",
         {"suites[0].lengths", "brief"}},
        {R"("kind": "stress", "backends": ["*"], "suites": [{"lengths": "brief"}])", accepted},
    };
    for (const auto& [keys, words] : cases) {
        const std::string file = write("{" + keys + "}"), said = refusal([&] { (void)load_study(file); });
        EXPECT_EQ(said == "accepted", words == accepted) << keys << ": " << said;
        for (const std::string& word : words) EXPECT_THAT(said, HasSubstr(word)) << keys;
    }
}

/// Parameters: the call in which the device is lost, and the number of that call.
class LostDevice : public StudyFile, public ::testing::WithParamInterface<std::pair<const char*, int>> {
protected:
    std::filesystem::path out_ = folder_.path() / "out.json";
    void TearDown() override { device = {}; }
};

TEST_F(StudyFile, StartsSeveralAtOnceWhereItSaysNothingOfTheirStart) {
    device = {};
    StudyOptions options;
    options.side_by_side = 3;
    const nlohmann::json result =
        run(R"({"backends": ["together_*", "test_unavailable", "test_unsupported", "test_sound"],
        "start_times": false, "scenes": [{"scene": "box@3"}], "repetitions": 1, "steps": 2})",
            options);
    device = {};
    EXPECT_EQ(result.at("failed").size(), 0u) << result.at("failed");
    EXPECT_EQ(result.at("skipped").size(), 2u);
    std::vector<std::string> timed;
    for (const auto& row : result.at("benchmarks")) {
        if (row.at("run_type") == "iteration") timed.push_back(row.at("backend"));
        EXPECT_FALSE(row.contains("construct_seconds"));
        EXPECT_TRUE(row.at("limit_seconds").is_number());
    }
    EXPECT_THAT(timed, ElementsAre("together_one", "together_three", "together_two", "test_sound"));
}

// Processes on the card that are not timed count as strangers.
TEST_F(StudyFile, EndsTheProcessesOfRefusedCasesBeforeTimes) {
    const nlohmann::json result = run(R"({"backends": ["alone", "test_unsupported"], "start_times": false,
        "scenes": [{"scene": "box@3"}], "repetitions": 1, "steps": 2})");
    EXPECT_EQ(result.at("failed").size(), 0u) << result.at("failed");
    EXPECT_EQ(result.at("skipped").size(), 1u);
    EXPECT_EQ(result.at("verification").size(), 1u);
}

// Reading and judging a state takes all cores, and for a large scene gigabytes of memory. A backend that has
// a fingerprint of its state is asked for that instead.
TEST_F(StudyFile, ReadsNoStateBeforeTheLastBatchOfAll) {
    const std::string study =
        write(R"({"backends": ["losing_*"], "scenes": [{"scene": "box@3"}], "repetitions": 4, "steps": 2})");
    device = {};
    std::ostringstream table;
    EXPECT_EQ(run_and_print_study(study, {}, table), 0);
    EXPECT_EQ(device.downloads, 2);
    EXPECT_EQ(device.steps_after_one, 0);
    device = {};
}

// Two cases, each of which warms up (upload, step, synchronize), is timed four times (upload,
// synchronize, step, synchronize) and read once. Before the device is lost in the second scene, three batches
// are timed there, so that a case has repetitions of either kind and none has finished.
INSTANTIATE_TEST_SUITE_P(, LostDevice,
                         ::testing::Values(std::pair{"upload", 2 * (1 + 4) + 2 * 1 + 3 + 1},
                                           std::pair{"step", 2 * (1 + 4) + 2 * 1 + 3 + 1},
                                           std::pair{"synchronize", 2 * (1 + 4 * 2) + 2 * 1 + 3 * 2 + 1},
                                           std::pair{"download", 2 * 1 + 1}),
                         [](const auto& tested) { return tested.param.first; });

TEST_P(LostDevice, KeepsWhatWasFinishedAndNamesTheRest) {
    const std::string study =
        write(R"({"backends": ["losing_*", "test_sound"], "start_times": false, "repetitions": 4, "steps": 2,
              "scenes": [{"scene": "box@3"}, {"scene": "box@4"}, {"scene": "box@5"}]})");
    const auto [call, number] = GetParam();
    device = {{}, number, false};
    std::string(call).copy(device.lost_in.data(), device.lost_in.size() - 1);
    StudyOptions options;
    options.out = out_;
    std::ostringstream table;
    EXPECT_EQ(run_and_print_study(study, options, table), 1);

    const auto result = nlohmann::json::parse(std::ifstream(out_));
    const auto names = [&](const char* list) {
        std::set<std::string> found;
        for (const auto& row : result.at(list)) {
            found.insert(std::string(row.at("scene")) + "/" + std::string(row.at("backend")));
        }
        return found;
    };
    EXPECT_THAT(names("benchmarks"), ElementsAre("box@3/losing_one", "box@3/losing_two", "box@3/test_sound",
                                                 "box@4/test_sound", "box@5/test_sound"));
    EXPECT_THAT(names("failed"),
                ElementsAre("box@4/losing_one", "box@4/losing_two", "box@5/losing_one", "box@5/losing_two"));
    EXPECT_EQ(result.at("failed").size(), 4u);
    EXPECT_TRUE(result.at("skipped").empty());
    for (const auto& row : result.at("failed"))
        EXPECT_THAT(std::string(row.at("reason")), HasSubstr("device lost"));
    EXPECT_THAT(table.str(), AllOf(HasSubstr("failed: device lost, seen in"), HasSubstr("losing_two")));
}

TEST(Study, WorkIsThatOfAStepAfterTheBatch) {
    Study study = study_of({"cpu_parallel:rest=skip", "cpu_parallel:rest=step"});
    study.repetitions = 1;
    study.scenes = {{"poke@32", 4, {}}};
    const nlohmann::json result = run_study(study, {});
    ASSERT_EQ(result.at("verification").size(), 2u);
    // Right after the upload it would be all of them.
    const auto& work = result.at("verification")[0].at("work");
    EXPECT_GT(work.at("tiles_stepped"), 0);
    EXPECT_LT(work.at("tiles_stepped"), work.at("tiles"));
    EXPECT_FALSE(result.at("verification")[1].contains("work"));
    // The limit of a full step would be wrong for a step of a part.
    int skipping = 0;
    for (const auto& row : result.at("benchmarks")) {
        const bool skips = std::string(row.at("tuning")).find("rest=skip") != std::string::npos;
        skipping += skips ? 1 : 0;
        for (const char* field : {"limit_seconds", "limited_by", "fraction_of_limit", "step_footprint_bytes"})
            EXPECT_EQ(row.at(field).is_null(), skips) << row.at("name") << " " << field;
    }
    EXPECT_EQ(skipping, 1);
}

TEST(BuiltinStudies, AllLoad) {
    std::vector<std::string> names;
    for (const auto& study : builtin_studies()) names.push_back(study.name);
    EXPECT_THAT(names, ::testing::IsSupersetOf({"default", "fastest", "figure7", "figure8", "pareto", "skips",
                                                "smoke", "table1", "tuning"}));
}

TEST(AWorker, RefusesATimeoutThatIsNoneAndTakesOneOfAges) {
    Workers workers;
    for (const double seconds : {std::nan(""), 0.0, -1.0})
        EXPECT_THROW(Worker(workers, {}, std::chrono::duration<double>(seconds)), std::invalid_argument);
    for (const double seconds : {1e10, std::numeric_limits<double>::infinity()}) {
        const auto spec = BackendSpec::parse("cpu_reference");
        EXPECT_EQ(introduce(spec, workers, std::chrono::duration<double>(seconds)).at("unsupported"), "");
    }
}

TEST(Signals, GoToOneProcessAndNeverToAll) {
    // Signal 0 only tests whether the process exists.
    EXPECT_TRUE(signal_process(getpid(), 0));
    for (const pid_t none : {0, -1, -getpid()})
        EXPECT_THROW(signal_process(none, 0), std::logic_error) << none;
}

TEST(Study, WithoutStartTimesAFaultTakesDownItsOwnRowOnly) {
    Study study = study_of({"test_*", "given_once"});
    study.settings = {{"start_times", false}};
    study.scenes = {{"box@5", 4, {}}, {"box@6", 4, {}}, {"box@5", 5, {"given_once", "test_sound"}}};
    StudyOptions options;
    options.together = 2;
    const nlohmann::json result = run_study(study, options);

    std::map<std::string, int> failed, verified;
    for (const auto& row : result.at("failed")) ++failed[row.at("backend")];
    for (const auto& row : result.at("verification")) ++verified[row.at("backend")];
    const std::map<std::string, int> all_failed{{"test_device_error_in_upload", 2},
                                                {"test_device_error_in_step", 2},
                                                {"test_wrong", 2},
                                                {"test_nan", 2}};
    EXPECT_EQ(failed, all_failed);
    EXPECT_EQ(verified.at("test_sound"), 3);
    EXPECT_EQ(verified.at("given_once"), 3);
}

TEST(Study, WithoutStartTimesHasSeveralBackendsOfAnApiInAProcess) {
    for (const bool start_times : {false, true}) {
        Study study = study_of({"sharing_one", "sharing_two"});
        study.settings = {{"start_times", start_times}};
        StudyOptions options;
        options.side_by_side = 1;
        device = {};
        const nlohmann::json result = run_study(study, options);
        EXPECT_EQ(result.at("verification").size(), 2u);
        EXPECT_EQ(device.changes_of_process == 1, !start_times) << device.changes_of_process;
    }
    device = {};
}

// Catches a case that is timed, or waited for, twice although nobody was beside it.
TEST(Study, MeasuresNothingAgainThatWasAlone) {
    Study study = study_of({"sharing_ends", "sharing_one"});
    study.settings = {{"start_times", false}};
    StudyOptions options;
    options.side_by_side = 2;
    ::testing::internal::CaptureStderr();
    const nlohmann::json result = run_study(study, options);
    EXPECT_EQ(::testing::internal::GetCapturedStderr().find("again"), std::string::npos);
    ASSERT_EQ(result.at("failed").size(), 1u);
    EXPECT_EQ(result.at("failed")[0].at("backend"), "sharing_ends");
    EXPECT_EQ(result.at("verification").size(), 1u);
}

TEST(Study, ARowSaysThatItsProcessServedOtherCases) {
    for (const bool start_times : {false, true}) {
        Study study = study_of({"sharing_one", "sharing_two", "test_sound"});
        study.settings = {{"start_times", start_times}};
        StudyOptions options;
        options.side_by_side = 1;
        const nlohmann::json result = run_study(study, options);
        EXPECT_THAT(values_of(result.at("benchmarks"), "backend"),
                    ElementsAre("sharing_one", "sharing_two", "test_sound"));
        for (const auto& row : result.at("benchmarks"))
            EXPECT_EQ(row.value("shared_process", false), !start_times && row.at("backend") != "test_sound")
                << row;
    }
}

// Catches a fault that costs other backends of the same process their rows, or counts against them.
TEST(Study, MeasuresAgainAloneWhatFailedBesideOthers) {
    for (const std::string harmful : {"sharing_ends", "sharing_spoils"}) {
        Study study = study_of({"sharing_one", harmful, "sharing_two"});
        study.settings = {{"start_times", false}};
        StudyOptions options;
        options.side_by_side = 1;
        ::testing::internal::CaptureStderr();
        const nlohmann::json result = run_study(study, options);
        const std::string said = ::testing::internal::GetCapturedStderr();
        std::set<std::string> failed, passed;
        for (const auto& row : result.at("failed")) failed.insert(row.at("backend"));
        for (const auto& row : result.at("verification")) {
            EXPECT_TRUE(row.at("passed").get<bool>()) << row;
            passed.insert(row.at("backend"));
        }
        EXPECT_EQ(result.at("verification").size(), passed.size());
        if (harmful == "sharing_ends") {
            EXPECT_THAT(failed, ElementsAre(harmful));
            EXPECT_THAT(passed, ElementsAre("sharing_one", "sharing_two"));
        } else {
            EXPECT_THAT(failed, ElementsAre());
            EXPECT_THAT(passed, ElementsAre("sharing_one", harmful, "sharing_two"));
        }
        EXPECT_THAT(said, HasSubstr("sharing_one/position/float64 failed beside other backends"));
        EXPECT_THAT(said, HasSubstr("measured again alone"));
    }
}

TEST(APareto, MeasuresAgainAloneWhatFailedBesideOthers) {
    Study study = study_of({"sharing_one", "sharing_ends"});
    study.kind = "pareto";
    study.settings = {{"time_steps", {0.5}}};
    StudyOptions options;
    options.side_by_side = 1;
    const nlohmann::json result = run_study(study, options);
    ASSERT_EQ(result.at("failed").size(), 1u) << result.at("failed");
    EXPECT_EQ(result.at("failed")[0].at("backend"), "sharing_ends");
    ASSERT_EQ(result.at("pareto").size(), 1u);
    EXPECT_EQ(result.at("pareto")[0].at("backend"), "sharing_one");
}

/// While a study runs, threads of the program hold locks, one of which every thread takes sooner or later.
class AProgramWithThreads : public ::testing::Test {
protected:
    void SetUp() override {
        std::promise<void> locked;
        holder_ = std::thread([&] {
            const std::lock_guard lock(in_use);
            flockfile(log_file);
            locked.set_value();
            while (!ends_) std::this_thread::sleep_for(std::chrono::milliseconds(1));
            funlockfile(log_file);
        });
        locked.get_future().wait();
        busy_ = std::thread([this] {
            while (!ends_) {
                const std::vector<int> taken(1000);
                std::this_thread::yield();
            }
        });
    }
    void TearDown() override {
        ends_ = true;
        holder_.join();
        busy_.join();
    }

private:
    std::atomic<bool> ends_ = false;
    std::thread holder_, busy_;
};

TEST_F(AProgramWithThreads, RunsAStudy) {
    StudyOptions options;
    options.timeout = std::chrono::seconds(60);
    const nlohmann::json result = run_study(study_of({"with_locks", "cpu_parallel"}), options);
    EXPECT_EQ(result.at("failed"), nlohmann::json::array());
    EXPECT_EQ(row_of(result.at("verification"), "with_locks").at("passed"), true);
    EXPECT_EQ(row_of(result.at("verification"), "cpu_parallel").at("passed"), true);
}

TEST(AStudy, GoesOnWhereALauncherIsKilled) {
    Study study = study_of({"launcher_killed", "test_sound"});
    study.scenes.push_back({"box@4", 4, {"launcher_killed_early", "test_sound"}});
    const nlohmann::json result = run_study(study, {});
    std::map<std::string, std::string> reasons;
    for (const auto& row : result.at("failed"))
        reasons[std::string(row.at("scene")) + "/" + std::string(row.at("backend"))] = row.at("reason");
    const std::string lost =
        "was terminated because its launcher was killed by signal 9 (Killed), as the system does when "
        "memory runs out, while ";
    // A case that has a process already goes with its launcher; one that has none yet gets another launcher.
    EXPECT_THAT(reasons, ::testing::UnorderedElementsAre(
                             ::testing::Pair("box@5/launcher_killed", lost + "warming up"),
                             ::testing::Pair("box@5/test_sound", lost + "warming up"),
                             ::testing::Pair("box@4/launcher_killed_early",
                                             lost + "constructing launcher_killed_early")));
    ASSERT_EQ(result.at("verification").size(), 1u);
    EXPECT_EQ(result.at("verification")[0].at("scene"), "box@4");
}

// Catches a process that this program kills being said to have been killed for lack of memory.
TEST(AStudy, SaysThatAProcessHangsOnceItsConnectionIsClosed) {
    const nlohmann::json result = run_study(study_of({"closing"}), {});
    EXPECT_EQ(row_of(result.at("failed"), "closing").at("reason"),
              "closed its connection and did not end within 10 s while warming up");
}

std::size_t open_files() {
    const std::filesystem::directory_iterator files("/proc/self/fd");
    return std::size_t(std::distance(begin(files), end(files)));
}

TEST(AStudy, LeavesNoProcessAndNoFileOpen) {
    (void)run_study(study_of({"test_sound"}), {});  // opens what is opened once and kept
    const std::size_t before = open_files();
    (void)run_study(study_of({"test_*", "launcher_killed"}), {});
    EXPECT_EQ(open_files(), before);
    EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
    EXPECT_EQ(errno, ECHILD) << "a process, or what is left of one";
}

TEST(AWrittenFile, HasTheRightsThatItsUserGives) {
    const TemporaryFolder folder;
    const mode_t before = umask(027);
    write_atomically(folder.path() / "written", "text");
    umask(before);
    struct stat about {};
    ASSERT_EQ(stat((folder.path() / "written").c_str(), &about), 0);
    EXPECT_EQ(about.st_mode & 0777, 0640u);
}

// The name of the temporary file is longer than that of the file, by the ID of this process.
TEST(AWrittenFile, HasANameAsLongAsWasChecked) {
    const TemporaryFolder folder;
    int written = 0, refused = 0;
    for (std::size_t length = 230; length <= 255; ++length) {
        const std::filesystem::path path = folder.path() / (std::string(length - 5, 'x') + ".json");
        if (refusal([&] { check_writable(path, "--out", ".json"); }) == "accepted") {
            EXPECT_NO_THROW(write_atomically(path, "text")) << length;
            ++written;
        } else {
            EXPECT_THROW(write_atomically(path, "text"), std::system_error) << length;
            ++refused;
        }
    }
    EXPECT_GT(written, 0);
    EXPECT_GT(refused, 0);
}

TEST(AWrittenFile, ThatIsAFullDeviceLeavesNoFileOpen) {
    const std::size_t before = open_files();
    EXPECT_THROW(write_atomically("/dev/full", "text"), std::system_error);
    EXPECT_EQ(open_files(), before);
}

/// A copy of this test that serves as a worker.
class AWorkersProgram : public StudyFile {
protected:
    std::filesystem::path program_ = folder_.path() / "worker";
    void SetUp() override { std::filesystem::copy_file("/proc/self/exe", program_); }
    /// Makes it a worker that sends these messages, the first of which is its build, and ignores requests.
    void say(const std::vector<nlohmann::json>& messages) {
        const std::string words = (folder_.path() / "words").string();
        std::ofstream file(words, std::ios::binary);
        for (const nlohmann::json& message : messages) {
            const std::vector<std::uint8_t> said = nlohmann::json::to_cbor(message);
            const std::uint64_t size = said.size();
            file.write(reinterpret_cast<const char*>(&size), sizeof size)
                .write(reinterpret_cast<const char*>(said.data()), std::streamsize(size));
        }
        std::ofstream(program_) << "#!/bin/sh\ncat " + words + " >&3\nexec cat <&3 >/dev/null\n";
    }
    std::string refusal_of(const std::filesystem::path& program) {
        StudyOptions options;
        options.worker = program;
        return refusal(
            [&] { EXPECT_TRUE(run_study(study_of({"test_sound"}), options).rows("failed").empty()); });
    }
};

TEST(AProgramsOptions, ThatNothingCanBeMeasuredWithAreRefused) {
    using Options = StudyOptions&;
    const std::pair<void (*)(Options), const char*> cases[] = {
        {[](Options o) { o.together = 0; }, "run_study(): together: 0 is not accepted; expected 1 or more"},
        {[](Options o) { o.side_by_side = 0; },
         "run_study(): side_by_side: 0 is not accepted; expected 1 or more"},
        {[](Options o) { o.repetitions = 0; }, "repetitions: 0 is"},
        {[](Options o) { o.ranks = -1; }, "ranks: -1 is"},
        {[](Options o) {
             o.devices = {0, -2};
         },
         "devices: -2 is"},
        {[](Options o) { o.timeout = {}; }, "timeout: 0 s is"}};
    for (const auto& [change, words] : cases) {
        StudyOptions options;
        change(options);
        EXPECT_THAT(refusal([&] { (void)run_study(study_of({"test_sound"}), options); }), HasSubstr(words));
    }
}

TEST_F(AWorkersProgram, MayBeAnotherFileOfTheSameBuild) { EXPECT_EQ(refusal_of(program_), "accepted"); }

TEST_F(AWorkersProgram, OfAnotherBuildIsRefused) {
    nlohmann::json build = build_of_workers();
    const std::string commit = build.at("commit");
    build["commit"] = "another one";
    say({build});
    EXPECT_THAT(refusal_of(program_), AllOf(HasSubstr(program_.string()), HasSubstr("another one"),
                                            HasSubstr("the same build"), HasSubstr(commit)));
}

// Otherwise the socket of its worker would be taken for the answer to the next request.
TEST_F(AWorkersProgram, WhoseAnswerComesHalfIsLost) {
    say({build_of_workers(), {{"ready", true}}, {{"process", 1}}});
    Launcher launcher(program_, nullptr, std::chrono::milliseconds(200));
    for (int n = 0; n < 2; ++n) {
        EXPECT_THAT([&] { (void)launcher.start(); },
                    ::testing::ThrowsMessage<std::runtime_error>("the launcher did not answer within 0.2 s"));
        EXPECT_TRUE(launcher.is_lost());
    }
}

TEST_F(AWorkersProgram, ThatKnowsNothingOfWorkersIsRefused) {
    EXPECT_THAT(refusal_of("/bin/true"), AllOf(HasSubstr("/bin/true"), HasSubstr("worker_main")));
    EXPECT_THAT(refusal_of(folder_.path() / "none"), AllOf(HasSubstr("none"), HasSubstr("No such file")));
}

TEST(AScene, ThatAnotherProcessHasNoMemoryForIsRefusedInItsWords) {
    const Scene scene = load_scene("incision");
    int ends[2];
    ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
    send_message(ends[1], {{"error", "no memory"}});
    shutdown(ends[1], SHUT_WR);
    std::thread receiver([&] {
        std::array<char, 65536> some;
        while (recv(ends[1], some.data(), some.size(), 0) > 0) {
        }
    });
    EXPECT_THAT([&] { send_scene(ends[0], &scene, 0); },
                ThrowsMessage<std::runtime_error>(HasSubstr("no memory")));
    close(ends[0]);
    receiver.join();
    close(ends[1]);
}

TEST(AScene, ArrivesInAnotherProcessAsItIs) {
    Scene sent = load_scene("incision");
    sent.source = "somewhere";
    sent.problem.gravity.y = std::numeric_limits<double>::infinity();
    take_hold(sent.problem, {.particles = {1, 5}, .held = {{0, 0, 1}, {0, 2, 0}}, .stiffness = 0.5});
    const std::string still = fingerprint_of(sent);
    sent.tool_motion = {.every = 3, .time = {0, 1}, .displacement = {{0, 0, 0}, {1, 2, 3}}};
    const std::string whole = fingerprint_of(sent);
    EXPECT_NE(whole, still);
    sent.problem.ghosts = {2, 3};
    EXPECT_NE(fingerprint_of(sent), whole);
    const auto arrived = [](const Scene* scene, pid_t receiver = getpid()) {
        int ends[2];
        if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0) throw std::runtime_error("no sockets");
        std::thread sender([&] { send_scene(ends[0], scene, receiver); });
        std::optional<Scene> received = receive_scene(ends[1]);
        sender.join();
        for (const int end : ends) close(end);
        return received;
    };
    EXPECT_FALSE(arrived(nullptr));
    // The scene is so large that its memory is written directly if that is allowed; with process id 0, which
    // no process has, it is not.
    ASSERT_GE(sent.problem.rest_position.size() * sizeof(glm::dvec3), std::size_t(1) << 22);
    EXPECT_EQ(fingerprint_of(arrived(&sent, 0).value()), fingerprint_of(sent));
    const std::optional<Scene> received = arrived(&sent);
    ASSERT_TRUE(received);
    EXPECT_EQ(received->name, sent.name);
    EXPECT_EQ(received->source, sent.source);
    EXPECT_EQ(received->description, sent.description);
    EXPECT_EQ(received->stable_time_step, sent.stable_time_step);
    ASSERT_FALSE(sent.edits.empty());
    EXPECT_EQ(received->edits.size(), sent.edits.size());
    EXPECT_EQ(changed_springs(received->problem, received->edits.back().edit.added),
              changed_springs(sent.problem, sent.edits.back().edit.added));
    EXPECT_EQ(fingerprint_of(*received), fingerprint_of(sent));
}

TEST(AStudy, LeavesTheSignalsOfItsProcessAsTheyWere) {
    const TemporaryFolder folder;
    StudyOptions options;
    options.out = folder.path() / "signals.json";
    (void)run_study(study_of({"test_sound"}), options);
    for (const int signal : {SIGXFSZ, SIGINT, SIGTERM, SIGPIPE}) {
        struct sigaction now {};
        ASSERT_EQ(sigaction(signal, nullptr, &now), 0);
        EXPECT_EQ(now.sa_handler, SIG_DFL) << signal;
    }
}

TEST(AJournal, ThatCannotBeReadIsNoEmptyOne) {
    // Its first bytes are unmapped: reading them is an input/output error.
    EXPECT_THAT(
        [] {
            Journal("/proc/self/mem", {{"scenes", {"box"}}}, true);
        },
        ThrowsMessage<Unwritten>(HasSubstr("cannot read /proc/self/mem: ")));
}

TEST(AJournal, AddsUpTheTimeOfItsSessions) {
    const TemporaryFolder folder;
    const std::filesystem::path file = folder.path() / "journal";
    double least = 0;
    for (int session = 0; session < 3; ++session) {
        Journal journal(file, {{"scenes", {"box"}}}, true);
        EXPECT_GE(journal.elapsed_seconds(), least);
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        journal.keep(std::to_string(session), 1);
        least += 0.02;
    }
}

TEST(AJournal, OfASceneWhoseNameIsNotUtf8IsGoneOnWith) {
    const nlohmann::json study = {{"scenes", {"b\xf6x.json"}}};
    const TemporaryFolder folder;
    Journal(folder.path() / "journal", study, false);
    EXPECT_NO_THROW(Journal(folder.path() / "journal", study, true));
}

TEST(AJournal, SaysWhereTwoStudiesDifferInWords) {
    const auto difference = [](const char* there, const char* here) {
        const Difference first = first_difference(nlohmann::json::parse(there), nlohmann::json::parse(here));
        return first.where + ": " + first.there + " | " + first.here;
    };
    EXPECT_EQ(difference("3", "4"), ": 3 | 4");
    EXPECT_EQ(difference(R"(["a", "b"])", R"(["a"])"), ": a, b | a");
    EXPECT_EQ(difference("[]", R"(["a"])"), ": none | a");
    EXPECT_EQ(difference(R"([["box", 4], ["heart", 5]])", R"([["box", 4], ["heart", 6]])"), "2 2: 5 | 6");
    EXPECT_EQ(difference(R"({"device": "A", "uuid": ""})", R"({"device": "B", "uuid": ""})"),
              "device: A | B");
    EXPECT_EQ(difference("{}", R"({"own.json": "12"})"), "own.json: nothing | 12");
    EXPECT_EQ(difference(R"({"own.json": "12"})", "{}"), "own.json: 12 | nothing");
}

}  // namespace
}  // namespace voxspring::testing
