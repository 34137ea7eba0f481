// Whether a study reports the times that there were: its backends have a simulated clock, so the time of
// every repetition is known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "backends/disk_cache.h"
#include "harness/results/print.h"
#include "harness/study/fastest.h"
#include "harness/study/study.h"
#include "tests/wrapped_backend.h"

namespace voxspring::testing {
namespace {

constexpr int repetitions = 9, steps = 4;

/// Nine times of a step in us, in the order of the repetitions, and what must be reported of them.
struct Truth {
    std::string name;
    std::vector<double> microseconds;
    double median;     ///< in us, known without sorting
    std::string text;  ///< of the table: the median, marked if it is noisy, with the interval
    std::vector<std::string> noise = {};  ///< empty: the time is to be trusted
};

/// `values` in a random order, which is the same in the study's process and in the cases'.
std::vector<double> shuffled(std::vector<double> values) {
    std::shuffle(values.begin(), values.end(), std::mt19937(1));
    return values;
}

const std::vector<Truth>& truths() {
    static const std::vector<Truth> all = {
        {"truth_steady", shuffled({99.6, 99.7, 99.8, 99.9, 100, 100.1, 100.2, 100.3, 100.4}), 100, "100 us"},
        // The middle half is 96 to 104 us: half of that is 4% of the median.
        {"truth_spread", shuffled({92, 94, 96, 98, 100, 102, 104, 106, 108}), 100, "100 us +-4%"},
        {"truth_outliers", shuffled({100, 100, 100, 100, 100, 100, 100, 900, 2000}), 100, "100 us"},
        {"truth_two_kinds",
         shuffled({100, 100, 100, 100, 100, 108, 108, 108, 108}),
         100,
         "~100 us +-4%",
         {"its repetitions form two groups (8% apart)"}},
        // Drift by 0.8%, 1% and 4% of the first time per repetition: by 4.8%, 5.9% and 23.1% from the second
        // to the eighth. The middle half spreads by 3.2 us, 4 us and 16 us.
        {"truth_least_drift", {100, 100.8, 101.6, 102.4, 103.2, 104, 104.8, 105.6, 106.4}, 103.2, "103 us"},
        {"truth_slow_drift",
         {100, 101, 102, 103, 104, 105, 106, 107, 108},
         104,
         "~104 us",
         {"its repetitions drift (6% from the first third to the last)"}},
        {"truth_drift",
         {100, 104, 108, 112, 116, 120, 124, 128, 132},
         116,
         "~116 us +-7%",
         {"the middle half of the repetitions spreads (over 14% of their median)",
          "its repetitions drift (23% from the first third to the last)"}}};
    return all;
}

/// The noise of this processor says nothing about a device.
Capabilities on_simulated_card(Capabilities capabilities) {
    capabilities.family = "opengl";
    capabilities.uuid = "GPU-simulated";
    return capabilities;
}

/// cpu_reference with a clock that only steps advance, by a time per step that depends on how many batches
/// were timed in this process. What comes between timed batches, such as warm-ups, is not in any of them.
class ByBatch : public WrappedBackend {
public:
    using Microseconds = std::function<double(int batch)>;
    explicit ByBatch(Microseconds microseconds) : microseconds_(std::move(microseconds)) {}
    Capabilities capabilities() const override { return on_simulated_card(WrappedBackend::capabilities()); }
    void step(int count) override {
        WrappedBackend::step(count);
        seconds_ += count * 1e-6 * microseconds_(batch_);
    }
    DeviceLimits measure_limits() override { throw Unavailable("a simulated clock has no limits"); }

protected:
    int batch() const { return batch_; }

private:
    void mark(Mark which) override {
        if (which == Mark::begin) {
            seconds_ = 0;
        } else {
            ++batch_;
        }
    }
    double seconds_between_marks() const override { return seconds_; }

    const Microseconds microseconds_;
    int batch_ = 0;
    double seconds_ = 0;
};

/// A device that holds its clock for as many batches as these studies repeat, and then takes a quarter
/// longer.
constexpr int held = 2;
double throttled(int batch) { return batch < held ? 100 : 125; }

/// A device whose median of all nine batches is 90 us, while that of every second one from the first on is
/// 104.
double lucky(int batch) { return batch == 4 || batch == 6 || batch == 8 ? 104 : 90; }

/// Makes a step too few once it has made as many batches.
class WrongWhenHot final : public ByBatch {
public:
    WrongWhenHot() : ByBatch([](int) { return 50; }) {}
    void step(int count) override { ByBatch::step(batch() < held ? count : count - 1); }
};

/// A fast device whose states are wrong from the first batch on.
class WrongAndFast final : public ByBatch {
public:
    WrongAndFast() : ByBatch([](int) { return 20; }) {}
    void step(int count) override { ByBatch::step(count - 1); }
};

/// A backend that steps on the host.
class OnHost final : public ByBatch {
public:
    using ByBatch::ByBatch;
    Capabilities capabilities() const override {
        Capabilities capabilities = ByBatch::capabilities();
        capabilities.family = "cpu";
        capabilities.uuid.clear();
        return capabilities;
    }
};

/// Microseconds that depend on the process.
double of_process(int) { return 100 + double(getpid() % 97); }

/// Compiles for 1000 s where no cache is found, and says that it took 3000 s where there is one.
class Compiling final : public ByBatch {
public:
    Compiling() : ByBatch([](int) { return 100; }) {}
    CompileTime compile_time() const override {
        const std::string cache = DiskCache::folder_of_user();
        return {0, cache.starts_with("/dev/null") ? 1000.0 : 3000.0};
    }
};

/// cpu_reference, which in one repetition makes a step too few.
class WrongOnce : public WrappedBackend {
public:
    static constexpr int wrong = 4;  ///< number of the repetition
    explicit WrongOnce(bool deterministic) : deterministic_(deterministic) {}
    Capabilities capabilities() const override {
        Capabilities capabilities = on_simulated_card(WrappedBackend::capabilities());  // one process
        capabilities.deterministic = deterministic_;
        return capabilities;
    }
    /// Every batch is one call, and the first one is the warm-up.
    void step(int count) override { WrappedBackend::step(batch_++ == wrong ? count - 1 : count); }

private:
    const bool deterministic_;
    int batch_ = 0;
};

/// cpu_reference, whose states differ by a bit from run to run, as those of atomics do.
class InAnyOrder final : public WrongOnce {
public:
    InAnyOrder() : WrongOnce(false) {}
    void step(int count) override { inner().step(count); }
    State download() override {
        State state = WrappedBackend::download();
        double& x = state.displacement.back().x;
        if (++reads_ % 2 == 0) x = std::nextafter(x, 1);
        return state;
    }

private:
    int reads_ = 0;
};

const std::vector<Registered> registered = [] {
    std::vector<Registered> all;
    for (const Truth& truth : truths())
        all.push_back(registered_for_test(truth.name, [&truth] {
            return std::make_unique<ByBatch>([&truth](int batch) {
                return batch < repetitions ? truth.microseconds[std::size_t(batch)] : 0;
            });
        }));
    all.push_back(registered_as<ByBatch>("sustain_hot", &throttled));
    all.push_back(registered_as<ByBatch>("sustain_slow", [](int) { return 101; }));
    all.push_back(registered_as<ByBatch>("halves_steady", [](int) { return 100; }));
    all.push_back(registered_as<ByBatch>("halves_lucky", &lucky));
    all.push_back(registered_as<WrongWhenHot>("hot_wrong"));
    all.push_back(registered_as<WrongAndFast>("rival_wrong"));
    all.push_back(registered_as<WrongWhenHot>("rival_hot_wrong"));
    all.push_back(registered_as<ByBatch>("rival_right", [](int) { return 100; }));
    all.push_back(registered_as<OnHost>("host_processes", &of_process));
    all.push_back(registered_as<OnHost>("sustain_host", [](int) { return 50; }));
    all.push_back(registered_as<Compiling>("start_compiling"));
    all.push_back(registered_as<WrongOnce>("once_wrong", true));
    all.push_back(registered_as<WrongOnce>("once_wrong_any", false));
    all.push_back(registered_as<InAnyOrder>("once_any_order"));
    return all;
}();

Result result_of(const std::vector<std::string>& backends, nlohmann::json settings = nlohmann::json::object(),
                 int times = repetitions, const StudyOptions& options = {}) {
    Study study;
    study.name = "truth";
    study.repetitions = times;
    settings["total_error"] = false;
    study.settings = std::move(settings);
    study.backends = backends;
    study.scenes = {{"box@4", steps, {}}};
    return run_study(study, options);
}

class TimingTruth : public ::testing::Test {
protected:
    static const Result& result() {
        static const Result measured = result_of({"truth_*"});
        return measured;
    }
    /// The rows of a backend: its repetitions in order, and the aggregate of that name.
    static std::vector<Row> rows_of(const Truth& truth, const std::string& aggregate = "") {
        std::vector<Row> rows;
        for (const Row& row : result().rows("benchmarks")) {
            if (row.identity.backend == truth.name && row.benchmark->aggregate_name.value_or("") == aggregate)
                rows.push_back(row);
        }
        return rows;
    }
    static Row row_of(const Truth& truth, const std::string& aggregate) {
        const std::vector<Row> rows = rows_of(truth, aggregate);
        return rows.size() == 1 ? rows.front() : Row();
    }
};

constexpr double rounding = 1e-9;  // relative, of a few sums and divisions

// Catches times that include a warm-up, an upload or another batch, batches that are not divided by their
// steps, and repetitions that are lost or change places.
TEST_F(TimingTruth, EveryRepetitionIsWhatTheClockSaid) {
    ASSERT_TRUE(result().rows("failed").empty()) << nlohmann::json(result()).at("failed");
    for (const Truth& truth : truths()) {
        const std::vector<Row> rows = rows_of(truth);
        ASSERT_EQ(rows.size(), std::size_t(repetitions)) << truth.name;
        for (std::size_t n = 0; n < rows.size(); ++n) {
            EXPECT_EQ(rows[n].benchmark->repetition_index, int(n));
            EXPECT_NEAR(rows[n].benchmark->real_microseconds, truth.microseconds[n], rounding * 1e3)
                << truth.name << " " << n;
        }
    }
}

// Catches a mean or a minimum in the median's place, which outliers and drift tell apart; a median of rates
// whose work is not that of a step; and the standard deviation of a population.
TEST_F(TimingTruth, AggregatesAreThoseOfTheKnownTimes) {
    for (const Truth& truth : truths()) {
        const BenchmarkPart median = *row_of(truth, "median").benchmark;
        EXPECT_NEAR(median.real_microseconds, truth.median, rounding * truth.median) << truth.name;
        const double particles = 4 * 4 * 4, rate = particles / (1e-6 * truth.median);
        EXPECT_NEAR(median.particle_updates_per_second, rate, rounding * rate) << truth.name;
        const std::vector<double>& times = truth.microseconds;
        const double mean = std::accumulate(times.begin(), times.end(), 0.0) / repetitions;
        EXPECT_NEAR(row_of(truth, "mean").benchmark->real_microseconds, mean, rounding * mean) << truth.name;
        double squares = 0;
        for (const double time : times) squares += (time - mean) * (time - mean);
        const double deviation = std::sqrt(squares / (repetitions - 1));
        EXPECT_NEAR(row_of(truth, "stddev").benchmark->real_microseconds, deviation, rounding * mean);
        EXPECT_NEAR(row_of(truth, "cv").benchmark->real_microseconds, deviation / mean, rounding);
    }
}

// Catches an interval of half or twice its width, and one from outliers: the table says half of the middle
// half from 3% on.
TEST_F(TimingTruth, TheTableHasTheKnownInterval) {
    const StepTimes times = step_times_of(result().rows("benchmarks"));
    for (const Truth& truth : truths()) {
        const Row median = row_of(truth, "median");
        EXPECT_EQ(time_text(median, median.step_seconds(), times), truth.text) << truth.name;
    }
}

// Catches a drift, or times of two kinds, that passes as quiet; outliers or a drift of less than 5% that do
// not; and a verdict that does not reach every row of the case.
TEST_F(TimingTruth, VerdictsOfNoiseAreThoseOfTheKnownTimes) {
    for (const Truth& truth : truths()) {
        for (const char* aggregate : {"", "mean", "median", "stddev", "cv"}) {
            for (const Row& row : rows_of(truth, aggregate)) EXPECT_EQ(row.noisy, truth.noise) << truth.name;
        }
    }
    std::ostringstream printed;
    print_table(result(), printed);
    EXPECT_THAT(printed.str(),
                ::testing::HasSubstr("~ 1 of 7 times not to be trusted, its repetitions form two "
                                     "groups: box@4: truth_two_kinds increment float64 (8% apart)"));
}

// Catches a repetition that nobody looks at, and one that is compared by its bits where these may differ.
TEST(EveryRepetition, IsJudged) {
    const Result result = result_of({"once_*", "cpu_reference"}, {{"start_times", false}});
    std::map<std::string, bool> passed;
    for (const Row& row : result.rows("verification")) {
        EXPECT_EQ(row.verdict->repetitions_judged, repetitions) << row.identity.backend;
        passed[row.identity.backend] = row.verdict->passed;
        if (row.verdict->passed) continue;
        EXPECT_THAT(row.reason.value_or(""), ::testing::HasSubstr("repetition 4 of 9"))
            << row.identity.backend;
    }
    const std::map<std::string, bool> expected = {
        {"once_wrong", false}, {"once_wrong_any", false}, {"once_any_order", true}, {"cpu_reference", true}};
    EXPECT_EQ(passed, expected);
    EXPECT_EQ(result.rows("failed").size(), 2u);
}

/// A study of one scene, whose rows of medians are by backend.
struct Measured {
    Result result;
    std::map<std::string, Row> medians;

    Measured(const std::string& backends, const nlohmann::json& settings, int times = repetitions,
             const StudyOptions& options = {})
        : result(result_of({backends}, settings, times, options)) {
        for (const Row& row : result.rows("benchmarks")) {
            if (row.benchmark->is_median()) medians[row.identity.backend] = row;
        }
    }
};

// A third of it is for clocks to settle: far longer than a few batches on a busy machine.
const nlohmann::json sustaining = {{"start_times", false}, {"sustained_seconds", 0.6}};

// Catches a sustained time that includes the batches of the burst, is that of the burst, or is of a row that
// is not the fastest of a device.
TEST(Sustained, IsTheTimeThatADeviceHolds) {
    const Measured measured("sustain_*", sustaining, held);
    ASSERT_EQ(measured.medians.size(), 3u) << nlohmann::json(measured.result).at("failed");
    const Row& hot = measured.medians.at("sustain_hot");
    EXPECT_NEAR(hot.benchmark->real_microseconds, 100, rounding * 100);
    EXPECT_NEAR(hot.counters.at("sustained_seconds_per_step"), 125e-6, rounding * 125e-6);
    for (const char* other : {"sustain_slow", "sustain_host"})
        EXPECT_EQ(measured.medians.at(other).counters.find("sustained_seconds_per_step"), nullptr) << other;
    std::ostringstream printed;
    print_table(measured.result, printed);
    EXPECT_THAT(printed.str(), ::testing::HasSubstr("125 us"));
}

// Catches a host whose fastest row has no sustained time, though no device was measured.
TEST(Sustained, IsThatOfTheHostWithoutADevice) {
    const Measured measured("sustain_host", sustaining);
    EXPECT_NEAR(measured.medians.at("sustain_host").counters.at("sustained_seconds_per_step"), 50e-6,
                rounding * 50e-6);
}

// Catches a sustained time of a row that is slower than one of an earlier group.
TEST(Sustained, IsThatOfTheFastestOfAllGroups) {
    StudyOptions options;
    options.together = 1;
    const Measured measured("sustain_*", sustaining, held, options);
    ASSERT_EQ(measured.medians.size(), 3u) << nlohmann::json(measured.result).at("failed");
    const auto sustained = [&](const std::string& backend) {
        return measured.medians.at(backend).counters.find("sustained_seconds_per_step") != nullptr;
    };
    EXPECT_TRUE(sustained("sustain_hot"));
    EXPECT_FALSE(sustained("sustain_slow"));
}

// Catches a sustained time of another row than the one that `fastest` names, which would then have none.
TEST(Sustained, IsOfTheRowThatIsChosenAsTheFastest) {
    const Measured measured("halves_*", sustaining);
    ASSERT_EQ(measured.medians.size(), 2u) << nlohmann::json(measured.result).at("failed");
    EXPECT_NEAR(measured.medians.at("halves_lucky").benchmark->real_microseconds, 90, rounding * 90);
    const std::vector<nlohmann::json> blocks = fastest_of(measured.result, {});
    ASSERT_EQ(blocks.size(), 1u);
    EXPECT_EQ(blocks.front().at("backend"), "halves_steady");
    EXPECT_NEAR(blocks.front().value("sustained_seconds_per_step", 0.0), 100e-6, rounding * 100e-6);
}

// Catches batches without a pause whose states nobody looks at.
TEST(Sustained, BatchesLeaveTheStateOfTheRepetitions) {
    const Measured measured("hot_wrong", sustaining, held);
    EXPECT_TRUE(measured.medians.empty());
    const std::vector<Row>& failed = measured.result.rows("failed");
    ASSERT_EQ(failed.size(), 1u);
    EXPECT_THAT(failed.front().reason.value_or(""),
                ::testing::HasSubstr("without a pause left another state"));
}

// Catches a case that gets no row and that takes the place of the fastest row: one of a wrong state, and one
// that fails without a pause.
TEST(Sustained, IsThatOfTheFastestRowWhoeverFails) {
    const Measured measured("rival_*", sustaining, held);
    EXPECT_EQ(measured.result.rows("failed").size(), 2u);
    ASSERT_EQ(measured.medians.size(), 1u) << nlohmann::json(measured.result).at("failed");
    const Counters& counters = measured.medians.at("rival_right").counters;
    ASSERT_NE(counters.find("sustained_seconds_per_step"), nullptr);
    EXPECT_NEAR(counters.at("sustained_seconds_per_step"), 100e-6, rounding * 100e-6);
}

// Catches repetitions on the host that all come from one process, and a spread that is not that of processes.
TEST(OnTheHost, RepetitionsAreOfThreeProcesses) {
    const Measured measured("host_processes", {{"start_times", false}});
    const auto times = step_times_of(measured.result.rows("benchmarks"));
    ASSERT_EQ(times.size(), 1u) << nlohmann::json(measured.result).at("failed");
    const std::vector<double>& all = times.begin()->second;
    ASSERT_EQ(all.size(), std::size_t(repetitions));
    std::vector<double> of_process;
    for (std::size_t n = 0; n < all.size(); n += 3) {
        EXPECT_EQ(std::vector<double>(3, all[n]),
                  std::vector<double>(all.begin() + std::ptrdiff_t(n), all.begin() + std::ptrdiff_t(n) + 3));
        of_process.push_back(all[n]);
    }
    std::sort(of_process.begin(), of_process.end());
    EXPECT_LT(of_process[0], of_process[1]);
    EXPECT_LT(of_process[1], of_process[2]);
    const Row& row = measured.medians.at("host_processes");
    EXPECT_EQ(row.counters.at("processes"), 3);
    EXPECT_NEAR(row.counters.at("process_spread"), (of_process[2] - of_process[0]) / 2 / of_process[1], 1e-9);
    EXPECT_EQ(measured.result.rows("verification").front().verdict->repetitions_judged, repetitions);
}

// Catches a start that is one sample, and further ones that find compiled kernels on disk.
TEST(Start, IsTheMedianOfColdOnes) {
    const Measured measured("start_compiling", nlohmann::json::object());
    ASSERT_EQ(measured.medians.size(), 1u) << nlohmann::json(measured.result).at("failed");
    const Row& row = measured.medians.begin()->second;
    EXPECT_EQ(row.start->compile_seconds, 1000);
    EXPECT_EQ(row.counters.at("starts"), 3);
    // From 3000 s to 1000 s; the rest of a start takes far less than a second of them.
    EXPECT_NEAR(row.counters.at("ready_spread"), 1, 0.01);
}

TEST(Ratio, HasAsManyDigitsAsItsSpreadDeserves) {
    EXPECT_EQ(ratio_text(91.79, 0.04), "92");
    EXPECT_EQ(ratio_text(91.79, 0.001), "92") << "2% of it is 1.8";
    EXPECT_EQ(ratio_text(27.374, 0), "27.4");
    EXPECT_EQ(ratio_text(1.7349, 0.002), "1.73");
    EXPECT_EQ(ratio_text(1.7349, 0.04), "1.7");
    EXPECT_EQ(ratio_text(1, 0), "1.00");
    EXPECT_EQ(ratio_text(153, 0.2), "150");
    EXPECT_EQ(ratio_text(42.3, 0.001, 0), "42");
}

}  // namespace
}  // namespace voxspring::testing
