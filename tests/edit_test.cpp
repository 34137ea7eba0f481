// Which springs a cut removes and a suture adds, and what an edit says about them.
#include "backends/physics/edit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "tests/support.h"

namespace voxspring::testing {
namespace {

const double sqrt2 = std::sqrt(2.0);

using Pair = std::pair<std::uint32_t, std::uint32_t>;

Problem paper_box(glm::ivec3 dims) { return make_lattice_problem(solid(dims), FACE_BITS | EDGE_BITS); }

/// Expects an edit to say of its particles what the edited problem has.
void expect_consistent(const SpringEdit& edit, const Problem& edited) {
    const std::vector<Spring> all = list_springs(edited);
    for (std::size_t n = 0; n < edit.touched.size(); ++n) {
        const SpringEdit::Touched& touched = edit.touched[n];
        if (n > 0) {
            EXPECT_LT(edit.touched[n - 1].particle, touched.particle);
        }
        if (!edited.lattice.mask.empty()) {
            EXPECT_EQ(touched.mask, edited.lattice.mask[touched.particle]);
        }
        std::multiset<std::tuple<std::uint32_t, double, double>> listed, expected;
        for (const ListedSpring& s : edit.springs_of(touched))
            listed.emplace(s.neighbour, s.stiffness, s.rest_length);
        for (const Spring& s : all) {
            if (s.first == touched.particle) expected.emplace(s.second, s.stiffness, s.rest_length);
            if (s.second == touched.particle) expected.emplace(s.first, s.stiffness, s.rest_length);
        }
        EXPECT_EQ(listed, expected) << "particle " << touched.particle;
    }
}

TEST(Cuts, LieBetweenTheEndsOfASpring) {
    const Shape plane = Plane{{1.5, 0, 0}, {2, 0, 0}}, on_centres = Plane{{1, 0, 0}, {1, 0, 0}},
                narrow = TrianglePatch{{{{{0.5, -1, -1}, {0.5, 1, -1}, {0.5, 0, 1}}}}};
    // Counter-clockwise as seen from above, so that its normal is +z.
    const std::array<glm::dvec3, 3> up = {{{-9, -9, 1}, {9, -9, 1}, {0, 9, 1}}};
    const Shape patch = TrianglePatch{{up}}, turned = TrianglePatch{{{{up[0], up[2], up[1]}}}},
                ball = Ball{{0, 0, 0}, 1};
    const struct {
        const char* what;
        const Shape& shape;
        glm::dvec3 from, to;
        bool cut;
    } cases[] = {
        {"a plane", plane, {1, 0, 0}, {2, 0, 0}, true},
        {"a plane from the other side", plane, {2, 5, 0}, {1, 4, 0}, true},
        {"a plane elsewhere", plane, {0, 0, 0}, {1, 0, 0}, false},
        {"a particle on the plane counts as above it", on_centres, {0, 0, 0}, {1, 0, 0}, true},
        {"a particle on the plane", on_centres, {1, 0, 0}, {2, 0, 0}, false},
        {"a patch", narrow, {0, 0, 0}, {1, 0, 0}, true},
        {"a patch from the other side", narrow, {1, 0, 0}, {0, 0, 0}, true},
        {"beyond a patch's border", narrow, {0, 0, 2}, {1, 0, 2}, false},
        {"beside a patch", narrow, {0, 0, 0}, {0, 1, 0}, false},
        {"behind a patch", narrow, {1, 0, 0}, {2, 0, 0}, false},
        {"a particle in a triangle's plane is on the side of its normal", patch, {0, 0, 0}, {0, 0, 1}, true},
        {"so nothing is between it and what is above", patch, {0, 0, 1}, {0, 0, 2}, false},
        {"a triangle that is turned over", turned, {0, 0, 0}, {0, 0, 1}, false},
        {"above a triangle that is turned over", turned, {0, 0, 1}, {0, 0, 2}, true},
        {"within the plane", patch, {0, 0, 1}, {1, 0, 1}, false},
        {"both ends in a ball", ball, {0, 0, 0}, {1, 0, 0}, true},
        {"one end in a ball", ball, {0, 0, 0}, {1, 1, 0}, false},
    };
    for (const auto& c : cases) EXPECT_EQ(cuts(c.shape, c.from, c.to), c.cut) << c.what;
}

TEST(Cuts, NoLineSlipsBetweenTriangles) {
    // A square of two triangles whose common diagonal and borders go through many of the lines.
    for (const double tilt : {0.0, 0.1, 1.0 / 3}) {
        const glm::dvec3 a(0.5, -4, -4), b(0.5 + tilt, 4, -4), c(0.5 + tilt, 4, 4), d(0.5, -4, 4);
        const Shape patch = TrianglePatch{{{a, b, c}, {a, c, d}}};
        for (int y = -3; y <= 3; ++y) {
            for (int z = -3; z <= 3; ++z) EXPECT_TRUE(cuts(patch, {-1, y, z}, {2, y, z})) << y << " " << z;
        }
    }
}

TEST(SpringEditor, APlaneTakesTheSpringsThatCrossIt) {
    Problem problem = paper_box({6, 5, 4});
    const SpringCounts before = count_springs(problem);
    SpringEditor editor(problem);
    const SpringEdit edit = editor.cut(Plane{{2.5, 0, 0}, {1, 0, 0}});
    // Between two layers of 5 x 4 particles: one face spring per particle, and two edge springs per pair of
    // neighbours in the layer.
    EXPECT_EQ(edit.removed.size(), 20u + 2 * (4 * 4 + 5 * 3));
    EXPECT_EQ(edit.touched.size(), 40u);
    EXPECT_TRUE(edit.added.empty());
    const SpringCounts after = count_springs(problem);
    EXPECT_EQ(before.group[0] - after.group[0], 20u);
    EXPECT_EQ(before.group[1] - after.group[1], 62u);
    expect_consistent(edit, problem);
    // A second cut finds no spring.
    EXPECT_TRUE(editor.cut(Plane{{2.5, 0, 0}, {1, 0, 0}}).empty());
}

/// Triangles all over a box of `side`, small and large, some of them through voxel centres.
TrianglePatch random_patch(std::size_t triangles, double side, unsigned seed) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> place(-1, side), extent(-2, 2);
    TrianglePatch patch;
    for (std::size_t t = 0; t < triangles; ++t) {
        const glm::dvec3 a(place(generator), place(generator), place(generator));
        auto corner = [&] { return a + glm::dvec3(extent(generator), extent(generator), extent(generator)); };
        std::array<glm::dvec3, 3> triangle{a, corner(), corner()};
        if (t % 3 == 0) {
            for (glm::dvec3& point : triangle) point = glm::round(2.0 * point) / 2.0;
        }
        patch.triangles.push_back(triangle);
    }
    return patch;
}

// However springs are searched, a patch cuts exactly those of which cuts() says so.
TEST(SpringEditor, APatchCutsWhatEachOfItsTrianglesCuts) {
    for (const std::size_t triangles : {1, 4, 5, 40, 400}) {
        const Shape patch = random_patch(triangles, 9, unsigned(triangles));
        const Problem whole = paper_box({9, 8, 7});
        Problem problem = whole;
        SpringEditor editor(problem);
        const SpringEdit cut = editor.cut(patch);
        expect_consistent(cut, problem);
        std::vector<std::pair<std::uint32_t, std::uint32_t>> expected, found;
        for (const Spring& spring : list_springs(whole)) {
            if (cuts(patch, whole.rest_position[spring.first], whole.rest_position[spring.second]))
                expected.emplace_back(spring.first, spring.second);
        }
        for (const ChangedSpring& changed : cut.removed)
            found.emplace_back(changed.spring.first, changed.spring.second);
        std::sort(expected.begin(), expected.end());
        std::sort(found.begin(), found.end());
        ASSERT_TRUE(triangles <= 4 || !expected.empty());
        EXPECT_EQ(found, expected) << triangles;
        // A suture of the same faces brings back every one of them.
        editor.suture(patch, 1.5);
        EXPECT_EQ(problem.lattice.mask, whole.lattice.mask);
        EXPECT_TRUE(problem.springs.empty());
    }
}

// Neither a rest length nor the place of a body in space changes which springs a shape cuts.
TEST(SpringEditor, ShapesCutWhereParticlesAreAtRest) {
    const auto removed = [](Problem problem, const Shape& shape) {
        std::vector<Pair> pairs;
        for (const ChangedSpring& changed : SpringEditor(problem).cut(shape).removed)
            pairs.emplace_back(changed.spring.first, changed.spring.second);
        return pairs;
    };
    const Problem box = paper_box({6, 5, 4});
    const Shape patch = TrianglePatch{{{{{2.95, -1, -1}, {2.95, 9, -1}, {2.95, -1, 9}}}}};
    const std::vector<Pair> cut = removed(box, patch);
    ASSERT_FALSE(cut.empty());
    Problem shrinking = box;
    shrinking.rest_length.fill(0.25);
    EXPECT_EQ(removed(shrinking, patch), cut);

    const glm::dvec3 by(128, -64, 8);
    Problem moved = box;
    for (glm::dvec3& position : moved.rest_position) position += by;
    TrianglePatch patch_there = std::get<TrianglePatch>(patch);
    for (glm::dvec3& corner : patch_there.triangles.front()) corner += by;
    EXPECT_EQ(removed(moved, patch_there), cut);
    const std::vector<Pair> in_ball = removed(box, Ball{{3, 2, 2}, 1.5});
    ASSERT_FALSE(in_ball.empty());
    EXPECT_EQ(removed(moved, Ball{glm::dvec3(3, 2, 2) + by, 1.5}), in_ball);
}

// The lines pass above the patch by less than coordinates of their ends are rounded by.
TEST(SpringEditor, APatchCutsLinesThatReachFarAsItsTrianglesDo) {
    const Shape patch = TrianglePatch{{{{{-0.5, -1, 0.5}, {0.5, -1, -0.5}, {0, 1, 0}}}}};
    Problem whole;
    std::mt19937 generator(6);
    std::uniform_real_distribution<double> factor(0.5, 1);
    for (std::uint32_t line = 0; line < 100; ++line) {
        const double far = 1e8 * factor(generator), back = factor(generator), above = 1 + 4e-9;
        const glm::dvec3 end(far, above, far * factor(generator));
        whole.rest_position.push_back(end);
        whole.rest_position.emplace_back(-back * end.x, above, -back * end.z);
        whole.springs.push_back({2 * line, 2 * line + 1, 1, 1});
    }
    std::vector<Spring> kept = whole.springs;
    std::erase_if(kept, [&](const Spring& spring) {
        return cuts(patch, whole.rest_position[spring.first], whole.rest_position[spring.second]);
    });
    ASSERT_LT(kept.size(), whole.springs.size()) << "rounding moves no line";
    Problem problem = whole;
    EXPECT_EQ(SpringEditor(problem).cut(patch).removed.size(), whole.springs.size() - kept.size());
    EXPECT_EQ(problem.springs, kept);
}

// A line is compared only with the triangles near it. Comparing all 3e10 pairs would take minutes.
TEST(SpringEditor, ALargePatchTakesNoTimeForEachOfItsTriangles) {
    Problem problem = paper_box({64, 64, 64});
    SpringEditor editor(problem);
    TrianglePatch patch;
    for (int y = 0; y < 150; ++y) {
        for (int z = 0; z < 100; ++z) {
            const glm::dvec3 a(31.3, y * 0.45 - 1, z * 0.7 - 1);
            patch.triangles.push_back({a, a + glm::dvec3(0, 0.45, 0), a + glm::dvec3(0, 0.45, 0.7)});
            patch.triangles.push_back({a, a + glm::dvec3(0, 0.45, 0.7), a + glm::dvec3(0, 0, 0.7)});
        }
    }
    const std::clock_t begin = std::clock();
    EXPECT_EQ(editor.cut(patch).removed.size(), 64u * 64 + 4 * 64 * 63);
    // It takes 0.1 s. Even 100 times that, under a sanitizer on a busy machine, is far from minutes.
    EXPECT_LT(double(std::clock() - begin) / CLOCKS_PER_SEC, 10);
}

TEST(SpringEditor, PairsAreCutWhateverTheirOrder) {
    Problem problem = paper_box({4, 3, 2});
    SpringEditor editor(problem);
    const std::vector<Pair> far = {{0, 23}};
    editor.suture(far);
    const Problem before = problem;
    // Two lattice springs, one of them twice; a spring beyond the lattice; neighbours of a group that is not
    // in use; and two particles that are no neighbours.
    const std::vector<Pair> pairs = {{1, 0}, {23, 0}, {4, 5}, {0, 1}, {0, 17}, {0, 3}};
    const SpringEdit edit = editor.cut(pairs);
    ASSERT_EQ(edit.removed.size(), 3u);
    EXPECT_TRUE(edit.added.empty());
    EXPECT_EQ(edit.removed[0].bit, 1);
    EXPECT_EQ(edit.removed[0].spring.second, 1u);
    EXPECT_EQ(edit.removed[0].spring.rest_length, 1);
    EXPECT_EQ(edit.removed[1].bit, 1);
    EXPECT_EQ(edit.removed[1].spring.first, 4u);
    EXPECT_EQ(edit.removed[2].bit, -1);
    EXPECT_EQ(count_springs(problem).total(), count_springs(before).total() - 3);
    EXPECT_TRUE(problem.springs.empty());
    expect_consistent(edit, problem);
    Problem replayed = before;
    apply(replayed, edit);
    expect_same_springs(replayed, problem);
    EXPECT_TRUE(editor.cut(pairs).empty());
}

TEST(SpringEditor, PairsOfANetworkAreCut) {
    Problem problem = random_network(10, 40, 5);
    const Spring first = problem.springs.front();
    problem.springs.push_back(first);  // joined twice
    const std::size_t before = problem.springs.size();
    const std::vector<Pair> pairs = {{first.second, first.first}};
    const SpringEdit edit = SpringEditor(problem).cut(pairs);
    EXPECT_GE(edit.removed.size(), 2u);
    EXPECT_EQ(problem.springs.size(), before - edit.removed.size());
    for (const Spring& spring : problem.springs)
        EXPECT_NE(Pair(spring.first, spring.second), Pair(first.first, first.second));
    expect_consistent(edit, problem);
}

TEST(SpringEditor, WhatWasCutIsJoinedAsItWas) {
    Problem problem = paper_box({4, 3, 2});
    SpringEditor editor(problem);
    // Stiffnesses and rest lengths that no suture would choose, and two springs between the same particles.
    problem.springs = {{0, 23, 0.125, 7}, {0, 23, 0.25, 6}, {1, 22, 0.5, 5}};
    const Problem whole = problem;
    const SpringEdit cut = editor.cut(Ball{{1.5, 1, 0.5}, 9});
    EXPECT_EQ(count_springs(problem).total(), 0u);
    std::vector<ChangedSpring> removed(cut.removed.rbegin(), cut.removed.rend());
    const SpringEdit joined = editor.join(removed);
    EXPECT_EQ(joined.added.size(), cut.removed.size());
    EXPECT_GE(joined.added.front().bit, 0) << "lattice springs come first";
    EXPECT_TRUE(joined.leaves_lattice());
    expect_consistent(joined, problem);
    std::reverse(problem.springs.begin(), problem.springs.end());
    expect_same_springs(problem, whole);
}

TEST(SpringEditor, WhatIsJoinedStaysAsItIs) {
    Problem problem = paper_box({4, 3, 2});
    SpringEditor editor(problem);
    const std::vector<Pair> neighbours = {{0, 1}}, far = {{0, 23}};
    const SpringEdit cut = editor.cut(neighbours);
    const SpringEdit suture = editor.suture(far, 0.5);
    editor.suture(neighbours, 0.125);  // another stiffness than the lattice's
    const Problem before = problem;
    EXPECT_TRUE(editor.join(cut.removed).empty());
    EXPECT_TRUE(editor.join(suture.added).empty());
    expect_same_springs(problem, before);
}

TEST(SpringEditor, ASutureOfTheSameFacesRestoresTheLattice) {
    const std::vector<Shape> shapes = {Plane{{2.5, 0, 0}, {1, 0.3, -0.2}}, Ball{{3, 2, 2}, 1.8},
                                       TrianglePatch{{{{{2.5, -1, -1}, {2.5, 9, -1}, {2.5, 0, 9}}}}}};
    for (const Shape& shape : shapes) {
        const Problem whole = make_lattice_problem(random_grid({7, 6, 5}, 0.8, 3), FACE_BITS | EDGE_BITS);
        Problem problem = whole;
        SpringEditor editor(problem);
        const SpringEdit cut = editor.cut(shape);
        EXPECT_FALSE(cut.empty());
        EXPECT_NE(problem.lattice.mask, whole.lattice.mask);
        const SpringEdit suture = editor.suture(shape, sqrt2);
        EXPECT_FALSE(suture.leaves_lattice());
        EXPECT_EQ(suture.added.size(), cut.removed.size());
        expect_same_springs(problem, whole);
        expect_consistent(suture, problem);
    }
}

TEST(SpringEditor, AWideSutureReachesBeyondTheLatticeAndOnlyAcrossTheCut) {
    Problem problem = paper_box({6, 1, 1});
    SpringEditor editor(problem);
    const Plane plane{{2.5, 0, 0}, {1, 0, 0}};
    // Without a cut there are no faces to suture.
    EXPECT_TRUE(editor.suture(plane, 4).empty());
    editor.cut(plane);
    const SpringEdit narrow = editor.suture(plane, 0.5);
    EXPECT_TRUE(narrow.empty());
    // However wide, a suture joins all of both faces.
    for (const double within : {4.0, 1e10, std::numeric_limits<double>::infinity()}) {
        Problem sewn = problem;
        EXPECT_EQ(SpringEditor(sewn).suture(plane, within).added.size(), 1u) << within;
    }
    Problem stiff = problem;
    const SpringEdit own = SpringEditor(stiff).suture(plane, 4, 0.125);
    ASSERT_EQ(own.added.size(), 1u);
    EXPECT_TRUE(own.leaves_lattice());
    EXPECT_EQ(own.added[0].spring.stiffness, 0.125);
    EXPECT_EQ(own.added[0].spring.rest_length, 1);
    ASSERT_EQ(stiff.springs.size(), 1u);
    expect_consistent(own, stiff);
    // The only faces are 2 and 3.
    EXPECT_EQ(editor.suture(plane, 4).added.size(), 1u);
    expect_same_springs(problem, paper_box({6, 1, 1}));
}

TEST(SpringEditor, ASutureBeyondTheLatticeIsAsStiffAsTheFirstGroupInUse) {
    for (const bool faces : {true, false}) {
        Problem problem = make_lattice_problem(solid({5, 5, 1}), (faces ? FACE_BITS : 0U) | EDGE_BITS);
        problem.group_stiffness = {2, 3, 5};
        const std::vector<Pair> far = {{0, 3}}, neighbours = {{0, 1}}, diagonal = {{0, 6}};
        SpringEditor editor(problem);
        EXPECT_EQ(editor.suture(far).added.at(0).spring.stiffness, faces ? 2 : 3);
        // Neighbours of a group that is not in use are joined as any other particles.
        if (!faces) {
            EXPECT_EQ(editor.suture(neighbours).added.at(0).bit, -1);
        }
        editor.cut(diagonal);
        const SpringEdit restored = editor.suture(diagonal);
        EXPECT_EQ(restored.added.at(0).spring.stiffness, 3);
        EXPECT_GE(restored.added.at(0).bit, 0);
    }
}

TEST(SpringEditor, ASutureStaysAcrossTheCut) {
    Problem problem = paper_box({6, 4, 1});
    SpringEditor editor(problem);
    const Plane plane{{2.5, 0, 0}, {1, 0, 0}};
    editor.cut(plane);
    // Rows at a distance of 0, 1 and 2; two particles on the same side that are 2 apart stay unjoined.
    EXPECT_EQ(editor.suture(plane, 2.5).added.size(), 4u + 6 + 4);
    EXPECT_EQ(problem.springs.size(), 4u);
}

TEST(SpringEditor, PairsAreJoinedOnce) {
    Problem problem = paper_box({4, 3, 2});
    SpringEditor editor(problem);
    const std::vector<Pair> pairs = {{0, 1}, {23, 0}, {0, 23}, {2, 0}};
    const SpringEdit edit = editor.suture(pairs);
    ASSERT_EQ(edit.added.size(), 2u);
    EXPECT_EQ(edit.added[0].spring.second, 2u);
    EXPECT_EQ(edit.added[1].spring.second, 23u);
    EXPECT_EQ(edit.added[1].spring.rest_length, glm::length(glm::dvec3(3, 2, 1)));
    EXPECT_TRUE(edit.leaves_lattice());
    expect_consistent(edit, problem);
    EXPECT_TRUE(editor.suture(pairs).empty());
    // A cut removes them again.
    const SpringEdit cut = editor.cut(Ball{{1.5, 1, 0.5}, 9});
    EXPECT_EQ(count_springs(problem).total(), 0u);
    expect_consistent(cut, problem);
    EXPECT_EQ(cut.touched.size(), 24u);
    for (const SpringEdit::Touched& touched : cut.touched) EXPECT_EQ(touched.mask, ACTIVE_BIT);
}

TEST(SpringEditor, NetworksAreCutAndSutured) {
    Problem problem = random_network(60, 300, 4);
    pin(problem, std::vector<std::uint8_t>(60, 1));
    const std::size_t before = problem.springs.size();
    Problem replayed = problem;
    SpringEditor editor(problem);
    const SpringEdit cut = editor.cut(Plane{{2, 2, 2}, {1, 1, 0}});
    EXPECT_EQ(problem.springs.size(), before - cut.removed.size());
    EXPECT_GT(cut.removed.size(), 50u);
    expect_consistent(cut, problem);
    for (const SpringEdit::Touched& touched : cut.touched) EXPECT_EQ(touched.mask, ACTIVE_BIT | PINNED_BIT);
    const std::vector<Pair> pairs = {{5, 50}, {6, 51}};
    const SpringEdit suture = editor.suture(pairs, 0.05);
    expect_consistent(suture, problem);
    apply(replayed, cut);
    apply(replayed, suture);
    expect_same_springs(replayed, problem);
}

/// Makes each of `edits` again from its difference.
void expect_differences_to_say_all(const Problem& before, const std::vector<SpringEdit>& edits) {
    Problem made = before, applied = before;
    SpringEditor editor(made);
    for (const SpringEdit& edit : edits) {
        const SpringDifference difference = edit;
        EXPECT_EQ(changed_springs(made, difference.removed), edit.removed);
        EXPECT_EQ(difference.leaves_lattice(), edit.leaves_lattice());
        EXPECT_EQ(editor.make(difference), edit);
        EXPECT_EQ(changed_springs(made, difference.added), edit.added);
        apply(applied, difference);
        expect_same_springs(applied, made);
    }
}

TEST(SpringDifference, SaysAllThatItsEditDoes) {
    Problem full = paper_box({9, 8, 7});
    Problem porous = make_lattice_problem(
        make_grid({9, 8, 7}, [](int x, int y, int z) { return (x + 2 * y + 3 * z) % 7 != 0; }),
        NEIGHBOUR_BITS);
    porous.materials = {{1, 1}, {1, 3}};
    for (std::size_t i = 0; i < porous.particle_count(); ++i) porous.material.push_back(i % 3 == 0 ? 1 : 0);
    for (const Problem& whole : {full, porous}) {
        Problem edited = whole;
        expect_differences_to_say_all(whole, edit_everything(edited, true));
        edited = whole;
        // Some of the joins list their springs in no particular order.
        expect_differences_to_say_all(whole, random_edits(edited, 8, 3));
    }
    Problem network = random_network(40, 120, 5);
    const Problem whole = network;
    const std::vector<SpringEdit> cut = {SpringEditor(network).cut(Plane{{2, 2, 2}, {1, 1, 0}})};
    expect_differences_to_say_all(whole, cut);
}

TEST(SpringEditor, PinnedParticlesStayPinned) {
    Problem problem = make_lattice_problem(random_grid({8, 7, 9}, 0.9, 6), FACE_BITS | EDGE_BITS);
    pin_base(problem);
    const Problem before = problem;
    SpringEditor editor(problem);
    const Shape across = Plane{{3.5, 0, 0}, {1, 0, 0}};
    for (const SpringEdit& edit : {editor.cut(across), editor.suture(across, 1.5)}) {
        std::size_t pinned = 0;
        for (const SpringEdit::Touched& touched : edit.touched) {
            EXPECT_EQ((touched.mask & PINNED_BIT) != 0, before.is_pinned(touched.particle));
            pinned += before.is_pinned(touched.particle) ? 1 : 0;
        }
        EXPECT_GT(pinned, 3u) << "the cut goes through the base";
    }
    EXPECT_EQ(problem.pinned, before.pinned);
    EXPECT_EQ(problem.lattice.mask, before.lattice.mask) << "the same faces are joined again";
}

TEST(SpringEditor, BetweenMaterialsASutureIsTheirSeries) {
    Problem problem =
        make_lattice_problem(make_grid({4, 1, 1}, [](int x, int, int) { return x < 2 ? 1 : 2; }), FACE_BITS);
    problem.materials = {{1, 1}, {1, 3}};
    SpringEditor editor(problem);
    const std::vector<Pair> pairs = {{0, 3}};
    const SpringEdit edit = editor.suture(pairs);
    ASSERT_EQ(edit.added.size(), 1u);
    EXPECT_DOUBLE_EQ(edit.added[0].spring.stiffness, 1.5);
}

}  // namespace
}  // namespace voxspring::testing
