// Subdomains of a lattice: which particles each has, and that stepping all of them with copied ghosts gives
// the bits of one device.
#include "backends/layout/decomposition.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <barrier>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/device_choice.h"
#include "backends/registry.h"
#include "harness/scene/scene.h"
#include "tests/bodies.h"
#include "tests/required.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using ::testing::HasSubstr;

/// How many subdomains along each axis: slabs across the longest one, and bricks.
std::vector<glm::ivec3> cuts_of(const Problem& problem) {
    std::vector<glm::ivec3> cuts;
    for (const int slabs : {1, 2, 3, 4}) cuts.push_back(Decomposition::slabs(problem, slabs));
    for (const glm::ivec3 bricks : {glm::ivec3(2, 1, 1), {1, 2, 2}, {2, 2, 2}, {3, 1, 3}})
        cuts.push_back(bricks);
    return cuts;
}

std::vector<Subdomain> subdomains_of(const Problem& whole, glm::ivec3 cut) {
    const Decomposition decomposition(whole, cut);
    std::vector<Subdomain> all;
    for (int n = 0; n < decomposition.count(); ++n) all.push_back(decomposition.subdomain(whole, n));
    return all;
}

/// The border of a subdomain with another one; null if they have none.
const Subdomain::Border* border_with(const Subdomain& subdomain, int other) {
    for (const Subdomain::Border& border : subdomain.borders) {
        if (border.subdomain == other) return &border;
    }
    return nullptr;
}

TEST(Decompositions, ShareTheParticlesEquallyAndNameTheirGhostsAlike) {
    for (const Problem& whole : bodies_to_cut()) {
        const glm::ivec3 dims = whole.lattice.dims;
        for (const glm::ivec3 cut : cuts_of(whole)) {
            const std::vector<Subdomain> all = subdomains_of(whole, cut);
            const Decomposition decomposition(whole, cut);
            std::vector<int> owners(whole.particle_count(), 0);
            // Cuts lie between layers, so that each side is off by at most one layer.
            double layers = 0;
            for (int axis = 0; axis < 3; ++axis) {
                if (cut[axis] > 1) layers += double(dims.x) * dims.y * dims.z / dims[axis];
            }
            for (std::size_t n = 0; n < all.size(); ++n) {
                for (const std::uint32_t i : all[n].own) ++owners[all[n].particle[i]];
                EXPECT_NEAR(double(all[n].own.size()), double(whole.particle_count()) / double(all.size()),
                            layers);
            }
            EXPECT_EQ(owners, std::vector<int>(owners.size(), 1));
            const auto whole_of = [](const Subdomain& subdomain, std::vector<std::uint32_t> particles) {
                for (std::uint32_t& i : particles) i = subdomain.particle[i];
                return particles;
            };
            for (int one = 0; one < int(all.size()); ++one) {
                for (int other = 0; other < int(all.size()); ++other) {
                    const Subdomain &here = all[std::size_t(one)], &there = all[std::size_t(other)];
                    const Subdomain::Border *to = border_with(here, other), *from = border_with(there, one);
                    ASSERT_EQ(to == nullptr, from == nullptr);
                    if (to == nullptr) continue;
                    EXPECT_EQ(whole_of(here, to->sent), whole_of(there, from->received));
                    EXPECT_LE(to->sent.size(), decomposition.most_sent(one, other));
                }
            }
        }
    }
}

TEST(Decompositions, HaveNoGhostThatNoSpringCouldReach) {
    // One of eight bricks has three neighbours with face springs alone, six with edge springs as well, and
    // seven with corner springs.
    for (const auto& [groups, neighbours] :
         {std::pair{FACE_BITS, 3U}, {FACE_BITS | EDGE_BITS, 6U}, {NEIGHBOUR_BITS, 7U}}) {
        const Problem whole = make_lattice_problem(solid({8, 8, 8}), groups);
        for (const Subdomain& brick : subdomains_of(whole, {2, 2, 2})) {
            EXPECT_EQ(brick.borders.size(), neighbours);
            std::vector<bool> own(brick.particle.size()), reached(brick.particle.size());
            for (const std::uint32_t i : brick.own) own[i] = true;
            for (const Spring& spring : list_springs(brick.problem))
                reached[spring.first] = reached[spring.second] = true;
            for (const std::uint32_t ghost : brick.problem.ghosts) EXPECT_TRUE(reached[ghost]);
        }
    }
}

TEST(Decompositions, CutIntoBricksWhereTheseHaveLessBorder) {
    const auto bricks = [](glm::ivec3 dims, int count) {
        return Decomposition::bricks(make_lattice_problem(solid(dims), FACE_BITS | EDGE_BITS), count);
    };
    EXPECT_EQ(bricks({16, 16, 16}, 8), glm::ivec3(2, 2, 2));
    EXPECT_EQ(bricks({8, 8, 64}, 8), glm::ivec3(1, 1, 8));
    EXPECT_EQ(bricks({64, 8, 8}, 4), glm::ivec3(4, 1, 1));
    EXPECT_EQ(bricks({16, 16, 16}, 7), glm::ivec3(1, 1, 7));
    // Two boxes side by side along y, joined by few springs, and longer along z.
    const Problem whole = make_lattice_problem(
        make_grid({6, 11, 16}, [](int, int y, int z) { return y != 5 || z == 0; }), FACE_BITS);
    EXPECT_EQ(Decomposition::slabs(whole, 4), glm::ivec3(1, 1, 4));
    EXPECT_EQ(Decomposition::bricks(whole, 4), glm::ivec3(1, 2, 2));
    EXPECT_EQ(Decomposition::bricks(whole, 2), glm::ivec3(1, 1, 2)) << "of two there are slabs alone";
    EXPECT_EQ(Decomposition::bricks(random_network(10, 20, 1), 2), glm::ivec3(1, 1, 2));
}

TEST(Decompositions, HaveEverySpringOfTheirOwnParticlesAndNoOther) {
    const Problem whole = bodies_to_cut()[2];
    const std::vector<Spring> springs = list_springs(whole);
    for (const glm::ivec3 cut : {glm::ivec3(1, 3, 1), {2, 2, 2}}) {
        std::size_t within = 0, across = 0;
        for (const Subdomain& part : subdomains_of(whole, cut)) {
            std::vector<bool> own(part.particle.size());
            for (const std::uint32_t i : part.own) own[i] = true;
            for (const Spring& spring : list_springs(part.problem)) {
                EXPECT_TRUE(own[spring.first] || own[spring.second]);
                (own[spring.first] && own[spring.second] ? within : across) += 1;
                EXPECT_EQ(spring.stiffness,
                          whole.spring_stiffness(part.particle[spring.first], part.particle[spring.second],
                                                 directions()[0]));
            }
            for (std::size_t i = 0; i < own.size(); ++i) {
                EXPECT_EQ(part.problem.is_pinned(i), !own[i] || whole.is_pinned(part.particle[i]));
                EXPECT_EQ(std::binary_search(part.problem.ghosts.begin(), part.problem.ghosts.end(), i),
                          !own[i]);
                EXPECT_EQ(part.problem.rest_position[i], whole.rest_position[part.particle[i]]);
            }
        }
        // Both subdomains have a spring that crosses their border.
        EXPECT_EQ(within + across / 2, springs.size());
        EXPECT_GT(across, 0u);
    }
}

TEST(Decompositions, LeaveOutWhatAStartLeavesOut) {
    const std::vector<glm::dvec3> some = {{1, 0, 0}, {2, 0, 0}, {3, 0, 0}};
    const std::vector<glm::dvec3> of_part = {some[0], some[2]};
    expect_same_bits(part_of(State{}, {0, 2}), {});
    expect_same_bits(part_of(State{some, {}}, {0, 2}), {of_part, {}});
    expect_same_bits(part_of(State{{}, some}, {0, 2}), {{}, of_part});
}

TEST(Decompositions, RefuseWhatTheyCannotCut) {
    const auto refusal = [](const Problem& problem, int slabs) {
        return Decomposition::refusal(problem, Decomposition::slabs(problem, slabs));
    };
    EXPECT_EQ(refusal(bodies_to_cut()[0], 13), "");
    EXPECT_EQ(refusal(bodies_to_cut()[0], 14),
              "the body has 13 layers with particles along z, so it cannot be cut into 14 parts");
    EXPECT_EQ(Decomposition::refusal(bodies_to_cut()[0], {2, 6, 2}),
              "the body has 5 layers with particles along y, so it cannot be cut into 6 parts");
    EXPECT_EQ(Decomposition::refusal(make_lattice_problem(solid({4, 3, 1}), FACE_BITS), {1, 1, 2}),
              "the body has 1 layer with particles along z, so it cannot be cut into 2 parts");
    EXPECT_THAT(refusal(bodies_to_cut()[0], 0), HasSubstr("at least one part"));
    EXPECT_THAT(refusal(random_network(10, 20, 1), 2), HasSubstr("lattice"));
    Problem beyond = bodies_to_cut()[0];
    beyond.springs.push_back({0, 7, 1, 2});
    EXPECT_THAT(refusal(beyond, 2), HasSubstr("springs that are not those of its lattice"));
}

TEST(Decompositions, AreNeverEmptyWhereLayersAre) {
    // Only layers 0, 1, 9 and 10 of 11 have particles.
    const VoxelGrid grid = make_grid({3, 2, 11}, [](int, int, int z) { return z < 2 || z > 8; });
    const Problem whole = make_lattice_problem(grid, FACE_BITS);
    const std::vector<Subdomain> slabs = subdomains_of(whole, {1, 1, 4});
    for (const Subdomain& slab : slabs) EXPECT_EQ(slab.own.size(), 6u);
    // No border crosses the empty layers.
    EXPECT_EQ(slabs[1].borders.size(), 1u);
}

// --- Bits ------------------------------------------------------------------------------------------------

/// A subdomain and the backend that steps it.
struct Part {
    Subdomain subdomain;
    Problem edited;
    std::unique_ptr<Backend> backend;
    std::vector<std::unique_ptr<Border>> sent, received;

    Part(Subdomain of, const BackendSpec& spec, const State& start)
        : subdomain(std::move(of)), edited(subdomain.problem) {
        backend = spec.make();
        backend->upload(subdomain.problem, subdomain.part_of(start));
        for (const Subdomain::Border& border : subdomain.borders) {
            sent.push_back(backend->borders()->border(border.sent));
            received.push_back(backend->borders()->border(border.received));
        }
    }
};

/// Copies what every subdomain has at its borders to the others' ghosts.
void copy_ghosts(std::vector<Part>& parts) {
    for (std::size_t n = 0; n < parts.size(); ++n) {
        const std::vector<Subdomain::Border>& borders = parts[n].subdomain.borders;
        for (std::size_t b = 0; b < borders.size(); ++b) {
            const Part& other = parts[std::size_t(borders[b].subdomain)];
            const Border& from = *other.sent.at(
                std::size_t(border_with(other.subdomain, int(n)) - other.subdomain.borders.data()));
            Border& to = *parts[n].received[b];
            ASSERT_EQ(from.bytes(), to.bytes());
            std::vector<std::byte> bytes(from.bytes());
            from.read(bytes.data());
            to.write(bytes.data());
        }
    }
}

/// Launch n, of `steps` steps; the tool, if there is one, is moved before it.
void step_once(Backend& backend, const Problem& problem, int n, int steps = 1) {
    if (problem.has_tool()) backend.tool()->move_tool({0.01 * n, 0, -0.02 * n});
    backend.step(steps);
}

/// The state after `steps` steps of all subdomains. Edit n is made before step n.
State stepped_as(glm::ivec3 cut, const BackendSpec& spec, const Problem& whole, const State& start, int steps,
                 const std::vector<SpringEdit>& edits = {}) {
    std::vector<Subdomain> subdomains = subdomains_of(whole, cut);
    std::vector<Part> parts;
    parts.reserve(subdomains.size());  // backends keep references to their problems
    for (Subdomain& subdomain : subdomains) parts.emplace_back(std::move(subdomain), spec, start);
    for (int step = 0; step < steps; ++step) {
        for (Part& part : parts) {
            if (std::size_t(step) < edits.size()) {
                const SpringEdit edit = part.subdomain.part_of(edits[std::size_t(step)]);
                const SpringDifference kept = part.subdomain.part_of(whole, edits[std::size_t(step)]);
                EXPECT_EQ(SpringEditor(part.edited).make(kept), edit);
                part.backend->edit(part.edited, edit);
            }
            step_once(*part.backend, part.edited, step);
        }
        copy_ghosts(parts);
    }
    State state = state_at_rest(whole);
    for (const Part& part : parts) part.subdomain.copy_own(part.backend->download(), state);
    return state;
}

/// The state after `steps` steps with borders that go by `way` from device to device. It steps twice from the
/// start and returns the second result. If the way is unavailable the state is empty and `reason` says why.
State stepped_by(const std::string& way, glm::ivec3 cut, const BackendSpec& spec, const Problem& whole,
                 const State& start, int steps, std::string& reason) {
    std::vector<Subdomain> subdomains = subdomains_of(whole, cut);
    std::vector<Part> parts;
    parts.reserve(subdomains.size());
    std::vector<std::shared_ptr<DeviceBorders>> borders;
    try {
        for (Subdomain& subdomain : subdomains) {
            Part& part = parts.emplace_back(std::move(subdomain), spec, start);
            std::vector<SharedParticles> shared;
            for (const Subdomain::Border& border : part.subdomain.borders)
                shared.push_back({border.subdomain, border.sent, border.received});
            borders.push_back(part.backend->borders()->device_borders(shared, way));
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
    for (const Part& part : parts) part.subdomain.copy_own(part.backend->download(), state);
    return state;
}

/// The state after these launches. Edit n is made before launch n.
State stepped_whole(const BackendSpec& spec, const Problem& whole, const State& start,
                    const std::vector<int>& launches, const std::vector<SpringEdit>& edits = {}) {
    const std::unique_ptr<Backend> backend = spec.make();
    Problem edited = whole;
    backend->upload(whole, start);
    for (std::size_t n = 0; n < launches.size(); ++n) {
        if (n < edits.size()) {
            apply(edited, edits[n]);
            backend->edit(edited, edits[n]);
        }
        step_once(*backend, edited, int(n), launches[n]);
    }
    return backend->download();
}
State stepped_whole(const BackendSpec& spec, const Problem& whole, const State& start, int steps,
                    const std::vector<SpringEdit>& edits = {}) {
    return stepped_whole(spec, whole, start, std::vector<int>(std::size_t(steps), 1), edits);
}

/// Whether a backend may have borders. It says for certain once it has its device.
bool may_have_borders(const std::string& text) {
    if (text.starts_with("cpu_")) return true;
    const auto is_of = [&](const std::string& backend) { return text.starts_with(backend + ":"); };
    // Among CUDA's backends cuda_scatter sums in any order, and cuda_resident and cuda_bricks keep no
    // positions in memory between steps. For the borders of cuda_resident within steps see
    // SubdomainsWithinSteps.
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

class SubdomainBits : public BackendTest {
protected:
    void SetUp() override {
        BackendTest::SetUp();
        if (backend) {
            ASSERT_TRUE(backend->capabilities().has_borders);
        }
    }
    /// The problems that the backend can run.
    std::vector<Problem> problems() const {
        std::vector<Problem> all = bodies_to_cut();
        std::erase_if(all, [&](const Problem& problem) { return !backend->unsupported(problem).empty(); });
        return all;
    }

    /// The cuts that keep the order of the backend's sums.
    std::vector<glm::ivec3> cuts(const Problem& whole) const {
        std::vector<glm::ivec3> all = cuts_of(whole);
        if (spec.entry->name == "cuda_march")
            std::erase_if(all, [](glm::ivec3 cut) { return cut.x > 1 || cut.y > 1; });
        return all;
    }

    static constexpr int steps = 12;
};

TEST_P(SubdomainBits, AreThoseOfOneDevice) {
    for (const Problem& whole : problems()) {
        const State start = random_state(whole, 0.05, 3);
        const State expected = stepped_whole(spec, whole, start, steps);
        for (const glm::ivec3 cut : cuts(whole))
            expect_same_bits(stepped_as(cut, spec, whole, start, steps), expected);
    }
}

TEST_P(SubdomainBits, AreThoseOfOneDeviceWithEditsAcrossBorders) {
    for (const Problem& whole : problems()) {
        Problem edited = whole;
        const std::vector<SpringEdit> edits = edit_everything(edited, false);
        const State start = random_state(whole, 0.05, 4);
        const State expected = stepped_whole(spec, whole, start, steps, edits);
        for (const glm::ivec3 cut : cuts(whole))
            expect_same_bits(stepped_as(cut, spec, whole, start, steps, edits), expected);
    }
}

TEST_P(SubdomainBits, AreThoseOfOneDeviceWhateverTheWayOfTheirBorders) {
    const std::vector<std::string> ways = backend->capabilities().border_ways;
    if (ways.empty()) GTEST_SKIP() << "its borders go through the host's memory alone";
    std::vector<Problem> wholes = problems();
    // Its slabs have blocks of particles without any particle of a border, however blocks are made.
    wholes.push_back(lattice(solid({8, 8, 40}), FACE_BITS | EDGE_BITS));
    for (const std::string& way : ways) {
        if (way.starts_with("nccl")) continue;  // needs a device for each rank
        SCOPED_TRACE(way);
        std::string reason;
        for (const Problem& whole : wholes) {
            const State start = random_state(whole, 0.05, 5);
            const State expected = stepped_whole(spec, whole, start, steps);
            for (const glm::ivec3 cut : {glm::ivec3(2, 2, 1), Decomposition::slabs(whole, 2)}) {
                reason.clear();
                const State state = stepped_by(way, cut, spec, whole, start, steps, reason);
                if (reason.empty()) expect_same_bits(state, expected);
            }
        }
        EXPECT_EQ(reason, "") << "of the last, which every way is for";
    }
}

INSTANTIATE_TEST_SUITE_P(Backends, SubdomainBits, ::testing::ValuesIn(specifications_with_borders()),
                         test_name);

// --- Borders that travel within steps --------------------------------------------------------------------

/// The state after all launches of `ranks` parts, each in its thread, on the same device or on `own_devices`.
/// The devices exchange borders by `way` and wait for each other.
State stepped_together(int ranks, bool own_devices, const BackendSpec& spec, const std::string& way,
                       const Problem& whole, const State& start, const std::vector<int>& counts,
                       const std::vector<SpringEdit>& edits) {
    const Decomposition decomposition(whole, Decomposition::slabs(whole, ranks));
    State state = state_at_rest(whole);
    std::vector<std::shared_ptr<DeviceBorders>> borders(static_cast<std::size_t>(ranks));
    std::barrier meeting(ranks);
    std::mutex mutex;
    const auto run = [&](int rank) {
        const DeviceOfThread taken(own_devices ? DeviceNumber{.number = rank, .wraps = false, .parts = 1}
                                               : DeviceNumber{.number = 0, .wraps = false, .parts = ranks});
        const Subdomain part = decomposition.subdomain(whole, rank);
        Problem edited = part.problem;
        const std::unique_ptr<Backend> backend = spec.make();
        if (const std::string why = backend->unsupported(part.problem); !why.empty())
            throw std::runtime_error(why);
        backend->upload(part.problem, part.part_of(start));
        std::vector<SharedParticles> mine;
        for (const Subdomain::Border& border : part.borders)
            mine.push_back({border.subdomain, border.sent, border.received});
        const auto own = borders[std::size_t(rank)] = backend->borders()->device_borders(mine, way);
        meeting.arrive_and_wait();
        own->connect(borders, std::size_t(rank));
        for (std::size_t n = 0; n < counts.size(); ++n) {
            if (n < edits.size()) {
                const SpringEdit edit = part.part_of(edits[n]);
                apply(edited, edit);
                if (!edit.empty()) backend->edit(edited, edit);
            }
            const bool within_steps = own->steps_per_call() > 0;
            if (!within_steps && !backend->borders()->prepare_exchanges(*own, counts[n]))
                throw std::runtime_error("it cannot step without the host");
            // The ranks meet before and after (DeviceBorders::steps_per_call()), since each may wait for
            // everything on its device.
            meeting.arrive_and_wait();
            if (within_steps) {
                backend->step(counts[n]);
            } else {
                backend->borders()->step_and_exchange(*own, counts[n]);
            }
            meeting.arrive_and_wait();
        }
        const State stepped = backend->download();
        const std::lock_guard lock(mutex);
        part.copy_own(stepped, state);
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

/// A backend and a way, separated by a space.
class SubdomainsWithinSteps : public ::testing::TestWithParam<std::string> {};

TEST_P(SubdomainsWithinSteps, HaveTheBitsOfOneDevice) {
    const std::string text = GetParam().substr(0, GetParam().find(' ')),
                      way = GetParam().substr(GetParam().find(' ') + 1);
    std::unique_ptr<Backend> any;
    make_or_skip(text, any);
    if (!any) return;
    const BackendSpec spec = BackendSpec::parse(text);
    // Only resident kernels may wait for each other on one device.
    const bool own_devices = spec.entry->name != "cuda_resident";
    std::vector<int> ranks_to_try = {2, 3};
    if (own_devices)
        std::erase_if(ranks_to_try, [&](int ranks) { return ranks > any->capabilities().devices; });
    if (ranks_to_try.empty()) GTEST_SKIP() << "there is one device only";
    const std::vector<int> counts = {1, 1, 4, 1, 100, 1, 1000};
    // Slabs of the last two have blocks without any particle of a border, however blocks are made.
    std::vector<Problem> wholes = {lattice(solid({6, 5, 13}), FACE_BITS | EDGE_BITS),
                                   lattice(solid({32, 8, 16}), FACE_BITS | EDGE_BITS),
                                   lattice(random_grid({37, 9, 8}, 0.37, 1), NEIGHBOUR_BITS),
                                   lattice(solid({8, 8, 90}), FACE_BITS | EDGE_BITS),
                                   lattice(random_grid({9, 12, 90}, 0.9, 1), FACE_BITS | EDGE_BITS)};
    if (way.ends_with("_overlap")) wholes.erase(wholes.begin(), wholes.end() - 2);
    std::erase_if(wholes, [&](const Problem& whole) {
        return !any->unsupported(whole).empty() ||
               (spec.entry->name == "cuda_march" && Decomposition::slabs(whole, 2).z == 1);
    });
    ASSERT_GE(wholes.size(), 2u);
    for (const Problem& whole : wholes) {
        const State start = random_state(whole, 0.05, 3);
        for (const bool cut : {false, true}) {
            Problem edited = whole;
            std::vector<SpringEdit> edits;
            if (cut) edits = random_edits(edited, 5, 4);
            const State expected = stepped_whole(spec, whole, start, counts, edits);
            for (const int ranks : ranks_to_try)
                expect_same_bits(stepped_together(ranks, own_devices, spec, way, whole, start, counts, edits),
                                 expected);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Backends, SubdomainsWithinSteps,
                         ::testing::Values("cuda_resident:overlap=off stores",
                                           "cuda_resident:overlap=off,formulation=increment stores",
                                           "cuda_march stores", "cuda_march stores_overlap",
                                           "cuda_tiles stores",
                                           "cuda_tiles:formulation=increment stores_overlap",
                                           "cuda_implicit_cached stores_overlap",
                                           "cuda_implicit_shared:formulation=compensated stores",
                                           "cuda_explicit_delta:precision=float64 stores_overlap",
                                           "cuda_explicit_cached stores"),
                         test_name);

TEST(SubdomainsOfScenes, GiveTheBitsOfTheWholeHeart) {
    const Scene heart = load_scene("heart");
    for (const char* text : {"cpu_parallel", "cpu_reference:formulation=position"}) {
        const BackendSpec spec = BackendSpec::parse(text);
        const State expected = stepped_whole(spec, heart.problem, heart.state, 6);
        for (const glm::ivec3 cut : {glm::ivec3(1, 1, 3), {2, 2, 2}})
            expect_same_bits(stepped_as(cut, spec, heart.problem, heart.state, 6), expected);
    }
}

TEST(SubdomainsAtRest, WakeWhenTheirGhostsMove) {
    const Poked poked({8, 8, 48});
    const BackendSpec spec = BackendSpec::parse("cpu_parallel:rest=skip");
    // A wave advances by one voxel per step, so that it reaches the last part.
    const State expected = stepped_whole(spec, poked.problem, poked.start, 60);
    EXPECT_NE(expected.displacement.back(), glm::dvec3(0));
    expect_same_bits(stepped_as({2, 1, 3}, spec, poked.problem, poked.start, 60), expected);
}

}  // namespace
}  // namespace voxspring::testing
