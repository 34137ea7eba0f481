#include "backends/glsl/limits.h"

#include <array>

namespace voxspring::glsl {
namespace {

constexpr CopyPass copies[] = {{2, false, false}, {2, true, false}, {2, true, true}, {1, true, false}};

/// Multiply-adds per second. Each invocation makes as many rounds of them as the uniform `rounds` says.
template <class Real>
double operations_per_second(Device& device, Precision precision) {
    constexpr auto side = std::size_t(arithmetic_side);
    constexpr auto groups = unsigned(arithmetic_side / arithmetic_group);
    const auto sums = device.make_zeros(side * side * 4 * sizeof(Real));
    Uniforms uniforms;
    uniforms.set("factor", Real(0.5));
    const auto pass =
        device.pass({.file = "limits_arithmetic", .precision = precision}, uniforms, {{0, sums.get()}});
    const double seconds_of_rounds = min_seconds([&](int count) {
        uniforms.set("rounds", rounds * count);
        device.set(*pass, uniforms);
        return device.seconds_of({{pass, {groups, groups, 1}}}, 1);
    });
    return double(side * side) * rounds * operations_per_round / seconds_of_rounds;
}

}  // namespace

double measure_launch(Device& device) {
    constexpr std::size_t group = 32;  // as in limits_launch.comp
    std::array<std::unique_ptr<Array>, 3> arrays;
    std::vector<Dispatch> cycle;
    for (std::unique_ptr<Array>& array : arrays) {
        array = device.make_zeros(group * copied_word);
        cycle.push_back(
            {device.pass({.file = "limits_launch", .precision = Precision::float32}, {}, {{0, array.get()}}),
             glm::uvec3(1)});
    }
    return min_seconds([&](int count) { return device.seconds_of(cycle, count); }, launch_patience);
}

DeviceLimits measure_limits(Device& device) {
    DeviceLimits limits;
    measure_bandwidth(limits, copies, [&](const CopyPass& pass, std::size_t words) {
        const std::size_t bytes = words * copied_word;
        std::array<std::unique_ptr<Array>, 3> arrays;
        Arrays bound;
        for (unsigned n = 0; n < arrays.size(); ++n) {
            arrays[n] = device.make_zeros(bytes);
            bound[n] = arrays[n].get();
        }
        Uniforms uniforms;
        uniforms.set("impossible", -1.0F);
        const Shader shader{.file = "limits_copy",
                            .constants = {{"READS", std::to_string(pass.reads)},
                                          {"WRITES", text(pass.writes)},
                                          {"IN_PLACE", text(pass.in_place)}},
                            .precision = Precision::float32};
        const std::vector<Dispatch> copy = {
            {device.pass(shader, uniforms, bound), glm::uvec3(words / copy_group, 1, 1)}};
        return min_seconds([&](int count) { return device.seconds_of(copy, count); }, one_of_many(bytes));
    });
    limits.launch_seconds = measure_launch(device);
    limits.float32_operations_per_second = operations_per_second<float>(device, Precision::float32);
    if (device.has_float64())
        limits.float64_operations_per_second = operations_per_second<double>(device, Precision::float64);
    return limits;
}

}  // namespace voxspring::glsl
