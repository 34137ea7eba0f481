// Which particles a hand reaches, and which springs a blade and a needle meet in a deformed body; and what a
// window shows of a state.
#include "harness/simulation/picking.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <glm/geometric.hpp>
#include <limits>

#include "tests/support.h"

namespace voxspring::testing {
namespace {

using Pair = std::pair<std::uint32_t, std::uint32_t>;
using Quad = std::array<glm::dvec3, 4>;

/// A lattice with springs beyond it, bent at random.
struct Bent {
    Problem problem = make_lattice_problem(random_grid({9, 8, 7}, 0.8, 3), FACE_BITS | EDGE_BITS);
    State state;

    Bent() {
        const auto last = std::uint32_t(problem.particle_count() - 1);
        const std::vector<Pair> far = {{0, last}, {1, last - 1}, {2, 50}};
        SpringEditor(problem).suture(far);
        state = random_state(problem, 0.6, 4);
    }
    glm::dvec3 place(std::size_t i) const { return problem.rest_position[i] + state.displacement[i]; }
    Places places() const { return {problem, state}; }
};

TEST(Picking, TheNearestOfAll) {
    const Bent bent;
    for (const glm::dvec3 place : {glm::dvec3(3, 4, 2), glm::dvec3(-5, 0, 9), glm::dvec3(0.3, 6.6, 1.2)}) {
        const std::uint32_t nearest = bent.places().nearest_to(place);
        for (std::size_t i = 0; i < bent.problem.particle_count(); ++i)
            EXPECT_LE(glm::distance(bent.place(nearest), place), glm::distance(bent.place(i), place));
    }
    // Among equally near particles the first is taken.
    const Problem flat = make_lattice_problem(solid({4, 4, 1}), FACE_BITS);
    const State rest = state_at_rest(flat);
    EXPECT_EQ(Places(flat, rest).nearest_to({1.5, 1.5, 0}), 5u);
}

TEST(Picking, AHandReachesWhatIsWithinItsRadius) {
    const Bent bent;
    const glm::dvec3 place(4, 3, 3);
    const auto held = bent.places().near(place, 2, 4096);
    EXPECT_GT(held.size(), 10u);
    for (std::uint32_t i = 0; i < bent.problem.particle_count(); ++i) {
        EXPECT_EQ(std::binary_search(held.begin(), held.end(), i), glm::distance(bent.place(i), place) <= 2);
    }
    const auto fewer = bent.places().near(place, 2, 5);
    ASSERT_EQ(fewer.size(), 5u);
    EXPECT_TRUE(std::is_sorted(fewer.begin(), fewer.end()));
    for (const std::uint32_t i : held) {
        if (std::binary_search(fewer.begin(), fewer.end(), i)) continue;
        for (const std::uint32_t nearer : fewer)
            EXPECT_LE(glm::distance(bent.place(nearer), place), glm::distance(bent.place(i), place));
    }
    const glm::dvec3 far(100, 0, 0);
    EXPECT_EQ(bent.places().near(far, 2, 4096), std::vector{bent.places().nearest_to(far)});
}

TEST(Picking, ABladeMeetsTheSpringsThatItsTrianglesCut) {
    const Bent bent;
    const std::vector<Spring> springs = list_springs(bent.problem);
    // Through the whole body, through a part, along the lattice's planes and outside of it; not planar.
    const std::vector<Quad> quads = {{{{3.4, -3, -3}, {3.6, -3, 12}, {3.2, 14, -3}, {3.9, 14, 12}}},
                                     {{{2, 3, 1.5}, {5, 3, 2.5}, {2, 6, 3.5}, {5, 6, 1.5}}},
                                     {{{4, -1, -1}, {4, -1, 9}, {4, 9, -1}, {4, 9, 9}}},
                                     {{{40, -1, -1}, {40, -1, 9}, {40, 9, -1}, {40, 9, 9}}}};
    std::vector<std::size_t> found;
    for (const Quad& quad : quads) {
        const Shape swept = TrianglePatch{{{quad[0], quad[1], quad[3]}, {quad[0], quad[3], quad[2]}}};
        std::vector<Pair> expected;
        for (const Spring& spring : springs) {
            if (cuts(swept, bent.place(spring.first), bent.place(spring.second)))
                expected.emplace_back(spring.first, spring.second);
        }
        std::sort(expected.begin(), expected.end());
        EXPECT_EQ(bent.places().springs_through(quad), expected);
        found.push_back(expected.size());
    }
    EXPECT_GT(found[0], found[1]);
    EXPECT_GT(found[1], 10u);
    EXPECT_GT(found[2], 100u);
    EXPECT_EQ(found[3], 0u);
}

TEST(Picking, ABladeThatStandsStillMeetsNothing) {
    const Bent bent;
    const glm::dvec3 from(3.4, -3, -3), to(3.4, 9, 9);
    EXPECT_TRUE(bent.places().springs_through({from, to, from, to}).empty());
}

TEST(Picking, ANeedleFindsWhatIsLostNearItsLine) {
    Bent bent;
    const Problem whole = bent.problem;
    const SpringEdit cut = SpringEditor(bent.problem).cut(Plane{{4.1, 3, 3}, {1, 0.2, 0.1}});
    // Another spring joins two particles that the cut has separated: they count as joined.
    const ChangedSpring& replaced = cut.removed.front();
    bent.problem.springs.push_back({replaced.spring.first, replaced.spring.second, 0.125, 1});
    const glm::dvec3 a(4, 1, 1), b(4, 6, 5);
    const auto distance = [&](std::uint32_t i) {
        const double part = glm::dot(bent.place(i) - a, b - a) / glm::dot(b - a, b - a);
        return glm::distance(bent.place(i), a + std::clamp(part, 0.0, 1.0) * (b - a));
    };
    for (const double radius : {0.1, 1.5, 3.0, 50.0}) {
        std::vector<std::pair<Pair, int>> expected;
        for (const ChangedSpring& removed : cut.removed) {
            const auto [first, second, stiffness, length] = removed.spring;
            if (&removed == &replaced || distance(first) > radius || distance(second) > radius) continue;
            expected.emplace_back(Pair(first, second), removed.bit);
        }
        std::vector<std::pair<Pair, int>> found;
        for (const ChangedSpring& lost : bent.places().lost_springs(whole, a, b, radius))
            found.emplace_back(Pair(lost.spring.first, lost.spring.second), lost.bit);
        EXPECT_EQ(found, expected) << radius;
        EXPECT_EQ(found.empty(), radius == 0.1);
    }
    EXPECT_EQ(bent.places().lost_springs(whole, a, b, 50).size(), cut.removed.size() - 1);
    // A line that is a point.
    const auto at = bent.places().lost_springs(whole, a, a, 2);
    EXPECT_FALSE(at.empty());
    for (const ChangedSpring& lost : at) EXPECT_LE(glm::distance(bent.place(lost.spring.second), a), 2);
}

TEST(Measures, OnlyFiniteStatesAreFinite) {
    const Bent bent;
    EXPECT_TRUE(finite(bent.state));
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), -HUGE_VAL}) {
        State state = bent.state;
        state.displacement.back().z = bad;
        EXPECT_FALSE(finite(state));
        state = bent.state;
        state.increment.front().x = bad;
        EXPECT_FALSE(finite(state));
    }
    State large = bent.state;
    for (glm::dvec3& u : large.displacement) u = glm::dvec3(std::numeric_limits<double>::max());
    EXPECT_TRUE(finite(large)) << "whose sum is not finite";
}

TEST(Measures, ARodIsAsTenseAsItIsStretched) {
    const Problem rod = make_lattice_problem(solid({4, 1, 1}, {2, 1, 1}), FACE_BITS);
    State state = state_at_rest(rod);
    EXPECT_EQ(tensions(rod, state), std::vector<double>(4, 0.0));
    for (const double stretch : {0.25, -0.5}) {
        for (std::size_t i = 0; i < 4; ++i) state.displacement[i] = {stretch * rod.rest_position[i].x, 0, 0};
        for (const double tension : tensions(rod, state)) EXPECT_DOUBLE_EQ(tension, stretch);
    }
    // Only one end is held: its neighbour has one such spring of two.
    state = state_at_rest(rod);
    state.displacement[0].x = -1;
    EXPECT_EQ(tensions(rod, state), (std::vector{0.5, 0.25, 0.0, 0.0}));
}

TEST(Measures, TensionIsTheMeanOverAllSprings) {
    Bent bent;
    bent.problem.springs.push_back({3, 7, 1, 0});  // rest length zero
    std::vector<double> sum(bent.problem.particle_count()), count(sum.size());
    for (const Spring& spring : list_springs(bent.problem)) {
        if (spring.rest_length == 0) continue;
        const double strain =
            glm::distance(bent.place(spring.first), bent.place(spring.second)) / spring.rest_length - 1;
        for (const std::uint32_t i : {spring.first, spring.second}) {
            sum[i] += strain;
            ++count[i];
        }
    }
    const std::vector<double> found = tensions(bent.problem, bent.state);
    ASSERT_EQ(found.size(), sum.size());
    for (std::size_t i = 0; i < sum.size(); ++i)
        EXPECT_NEAR(found[i], count[i] > 0 ? sum[i] / count[i] : 0, 1e-12) << "sums in another order";
    // Nothing holds it.
    const Problem lone = make_lattice_problem(solid({1, 1, 1}), FACE_BITS);
    EXPECT_EQ(tensions(lone, state_at_rest(lone)), std::vector{0.0});
}

TEST(Measures, ANetworkHasTensionsToo) {
    const Problem network = random_network(3, 0, 1);
    Problem joined = network;
    joined.springs = {{0, 1, 1, 0.5}};
    const State rest = state_at_rest(joined);
    const double strain = glm::distance(joined.rest_position[0], joined.rest_position[1]) / 0.5 - 1;
    EXPECT_EQ(tensions(joined, rest), (std::vector{strain, strain, 0.0}));
}

}  // namespace
}  // namespace voxspring::testing
