// Scenes in units of the world: what follows from a modulus and a density, and whether the body then behaves
// like the continuum, at any pitch.
#include "harness/scene/units.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "backends/physics/neighbours.h"
#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/scene/corners.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"
#include "harness/verification/conserved.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr SceneSizeLimits limits{100000, 10000};

Scene parse(const std::string& text) { return parse_scene(text, "scene", limits); }

/// A scene of a box, in mm and with a spacing of 2.
std::string box_text(const std::string& keys) {
    return R"({"dataset": {"type": "box", "dims": [4, 3, 2]}, "spacing": 2, "unit": "mm", )" + keys + "}";
}
Scene box_with(const std::string& keys) { return parse(box_text(keys)); }

TEST(Units, SpringsMassesGravityAndLoadsFollow) {
    const Scene scene = box_with(
        R"("young": "5 kPa", "density": "1.05 g/cm3", "gravity": {"toward": "z-", "strength": 9.81},
           "loads": [{"voxel": [0, 0, 0], "force": [2, 0, 0]}], "damping": {"per_second": 30})");
    const Problem& problem = scene.problem;
    EXPECT_DOUBLE_EQ(problem.group_stiffness[0], 5000 * 0.002 / 2.5);  // N/m
    EXPECT_DOUBLE_EQ(problem.group_stiffness[1], problem.group_stiffness[0]);
    EXPECT_DOUBLE_EQ(problem.load[0].x, 2000);  // 2 N in kg mm / s^2
    // x'' + c x' = f / m + gravity; the step divides the right side by 1 + c dt / 2, and this is made up for.
    const double g = 30 * problem.time_step / 2;
    EXPECT_DOUBLE_EQ(problem.damping, 2 * g / (1 + g));
    EXPECT_DOUBLE_EQ(problem.materials[0].mass / (1 + g), 1050 * 8e-9);
    EXPECT_DOUBLE_EQ(problem.gravity.z * (1 + g), -9810);
    EXPECT_NEAR(scene.stable_time_step, stable_time_step(problem), 1e-12 * scene.stable_time_step);
    ASSERT_TRUE(scene.world);
    EXPECT_NEAR(scene.world->tissues[0].pressure_wave(), std::sqrt(1.2 * 5000 / 1050), 1e-12);
    EXPECT_NEAR(scene.world->tissues[0].shear_wave(), std::sqrt(0.4 * 5000 / 1050), 1e-12);
    EXPECT_THAT(scene.notes, ::testing::Contains(HasSubstr("up to 4 N/m and particles up to 8.4e-06 kg")));
    EXPECT_EQ(scene.world->force(), "mN");
}

TEST(Units, RefusesWhatDoesNotMakeAMaterial) {
    const auto refuses_scene = [](const std::string& text, const std::string& why) {
        EXPECT_THAT([&] { (void)parse(text); }, ThrowsMessage<BadInput>(HasSubstr(why))) << text;
    };
    const auto refuses = [&](const std::string& keys, const std::string& why) {
        refuses_scene(box_text(keys), why);
    };
    refuses(R"("young": 5000)", "density");
    refuses(R"("density": 1000)", "together with \"young\"");
    refuses(R"("damping": 0)", "together with \"young\"");  // the unit alone
    refuses(R"("young": 5000, "density": 1000, "stiffness": 1)", "stiffness");
    refuses(R"("young": 5000, "density": 1000, "mass": 1)", "mass");
    refuses(R"("young": "5 bar", "density": 1000)", "kPa");
    refuses(R"("young": -5, "density": 1000)", "kPa");
    refuses(R"("young": "1e4 GPa", "density": 1000)", "1e12 Pa");
    // The options --young and --density take these texts as they are.
    for (const char* text : {"1e308 GPa", "1e300", "1e4 GPa", "1e-13", "0", "nan"})
        EXPECT_FALSE(pascals_of(text)) << text;
    EXPECT_FALSE(kilograms_per_cubic_metre_of("1e10 g/cm3"));
    refuses(R"("young": 5000, "density": "1 kg")", "g/cm3");
    refuses(R"("young": 5000, "density": 1000, "spring_groups": ["face"])", "face and edge");
    // Face and corner springs alone can be isotropic, but leave motions that strain none of them.
    refuses(R"("young": 5000, "density": 1000, "spring_groups": ["face", "corner"])", "face and edge");
    const std::string box =
        R"({"dataset": {"type": "box", "dims": [2, 2, 2]}, "young": 5000, "density": 1000)";
    refuses_scene(box + R"(, "spacing": [1, 1, 2], "unit": "mm"})", "cubes");
    refuses_scene(box + "}", "unit");
    refuses(R"("damping": {"per_second": -1}, "young": 5000, "density": 1000)", "damping");
}

/// The energy of a homogeneous strain, which is the same in every voxel, against that of an isotropic
/// continuum of E = 3 and nu = 1/4 of the same volume.
void expect_energy_of_the_continuum(std::uint32_t group_bits, unsigned seed) {
    constexpr double young = 3, spacing = 0.5;
    const VoxelGrid grid = [&] {
        VoxelGrid random = random_grid({5, 4, 6}, 0.6, seed);
        random.spacing = glm::dvec3(spacing);
        return random;
    }();
    const double volume =
        std::pow(spacing, 3) * double(std::count(grid.label.begin(), grid.label.end(), std::uint8_t(1)));
    Problem problem =
        make_corner_problem(grid, group_bits, {{1, isotropic_stiffness(young, spacing, group_bits).value()}});
    problem.time_step = 1;  // any: nothing moves
    std::mt19937 generator(seed);
    // So small that the energy of the springs' rotations, of the next order, is far below the tolerance.
    std::uniform_real_distribution<double> uniform(-1e-6, 1e-6);
    glm::dmat3 strain;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j <= i; ++j) strain[i][j] = strain[j][i] = uniform(generator);
    }
    State state = state_at_rest(problem);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        state.displacement[i] = strain * problem.rest_position[i];
    const double trace = strain[0][0] + strain[1][1] + strain[2][2];
    double squares = 0;
    for (int i = 0; i < 3; ++i) squares += glm::dot(strain[i], strain[i]);
    const double lame = 0.4 * young;  // both of Lame's constants
    const double expected = volume * (lame / 2 * trace * trace + lame * squares);
    const Energy strained = energy(problem, state);
    EXPECT_NEAR(strained.springs / expected, 1, 1e-5);
    EXPECT_EQ(strained.kinetic, 0);
}

// Also on a body that is nothing but surface. This determines E and nu, and the share of each surface spring.
TEST(Units, AStrainedBodyHasTheEnergyOfTheContinuum) {
    for (unsigned seed = 1; seed <= 4; ++seed) {
        expect_energy_of_the_continuum(FACE_BITS | EDGE_BITS, seed);
        expect_energy_of_the_continuum(NEIGHBOUR_BITS, seed);
    }
}

TEST(Units, ParticlesAtCornersWeighWhatTheVoxelsWeigh) {
    const VoxelGrid grid = random_grid({4, 5, 3}, 0.5, 3, 2);
    const std::vector<VoxelMaterial> materials = {{2, {4, 4, 4}}, {3, {1, 1, 1}}};
    const Problem problem = make_corner_problem(grid, FACE_BITS | EDGE_BITS, materials);
    double voxels = 0, particles = 0;
    for (const std::uint8_t label : grid.label) voxels += label == 0 ? 0 : materials[label - 1U].mass;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) particles += problem.material_of(i).mass;
    EXPECT_NEAR(particles, voxels, 1e-12 * voxels);
}

// The order in which masses are summed would else make several masses of one, and more than 254 are refused.
TEST(Units, CornersOfTheSameVoxelsHaveTheSameMass) {
    const std::vector<VoxelMaterial> materials = {
        {1.0567, {1, 1, 1}}, {1.0531, {2, 2, 2}}, {0.9213, {3, 3, 3}}};
    const Problem problem =
        make_corner_problem(random_grid({20, 20, 20}, 0.75, 1, 3), FACE_BITS | EDGE_BITS, materials);
    // The number of ways to choose up to eight voxels of three materials, without the empty choice.
    EXPECT_LE(problem.materials.size(), 164U);
}

// --- The same modulus at three pitches -----------------------------------------------------------------

/// How far the end of a clamped bar of 12 x 12 x 48 mm sags under its own weight, in mm, with `across` voxels
/// in its width.
double sag(Backend& backend, int across, const std::string& particles) {
    // The slowest motion is damped critically: omega = 3.516 sqrt(E I / (density A)) / L^2.
    constexpr double young = 3e6, density = 1000, width = 0.012, length = 0.048;
    const double slowest = 3.516 * std::sqrt(young / density / 12) * width / (length * length);
    const Scene scene =
        parse_scene(fmt::format(R"({{"dataset": {{"type": "box", "dims": [{0}, {0}, {1}]}}, "spacing": {2},
            "unit": "mm", "young": "3 MPa", "density": {3}, "particles": "{4}",
            "gravity": {{"toward": "x+", "strength": 9.81}}, "damping": {{"per_second": {5}}},
            "pinned": {{"side": "z-"}}}})",
                                across, 4 * across, 12.0 / across, density, particles, 2 * slowest),
                    "bar", limits);
    const Problem& problem = scene.problem;
    backend.upload(problem, scene.state);
    backend.step(int(14 / (slowest * problem.time_step)));  // e^-14 is 1e-6
    const State state = backend.download();
    double sum = 0, mass = 0;
    const double end = problem.rest_position.back().z;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (problem.rest_position[i].z < end) continue;
        sum += problem.material_of(i).mass * state.displacement[i].x;
        mass += problem.material_of(i).mass;
    }
    return sum / mass;
}

class SameModulus : public ::testing::TestWithParam<std::string> {};

/// Whether the backend takes the springs of a surface with particles at corners.
bool takes_corners(const Backend& backend) {
    return backend
        .unsupported(make_corner_problem(solid({2, 2, 2}), FACE_BITS | EDGE_BITS, {VoxelMaterial{}}))
        .empty();
}

TEST_P(SameModulus, SagsAlikeAtEveryPitch) {
    std::unique_ptr<Backend> backend;
    make_or_skip(GetParam(), backend);
    if (backend == nullptr) return;
    // results/continuum.py, for weight 0.2e-2 / 48 of E / width; it is proportional to the weight for small
    // strain, which is below 0.3% here.
    constexpr double weight = 1000 * 9.81 * 0.012 / 3e6;
    const double continuum = 0.01675003 / (0.2e-2 / 48) * weight * 12;
    const bool corners = takes_corners(*backend);
    std::vector<double> errors;
    for (const int across : {2, 3, 4})
        errors.push_back(std::abs(sag(*backend, across, corners ? "corners" : "centres") / continuum - 1));
    const double order = std::log2(errors[0] / errors[2]);
    const std::string list = fmt::format("{}, {}, {}", errors[0], errors[1], errors[2]);
    EXPECT_GT(errors[0], errors[1]) << list;
    EXPECT_GT(errors[1], errors[2]) << list;
    // `study truth` states 1.75 and 1 at finer pitches; at these the orders are 1.62 and 1.70. With a modulus
    // that is off by 5% the first one is 1.1 or 3.2.
    EXPECT_GT(order, corners ? 1.4 : 1) << list;
    EXPECT_LT(order, 2) << list;
}

INSTANTIATE_TEST_SUITE_P(, SameModulus,
                         ::testing::Values("cpu_explicit", "cpu_parallel", "gl_compute_explicit",
                                           "gl_fragment_explicit", "gl_compute_implicit", "vulkan_explicit",
                                           "vulkan_implicit"),
                         test_name);

}  // namespace
}  // namespace voxspring::testing
