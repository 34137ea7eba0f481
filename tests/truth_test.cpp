// The study `truth`: a right lattice converges to the continuum with the order that is claimed, and a wrong
// one does not.
#include "harness/study/truth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "backends/physics/neighbours.h"
#include "backends/registry.h"
#include "harness/scene/stability.h"

namespace voxspring::testing {
namespace {

using Fault = std::function<void(Problem&)>;

/// Rows of a case over pitches, and why they fail.
std::vector<std::string> failures(
    const TruthCase& of, const std::string& strain, bool corners, const std::vector<int>& pitches,
    const Fault& fault = [](Problem&) {}) {
    const BackendSpec spec = BackendSpec::parse("cpu_explicit:precision=float64");
    const auto backend = spec.make();
    const ContinuumAnswer truth = continuum_answer(of, strain);
    std::vector<TruthRow> rows;
    for (const int across : pitches) {
        TruthLattice lattice = truth_lattice(of, truth.load, across, corners);
        fault(lattice.problem);
        double& time_step = lattice.problem.time_step;
        time_step = std::min(time_step, 0.8 * stable_time_step(lattice.problem));  // of stiffer springs
        TruthRow& row = rows.emplace_back();
        row.identity = row_of(of.name, spec).identity;
        row.particles_at = corners ? "corners" : "centres";
        row.strain = strain;
        row.across = across;
        row.continuum_error = truth.error;
        row.deflection = come_to_rest(*backend, lattice).deflection;
        row.model_error = std::abs(row.deflection / truth.deflection - 1);
        row.claimed_order = corners ? of.order_at_corners : of.order_at_centres;
    }
    std::vector<std::string> reasons = judge_truth(rows);
    std::erase(reasons, "");
    return reasons;
}

TEST(Truth, EveryCaseConvergesWithItsOrder) {
    for (const TruthCase& one : truth_cases()) {
        const std::vector<int> pitches = one.is_ball ? std::vector{8, 24} : std::vector{4, 6};
        for (const std::string strain : {"small", "large"}) {
            EXPECT_THAT(failures(one, strain, true, pitches), ::testing::IsEmpty()) << one.name << strain;
            EXPECT_THAT(failures(one, strain, false, pitches), ::testing::IsEmpty()) << one.name << strain;
        }
    }
}

TEST(Truth, WrongLatticesDoNot) {
    const auto fails = [&](const Fault& fault, const char* name = "cube") {
        return !failures(truth_case(name, "test"), "small", true, {4, 6}, fault).empty();
    };
    EXPECT_FALSE(fails([](Problem&) {}));
    const auto stiffer = [](double factor) {
        return [=](Problem& problem) {
            for (Material& material : problem.materials) material.stiffness *= factor;
            for (Spring& spring : problem.springs) spring.stiffness *= factor;
        };
    };
    EXPECT_TRUE(fails(stiffer(1.05)));
    EXPECT_TRUE(fails(stiffer(0.95)));
    EXPECT_TRUE(fails([](Problem& problem) {
        for (Material& material : problem.materials) material.mass *= 1.05;
    })) << "density";
    EXPECT_TRUE(fails([](Problem& problem) {
        for (Spring& spring : problem.springs) spring.stiffness = problem.materials[0].stiffness;
    })) << "surface springs of full stiffness";
    // Their error is of first order, which the cube's 1.25 would let pass.
    EXPECT_TRUE(fails(
        [](Problem& problem) {
            double whole = 0;
            for (const Material& material : problem.materials) whole = std::max(whole, material.mass);
            for (Material& material : problem.materials) material.mass = whole;
        },
        "cantilever"))
        << "surface particles of full mass";
}

// Finite elements agree with closed forms, up to what these leave out: a clamped end stiffens a bar, and a
// torque that is not spread as in Saint-Venant's solution turns the end a little further.
TEST(Truth, TheContinuumAgreesWithClosedForms) {
    const auto small = [](const char* name) { return continuum_answer(truth_case(name, "test"), "small"); };
    const auto expect = [](double value, double closed, double share) {
        EXPECT_NEAR(value / closed, 1, share) << value << " and " << closed;
    };
    const ContinuumAnswer tension = small("tension"), torsion = small("torsion"), sag = small("cantilever"),
                          cube = small("cube");
    expect(tension.deflection, tension.load * 3, 0.015);
    expect(torsion.deflection, torsion.load / 6 * 3 / (0.4 * 0.1406), 0.015);
    // Bending, and shear with Cowper's coefficient 10 (1 + nu) / (12 + 11 nu).
    expect(sag.deflection, sag.load * (12 * 256 / 8.0 + 16 / (2 * 0.4 * 12.5 / 14.75)), 0.015);
    // Between a free bar and one that cannot contract.
    EXPECT_LT(cube.deflection, cube.load / 2);
    EXPECT_GT(cube.deflection, cube.load / 2 / 1.2);
}

}  // namespace
}  // namespace voxspring::testing
