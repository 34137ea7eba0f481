// Pictures: the surface that they show, the scale that colours it, and pixels.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "harness/drawing/body_mesh.h"
#include "harness/drawing/legend.h"
#include "harness/export/pictures.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

Problem lattice(const VoxelGrid& grid) { return make_lattice_problem(grid, NEIGHBOUR_BITS); }

// --- The surface ------------------------------------------------------------------------------------------

TEST(Surface, HasEveryFaceBetweenActiveAndInactive) {
    const auto faces = [](const VoxelGrid& grid) { return mesh_of(lattice(grid)).faces.size(); };
    EXPECT_EQ(faces(solid({1, 1, 1})), 6u);
    EXPECT_EQ(faces(solid({4, 5, 6})), 2 * (4 * 5 + 5 * 6 + 6 * 4u));
    // The hollow's six faces are as much surface as the outside, though no picture shows them.
    EXPECT_EQ(faces(make_grid({5, 5, 5}, [](int x, int y, int z) { return x != 2 || y != 2 || z != 2; })),
              6 * 25 + 6u);
    const VoxelGrid random = random_grid({7, 6, 5}, 0.5, 3);
    std::size_t open = 0;
    const auto is_active = [&](int x, int y, int z) {
        return x >= 0 && y >= 0 && z >= 0 && x < 7 && y < 6 && z < 5 &&
               random.label[std::size_t((z * 6 + y) * 7 + x)] != 0;
    };
    for (int z = 0; z < 5; ++z) {
        for (int y = 0; y < 6; ++y) {
            for (int x = 0; x < 7; ++x) {
                for (const int side : {-1, 1})
                    open += is_active(x, y, z) * (!is_active(x + side, y, z) + !is_active(x, y + side, z) +
                                                  !is_active(x, y, z + side));
            }
        }
    }
    EXPECT_EQ(faces(random), open);
}

TEST(Surface, IsWhereTheBodyIsAndFacesOutwards) {
    const glm::dvec3 spacing(1, 0.5, 2);
    const Problem problem = lattice(solid({6, 6, 6}, spacing));
    const glm::dvec3 low = problem.rest_position.front() - spacing / 2.0;
    constexpr double rounding = 1e-5;  // of places in float32
    const BodyMesh mesh = mesh_of(problem);
    for (const auto& face : mesh.faces) {
        std::array<glm::dvec3, 4> place;
        for (std::size_t n = 0; n < 4; ++n) place[n] = mesh.vertices[face[n]].rest;
        const glm::dvec3 middle = (place[0] + place[1] + place[2] + place[3]) / 4.0;
        EXPECT_GT(
            glm::dot(glm::cross(place[2] - place[0], place[3] - place[1]), middle - (low + 3.0 * spacing)), 0)
            << "seen from outside: clockwise";
        for (const glm::dvec3& vertex : place) {
            // In voxels: at most on the box's planes, and exactly on one of them except at the box's edges,
            // which are rounded.
            int inside = 0;
            double nearest = 6;
            for (int a = 0; a < 3; ++a) {
                const double at = (vertex[a] - low[a]) / spacing[a];
                const double depth = std::min(at, 6 - at);
                EXPECT_GT(depth, -rounding);
                nearest = std::min(nearest, depth);
                inside += depth > 0.5;
            }
            EXPECT_LT(nearest, inside == 2 ? rounding : 0.5);
        }
    }
    // A particle without neighbours is a cell around itself.
    for (const BodyMesh::Vertex& vertex : mesh_of(lattice(solid({1, 1, 1}))).vertices)
        EXPECT_NEAR(glm::length(vertex.rest), 0.3, 0.2);
}

TEST(Surface, HasSharedVerticesWhichACutParts) {
    // The corners of a box of 6 x 4 x 5 voxels on its sides, then those of two boxes of 3 x 4 x 5.
    Problem problem = lattice(solid({6, 4, 5}));
    const BodyMesh whole = mesh_of(problem);
    EXPECT_EQ(whole.vertices.size(), 7u * 5 * 6 - 5u * 3 * 4);
    SpringEditor(problem).cut(Plane{.point = {2.5, 0, 0}, .normal = {1, 0, 0}});
    const BodyMesh cut = mesh_of(problem);
    EXPECT_EQ(cut.vertices.size(), 2 * (4u * 5 * 6 - 2u * 3 * 4));
    EXPECT_EQ(cut.faces.size(), whole.faces.size() + 2 * 4u * 5);
    int lips = 0;
    for (const BodyMesh::Vertex& vertex : cut.vertices) {
        ASSERT_GE(vertex.count, 1u);
        ASSERT_LE(vertex.count, 8u);
        std::set<bool> sides;
        for (std::size_t n = 0; n < vertex.count; ++n)
            sides.insert(problem.rest_position[cut.particles[vertex.follows[n]]].x > 2.5);
        EXPECT_EQ(sides.size(), 1u) << "no mean across the cut";
        lips += std::abs(vertex.rest.x - 2.5F) < 1e-5F;
    }
    EXPECT_GE(lips, 2 * 2 * 3) << "cut faces lie in the plane of the cut";
}

TEST(Surface, ListsTheFacesAroundAVertex) {
    const BodyMesh mesh = mesh_of(lattice(random_grid({7, 6, 5}, 0.5, 3)));
    EXPECT_TRUE(std::is_sorted(mesh.particles.begin(), mesh.particles.end()));
    std::map<std::uint32_t, std::multiset<std::uint32_t>> around;
    for (std::uint32_t f = 0; f < mesh.faces.size(); ++f) {
        for (const std::uint32_t vertex : mesh.faces[f]) around[vertex].insert(f);
    }
    for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
        const std::multiset<std::uint32_t> listed(mesh.face_of_vertex.begin() + mesh.first_face[v],
                                                  mesh.face_of_vertex.begin() + mesh.first_face[v + 1]);
        EXPECT_EQ(listed, around[v]);
    }
}

TEST(Surface, NeedsALattice) {
    EXPECT_THAT([] { (void)mesh_of(random_network(8, 20, 1)); },
                ThrowsMessage<std::runtime_error>(HasSubstr("no lattice")));
}

// --- The legend -------------------------------------------------------------------------------------------

TEST(Scale, RunsFromTheLeastToTheMost) {
    const Scale even(Colouring::displacement, 6.742);
    EXPECT_EQ(even.place(0), 0);
    EXPECT_EQ(even.place(3.371), 0.5);
    EXPECT_EQ(even.place(6.742), 1);
    const Scale decades(Colouring::error, 1e-5);
    EXPECT_EQ(decades.place(0), 0);
    EXPECT_EQ(decades.place(1e-9), 0);
    // log10 of a quotient that is no power of ten to the bit.
    EXPECT_NEAR(decades.place(1e-6), 2.0 / 3, 1e-15);
    EXPECT_EQ(decades.place(1e-5), 1);
    for (const Colouring colouring : {Colouring::displacement, Colouring::error}) {
        // A scale for errors of zero is valid too.
        EXPECT_EQ(Scale(colouring, 0).place(0), 0);
        EXPECT_EQ(Scale(colouring, 0).ticks().size(), 1u);
        for (const double most : {1e-300, 2.99e-6, 0.0307, 0.1, 1.0, 6.742, 9.99, 167.0, 1e200}) {
            const Scale scale(colouring, most);
            const auto ticks = scale.ticks();
            EXPECT_GE(ticks.size(), 3u) << most;
            EXPECT_LE(ticks.size(), 6u) << most;
            for (std::size_t n = 0; n < ticks.size(); ++n) {
                // A label shows the value in at most three digits.
                EXPECT_NEAR(std::stod(ticks[n].label), ticks[n].value, 0.005 * ticks[n].value)
                    << ticks[n].label;
                EXPECT_LE(ticks[n].value, most * (1 + 1e-13));
                if (n == 0) continue;
                EXPECT_GT(scale.place(ticks[n].value), scale.place(ticks[n - 1].value));
            }
        }
    }
}

TEST(Legend, ShowsItsColoursFromEndToEnd) {
    Image image(640, 480);
    draw_legend(image, Scale(Colouring::displacement, 5));
    int bar = 0;
    std::array<double, 3> first{}, last{};
    for (int x = 0; x < image.width; ++x) {
        // In the middle of the bar.
        const std::uint8_t* pixel = image.at(x, int(image.height * (1 - 0.52 * legend_share)));
        if (pixel[3] != 255) continue;
        for (std::size_t c = 0; c < 3; ++c) (bar == 0 ? first : last)[c] = pixel[c] / 255.0;
        ++bar;
    }
    EXPECT_GT(bar, image.width / 2);
    const auto& colours = colours_of(Colouring::displacement);
    for (std::size_t c = 0; c < 3; ++c) {
        // Half a pixel off the end, and rounded to 1/255.
        EXPECT_NEAR(first[c], colours.front()[c], 0.01);
        EXPECT_NEAR(last[c], colours.back()[c], 0.01);
    }
    // Nothing is drawn above the legend's share.
    for (int y = 0; y < int(image.height * (1 - legend_share)); ++y) {
        for (int x = 0; x < image.width; ++x) ASSERT_EQ(image.at(x, y)[3], 0);
    }
}

TEST(Png, RefusesWhatIsNoImage) {
    EXPECT_THAT([] { encode_png(Image(0, 5), {}); }, ThrowsMessage<std::runtime_error>(HasSubstr("PNG: ")));
}

// --- Pixels -----------------------------------------------------------------------------------------------

/// Skips its tests where there is no OpenGL; VOXSPRING_REQUIRE=gl makes that a failure.
class Pixels : public ::testing::Test {
protected:
    void SetUp() override {
        skip_without("gl", [&] { painter_.emplace(context_.emplace(), for_files); });
    }

    /// Draws the body at rest, with `value(rest position)` for each particle.
    template <class Value>
    Image paint(const Problem& problem, Value value) {
        std::vector<double> values;
        for (const glm::dvec3& rest : problem.rest_position) values.push_back(value(rest));
        painter_->set_mesh(mesh_of(problem));
        painter_->put_values(values);
        SlantedCamera camera;
        camera.include(painter_->places());
        view_ = camera.view(size, 1 - legend_share);
        painter_->draw(view_, {});
        return painter_->picture();
    }
    glm::ivec2 pixel_of(glm::dvec3 position) const { return view_.pixel_of(position); }

    static constexpr glm::ivec2 size{320, 240};
    static constexpr int above_legend = int(size.y * (1 - legend_share));
    std::optional<gl::Context> context_;
    std::optional<BodyPainter> painter_;
    View view_;
};

TEST_F(Pixels, OfABoxFillTheirBoundsAndNothingElse) {
    const Image image = paint(lattice(solid({9, 9, 9})), [](glm::dvec3) { return 0.5; });
    for (const int x : {0, size.x - 1}) {
        for (const int y : {0, size.y - 1}) EXPECT_EQ(image.at(x, y)[3], 0) << x << ", " << y;
    }
    glm::dvec2 low(1e9), high(-1e9);
    for (const BodyMesh::Vertex& vertex : painter_->mesh().vertices) {
        low = glm::min(low, view_.pixel_of(vertex.rest));
        high = glm::max(high, view_.pixel_of(vertex.rest));
    }
    glm::ivec2 first(size), last(-1);
    int opaque = 0;
    int partly = 255;  // least green
    int fully = 255;
    for (int y = 0; y < size.y; ++y) {
        for (int x = 0; x < size.x; ++x) {
            if (image.at(x, y)[3] == 0) continue;
            first = glm::min(first, glm::ivec2(x, y));
            last = glm::max(last, glm::ivec2(x, y));
            opaque += image.at(x, y)[3] == 255;
            int& least = image.at(x, y)[3] == 255 ? fully : partly;
            least = std::min(least, int(image.at(x, y)[1]));
        }
    }
    // A pixel at an edge is as bright as the share of it that is covered; a quarter of it shows a colour to
    // 4/255.
    EXPECT_LT(partly, 255);
    EXPECT_NEAR(partly, fully, 4);
    // A pixel is covered where one of its samples is: off by one at most.
    for (int a = 0; a < 2; ++a) {
        EXPECT_NEAR(first[a], low[a], 1) << a;
        EXPECT_NEAR(last[a] + 1, high[a], 1) << a;
    }
    EXPECT_LE(last.y, above_legend);
    // A convex outline of a cube fills about three quarters of its bounds.
    const double share = opaque / ((high.x - low.x) * (high.y - low.y));
    EXPECT_GT(share, 0.6);
    EXPECT_LT(share, 0.9);
    const glm::ivec2 middle = pixel_of({4, 4, 4});
    EXPECT_EQ(image.at(middle.x, middle.y)[3], 255);
}

TEST_F(Pixels, HaveTheColourOfTheirPlace) {
    // From 0 at the bottom to 1 on top: the front goes from viridis' purple to its yellow.
    const Problem problem = lattice(solid({9, 9, 9}));
    const double bottom = problem.rest_position.front().z;
    const Image image = paint(problem, [&](glm::dvec3 x) { return (x.z - bottom) / 8; });
    const glm::dvec3 front = problem.rest_position.front() + glm::dvec3(4, -0.5, 0);
    const glm::ivec2 low = pixel_of(front);
    const glm::ivec2 high = pixel_of(front + glm::dvec3(0, 0, 8));
    const std::uint8_t* purple = image.at(low.x, low.y);
    const std::uint8_t* yellow = image.at(high.x, high.y);
    // Light changes the brightness of a colour, not which component is the largest: blue, then red and green.
    EXPECT_GT(purple[2], purple[0]);
    EXPECT_GT(purple[0], purple[1]);
    EXPECT_GT(yellow[0], 2 * yellow[2]);
    EXPECT_GT(yellow[1], 2 * yellow[2]);
    EXPECT_GT(yellow[1], 100 + purple[1]);
    // Between two knots of the colour scale the components lie between those of the knots: red is 0.75 of
    // green at knot 13 of 0 to 15, 0.93 at knot 14, and 0.84 halfway. Gloss adds a little white.
    const Image between = paint(problem, [](glm::dvec3) { return 13.5 / 15; });
    const std::uint8_t* lime = between.at(high.x, high.y);
    EXPECT_NEAR(double(lime[0]) / lime[1], 0.84, 0.03);
}

TEST_F(Pixels, ShowWhatIsBehindAHole) {
    // A ring around y in a slice two voxels thick, which the camera looks through.
    const Problem problem = lattice(make_grid({24, 2, 24}, [](int x, int, int z) {
        const double radius = std::hypot(x - 11.5, z - 11.5);
        return radius > 7 && radius < 11;
    }));
    const Image image = paint(problem, [](glm::dvec3) { return 0.5; });
    const glm::dvec3 middle(11.5, 0.5, 11.5);
    const glm::ivec2 hole = pixel_of(middle);
    EXPECT_EQ(image.at(hole.x, hole.y)[3], 0);
    for (const double side : {-9.0, 9.0}) {
        for (const glm::dvec3 beside : {glm::dvec3(side, 0, 0), glm::dvec3(0, 0, side)}) {
            const glm::ivec2 pixel = pixel_of(middle + beside);
            EXPECT_EQ(image.at(pixel.x, pixel.y)[3], 255) << pixel.x << ", " << pixel.y;
        }
    }
}

TEST_F(Pixels, HideWhatIsBehindThem) {
    // A small box in front of a large one, as the camera sees them, with different values.
    const Problem problem = lattice(make_grid({9, 12, 9}, [](int x, int y, int z) {
        return y >= 6 || (y <= 1 && x >= 3 && x <= 5 && z >= 3 && z <= 5);
    }));
    const double before = problem.rest_position.front().y + 2;
    const Image image = paint(problem, [&](glm::dvec3 x) { return x.y < before ? 1 : 0; });
    const glm::ivec2 pixel = pixel_of({4, 0, 4});
    EXPECT_GT(image.at(pixel.x, pixel.y)[1], 2 * image.at(pixel.x, pixel.y)[2]) << "yellow before purple";
}

TEST_F(Pixels, AreTheSameEveryTime) {
    const Problem problem = lattice(random_grid({9, 8, 7}, 0.5, 1));
    const auto value = [](glm::dvec3 x) { return x.z / 7; };
    const Image one = paint(problem, value);
    EXPECT_EQ(paint(problem, value).pixels, one.pixels);
    painter_.emplace(*context_, for_files);
    EXPECT_EQ(paint(problem, value).pixels, one.pixels);
    EXPECT_EQ(encode_png(one, "b"), encode_png(one, "b"));
}

TEST_F(Pixels, DoNotDependOnTheUnitOfLength) {
    // Between pictures of very small and very large bodies rounding moves an edge across a sample here and
    // there, which is a quarter of a pixel.
    const auto painted = [&](double spacing) {
        return paint(lattice(solid({5, 6, 7}, glm::dvec3(spacing))), [](glm::dvec3) { return 0.5; });
    };
    const Image one = painted(1);
    for (const double spacing : {1e-12, 1e12}) {
        const Image other = painted(spacing);
        int different = 0;
        for (std::size_t n = 0; n < one.pixels.size(); ++n)
            different += std::abs(one.pixels[n] - other.pixels[n]) > 64;
        EXPECT_LT(different, 40) << spacing;
    }
}

TEST_F(Pixels, OfABodyThatHasCollapsedHaveAView) {
    SlantedCamera camera;
    camera.include(std::vector<glm::vec4>(3, glm::vec4(1, 2, 3, 0)));
    const glm::dvec2 pixel = camera.view(size, 0.5).pixel_of({1, 2, 3});
    EXPECT_NEAR(pixel.x, size.x / 2.0, 1e-9);
    EXPECT_NEAR(pixel.y, size.y / 4.0, 1e-9);
}

TEST_F(Pixels, DoNotFollowPartsThatNothingHolds) {
    // A voxel beside a body that is pinned: wherever it falls, the body's picture and scale stay as they are.
    Problem problem =
        lattice(make_grid({9, 6, 6}, [](int x, int, int z) { return x < 6 || (x == 8 && z == 5); }));
    pin_base(problem);
    const Scene scene = scene_of("island", problem);
    const auto png = [&](double fallen, double bent) {
        State state = state_at_rest(problem);
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const glm::dvec3& rest = problem.rest_position[i];
            state.displacement[i].z = rest.x > 6 ? -fallen : -bent * rest.z;
        }
        return Pictures(Colouring::displacement, size).png({scene, problem, state, 5, 1, "cpu"});
    };
    const std::string one = png(1000, 0.1);
    EXPECT_THAT(one, HasSubstr("\"largest\":0.5"));
    EXPECT_EQ(one, png(3000, 0.1));
    EXPECT_NE(one, png(1000, 0.2));
    EXPECT_NE(one, png(0, 0.1)) << "in the picture while it is there";
}

}  // namespace
}  // namespace voxspring::testing
