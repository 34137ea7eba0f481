// Slabs of a lattice: who has which particles, and that stepping all of them with their ghosts copied gives
// the bits that one device gives.
#include "backends/layout/slabs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <barrier>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/device_choice.h"
#include "backends/registry.h"
#include "harness/scene/scene.h"
#include "tests/required.h"
#include "tests/specifications.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;

constexpr int most_slabs = 4;

Problem with_dynamics(Problem problem) {
    problem.gravity = {8e-4, 0, -2e-3};
    problem.damping = 0.01;
    problem.time_step = 0.2;
    return problem;
}

/// Longest along x, y and z; solid and with holes; with materials, loads and pins.
std::vector<Problem> problems() {
    std::vector<Problem> all;
    all.push_back(with_dynamics(make_lattice_problem(solid({6, 5, 13}), FACE_BITS | EDGE_BITS)));
    all.push_back(with_dynamics(make_lattice_problem(random_grid({37, 9, 8}, 0.37, 1), NEIGHBOUR_BITS)));
    take_hold(all.back(), {.particles = {3, 200, 201, 700}, .held = {}, .stiffness = 0.05});
    all.push_back(with_dynamics(make_lattice_problem(random_grid({9, 23, 8}, 0.37, 2, 3), NEIGHBOUR_BITS)));
    all.back().materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    pin_base(all.back());
    all.back().load.assign(all.back().particle_count(), {0.001, -0.002, 0.003});
    return all;
}

TEST(Slabs, ShareTheParticlesEquallyAndNameTheirGhostsAlike) {
    for (const Problem& whole : problems()) {
        for (int count = 1; count <= most_slabs; ++count) {
            const SlabCuts cuts(whole, count);
            std::vector<Slab> slabs;
            std::vector<int> owners(whole.particle_count(), 0);
            for (int n = 0; n < count; ++n) {
                slabs.push_back(cuts.slab(whole, n));
                const Slab& slab = slabs.back();
                for (const std::uint32_t i : slab.own) ++owners[slab.particle[i]];
                // A layer is what cuts are made between: no slab is off by more than the two at its sides.
                const glm::ivec3 dims = whole.lattice.dims;
                const double layer = double(dims.x) * dims.y * dims.z / dims[cuts.axis()];
                EXPECT_NEAR(double(slab.own.size()), double(whole.particle_count()) / count, layer);
            }
            EXPECT_EQ(owners, std::vector<int>(owners.size(), 1));
            for (int n = 0; n + 1 < count; ++n) {
                const Slab &low = slabs[std::size_t(n)], &high = slabs[std::size_t(n) + 1];
                const auto whole_of = [](const Slab& slab, std::vector<std::uint32_t> particles) {
                    for (std::uint32_t& i : particles) i = slab.particle[i];
                    return particles;
                };
                EXPECT_FALSE(low.borders.back().sent.empty());
                EXPECT_EQ(whole_of(low, low.borders.back().sent),
                          whole_of(high, high.borders.front().received));
                EXPECT_EQ(whole_of(high, high.borders.front().sent),
                          whole_of(low, low.borders.back().received));
            }
        }
    }
}

TEST(Slabs, HaveEverySpringOfTheirOwnParticlesAndNoOther) {
    const Problem whole = problems()[2];
    const std::vector<Spring> springs = list_springs(whole);
    const SlabCuts cuts(whole, 3);
    std::size_t within = 0, across = 0;
    for (int n = 0; n < 3; ++n) {
        const Slab slab = cuts.slab(whole, n);
        std::vector<bool> own(slab.particle.size());
        for (const std::uint32_t i : slab.own) own[i] = true;
        for (const Spring& spring : list_springs(slab.problem)) {
            EXPECT_TRUE(own[spring.first] || own[spring.second]);
            (own[spring.first] && own[spring.second] ? within : across) += 1;
            EXPECT_EQ(spring.stiffness,
                      whole.spring_stiffness(slab.particle[spring.first], slab.particle[spring.second],
                                             directions()[0]));
        }
        for (std::size_t i = 0; i < own.size(); ++i) {
            EXPECT_EQ(slab.problem.is_pinned(i), !own[i] || whole.is_pinned(slab.particle[i]));
            EXPECT_EQ(std::binary_search(slab.problem.ghosts.begin(), slab.problem.ghosts.end(), i), !own[i]);
            EXPECT_EQ(slab.problem.rest_position[i], whole.rest_position[slab.particle[i]]);
        }
    }
    // A spring across a border is in both.
    EXPECT_EQ(within + across / 2, springs.size());
    EXPECT_GT(across, 0u);
}

TEST(Slabs, RefuseWhatTheyCannotCut) {
    EXPECT_EQ(SlabCuts::refusal(problems()[0], 13), "");
    EXPECT_THAT(SlabCuts::refusal(problems()[0], 14), HasSubstr("13 layers"));
    EXPECT_THAT(SlabCuts::refusal(random_network(10, 20, 1), 2), HasSubstr("lattice"));
    Problem beyond = problems()[0];
    beyond.springs.push_back({0, 7, 1, 2});
    EXPECT_THAT(SlabCuts::refusal(beyond, 2), HasSubstr("springs beyond the lattice"));
}

TEST(Slabs, AreNeverEmptyWhereLayersAre) {
    // Particles in layers 0, 1, 9 and 10 of 11 alone.
    const VoxelGrid grid = make_grid({3, 2, 11}, [](int, int, int z) { return z < 2 || z > 8; });
    const Problem whole = make_lattice_problem(grid, FACE_BITS);
    const SlabCuts cuts(whole, 4);
    for (int n = 0; n < 4; ++n) EXPECT_EQ(cuts.slab(whole, n).own.size(), 6u);
}

// --- Bits ------------------------------------------------------------------------------------------------

/// A slab on a backend of its own.
struct Part {
    Slab slab;
    Problem edited;
    std::unique_ptr<Backend> backend;
    std::vector<std::unique_ptr<Border>> sent, received;

    Part(Slab of, const BackendSpec& spec, const State& start) : slab(std::move(of)), edited(slab.problem) {
        backend = spec.make();
        backend->upload(slab.problem, slab.part_of(start));
        for (const Slab::Border& border : slab.borders) {
            sent.push_back(backend->border(border.sent));
            received.push_back(backend->border(border.received));
        }
    }
};

/// Copies what every slab has at its borders to its neighbours' ghosts.
void copy_ghosts(std::vector<Part>& parts) {
    for (std::size_t n = 0; n + 1 < parts.size(); ++n) {
        const auto copy = [](const Border& from, Border& to) {
            ASSERT_EQ(from.bytes(), to.bytes());
            std::vector<std::byte> bytes(from.bytes());
            from.read(bytes.data());
            to.write(bytes.data());
        };
        copy(*parts[n].sent.back(), *parts[n + 1].received.front());
        copy(*parts[n + 1].sent.front(), *parts[n].received.back());
    }
}

/// A step before which the tool, where there is one, has been moved.
void step_once(Backend& backend, const Problem& problem, int step) {
    if (problem.has_tool()) backend.move_tool({0.01 * step, 0, -0.02 * step});
    backend.step(1);
}

/// The state after `steps` steps of all slabs, with one of `edits` before each of the first.
State stepped_as(int slabs, const BackendSpec& spec, const Problem& whole, const State& start, int steps,
                 const std::vector<SpringEdit>& edits = {}) {
    const SlabCuts cuts(whole, slabs);
    std::vector<Part> parts;
    parts.reserve(std::size_t(slabs));  // backends keep where their problems are
    for (int n = 0; n < slabs; ++n) parts.emplace_back(cuts.slab(whole, n), spec, start);
    for (int step = 0; step < steps; ++step) {
        for (Part& part : parts) {
            if (std::size_t(step) < edits.size()) {
                const SpringEdit edit = part.slab.part_of(edits[std::size_t(step)]);
                apply(part.edited, edit);
                part.backend->edit(part.edited, edit);
            }
            step_once(*part.backend, part.edited, step);
        }
        copy_ghosts(parts);
    }
    State state = state_at_rest(whole);
    for (const Part& part : parts) part.slab.copy_own(part.backend->download(), state);
    return state;
}

/// The same, twice from the start, with borders that go by `way` from device to device. Empty, with the
/// reason, where there is no such way.
State stepped_by(const std::string& way, int slabs, const BackendSpec& spec, const Problem& whole,
                 const State& start, int steps, std::string& reason) {
    const SlabCuts cuts(whole, slabs);
    std::vector<Part> parts;
    parts.reserve(std::size_t(slabs));
    std::vector<std::shared_ptr<DeviceBorders>> borders;
    try {
        for (int n = 0; n < slabs; ++n) {
            Part& part = parts.emplace_back(cuts.slab(whole, n), spec, start);
            std::vector<SharedParticles> shared;
            for (const Slab::Border& border : part.slab.borders)
                shared.push_back({border.sent, border.received});
            borders.push_back(part.backend->device_borders(shared, way));
        }
        for (std::size_t n = 0; n < parts.size(); ++n) borders[n]->connect(borders, n);
    } catch (const Unavailable& why) {
        reason = why.what();
        return {};
    }
    const auto exchange = [&] {
        for (const auto& border : borders) border->send();
        for (const auto& border : borders) border->receive();
    };
    for (const bool again : {false, true}) {
        for (Part& part : parts) {
            if (again) {
                part.backend->rewind();
            } else {
                EXPECT_TRUE(part.backend->keep_start());
            }
        }
        exchange();
        for (int step = 0; step < steps; ++step) {
            for (Part& part : parts) step_once(*part.backend, part.edited, step);
            exchange();
        }
    }
    State state = state_at_rest(whole);
    for (const Part& part : parts) part.slab.copy_own(part.backend->download(), state);
    return state;
}

State stepped_whole(const BackendSpec& spec, const Problem& whole, const State& start, int steps,
                    const std::vector<SpringEdit>& edits = {}) {
    const std::unique_ptr<Backend> backend = spec.make();
    Problem edited = whole;
    backend->upload(whole, start);
    for (int step = 0; step < steps; ++step) {
        if (std::size_t(step) < edits.size()) {
            apply(edited, edits[std::size_t(step)]);
            backend->edit(edited, edits[std::size_t(step)]);
        }
        step_once(*backend, edited, step);
    }
    return backend->download();
}

/// Of those that say so once they have their device.
bool may_have_borders(const std::string& text) {
    if (text.starts_with("cpu_")) return true;
    const auto is_of = [&](const std::string& backend) { return text.starts_with(backend + ":"); };
    // Of the others on CUDA one sums in any order, and two have no places in memory between steps. Those of
    // cuda_resident travel within steps, see SlabsWithinSteps.
    return text.starts_with("cuda_") && !is_of("cuda_scatter") && !is_of("cuda_resident") &&
           !is_of("cuda_bricks");
}

std::vector<std::string> specifications_with_borders() {
    std::vector<std::string> all;
    for (const std::string& text : in_every_formulation()) {
        if (may_have_borders(text)) all.push_back(text);
    }
    return all;
}

class SlabBits : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override {
        make_or_skip(spec_, any_);
        if (any_) {
            ASSERT_TRUE(any_->capabilities().has_borders);
        }
    }
    /// Those that the backend can run.
    std::vector<Problem> problems() const {
        std::vector<Problem> all = testing::problems();
        std::erase_if(all, [&](const Problem& problem) { return !any_->unsupported(problem).empty(); });
        return all;
    }

    std::unique_ptr<Backend> any_;
    const BackendSpec spec_ = BackendSpec::parse(GetParam());
    static constexpr int steps = 12;
};

TEST_P(SlabBits, AreThoseOfOneDevice) {
    for (const Problem& whole : problems()) {
        const State start = random_state(whole, 0.05, 3);
        const State expected = stepped_whole(spec_, whole, start, steps);
        for (int slabs = 1; slabs <= most_slabs; ++slabs)
            expect_same_bits(stepped_as(slabs, spec_, whole, start, steps), expected);
    }
}

TEST_P(SlabBits, AreThoseOfOneDeviceWithEditsAcrossBorders) {
    for (const Problem& whole : problems()) {
        Problem edited = whole;
        const std::vector<SpringEdit> edits = edit_everything(edited, false);
        const State start = random_state(whole, 0.05, 4);
        const State expected = stepped_whole(spec_, whole, start, steps, edits);
        for (int slabs = 1; slabs <= most_slabs; ++slabs)
            expect_same_bits(stepped_as(slabs, spec_, whole, start, steps, edits), expected);
    }
}

TEST_P(SlabBits, AreThoseOfOneDeviceWhateverTheWayOfTheirBorders) {
    const std::vector<std::string> ways = any_->capabilities().border_ways;
    if (ways.empty()) GTEST_SKIP() << "its borders go through the host's memory alone";
    std::vector<Problem> wholes = problems();
    // Whose slabs have blocks of particles without any of a border, in whatever way they are made.
    wholes.push_back(with_dynamics(make_lattice_problem(solid({8, 8, 40}), FACE_BITS | EDGE_BITS)));
    for (const std::string& way : ways) {
        if (way.starts_with("nccl")) continue;  // takes a device for each rank
        SCOPED_TRACE(way);
        std::string reason;
        for (const Problem& whole : wholes) {
            reason.clear();
            const State start = random_state(whole, 0.05, 5);
            const State state = stepped_by(way, 2, spec_, whole, start, steps, reason);
            if (reason.empty()) expect_same_bits(state, stepped_whole(spec_, whole, start, steps));
        }
        EXPECT_EQ(reason, "") << "of the last, which every way is for";
    }
}

INSTANTIATE_TEST_SUITE_P(Backends, SlabBits, ::testing::ValuesIn(specifications_with_borders()), test_name);

// --- Borders that travel within steps --------------------------------------------------------------------

/// The state after all launches of `ranks` parts, each in a thread of its own on the same device.
State stepped_together(int ranks, const BackendSpec& spec, const Problem& whole, const State& start,
                       const std::vector<int>& counts, const std::vector<SpringEdit>& edits) {
    const SlabCuts cuts(whole, ranks);
    State state = state_at_rest(whole);
    std::vector<std::shared_ptr<DeviceBorders>> borders(static_cast<std::size_t>(ranks));
    std::barrier meeting(ranks);
    std::mutex mutex;
    const auto run = [&](int rank) {
        const DeviceOfThread shared({.number = 0, .wraps = false, .parts = ranks});
        const Slab slab = cuts.slab(whole, rank);
        Problem edited = slab.problem;
        const std::unique_ptr<Backend> backend = spec.make();
        if (const std::string why = backend->unsupported(slab.problem); !why.empty())
            throw std::runtime_error(why);
        backend->upload(slab.problem, slab.part_of(start));
        std::vector<SharedParticles> mine;
        for (const Slab::Border& border : slab.borders) mine.push_back({border.sent, border.received});
        borders[std::size_t(rank)] = backend->device_borders(mine, "stores");
        meeting.arrive_and_wait();
        borders[std::size_t(rank)]->connect(borders, std::size_t(rank));
        for (std::size_t n = 0; n < counts.size(); ++n) {
            if (n < edits.size()) {
                const SpringEdit edit = slab.part_of(edits[n]);
                apply(edited, edit);
                if (!edit.empty()) backend->edit(edited, edit);
            }
            meeting.arrive_and_wait();  // DeviceBorders::steps_a_call()
            backend->step(counts[n]);
        }
        const State part = backend->download();
        const std::lock_guard lock(mutex);
        slab.copy_own(part, state);
    };
    std::vector<std::jthread> threads;
    for (int rank = 0; rank < ranks; ++rank) {
        threads.emplace_back([&, rank] {
            try {
                run(rank);
            } catch (const std::exception& error) {
                ADD_FAILURE() << "rank " << rank << ": " << error.what();
                meeting.arrive_and_drop();
            }
        });
    }
    threads.clear();
    return state;
}

class SlabsWithinSteps : public ::testing::TestWithParam<std::string> {};

TEST_P(SlabsWithinSteps, HaveTheBitsOfOneDevice) {
    const BackendSpec spec = BackendSpec::parse(GetParam());
    std::unique_ptr<Backend> any;
    make_or_skip(spec, any);
    if (!any) return;
    const std::vector<int> counts = {1, 1, 4, 1, 100, 1, 1000};
    for (const Problem& whole :
         {with_dynamics(make_lattice_problem(solid({6, 5, 13}), FACE_BITS | EDGE_BITS)),
          with_dynamics(make_lattice_problem(solid({32, 8, 16}), FACE_BITS | EDGE_BITS)),
          with_dynamics(make_lattice_problem(random_grid({37, 9, 8}, 0.37, 1), NEIGHBOUR_BITS))}) {
        const State start = random_state(whole, 0.05, 3);
        for (const bool cut : {false, true}) {
            Problem edited = whole;
            std::vector<SpringEdit> edits;
            if (cut) edits = random_edits(edited, 5, 4);
            const std::unique_ptr<Backend> one = spec.make();
            Problem now = whole;
            one->upload(now, start);
            for (std::size_t n = 0; n < counts.size(); ++n) {
                if (n < edits.size()) {
                    apply(now, edits[n]);
                    one->edit(now, edits[n]);
                }
                one->step(counts[n]);
            }
            const State expected = one->download();
            for (const int ranks : {2, 3})
                expect_same_bits(stepped_together(ranks, spec, whole, start, counts, edits), expected);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Backends, SlabsWithinSteps,
                         ::testing::Values("cuda_resident:overlap=off",
                                           "cuda_resident:overlap=off,formulation=increment"),
                         test_name);

TEST(SlabsOfScenes, GiveTheBitsOfTheWholeHeart) {
    const Scene heart = load_scene("heart");
    for (const char* text : {"cpu_parallel", "cpu_reference:formulation=position"}) {
        const BackendSpec spec = BackendSpec::parse(text);
        const State expected = stepped_whole(spec, heart.problem, heart.state, 6);
        for (const int slabs : {2, 3}) {
            expect_same_bits(stepped_as(slabs, spec, heart.problem, heart.state, 6), expected);
        }
    }
}

TEST(SlabsAtRest, WakeWhenTheirGhostsMove) {
    const Poked poked({8, 8, 48});
    const BackendSpec spec = BackendSpec::parse("cpu_parallel:rest=skip");
    // A wave goes on by a voxel a step: into the last slab.
    const State expected = stepped_whole(spec, poked.problem, poked.start, 60);
    EXPECT_NE(expected.displacement.back(), glm::dvec3(0));
    expect_same_bits(stepped_as(3, spec, poked.problem, poked.start, 60), expected);
}

}  // namespace
}  // namespace voxspring::testing
