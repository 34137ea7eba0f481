// The oracle against what shares no code with it: closed forms, conservation laws of its integrator, beam
// theory and another simulator. Formulas of the model are written out here; spring.h is not used.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/gtc/constants.hpp>
#include <glm/mat3x3.hpp>
#include <memory>
#include <string>
#include <vector>

#include "backends/cpu/perturbed_reference.h"
#include "backends/disk_cache.h"
#include "backends/registry.h"
#include "harness/verification/reference.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

/// The references that results are compared with: the plain one in its formulations, and the one on all
/// cores.
std::unique_ptr<Backend> oracle(const std::string& name) {
    if (name == parallel_reference_name) return make_perturbed_reference({});
    return BackendSpec::parse("cpu_reference:formulation=" + name).make();
}

glm::dvec3 position(const Problem& problem, const State& state, std::size_t i) {
    return problem.rest_position[i] + state.displacement[i];
}

/// The state in which every particle is at `now(i)` and was at `before(i)` one step ago.
template <class Now, class Before>
State state_at(const Problem& problem, Now now, Before before) {
    State state = state_at_rest(problem);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        state.displacement[i] = now(i) - problem.rest_position[i];
        state.increment[i] = now(i) - before(i);
    }
    return state;
}

glm::dmat3 rotation(glm::dvec3 axis, double angle) {
    axis = glm::normalize(axis);
    const double c = std::cos(angle), s = std::sin(angle);
    const glm::dmat3 cross(0, axis.z, -axis.y, -axis.z, 0, axis.x, axis.y, -axis.x, 0);
    return c * glm::dmat3(1.0) + s * cross + (1 - c) * glm::outerProduct(axis, axis);
}

class Oracle : public ::testing::TestWithParam<std::string> {
protected:
    const std::unique_ptr<Backend> backend = oracle(GetParam());
};
INSTANTIATE_TEST_SUITE_P(, Oracle,
                         ::testing::Values("increment", "position", "displacement", "compensated",
                                           parallel_reference_name));

// --- Closed forms at large amplitude ---------------------------------------------------------------------

/// Two particles of mass m on a spring that circle their centre by an angle a per step. The scheme's second
/// difference of a circle of radius r is -2 (1 - cos a) r. The spring's pull k (2 r - l) dt^2 / m has to
/// equal it, so r = k l dt^2 / (2 (k dt^2 - m (1 - cos a))). The orbit is exact, not an approximation for
/// small steps.
TEST_P(Oracle, ARotatingStretchedPairStaysOnItsCircle) {
    constexpr double mass = 1.5, stiffness = 2, angle = 0.2, time_step = 0.3;
    Problem problem = make_lattice_problem(solid({2, 1, 1}), FACE_BITS);
    problem.materials = {{mass, stiffness}};
    problem.group_stiffness = {stiffness, stiffness, stiffness};
    problem.time_step = time_step;
    const double pull = stiffness * time_step * time_step;
    const double radius = pull / (2 * (pull - mass * (1 - std::cos(angle))));
    ASSERT_GT(2 * radius, 1.15) << "stretched by more than a seventh";
    const glm::dvec3 centre = problem.rest_position[0] + glm::dvec3(0.5, 0.25, -0.125);
    const auto at = [&](double step, std::size_t i) {
        const double phase = angle * step + (i == 0 ? glm::pi<double>() : 0);
        return centre + radius * glm::dvec3(std::cos(phase), 0.6 * std::sin(phase), 0.8 * std::sin(phase));
    };
    const State start = state_at(
        problem, [&](std::size_t i) { return at(0, i); }, [&](std::size_t i) { return at(-1, i); });
    constexpr int steps = 1000;  // 32 turns
    const State end = stepped(*backend, problem, start, steps);
    for (const std::size_t i : {0, 1}) {
        // Rounding in float64, 1e-16 per step, summed twice in the worst case: 1e-10.
        EXPECT_LT(glm::length(position(problem, end, i) - at(steps, i)), 1e-9) << i;
    }
}

/// A mass on a spring under gravity along z, swinging in all three dimensions through large angles.
struct ElasticPendulum {
    explicit ElasticPendulum(double step) {
        problem = make_lattice_problem(solid({1, 1, 2}), FACE_BITS);
        pin_base(problem);
        problem.materials = {{mass, stiffness}};
        problem.group_stiffness = {stiffness, stiffness, stiffness};
        problem.gravity = {0, 0, -gravity};
        problem.time_step = step;
        const glm::dvec3 x(1.1, 0.2, -0.3), velocity(0.1, 0.5, 0.2);
        // The position one step ago to third order; errors of second order do not depend on that.
        const double length = glm::length(x);
        const glm::dvec3 acceleration =
            -stiffness / mass * (length - 1) / length * x + glm::dvec3(0, 0, -gravity);
        before = x - step * velocity + step * step / 2 * acceleration;
        const glm::dvec3 pivot = problem.rest_position[0];
        start = state_at_rest(problem);
        start.displacement[1] = pivot + x - problem.rest_position[1];
        start.increment[1] = x - before;
    }
    /// The position of the mass and its position one step before, relative to the pivot.
    std::pair<glm::dvec3, glm::dvec3> ends(const State& state) const {
        const glm::dvec3 x = position(problem, state, 1) - problem.rest_position[0];
        return {x, x - state.increment[1]};
    }
    double energy(const State& state) const {
        const auto [x, x_before] = ends(state);
        const glm::dvec3 middle = (x + x_before) / 2.0, velocity = state.increment[1] / problem.time_step;
        const double stretch = glm::length(middle) - 1;
        return mass * glm::dot(velocity, velocity) / 2 + stiffness * stretch * stretch / 2 +
               mass * gravity * middle.z;
    }
    static constexpr double mass = 2, stiffness = 5, gravity = 0.7;
    Problem problem;
    State start;
    glm::dvec3 before;
};

/// The force has no moment about the axis through the pivot along gravity. So the scheme keeps the z
/// component of the cross product of x(t - dt) and x(t) exactly.
TEST_P(Oracle, AnElasticPendulumKeepsItsAngularMomentum) {
    const ElasticPendulum pendulum(0.1);
    const auto moment = [&](const State& state) {
        const auto [x, x_before] = pendulum.ends(state);
        return glm::cross(x_before, x).z;
    };
    const double expected = moment(pendulum.start);
    backend->upload(pendulum.problem, pendulum.start);
    for (int n = 0; n < 50; ++n) {
        backend->step(100);
        EXPECT_NEAR(moment(backend->download()) / expected, 1, 1e-11) << n;
    }
}

TEST_P(Oracle, AnElasticPendulumKeepsItsEnergyToSecondOrder) {
    const auto drift = [&](double step) {
        const ElasticPendulum pendulum(step);
        const double expected = pendulum.energy(pendulum.start);
        double worst = 0;
        backend->upload(pendulum.problem, pendulum.start);
        for (int n = 0; n < 400; ++n) {
            backend->step(int(std::lround(0.1 / step)));
            worst = std::max(worst, std::abs(pendulum.energy(backend->download()) - expected));
        }
        return worst;
    };
    const double coarse = drift(0.05), fine = drift(0.025);
    EXPECT_LT(coarse, 0.02) << "of energies of about 1";
    EXPECT_NEAR(coarse / fine, 4, 0.4);
}

// --- Statics ---------------------------------------------------------------------------------------------

/// A hanging chain: the spring above n masses is stretched by n m g / k.
TEST_P(Oracle, AColumnSagsByItsWeight) {
    constexpr int count = 8;
    constexpr double mass = 1.25, stiffness = 3, gravity = 0.06;
    Problem problem = make_lattice_problem(solid({1, 1, count}), FACE_BITS);
    pin_base(problem);
    problem.materials = {{mass, stiffness}};
    problem.group_stiffness = {stiffness, stiffness, stiffness};
    problem.gravity = {0, 0, gravity};  // away from the pinned end
    problem.damping = 0.1;
    problem.time_step = 0.4;
    const State end = stepped(*backend, problem, state_at_rest(problem), 8000);
    double sag = 0;
    for (int i = 1; i < count; ++i) {
        sag += (count - i) * mass * gravity / stiffness;
        // Positions of up to 8 stop changing once a dt^2 is below their last bit, 1e-15. That acceleration is
        // the stiffness of the softest mode, 1 / 50 of a spring, times its remaining error.
        EXPECT_NEAR(end.displacement[std::size_t(i)].z, sag, 1e-11) << i;
        EXPECT_EQ(end.displacement[std::size_t(i)].x, 0);
    }
    ASSERT_GT(sag, 0.5) << "far beyond small strain";
}

// --- Symmetries ------------------------------------------------------------------------------------------

TEST_P(Oracle, ARotatedBodyMovesTheSameWay) {
    Problem problem = make_lattice_problem(random_grid({7, 6, 5}, 0.9, 3), NEIGHBOUR_BITS);
    pin_base(problem);
    problem.gravity = {8e-3, 0, -2e-2};
    problem.time_step = 0.25;
    problem.damping = 0.01;
    const State start = random_state(problem, 0.1, 5);
    const glm::dmat3 turned = rotation({1, 2, -0.5}, 2.1);
    Problem rotated = problem;
    rotated.gravity = turned * problem.gravity;
    const State turned_start = state_at(
        problem, [&](std::size_t i) { return turned * position(problem, start, i); },
        [&](std::size_t i) { return turned * (position(problem, start, i) - start.increment[i]); });
    constexpr int steps = 300;
    const State plain = stepped(*backend, problem, start, steps);
    const State end = stepped(*backend, rotated, turned_start, steps);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        EXPECT_LT(glm::length(position(problem, end, i) - turned * position(problem, plain, i)), 1e-11) << i;
}

TEST_P(Oracle, AFreeBodyKeepsItsMomenta) {
    Problem problem = make_lattice_problem(random_grid({6, 7, 5}, 0.9, 4, 2), FACE_BITS | EDGE_BITS);
    problem.materials = {{1, 1}, {2, 0.5}};
    problem.time_step = 0.25;
    State start = random_state(problem, 0.1, 6);
    for (std::size_t i = 0; i < problem.particle_count(); ++i)
        start.increment[i] += 0.02 * glm::cross(glm::dvec3(0.3, -0.2, 1), problem.rest_position[i]);
    const auto momenta = [&](const State& state) {
        glm::dvec3 linear(0), angular(0);
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const double mass = problem.material_of(i).mass;
            const glm::dvec3 x = position(problem, state, i);
            linear += mass * state.increment[i];
            angular += mass * glm::cross(x - state.increment[i], x);
        }
        return std::pair(linear, angular);
    };
    const auto [linear, angular] = momenta(start);
    const auto [linear_end, angular_end] = momenta(stepped(*backend, problem, start, 2000));
    EXPECT_LT(glm::length(linear_end - linear), 1e-10 * glm::length(linear));
    EXPECT_LT(glm::length(angular_end - angular), 1e-10 * glm::length(angular));
}

// --- Beam theory -----------------------------------------------------------------------------------------

/// A cantilever of side x side x length particles, face and edge springs of stiffness 1, spacing and mass 1.
///
/// Its continuum is isotropic. A strain e stretches a face spring by e_ii and an edge spring in a plane by
/// (e_ii + e_jj) / 2 +- e_ij of its length sqrt(2): the energy of a cell is the sum of e_ii^2 / 2 and, a
/// plane, of (e_ii + e_jj)^2 / 2 + 2 e_ij^2. Hence C11 = 3, C12 = C44 = 1, E = 5 / 2, G = 1, Poisson's ratio
/// 1/4.
struct Cantilever {
    Cantilever(int side, int length) : side_(side), length_(length) {
        problem = make_lattice_problem(solid({side, side, length + 1}), FACE_BITS | EDGE_BITS);
        pin_base(problem);
        problem.time_step = 0.4;
    }
    double tip(const State& state) const { return state.displacement.back().x; }

    /// The tip's deflection by gravity g across: w L^4 / (8 E I) + w L^2 / (2 kappa G A), w = A g. The beam
    /// counts as thick as its number of layers, each of which stands for half a spacing on either side.
    double theory_deflection(double gravity) const {
        const double l = length_, a = side_ * side_;
        return a * gravity * (l * l * l * l / (8 * 2.5 * inertia()) + l * l / (2 * kappa * a));
    }
    /// Angular frequency of the first mode: Euler's, 1.8751^2 / L^2 sqrt(E I / A), less the share that shear
    /// and rotary inertia take (Timoshenko; to first order in (r / L)^2, r^2 = I / A, with Huang's
    /// coefficients of a cantilever's first mode: 1 - (r / L)^2 (c_r + c_s E / (kappa G)) / 2, from
    /// Rayleigh's quotient of its shape).
    double theory_frequency() const {
        const double l = length_, a = side_ * side_;
        const double euler = 1.875104 * 1.875104 / (l * l) * std::sqrt(2.5 * inertia() / a);
        const double slenderness = inertia() / (a * l * l);
        // Integrals of Euler's shape w: that of w'^2 over that of w^2 is 4.648, of w'''^2 over w''^2
        // likewise.
        constexpr double ratio = 4.648;
        return euler / std::sqrt(1 + slenderness * ratio * (1 + 2.5 / kappa));
    }
    double inertia() const { return std::pow(side_, 4) / 12; }

    static constexpr double kappa =
        5 * (1 + 0.25) / (6 + 5 * 0.25);  // of a rectangle (Cowper without warping)
    int side_, length_;
    Problem problem;
};

double measured_deflection(Backend& backend, Cantilever beam, double gravity) {
    beam.problem.gravity = {gravity, 0, 0};
    // About critical for the first mode; ten of its time constants.
    const double omega = beam.theory_frequency();
    beam.problem.damping = std::min(1.0, 2 * omega * beam.problem.time_step);
    const int steps = int(14 / (omega * beam.problem.time_step));
    return beam.tip(stepped(backend, beam.problem, state_at_rest(beam.problem), steps));
}

double measured_frequency(Backend& backend, Cantilever beam) {
    State start = state_at_rest(beam.problem);
    for (std::size_t i = 0; i < start.displacement.size(); ++i) {
        // Close to the first mode; small enough to be linear.
        const double z = beam.problem.rest_position[i].z - beam.problem.rest_position[0].z;
        const double s = 1.875104 * z / beam.length_;
        start.displacement[i].x =
            1e-6 * (std::cosh(s) - std::cos(s) - 0.734096 * (std::sinh(s) - std::sin(s)));
    }
    // The mean over the beam, in which higher modes are hardly present, passes zero after a quarter and three
    // quarters of a period.
    backend.upload(beam.problem, start);
    const auto mean = [&] {
        const State state = backend.download();
        double sum = 0;
        for (const glm::dvec3& u : state.displacement) sum += u.x;
        return sum;
    };
    std::vector<double> zeros;
    double last = mean();
    for (int n = 1; zeros.size() < 3; ++n) {
        backend.step(4);
        const double now = mean();
        if ((now < 0) != (last < 0)) zeros.push_back(4 * (n - now / (now - last)));
        last = now;
    }
    return 2 * glm::pi<double>() / ((zeros[2] - zeros[0]) * beam.problem.time_step);
}

/// The value at 0 of the polynomial through the points (h, values) (Neville).
double at_zero(std::vector<double> values, const std::vector<double>& h) {
    for (std::size_t order = 1; order < values.size(); ++order) {
        for (std::size_t i = values.size() - 1; i >= order; --i)
            values[i] += (values[i] - values[i - 1]) * h[i] / (h[i - order] - h[i]);
    }
    return values.back();
}

/// Edge springs join layers but not half of their surroundings, so that a lattice of few layers is too soft
/// by a part of first order in the spacing. Extrapolated to zero spacing, the beam is that of the continuum.
TEST(Beam, BecomesTimoshenkosAsTheLatticeIsRefined) {
    const auto backend = oracle(parallel_reference_name);
    std::vector<double> spacing, stiffness, frequency;
    for (const int side : {2, 4, 6}) {
        const Cantilever beam(side, 10 * side);
        const double gravity = 1e-7 / (side * side);
        spacing.push_back(1.0 / side);
        stiffness.push_back(beam.theory_deflection(gravity) / measured_deflection(*backend, beam, gravity));
        frequency.push_back(measured_frequency(*backend, beam) / beam.theory_frequency());
    }
    for (const auto& measured : {stiffness, frequency}) {
        for (std::size_t i = 1; i < measured.size(); ++i)
            EXPECT_LT(std::abs(measured[i] - 1), 0.7 * std::abs(measured[i - 1] - 1)) << i;
        // The remaining error is of third order, and Poisson's effect at the pinned end, which beam theory
        // ignores.
        EXPECT_NEAR(at_zero(measured, spacing), 1, 0.03);
    }
}

// --- Another simulator -----------------------------------------------------------------------------------

/// A published lattice run: 18 neighbours, k = 100, m = 1, dt = 0.01, g = -1 along z, lowest layer pinned,
/// undamped from rest, 200 steps in float64.
TEST_P(Oracle, RepeatsThePublishedLatticeRun) {
    struct Published {
        int side;
        double sum_of_z, top_layer;
    };
    for (const Published& published :
         {Published{8, 1791.473180, 7.001053}, Published{32, 465464.119623, 29.013696}}) {
        const int side = published.side;
        Problem problem = make_lattice_problem(solid({side, side, side}), FACE_BITS | EDGE_BITS);
        pin_base(problem);
        problem.materials = {{1, 100}};
        problem.group_stiffness = {100, 100, 100};
        problem.gravity = {0, 0, -1};
        problem.time_step = 0.01;
        const State end = stepped(*backend, problem, state_at_rest(problem), 200);
        double sum = 0, top = 0;
        const double base = problem.rest_position[0].z;
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const double z = position(problem, end, i).z - base;
            sum += z;
            if (i >= problem.particle_count() - std::size_t(side * side)) top += z / (side * side);
        }
        // Half a unit of the last published digit.
        EXPECT_NEAR(sum, published.sum_of_z, 0.6e-6) << side;
        EXPECT_NEAR(top, published.top_layer, 0.6e-6) << side;
    }
}

// --- Order -----------------------------------------------------------------------------------------------

/// The method is of second order on every scene of the study `pareto`, from its largest time step on.
TEST(OrderTwo, HoldsOnTheScenesOfPareto) {
    References references{DiskCache(std::filesystem::path{})};
    for (const char* name : {"box@32", "heart", "beam"}) {
        const Scene scene = load_scene(name);
        const Span span{0.5 * scene.stable_time_step, 100};
        std::vector<std::vector<glm::dvec3>> ends;
        for (const int steps : {200, 400, 800, 1600})
            ends.push_back(references.after(in_steps(scene, span, steps), steps).displacement);
        const double coarse = relative_difference(ends[0], ends[1]),
                     fine = relative_difference(ends[1], ends[2]),
                     finest = relative_difference(ends[2], ends[3]);
        // The next term of the error is of fourth order.
        EXPECT_NEAR(std::log2(coarse / fine), 2, 0.1) << name;
        EXPECT_NEAR(std::log2(fine / finest), 2, 0.03) << name;
    }
}

}  // namespace
}  // namespace voxspring::testing
