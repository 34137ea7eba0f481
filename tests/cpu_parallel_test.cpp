// What cpu_parallel promises beyond conformance: bits that depend neither on threads, nor on SIMD target,
// nor on what was skipped.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cmath>
#include <glm/geometric.hpp>
#include <memory>
#include <string>
#include <vector>

#include "backends/physics/spring.h"
#include "backends/registry.h"
#include "harness/verify.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Scene {
    std::string name;
    Problem problem;
};

Problem with_dynamics(Problem problem) {
    problem.gravity = {8e-4, 0, -2e-3};
    problem.damping = 0.01;
    problem.time_step = 0.2;
    return problem;
}

/// Rows of one block and of several, whole blocks and holes, and each optional term with and without.
std::vector<Scene> scenes() {
    std::vector<Scene> all;
    all.push_back({"box", with_dynamics(make_lattice_problem(solid({37, 11, 9}), FACE_BITS | EDGE_BITS))});

    all.push_back({"no_damping_no_gravity", make_lattice_problem(solid({37, 5, 6}), FACE_BITS | EDGE_BITS)});
    all.back().problem.time_step = 0.2;

    all.push_back(
        {"sparse", with_dynamics(make_lattice_problem(random_grid({70, 9, 7}, 0.05, 31), NEIGHBOUR_BITS))});

    all.push_back({"pinned_and_loaded", with_dynamics(make_lattice_problem(random_grid({41, 10, 9}, 0.9, 32),
                                                                           FACE_BITS | EDGE_BITS))});
    pin_base(all.back().problem);
    all.back().problem.load.assign(all.back().problem.particle_count(), glm::dvec3(0));
    all.back().problem.load[100] = {0.01, -0.02, 0.03};

    all.push_back(
        {"labels", with_dynamics(make_lattice_problem(random_grid({40, 8, 8}, 0.8, 33, 3), NEIGHBOUR_BITS))});
    all.back().problem.materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};

    all.push_back({"stiffness_a_group",
                   with_dynamics(make_lattice_problem(solid({34, 7, 5}, {0.7, 1.0, 1.9}), NEIGHBOUR_BITS))});
    all.back().problem.group_stiffness = {1, 0.5, 0.25};

    all.push_back({"faces", with_dynamics(make_lattice_problem(solid({33, 4, 4}), FACE_BITS))});
    all.push_back({"one_row", with_dynamics(make_lattice_problem(solid({50, 1, 1}), NEIGHBOUR_BITS))});
    all.push_back({"one_particle", with_dynamics(make_lattice_problem(solid({1, 1, 1}), NEIGHBOUR_BITS))});
    return all;
}

State run(const std::string& spec, const Problem& problem, int steps = 20) {
    const auto backend = BackendSpec::parse(spec).make();
    backend->upload(problem, random_state(problem, 0.05, 34));
    backend->step(steps);
    return backend->download();
}

void expect_same_bits(const State& a, const State& b) {
    EXPECT_EQ(a.displacement, b.displacement);
    EXPECT_EQ(a.increment, b.increment);
}

class CpuParallel : public ::testing::TestWithParam<std::string> {
protected:
    const std::string spec = "cpu_parallel:precision=" + GetParam();
};

TEST_P(CpuParallel, ThreadsChangeNoBit) {
    for (const Scene& scene : scenes()) {
        SCOPED_TRACE(scene.name);
        const State one = run(spec + ",threads=1", scene.problem);
        // 61 is more than some scenes have blocks, and leaves shares that end within a row.
        for (const char* threads : {"2", "3", "7", "61", "auto"}) {
            SCOPED_TRACE(threads);
            expect_same_bits(one, run(spec + ",threads=" + threads, scene.problem));
        }
    }
}

TEST_P(CpuParallel, SkippingAndSharingChangeNoBit) {
    for (const Scene& scene : scenes()) {
        SCOPED_TRACE(scene.name);
        const State all = run(spec + ",terms=all", scene.problem);
        // Inactive voxels hold NaN: none of it has got through.
        EXPECT_TRUE(compare(scene.problem, all, all, Precision::float64, 20).finite);
        expect_same_bits(all, run(spec + ",terms=needed,threads=2", scene.problem));
    }
}

/// Makes Highway choose `target` until the end of the scope.
class ChosenTarget {
public:
    explicit ChosenTarget(std::int64_t target) { hwy::SetSupportedTargetsForTest(target); }
    ~ChosenTarget() { hwy::SetSupportedTargetsForTest(0); }
    ChosenTarget(const ChosenTarget&) = delete;
    ChosenTarget& operator=(const ChosenTarget&) = delete;
};

TEST_P(CpuParallel, SimdTargetsChangeNoBit) {
    const auto targets = hwy::SupportedAndGeneratedTargets();
    ASSERT_FALSE(targets.empty());
    for (const Scene& scene : scenes()) {
        SCOPED_TRACE(scene.name);
        const State best = run(spec, scene.problem);
        for (const std::int64_t target : targets) {
            SCOPED_TRACE(hwy::TargetName(target));
            const ChosenTarget chosen(target);
            ASSERT_THAT(BackendSpec::parse(spec).make()->capabilities().driver,
                        StartsWith(hwy::TargetName(target)));
            expect_same_bits(best, run(spec, scene.problem));
        }
    }
}

/// One particle after the other, with the shared formulas on plain scalars.
template <class Vec3, class Real>
State run_scalar_gather(const Problem& problem, const State& start, int steps) {
    const std::size_t count = problem.particle_count();
    std::vector<Vec3> x(count), previous(count), next(count);
    for (std::size_t i = 0; i < count; ++i) {
        const glm::dvec3 position = problem.rest_position[i] + start.displacement[i];
        x[i] = Vec3(position);
        previous[i] = Vec3(position - start.increment[i]);
    }
    const auto particle = particle_of_voxel(problem.lattice);
    for (int n = 0; n < steps; ++n) {
        for (std::size_t i = 0; i < count; ++i) {
            Vec3 force(0);
            for (const Direction& direction : directions()) {
                if ((problem.lattice.mask[i] >> direction.bit & 1u) == 0) continue;
                const auto j =
                    particle[std::size_t(problem.lattice.voxel[i] + problem.lattice.stride(direction))];
                const Material& a = problem.material_of(i);
                const Material& b = problem.material_of(j);
                const Real stiffness = problem.has_materials()
                                           ? series_stiffness(Real(1 / a.stiffness), Real(1 / b.stiffness))
                                           : Real(problem.group_stiffness[std::size_t(direction.group)]);
                force += spring_force(x[i] - x[j], Real(problem.rest_length[std::size_t(direction.bit)]),
                                      stiffness, Real(problem.shortest_squared()));
            }
            if (!problem.load.empty()) force += Vec3(problem.load[i]);
            next[i] = problem.is_pinned(i)
                          ? x[i]
                          : next_position(x[i], previous[i], force, Real(1 / problem.material_of(i).mass),
                                          Vec3(problem.gravity), Real(1 - problem.damping),
                                          Real(problem.time_step * problem.time_step));
        }
        previous = x;
        x = next;
    }
    State state = state_at_rest(problem);
    for (std::size_t i = 0; i < count; ++i) {
        state.displacement[i] = glm::dvec3(x[i]) - problem.rest_position[i];
        state.increment[i] = glm::dvec3(x[i]) - glm::dvec3(previous[i]);
    }
    return state;
}

TEST_P(CpuParallel, GivesTheBitsOfAScalarGatherInNeighbourOrder) {
    for (const Scene& scene : scenes()) {
        SCOPED_TRACE(scene.name);
        const State start = random_state(scene.problem, 0.05, 34);
        expect_same_bits(GetParam() == "float32"
                             ? run_scalar_gather<glm::vec3, float>(scene.problem, start, 20)
                             : run_scalar_gather<glm::dvec3, double>(scene.problem, start, 20),
                         run(spec, scene.problem, 20));
    }
}

TEST_P(CpuParallel, RefusesWhatImplicitAddressingCannotReach) {
    const auto backend = BackendSpec::parse(spec).make();
    const auto bytes = [&](const Problem& problem) {
        const BackendSpec parsed = BackendSpec::parse(spec);
        return parsed.entry->bytes(problem, parsed.options);
    };
    Problem problem = make_lattice_problem(solid({4, 3, 2}), FACE_BITS);
    EXPECT_EQ(backend->unsupported(problem), "");
    EXPECT_GT(bytes(problem), 0u);
    problem.springs = {{0, 23, 1, 3}};
    EXPECT_THAT(backend->unsupported(problem), HasSubstr("beyond the lattice"));
    EXPECT_EQ(bytes(problem), 0u);

    Problem network;
    network.rest_position.resize(2);
    network.springs = {{0, 1, 1, 1}};
    EXPECT_THAT(backend->unsupported(network), HasSubstr("needs a lattice"));

    // Dims whose padded product overflows 64 bits, or merely exceeds all memory there is.
    for (const glm::ivec3 dims : {glm::ivec3(2147483647), glm::ivec3(1, 2147483647, 65536)}) {
        Problem huge;
        huge.lattice.dims = dims;
        EXPECT_THAT(backend->unsupported(huge), HasSubstr("exceeds the address space"));
        EXPECT_EQ(bytes(huge), 0u);
    }
}

TEST_P(CpuParallel, RefusesMoreThreadsThanAProcessCanCountOn) {
    EXPECT_THROW(BackendSpec::parse(spec + ",threads=9999999").make(), BadSpecification);
}

TEST_P(CpuParallel, TakesMoreMemoryForWhatASceneNeedsMore) {
    const auto bytes = [&](const std::string& tuning, const Problem& problem) {
        const BackendSpec parsed = BackendSpec::parse(spec + tuning);
        return parsed.entry->bytes(problem, parsed.options);
    };
    const Problem problem = make_lattice_problem(solid({64, 32, 16}), FACE_BITS);
    const std::uint64_t plain = bytes(",threads=1", problem);
    // At least two positions and a mask.
    EXPECT_GE(plain, problem.particle_count() * (GetParam() == "float32" ? 28u : 56u));
    EXPECT_GT(bytes(",threads=2", problem), plain);
    EXPECT_GT(bytes(",threads=1,terms=all", problem), plain);
    Problem loaded = problem;
    loaded.load.assign(problem.particle_count(), glm::dvec3(0));
    EXPECT_GT(bytes(",threads=1", loaded), plain);
    EXPECT_GT(bytes(",threads=1", make_lattice_problem(solid({64, 32, 16}), NEIGHBOUR_BITS)), plain);
}

INSTANTIATE_TEST_SUITE_P(Precisions, CpuParallel, ::testing::Values("float32", "float64"),
                         [](const auto& tested) { return tested.param; });

}  // namespace
}  // namespace voxspring::testing
