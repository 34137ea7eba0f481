// The study haptic: its rows, with the body drawn meanwhile and without, and what happens if a backend fails.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/time.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <ctime>
#include <glm/vec4.hpp>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "backends/cpu/cpu_backend.h"
#include "backends/gl/context.h"
#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/drawing/live_drawing.h"
#include "harness/study/study.h"
#include "harness/verification/verify.h"
#include "tests/required.h"
#include "tests/volume_files.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

// --- A backend that fails once it is drawn ---------------------------------------------------------------

/// A cpu_reference whose state cannot be downloaded often: beside drawing, only the two runs that are judged
/// download it.
class Withheld : public WrappedToolBackend {
public:
    State download() override {
        if (++downloads_ > 2) throw DeviceError("the device was lost");
        return WrappedToolBackend::download();
    }
    std::string state_fingerprint() override { return fingerprint_of(inner().download()); }

private:
    int downloads_ = 0;
};

/// A Withheld backend that offers a host feed of some displacements.
class Brought final : public Withheld, public FeedFacet {
public:
    FeedFacet* feeds() override { return this; }
    std::unique_ptr<HostFeed> host_feed(const std::vector<std::uint32_t>& particles) override {
        return std::make_unique<Some>(inner(), particles);
    }

private:
    class Some final : public HostFeed {
    public:
        Some(Backend& backend, const std::vector<std::uint32_t>& particles)
            : backend_(backend), particles_(particles), displacements_(particles.size()) {}
        std::span<const glm::vec4> read() override {
            const State state = backend_.download();
            for (std::size_t n = 0; n < particles_.size(); ++n)
                displacements_[n] = glm::vec4(glm::vec3(state.displacement[particles_[n]]), 0);
            return displacements_;
        }

    private:
        Backend& backend_;
        const std::vector<std::uint32_t> particles_;
        std::vector<glm::vec4> displacements_;
    };
};

/// A backend of which one step takes a quarter of a second: in the first playing, after 80 steps that are
/// judged.
class Stalled final : public Withheld {
public:
    static constexpr double pause = 0.25;
    void step(int count) override {
        Withheld::step(count);
        if (++steps_ == 200) std::this_thread::sleep_for(std::chrono::duration<double>(pause));
    }

private:
    int steps_ = 0;
};

/// A Withheld backend in a process that a signal stops for two milliseconds, some fifty times a second.
class Interrupted final : public Withheld {
public:
    Interrupted() {
        struct sigaction stop {};
        stop.sa_handler = [](int) {
            const timespec pause{.tv_sec = 0, .tv_nsec = 2'000'000};
            nanosleep(&pause, nullptr);
        };
        stop.sa_flags = SA_RESTART;
        sigaction(SIGALRM, &stop, nullptr);
        // No multiple of a tick's 200 us: otherwise all pauses could meet the step at the begin of a tick.
        const itimerval often{.it_interval = {0, 17'770}, .it_value = {0, 17'770}};
        setitimer(ITIMER_REAL, &often, nullptr);
    }
};

/// A backend that loses moves of the tool in one of its playings: not in the runs that are judged, which make
/// 80 moves.
class Loses final : public Withheld {
public:
    void move_tool(const glm::dvec3& displacement) override {
        if (++moves_ % 100 != 0) Withheld::move_tool(displacement);
    }

private:
    int moves_ = 0;
};

/// A Withheld backend whose force is right but for one of those that are judged, which is no number.
class ForceIsNoNumber final : public Withheld {
public:
    glm::dvec3 tool_force() override {
        const glm::dvec3 force = Withheld::tool_force();
        return ++forces_ == 5 ? glm::dvec3(force.x, std::numeric_limits<double>::quiet_NaN(), force.z)
                              : force;
    }

private:
    int forces_ = 0;
};

/// A Withheld backend whose force has a part that no spring gives it.
class ForceOfNothing final : public Withheld {
public:
    glm::dvec3 tool_force() override { return Withheld::tool_force() + glm::dvec3(1e-3, 0, 0); }
};

const std::vector<Registered> wrong_ones = register_wrong_backends();
const Registered force_is_no_number = registered_as<ForceIsNoNumber>("force_is_no_number");
const Registered force_of_nothing = registered_as<ForceOfNothing>("force_of_nothing");
const Registered loses = registered_as<Loses>("loses");
const Registered withheld = registered_as<Withheld>("withheld");
const Registered brought = registered_as<Brought>("brought");
const Registered stalled = registered_as<Stalled>("stalled");
const Registered stopped = registered_as<Interrupted>("interrupted");

// --- Tests -----------------------------------------------------------------------------------------------

class Haptic : public ::testing::Test {
protected:
    Study study(const std::vector<std::string>& backends, std::vector<int> rates) const {
        folder_.write("hand.csv", "time,x,y,z\n0,0,0,0\n1,0.2,0,0\n2,0.2,0.1,0\n");
        const std::string scene =
            folder_.write("held.json", R"({"dataset": {"type": "box", "dims": [4, 4, 4]},
            "pinned": {"side": "x-"}, "tool": {"side": "x+", "stiffness": 0.5, "motion": "hand.csv"}})");
        Study study;
        study.name = "test";
        study.kind = "haptic";
        study.settings = {{"rates", std::move(rates)}, {"motion_seconds", seconds}};
        study.backends = backends;
        study.scenes = {{scene, 40, {}}};
        return study;
    }
    static constexpr double seconds = 0.25;
    const TemporaryFolder folder_;
};

void expect_consistent_latencies(const nlohmann::json& row) {
    EXPECT_GT(row.at("median_seconds"), 0.0);
    EXPECT_LE(row.at("median_seconds"), row.at("worst_seconds"));
    const int ticks = row.at("ticks").get<int>() + row.at("missed").get<int>();
    EXPECT_EQ(row.at("p99_seconds").is_null(), ticks < 1000);
    EXPECT_EQ(row.at("p999_seconds").is_null(), ticks < 10000);
    const auto bins = row.at("histogram").get<Histogram>();
    std::int64_t counted = 0;
    // Each percentile lies in the bin of its rank.
    for (const auto& [begin, count] : bins) {
        EXPECT_GT(count, 0);
        const double end = begin * std::pow(10, 1.0 / bins_per_decade) * (1 + 1e-12);
        for (const auto& [key, fraction] :
             {std::pair("median_seconds", 0.5), {"p99_seconds", 0.99}, {"p999_seconds", 0.999}}) {
            const auto rank = std::int64_t(std::ceil(fraction * ticks));
            if (row.at(key).is_null() || rank <= counted || rank > counted + count) continue;
            EXPECT_GE(row.at(key), begin * (1 - 1e-12));
            EXPECT_LT(row.at(key), end);
        }
        counted += count;
    }
    EXPECT_EQ(counted, ticks) << "missed ticks have a time as well";
    EXPECT_TRUE(std::is_sorted(bins.begin(), bins.end()));
}

/// Expects the thread's pauses to lie within the time that it waited.
void expect_consistent_pauses(const nlohmann::json& row) {
    double paused = 0;
    for (const auto& [begin, count] : row.at("pauses").get<Histogram>()) {
        EXPECT_GT(begin, 0.89e-6);  // the bin that a microsecond lies in
        paused += begin * double(count);
    }
    EXPECT_LE(paused, row.at("waited_seconds"));
    EXPECT_GT(row.at("waited_seconds"), 0.0);
}

TEST_F(Haptic, PlaysTheMotionAndReadsTheForce) {
    const nlohmann::json result = run_study(study({"cpu_reference", "cpu_parallel"}, {500}), {});
    ASSERT_GE(result.at("haptic").size(), 4u) << result.at("failed");
    for (const auto& row : result.at("haptic")) {
        SCOPED_TRACE(row.dump());
        expect_consistent_latencies(row);
        expect_consistent_pauses(row);
        EXPECT_EQ(row.at("ticks").get<int>() + row.at("missed").get<int>(),
                  int(std::lround(seconds * row.at("hertz").get<double>())));
        EXPECT_GT(row.at("steps_that_fit"), 0);
        // cpu_reference is the reference itself, apart from the formulation; the other backend rounds to
        // float32.
        EXPECT_LT(row.at("force_error"), row.at("precision") == "float64" ? 1e-12 : 1e-3);
        EXPECT_EQ(row.at("force_error") == 0.0, row.at("backend") == "cpu_reference");
    }
    Study without = study({"cpu_reference"}, {500});
    without.scenes = {{"box@4", 20, {}}};
    EXPECT_THROW((void)run_study(without, {}), BadInput);
}

/// The rows of a result, by backend, and whether they were edited.
std::map<std::string, std::vector<bool>> rows_of(const nlohmann::json& result) {
    std::map<std::string, std::vector<bool>> rows;
    for (const auto& row : result.at("haptic")) {
        if (!row.at("drawn")) rows[row.at("backend")].push_back(row.at("edited"));
    }
    return rows;
}

// A backend in float32 has to pass, of which no force is wrong and every spring matters. None with a fault
// may have a row.
TEST_F(Haptic, HasNoRowOfAWrongBackend) {
    std::vector<std::string> names;
    for (const auto& [name, fault] : faults()) names.push_back(name);
    Study judged = study(names, {500});
    const std::string scene = folder_.write("heavy.json", R"({"dataset": {"type": "box", "dims": [6, 6, 6]},
            "gravity": [8e-4, 0, -2e-3], "pinned": {"side": "x-"}, "time_step": {"fraction_of_stable": 0.5},
            "tool": {"side": "x+", "stiffness": 0.5, "motion": "hand.csv"}})");
    judged.scenes = {{scene, 60, {}}};
    const nlohmann::json result = run_study(judged, {});
    const std::map<std::string, std::vector<bool>> expected = {{"wrong_in_nothing", {false, true}}};
    EXPECT_EQ(rows_of(result), expected) << result.at("failed");
    EXPECT_EQ(result.at("failed").size(), faults().size() - 1) << result.at("failed");
    for (const auto& failed : result.at("failed"))
        EXPECT_THAT(failed.at("reason").get<std::string>(), ::testing::HasSubstr("not agree with float64"));
    for (const auto& row : result.at("haptic")) {
        SCOPED_TRACE(row.dump());
        EXPECT_EQ(row.at("passed"), true);
        EXPECT_GT(row.at("strained_share"), 0.5);
        EXPECT_LT(row.at("error_rms"), row.at("tolerance_rms"));
        EXPECT_LT(row.at("tolerance_rms"), 0.1 * row.at("motion_rms").get<double>());
        EXPECT_LT(row.at("force_error"), row.at("force_tolerance"));
    }
}

// Catches a largest difference that drops what is no number.
TEST_F(Haptic, HasNoRowOfAForceThatIsNoNumber) {
    const nlohmann::json result = run_study(study({"force_is_no_number"}, {500}), {});
    EXPECT_EQ(result.at("haptic"), nlohmann::json::array());
    ASSERT_EQ(result.at("failed").size(), 1u);
    EXPECT_THAT(result.at("failed")[0].at("reason").get<std::string>(),
                ::testing::HasSubstr("force does not agree with float64: it is not finite"));
}

// The tool and the body rest while steps are judged. Catches a bound that is relative to a force of zero.
TEST_F(Haptic, HasNoRowOfAForceWhereThereIsNone) {
    Study resting = study({"force_of_nothing", "withheld"}, {500});
    folder_.write("hand.csv", "time,x,y,z\n0,0,0,0\n1000,0,0,0\n2000,0.2,0,0\n");
    const nlohmann::json result = run_study(resting, {});
    const std::map<std::string, std::vector<bool>> expected = {{"withheld", {false, true}}};
    EXPECT_EQ(rows_of(result), expected) << result.at("failed");
    for (const auto& row : result.at("haptic")) EXPECT_TRUE(row.at("force_error").is_null()) << row;
    ASSERT_FALSE(result.at("failed").empty());
    EXPECT_THAT(result.at("failed")[0].at("reason").get<std::string>(),
                ::testing::HasSubstr("force does not agree with float64: 1.0e-03, where there is none"));
}

TEST_F(Haptic, HasNoRowOfAMotionThatLeavesAnotherState) {
    const nlohmann::json result = run_study(study({"loses"}, {500}), {});
    EXPECT_EQ(result.at("haptic"), nlohmann::json::array());
    ASSERT_EQ(result.at("failed").size(), 1U);
    EXPECT_THAT(result.at("failed")[0].at("reason").get<std::string>(),
                ::testing::HasSubstr("another state than the same ticks"));
}

// Catches times from the beginning of ticks that were played, by which a stall of a fifth of the motion is
// one slow tick of a thousand.
TEST_F(Haptic, CountsTheTicksThatALongOneDelays) {
    Study of_a_second = study({"stalled"}, {1000});
    of_a_second.settings["motion_seconds"] = 1;
    const nlohmann::json result = run_study(of_a_second, {});
    ASSERT_FALSE(result.at("haptic").empty()) << result.at("failed");
    const nlohmann::json& row = result.at("haptic")[0];
    ASSERT_GE(row.at("worst_seconds"), Stalled::pause) << "the stall is in another playing";
    EXPECT_GE(row.at("missed"), 240);
    // A hundredth of the ticks are due within the first 10 ms of the stall.
    EXPECT_GE(row.at("p99_seconds"), Stalled::pause - 0.015) << row;
}

TEST_F(Haptic, CountsThePausesOfItsThread) {
    // The interval is so short that the thread reads the clock all the time between ticks.
    const nlohmann::json result = run_study(study({"interrupted"}, {5000}), {});
    ASSERT_FALSE(result.at("haptic").empty()) << result.at("failed");
    const nlohmann::json& row = result.at("haptic")[0];
    std::int64_t long_pauses = 0;
    for (const auto& [begin, count] : row.at("pauses").get<Histogram>()) {
        if (begin > 1.5e-3) long_pauses += count;
    }
    // Some of the dozen pauses fall into a tick.
    EXPECT_GE(long_pauses, 3) << row;
}

/// Skips its tests where drawing is impossible.
class DrawnHaptic : public Haptic {
protected:
    void SetUp() override {
        skip_without("gl", [] { const gl::Context context; });
    }
};

TEST_F(DrawnHaptic, DrawsTheBodyMeanwhile) {
    const nlohmann::json result = run_study(study({"cpu_parallel", "gl_compute_implicit"}, {500, 1000}), {});
    std::map<std::string, std::vector<std::string>> played;
    for (const auto& row : result.at("haptic")) {
        SCOPED_TRACE(row.dump());
        expect_consistent_latencies(row);
        const std::string backend = row.at("backend");
        played[backend].push_back(fixed_text(row.at("hertz"), 0) + (row.at("edited") ? " edited" : "") +
                                  (row.at("drawn") ? " drawn" : ""));
        if (row.at("drawn")) {
            EXPECT_GT(row.at("pictures_per_second"), 0.0);
            EXPECT_LE(row.at("pictures_per_second"), 1.5 * LiveDrawing::pictures_per_second);
            EXPECT_EQ(row.at("displacements_by"), backend == "cpu_parallel" ? "download" : "feed");
            EXPECT_NE(row.at("renderer"), "");
        } else {
            for (const char* key : {"pictures_per_second", "displacements_by", "renderer"})
                EXPECT_TRUE(row.at(key).is_null()) << key;
        }
    }
    const std::vector<std::string> expected = {"500",       "500 edited",       "1000",      "1000 edited",
                                               "500 drawn", "500 edited drawn", "1000 drawn"};
    EXPECT_EQ(played["cpu_parallel"], expected) << result.at("failed") << result.at("skipped");
    EXPECT_EQ(played["gl_compute_implicit"], expected) << result.at("failed") << result.at("skipped");
}

TEST_F(DrawnHaptic, DrawsWhatABackendBringsInsteadOfItsWholeState) {
    const nlohmann::json result = run_study(study({"brought"}, {500}), {});
    EXPECT_THAT(result.at("failed"), ::testing::IsEmpty());
    int drawn = 0;
    for (const auto& row : result.at("haptic")) {
        if (!row.at("drawn")) continue;
        ++drawn;
        EXPECT_EQ(row.at("displacements_by"), "host_feed");
        EXPECT_GT(row.at("pictures_per_second"), 0.0);
    }
    EXPECT_EQ(drawn, 2);
}

TEST_F(DrawnHaptic, ABackendThatFailsWhileItIsDrawnKeepsItsOtherRows) {
    const nlohmann::json result = run_study(study({"withheld"}, {500}), {});
    ASSERT_EQ(result.at("haptic").size(), 2u);
    for (const auto& row : result.at("haptic")) EXPECT_EQ(row.at("drawn"), false);
    ASSERT_EQ(result.at("failed").size(), 1u);
    EXPECT_THAT(result.at("failed")[0].at("reason").get<std::string>(),
                ::testing::HasSubstr("the device was lost"));
}

}  // namespace
}  // namespace voxspring::testing
