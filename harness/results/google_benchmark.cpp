#include "harness/results/google_benchmark.h"

#include <benchmark/benchmark.h>
#include <fmt/chrono.h>
#include <omp.h>

#include <array>
#include <cmath>
#include <ctime>
#include <nlohmann/json.hpp>
#include <string>

#include "harness/base/statistics.h"

namespace voxspring {
namespace {

using Statistic = double (*)(const std::vector<double>&);
struct Aggregate {
    const char* name;
    const char* unit;
    Statistic of;
};
double median_of(const std::vector<double>& values) { return median(values); }
/// The coefficient of variation; 0 if the mean is 0, as in Google Benchmark.
double variation(const std::vector<double>& values) {
    const double centre = mean(values);
    return centre == 0 ? 0 : standard_deviation(values) / centre;
}
constexpr std::array aggregates = {Aggregate{"mean", "time", mean}, Aggregate{"median", "time", median_of},
                                   Aggregate{"stddev", "time", standard_deviation},
                                   Aggregate{"cv", "percentage", variation}};

/// The figures of a row for which statistics are computed.
constexpr std::array figures = {&BenchmarkPart::real_microseconds, &BenchmarkPart::cpu_microseconds,
                                &BenchmarkPart::particle_updates_per_second,
                                &BenchmarkPart::spring_updates_per_second,
                                &BenchmarkPart::host_seconds_per_step};

BenchmarkPart part_of(const Repetition& repetition, const Workpiece& piece) {
    BenchmarkPart part;
    const double steps = piece.steps;
    part.iterations = piece.steps;
    part.real_microseconds = 1e6 * repetition.device_seconds / steps;
    part.cpu_microseconds = 1e6 * repetition.cpu_seconds / steps;
    part.particle_updates_per_second = double(piece.particles) * steps / repetition.device_seconds;
    part.spring_updates_per_second = double(piece.springs) * steps / repetition.device_seconds;
    part.host_seconds_per_step = repetition.host_seconds / steps;
    return part;
}

}  // namespace

nlohmann::json google_benchmark_context() {
    const benchmark::CPUInfo& cpu = benchmark::CPUInfo::Get();
    nlohmann::json context = {{"date", fmt::format("{:%FT%T}+00:00", fmt::gmtime(std::time(nullptr)))},
                              {"executable", "voxspring"},
                              // Google Benchmark also counts processors that this process may not use.
                              {"num_cpus", omp_get_num_procs()},
                              {"mhz_per_cpu", std::llround(cpu.cycles_per_second / 1e6)},
                              {"caches", nlohmann::json::array()},
                              {"load_avg", cpu.load_avg},
#ifdef NDEBUG
                              {"library_build_type", "release"}};
#else
                              {"library_build_type", "debug"}};
#endif
    if (cpu.scaling != benchmark::CPUInfo::UNKNOWN)
        context["cpu_scaling_enabled"] = cpu.scaling == benchmark::CPUInfo::ENABLED;
    for (const auto& cache : cpu.caches) {
        context["caches"].push_back({{"type", cache.type},
                                     {"level", cache.level},
                                     {"size", cache.size},
                                     {"num_sharing", cache.num_sharing}});
    }
    return context;
}

std::vector<Row> google_benchmark_rows(const Row& common, const std::vector<Repetition>& repetitions,
                                       int family) {
    const Workpiece& piece = common.workpiece.value();
    const int count = int(repetitions.size());
    const std::string run_name = common.identity.name + "/iterations:" + std::to_string(piece.steps) +
                                 "/repeats:" + std::to_string(count) + "/manual_time";
    std::vector<Row> rows;
    const auto add = [&](BenchmarkPart part, const std::string& suffix) {
        part.run_name = run_name;
        part.repetitions = count;
        part.family_index = family;
        Row row = common;
        row.identity.name = run_name + suffix;
        if (row.limit && row.limit->seconds && part.is_time() && part.real_microseconds > 0)
            row.limit->fraction = *row.limit->seconds / (1e-6 * part.real_microseconds);
        row.benchmark = std::move(part);
        rows.push_back(std::move(row));
    };
    std::vector<BenchmarkPart> parts;
    for (const Repetition& repetition : repetitions) parts.push_back(part_of(repetition, piece));
    for (int i = 0; i < count; ++i) {
        BenchmarkPart part = parts[std::size_t(i)];
        part.repetition_index = i;
        add(part, "");
    }
    if (count < 2) return rows;
    for (const Aggregate& aggregate : aggregates) {
        BenchmarkPart part;
        part.run_type = "aggregate";
        part.aggregate_name = aggregate.name;
        part.aggregate_unit = aggregate.unit;
        part.iterations = count;
        for (const auto figure : figures) {
            std::vector<double> values;
            for (const BenchmarkPart& one : parts) values.push_back(one.*figure);
            part.*figure = aggregate.of(values);
        }
        add(part, std::string("_") + aggregate.name);
    }
    return rows;
}

}  // namespace voxspring
