// The reference on all cores against the plain one, and the rounding that is simulated in it.
#include "backends/cpu/perturbed_reference.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <string>

#include "backends/cpu/perturbed_kernel.h"
#include "backends/physics/stored.h"
#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/bodies.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using Kind = Perturbation::Kind;

std::vector<std::pair<std::string, Problem>> problems() {
    std::vector<std::pair<std::string, Problem>> all;
    const auto add = [&](const std::string& name, Problem problem) {
        all.emplace_back(name, with_dynamics(std::move(problem)));
    };
    add("one", make_lattice_problem(solid({1, 1, 1}), FACE_BITS));
    add("row", make_lattice_problem(solid({17, 1, 1}), FACE_BITS));
    add("prime", make_lattice_problem(solid({13, 7, 11}), FACE_BITS | EDGE_BITS));
    add("blocks", make_lattice_problem(solid({16, 8, 3}), NEIGHBOUR_BITS));
    add("sparse", make_lattice_problem(random_grid({19, 17, 13}, 0.3, 1), NEIGHBOUR_BITS));
    add("anisotropic", make_lattice_problem(solid({9, 10, 11}, {0.7, 1.0, 1.9}), NEIGHBOUR_BITS));
    add("labels", make_lattice_problem(random_grid({12, 11, 10}, 0.7, 4, 3), FACE_BITS | EDGE_BITS));
    all.back().second.materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    add("groups", make_lattice_problem(random_grid({11, 9, 10}, 0.7, 3), NEIGHBOUR_BITS));
    all.back().second.group_stiffness = {1.0, 0.5, 0.25};
    pin_base(all.back().second);
    add("network", random_network(200, 700, 6));
    add("sutured", make_lattice_problem(random_grid({9, 8, 7}, 0.9, 6), FACE_BITS | EDGE_BITS));
    all.back().second.springs = {{0, 7, 0.5, 3.0}, {1, 20, 0.25, 2.0}};
    all.back().second.load.assign(all.back().second.particle_count(), glm::dvec3(0.01, 0, -0.02));
    add("held", make_lattice_problem(random_grid({9, 8, 7}, 0.9, 6), FACE_BITS | EDGE_BITS));
    take_hold(
        all.back().second,
        {.particles = {2, 40, 41, 200}, .held = std::vector(4, glm::dvec3(0.1, 0, -0.2)), .stiffness = 0.25});
    return all;
}

/// Forces are added in another order, and 20 steps in float64 each round lengths of 20 by some 1e-16.
constexpr double reordered = 1e-12;

TEST(ParallelReference, AgreesWithThePlainOne) {
    for (const auto& [name, problem] : problems()) {
        const State start = random_state(problem, 0.05, 7);
        const auto plain = BackendSpec::parse("cpu_reference:formulation=increment").make();
        const auto parallel = make_perturbed_reference({});
        const State one = stepped(*plain, problem, start, 20), other = stepped(*parallel, problem, start, 20);
        EXPECT_LT(differences(other, one).max, reordered) << name;
        for (std::size_t i = 0; i < one.increment.size(); ++i)
            ASSERT_LT(glm::length(other.increment[i] - one.increment[i]), reordered) << name << " " << i;
    }
}

TEST(ParallelReference, FollowsEdits) {
    for (const bool beyond : {false, true}) {
        Problem edited =
            with_dynamics(make_lattice_problem(random_grid({11, 9, 10}, 0.95, 31), NEIGHBOUR_BITS));
        const Problem uploaded = edited;
        Problem now = edited;
        const State start = random_state(now, 0.05, 7);
        const std::vector<SpringEdit> edits = edit_everything(edited, beyond);
        const auto plain = BackendSpec::parse("cpu_reference:formulation=increment").make();
        const std::unique_ptr<Backend> parallel = make_perturbed_reference({});
        for (Backend* backend : {plain.get(), parallel.get()}) backend->upload(uploaded, start);
        for (const SpringEdit& edit : edits) {
            apply(now, edit);
            for (Backend* backend : {plain.get(), parallel.get()}) {
                backend->step(3);
                backend->edit(now, edit);
                backend->step(2);
            }
            EXPECT_LT(differences(parallel->download(), plain->download()).max, reordered) << beyond;
        }
    }
}

TEST(ParallelReference, DependsOnNoNumberOfThreads) {
    const Problem problem = with_dynamics(make_lattice_problem(solid({40, 24, 24}), FACE_BITS | EDGE_BITS));
    const State start = random_state(problem, 0.05, 7);
    const int threads = omp_get_max_threads();
    for (const Kind kind : {Kind::none, Kind::random}) {
        State first;
        for (const int count : {1, 2, 3}) {
            omp_set_num_threads(count);
            const auto backend =
                make_perturbed_reference({kind, Formulation::increment, Precision::float32, 0, 5});
            const State state = stepped(*backend, problem, start, 7);
            if (count == 1) first = state;
            expect_same_bits(state, first);
        }
    }
    omp_set_num_threads(threads);
}

TEST(ParallelReference, UsedAgainRunsAsANewOne) {
    // Bodies with many blocks, so that several threads list them, and with arrays that other problems do not
    // have.
    std::vector<Problem> bodies = {
        with_dynamics(make_lattice_problem(solid({128, 128, 65}), FACE_BITS)),
        with_dynamics(make_lattice_problem(random_grid({12, 11, 10}, 0.7, 4, 3), FACE_BITS | EDGE_BITS)),
        with_dynamics(make_lattice_problem(random_grid({12, 11, 10}, 0.5, 5), FACE_BITS | EDGE_BITS))};
    bodies[1].materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    bodies[1].load.assign(bodies[1].particle_count(), glm::dvec3(0.01, 0, -0.02));
    bodies[1].springs = {{0, 7, 0.5, 3.0}, {1, 20, 0.25, 2.0}};
    const auto again = make_perturbed_reference({});
    State state;
    for (const Problem& problem : bodies) {
        const State start = random_state(problem, 0.05, 7);
        for (const auto& [kind, formulation] :
             {std::pair{Kind::random, Formulation::increment},
              std::pair{Kind::nearest, Formulation::position}, std::pair{Kind::none, Formulation::position},
              std::pair{Kind::random, Formulation::increment}}) {
            const Perturbation perturbation{kind, formulation, Precision::float32, 0, 5};
            again->perturb(perturbation);
            again->upload(problem, start);
            again->step(3);
            again->read(state);
            const State once = stepped(*make_perturbed_reference(perturbation), problem, start, 3);
            expect_same_bits(state, once);
        }
    }
}

// --- Rounding --------------------------------------------------------------------------------------------

perturbed::RoundingBits random_float32() {
    perturbed::RoundingBits bits;
    bits.kept = ~std::uint64_t(0) << 29;
    bits.random = ~bits.kept;
    return bits;
}

TEST(RandomRounding, GivesTheTwoNeighboursAndTheValueOnAverage) {
    perturbed::RoundingBits bits = random_float32();
    for (const double value : {1.1, -3.3, 1e-3, 12345.678}) {
        const float near = float(value);
        const double below = std::nextafter(near, -INFINITY), above = std::nextafter(near, INFINITY);
        double sum = 0;
        constexpr int count = 20000;
        for (int n = 0; n < count; ++n) {
            bits.key = 0x123456789ABCDEFu * std::uint64_t(n + 1);
            const double rounded = perturbed::rounded(value, bits, std::uint64_t(n % 7), 12);
            EXPECT_EQ(rounded, stored_as<float>(rounded));
            EXPECT_TRUE(rounded == near || rounded == below || rounded == above);
            sum += rounded - value;
        }
        // The mean of 20000 has a standard deviation of 0.0035 units.
        EXPECT_LT(std::abs(sum / count) / (above - near), 0.02) << value;
    }
    EXPECT_EQ(perturbed::rounded(0, bits, 1, 1), 0);
}

TEST(RandomRounding, DrawsEvenlyAndIndependently) {
    perturbed::RoundingBits bits = random_float32();
    constexpr int count = 20000;
    double sum = 0, squares = 0, neighbours = 0, axes = 0;
    for (int n = 0; n < count; ++n) {
        bits.key = 77;
        const double a = perturbed::random_number(bits, std::uint64_t(n), 0);
        ASSERT_TRUE(a >= -1 && a < 1);
        sum += a;
        squares += a * a;
        neighbours += a * perturbed::random_number(bits, std::uint64_t(n + 1), 0);
        axes += a * perturbed::random_number(bits, std::uint64_t(n), 1);
    }
    // Four standard deviations of means of 20000.
    EXPECT_LT(std::abs(sum / count), 4 * 0.58 / std::sqrt(count));
    EXPECT_NEAR(squares / count, 1.0 / 3, 0.01);
    EXPECT_LT(std::abs(neighbours / count), 4 * 0.34 / std::sqrt(count));
    EXPECT_LT(std::abs(axes / count), 4 * 0.34 / std::sqrt(count));
}

/// A run that rounds to nearest stores what a backend of that precision stores.
TEST(NearestRounding, IsThatOfABackend) {
    const Problem problem = with_dynamics(make_lattice_problem(solid({9, 8, 7}), FACE_BITS | EDGE_BITS));
    const State start = random_state(problem, 0.05, 7);
    for (const Formulation formulation :
         {Formulation::position, Formulation::displacement, Formulation::increment}) {
        const auto backend = make_perturbed_reference({Kind::nearest, formulation, Precision::float32, 0, 1});
        const State state = stepped(*backend, problem, start, 3);
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const glm::dvec3 stored = state.displacement[i] +
                                      (on_positions(formulation) ? problem.rest_position[i] : glm::dvec3(0));
            // The subtraction of the position at rest is rounded in float64.
            EXPECT_LT(glm::length(lost_by<float>(stored)), 1e-14) << to_string(formulation);
        }
    }
}

TEST(Perturbation, LeavesABodyAtRestAloneWhereItsBackendsDo) {
    Problem problem = make_lattice_problem(random_grid({12, 11, 10}, 0.8, 3), NEIGHBOUR_BITS);
    problem.time_step = 0.25;
    const State rest = state_at_rest(problem);
    for (const Formulation formulation : {Formulation::increment, Formulation::compensated}) {
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            const auto backend = make_perturbed_reference({Kind::random, formulation, precision, 0, 1});
            EXPECT_EQ(stepped(*backend, problem, rest, 50).displacement, rest.displacement);
        }
    }
}

}  // namespace
}  // namespace voxspring::testing
