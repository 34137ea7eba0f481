// Pictures: the surface that they show, the scale that colours it, and pixels.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <glm/geometric.hpp>
#include <limits>
#include <memory>
#include <new>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "harness/export/legend.h"
#include "harness/export/painter.h"
#include "harness/export/surface.h"
#include "tests/required.h"
#include "tests/support.h"

namespace {

/// A request for more bytes than this fails.
std::size_t max_allocation = std::numeric_limits<std::size_t>::max();

}  // namespace

// GCC 12 takes an inlined free() for that of another allocator.
[[gnu::noinline]] void* operator new(std::size_t bytes) {
    void* memory = bytes <= max_allocation ? std::malloc(bytes) : nullptr;
    if (memory == nullptr) throw std::bad_alloc();
    return memory;
}
[[gnu::noinline]] void* operator new(std::size_t bytes, const std::nothrow_t& /*unused*/) noexcept {
    return bytes <= max_allocation ? std::malloc(bytes) : nullptr;
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

/// The rounding of a few operations on numbers of the size of a few voxels.
constexpr double rounding = 1e-13;

Problem lattice(const VoxelGrid& grid) { return make_lattice_problem(grid, NEIGHBOUR_BITS); }

/// `displacement(rest position)` of each particle.
template <class Displacement>
std::vector<glm::dvec3> displaced(const Problem& problem, Displacement displacement) {
    std::vector<glm::dvec3> all;
    for (const glm::dvec3& rest : problem.rest_position) all.push_back(displacement(rest));
    return all;
}

std::vector<SurfaceVertex> at_rest(const Problem& problem) {
    const std::vector<glm::dvec3> still(problem.particle_count());
    return surface_of(problem, still, std::vector<double>(problem.particle_count()));
}

/// The mean of a face's vertices.
glm::dvec3 middle(const std::vector<SurfaceVertex>& surface, std::size_t face) {
    glm::dvec3 sum(0);
    for (std::size_t n = 0; n < 4; ++n) sum += surface[4 * face + n].position;
    return sum / 4.0;
}

/// A ring around y in a slice two voxels thick, which the camera looks through.
VoxelGrid ring() {
    return make_grid({24, 2, 24}, [](int x, int, int z) {
        const double radius = std::hypot(x - 11.5, z - 11.5);
        return radius > 7 && radius < 11;
    });
}

TEST(Surface, HasEveryFaceBetweenActiveAndInactive) {
    EXPECT_EQ(at_rest(lattice(solid({1, 1, 1}))).size(), 4 * 6u);
    EXPECT_EQ(at_rest(lattice(solid({4, 5, 6}))).size(), 4 * 2 * (4 * 5 + 5 * 6 + 6 * 4u));
    // The hollow's six faces are as much surface as the outside, though no picture shows them.
    const auto hollow = make_grid({5, 5, 5}, [](int x, int y, int z) { return x != 2 || y != 2 || z != 2; });
    EXPECT_EQ(at_rest(lattice(hollow)).size(), 4 * (6 * 25 + 6u));
}

TEST(Surface, IsWhereTheBodyIsAndFacesOutwards) {
    const glm::dvec3 spacing(1, 0.5, 2);
    const Problem problem = lattice(solid({6, 6, 6}, spacing));
    const glm::dvec3 low = problem.rest_position.front() - spacing / 2.0;
    const std::vector<SurfaceVertex> surface = at_rest(problem);
    for (std::size_t face = 0; face < surface.size() / 4; ++face) {
        const SurfaceVertex* v = &surface[4 * face];
        const glm::dvec3 flat = glm::cross(v[2].position - v[0].position, v[3].position - v[1].position);
        EXPECT_GT(glm::dot(flat, middle(surface, face) - (low + 3.0 * spacing)), 0)
            << "seen from outside: clockwise";
        for (std::size_t n = 0; n < 4; ++n) {
            EXPECT_GT(glm::dot(v[n].normal, flat), 0);
            EXPECT_NEAR(glm::length(v[n].normal), 1, 1e-15);
            // In voxels: at most on the box's planes, and exactly on one of them except at the box's edges,
            // which are rounded.
            const glm::dvec3 place = (v[n].position - low) / spacing;
            int inside = 0;
            double nearest = 6;
            for (int a = 0; a < 3; ++a) {
                const double depth = std::min(place[a], 6 - place[a]);
                EXPECT_GT(depth, -rounding);
                nearest = std::min(nearest, depth);
                inside += depth > 0.5;
            }
            EXPECT_LT(nearest, inside == 2 ? rounding : 0.5);
        }
    }
}

TEST(Surface, TurnsWithTheBody) {
    // A third of a turn about (1, 1, 1) takes x to y, y to z and z to x. Cells one voxel thin have but the
    // axes of their neighbours to go by: a plate, in which two are left.
    const auto turned = [](glm::dvec3 v) { return glm::dvec3(v.z, v.x, v.y); };
    for (const glm::ivec3 dims : {glm::ivec3(4, 3, 5), glm::ivec3(4, 5, 1)}) {
        const Problem problem = lattice(solid(dims));
        const std::vector<double> value(problem.particle_count(), 0.5);
        const auto surface =
            surface_of(problem, displaced(problem, [&](glm::dvec3 x) { return turned(x) - x; }), value);
        const auto rest = at_rest(problem);
        ASSERT_EQ(surface.size(), rest.size());
        for (std::size_t n = 0; n < rest.size(); ++n) {
            EXPECT_LT(glm::distance(surface[n].position, turned(rest[n].position)), rounding);
            EXPECT_LT(glm::distance(surface[n].normal, turned(rest[n].normal)), rounding);
            EXPECT_EQ(surface[n].value, 0.5);
        }
    }
}

TEST(Surface, OfWhatHasNoThickness) {
    // A particle is a cell around itself; a rope keeps a distance of one voxel between its two faces, in any
    // direction.
    const Problem one = lattice(solid({1, 1, 1}));
    for (const SurfaceVertex& vertex : at_rest(one)) {
        EXPECT_GT(glm::distance(vertex.position, one.rest_position[0]), 0.1);
        EXPECT_LT(glm::distance(vertex.position, one.rest_position[0]), 1);
    }
    const Problem rope = lattice(solid({1, 1, 9}));
    const auto bent = surface_of(
        rope,
        displaced(
            rope,
            [](glm::dvec3 x) { return glm::dvec3(4 * std::sin(x.z / 4), 0, 4 * std::cos(x.z / 4)) - x; }),
        std::vector<double>(9));
    EXPECT_EQ(bent.size(), 4 * (9 * 4 + 2u));
    // In any direction along it the rope is as thick: at each end of a face's side a corner, half a voxel or
    // so away.
    for (std::size_t face = 0; face < bent.size() / 4; ++face) {
        const glm::dvec3 across = bent[4 * face + 2].position - bent[4 * face].position;
        EXPECT_GT(glm::length(across), 0.4);
    }
    // A body that has collapsed to a point shows nothing, and no value is NaN.
    const auto gone =
        surface_of(rope, displaced(rope, [](glm::dvec3 x) { return -x; }), std::vector<double>(9));
    for (const auto& surface : {bent, gone}) {
        for (const SurfaceVertex& vertex : surface) {
            EXPECT_TRUE(std::isfinite(glm::length(vertex.position)));
            EXPECT_TRUE(std::isfinite(glm::length(vertex.normal)));
        }
    }
}

TEST(Surface, OpensWhereItIsCut) {
    Problem problem = lattice(solid({4, 4, 4}));
    SpringEditor editor(problem);
    const double middle_z = problem.rest_position.front().z + 1.5;
    editor.cut(Plane{{0, 0, middle_z}, {0, 0, 1}});
    ASSERT_EQ(at_rest(problem).size(), 4 * (6 * 16 + 2 * 16u));
    // The upper half moves away by 3: nothing is drawn between them.
    const auto displacement =
        displaced(problem, [&](glm::dvec3 x) { return glm::dvec3(0, 0, x.z > middle_z ? 3 : 0); });
    std::vector<double> value;
    for (const glm::dvec3& u : displacement) value.push_back(u.z);
    int lips = 0;
    for (const SurfaceVertex& vertex : surface_of(problem, displacement, value)) {
        const double above = vertex.position.z - middle_z;
        EXPECT_TRUE(above < rounding || above > 3 - rounding) << above;
        EXPECT_EQ(vertex.value, above > 1 ? 3 : 0) << "no mean across the cut";
        lips += std::abs(above) < rounding || std::abs(above - 3) < rounding;
    }
    EXPECT_GE(lips, 4 * 2 * 4) << "cut faces lie in the plane of the cut";
}

TEST(Surface, OfNothingToDrawIsRefused) {
    const Problem problem = lattice(solid({2, 2, 2}));
    std::vector<glm::dvec3> displacement(8);
    displacement[5].y = std::numeric_limits<double>::quiet_NaN();
    const std::vector<double> value(8);
    EXPECT_THAT([&] { surface_of(problem, displacement, value); },
                ThrowsMessage<std::runtime_error>(HasSubstr("particle 5 is not finite")));
    const Problem network = random_network(8, 20, 1);
    EXPECT_THAT([&] { at_rest(network); }, ThrowsMessage<std::runtime_error>(HasSubstr("no lattice")));
}

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
                EXPECT_LE(ticks[n].value, most * (1 + rounding));
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
    // libpng finds the error, and its memory is freed on the way out: a sanitizer looks for leaks.
    EXPECT_THAT([] { encode_png(Image(0, 5), {}); }, ThrowsMessage<std::runtime_error>(HasSubstr("PNG: ")));
}

TEST(Png, SaysThatNoMemoryIsLeftForTheFile) {
    Image image(128, 128);
    std::mt19937 generator(1);
    // Noise, which no compression makes smaller than the 16 KiB that are allowed below.
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < 4 * image.width; ++x) image.at(0, y)[x] = std::uint8_t(generator());
    EXPECT_GT(encode_png(image, {}).size(), 60'000u);
    max_allocation = 16'384;
    std::string said;
    try {
        encode_png(image, {});
    } catch (const std::runtime_error& error) {
        said = error.what();
    }
    max_allocation = std::numeric_limits<std::size_t>::max();
    EXPECT_EQ(said, "PNG: no memory is left for the file");
}

TEST(Png, SaysWhatLibpngRefuses) {
    const Image image(2, 2);
    EXPECT_GT(encode_png(image, {{"Title", "a"}}).size(), 0u);
    // A keyword has at most 79 characters.
    EXPECT_THAT(
        [&] {
            encode_png(image, {{"", "a"}});
        },
        ThrowsMessage<std::runtime_error>(HasSubstr("keyword")));
}

/// Skips its tests where there is no OpenGL; VOXSPRING_REQUIRE=gl makes that a failure.
class Pixels : public ::testing::Test {
protected:
    void SetUp() override {
        try {
            painter_.emplace(size);
        } catch (const Unavailable& absent) {
            if (is_required("gl")) FAIL() << absent.what();
            GTEST_SKIP() << absent.what();
        }
    }

    /// Draws the body at rest, with `value(rest position)` for each particle.
    template <class Value>
    Image paint(const Problem& problem, Value value) {
        std::vector<double> values;
        for (const glm::dvec3& rest : problem.rest_position) values.push_back(value(rest));
        surface_ = surface_of(problem, std::vector<glm::dvec3>(problem.particle_count()), values);
        camera_ = {};
        camera_.include(surface_);
        return painter_->paint(surface_, camera_, Scale(Colouring::displacement, 1));
    }
    glm::ivec2 pixel_of(glm::dvec3 position) const { return painter_->pixel_of(camera_, position); }

    static constexpr glm::ivec2 size{320, 240};
    static constexpr int above_legend = int(size.y * (1 - legend_share));
    std::optional<Painter> painter_;
    std::vector<SurfaceVertex> surface_;
    Camera camera_;
};

TEST_F(Pixels, OfABoxFillTheirBoundsAndNothingElse) {
    const Image image = paint(lattice(solid({9, 9, 9})), [](glm::dvec3) { return 0.5; });
    for (const int x : {0, size.x - 1}) {
        for (const int y : {0, size.y - 1}) EXPECT_EQ(image.at(x, y)[3], 0) << x << ", " << y;
    }
    glm::dvec2 low(1e9), high(-1e9);
    for (const SurfaceVertex& vertex : surface_) {
        low = glm::min(low, painter_->pixel_of(camera_, vertex.position));
        high = glm::max(high, painter_->pixel_of(camera_, vertex.position));
    }
    glm::ivec2 first(size), last(-1);
    int opaque = 0;
    int partly = 255;  // least green
    int fully = 255;
    for (int y = 0; y < above_legend; ++y) {
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
    // Between two knots the components lie between those of the knots: for the mean of the 13th and 14th red
    // is 0.84 of green, for the knots themselves 0.75 and 0.93. A trace of gloss is white.
    const Image between = paint(problem, [](glm::dvec3) { return 13.5 / 15; });
    const std::uint8_t* lime = between.at(high.x, high.y);
    EXPECT_NEAR(double(lime[0]) / lime[1], 0.84, 0.03);
}

TEST_F(Pixels, ShowWhatIsBehindAHole) {
    const Problem problem = lattice(ring());
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
    const auto grid = make_grid({9, 12, 9}, [](int x, int y, int z) {
        return y >= 6 || (y <= 1 && x >= 3 && x <= 5 && z >= 3 && z <= 5);
    });
    const Problem problem = lattice(grid);
    const double before = problem.rest_position.front().y + 2;
    paint(problem, [&](glm::dvec3 x) { return x.y < before ? 1 : 0; });
    const glm::ivec2 pixel = pixel_of({4, 0, 4});
    // The order in which its faces are drawn does not matter.
    std::vector<SurfaceVertex> reversed;
    for (std::size_t n = surface_.size(); n > 0; n -= 4)
        reversed.insert(reversed.end(), surface_.begin() + std::ptrdiff_t(n - 4),
                        surface_.begin() + std::ptrdiff_t(n));
    for (const auto& surface : {surface_, reversed}) {
        const Image image = painter_->paint(surface, camera_, Scale(Colouring::displacement, 1));
        EXPECT_GT(image.at(pixel.x, pixel.y)[1], 2 * image.at(pixel.x, pixel.y)[2]) << "yellow before purple";
    }
}

TEST_F(Pixels, AreTheSameEveryTime) {
    const Problem problem = lattice(random_grid({9, 8, 7}, 0.5, 1));
    const auto value = [](glm::dvec3 x) { return x.z / 7; };
    const Image one = paint(problem, value);
    EXPECT_EQ(paint(problem, value).pixels, one.pixels);
    Painter another(size);
    EXPECT_EQ(another.paint(surface_, camera_, Scale(Colouring::displacement, 1)).pixels, one.pixels);
    EXPECT_EQ(encode_png(one, {{"a", "b"}}), encode_png(one, {{"a", "b"}}));
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
        for (std::size_t n = 3; n < one.pixels.size(); n += 4)
            different += std::abs(one.pixels[n] - other.pixels[n]) > 64;
        EXPECT_LT(different, 20) << spacing;
    }
}

TEST_F(Pixels, OfABodyThatHasCollapsedAreEmpty) {
    const Problem problem = lattice(solid({3, 3, 3}));
    surface_ =
        surface_of(problem, displaced(problem, [](glm::dvec3 x) { return -x; }), std::vector<double>(27));
    camera_.include(surface_);
    const Image image = painter_->paint(surface_, camera_, Scale(Colouring::displacement, 1));
    for (int y = 0; y < above_legend; ++y) {
        for (int x = 0; x < size.x; ++x) ASSERT_EQ(image.at(x, y)[3], 0) << x << ", " << y;
    }
}

}  // namespace
}  // namespace voxspring::testing
