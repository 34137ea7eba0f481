// Errors: references and their cache, conserved quantities, divergence, and advice.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "backends/cpu/perturbed_reference.h"
#include "backends/disk_cache.h"
#include "backends/registry.h"
#include "harness/choice/advise.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/kinds/pareto.h"
#include "harness/verification/conserved.h"
#include "harness/verification/divergence.h"
#include "harness/verification/error_threshold.h"
#include "harness/verification/errors.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/reference.h"
#include "tests/support.h"
#include "tests/surroundings.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;

DiskCache no_cache() { return DiskCache(std::filesystem::path{}); }

/// One mass on one spring along z, pinned at its lower end: z'' + 2 beta z' = -omega^2 z + g, exactly linear.
struct Oscillator {
    double damping, gravity, displacement, increment, time_step;

    Scene scene() const {
        Scene scene;
        scene.name = "oscillator";
        Problem& problem = scene.problem;
        problem = make_lattice_problem(solid({1, 1, 2}), FACE_BITS);
        pin_base(problem);
        problem.materials = {{mass, stiffness}};
        problem.group_stiffness = {stiffness, stiffness, stiffness};
        problem.gravity = {0, 0, gravity};
        problem.damping = damping;
        problem.time_step = time_step;
        scene.state = state_at_rest(problem);
        scene.state.displacement[1].z = displacement;
        scene.state.increment[1].z = increment;
        scene.stable_time_step = 2 / std::sqrt(stiffness / mass);
        return scene;
    }
    /// The displacement at t of the motion that at_time_step() preserves.
    double exact(double t) const {
        const double scale = 1 - damping / 2;
        const double beta = damping / (2 - damping) / time_step;
        const double omega_squared = stiffness / mass / scale;
        const double equilibrium = gravity / scale / omega_squared;
        const double force = gravity / scale - omega_squared * displacement;
        // v(0) by its definition, with x(dt) of the first step written out.
        const double velocity = (scale * increment + scale * force * time_step * time_step / 2) / time_step;
        const double omega = std::sqrt(omega_squared - beta * beta);
        const double a = displacement - equilibrium, b = (velocity + beta * a) / omega;
        return equilibrium + std::exp(-beta * t) * (a * std::cos(omega * t) + b * std::sin(omega * t));
    }
    static constexpr double mass = 2, stiffness = 3;
};

class Motion : public ::testing::TestWithParam<Oscillator> {
protected:
    References references{no_cache()};
};

INSTANTIATE_TEST_SUITE_P(, Motion,
                         ::testing::Values(Oscillator{0, -0.02, 0, 0, 0.2}, Oscillator{0, 0, 0.1, 0, 0.2},
                                           Oscillator{0, 0, 0.1, 0.03, 0.2},
                                           Oscillator{0.1, -0.02, 0.1, 0.03, 0.2}));

TEST_P(Motion, IsOfSecondOrder) {
    const Oscillator oscillator = GetParam();
    const Scene scene = oscillator.scene();
    const Span span{0.2, 64};
    double before = 0;
    for (const int steps : {256, 512, 1024, 2048}) {
        const State end = references.after(in_steps(scene, span, steps), steps);
        const double error = std::abs(end.displacement[1].z - oscillator.exact(0.2 * 64));
        // The fourth-order term is a few percent of it at the largest step.
        if (before > 0) {
            EXPECT_NEAR(before / error, 4, 0.2) << steps;
        }
        before = error;
    }
    EXPECT_LT(before, 1e-4);
}

TEST_P(Motion, RefinedReferenceHasTheClosedForm) {
    const Oscillator oscillator = GetParam();
    const Refined refined = references.refined(oscillator.scene(), {0.2, 64}, {64});
    ASSERT_FALSE(refined.displacement.empty()) << refined.reason;
    const double exact = oscillator.exact(0.2 * 64);
    const double error = std::abs(refined.displacement[1].z - exact) / std::abs(exact);
    EXPECT_LE(error, refined.uncertainty) << "the estimate is of the extrapolation before";
    EXPECT_LT(error, 1e-4);
    const Refined finer = references.refined(oscillator.scene(), {0.2, 64}, {64, 128, 256, 512});
    EXPECT_NEAR(finer.displacement[1].z, exact, finer.uncertainty * std::abs(exact));
    // A hundredth of the error of 512 steps, 1e-4 or less.
    EXPECT_LT(finer.uncertainty, 1e-6);
}

TEST(AtTimeStep, IsTheSceneItselfAtItsOwn) {
    const Scene scene = Oscillator{0.1, -0.02, 0.1, 0.03, 0.2}.scene();
    const Scene same = in_steps(scene, {0.2, 7}, 7);
    EXPECT_EQ(same.problem.damping, scene.problem.damping);
    EXPECT_EQ(same.problem.time_step, scene.problem.time_step);
    EXPECT_EQ(same.state.increment, scene.state.increment);
    const Scene there = at_time_step(scene, 0.05), back = at_time_step(there, 0.2);
    EXPECT_NEAR(back.problem.damping, 0.1, 1e-15);
    EXPECT_NEAR(back.problem.materials[0].mass, 2, 1e-14);
    EXPECT_NEAR(back.problem.gravity.z, -0.02, 1e-16);
    EXPECT_NEAR(back.state.increment[1].z, 0.03, 1e-15);
}

TEST(Refined, GivesReasonsWhereThereIsNone) {
    References references{no_cache()};
    Scene scene = Oscillator{0, -0.02, 0, 0, 0.2}.scene();
    scene.edits.push_back({3, SpringEditor(scene.problem).cut(Plane{{0, 0, 0.5}, {0, 0, 1}})});
    EXPECT_THAT(references.refined(scene, {0.2, 8}, {8}).reason, HasSubstr("springs change"));
    EXPECT_EQ(references.computed(), 0);
    // Particles that fly through each other make it chaotic.
    scene = {};
    scene.problem = make_lattice_problem(solid({4, 4, 4}), FACE_BITS | EDGE_BITS);
    scene.problem.time_step = 0.25;
    scene.state = random_state(scene.problem, 3, 1);
    const Refined refined = references.refined(scene, {0.25, 1000}, {1000});
    EXPECT_TRUE(refined.displacement.empty());
    EXPECT_THAT(refined.reason, HasSubstr("does not converge"));
}

// --- Chaos -----------------------------------------------------------------------------------------------

TEST(Chaos, IsFoundWhereRoundingNearsTheMotion) {
    References references{no_cache()};
    Scene scene;
    scene.problem = make_lattice_problem(solid({5, 4, 6}), FACE_BITS | EDGE_BITS);
    scene.problem.time_step = 0.25;
    scene.state = random_state(scene.problem, 0.01, 1);
    const BackendSpec spec = BackendSpec::parse("cpu_parallel:formulation=position");
    const RoundingModel model = rounding_model_of(spec);
    const auto solution_after = [&](int steps) {
        ReferenceSolution solution{scene.problem, steps, references.after(scene, steps), {}, scene.state};
        solution.spreads = {{model, references.spread(scene, steps, solution.same_step, model)}};
        return solution;
    };
    const ReferenceSolution calm = solution_after(20);
    EXPECT_FALSE(is_chaotic(calm.spreads[0].second));
    EXPECT_FALSE(errors_of(calm, calm.same_step, judge(calm, calm.same_step, spec), spec).chaotic);
    State state = calm.same_step;
    state.displacement[3].x += 1e-3;
    EXPECT_THAT(judge(calm, state, spec).reason, HasSubstr("particle 3 is off by 0.001"));
    // Every particle is off by a little, none by much.
    state = calm.same_step;
    const double rms_gate = judge(calm, state, spec).tolerance_rms;
    ASSERT_LT(1.1 * rms_gate, judge(calm, state, spec).tolerance);
    for (glm::dvec3& u : state.displacement) u.y += 1.1 * rms_gate;
    EXPECT_THAT(judge(calm, state, spec).reason, HasSubstr("root mean square"));

    scene.state = random_state(scene.problem, 0.9, 1);
    const ReferenceSolution wild = solution_after(2000);
    EXPECT_TRUE(is_chaotic(wild.spreads[0].second));
    state = wild.same_step;
    const JudgedState itself = judge(wild, state, spec);
    EXPECT_TRUE(itself.passed()) << itself.reason;
    // Only statistics need the energy. errors_of() takes it from there.
    ASSERT_TRUE(itself.energy);
    EXPECT_EQ(itself.energy->total(), energy(wild.problem, state).total());
    EXPECT_FALSE(judge(calm, calm.same_step, spec).energy);
    // The summary of the reference takes the energy that is known.
    ReferenceSolution known = wild;
    known.summary.reset();
    known.conserved.value().energy.field = 7;
    (void)judge(known, state, spec);
    EXPECT_EQ(known.summary.value().energy.field, 7);
    EXPECT_TRUE(std::isinf(itself.tolerance));
    EXPECT_TRUE(errors_of(wild, state, itself, spec).chaotic);
    // No single particle fails the row. A state that belongs to another body does, and so does one that is
    // not finite.
    state.displacement[3].x += 0.1;
    EXPECT_TRUE(judge(wild, state, spec).passed());
    EXPECT_THAT(judge(wild, state_at_rest(scene.problem), spec).reason, HasSubstr("chaotic, and the"));
    State faster = state;
    for (glm::dvec3& v : faster.increment) v *= 3;
    EXPECT_THAT(judge(wild, faster, spec).reason, HasSubstr("kinetic energy"));
    for (glm::dvec3& u : state.displacement) u.x += 50;
    EXPECT_THAT(judge(wild, state, spec).reason, HasSubstr("centre of mass"));
    state.displacement[3].x = NAN;
    EXPECT_THAT(judge(wild, state, spec).reason, HasSubstr("not finite"));
}

TEST(Judge, HoldsAModelWithoutASpreadToBeFinite) {
    const Scene scene = Oscillator{0.1, -0.02, 0.1, 0.03, 0.2}.scene();
    const ReferenceSolution solution{scene.problem, 40, scene.state, {}, scene.state};
    const BackendSpec spec = BackendSpec::parse("cpu_parallel");
    State state = scene.state;
    state.displacement[1].x += 9;
    EXPECT_TRUE(judge(solution, state, spec).passed());
    state.displacement[1].x = INFINITY;
    EXPECT_FALSE(judge(solution, state, spec).passed());
}

// --- What is asked for -----------------------------------------------------------------------------------

TEST(Judge, AdmitsTheErrorThatSleepAsksFor) {
    Scene scene;
    scene.problem = make_lattice_problem(solid({5, 4, 6}), FACE_BITS | EDGE_BITS);
    scene.problem.lattice.spacing = {2, 0.5, 1};
    scene.state = state_at_rest(scene.problem);
    ReferenceSolution solution{scene.problem, 40, scene.state, {}, scene.state};
    Spread spread;
    spread.max = spread.rms = 1e-6;
    solution.spreads = {{rounding_model_of(BackendSpec::parse("cpu_parallel")), spread}};
    const auto tolerance = [&](const std::string& spec) {
        return judge(solution, scene.state, BackendSpec::parse(spec)).tolerance;
    };
    const double rounding = tolerance("cpu_parallel");
    EXPECT_DOUBLE_EQ(tolerance("cpu_parallel:sleep=1e-4"), rounding + 40 * 1e-4 * 0.5);
    EXPECT_EQ(tolerance("cpu_parallel:sleep=off"), rounding);
    EXPECT_EQ(tolerance("cpu_parallel:rest=flush"), rounding);
}

TEST(Spread, FollowsFormulationPrecisionAndRoots) {
    References references{no_cache()};
    const Scene scene = load_scene("box@6");
    const State end = references.after(scene, 100);
    std::vector<RoundingModel> models;
    for (const char* spec : {"cpu_parallel", "cpu_parallel:formulation=position", "cpu_parallel:root=raw",
                             "cpu_parallel:precision=float64"})
        models.push_back(rounding_model_of(BackendSpec::parse(spec)));
    const std::vector<Spread> spreads = references.spreads(scene, 100, end, models);
    ASSERT_EQ(spreads.size(), models.size());
    for (std::size_t n = 0; n < models.size(); ++n) {
        const Spread alone = references.spread(scene, 100, end, models[n]);
        EXPECT_EQ(spreads[n].max, alone.max) << to_string(models[n]);
        EXPECT_EQ(spreads[n].rms, alone.rms) << "the same numbers every time";
    }
    EXPECT_GT(spreads[1].rms, 100 * spreads[0].rms);
    EXPECT_GT(spreads[2].rms, 100 * spreads[0].rms);
    EXPECT_LT(spreads[3].rms, 1e-6 * spreads[0].rms);
}

// The edited body has to live as long as the run, since comparing states afterwards reads it.
TEST(Spread, OfAnEditedSceneIsSmallToo) {
    References references{no_cache()};
    const Scene scene = load_scene("scalpel_100");  // an edit in step 5 and in every tenth step after it
    const int steps = 60;
    const RoundingModel model = rounding_model_of(BackendSpec::parse("cpu_parallel:formulation=position"));
    const Spread spread = references.spread(scene, steps, references.after(scene, steps), model);
    EXPECT_GT(spread.max, 0);
    EXPECT_FALSE(is_chaotic(spread));
}

TEST(Refined, IsLeftOutWhereItTakesTooLong) {
    References references{no_cache()};
    const Scene scene = load_scene("box@100");
    const Refined refined = references.refined(scene, {scene.problem.time_step, 1000}, {1000});
    EXPECT_TRUE(refined.displacement.empty());
    EXPECT_THAT(refined.reason, HasSubstr("more than 5000000000"));
    EXPECT_EQ(references.computed(), 0);
}

TEST(Reference, OfALongRunIsTheParallelOne) {
    const Scene small = load_scene("box@6"), large = load_scene("box@32");
    EXPECT_EQ(References::name_of_backend(small, 1000), reference_backend);
    EXPECT_EQ(References::name_of_backend(large, 1000), parallel_reference_name);
    References references{no_cache()};
    // 361 steps are the first number that is too large.
    const State end = references.after(large, 361);
    const State plain = stepped("cpu_reference:formulation=increment", large.problem, large.state, 361);
    EXPECT_LT(relative_difference(end.displacement, plain.displacement), 1e-13);
}

// Catches a check of the first steps that ends a whole study, since squares of the displacements overflow.
TEST(Reference, OfARunThatDivergesIsNotChecked) {
    Scene scene = load_scene("box@32");
    scene.problem.time_step = 5 * scene.stable_time_step;
    References references{no_cache()};
    State end;
    ASSERT_NO_THROW(end = references.after(scene, 361));
    EXPECT_GT(farthest(end), largest_increment(scene, 361));
}

// Catches a limit that takes every kept state to be as large as the new one.
TEST(LatestStates, OfAllSizesHaveOneLimit) {
    const auto state_of = [](std::size_t particles) {
        const std::vector<glm::dvec3> vectors(particles, glm::dvec3(double(particles), 0, 0));
        return State{vectors, vectors};
    };
    constexpr std::size_t of_a_particle = 2 * sizeof(glm::dvec3), most = 1000 * of_a_particle;
    LatestStates latest(most);
    for (int n = 0; n < 9; ++n) (void)latest.keep("large " + std::to_string(n), state_of(100));
    EXPECT_EQ(latest.bytes(), 900 * of_a_particle);
    ASSERT_NE(latest.find("large 0"), nullptr);
    EXPECT_EQ(latest.find("large 0")->displacement.at(0).x, 100);
    for (int n = 0; n < 9; ++n) {
        EXPECT_EQ(latest.keep("small " + std::to_string(n), state_of(53)).displacement.size(), 53u);
        EXPECT_LE(latest.bytes(), most);
    }
    EXPECT_EQ(latest.find("large 8"), nullptr) << "one small state fits beside the large ones, two do not";
    EXPECT_NE(latest.find("small 8"), nullptr);
    EXPECT_EQ(latest.bytes(), 8 * 53 * of_a_particle);
    (void)latest.keep("huge", state_of(2000));
    EXPECT_NE(latest.find("huge"), nullptr);
    EXPECT_EQ(latest.find("small 8"), nullptr);
}

// --- The cache -------------------------------------------------------------------------------------------

class Cache : public ::testing::Test {
protected:
    int computed(const Scene& scene, int steps, DiskCache cache) const {
        References references(std::move(cache));
        const State state = references.after(scene, steps);
        EXPECT_EQ(state.displacement, expected_.after(scene, steps).displacement);
        EXPECT_EQ(state.increment, expected_.after(scene, steps).increment);
        return references.computed();
    }
    std::filesystem::path only_file() const {
        std::filesystem::path found;
        for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
            EXPECT_TRUE(found.empty()) << "one file";
            found = entry.path();
        }
        return found;
    }

    const TemporaryFolder temporary_;
    const std::filesystem::path folder_ = temporary_.path() / "cache";
    const Scene scene_ = Oscillator{0.1, -0.02, 0.1, 0.03, 0.2}.scene();
    mutable References expected_{no_cache()};
};

TEST_F(Cache, ComputesOnce) {
    EXPECT_EQ(computed(scene_, 9, DiskCache(folder_)), 1);
    EXPECT_EQ(computed(scene_, 9, DiskCache(folder_)), 0);
    EXPECT_EQ(computed(scene_, 10, DiskCache(folder_)), 1);
    References references{DiskCache(folder_)};
    references.refined(scene_, {0.2, 64}, {64});
    const int needed = references.computed();
    EXPECT_GE(needed, 3);
    references.refined(scene_, {0.2, 64}, {64});
    EXPECT_EQ(references.computed(), needed);
    References later{DiskCache(folder_)};
    later.refined(scene_, {0.2, 64}, {64});
    EXPECT_EQ(later.computed(), 0);
}

TEST_F(Cache, KnowsWhateverDeterminesATrajectory) {
    const DiskCache cache(folder_);
    References references{cache};
    const auto is_new = [&](const Scene& scene) {
        const int before = references.computed();
        references.after(scene, 5);
        return references.computed() > before;
    };
    EXPECT_TRUE(is_new(scene_));
    EXPECT_FALSE(is_new(scene_));
    const std::vector<std::function<void(Scene&)>> changes = {
        [](Scene& s) { s.problem.time_step *= 1.5; },
        [](Scene& s) { s.problem.damping = 0.2; },
        [](Scene& s) { s.problem.gravity.x = 1e-3; },
        [](Scene& s) { s.problem.materials[0].mass = 5; },
        [](Scene& s) { s.problem.group_stiffness[0] = 5; },
        [](Scene& s) { s.problem.rest_length[std::size_t(directions()[0].bit)] *= 1.1; },
        [](Scene& s) { s.problem.rest_position[1].z += 0.1; },
        [](Scene& s) { s.problem.pinned = {}; },
        [](Scene& s) {
            s.problem.load = {{0, 0, 0}, {0, 0, 1}};
        },
        [](Scene& s) {
            s.problem.springs = {{0, 1, 1, 1}};
        },
        [](Scene& s) { s.problem.lattice.mask[0] = ACTIVE_BIT, s.problem.lattice.mask[1] = ACTIVE_BIT; },
        [](Scene& s) { s.state.displacement[1].x = 0.01; },
        [](Scene& s) { s.state.increment[1].x = 0.01; },
        [](Scene& s) {
            Problem edited = s.problem;
            s.edits.push_back({2, SpringEditor(edited).cut(Plane{{0, 0, 0.5}, {0, 0, 1}})});
        },
    };
    for (std::size_t c = 0; c < changes.size(); ++c) {
        Scene changed = scene_;
        changes[c](changed);
        EXPECT_TRUE(is_new(changed)) << "change " << c;
    }
}

TEST(AStart, MayLeaveOutZeros) {
    Scene full = load_scene("box@11");
    full.state = random_state(full.problem, 0.01, 5);
    const State moving = full.state, rest = state_at_rest(full.problem);
    const RoundingModel model = rounding_model_of(BackendSpec::parse("cpu_parallel"));
    for (const auto& [empty, zeros] : starts_without_zeros(moving, rest)) {
        Scene scene = full;
        scene.state = empty;
        full.state = zeros;
        EXPECT_EQ(fingerprint_of(scene), fingerprint_of(full));
        References references{no_cache()}, others{no_cache()};
        const State expected = references.after(scene, 5);
        expect_same_bits(expected, others.after(full, 5));
        const double finer = full.problem.time_step / 2;
        expect_same_bits(at_time_step(scene, finer).state, at_time_step(full, finer).state);
        const Spread one = references.spread(scene, 5, expected, model);
        const Spread other = others.spread(full, 5, expected, model);
        EXPECT_EQ(one.motion_max, other.motion_max);
        EXPECT_EQ(one.rms, other.rms);
        EXPECT_EQ(summary_of(full.problem, empty, expected).moved,
                  summary_of(full.problem, zeros, expected).moved);
    }
}

TEST_F(Cache, RecomputesWhatIsTruncatedOrCorrupt) {
    computed(scene_, 9, DiskCache(folder_));
    const auto file = only_file();
    const auto size = std::filesystem::file_size(file);
    for (const auto shorter : {std::uintmax_t(0), std::uintmax_t(10), size - 1}) {
        std::filesystem::resize_file(file, shorter);
        EXPECT_EQ(computed(scene_, 9, DiskCache(folder_)), 1);
        EXPECT_EQ(std::filesystem::file_size(file), size);
    }
    for (std::uintmax_t at = 0; at < size; at += 7) {
        std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
        stream.seekg(std::streamoff(at));
        const char byte = char(stream.get() ^ 0x10);
        stream.seekp(std::streamoff(at));
        stream.put(byte);
        stream.close();
        EXPECT_EQ(computed(scene_, 9, DiskCache(folder_)), 1) << "byte " << at;
    }
    EXPECT_EQ(computed(scene_, 9, DiskCache(folder_)), 0);
}

TEST_F(Cache, StaysWithinItsSize) {
    computed(scene_, 1, DiskCache(folder_));
    const auto size = std::filesystem::file_size(only_file());
    const DiskCache small(folder_, 2 * size + size / 2);
    computed(scene_, 2, small);
    computed(scene_, 1, small);  // used again, so that the other one is now the older
    using Clock = std::filesystem::file_time_type::clock;
    const auto name_of_newest = [&] {
        std::filesystem::path newest;
        for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
            if (newest.empty() || entry.last_write_time() > std::filesystem::last_write_time(newest))
                newest = entry.path();
        }
        return newest;
    };
    std::filesystem::last_write_time(name_of_newest(), Clock::now() + std::chrono::seconds(9));
    computed(scene_, 3, small);
    EXPECT_EQ(computed(scene_, 1, small), 0);
    EXPECT_EQ(computed(scene_, 2, small), 1) << "the oldest has gone";
    std::uintmax_t total = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) total += entry.file_size();
    EXPECT_LE(total, 2 * size + size / 2);
    std::filesystem::remove_all(folder_);
    computed(scene_, 1, DiskCache(folder_, size));
    EXPECT_FALSE(std::filesystem::exists(folder_)) << "more than half of the room";
}

TEST_F(Cache, IsNotMissedWhereItCannotBeWritten) {
    EXPECT_EQ(computed(scene_, 9, no_cache()), 1);
    EXPECT_EQ(computed(scene_, 9, DiskCache("/proc/voxspring")), 1);
    EXPECT_EQ(computed(scene_, 9, DiskCache("/dev/null")), 1);
}

TEST(Hash, IsXxh3Of128Bits) {
    // Published test vectors.
    EXPECT_EQ(hash_of(""), "99aa06d3014798d86001c324468d497f");
    EXPECT_EQ(hash_of("abc"), "06b05ab6733a618578af5f94892f3950");
    // Hashing in pieces gives the same value.
    Hash hash;
    const std::string text(5000, 'x');
    for (const std::size_t begin : {0, 1, 300, 2000})
        hash.add(text.data() + begin, (begin == 0     ? 1
                                       : begin == 1   ? 300
                                       : begin == 300 ? 2000
                                                      : 5000) -
                                          begin);
    EXPECT_EQ(hash.text(), hash_of(text));
}

// --- Momentum and energy ---------------------------------------------------------------------------------

TEST(Conserved, MomentumAndEnergyByHand) {
    const Scene scene = Oscillator{0, -0.5, 0.1, 0.02, 0.2}.scene();
    const Momentum p = momentum(scene.problem, scene.state);
    EXPECT_DOUBLE_EQ(p.sum.z, 2 * 0.02 / 0.2);
    EXPECT_DOUBLE_EQ(p.size, p.sum.z);
    const Energy e = energy(scene.problem, scene.state);
    EXPECT_DOUBLE_EQ(e.kinetic, 0.5 * 2 * 0.1 * 0.1);
    EXPECT_NEAR(e.springs, 0.5 * 3 * 0.1 * 0.1, 1e-16);
    EXPECT_DOUBLE_EQ(e.field, 2 * 0.5 * 0.1);
    State faster = scene.state;
    faster.increment[1].z *= -2;
    const Drift drifted = drift(conserved(scene.problem, faster), conserved(scene.problem, scene.state));
    EXPECT_DOUBLE_EQ(drifted.momentum, 3);
    EXPECT_NEAR(drifted.energy, 0.03 / (0.01 + 0.015 + 0.1), 1e-14);
    EXPECT_EQ(drift(conserved(scene.problem, scene.state), conserved(scene.problem, scene.state)).energy, 0);
}

TEST(Conserved, EnergyKeepsItsDigitsAtSmallStrain) {
    Scene scene = Oscillator{0, 0, 1e-9, 0, 0.2}.scene();
    EXPECT_NEAR(energy(scene.problem, scene.state).springs / (0.5 * 3 * 1e-18), 1, 1e-8);
}

TEST(Conserved, DriftOfAFreeBodyIsThatOfRounding) {
    Scene scene;
    scene.problem = make_lattice_problem(solid({6, 5, 4}), FACE_BITS | EDGE_BITS);
    scene.problem.time_step = 0.25;
    scene.state = random_state(scene.problem, 0.05, 2);
    References references{no_cache()};
    const State reference = references.after(scene, 200);
    const State end = stepped("cpu_parallel:precision=float32", scene.problem, scene.state, 200);
    const Drift drifted = drift(conserved(scene.problem, end), conserved(scene.problem, reference));
    // A step rounds an increment of 0.03 within positions of 8 by at most 5e-7; 200 such errors add up at
    // random.
    EXPECT_LT(drifted.momentum, 1e-4);
    EXPECT_LT(std::abs(drifted.energy), 1e-3);
    EXPECT_GT(drifted.momentum, 0);
}

// --- Divergence ------------------------------------------------------------------------------------------

TEST(Divergence, IsFoundAtItsStep) {
    Scene scene;
    scene.problem = make_lattice_problem(solid({5, 5, 5}), FACE_BITS | EDGE_BITS);
    scene.problem.time_step = 1.5;
    scene.state = random_state(scene.problem, 0.1, 1);
    const auto backend = BackendSpec::parse("cpu_reference").make();
    SceneRunner runner(scene);
    for (const int steps : {200, 20}) {  // with a check on the way and without
        const DivergenceMonitor monitor = divergence_monitor(scene, steps);
        backend->monitor(monitor);
        runner.rewind(*backend);
        runner.run(*backend, steps);
        const auto divergence = find_divergence(*backend, runner, monitor, backend->download(), steps);
        ASSERT_TRUE(divergence) << steps;
        EXPECT_EQ(divergence->found, divergence->last_good + 1);
        const auto fastest_after = [&](std::int64_t n) {
            const State end = stepped(*backend, scene.problem, scene.state, int(n));
            double fastest = 0;
            for (const glm::dvec3& v : end.increment)
                fastest = std::max(fastest, std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z));
            return fastest;
        };
        EXPECT_LE(fastest_after(divergence->last_good), monitor.largest_increment);
        EXPECT_GT(fastest_after(divergence->found), monitor.largest_increment);
        EXPECT_THAT(describe(*divergence, monitor),
                    HasSubstr("diverged at step " + std::to_string(divergence->found)));
    }
}

TEST(Divergence, BoundGrowsWithWhatMovesAScene) {
    Scene scene = Oscillator{0, 0, 0, 0, 0.2}.scene();
    EXPECT_DOUBLE_EQ(largest_increment(scene, 100), 1);
    scene.state.increment[1].z = 0.5;
    scene.state.displacement[1].z = 0.25;
    EXPECT_DOUBLE_EQ(largest_increment(scene, 100), 1 + 0.5 + 0.5);
    scene.problem.gravity.z = -2;
    EXPECT_DOUBLE_EQ(largest_increment(scene, 100), 2 + 0.04 * 2 * 100);
    scene.problem.damping = 0.1;
    EXPECT_DOUBLE_EQ(largest_increment(scene, 100), 2 + 0.04 * 2 * 10);
}

// --- Pareto and advice -----------------------------------------------------------------------------------

nlohmann::json row_of(const std::string& backend, const std::string& device, double seconds, double error) {
    return {{"name", "box/" + backend + "/increment/float32"},
            {"scene", "box"},
            {"backend", backend},
            {"formulation", "increment"},
            {"precision", "float32"},
            {"tuning", ""},
            {"device", device},
            {"time_step", 0.25},
            {"fraction_of_stable", 0.5},
            {"steps", 100},
            {"end_time", 25},
            {"seconds", seconds},
            {"total_error_relative_l2", error},
            {"error_relative_l2", error / 2},
            {"on_front", true}};
}

TEST(Pareto, FrontHasWhatNothingBeatsOnItsDevice) {
    std::vector<ParetoRow> rows;
    for (const auto& row : {row_of("slow_and_worse", "card", 3, 1e-3), row_of("accurate", "card", 2, 1e-5),
                            row_of("fast", "card", 1, 1e-4), row_of("as_fast_and_worse", "card", 1, 2e-4),
                            row_of("alone", "cpu", 9, 1), row_of("diverged", "card", 0, 0)})
        rows.push_back(row_of_json<ParetoRow>(row));
    rows.back().seconds.reset();
    rows.back().on_front = false;
    mark_fronts(rows);
    std::vector<bool> on_front;
    for (const ParetoRow& row : rows) on_front.push_back(row.on_front);
    EXPECT_THAT(on_front, ::testing::ElementsAre(false, true, true, false, true, false));
}

TEST(Advise, FastestThatReachesTheErrorAndRunnersUp) {
    const nlohmann::json result = {
        {"pareto",
         {row_of("fast", "card", 1, 1e-2), row_of("good", "card", 2, 1e-4), row_of("other", "card", 3, 1e-4),
          row_of("third", "card", 4, 1e-5), row_of("slow", "cpu", 50, 1e-6)}}};
    const auto candidates = candidates_of(parse_json(result.dump(), "r.json"), "box");
    ASSERT_EQ(candidates.size(), 5u);
    const Advice advice = advise(candidates, 1e-3);
    ASSERT_TRUE(advice.best);
    EXPECT_EQ(advice.best->backend, "good");
    ASSERT_EQ(advice.runners_up.size(), 2u);
    EXPECT_EQ(advice.runners_up[0].backend, "other");
    EXPECT_EQ(advice.runners_up[1].backend, "slow");
    EXPECT_EQ(advise(candidates, 1e-2).best->backend, "fast");
    const Advice none = advise(candidates, 1e-9);
    EXPECT_FALSE(none.best);
    EXPECT_EQ(none.most_accurate.backend, "slow");
    EXPECT_EQ(specification(none.most_accurate), "slow:formulation=increment,precision=float32");
}

TEST(Advise, RefusesAResultThatIsNone) {
    const auto refusal = [](const std::string& text) {
        return testing::refusal([&] { candidates_of(parse_json(text, "r.json"), "box"); });
    };
    EXPECT_THAT(refusal("{}"), ::testing::AllOf(HasSubstr("r.json"), HasSubstr("pareto")));
    EXPECT_THAT(refusal(R"({"pareto": []})"), HasSubstr("it has none"));
    nlohmann::json row = row_of("fast", "card", 1, 1e-2);
    row["scene"] = "heart";
    EXPECT_THAT(refusal(nlohmann::json({{"pareto", {row}}}).dump()), HasSubstr("heart"));
    row["scene"] = "box";
    row["seconds"] = "fast";
    EXPECT_THAT(refusal(nlohmann::json({{"pareto", {row}}}).dump()),
                ::testing::AllOf(HasSubstr("pareto[0].seconds"), HasSubstr("fast")));
    row.erase("seconds");
    EXPECT_THAT(refusal(nlohmann::json({{"pareto", {row}}}).dump()), HasSubstr("seconds"));
    for (const char* key : {"seconds", "total_error_relative_l2", "error_relative_l2", "time_step"}) {
        nlohmann::json negative = row_of("fast", "card", 1, 1e-2);
        negative[key] = -1;
        EXPECT_THAT(refusal(nlohmann::json({{"pareto", {negative}}}).dump()),
                    ::testing::AllOf(HasSubstr(std::string("pareto[0].") + key), HasSubstr("-1")));
    }
}

TEST(AReference, SaysHowFarItIsAndCanBeStopped) {
    const Scene scene = load_scene("box@6");
    const int steps = 50;
    const State expected = References(no_cache()).after(scene, steps);
    std::vector<int> told;
    const auto tell = [&](int done, int all) {
        told.push_back(done);
        EXPECT_EQ(all, steps);
    };
    References talkative(no_cache(), tell, std::chrono::seconds(0));
    const State state = talkative.after(scene, steps);
    expect_same_bits(state, expected);
    ASSERT_GE(told.size(), 2u);
    EXPECT_TRUE(std::is_sorted(told.begin(), told.end()));
    EXPECT_EQ(told.back(), steps);

    struct Enough {};
    References stopped(
        no_cache(), [](int, int) { throw Enough(); }, std::chrono::seconds(0));
    EXPECT_THROW((void)stopped.after(scene, steps), Enough);

    told.clear();
    (void)References(no_cache(), tell).after(scene, steps);
    EXPECT_TRUE(told.empty()) << "nothing is told of what takes no time";
}

}  // namespace
}  // namespace voxspring::testing
