// The study `truth`: a right lattice converges to the continuum with the order that is claimed, and a wrong
// one does not.
#include "harness/study/kinds/truth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>

#include "backends/physics/neighbours.h"
#include "backends/registry.h"
#include "harness/scene/stability.h"
#include "tests/required.h"

namespace voxspring::testing {
namespace {

using Fault = std::function<void(Problem&)>;

/// Rows of a case over pitches by a backend, which takes its lattices.
std::vector<TruthRow> rows_over(
    const std::vector<int>& pitches, const BackendSpec& spec, Backend& backend, const TruthCase& of,
    const std::string& strain, bool corners, const Fault& fault = [](Problem&) {}) {
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
        row.deflection = come_to_rest(backend, lattice).deflection;
        row.model_error = std::abs(row.deflection / truth.deflection - 1);
        row.claimed_order = corners ? of.order_at_corners : of.order_at_centres;
    }
    return rows;
}

/// Why the rows of a case over pitches fail.
std::vector<std::string> failures(
    const TruthCase& of, const std::string& strain, bool corners, const std::vector<int>& pitches,
    const Fault& fault = [](Problem&) {}) {
    const BackendSpec spec = BackendSpec::parse("cpu_explicit:precision=float64");
    std::vector<TruthRow> rows = rows_over(pitches, spec, *spec.make(), of, strain, corners, fault);
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

/// Every backend by `increment`, in float64 if it has it.
std::vector<std::string> every_backend() {
    std::vector<std::string> all;
    for (const auto& [name, entry] : registry()) {
        const auto& known = entry.precisions;
        const bool is_double = std::find(known.begin(), known.end(), Precision::float64) != known.end();
        all.push_back(name + ":formulation=increment,precision=" + (is_double ? "float64" : "float32"));
    }
    for (const auto& [name, reason] : left_out()) all.push_back(name);
    return all;
}

class BackendsOfTruth : public ::testing::TestWithParam<std::string> {};

// A backend's error is that of cpu_explicit in float64, and so falls with the same order. What is left
// between them is rounding, in float32 on Mesa up to 1e-7 and in float64 up to 4e-16. The tolerance of
// float32 is ten times that, a thousandth of the least model error here. That of float64 leaves room for sums
// in another order that grow over thousands of steps.
TEST_P(BackendsOfTruth, AgreeWithCpuExplicitOnEveryCase) {
    std::unique_ptr<Backend> backend;
    make_or_skip(GetParam(), backend);
    if (backend == nullptr) return;
    static std::map<std::string, std::vector<TruthRow>> known;
    const BackendSpec spec = BackendSpec::parse(GetParam());
    const double tolerance = spec.options.precision == Precision::float64 ? 1e-9 : 1e-6;
    const BackendSpec other = BackendSpec::parse("cpu_explicit:precision=float64");
    for (const TruthCase& one : truth_cases()) {
        const std::vector<int> pitches = one.is_ball ? std::vector{8, 12} : std::vector{4, 6};
        for (const bool corners : {true, false}) {
            if (const Problem problem = truth_lattice(one, 0, pitches[0], corners).problem;
                !backend->unsupported(problem).empty()) {
                EXPECT_TRUE(corners) << one.name << ": " << backend->unsupported(problem);
                continue;
            }
            for (const std::string strain : {"small", "large"}) {
                const std::string name = one.name + (corners ? " corners " : " centres ") + strain;
                std::vector<TruthRow>& expected = known[name];
                if (expected.empty())
                    expected = rows_over(pitches, other, *other.make(), one, strain, corners);
                std::vector<TruthRow> rows = rows_over(pitches, spec, *backend, one, strain, corners);
                for (std::size_t n = 0; n < rows.size(); ++n)
                    EXPECT_NEAR(rows[n].model_error, expected[n].model_error, tolerance) << name;
                EXPECT_THAT(judge_truth(rows), ::testing::Each("")) << name;
            }
        }
    }
}

INSTANTIATE_TEST_SUITE_P(, BackendsOfTruth, ::testing::ValuesIn(every_backend()), test_name);

}  // namespace
}  // namespace voxspring::testing
