// The limits of devices, the least work of a step counted by hand, and the fraction that follows from both.
#include "harness/device/limits.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <omp.h>
#include <sched.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "backends/layout/delta_lists.h"
#include "backends/layout/spring_array.h"
#include "backends/layout/work.h"
#include "backends/limits.h"
#include "backends/registry.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// --- The shortest time of a step ------------------------------------------------------------------------

DeviceLimits round_limits() {
    DeviceLimits limits;
    limits.copy_bytes_per_second = 1e9;
    limits.cached_copy_bytes_per_second = 4e9;
    limits.cache_bytes = 1000;
    limits.launch_seconds = 1e-6;
    limits.float32_operations_per_second = 1e10;
    limits.float64_operations_per_second = 1e9;
    return limits;
}

TEST(StepLimit, IsTheLongestOfWhatEachTakesAlone) {
    const auto limit = [](StepWork work, Precision precision = Precision::float32) {
        return limit_of(work, round_limits(), precision);
    };
    // 2 us of launches, 1.5 us of bytes, 1 us of operations.
    const StepLimit launch =
        limit({.bytes = 1500, .footprint_bytes = 1500, .operations = 10000, .launches = 2});
    EXPECT_EQ(launch.limited_by, "launch");
    EXPECT_DOUBLE_EQ(launch.seconds, 2e-6);
    // 1 us, 5 us, 4 us.
    const StepLimit bandwidth = limit({.bytes = 5000, .footprint_bytes = 5000, .operations = 40000});
    EXPECT_EQ(bandwidth.limited_by, "bandwidth");
    EXPECT_DOUBLE_EQ(bandwidth.seconds, 5e-6);
    // 1 us, 5 us, 6 us.
    const StepLimit arithmetic = limit({.bytes = 5000, .footprint_bytes = 5000, .operations = 60000});
    EXPECT_EQ(arithmetic.limited_by, "arithmetic");
    EXPECT_DOUBLE_EQ(arithmetic.seconds, 6e-6);
    // 40 us at the rate of float64.
    const StepLimit float64 =
        limit({.bytes = 5000, .footprint_bytes = 5000, .operations = 40000}, Precision::float64);
    EXPECT_EQ(float64.limited_by, "arithmetic");
    EXPECT_DOUBLE_EQ(float64.seconds, 4e-5);
}

// Catches a card with several denominators, a launch of another API, a sum without one of its terms, and a
// rate that is worse than that of the step's own API.
TEST(StepBound, HasTheRatesOfTheCardAndTheLaunchesOfTheApi) {
    const DeviceLimits own = round_limits();
    DeviceLimits other = round_limits();
    other.launch_seconds = 1e-9;
    other.cached_copy_bytes_per_second = 2e9;  // slower than the API's own, unlike the next
    other.copy_bytes_per_second = 5e9;
    other.float32_operations_per_second = 4e10;
    other.float64_operations_per_second.reset();
    // By its own API: 2 us of launches, 5 us of bytes, 6 us of operations. By the other one: 1 us, 1.5 us.
    const StepWork work{.bytes = 5000, .footprint_bytes = 5000, .operations = 60000, .launches = 2};
    const StepBound alone = bound_of(work, Precision::float32, own, {own});
    EXPECT_EQ(alone.longest.limited_by, "arithmetic");
    EXPECT_DOUBLE_EQ(alone.longest.seconds, 6e-6);
    EXPECT_DOUBLE_EQ(alone.sum_seconds, 13e-6);
    const StepBound of_card = bound_of(work, Precision::float32, own, {other, own});
    EXPECT_EQ(of_card.longest.limited_by, "launch");
    EXPECT_DOUBLE_EQ(of_card.longest.seconds, 2e-6);
    EXPECT_DOUBLE_EQ(of_card.sum_seconds, 4.5e-6);
    const StepBound in_cache =
        bound_of({.bytes = 1000, .footprint_bytes = 1000}, Precision::float32, own, {other});
    EXPECT_DOUBLE_EQ(in_cache.sum_seconds, 1e-6 + 0.25e-6);
    // An API without float64 says nothing about it.
    EXPECT_DOUBLE_EQ(bound_of(work, Precision::float64, own, {other}).longest.seconds, 60e-6);
}

// Catches a limit that is kept as the last process measured it, rather than the best.
TEST(BestLimits, TakeTheBetterOfEach) {
    DeviceLimits one = round_limits(), other = round_limits();
    one.bandwidth = {{100, 0, 5e9}, {100, 0.5, 2e9}};
    other.bandwidth = {{100, 0, 4e9}, {100, 0.5, 3e9}, {200, 0, 1e9}};
    one.launch_seconds = 2e-6;
    other.copy_bytes_per_second = 2e9;
    other.float64_operations_per_second.reset();
    one.exchange_seconds = 3e-6;
    for (const DeviceLimits& best : {best_of(one, other), best_of(other, one)}) {
        EXPECT_EQ(best.launch_seconds, 1e-6);
        EXPECT_EQ(best.copy_bytes_per_second, 2e9);
        EXPECT_EQ(best.float64_operations_per_second, 1e9);
        EXPECT_EQ(best.exchange_seconds, 3e-6);
        EXPECT_THAT(best.bandwidth,
                    ::testing::UnorderedElementsAre(Bandwidth{100, 0, 5e9}, Bandwidth{100, 0.5, 3e9},
                                                    Bandwidth{200, 0, 1e9}));
    }
    Capabilities device;
    device.device = "the device of a test, " + std::to_string(std::random_device{}());
    EXPECT_FALSE(best_so_far(device));
    EXPECT_EQ(best_so_far(device, one).launch_seconds, 2e-6);
    EXPECT_EQ(best_so_far(device, other).launch_seconds, 1e-6);
    EXPECT_EQ(best_so_far(device, one).launch_seconds, 1e-6);
    EXPECT_EQ(best_so_far(device, one, 0).launch_seconds, 1e-6);
    EXPECT_EQ(best_so_far(device).value().processes, 3) << "the last one did not measure all";
    const int threads = omp_get_max_threads();
    omp_set_num_threads(threads + 1);
    EXPECT_TRUE(best_so_far(device)) << "a study measures with all processors nevertheless";
    omp_set_num_threads(threads);
    const int processors = omp_get_num_procs();
    cpu_set_t all, alone;
    ASSERT_EQ(sched_getaffinity(0, sizeof all, &all), 0);
    CPU_ZERO(&alone);
    CPU_SET(sched_getcpu(), &alone);
    ASSERT_EQ(sched_setaffinity(0, sizeof alone, &alone), 0);
    // Some libraries of OpenMP count the processors only once.
    if (omp_get_num_procs() != processors) {
        EXPECT_FALSE(best_so_far(device)) << "other footprints, and another rate";
    }
    ASSERT_EQ(sched_setaffinity(0, sizeof all, &all), 0);
    device.driver = "another driver";
    EXPECT_FALSE(best_so_far(device));
}

TEST(StepLimit, TakesTheCachesRateForWhatFitsIntoIt) {
    DeviceLimits limits = round_limits();
    limits.launch_seconds = 0;
    // Read by one launch and again by another.
    const auto seconds = [&](std::uint64_t footprint) {
        const StepLimit limit =
            limit_of({.bytes = 2 * footprint, .footprint_bytes = footprint, .operations = 1}, limits,
                     Precision::float32);
        EXPECT_EQ(limit.limited_by, "bandwidth");
        return limit.seconds;
    };
    EXPECT_DOUBLE_EQ(seconds(1000), 0.5e-6);
    EXPECT_DOUBLE_EQ(seconds(1001), 2.002e-6);
    limits.cache_bytes = limits.cached_copy_bytes_per_second = 0;
    EXPECT_DOUBLE_EQ(seconds(1000), 2e-6) << "the cache is unknown";
}

/// Rates in GB/s at 100, 1000 and 8000 bytes, read only and half of them written.
DeviceLimits tabled_limits() {
    DeviceLimits limits = round_limits();
    limits.bandwidth = {{100, 0, 4e9},    {100, 0.5, 2e9}, {1000, 0, 5e9},
                        {1000, 0.5, 1e9}, {8000, 0, 1e9},  {8000, 0.5, 0.5e9}};
    return limits;
}

double tabled_rate(std::uint64_t footprint, std::uint64_t written_of_100) {
    return bytes_per_second_of({.bytes = 100, .written_bytes = written_of_100, .footprint_bytes = footprint},
                               tabled_limits());
}

TEST(Bandwidths, AreThoseOfTheFootprintOrFaster) {
    EXPECT_DOUBLE_EQ(tabled_rate(8000, 0), 1e9);
    EXPECT_DOUBLE_EQ(tabled_rate(1000000, 50), 0.5e9);
    EXPECT_DOUBLE_EQ(tabled_rate(7999, 0), 5e9) << "some of it may be in the cache still";
    EXPECT_DOUBLE_EQ(tabled_rate(1000, 50), 1e9);
    EXPECT_DOUBLE_EQ(tabled_rate(999, 50), 2e9);
    EXPECT_DOUBLE_EQ(tabled_rate(100, 0), 5e9) << "what more bytes reached, fewer can";
    EXPECT_DOUBLE_EQ(tabled_rate(1, 50), 2e9) << "below all that was measured";
}

TEST(Bandwidths, AreInterpolatedByTheTimeOfAByte) {
    // A read byte takes 1 ns and one of which half are written 2 ns.
    EXPECT_DOUBLE_EQ(tabled_rate(8000, 25), 1e9 / 1.5);
    EXPECT_DOUBLE_EQ(tabled_rate(8000, 5), 1e9 / 1.1);
    EXPECT_DOUBLE_EQ(tabled_rate(8000, 80), 0.5e9) << "more writing than was measured";
    EXPECT_DOUBLE_EQ(bytes_per_second_of({}, tabled_limits()), 5e9) << "no bytes at all";
}

TEST(Bandwidths, GoThroughJson) {
    const DeviceLimits limits = tabled_limits();
    const nlohmann::json json = to_json(limits);
    EXPECT_EQ(json.at("bandwidth").at(1),
              nlohmann::json::parse(
                  R"({"footprint_bytes": 100.0, "written_share": 0.5, "bytes_per_second": 2e9})"));
    EXPECT_EQ(device_limits_of(json).bandwidth, limits.bandwidth);
    EXPECT_FALSE(to_json(round_limits()).contains("bandwidth"));
    EXPECT_TRUE(device_limits_of(to_json(round_limits())).bandwidth.empty());
}

TEST(LeastSeconds, AreThoseOfAnUndisturbedBatch) {
    // A repetition takes 7 us. Two batches in three are interrupted for longer than a batch has to last.
    int calls = 0;
    int longest = 0;
    const double seconds = min_seconds([&](int count) {
        longest = std::max(longest, count);
        return count * 7e-6 + (++calls % 3 == 0 ? 0 : 5e-3);
    });
    EXPECT_NEAR(seconds, 7e-6, 1e-12);
    EXPECT_EQ(longest, 512) << "the first power of two that lasts 2 ms";
}

TEST(LeastSeconds, BeginWithBatchesThatAreLongEnough) {
    std::vector<int> counts;
    const double seconds = min_seconds(
        [&](int count) {
            counts.push_back(count);
            return count * 1e-5;
        },
        one_of_many(std::size_t(1) << 18));
    EXPECT_NEAR(seconds, 1e-5, 1e-15);
    EXPECT_EQ(counts.at(1), 64) << "16 MiB";
    EXPECT_EQ(counts.back(), 128);
    EXPECT_EQ(std::count(counts.begin(), counts.end(), 128), 5);
}

TEST(LeastSeconds, EndOnAClockThatStandsStill) {
    EXPECT_EQ(min_seconds([](int) { return 0.0; }), 0);
}

// --- The least work of a step, counted by hand ----------------------------------------------------------

/// 6 particles, 4 springs along x, 3 along y and 4 diagonals: 11, with 22 ends.
Problem plate() { return make_lattice_problem(solid({3, 2, 1}), FACE_BITS | EDGE_BITS); }

Problem loaded_plate_of_two_materials() {
    Problem problem = make_lattice_problem(make_grid({3, 2, 1}, [](int x, int, int) { return 1 + x % 2; }),
                                           FACE_BITS | EDGE_BITS);
    problem.materials = {{1, 1}, {2, 3}};
    problem.load.assign(6, glm::dvec3(0, 0, 1));
    return problem;
}

StepWork work_of(const std::string& spec, const Problem& problem) {
    return BackendSpec::parse(spec).make()->limits()->step_work(problem);
}

#define EXPECT_WORK(actual, expected_bytes, expected_operations, expected_launches) \
    {                                                                               \
        const StepWork work = actual;                                               \
        EXPECT_EQ(work.bytes, std::uint64_t(expected_bytes));                       \
        EXPECT_EQ(work.operations, std::uint64_t(expected_operations));             \
        EXPECT_EQ(work.launches, expected_launches);                                \
    }

#define EXPECT_TRAFFIC(actual, expected_written, expected_footprint)        \
    {                                                                       \
        const StepWork work = actual;                                       \
        EXPECT_EQ(work.written_bytes, std::uint64_t(expected_written));     \
        EXPECT_EQ(work.footprint_bytes, std::uint64_t(expected_footprint)); \
    }

constexpr Formulation position = Formulation::position;

TEST(StepWork, OfCudaImplicit) {
    EXPECT_WORK(layout::implicit_work<float>(plate(), position), 6 * 48, 6 * (15 + 6) + 22 * 13, 1);
    EXPECT_WORK(layout::implicit_work<double>(plate(), position), 6 * 96, 6 * (15 + 6) + 22 * 19, 1);
    const Problem loaded = loaded_plate_of_two_materials();
    EXPECT_WORK(layout::implicit_work<float>(loaded, position), 6 * (48 + 12 + 4 + 4), 6 * (18 + 3) + 22 * 16,
                1);
    EXPECT_WORK(layout::implicit_work<double>(loaded, position), 6 * (96 + 24 + 8 + 8),
                6 * (18 + 3) + 22 * 26, 1);
}

// 7 springs along an axis and 4 along two.
TEST(StepWork, OfCudaByFormulation) {
    EXPECT_WORK(layout::implicit_work<float>(plate(), Formulation::displacement), 6 * 48,
                6 * (15 + 6) + 2 * (7 * 11 + 4 * 12) + 22 * 3, 1);
    EXPECT_WORK(layout::implicit_work<float>(plate(), Formulation::increment), 6 * 56,
                6 * (12 + 6) + 2 * (7 * 16 + 4 * 18) + 22 * 3, 1);
    EXPECT_WORK(layout::implicit_work<double>(plate(), Formulation::increment), 6 * 112,
                6 * (12 + 6) + 2 * (7 * 25 + 4 * 27) + 22 * 3, 1);
    EXPECT_WORK(layout::implicit_work<float>(plate(), Formulation::compensated), 6 * 112,
                6 * (72 + 6) + 2 * (7 * 22 + 4 * 24) + 22 * 3, 1);
    Problem moved = plate();
    moved.gravity.z = 1;
    moved.damping = 0.1;
    EXPECT_WORK(layout::implicit_work<float>(moved, Formulation::paper), 6 * 48, 6 * (21 + 6) + 22 * 13, 1);
}

// For two rows of two particles each a thread evaluates 16 face springs in place of 12, and 38 edge springs
// in place of 24; for one row, in float64, 9 in place of 6 and 22 in place of 12.
TEST(StepWork, OfCudaMarch) {
    const int faces = 7 * 16 / 12, edges = 4 * 38 / 24, ends = 22;
    EXPECT_WORK(layout::march_work<float>(plate(), position), 6 * 36,
                faces * 9 + edges * 8 + ends * 3 + 6 * 9, 1);
    EXPECT_WORK(layout::march_work<double>(plate(), position), 6 * 72,
                7 * 9 / 6 * 15 + 4 * 22 / 12 * 14 + ends * 3 + 6 * 9, 1);
    EXPECT_WORK(layout::march_work<float>(plate(), Formulation::displacement), 6 * 36,
                faces * 10 + edges * 10 + ends * 3 + 6 * 9, 1);
    EXPECT_WORK(layout::march_work<float>(plate(), Formulation::increment), 6 * 48,
                faces * 16 + edges * 17 + ends * 3 + 6 * 6, 1);
    Problem moved = plate();
    moved.damping = 0.1;
    EXPECT_WORK(layout::march_work<float>(moved, position), 6 * 36, faces * 9 + edges * 8 + ends * 3 + 6 * 12,
                1);
}

TEST(StepWork, OfCudaExplicit) {
    EXPECT_WORK(layout::explicit_work<float>(plate(), false, position), 6 * 48 + 22 * 4,
                6 * (15 + 6) + 22 * 13, 1);
    EXPECT_WORK(layout::explicit_work<float>(plate(), true, position), 6 * 48 + 22 * 12, 6 * 15 + 22 * 14, 1);
    EXPECT_WORK(layout::explicit_work<double>(plate(), true, position), 6 * 96 + 22 * 20, 6 * 15 + 22 * 20,
                1);
    Problem sutured = plate();
    sutured.springs = {{0, 5, 1, 1}};
    EXPECT_WORK(layout::explicit_work<float>(sutured, true, position), 6 * 48 + 24 * 12, 6 * 15 + 24 * 14, 1);
    // Without positions, the list says how this spring lies at rest, at both of its ends.
    EXPECT_EQ(layout::explicit_work<float>(sutured, true, Formulation::displacement).bytes,
              6 * 48 + 24 * 12 + 2 * 16);
}

// A spring beyond the lattice has a stiffness: 1 operation at either end, whatever the materials are.
TEST(StepWork, OfCudaExplicitDelta) {
    Problem sutured = plate(), loaded = loaded_plate_of_two_materials();
    sutured.springs = loaded.springs = {{0, 5, 1, 1}};
    constexpr std::size_t slice = sizeof(layout::Slice);
    EXPECT_WORK(layout::delta_work<float>(sutured, position), 6 * 48 + slice + 2 * (4 + 8),
                6 * (15 + 6) + 22 * 13 + 2 * 14, 1);
    EXPECT_WORK(layout::delta_work<float>(loaded, position), 6 * (48 + 12 + 4 + 4) + slice + 2 * (4 + 8),
                6 * (18 + 3) + 22 * 16 + 2 * 14, 1);
    EXPECT_WORK(layout::delta_work<double>(loaded, position), 6 * (96 + 24 + 8 + 8) + slice + 2 * (4 + 16),
                6 * (18 + 3) + 22 * 26 + 2 * 20, 1);
}

TEST(StepWork, OfCudaScatter) {
    // Both launches read and write forces; the first also reads positions.
    EXPECT_WORK(layout::scatter_work<float>(plate(), position), 6 * (48 + 4 * 12 + 16) + 11 * 16,
                6 * 15 + 11 * 20, 2);
    EXPECT_WORK(layout::scatter_work<double>(plate(), position), 6 * (96 + 4 * 24 + 32) + 11 * 24,
                6 * 15 + 11 * 26, 2);
    Problem sutured = plate();
    sutured.springs = {{0, 5, 1, 1}};
    EXPECT_EQ(layout::scatter_work<float>(sutured, Formulation::displacement).bytes,
              6 * (48 + 4 * 12 + 16) + 12 * 16 + 16)
        << "one offset at rest";
    EXPECT_EQ(layout::scatter_work<float>(plate(), Formulation::compensated).bytes,
              6 * (112 + 4 * 12 + 2 * 16) + 11 * 16)
        << "low parts";
    const Problem one_particle = make_lattice_problem(solid({1, 1, 1}), FACE_BITS);
    EXPECT_WORK(layout::scatter_work<float>(one_particle, position), 48 + 2 * 12, 15, 1);
}

// Words of 16 bytes in two arrays, one of which is overwritten; vectors of 12 bytes in one.
TEST(StepWork, TrafficOfCuda) {
    const Problem loaded = loaded_plate_of_two_materials();
    EXPECT_TRAFFIC(layout::implicit_work<float>(plate(), position), 6 * 16, 6 * 32);
    EXPECT_TRAFFIC(layout::implicit_work<double>(plate(), position), 6 * 32, 6 * 64);
    EXPECT_TRAFFIC(layout::implicit_work<float>(loaded, position), 6 * 16, 6 * (32 + 12 + 4 + 4));
    EXPECT_TRAFFIC(layout::implicit_work<float>(plate(), Formulation::increment), 6 * 28, 6 * 44);
    EXPECT_TRAFFIC(layout::implicit_work<float>(plate(), Formulation::compensated), 6 * 56, 6 * 88);
    EXPECT_TRAFFIC(layout::march_work<float>(plate(), position), 6 * 12, 6 * 24);
    EXPECT_TRAFFIC(layout::march_work<float>(plate(), Formulation::increment), 6 * 24, 6 * 36);
    EXPECT_TRAFFIC(layout::march_work<double>(plate(), Formulation::increment), 6 * 48, 6 * 72);
    EXPECT_TRAFFIC(layout::explicit_work<float>(plate(), true, position), 6 * 16, 6 * 32 + 22 * 12);
    // Both launches write all forces, which form one array; the springs are read.
    EXPECT_TRAFFIC(layout::scatter_work<float>(plate(), position), 6 * (16 + 2 * 12),
                   6 * (32 + 12) + 11 * 16);
    const Problem one_particle = make_lattice_problem(solid({1, 1, 1}), FACE_BITS);
    EXPECT_TRAFFIC(layout::scatter_work<float>(one_particle, position), 16 + 12, 32 + 12);
    Problem sutured = plate();
    sutured.springs = {{0, 5, 1, 1}};
    const std::uint64_t slice_and_ends = sizeof(layout::Slice) + 2 * (4 + 8);
    EXPECT_EQ(layout::delta_work<float>(sutured, position).bytes, 6 * 48 + slice_and_ends);
    EXPECT_TRAFFIC(layout::delta_work<float>(sutured, position), 6 * 16, 6 * 32 + slice_and_ends);
}

TEST(StepWork, TrafficOfCpu) {
    const std::string parallel = "cpu_parallel:formulation=", reference = "cpu_reference:formulation=";
    EXPECT_TRAFFIC(work_of(parallel + "position", plate()), 6 * 3 * 4, 6 * (6 + 1) * 4);
    EXPECT_TRAFFIC(work_of(parallel + "position", loaded_plate_of_two_materials()), 6 * 3 * 4,
                   6 * (6 + 3 + 2 + 1) * 4);
    EXPECT_TRAFFIC(work_of(parallel + "increment", plate()), 6 * 6 * 4, 6 * (9 + 1) * 4);
    EXPECT_TRAFFIC(work_of(parallel + "compensated", plate()), 6 * 12 * 4, 6 * (18 + 1) * 4);
    // Forces are written twice; positions and previous positions once.
    EXPECT_TRAFFIC(work_of(reference + "position", plate()), 6 * 4 * 24, 6 * 3 * 24 + 11 * 24);
    EXPECT_TRAFFIC(work_of(reference + "compensated", loaded_plate_of_two_materials()), 6 * 6 * 24,
                   6 * (3 + 1 + 2) * 24 + 11 * (24 + 40));
}

TEST(StepWork, OfCpuParallel) {
    const std::string by_position = "cpu_parallel:formulation=position";
    // Springs along x are evaluated twice; no particle has every neighbour.
    EXPECT_WORK(work_of(by_position, plate()), 6 * (9 + 1) * 4, 15 * 10 + 22 * 9 + 6 * 21, 1);
    EXPECT_WORK(work_of(by_position + ",precision=float64", plate()), 6 * (9 + 1) * 8,
                15 * 10 + 22 * 9 + 6 * 21, 1);
    EXPECT_WORK(work_of(by_position, loaded_plate_of_two_materials()), 6 * (9 + 3 + 2 + 1) * 4,
                15 * 12 + 22 * 9 + 6 * 24, 1);
    EXPECT_WORK(work_of(by_position + ",terms=all", plate()), 6 * (9 + 3 + 1 + 1) * 4,
                22 * 10 + 22 * 9 + 6 * 24, 1);
    // The middle one of three particles has both neighbours, and its mask may stay unread.
    const Problem row = make_lattice_problem(solid({3, 1, 1}), FACE_BITS);
    EXPECT_WORK(work_of(by_position, row), (3 * 9 + 2) * 4, 4 * 10 + 4 * 9 + 3 * 21, 1);

    EXPECT_WORK(work_of("cpu_parallel:formulation=paper", plate()), 6 * (9 + 1) * 4,
                15 * 10 + 22 * 9 + 6 * 21, 1);
    EXPECT_WORK(work_of("cpu_parallel:formulation=displacement", plate()), 6 * (9 + 1) * 4,
                15 * 10 + 22 * 12 + 6 * 21, 1);
    EXPECT_WORK(work_of("cpu_parallel", plate()), 6 * (12 + 1) * 4, 15 * 20 + 22 * 12 + 6 * 21, 1);
    EXPECT_WORK(work_of("cpu_parallel:formulation=compensated", plate()), 6 * (24 + 1) * 4,
                15 * 20 + 22 * 18 + 6 * 81, 1);
}

// A list of 12 bytes per spring and end in float32; 4 bytes for an inverse mass and 16 for where the list is.
TEST(StepWork, OfCpuExplicit) {
    const std::string by_position = "cpu_explicit:formulation=position";
    EXPECT_WORK(work_of(by_position, plate()), 6 * (3 * 12 + 20) + 22 * 12, 22 * 19 + 6 * 21, 1);
    EXPECT_WORK(work_of("cpu_explicit", plate()), 6 * (4 * 12 + 20) + 22 * 12, 22 * 32 + 6 * 21, 1);
    EXPECT_WORK(work_of("cpu_explicit:formulation=compensated", loaded_plate_of_two_materials()),
                6 * (9 * 12 + 20) + 22 * 12, 22 * 38 + 6 * 84, 1);
    EXPECT_TRAFFIC(work_of(by_position, plate()), 6 * 12, 6 * (2 * 12 + 20) + 22 * 12);
    EXPECT_TRAFFIC(work_of("cpu_explicit", plate()), 6 * 24, 6 * (3 * 12 + 20) + 22 * 12);
    Problem sutured = plate();
    sutured.springs = {{0, 5, 1, 1}};
    EXPECT_WORK(work_of("cpu_explicit", sutured), 6 * (4 * 12 + 20) + 24 * 12 + 2 * 20, 24 * 32 + 6 * 21, 1);
}

TEST(StepWork, OfCpuReference) {
    const std::string by_position = "cpu_reference:formulation=position";
    EXPECT_WORK(work_of(by_position, plate()), 6 * 9 * 24 + 11 * 24, 11 * 22 + 6 * 22, 1);
    EXPECT_WORK(work_of(by_position, loaded_plate_of_two_materials()), 6 * 10 * 24 + 11 * 24,
                11 * 22 + 6 * 25, 1);
    EXPECT_WORK(work_of("cpu_reference", plate()), 6 * 9 * 24 + 11 * (24 + 40), 11 * 35 + 6 * 22, 1);
    EXPECT_WORK(work_of("cpu_reference:formulation=compensated", plate()), 6 * 14 * 24 + 11 * (24 + 40),
                11 * 41 + 6 * 82, 1);
}

class Gl : public ::testing::Test {
protected:
    void SetUp() override {
        skip_without("gl", [] { BackendSpec::parse("gl_fragment_implicit").make(); });
    }
};

// An end of a spring takes 13 operations on positions. On displacements it takes one more for each axis along
// which it lies, by increments four more and two more per axis. The plate's seven face springs lie along one
// axis, its four edge springs along two.
TEST_F(Gl, StepWorkOfImplicit) {
    constexpr int axes = 2 * (7 * 1 + 4 * 2);
    const std::string by_position = "gl_fragment_implicit:formulation=position";
    EXPECT_WORK(work_of(by_position, plate()), 6 * 48, 6 * 15 + 22 * 13, 1);
    EXPECT_WORK(work_of(by_position, loaded_plate_of_two_materials()), 6 * (48 + 16 + 8),
                6 * 18 + 22 * (13 + 3), 1);
    Problem falling = plate();
    falling.gravity = {0, 0, -1};
    falling.damping = 0.1;
    EXPECT_WORK(work_of(by_position, falling), 6 * 48, 6 * 21 + 22 * 13, 1);
    // Without a mask the empty voxel is shaded as well.
    const Problem pair =
        make_lattice_problem(make_grid({3, 1, 1}, [](int x, int, int) { return x != 1; }), FACE_BITS);
    EXPECT_WORK(work_of(by_position, pair), 2 * 48, 2 * 15, 1);
    EXPECT_WORK(work_of(by_position + ",mask=none", pair), 3 * 48, 2 * 15, 1);

    EXPECT_WORK(work_of("gl_fragment_implicit:formulation=paper", falling), 6 * 48, 6 * 21 + 22 * 13, 1);
    EXPECT_WORK(work_of("gl_fragment_implicit:formulation=displacement", falling), 6 * 48,
                6 * 21 + 22 * 13 + axes, 1);
    EXPECT_WORK(work_of("gl_fragment_implicit", plate()), 6 * 64, 6 * 12 + 22 * 17 + 2 * axes, 1);
    EXPECT_WORK(work_of("gl_fragment_implicit", falling), 6 * 64, 6 * 21 + 22 * 17 + 2 * axes, 1);
    EXPECT_WORK(work_of("gl_fragment_implicit:formulation=compensated", plate()), 6 * 128,
                6 * 3 * (2 + 10 + 11) + 22 * 23 + 2 * axes, 1);
}

// With one more array for the stiffness.
TEST_F(Gl, StepWorkOfExplicit) {
    const std::string by_position = "gl_fragment_explicit:formulation=position";
    EXPECT_WORK(work_of(by_position, plate()), 6 * 48 + 22 * 4, 6 * 15 + 22 * 14, 1);
    EXPECT_WORK(work_of(by_position, loaded_plate_of_two_materials()), 6 * (48 + 16 + 8) + 22 * 12,
                6 * 18 + 22 * 14, 1);
    Problem sutured = plate();
    sutured.springs.push_back({0, 5, 1, 2});
    EXPECT_WORK(work_of(by_position, sutured), 6 * 48 + 24 * 12, 6 * 15 + 24 * 14, 1);
    // The one spring beyond the lattice stores a rest offset and deficit at either end.
    EXPECT_WORK(work_of("gl_fragment_explicit", sutured), 6 * 64 + 24 * 12 + 2 * 16,
                6 * 12 + 24 * (17 + 1) + 2 * (2 * (7 * 1 + 4 * 2) + 2 * 3), 1);
}

// Each frame is a separate image, and is read or written as a whole.
TEST_F(Gl, TrafficOfFragments) {
    EXPECT_TRAFFIC(work_of("gl_fragment_implicit:formulation=position", loaded_plate_of_two_materials()),
                   6 * 16, 6 * (48 + 16 + 8));
    EXPECT_TRAFFIC(work_of("gl_fragment_implicit", plate()), 6 * 32, 6 * 64);
    EXPECT_TRAFFIC(work_of("gl_fragment_implicit:formulation=compensated", plate()), 6 * 64, 6 * 128);
    EXPECT_TRAFFIC(work_of("gl_fragment_explicit:formulation=position", plate()), 6 * 16, 6 * 48 + 22 * 4);
}

TEST_F(Gl, StepWorkOfCompute) {
    EXPECT_EQ(work_of("gl_compute_implicit", plate()),
              layout::implicit_work<float>(plate(), Formulation::increment));
    EXPECT_EQ(work_of("gl_compute_implicit:formulation=position", loaded_plate_of_two_materials()),
              layout::implicit_work<float>(loaded_plate_of_two_materials(), Formulation::position));
}

// --- What devices reach ---------------------------------------------------------------------------------

void expect_rate(double rate) {
    EXPECT_TRUE(std::isfinite(rate));
    EXPECT_GT(rate, 0);
}

/// Expects the bandwidth at several footprints, from within the cache, if its size is known, to far beyond
/// it. At each there are three values, which differ in the share of the bytes moved that is written.
void expect_table(const DeviceLimits& limits) {
    std::map<double, std::set<double>> shares;
    for (const Bandwidth& one : limits.bandwidth) {
        expect_rate(one.bytes_per_second);
        EXPECT_TRUE(shares[one.footprint_bytes].insert(one.written_share).second);
    }
    for (const auto& [footprint, of_footprint] : shares)
        EXPECT_EQ(of_footprint, (std::set<double>{0, 1.0 / 3, 0.5})) << footprint;
    ASSERT_FALSE(shares.empty());
    if (limits.cache_bytes > 0) {
        EXPECT_LE(shares.begin()->first, limits.cache_bytes);
    }
    EXPECT_GT(shares.rbegin()->first, limits.cache_bytes);
}

/// Compares two measurements of a constant. Other processes may take any part of the machine in between.
void expect_alike(double a, double b) {
    EXPECT_LT(a, 3 * b);
    EXPECT_LT(b, 3 * a);
}

/// The higher rates of two measurements, since another process may have had a core during one.
DeviceLimits undisturbed(const BackendSpec& spec) {
    DeviceLimits limits = spec.make()->limits()->measure_limits();
    const DeviceLimits again = spec.make()->limits()->measure_limits();
    for (const auto rate : {&DeviceLimits::copy_bytes_per_second, &DeviceLimits::cached_copy_bytes_per_second,
                            &DeviceLimits::float32_operations_per_second})
        limits.*rate = std::max(limits.*rate, again.*rate);
    auto& float64 = limits.float64_operations_per_second;
    if (float64) float64 = std::max(*float64, *again.float64_operations_per_second);
    return limits;
}

TEST(CpuLimits, ArePositiveAndRepeat) {
    const BackendSpec spec = BackendSpec::parse("cpu_parallel");
    const DeviceLimits first = undisturbed(spec);
    const DeviceLimits second = undisturbed(spec);
    expect_rate(first.copy_bytes_per_second);
    expect_alike(first.copy_bytes_per_second, second.copy_bytes_per_second);
    if (first.cache_bytes > 0) {
        // The cache need not be faster: a virtual machine may name a cache that others share.
        expect_rate(first.cached_copy_bytes_per_second);
        expect_alike(first.cached_copy_bytes_per_second, second.cached_copy_bytes_per_second);
    }
    if (first.cache_bytes > 0) expect_table(first);
    EXPECT_EQ(first.launch_seconds, 0);
    EXPECT_FALSE(first.grid_barrier_seconds);
    EXPECT_FALSE(first.compute_shader_float32_operations_per_second);
    expect_rate(first.float32_operations_per_second);
    expect_rate(first.float64_operations_per_second.value());
    EXPECT_GT(first.float32_operations_per_second, *first.float64_operations_per_second);
}

// OpenMP may grant fewer threads than it offers: because of OMP_THREAD_LIMIT or, as here, to one thread of a
// team. Memory of threads that do not run must not count as moved.
TEST(CpuLimits, CountOnlyThreadsThatRun) {
    const auto backend = BackendSpec::parse("cpu_parallel").make();
    DeviceLimits limits;
#pragma omp parallel num_threads(2)
#pragma omp single
    {
        omp_set_num_threads(4);
        limits = backend->limits()->measure_limits();
    }
    ASSERT_FALSE(limits.bandwidth.empty());
    EXPECT_LE(limits.bandwidth.front().footprint_bytes, 64 << 10);
}

TEST(CudaLimits, ArePositiveAndRepeat) {
    std::unique_ptr<Backend> backend;
    make_or_skip("cuda_implicit_device", backend);
    if (!backend) return;
    const DeviceLimits first = backend->limits()->measure_limits();
    const DeviceLimits second = BackendSpec::parse("cuda_implicit_device").make()->limits()->measure_limits();
    expect_rate(first.copy_bytes_per_second);
    expect_alike(first.copy_bytes_per_second, second.copy_bytes_per_second);
    expect_rate(first.cached_copy_bytes_per_second);
    expect_table(first);
    // Each value is the best of several repeats of kernels that have the card to themselves.
    ASSERT_EQ(first.bandwidth.size(), second.bandwidth.size());
    for (std::size_t n = 0; n < first.bandwidth.size(); ++n) {
        const Bandwidth& one = first.bandwidth[n];
        const double ratio = second.bandwidth[n].bytes_per_second / one.bytes_per_second;
        EXPECT_NEAR(ratio, 1, 0.03) << one.footprint_bytes << " bytes, " << one.written_share << " written";
    }
    expect_rate(first.launch_seconds);
    EXPECT_LT(first.launch_seconds, 1e-4);
    if (first.grid_barrier_seconds) {
        expect_rate(*first.grid_barrier_seconds);
        EXPECT_LT(*first.grid_barrier_seconds, 1e-4);
    }
    expect_rate(first.float32_operations_per_second);
    expect_rate(first.float64_operations_per_second.value());
    EXPECT_LT(*first.float64_operations_per_second, first.float32_operations_per_second);
    EXPECT_FALSE(first.compute_shader_float32_operations_per_second);
}

class GlNamed : public Gl, public ::testing::WithParamInterface<const char*> {};
INSTANTIATE_TEST_SUITE_P(, GlNamed, ::testing::Values("gl_fragment_implicit", "gl_compute_implicit"));

TEST_P(GlNamed, LimitsArePositiveAndRepeat) {
    const BackendSpec spec = BackendSpec::parse(GetParam());
    const DeviceLimits first = undisturbed(spec);
    const DeviceLimits second = undisturbed(spec);
    expect_rate(first.copy_bytes_per_second);
    expect_alike(first.copy_bytes_per_second, second.copy_bytes_per_second);
    expect_rate(first.launch_seconds);
    expect_rate(first.float32_operations_per_second);
    EXPECT_EQ(first.cache_bytes, 0) << "OpenGL does not tell";
    expect_table(first);
    // Each API's own programs, each under its own name.
    const bool computes = spec.entry->name == "gl_compute_implicit";
    EXPECT_EQ(spec.make()->capabilities().api, computes ? "OpenGL compute 4.5 core" : "OpenGL 4.5 core");
    EXPECT_EQ(first.compute_shader_float32_operations_per_second.has_value(), !computes);
    if (!computes) {
        expect_rate(*first.compute_shader_float32_operations_per_second);
        EXPECT_FALSE(first.float64_operations_per_second);
    }
}

TEST_P(GlNamed, MeasuringLimitsChangesNoStep) {
    const BackendSpec spec = BackendSpec::parse(GetParam());
    Problem problem = plate();
    problem.time_step = 0.1;
    const State state = random_state(problem, 0.1, 1);
    const auto after = [&](bool measured) {
        const auto backend = spec.make();
        if (measured) backend->limits()->measure_limits();
        return stepped(*backend, problem, state, 3);
    };
    const State with = after(true);
    const State without = after(false);
    EXPECT_NE(with.increment, state.increment);
    expect_same_bits(with, without);
}

TEST(PrintedLimits, SayWhereFragmentShadersHaveFewProcessors) {
    nlohmann::json device = {{"api", "OpenGL 4.5 core"},
                             {"device", "Card"},
                             {"copy_bytes_per_second", 2e11},
                             {"launch_seconds", 2e-6},
                             {"float32_operations_per_second", 1e12},
                             {"compute_shader_float32_operations_per_second", 3.2e13}};
    const auto printed = [&] {
        std::ostringstream out;
        print_limits({{"OpenGL", device}, {"CUDA", "out of memory"}}, out);
        return out.str();
    };
    EXPECT_THAT(printed(), HasSubstr("200 GB/s, a launch 2.00 us, float32 1.00 Top/s"));
    EXPECT_THAT(printed(), HasSubstr("1/32 of the arithmetic"));
    EXPECT_THAT(printed(), HasSubstr("CUDA: not measured: out of memory"));
    device["float32_operations_per_second"] = 0.8e13;
    EXPECT_THAT(printed(), Not(HasSubstr("of the arithmetic"))) << "a quarter";
}

// Catches rows of one card with several denominators, and those of another card or of a part of it among
// them.
TEST(MeasuredLimits, OfACardAreThoseOfAllItsApis) {
    MeasuredLimits measured;
    const auto device = [&](const std::string& api, const std::string& uuid, double compute = 0) {
        Capabilities capabilities;
        capabilities.api = capabilities.limits_of = api;
        capabilities.uuid = uuid;
        measured.of(capabilities, [&] {
            DeviceLimits rates = round_limits();
            if (compute > 0) rates.compute_shader_float32_operations_per_second = compute;
            return rates;
        });
        return capabilities;
    };
    const Capabilities cuda = device("CUDA", "GPU-a"), vulkan = device("Vulkan", "GPU-a"),
                       part = device("OpenGL", "GPU-a", 1e12), other = device("other", "GPU-b"),
                       cpu = device("CPU", ""), mesa = device("Mesa", "");
    EXPECT_EQ(measured.on_card_of(cuda).size(), 3u);
    EXPECT_EQ(measured.on_card_of(vulkan).size(), 3u);
    for (const Capabilities& alone : {part, other, cpu, mesa})
        EXPECT_EQ(measured.on_card_of(alone).size(), 1u) << alone.api;
    measured.improve_launch(cuda, 1e-7);
    measured.improve_launch(cuda, 1e-3);
    EXPECT_EQ(measured.json().at("CUDA").at("launch_seconds"), 1e-7);
    EXPECT_EQ(measured.json().at("Vulkan").at("launch_seconds"), 1e-6);
}

TEST(MeasuredLimits, AreMeasuredOnceForWhatSharesThem) {
    MeasuredLimits measured;
    int measurements = 0;
    const auto of = [&](const std::string& api, const std::string& limits_of) {
        Capabilities capabilities;
        capabilities.api = api;
        capabilities.limits_of = limits_of;
        const auto limits = measured.of(capabilities, [&] {
            DeviceLimits rates = round_limits();
            rates.launch_seconds = ++measurements;
            return rates;
        });
        return limits.value().launch_seconds;
    };
    EXPECT_EQ(of("OpenGL 4.5 core", "OpenGL"), 1);
    EXPECT_EQ(of("OpenGL 4.6 core", "OpenGL"), 1) << "another version of the same";
    EXPECT_EQ(of("OpenGL 4.5 core", "OpenGL compute"), 2);
    // Without an API there is nothing to share: the CPU is only its default family.
    EXPECT_EQ(of("Vulkan 1.3", ""), 3);
    EXPECT_EQ(of("CPU", "CPU"), 4);
    EXPECT_EQ(measured.json().size(), 4U);
    EXPECT_EQ(measured.json().at("Vulkan 1.3").at("launch_seconds"), 3);
}

}  // namespace
}  // namespace voxspring::testing
