// The oracle, and with it every backend that this machine can run, against closed forms and symmetries.
// With VOXSPRING_REQUIRE (required.h) missing devices are failures instead of skips.
//
// The closed forms are those of the discrete recurrence, not of the differential equation, so that only
// rounding is left. The bound is rounding_tolerance() (harness/verification/verify.h) unless a test says
// otherwise.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

class Physics : public BackendTest {
protected:
    State run(const Problem& problem, const State& start, int steps) {
        EXPECT_EQ(backend->unsupported(problem), "");
        return stepped(*backend, problem, start, steps);
    }

    void expect_close(const Problem& problem, const State& state, const State& expected, int steps) {
        const Comparison comparison = compare(problem, state, expected, spec.options.precision, steps);
        EXPECT_TRUE(comparison.passed()) << "after " << steps << " steps: " << comparison.reason;
    }
};

/// z_{n+1} = z_n + (1 - lambda)(z_n - z_{n-1}) - w z_n is the integrator's form of z'' = -omega^2 z with w =
/// (omega dt)^2. Its solution is z_n = rho^n (a cos n phi + b sin n phi), rho^2 = 1 - lambda, cos phi = (2 -
/// lambda - w) / (2 rho).
struct Oscillator {
    double rho, phi, a, b;

    Oscillator(double w, double lambda, double z0, double z_before)
        : rho(std::sqrt(1 - lambda)), phi(std::acos((2 - lambda - w) / (2 * rho))), a(z0) {
        // z_{-1} = (a cos phi - b sin phi) / rho
        b = (a * std::cos(phi) - rho * z_before) / std::sin(phi);
    }
    double at(int n) const { return std::pow(rho, n) * (a * std::cos(n * phi) + b * std::sin(n * phi)); }
};

TEST_P(Physics, OneSpringOscillatesAtTheDiscreteFrequencyOfVerlet) {
    Problem problem = make_lattice_problem(solid({2, 1, 1}), FACE_BITS);
    problem.group_stiffness = {3, 1, 1};
    problem.materials = {{0.5, 1}};
    problem.time_step = 0.2;
    // The stretch s of the spring obeys s'' = -(2 k / m) s.
    const double omega = std::sqrt(2 * 3 / 0.5);
    const double phi = 2 * std::asin(omega * problem.time_step / 2);
    const double amplitude = 0.1;
    State start = state_at_rest(problem);
    start.displacement = {{-amplitude / 2, 0, 0}, {amplitude / 2, 0, 0}};
    const double first_step = amplitude * (1 - std::cos(phi)) / 2;  // from s_{-1} = A cos(phi)
    start.increment = {{-first_step, 0, 0}, {first_step, 0, 0}};
    for (const int steps : {1, 2, 3, 10, 100, 1000}) {
        State expected = state_at_rest(problem);
        const double stretch = amplitude * std::cos(steps * phi);
        expected.displacement = {{-stretch / 2, 0, 0}, {stretch / 2, 0, 0}};
        expect_close(problem, run(problem, start, steps), expected, steps);
    }
}

TEST_P(Physics, APinnedSpringWithMassOscillatesDampedAboutItsEquilibrium) {
    for (const double lambda : {0.0, 0.01, 0.3}) {
        Problem problem = make_lattice_problem(solid({1, 1, 2}), FACE_BITS);
        pin_base(problem);
        problem.group_stiffness = {2, 1, 1};
        problem.materials = {{1.5, 1}};
        problem.gravity = {0, 0, -0.05};
        problem.damping = lambda;
        problem.time_step = 0.3;
        const double sag = -0.05 * 1.5 / 2;
        State start = state_at_rest(problem);
        start.displacement[1].z = 0.02;
        start.increment[1].z = 0.003;
        const Oscillator z(2 / 1.5 * 0.3 * 0.3, lambda, 0.02 - sag, 0.02 - 0.003 - sag);
        for (const int steps : {1, 2, 3, 10, 100, 1000}) {
            State expected = state_at_rest(problem);
            expected.displacement[1].z = sag + z.at(steps);
            expect_close(problem, run(problem, start, steps), expected, steps);
        }
    }
}

TEST_P(Physics, AnUnstructuredSpringIsTheSame) {
    Problem problem;
    problem.rest_position = {{0.5, 0, 0}, {0.5, 2, 0}};
    problem.springs = {{0, 1, 3, 2}};
    problem.time_step = 0.2;
    if (const std::string why = backend->unsupported(problem); !why.empty()) GTEST_SKIP() << why;
    State start = state_at_rest(problem);
    start.displacement[0].y = -0.05;
    start.displacement[1].y = 0.05;
    const Oscillator stretch(2 * 3 * 0.2 * 0.2, 0, 0.1, 0.1);
    for (const int steps : {1, 10, 100}) {
        State expected = state_at_rest(problem);
        expected.displacement[0].y = -stretch.at(steps) / 2;
        expected.displacement[1].y = stretch.at(steps) / 2;
        expect_close(problem, run(problem, start, steps), expected, steps);
    }
}

TEST_P(Physics, TheShortestWaveHasTheFrequencyOfTheInfiniteLattice) {
    // u = (-1)^x A along x is the wave q = (pi, 0, 0) of the highest frequency: omega^2 = 4 k1 + 8 k2 + 16/3
    // k3. The influence of the border travels by one voxel per step and does not reach the centre before step
    // 8.
    const glm::ivec3 dims(17);
    const int steps = 7;
    // Springs across the wave are geometrically nonlinear. At first order this cancels between opposite
    // neighbours; a strain of 2 A squared remains, against an acceleration of 4 A. And displacements this
    // small must exceed the rounding of positions.
    const double amplitude = spec.options.precision == Precision::float32 ? 5e-3 : 1e-4;
    const std::vector<std::array<double, 3>> stiffnesses = {
        {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0}, {1, 0.5, 0.25}};
    for (const auto& k : stiffnesses) {
        const std::uint32_t groups =
            (k[0] > 0 ? FACE_BITS : 0u) | (k[1] > 0 ? EDGE_BITS : 0u) | (k[2] > 0 ? CORNER_BITS : 0u);
        Problem problem = make_lattice_problem(solid(dims), groups);
        if (!backend->unsupported(problem).empty() && (groups & CORNER_BITS) != 0) continue;
        problem.group_stiffness = k;
        const double omega_squared = 4 * k[0] + 8 * k[1] + 16.0 / 3 * k[2];
        problem.time_step = 0.8 * 2 / std::sqrt(omega_squared);
        State start = state_at_rest(problem);
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            start.displacement[i].x = int(problem.rest_position[i].x) % 2 == 0 ? amplitude : -amplitude;
        }
        const State end = run(problem, start, steps);
        const Oscillator wave(omega_squared * problem.time_step * problem.time_step, 0, amplitude, amplitude);
        const auto centre = std::size_t((8 * 17 + 8) * 17 + 8);
        ASSERT_EQ(problem.rest_position[centre], glm::dvec3(8));
        const double tolerance = double(steps * steps) * amplitude * 4 * amplitude * amplitude +
                                 rounding_tolerance(problem, end, spec.options.precision, steps);
        ASSERT_LT(tolerance, amplitude / 40) << "too loose to tell a frequency";
        EXPECT_NEAR(end.displacement[centre].x, wave.at(steps), tolerance);
        EXPECT_NEAR(end.displacement[centre].y, 0, tolerance);
        EXPECT_NEAR(end.displacement[centre].z, 0, tolerance);
    }
}

TEST_P(Physics, ParticlesWithoutSpringsFallFreely) {
    for (const double lambda : {0.0, 0.05}) {
        Problem problem = make_lattice_problem(
            make_grid({6, 5, 4}, [](int x, int y, int z) { return (x + y + z) % 2; }), FACE_BITS);
        ASSERT_EQ(count_springs(problem).total(), 0u);
        problem.materials = {{2, 1}};
        problem.gravity = {0.01, 0, -0.02};
        problem.damping = lambda;
        problem.time_step = 0.5;
        problem.load.assign(problem.particle_count(), glm::dvec3(0));
        problem.load[7] = {0, 0.1, 0};
        if (!backend->unsupported(problem).empty()) problem.load.clear();
        const State start = random_state(problem, 0.1, 21);
        const int steps = 50;
        // The increment v obeys v_n = (1 - lambda) v_{n-1} + a dt^2.
        double retained = 1, sum_retained = 0, sum_acceleration = 0, weight = 0;
        for (int n = 1; n <= steps; ++n) {
            weight = weight * (1 - lambda) + 1;
            retained *= 1 - lambda;
            sum_retained += retained;
            sum_acceleration += weight;
        }
        if (lambda == 0) {
            EXPECT_EQ(sum_acceleration, steps * (steps + 1) / 2);
        }
        State expected = start;
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const glm::dvec3 load = problem.load.empty() ? glm::dvec3(0) : problem.load[i];
            const glm::dvec3 acceleration = problem.gravity + load / 2.0;
            expected.displacement[i] +=
                start.increment[i] * sum_retained + acceleration * 0.25 * sum_acceleration;
        }
        expect_close(problem, run(problem, start, steps), expected, steps);
    }
}

// The tool's force on a free body is the body's gain of momentum in each step.
TEST_P(Physics, TheForceOnTheToolIsWhatItsBodyGains) {
    Problem problem = make_lattice_problem(random_grid({9, 8, 7}, 0.8, 22), FACE_BITS | EDGE_BITS);
    problem.materials = {{2, 1}};
    problem.time_step = 0.3;
    take_hold(problem, {.particles = {3, 4, 50, 51, 120}, .held = {}, .stiffness = 0.5});
    if (!backend->unsupported(problem).empty()) GTEST_SKIP() << backend->unsupported(problem);
    const State start = random_state(problem, 0.05, 23);
    backend->upload(problem, start);
    glm::dvec3 momentum(0);
    for (const glm::dvec3& v : start.increment) momentum += 2.0 / problem.time_step * v;
    for (int step = 1; step <= 20; ++step) {
        backend->tool()->move_tool(glm::dvec3(0.02, 0.01, -0.005) * double(step));
        backend->step(1);
        const State now = backend->download();
        glm::dvec3 then(0);
        for (const glm::dvec3& v : now.increment) then += 2.0 / problem.time_step * v;
        // On positions each increment is off by two roundings, in the worst case in the same direction.
        const double tolerance = 2 / problem.time_step * double(problem.particle_count()) *
                                 rounding_tolerance(problem, now, spec.options.precision, 1) /
                                 problem.time_step;
        EXPECT_LT(glm::distance((then - momentum) / problem.time_step, -backend->tool()->tool_force()),
                  tolerance);
        EXPECT_GT(glm::length(backend->tool()->tool_force()), 0.01);
        momentum = then;
    }
}

TEST_P(Physics, ALatticeAtRestStaysAtRest) {
    for (const double lambda : {0.0, 0.01}) {
        Problem problem = make_lattice_problem(random_grid({19, 8, 7}, 0.8, 22), NEIGHBOUR_BITS);
        if (!backend->unsupported(problem).empty())
            problem = make_lattice_problem(random_grid({19, 8, 7}, 0.8, 22), FACE_BITS | EDGE_BITS);
        problem.damping = lambda;
        problem.time_step = 0.3;
        const State rest = state_at_rest(problem);
        const State end = run(problem, rest, 200);
        // The bits are exact if the square root is rounded correctly, since every spring between integer
        // coordinates then measures its rest length. OpenGL does not guarantee that.
        if (backend->capabilities().api == "CPU") {
            expect_same_bits(end, rest);
        } else {
            expect_close(problem, end, rest, 200);
        }
    }
}

TEST_P(Physics, UndampedMotionRunsBackwards) {
    Problem problem = make_lattice_problem(random_grid({8, 7, 6}, 0.8, 27), FACE_BITS | EDGE_BITS);
    pin_base(problem);
    problem.gravity = {0, 0.01, -0.02};
    problem.time_step = 0.2;
    const State start = random_state(problem, 0.05, 28);
    const int steps = 60;
    State end = run(problem, start, steps);
    // Verlet is symmetric in x_{n+1} and x_{n-1}: start again from x_{n-1} with x_n behind it.
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        end.displacement[i] -= end.increment[i];
        end.increment[i] = -end.increment[i];
    }
    expect_close(problem, run(problem, end, steps - 1), start, 2 * steps);
}

TEST_P(Physics, CoincidentParticlesStayFinite) {
    Problem problem = make_lattice_problem(solid({2, 1, 1}), FACE_BITS);
    problem.time_step = 0.2;
    State start = state_at_rest(problem);
    start.displacement[1].x = -1;
    // There is no direction to push in, so they stay where they are.
    EXPECT_EQ(run(problem, start, 10).displacement, start.displacement);

    problem = make_lattice_problem(solid({5, 5, 5}), NEIGHBOUR_BITS);
    if (!backend->unsupported(problem).empty())
        problem = make_lattice_problem(solid({5, 5, 5}), FACE_BITS | EDGE_BITS);
    problem.damping = 0.05;
    problem.time_step = 0.2;
    start = state_at_rest(problem);
    start.displacement[62].x = 1;  // moves the centre onto its neighbour
    const State end = run(problem, start, 100);
    for (const glm::dvec3& u : end.displacement) {
        ASSERT_TRUE(std::isfinite(u.x) && std::isfinite(u.y) && std::isfinite(u.z));
        // Springs with the energy of one voxel's displacement move no particle far.
        EXPECT_LT(glm::length(u), 2);
    }
}

std::vector<std::string> every_backend() {
    std::vector<std::string> specs;
    for (const auto& [name, entry] : registry()) {
        for (const Precision precision : entry.precisions) {
            specs.push_back(name + ":precision=" + to_string(precision));
        }
    }
    return specs;
}

INSTANTIATE_TEST_SUITE_P(Backends, Physics, ::testing::ValuesIn(every_backend()), test_name);

}  // namespace
}  // namespace voxspring::testing
