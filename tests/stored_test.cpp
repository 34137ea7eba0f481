// The loss from rounding to a backend's precision, for three neighbouring numbers: GCC 12 drops two of them
// (stored.h). This file is compiled at -O3, like the code that it tests.
#include "backends/physics/stored.h"

#include <gtest/gtest.h>

#include <vector>

#include "backends/layout/particles.h"
#include "backends/layout/vectors.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

const glm::dvec3 start(0.1, -0.07, 0.013);
/// The nearest numbers of float32, written out.
const glm::dvec3 nearest(0.100000001490116119384765625, -0.070000000298023223876953125,
                         0.0130000002682209014892578125);

TEST(Stored, WhatFloat32LosesOfEachComponent) {
    const std::vector<glm::dvec3> values(5, start);
    std::vector<glm::dvec3> stored(5), lost(5);
    for (std::size_t i = 0; i < values.size(); ++i) {
        stored[i] = stored_as<float>(values[i]);
        lost[i] = lost_by<float>(values[i]);
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
        EXPECT_EQ(stored[i], nearest);
        EXPECT_EQ(lost[i], start - nearest);
    }
    EXPECT_EQ(lost_by<double>(start), glm::dvec3(0));
}

TEST(Stored, LowPartsOfAStartAreExact) {
    const Problem problem = make_lattice_problem(solid({5, 3, 2}), FACE_BITS);
    State state = state_at_rest(problem);
    for (glm::dvec3& u : state.displacement) u = start;
    for (glm::dvec3& v : state.increment) v = start / 16.0;
    const layout::Placement placement = layout::place_compact(problem);
    const auto packed =
        layout::pack<float>(problem, state, placement, layout::state_bits(problem), Formulation::compensated);
    const std::size_t pitch = layout::increment_pitch(placement);
    const glm::dvec3 lost = start - nearest;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const layout::Vector<float> low = packed.current_low[placement.at(i)].position;
        EXPECT_EQ(glm::vec3(low.x, low.y, low.z), glm::vec3(lost));
        for (std::size_t axis = 0; axis < 3; ++axis) {
            EXPECT_EQ(packed.increment_low[axis * pitch + placement.at(i)], float(lost[int(axis)] / 16));
        }
    }
}

}  // namespace
}  // namespace voxspring::testing
