// Tiles at rest, on every backend that leaves them out: no bit changes, the tiles really are left out, and
// they are not if it is not worthwhile. A backend without its device is skipped, or fails if
// VOXSPRING_REQUIRE names it.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/verification/verify.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

bool on_processor(const BackendSpec& spec) { return spec.entry->name == "cpu_parallel"; }

class Resting : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override { make_or_skip(BackendSpec::parse(text), any_); }

    std::unique_ptr<Backend> make(const std::string& how) const {
        return BackendSpec::parse(text + "," + how).make();
    }
    /// Ways to skip tiles at rest, which may differ in who checks which tiles.
    std::vector<std::string> ways() const {
        if (on_processor(spec)) return {"rest=skip,threads=1", "rest=skip,threads=3", "rest=skip,threads=7"};
        return {"rest=skip"};
    }

    const std::string text = GetParam();
    const BackendSpec spec = BackendSpec::parse(text);

private:
    std::unique_ptr<Backend> any_;
};

TEST_P(Resting, SkippingChangesNoBitAndSkips) {
    const Poked poked;
    const bool drifts = spec.options.formulation == Formulation::paper;
    const bool narrow = on_processor(spec) && spec.options.precision == Precision::float64;
    const auto plain = make("rest=step");
    std::vector<std::string> hows = ways();
    if (on_processor(spec)) hows.push_back("rest=auto");
    for (const std::string& how : hows) {
        SCOPED_TRACE(how);
        const auto resting = make(how);
        for (Backend* b : {plain.get(), resting.get()}) b->upload(poked.problem, poked.start);
        for (const int steps : {1, 1, 1, 7, 30, 41}) {
            for (Backend* b : {plain.get(), resting.get()}) b->step(steps);
            expect_same_bits(plain->download(), resting->download());
            if (steps != 7 || drifts) continue;
            const WorkCount work = resting->count_work();
            plain->step(1);
            // Tiles have 16 x 4 x 4 particles, half as many in float64, or 256 in any shape.
            EXPECT_EQ(work.at("tiles"), narrow ? 8u * 6 * 6 : 4u * 6 * 6);
            EXPECT_LT(work.at("tiles_stepped"), work.at("tiles") / 2);
            // The wave has advanced by ten voxels, and touches tiles next to those that it is in.
            EXPECT_GE(work.at("tiles_stepped"), 2u * 3 * 3);
        }
    }
    EXPECT_TRUE(plain->count_work().empty());
}

// Repeated runs from the same start: the first step, too, takes only the tiles that move.
TEST_P(Resting, ARewoundStartSkipsFromTheFirstStepOn) {
    const Poked poked;
    const auto plain = make("rest=step"), resting = make("rest=skip");
    const State end = stepped(*plain, poked.problem, poked.start, 20);
    resting->upload(poked.problem, poked.start);
    if (!resting->keep_start()) GTEST_SKIP() << "keeps none";
    for (int turn = 0; turn < 3; ++turn) {
        SCOPED_TRACE(turn);
        if (turn > 0) resting->rewind();
        const WorkCount work = resting->count_work();
        if (spec.options.formulation != Formulation::paper) {
            EXPECT_LT(work.at("tiles_stepped"), work.at("tiles") / 2);
        }
        resting->step(19);
        expect_same_bits(end, resting->download());
    }
}

TEST_P(Resting, EditsAndUploadsWakeWhatTheyTouch) {
    const Poked poked;
    const auto play = [&](const std::string& how) {
        const auto backend = make(how);
        Problem now = poked.problem;
        backend->upload(poked.problem, poked.start);
        std::vector<State> states;
        const auto step = [&](int count) {
            backend->step(count);
            states.push_back(backend->download());
        };
        step(12);
        SpringEditor editor(now);
        // Far from the wave, and where it is.
        for (const Shape& shape : {Shape(Plane{{40.5, 0, 0}, {1, 0, 0}}), Shape(Ball{{3, 3, 3}, 2.5})}) {
            backend->edit(now, editor.cut(shape));
            step(9);
            backend->edit(now, editor.suture(shape, 1.5));
            step(3);
        }
        // A start away from rest, for the whole body and then for a part.
        backend->upload(now, random_state(now, 0.05, 35));
        step(5);
        State start = state_at_rest(now);
        start.increment.back().z = 0.01;
        backend->upload(now, start);
        step(20);
        return states;
    };
    const std::vector<State> plain = play("rest=step"), resting = play(ways().back());
    for (std::size_t n = 0; n < plain.size(); ++n) {
        SCOPED_TRACE(n);
        expect_same_bits(plain[n], resting[n]);
    }
}

TEST_P(Resting, AToolThatMovesWakesWhatItHolds) {
    Poked poked;
    // Far from the wave.
    const auto last = std::uint32_t(poked.problem.particle_count() - 1);
    take_hold(poked.problem, {.particles = {last - 1, last}, .held = {}, .stiffness = 0.25});
    const auto end = [&](const std::string& how) {
        const auto backend = make(how);
        backend->upload(poked.problem, poked.start);
        backend->step(12);
        backend->tool()->move_tool({0.01, 0, 0});
        backend->step(7);
        backend->tool()->move_tool({0.01, 0.02, 0});
        backend->step(8);
        return backend->download();
    };
    const State plain = end("rest=step");
    expect_same_bits(plain, end("rest=skip"));
    EXPECT_GT(plain.displacement[last].y, 0);
}

// An edit changes the forces of resting particles if the springs that it adds are not at rest.
TEST_P(Resting, AnEditOfWhatRestsUnderStressMovesIt) {
    Problem problem = make_lattice_problem(solid({40, 8, 8}), FACE_BITS);
    problem.damping = 0.01;
    problem.time_step = 0.28;
    std::vector<std::uint8_t> pinned(problem.particle_count());
    State start = state_at_rest(problem);
    // Two pinned halves, one of them moved away: the springs between them are stretched, and the halves rest
    // since they are pinned.
    for (std::size_t i = 0; i < pinned.size(); ++i) {
        pinned[i] = problem.rest_position[i] != glm::dvec3(20, 4, 4);
        if (problem.rest_position[i].x > 20) start.displacement[i].x = 0.25;
    }
    pin(problem, pinned);
    SpringEditor(problem).cut(Ball{{20, 4, 4}, 1.5});
    const auto end = [&](const std::string& how) {
        const auto backend = make(how);
        Problem now = problem;
        backend->upload(problem, start);
        backend->step(10);
        SpringEditor editor(now);
        backend->edit(now, editor.suture(Ball{{20, 4, 4}, 1.5}, 1.5));
        backend->step(10);
        return backend->download();
    };
    const State plain = end("rest=step");
    expect_same_bits(plain, end("rest=skip"));
    EXPECT_NE(plain.displacement, start.displacement);
}

// By increments the tails of a wave reach everywhere within as many steps as the lattice is wide. By default
// a backend checks for rest when that can pay, stops when it does not, and may check again later: nothing
// that has moved meanwhile counts as resting.
TEST_P(Resting, AutoChangesNoBitAndSkipsWhatRests) {
    // The minimum that a backend checks: 128 tiles on the processor, 512 blocks on a card.
    const Poked poked(on_processor(spec) ? glm::ivec3(64, 32, 16) : glm::ivec3(64, 64, 32));
    const bool drifts = spec.options.formulation == Formulation::paper;
    const auto plain = make("rest=step"), choosing = make("rest=auto");
    const auto chooses = [&](const std::string& value) {
        return (choosing->choice().value().tuning + ",").find("rest=" + value + ",") != std::string::npos;
    };
    for (Backend* b : {plain.get(), choosing.get()}) b->upload(poked.problem, poked.start);
    EXPECT_TRUE(chooses("skip_or_step"));
    // By then every tile has moved, checking was in vain for two times 64 steps, and the backend checks once
    // more.
    for (const int steps : {20, 200, 300}) {
        for (Backend* b : {plain.get(), choosing.get()}) b->step(steps);
        const WorkCount work = choosing->count_work();
        plain->step(1);
        expect_same_bits(plain->download(), choosing->download());
        if (steps == 20 && !drifts) {
            EXPECT_LT(work.at("tiles_stepped"), work.at("tiles"));
        } else if (steps > 20 && by_increments(spec.options.formulation)) {
            EXPECT_EQ(work.at("tiles_stepped"), work.at("tiles"));
        }
    }
    // Everything moves. The card does not check then; the processor checks in vain, pauses, and checks again.
    const State moving = random_state(poked.problem, 0.05, 36);
    for (Backend* b : {plain.get(), choosing.get()}) b->upload(poked.problem, moving);
    choosing->step(20);
    const WorkCount work = choosing->count_work();
    if (on_processor(spec)) {
        EXPECT_EQ(work.at("tiles_stepped"), work.at("tiles"));
    } else {
        EXPECT_TRUE(work.empty());
    }
    choosing->step(work.empty() ? 130 : 129);
    plain->step(150);
    expect_same_bits(plain->download(), choosing->download());
    Problem falling = poked.problem;
    falling.gravity = {0, 0, -1e-3};
    choosing->upload(falling, poked.start);
    EXPECT_TRUE(choosing->count_work().empty());
    EXPECT_TRUE(chooses("step"));
}

// Without a flush the tails of `increment` reach everywhere: tiny, but not zero.
TEST_P(Resting, FlushingRestsMoreForAnErrorOfWhatItFlushes) {
    if (!by_increments(spec.options.formulation)) {
        EXPECT_THROW(make("rest=flush"), BadSpecification);
        return;
    }
    // Tails have advanced by 30 particles; the part above the flush by half of that.
    const Poked poked({64, 32, 32});
    const auto run = [&](const std::string& how, WorkCount& work) {
        const auto backend = make(how);
        backend->upload(poked.problem, poked.start);
        backend->step(30);
        work = backend->count_work();
        backend->step(200);
        return backend->download();
    };
    WorkCount skipping, flushing;
    const State exact = run("rest=skip", skipping), flushed = run("rest=flush", flushing);
    EXPECT_LT(flushing.at("tiles_stepped"), skipping.at("tiles_stepped"));
    // 2e-7 was measured on a larger lattice.
    EXPECT_LT(compare(poked.problem, flushed, exact, spec.options.precision, 231).relative_l2, 1e-6);
}

// Lengths in metres or in voxels: the same body at a spacing of 2^-10 rests in the same tiles, and its state
// is the same times 2^-10, to the bit. A flush below a length that does not follow the spacing fails.
TEST_P(Resting, FlushingFollowsTheSpacing) {
    if (!by_increments(spec.options.formulation)) GTEST_SKIP() << "does not flush";
    constexpr double scale = 1.0 / 1024;
    const Poked poked({64, 32, 32}), small({64, 32, 32}, scale);
    const auto run = [&](const Poked& body, std::uint64_t& stepped) {
        const auto backend = make("rest=flush");
        backend->upload(body.problem, body.start);
        backend->step(30);
        stepped = backend->count_work().at("tiles_stepped");
        return backend->download();
    };
    std::uint64_t of_large = 0, of_small = 0;
    State large = run(poked, of_large);
    const State after = run(small, of_small);
    EXPECT_EQ(of_small, of_large);
    for (std::vector<glm::dvec3>* vectors : {&large.displacement, &large.increment})
        for (glm::dvec3& v : *vectors) v *= scale;
    expect_same_bits(after, large);
}

INSTANTIATE_TEST_SUITE_P(Backends, Resting, ::testing::ValuesIn(in_every_formulation("rest")), test_name);

}  // namespace
}  // namespace voxspring::testing
