// Untrustworthy times are marked, for each of the possible reasons; other times are not.
#include "harness/device/noise.h"

#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/device_choice.h"
#include "backends/registry.h"
#include "harness/base/clock.h"
#include "harness/device/card.h"
#include "harness/device/energy.h"
#include "harness/results/print.h"
#include "harness/study/study.h"
#include "tests/surroundings.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(Noise, IsInTheSpreadOfRepetitions) {
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.01, 1.02, 1.03, 1.04}}), IsEmpty());
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1, 1, 1, 9}}), IsEmpty()) << "the median stands";
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.1, 1.2, 1.3, 1.4}}),
                ElementsAre("the middle half of the repetitions spreads (over 17% of their median)"));
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 2, 3}}), IsEmpty()) << "too few to say";
    EXPECT_THAT(reasons_of_noise({}), IsEmpty()) << "nothing is known";
}

TEST(Noise, IsInRepetitionsOfTwoKinds) {
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.06, 1.001, 1.061, 1, 1.002, 1.06, 1, 1.001}}),
                ElementsAre("its repetitions form two groups (6% apart)"));
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.02, 1.001, 1.021, 1, 1.002, 1.02, 1, 1.001}}), IsEmpty())
        << "near enough to say the same";
    EXPECT_THAT(reasons_of_noise({.seconds = {1.04, 1.01, 1.07, 1, 1.08, 1.03, 1.06, 1.02, 1.05}}), IsEmpty())
        << "no gap";
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1, 1, 1, 1.06, 1, 1, 1, 1}}), IsEmpty()) << "one is no kind";
}

TEST(Noise, IsInRepetitionsThatDrift) {
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.01, 1.02, 1.03, 1.04, 1.05, 1.06, 1.07, 1.08}}),
                ElementsAre("its repetitions drift (6% from the first third to the last)"));
    EXPECT_THAT(reasons_of_noise({.seconds = {1.08, 1.07, 1.06, 1.05, 1.04, 1.03, 1.02, 1.01, 1}}),
                ElementsAre("its repetitions drift (-6% from the first third to the last)"));
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.005, 1.01, 1.015, 1.02, 1.025, 1.03, 1.035, 1.04}}),
                IsEmpty())
        << "by less than 5%";
    EXPECT_THAT(reasons_of_noise({.seconds = {1, 1.05, 1.01, 1.08, 1.03, 1.0, 1.06, 1.07, 1.08}}), IsEmpty())
        << "the thirds differ by 6%, as they do by chance";
}

TEST(Noise, IsInClocksThatMoved) {
    EXPECT_THAT(reasons_of_noise({.spins = {1.0e-5, 1.05e-5}}), IsEmpty());
    EXPECT_THAT(reasons_of_noise({.spins = {1.0e-5, 1.2e-5, 1.1e-5}}),
                ElementsAre("the processor's clock moved (by 20%)"));
    EXPECT_THAT(reasons_of_noise({.card_mhz = {1980, 1905}}), IsEmpty());
    EXPECT_THAT(reasons_of_noise({.card_mhz = {1980, 1500, 1800}}),
                ElementsAre("the card's clock moved (between 1500 and 1980 MHz)"));
}

TEST(Noise, IsInOtherProcesses) {
    EXPECT_THAT(reasons_of_noise({.waits = {0, 0, 0.5}}), IsEmpty()) << "the median stands";
    EXPECT_THAT(reasons_of_noise({.waits = {0.3, 0.4, 0.5}}),
                ElementsAre("its threads waited for a processor (40% of the time)"));
    EXPECT_THAT(reasons_of_noise({.other_users = {0, 0}}), IsEmpty());
    EXPECT_THAT(reasons_of_noise({.other_users = {0, 2, 1}}),
                ElementsAre("other processes computed on the card (2)"));
}

TEST(Noise, IsNotInTheStudysOwnProcesses) {
    EXPECT_EQ(other_processes({}, {}), 0u);
    EXPECT_EQ(other_processes({11, 12}, {.all = {10, 11, 12}, .on_card = 2}), 0u);
    EXPECT_EQ(other_processes({11, 12, 99}, {.all = {10, 11, 12}, .on_card = 2}), 1u);
    EXPECT_EQ(other_processes({11, 99}, {.all = {10, 11, 12}, .on_card = 2}), 1u) << "12 is not listed";
    EXPECT_EQ(other_processes({7}, {}), 1u) << "a resumed study's cases have no process yet";
    // In a container the driver may show other process ids.
    EXPECT_EQ(other_processes({5011, 5012}, {.all = {11, 12}, .on_card = 2}), 0u);
    EXPECT_EQ(other_processes({5011, 5012, 5013}, {.all = {11, 12}, .on_card = 2}), 1u);
}

TEST(Noise, IsPrintedWithWhatItIsOf) {
    std::ostringstream out;
    const auto row = [](const std::string& backend, const std::vector<std::string>& noisy) {
        Row one{.identity = {.name = "box/" + backend + "/increment/float32", .scene = "box"}};
        one.noisy = noisy;
        return one;
    };
    print_noise({row("a", {"it rained (twice)"}), row("b", {}), row("c", {"it rained (once)"})}, out);
    EXPECT_EQ(out.str(),
              "~ 2 of 3 times not to be trusted, it rained: box: a increment float32 (twice), c increment "
              "float32 (once)\n");
    // The table marks the rows themselves: the summary stays one line, however many there are.
    out.str("");
    print_noise(std::vector<Row>(40, row("cuda_a", {"it rained (once)", "a card slept (twice)"})), out);
    EXPECT_EQ(out.str(),
              "~ 40 of 40 times not to be trusted, a card slept: box: 40 cuda_* backends\n"
              "~ 40 of 40 times not to be trusted, it rained: box: 40 cuda_* backends\n");
}

// Without its operations a spin is two readings of a clock, which take some 40 ns.
TEST(Noise, ASpinTakesTheTimeOfItsOperations) { EXPECT_GT(spin_seconds(), 2e-6); }

TEST(Noise, WaitingGrowsWhereThreadsHaveNoCore) {
    if (!waited_seconds()) GTEST_SKIP() << "this system does not tell";
    const double before = *waited_seconds();
    // With three threads per core each waits for two thirds of the time.
    std::atomic<bool> stop = false;
    std::vector<std::thread> threads;
    for (unsigned i = 0; i < 3 * std::thread::hardware_concurrency(); ++i)
        threads.emplace_back([&] {
            while (!stop) {
            }
        });
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    const double waited = *waited_seconds() - before;
    stop = true;
    for (std::thread& thread : threads) thread.join();
    EXPECT_GT(waited, 0.1);
}

/// A library that was loaded under this name is used for the name from then on, in the test and in its
/// workers.
void* const library = dlopen(FAKE_NVML, RTLD_NOW);

/// Whether this process has asked for a card's energy.
bool counts_energy() {
    static auto* const queries = reinterpret_cast<int (*)()>(dlsym(library, "fake_energy_queries"));
    return queries() > 0;
}

/// cpu_reference as a backend on a card.
class OnCard : public WrappedBackend {
public:
    explicit OnCard(std::string api) : api_(std::move(api)) {}
    Capabilities capabilities() const override {
        Capabilities capabilities = WrappedBackend::capabilities();
        capabilities.api = api_;
        capabilities.family = "cuda";
        capabilities.uuid = number_ == 0 ? "GPU-fake" : "GPU-fake-" + std::to_string(number_);
        return capabilities;
    }

private:
    const int number_ = DeviceOfThread::now().number;
    const std::string api_;
};

/// OnCard without springs.
class WrongOnCard final : public OnCard {
public:
    WrongOnCard() : OnCard("CUDA 13.0") {}
    void upload(const Problem& problem, const State& state) override {
        wrong_ = problem;
        wrong_.group_stiffness = {0, 0, 0};
        OnCard::upload(wrong_, state);
    }

private:
    Problem wrong_;
};

/// OnCard, which fails once: in the first batch of which the energy is counted.
class Torn final : public OnCard {
public:
    Torn() : OnCard("CUDA 13.0") {}
    void step(int count) override {
        if (counts_energy() && !std::exchange(torn_, true)) throw std::runtime_error("the batch is torn");
        OnCard::step(count);
    }

private:
    bool torn_ = false;
};

/// Seconds of batches without a pause, of which the energy is counted.
constexpr double counted_seconds = 1;

/// OnCard with a clock by which a step takes 100 us. It takes 200 us once energy has been counted for longer
/// than it takes to measure it one time.
class Tiring final : public OnCard {
public:
    Tiring() : OnCard("CUDA 13.0") {}
    void step(int count) override {
        OnCard::step(count);
        if (counts_energy() && !begin_) begin_ = Clock::now();
        const bool tired = begin_ && seconds_since(*begin_) > counted_seconds + max_leap_seconds + 0.1;
        seconds_ += count * (tired ? 200e-6 : 100e-6);
    }

private:
    void mark(Mark which) override {
        if (which == Mark::begin) seconds_ = 0;
    }
    double seconds_between_marks() const override { return seconds_; }

    std::optional<Clock::time_point> begin_;
    double seconds_ = 0;
};

const Registered torn = registered_as<Torn>("torn_on_card");
const Registered tiring = registered_as<Tiring>("tiring_on_card");
const Registered on_card = registered_as<OnCard>("on_card", "CUDA 13.0");
const Registered wrong_on_card = registered_as<WrongOnCard>("wrong_on_card");
const Registered drawn_on_card = registered_as<OnCard>("drawn_on_card", "OpenGL 4.6");

nlohmann::json result_of_study(const std::string& kind, const std::vector<std::string>& backends,
                               const nlohmann::json& settings = nlohmann::json::object(),
                               std::optional<int> ranks = {}, bool strained = false) {
    Study study;
    study.name = "test";
    study.kind = kind;
    study.repetitions = 4;
    study.backends = backends;
    study.settings = settings;
    study.scenes = {{"box@4", 4, {}}};
    if (strained) study.scenes.front().settings[StudyScene::strained_key] = true;
    StudyOptions options;
    options.ranks = ranks;
    return run_study(study, options);
}
nlohmann::json timing() { return result_of_study("timing", {"on_card", "drawn_on_card", "cpu_reference"}); }

/// The one row of the list `kind`.
nlohmann::json row_of(const std::string& kind, const nlohmann::json& result) {
    return result.at(kind).empty() ? result.at("failed").at(0) : result.at(kind).at(0);
}

std::string reasons_of(const nlohmann::json& result, const std::string& backend) {
    for (const auto& row : result.at("benchmarks")) {
        if (row.at("backend") == backend) return row.value("noisy", nlohmann::json::array()).dump();
    }
    return "no row";
}

class CardInAStudy : public ::testing::Test {
protected:
    void SetUp() override { ASSERT_NE(library, nullptr) << FAKE_NVML; }
    void TearDown() override {
        for (const char* name : {"FAKE_FALLING_CARD", "FAKE_STRANGERS", "FAKE_LISTS_WORKERS",
                                 "FAKE_SAMPLED_WATTS", "FAKE_STILL_COUNTER"})
            unsetenv(name);
    }
};

TEST_F(CardInAStudy, IsWatched) {
    nlohmann::json result = timing();
    EXPECT_EQ(result.at("context").at("voxspring").at("card_watched"), "yes");
    for (const char* backend : {"on_card", "drawn_on_card"})
        EXPECT_THAT(reasons_of(result, backend), ::testing::Not(HasSubstr("card")))
            << "they are the study's own";

    setenv("FAKE_FALLING_CARD", "GPU-fake", 1);
    setenv("FAKE_STRANGERS", "2", 1);
    result = timing();
    for (const char* backend : {"on_card", "drawn_on_card"})
        EXPECT_THAT(reasons_of(result, backend),
                    ::testing::AllOf(HasSubstr("the card's clock moved (between "),
                                     HasSubstr("other processes computed on the card (2)")));
    EXPECT_THAT(reasons_of(result, "cpu_reference"), ::testing::Not(HasSubstr("card")));
    for (const auto& row : result.at("benchmarks"))
        EXPECT_TRUE(row.at("backend") != "on_card" || row.contains("noisy")) << "aggregates too";
}

TEST_F(CardInAStudy, IsWatchedWhereTheDriverHasOtherNumbersForProcesses) {
    setenv("FAKE_LISTS_WORKERS", "0", 1);
    setenv("FAKE_STRANGERS", "2", 1);  // as many as the study has processes on the card
    EXPECT_THAT(reasons_of(timing(), "drawn_on_card"), ::testing::Not(HasSubstr("card")));
    setenv("FAKE_STRANGERS", "3", 1);
    EXPECT_THAT(reasons_of(timing(), "drawn_on_card"), HasSubstr("other processes computed on the card (1)"));
}

TEST_F(CardInAStudy, IsWatchedWhicheverRankItIsOf) {
    setenv("FAKE_FALLING_CARD", "GPU-fake-1", 1);
    setenv("FAKE_STRANGERS", "3", 1);  // one of them is the ranks' process, with another id
    const nlohmann::json row =
        row_of("scaling", result_of_study("scaling", {"on_card"}, {{"ranks", {2}}, {"ways", {"memory"}}}, 2));
    const std::string noisy = row.value("noisy", nlohmann::json::array()).dump();
    EXPECT_THAT(noisy, HasSubstr("the card's clock moved (between 1380 and 1980 MHz, rank 1)"));
    EXPECT_THAT(noisy, ::testing::Not(HasSubstr("MHz, rank 0")));
    EXPECT_THAT(noisy, HasSubstr("other processes computed on the card (2, rank 0)"));
    EXPECT_THAT(noisy, HasSubstr("other processes computed on the card (2, rank 1)"));
    EXPECT_EQ(row.value("min_card_mhz", 0), 1380) << row.dump(2);
    EXPECT_EQ(row.value("max_card_mhz", 0), 1980);
}

TEST_F(CardInAStudy, IsTheSameWhenAStudyOfAnotherDeviceIsResumed) {
    const TemporaryFolder folder;
    Study study;
    study.name = "test";
    study.kind = "scaling";
    study.repetitions = 1;
    study.backends = {"on_card"};
    study.settings = {{"ranks", {1}}};
    study.scenes = {{"box@4", 4, {}}};
    StudyOptions options;
    options.devices = {1};
    options.out = folder.path() / "result.json";
    // The study goes on with the empty journal, and in the end deletes one of its two names.
    const std::filesystem::path journal = folder.write("result.json.journal", ""),
                                kept = folder.path() / "kept";
    std::filesystem::create_hard_link(journal, kept);
    EXPECT_TRUE(run_study(study, options).rows("failed").empty());
    std::filesystem::rename(kept, journal);
    options.resume = true;
    const nlohmann::json result = run_study(study, options);
    EXPECT_EQ(result.at("context").at("voxspring").at("study").value("sessions", 1), 2);
    EXPECT_EQ(result.at("scaling").size(), 1u) << result.dump(2);
}

TEST_F(CardInAStudy, TellsItsEnergy) {
    const nlohmann::json row = row_of("energy", result_of_study("energy", {"on_card"}));
    ASSERT_TRUE(row.contains("watts")) << row.dump(2);
    // The counter is read up to 10 ms after a leap of 20 ms, at either end of five seconds.
    EXPECT_NEAR(row.at("watts").get<double>(), 500, 500 * 0.01);
    EXPECT_EQ(row.at("sampled_watts"), 500);
    EXPECT_NEAR(row.at("seconds").get<double>(), 5, 0.5);
    EXPECT_DOUBLE_EQ(row.at("joules_per_step"),
                     row.at("watts").get<double>() * row.at("seconds_per_step").get<double>());
    EXPECT_EQ(row.at("throttled"), nlohmann::json::array({"power limit"}));
    EXPECT_EQ(row.at("meter"), "NVML");
    EXPECT_EQ(row.at("passed"), true);
    EXPECT_GT(row.at("motion_max"), row.at("tolerance")) << "without any motion any state would pass";
}

// Catches batches that begin at the scene's own start, from which nothing moves by that much in four steps.
TEST_F(CardInAStudy, StepsFromAStrainedStartWhereTheStudyAsksForOne) {
    const nlohmann::json row =
        row_of("energy", result_of_study("energy", {"on_card"}, nlohmann::json::object(), {}, true));
    EXPECT_EQ(row.at("passed"), true);
    EXPECT_GT(row.at("motion_max"), 0.1);
}

TEST_F(CardInAStudy, HasNoEnergyOfAWrongBackend) {
    const nlohmann::json row = row_of("energy", result_of_study("energy", {"wrong_on_card"}));
    EXPECT_THAT(row.value("reason", ""), HasSubstr("does not agree with float64"));
}

TEST_F(CardInAStudy, WhoseCounterAndSamplesDisagreeHasNoEnergy) {
    setenv("FAKE_SAMPLED_WATTS", "400", 1);
    const nlohmann::json row = row_of("energy", result_of_study("energy", {"on_card"}));
    const std::string reason = row.value("reason", ""), said = "its energy is not known: the counter says ";
    ASSERT_THAT(reason, HasSubstr(said));
    // As far from 500 W as in the test above, so that 499 W may be said as well.
    EXPECT_NEAR(std::stod(reason.substr(reason.find(said) + said.size())), 500, 500 * 0.01);
}

const nlohmann::json sustaining = {{"start_times", false}, {"sustained_seconds", counted_seconds}};

// Catches a batch whose failure passes for that of the meter.
TEST_F(CardInAStudy, HasNoSustainedTimeOfABatchThatFails) {
    const nlohmann::json result = result_of_study("timing", {"torn_on_card"}, sustaining);
    EXPECT_EQ(result.at("benchmarks"), nlohmann::json::array());
    EXPECT_THAT(row_of("benchmarks", result).value("reason", ""), HasSubstr("the batch is torn"));
}

// Catches batches that are made once more because the power is not known.
TEST_F(CardInAStudy, WhoseCounterStandsStillHasASustainedTime) {
    for (const bool stands : {false, true}) {
        setenv("FAKE_STILL_COUNTER", stands ? "1" : "0", 1);
        const nlohmann::json row =
            row_of("benchmarks", result_of_study("timing", {"tiring_on_card"}, sustaining));
        EXPECT_EQ(row.value("sustained_watts", nlohmann::json()).is_null(), stands) << row.dump(2);
        EXPECT_NEAR(row.value("sustained_seconds_per_step", 0.0), 100e-6, 10e-6) << row.dump(2);
    }
}

TEST_F(CardInAStudy, TellsItsSettings) {
    EXPECT_EQ(Card("GPU-fake").settings(), nlohmann::json({{"power_limit_watts", 700.0}, {"ecc", true}}));
    EXPECT_EQ(timing().at("context").at("voxspring").at("card").at("ecc"), true);
}

TEST_F(CardInAStudy, ThatIsNotThereIsNotKnown) {
    try {
        const Card card("GPU-another");
        FAIL() << "it is watched";
    } catch (const std::runtime_error& reason) {
        EXPECT_THAT(reason.what(), HasSubstr("knows no card GPU-another"));
    }
}

}  // namespace
}  // namespace voxspring::testing
