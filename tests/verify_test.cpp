// The verifier, mainly on states that must fail.
#include "harness/verification/verify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <glm/geometric.hpp>
#include <limits>
#include <utility>

#include "backends/physics/stored.h"
#include "backends/registry.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;

constexpr int steps = 10;

class Verify : public ::testing::Test {
protected:
    Comparison compared(Precision precision = Precision::float32) const {
        return compare(problem, state, reference, precision, steps);
    }

    const Problem problem = make_lattice_problem(solid({6, 5, 4}), FACE_BITS);
    const State reference = random_state(problem, 0.05, 3);
    State state = reference;
};

TEST_F(Verify, PassesTheReferenceItself) {
    const Comparison comparison = compared();
    EXPECT_TRUE(comparison.passed()) << comparison.reason;
    EXPECT_TRUE(comparison.finite);
    EXPECT_EQ(comparison.max, 0);
    EXPECT_EQ(comparison.rms, 0);
    EXPECT_EQ(comparison.relative_l2, 0);
    EXPECT_GT(comparison.tolerance, 0);
}

TEST_F(Verify, PassesRoundingOfThatPrecisionAndNotOfALesserOne) {
    for (std::size_t i = 0; i < state.displacement.size(); ++i) {
        const glm::dvec3 x = problem.rest_position[i];
        state.displacement[i] = stored_as<float>(x + state.displacement[i]) - x;
    }
    EXPECT_TRUE(compared(Precision::float32).passed());
    EXPECT_GT(compared(Precision::float32).max, 0);
    EXPECT_FALSE(compared(Precision::float64).passed());
}

TEST_F(Verify, AdmitsWhatApproximateRootsCostAndLittleMore) {
    constexpr double root_error = 3 * 0x1p-12;  // two approximations of an x86 processor without AVX-512
    const auto passes = [&](double off, double error, Formulation formulation) {
        state = reference;
        state.displacement[3].x += off;
        return compare(problem, state, reference, Precision::float32, steps, formulation, error).passed();
    };
    // Displacements are 0.05.
    EXPECT_TRUE(passes(1e-3, root_error, Formulation::increment));
    EXPECT_FALSE(passes(1e-3, 0, Formulation::increment));
    EXPECT_FALSE(passes(1e-2, root_error, Formulation::increment));
    EXPECT_TRUE(passes(1e-3, root_error, Formulation::position)) << "off by a share of the lengths";
    EXPECT_FALSE(passes(3e-2, root_error, Formulation::position));
}

TEST_F(Verify, FailsOnWhatIsNotFinite) {
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
          -std::numeric_limits<double>::infinity()}) {
        for (const int axis : {0, 1, 2}) {
            for (const std::size_t particle : {std::size_t(0), state.displacement.size() - 1}) {
                state = reference;
                state.displacement[particle][axis] = bad;
                const Comparison comparison = compared();
                EXPECT_FALSE(comparison.passed());
                EXPECT_FALSE(comparison.finite);
                EXPECT_EQ(comparison.worst, particle);
                EXPECT_THAT(comparison.reason, HasSubstr("not finite"));
            }
        }
    }
}

TEST_F(Verify, FailsOnAReferenceThatIsNotFinite) {
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        State diverged = reference;
        diverged.displacement[17].y = bad;
        const Comparison comparison = differences(state, diverged);
        EXPECT_EQ(comparison.reason, "the reference is not finite");
        EXPECT_EQ(comparison.max, std::numeric_limits<double>::infinity());
        EXPECT_EQ(comparison.relative_l2, std::numeric_limits<double>::infinity());
    }
}

TEST_F(Verify, FailsOnAStateThatIsWrong) {
    const std::size_t last = state.displacement.size() - 1;
    const double flipped = 2 * std::abs(reference.displacement[17].y);
    struct Case {
        std::function<void(State&)> change;
        std::size_t worst;
        double max;
    };
    const Case cases[] = {
        {[](State& s) { s.displacement[17].y *= -1; }, 17, flipped},
        {[](State& s) { s.displacement.back().z += 1e-3; }, last, 1e-3},
        {[](State& s) { std::swap(s.displacement[40], s.displacement[41]); }, 40,
         glm::distance(reference.displacement[40], reference.displacement[41])},
    };
    for (const Case& wrong : cases) {
        state = reference;
        wrong.change(state);
        const Comparison comparison = compared();
        EXPECT_FALSE(comparison.passed());
        EXPECT_EQ(comparison.worst, wrong.worst);
        EXPECT_NEAR(comparison.max, wrong.max, 1e-15);
        EXPECT_GE(comparison.rms, wrong.max / std::sqrt(double(last + 1)) - 1e-15);
    }
    state = state_at_rest(problem);
    EXPECT_FALSE(compared().passed());
    EXPECT_DOUBLE_EQ(compared().relative_l2, 1) << "a state that never moved";
}

TEST_F(Verify, FailsOnAWrongSize) {
    for (const std::size_t size : {119, 121, 0}) {
        state.displacement.resize(size);
        EXPECT_THAT(compared().reason, HasSubstr("particles instead of 120")) << size;
    }
}

TEST_F(Verify, RelativeErrorAgainstAReferenceAtRest) {
    state = state_at_rest(problem);
    EXPECT_EQ(compare(problem, state, state, Precision::float32, steps).relative_l2, 0);
    const State rest = state;
    state.displacement[5].x = 1e-9;
    EXPECT_EQ(compare(problem, state, rest, Precision::float32, steps).relative_l2,
              std::numeric_limits<double>::infinity());
}

TEST_F(Verify, ToleranceFollowsPrecisionAndSteps) {
    const auto tolerance = [&](Precision precision, int n) {
        return rounding_tolerance(problem, reference, precision, n);
    };
    // Units of rounding are 2^-24 and 2^-53.
    EXPECT_DOUBLE_EQ(tolerance(Precision::float32, 100) / tolerance(Precision::float64, 100),
                     std::ldexp(1.0, 29));
    EXPECT_GT(tolerance(Precision::float32, 100), tolerance(Precision::float32, 10));
    // Whatever the number of steps, a visible error is not accepted as rounding here.
    EXPECT_LT(tolerance(Precision::float32, 20), 1e-3);
}

TEST_F(Verify, ToleranceFollowsFormulation) {
    Problem long_box = make_lattice_problem(solid({3, 3, 40}), FACE_BITS | EDGE_BITS);
    long_box.damping = 0.01;
    const State moved = random_state(long_box, 1e-3, 3);
    const auto tolerance = [&](Formulation formulation, int n = 20) {
        return rounding_tolerance(long_box, moved, Precision::float32, n, formulation);
    };
    // Positions of 40, rest lengths of 1.4 and displacements of 1e-3 are rounded, in that order.
    EXPECT_GT(tolerance(Formulation::paper), 2 * tolerance(Formulation::position));
    EXPECT_GT(tolerance(Formulation::position), 2 * tolerance(Formulation::displacement));
    EXPECT_GT(tolerance(Formulation::displacement), 50 * tolerance(Formulation::increment));
    EXPECT_GT(tolerance(Formulation::increment), tolerance(Formulation::compensated));
    // The bias of the equation as printed grows with the square of the number of steps, and is zero without
    // damping.
    EXPECT_GT(tolerance(Formulation::paper, 10000) / tolerance(Formulation::paper, 1000), 70);
    long_box.damping = 0;
    EXPECT_LT(tolerance(Formulation::paper, 10000) / tolerance(Formulation::paper, 1000), 33);
    // The bound is never less than what a reference on positions rounds itself.
    EXPECT_EQ(rounding_tolerance(long_box, moved, Precision::float64, 20, Formulation::compensated),
              rounding_tolerance(long_box, moved, Precision::float64, 20, Formulation::position));
    // Rest is free of strain; springs of an unstructured network are far from it and round their stored
    // lengths.
    const Problem network = random_network(50, 200, 4);
    EXPECT_GT(
        rounding_tolerance(network, state_at_rest(network), Precision::float32, 20, Formulation::increment),
        1e-6);
    EXPECT_LT(
        rounding_tolerance(long_box, state_at_rest(long_box), Precision::float32, 20, Formulation::increment),
        1e-11);
}

TEST_F(Verify, ToleranceAllowsWhatAConstantForceLosesInRounding) {
    // Free fall from high up, in steps so small that a float32 position hardly changes by gravity.
    Problem falling = make_lattice_problem(solid({1, 1, 60}), FACE_BITS);
    falling.gravity = {0, 0, -1e-3};
    falling.time_step = 0.02;
    const auto run = [&](const std::string& specification) {
        return stepped(specification, falling, state_at_rest(falling), 2000);
    };
    const State exact = run("cpu_reference");
    for (const Formulation formulation : all_formulations) {
        const Comparison comparison =
            compare(falling, run("cpu_parallel:precision=float32,formulation=" + to_string(formulation)),
                    exact, Precision::float32, 2000, formulation);
        EXPECT_TRUE(comparison.passed()) << to_string(formulation) << ": " << comparison.reason;
        if (on_positions(formulation)) {
            EXPECT_GT(comparison.relative_l2, 0.1) << "stalled";
        } else {
            EXPECT_LT(comparison.relative_l2, 1e-2) << to_string(formulation);
        }
    }
}

}  // namespace
}  // namespace voxspring::testing
