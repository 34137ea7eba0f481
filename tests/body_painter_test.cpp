// The live picture of a body: the camera around it, and what the card draws.
#include "harness/drawing/body_painter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <glm/geometric.hpp>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/gl/context.h"
#include "backends/registry.h"
#include "harness/drawing/body_mesh.h"
#include "harness/drawing/live_drawing.h"
#include "harness/drawing/orbit.h"
#include "harness/scene/parts.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

Problem body_of(const VoxelGrid& grid) { return make_lattice_problem(grid, NEIGHBOUR_BITS); }

Problem cut_in_two(const Problem& whole) {
    Problem cut = whole;
    SpringEditor(cut).cut(Plane{.point = {2.5, 0, 0}, .normal = {1, 0, 0}});
    return cut;
}

// --- The camera -------------------------------------------------------------------------------------------

constexpr glm::ivec2 picture_size{240, 180};

TEST(OrbitTest, PixelsAndPlacesAreInverse) {
    Orbit orbit;
    orbit.show({-1, -2, -3}, {3, 2, 1});
    orbit.turn({40, -20}, picture_size);
    orbit.zoom(2);
    const glm::dvec3 place(0.3, -0.4, 0.2);
    const glm::dvec2 pixel = orbit.pixel_of(place, picture_size);
    const Ray ray = orbit.through(pixel, picture_size);
    const glm::dvec3 nearest = ray.origin + ray.direction * glm::dot(place - ray.origin, ray.direction);
    EXPECT_LT(glm::distance(nearest, place), 1e-9);
    EXPECT_NEAR(orbit.distance_to(place), glm::dot(ray.origin - place, orbit.backward()), 1e-12);
}

TEST(OrbitTest, AllOfABodyIsSeenFromEverywhere) {
    Orbit orbit;
    const glm::dvec3 low(-1, -2, -3), high(3, 2, 1);
    orbit.show(low, high);
    for (int n = 0; n < 12; ++n) {
        orbit.turn({25, n - 6.0}, picture_size);
        for (const double x : {low.x, high.x}) {
            for (const double y : {low.y, high.y}) {
                const glm::dvec2 pixel = orbit.pixel_of({x, y, high.z}, picture_size);
                EXPECT_TRUE(pixel.x > 0 && pixel.y > 0 && pixel.x < picture_size.x &&
                            pixel.y < picture_size.y);
            }
        }
    }
}

TEST(OrbitTest, ShiftingFollowsThePointer) {
    Orbit orbit;
    orbit.show({-1, -1, -1}, {1, 1, 1});
    const glm::dvec2 before = orbit.pixel_of({0, 0, 0}, picture_size);
    orbit.shift({12, -7}, picture_size);
    const glm::dvec2 after = orbit.pixel_of({0, 0, 0}, picture_size);
    EXPECT_NEAR(after.x - before.x, 12, 1e-9);
    EXPECT_NEAR(after.y - before.y, -7, 1e-9);
}

// --- The picture ------------------------------------------------------------------------------------------

class BodyPainterTest : public ::testing::Test {
protected:
    void SetUp() override {
        skip_without("gl", [&] { painter_.emplace(context_.emplace()); });
    }

    void show(const Problem& problem) {
        painter_->set_mesh(mesh_of(problem));
        orbit_.show(painter_->mesh().low, painter_->mesh().high);
    }
    Image draw() {
        painter_->draw(orbit_.view(picture_size), {});
        return painter_->picture();
    }
    /// Whether something other than the background is at the pixel of a place.
    bool is_seen(const Image& image, glm::dvec3 place) const {
        const glm::ivec2 at(orbit_.pixel_of(place, picture_size));
        if (at.x < 0 || at.y < 0 || at.x >= image.width || at.y >= image.height) return false;
        return !std::equal(image.at(at.x, at.y), image.at(at.x, at.y) + 4, image.at(0, 0));
    }

    std::optional<gl::Context> context_;
    std::optional<BodyPainter> painter_;
    Orbit orbit_;
};

TEST_F(BodyPainterTest, TheBodyIsWhereTheCameraSaysAndItsDepthIsItsPlace) {
    const Problem problem = body_of(solid({6, 4, 5}));
    show(problem);
    const Image image = draw();
    const glm::dvec3 top(2.5, 1.5, 4.5);
    EXPECT_TRUE(is_seen(image, top));
    EXPECT_FALSE(is_seen(image, {2.5, 1.5, 8}));
    const auto place = painter_->place_at(orbit_.pixel_of(top, picture_size));
    ASSERT_TRUE(place);
    // A pixel is a fortieth of the body.
    EXPECT_LT(glm::distance(*place, top), 0.2);
    EXPECT_FALSE(painter_->place_at({1, 1}));
    EXPECT_FALSE(painter_->place_at({-5, 1e4}));
}

TEST_F(BodyPainterTest, ItFollowsDisplacements) {
    const Problem problem = body_of(solid({6, 4, 5}));
    show(problem);
    const glm::dvec3 above(2.5, 1.5, 6.5);
    EXPECT_FALSE(is_seen(draw(), above));
    painter_->put_displacements(std::vector<glm::dvec3>(problem.particle_count(), glm::dvec3(0, 0, 2)));
    EXPECT_TRUE(is_seen(draw(), above));
    // If no values are given the picture shows the length of the displacement.
    EXPECT_THAT(painter_->range(), ::testing::ElementsAre(2, 2));
}

TEST_F(BodyPainterTest, ItsRangeMayLeaveOutParticles) {
    // A voxel that nothing holds has fallen far.
    Problem problem =
        body_of(make_grid({6, 3, 3}, [](int x, int y, int z) { return x < 4 || (x == 5 && y * z == 1); }));
    pin_base(problem);
    show(problem);
    std::vector<glm::dvec3> displacement;
    for (const glm::dvec3& rest : problem.rest_position)
        displacement.emplace_back(0, 0, rest.x > 4 ? -1000 : rest.z / 4);
    painter_->put_displacements(displacement);
    (void)draw();
    EXPECT_THAT(painter_->range(), ::testing::ElementsAre(0, 1000));
    const std::vector<std::uint32_t> loose = parts_of(problem).loose();
    EXPECT_THAT(painter_->range(loose), ::testing::ElementsAre(0, 0.5));
}

TEST_F(BodyPainterTest, ACutOpens) {
    const Problem whole = body_of(solid({6, 4, 5}));
    std::vector<glm::dvec3> parted;
    for (const glm::dvec3& rest : whole.rest_position) parted.emplace_back(rest.x > 2.5 ? 1 : -1, 0, 0);
    const glm::dvec3 between(2.5, -0.5, 2);
    for (const bool cut : {false, true}) {
        show(cut ? cut_in_two(whole) : whole);
        orbit_ = {};
        orbit_.show(painter_->mesh().low, painter_->mesh().high);
        orbit_.turn({0.5 / 3.14159265358979 * picture_size.y, 0}, picture_size);  // along y
        painter_->put_displacements(parted);
        EXPECT_EQ(is_seen(draw(), between), !cut);
    }
}

TEST_F(BodyPainterTest, ValuesAreColours) {
    const Problem problem = body_of(solid({6, 4, 5}));
    show(problem);
    painter_->put_values(std::vector<double>(problem.particle_count(), 0));
    const Image low = draw();
    painter_->put_values(std::vector<double>(problem.particle_count(), 1));
    const Image high = draw();
    EXPECT_THAT(painter_->range(), ::testing::ElementsAre(1, 1));
    const glm::ivec2 at(orbit_.pixel_of({2.5, 1.5, 4.5}, picture_size));
    // viridis goes from a dark violet to a bright yellow.
    EXPECT_LT(low.at(at.x, at.y)[1], 60);
    EXPECT_GT(high.at(at.x, at.y)[1], 160);
    painter_->put_values({});
    EXPECT_EQ(draw().pixels, low.pixels);
}

// --- Beside a backend that steps ------------------------------------------------------------------------

class LiveDrawingTest : public BodyPainterTest {
protected:
    void SetUp() override {
        BodyPainterTest::SetUp();
        if (!IsSkipped() && !HasFatalFailure()) sharing_.emplace(*context_);
    }
    /// The contexts of the drawing and of the backend share buffers with context_.
    std::unique_ptr<Backend> upload(const std::string& name, const Problem& problem) {
        auto backend = BackendSpec::parse(name).make();
        backend->upload(problem, random_state(problem, 0.05, 4));
        return backend;
    }
    static Problem stepped_body() {
        Problem problem = body_of(solid({6, 4, 5}));
        problem.time_step = 0.1;
        return problem;
    }
    /// Steps until `pictures` pictures are finished; returns the number of steps.
    static int step_until(LiveDrawing& drawing, Backend& backend, std::int64_t pictures) {
        const auto begin = std::chrono::steady_clock::now();
        int steps = 0;
        for (; drawing.pictures() < pictures; ++steps) {
            drawing.hand_over_if_due();
            backend.step(1);
            backend.synchronize();
            drawing.follow_mesh();
            if (std::chrono::steady_clock::now() - begin > std::chrono::seconds(60)) break;
        }
        return steps;
    }

    std::optional<gl::Sharing> sharing_;
};

TEST_F(LiveDrawingTest, DrawsOnTheDeviceOrByTheHostAndFollowsEdits) {
    for (const auto& [name, by] : {std::pair<std::string, std::string>{"cpu_parallel", "download"},
                                   {"gl_compute_implicit", "feed"},
                                   {"gl_fragment_implicit", "feed"}}) {
        SCOPED_TRACE(name);
        const Problem problem = stepped_body();
        Problem later = problem;
        SpringEditor editor(later);
        const SpringEdit cut = editor.cut(Plane{.point = {2.5, 0, 0}, .normal = {1, 0, 0}});
        const auto backend = upload(name, problem);
        LiveDrawing drawing(*context_, *backend, problem);
        EXPECT_EQ(drawing.displacements_by(), by);
        step_until(drawing, *backend, 3);
        EXPECT_GE(drawing.pictures(), 3);
        backend->edit(later, cut);
        drawing.follow(cut);
        step_until(drawing, *backend, 9);
        EXPECT_GE(drawing.pictures(), 9);
        EXPECT_EQ(drawing.displacements_by(), by);
    }
}

TEST_F(LiveDrawingTest, ALaunchThatWaitsForTicksEndsForANewMesh) {
    std::unique_ptr<Backend> backend;
    make_or_skip("cuda_resident:ticks=resident", backend);
    if (IsSkipped()) return;
    Problem problem = stepped_body();
    take_hold(problem, {.particles = {0, 1}, .held = {glm::dvec3(0), glm::dvec3(0)}, .stiffness = 0.125});
    Problem later = problem;
    SpringEditor editor(later);
    const SpringEdit cut = editor.cut(Plane{.point = {2.5, 0, 0}, .normal = {1, 0, 0}});
    backend->upload(problem, state_at_rest(problem));
    LiveDrawing drawing(*context_, *backend, problem);
    const auto tick = [&](auto until) {
        std::chrono::duration<double> longest{0};
        const auto begin = std::chrono::steady_clock::now();
        for (auto before = begin; !until() && before < begin + std::chrono::seconds(60);) {
            drawing.hand_over_if_due();
            backend->step(1);
            (void)backend->tool()->tool_force();
            drawing.follow_mesh();
            const auto now = std::chrono::steady_clock::now();
            longest = std::max<std::chrono::duration<double>>(longest, now - before);
            before = now;
        }
        return longest.count();
    };
    tick([&] { return drawing.pictures() >= 3; });
    backend->edit(later, cut);
    drawing.follow(cut);
    const std::int64_t before = drawing.pictures();
    // The thread would wait for a second.
    EXPECT_LT(tick([&] { return drawing.pictures() >= before + 9; }), 0.5);
    EXPECT_GE(drawing.pictures(), before + 9);
}

TEST_F(LiveDrawingTest, DrawsNoMorePicturesThanAskedFor) {
    const Problem problem = stepped_body();
    const auto backend = upload("cpu_parallel", problem);
    LiveDrawing drawing(*context_, *backend, problem);
    const auto begin = std::chrono::steady_clock::now();
    step_until(drawing, *backend, 1);
    const std::int64_t first = drawing.pictures();
    step_until(drawing, *backend, first + 12);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    // The first two are handed over at once.
    EXPECT_GE(seconds.count(), 11.0 / LiveDrawing::pictures_per_second);
}

TEST_F(LiveDrawingTest, EndsWhereverItIs) {
    const Problem problem = stepped_body();
    const auto backend = upload("cpu_parallel", problem);
    const SpringEdit none;
    for (int n = 0; n < 20; ++n) {
        LiveDrawing drawing(*context_, *backend, problem);
        if (n % 2 == 0) drawing.hand_over_if_due();
        if (n % 4 < 2) drawing.follow(none);
        std::this_thread::sleep_for(std::chrono::milliseconds(n % 5));
    }
}

TEST_F(LiveDrawingTest, ABodyWithoutASurfaceIsAbsent) {
    Problem problem = random_network(5, 6, 1);
    problem.time_step = 0.1;
    const auto backend = upload("cpu_reference", problem);
    EXPECT_THROW(LiveDrawing(*context_, *backend, problem), Unavailable);
}

}  // namespace
}  // namespace voxspring::testing
