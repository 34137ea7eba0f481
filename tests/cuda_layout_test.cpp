// The CUDA backends' data layouts, and the bodies of their kernels on the host (host_kernels.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "backends/layout/blocks.h"
#include "backends/layout/delta_lists.h"
#include "backends/layout/neighbour_lists.h"
#include "backends/layout/particles.h"
#include "backends/layout/spring_array.h"
#include "backends/layout/springs.h"
#include "backends/registry.h"
#include "cuda/kernels/edit.h"
#include "tests/bodies.h"
#include "tests/host_kernels.h"
#include "tests/support.h"

namespace voxspring::cuda {
namespace {

using testing::edit_everything;
using testing::expect_same_steps;
using testing::lattice;
using testing::make_grid;
using testing::random_grid;
using testing::random_network;
using testing::random_state;
using testing::solid;
using testing::sutured;
using testing::with_dynamics;

/// The fourth component of a word, moved as shaders and kernels move it.
float fourth(const ParticleRecord<float>& word) { return std::bit_cast<float>(word.bits); }
double fourth(const ParticleRecord<double>& word) { return std::bit_cast<double>(word.bits); }

// Hardware may flush subnormal numbers to zero, so that component must be normal.
template <class Real>
void expect_normal_words(std::uint32_t bits) {
    ParticleRecord<Real> word{};
    store(&word, Particle<Real>{{1, 2, 3}, bits});
    EXPECT_TRUE(std::isnormal(fourth(word))) << bits;
    EXPECT_EQ(load_past_l1(&word).bits, bits);
    word = {};
    write_bits(&word, EditedWord{0, bits});
    EXPECT_TRUE(std::isnormal(fourth(word))) << bits;
    EXPECT_EQ(load_through_l1(&word).bits, bits);
}

TEST(Words, HaveBitsThatNoHardwareFlushes) {
    for (std::uint32_t bits : {0U, FACE_BITS, NEIGHBOUR_BITS, PINNED_BIT | EDGE_BITS}) {
        bits |= ACTIVE_BIT;
        expect_normal_words<float>(bits);
        expect_normal_words<double>(bits);
    }
    // The words of the state as it is uploaded; words without a particle are zero.
    const Problem problem = make_lattice_problem(random_grid({5, 4, 3}, 0.67, 1), FACE_BITS);
    const PackedState<double> packed =
        pack<double>(problem, random_state(problem, 0.05, 1), place_on_grid(problem.lattice),
                     problem.lattice.mask, Formulation::position);
    std::size_t particles = 0;
    for (const auto* words : {&packed.current, &packed.previous}) {
        for (const ParticleRecord<double>& word : *words) {
            if (word.particle_bits() != 0) ++particles;
            EXPECT_TRUE(word.particle_bits() != 0 ? std::isnormal(fourth(word)) : word.bits == 0);
        }
    }
    EXPECT_EQ(particles, 2 * problem.particle_count());
}

// The last block's threads beyond the words also have numbers that fit an int.
TEST(Words, AreNoMoreThanThreadsHaveNumbers) {
    constexpr std::size_t largest_block = 1024;
    EXPECT_LE((max_words + largest_block - 1) / largest_block * largest_block,
              std::size_t(std::numeric_limits<int>::max()));
}

Problem loaded_and_pinned(Problem problem) {
    testing::pin_base(problem);
    problem.load.assign(problem.particle_count(), glm::dvec3(0));
    problem.load.back() = {0.01, -0.02, 0.03};
    problem.load[problem.particle_count() / 2] = {0, 0, 0.05};
    return problem;
}

/// Problems that lie on a grid and have no springs beyond it.
std::map<std::string, Problem> lattices() {
    std::map<std::string, Problem> problems = testing::small_bodies();
    problems["aligned_box"] = lattice(solid({32, 8, 4}));
    problems["wide_box"] = lattice(solid({67, 9, 5}));
    problems["corners"] = lattice(solid({9, 8, 7}), CORNER_BITS);
    // Particles with all neighbours at both ends of a row, and no particle in its middle.
    problems["sparse_edges"] = lattice(random_grid({21, 9, 10}, 0.95, 8), EDGE_BITS);
    problems["sparse_corners"] = lattice(random_grid({21, 9, 10}, 0.95, 9), CORNER_BITS);
    problems["all_groups"] = lattice(random_grid({21, 9, 10}, 0.8, 3), NEIGHBOUR_BITS);
    problems["all_groups"].group_stiffness = {1.0, 0.5, 0.25};
    problems["anisotropic"] = lattice(solid({9, 10, 11}, {0.7, 1.0, 1.9}), NEIGHBOUR_BITS);
    problems["materials"] = lattice(random_grid({22, 11, 10}, 0.7, 4, 3));
    problems["materials"].materials = {{1, 1}, {2, 0.25}, {0.75, 0.5}};
    problems["materials_all_groups"] = lattice(random_grid({12, 11, 10}, 0.9, 4, 2), NEIGHBOUR_BITS);
    problems["materials_all_groups"].materials = {{1, 0.3}, {2, 0.25}};
    problems["loads_and_pins"] = loaded_and_pinned(lattice(random_grid({12, 11, 10}, 0.7, 5)));
    return problems;
}

std::map<std::string, Problem> networks() {
    std::map<std::string, Problem> problems;
    problems["unstructured"] = with_dynamics(random_network(60, 200, 6));
    problems["sutured_box"] = sutured(lattice(solid({7, 6, 5})));
    problems["sutured_materials"] = sutured(lattices().at("materials"));
    return problems;
}

std::map<std::string, Problem> lattices_and_networks() {
    std::map<std::string, Problem> problems = lattices();
    problems.merge(networks());
    return problems;
}

template <class V>
auto lists_by_springs(const Problem& problem, ListLayout layout = ListLayout::vertical) {
    return list_by_springs<typename V::Real>(problem, layout, V::formulation);
}
template <class V>
auto lists_by_groups(const Problem& problem, ListLayout layout = ListLayout::vertical) {
    return list_by_groups<typename V::Real>(problem, layout, V::formulation);
}

/// Every kernel body that can step the problem, by name.
template <class V>
using KernelsByName = std::map<std::string, std::unique_ptr<Simulation<V>>>;
template <class V>
KernelsByName<V> kernels_on(const Problem& problem, const State& start) {
    KernelsByName<V> all;
    for (const ListLayout layout : {ListLayout::vertical, ListLayout::concatenated}) {
        const std::string in = layout == ListLayout::vertical ? " vertical" : " concatenated";
        all["springs" + in] =
            std::make_unique<ExplicitSimulation<V>>(problem, start, lists_by_springs<V>(problem, layout));
        if (grouped_list_refusal(problem).empty())
            all["groups" + in] =
                std::make_unique<ExplicitSimulation<V>>(problem, start, lists_by_groups<V>(problem, layout));
    }
    all["deltas"] = std::make_unique<DeltaSimulation<V>>(problem, start);
    all["deltas without masks"] = std::make_unique<DeltaSimulation<V>>(problem, start, true);
    all["scatter"] = std::make_unique<ScatterSimulation<V>>(problem, start);
    if (!problem.springs.empty()) return all;
    for (const char* block : {"32x4x2", "128x1x1", "8x8x4", "16x4x4"})
        all[std::string("implicit ") + block] =
            std::make_unique<ImplicitSimulation<V>>(problem, start, BlockShape::parse(block));
    all["tiles 32x4"] = std::make_unique<TileSimulation<V, 32, 4>>(problem, start);
    all["tiles 16x16"] = std::make_unique<TileSimulation<V, 16, 16>>(problem, start);
    for (auto& [name, simulation] : all) {
        if (name.starts_with("implicit") || name.starts_with("tiles")) simulation->poison();
    }
    return all;
}

// --- Every kernel body against the oracle ----------------------------------------------------------------

template <class V>
class KernelBodies : public ::testing::Test {
protected:
    static constexpr Precision precision =
        sizeof(typename V::Real) == 4 ? Precision::float32 : Precision::float64;
};
using Variants =
    ::testing::Types<Variant<float, Formulation::paper>, Variant<float, Formulation::position>,
                     Variant<float, Formulation::displacement>, Variant<float, Formulation::increment>,
                     Variant<float, Formulation::compensated>, Variant<double, Formulation::position>,
                     Variant<double, Formulation::increment>>;
TYPED_TEST_SUITE(KernelBodies, Variants);

TYPED_TEST(KernelBodies, TheTool) {
    for (Problem problem :
         {lattices().at("prime_box"), lattices().at("loads_and_pins"), lattices().at("materials")}) {
        const State start = random_state(problem, 0.05, 7);
        take_hold(
            problem,
            {.particles = {0, 17, 18, 300}, .held = std::vector(4, glm::dvec3(0.02)), .stiffness = 0.125});
        const auto oracle = BackendSpec::parse("cpu_reference").make();
        oracle->upload(problem, start);
        const KernelsByName<TypeParam> kernels = kernels_on<TypeParam>(problem, start);
        int steps = 0;
        for (const glm::dvec3& moved : {glm::dvec3(0.1, 0, 0), glm::dvec3(0.1, -0.2, 0)}) {
            oracle->tool()->move_tool(moved);
            oracle->step(3);
            steps += 3;
            for (const auto& [name, simulation] : kernels) {
                SCOPED_TRACE(name);
                simulation->move_tool(moved);
                simulation->step(3);
                const Comparison comparison =
                    compare(problem, simulation->download(), oracle->download(), this->precision, steps);
                EXPECT_TRUE(comparison.passed()) << comparison.reason;
                // Each of four forces is the stiffness times a distance, which is off by no more than
                // particles are.
                EXPECT_LT(glm::distance(simulation->tool_force(), oracle->tool()->tool_force()),
                          4 * problem.tool.stiffness * 2 * comparison.tolerance);
            }
        }
    }
}

// The bits of implicit addressing, delta-compressed lists and lists with one counter per group are the same.
TYPED_TEST(KernelBodies, AgreeWithTheReferenceAndWithEachOther) {
    std::size_t by_groups = 0;
    for (const auto& [name, problem] : lattices_and_networks()) {
        const State start = random_state(problem, 0.05, 7);
        const KernelsByName<TypeParam> kernels = kernels_on<TypeParam>(problem, start);
        by_groups += kernels.count("groups vertical");
        for (const auto& [kernel, simulation] : kernels) {
            SCOPED_TRACE(name + " by " + kernel);
            testing::expect_reference(problem, start, *simulation, this->precision);
        }
        const State expected = kernels.at("deltas")->download();
        for (const auto& [kernel, simulation] : kernels) {
            if (!kernel.starts_with("springs") && kernel != "scatter") {
                EXPECT_EQ(simulation->download().displacement, expected.displacement)
                    << name << " by " << kernel;
            }
        }
    }
    // All lattices except those of several materials or spacings.
    EXPECT_EQ(by_groups, lattices().size() - 3);
}

TYPED_TEST(KernelBodies, RestStaysRestToTheBit) {
    if (TypeParam::formulation == Formulation::paper)
        GTEST_SKIP() << "rounds 2 - lambda and 1 - lambda apart";
    Problem problem = make_lattice_problem(random_grid({12, 11, 10}, 0.8, 3), NEIGHBOUR_BITS);
    problem.time_step = 0.2;
    problem.damping = 0.01;
    const State rest = state_at_rest(problem);
    for (const auto& [name, simulation] : kernels_on<TypeParam>(problem, rest)) {
        SCOPED_TRACE(name);
        simulation->step(20);
        testing::expect_same_bits(simulation->download(), rest);
    }
}

// What a scene does not need is skipped: empty blocks, loads, groups. A run that skips nothing gives the same
// bits.
TYPED_TEST(KernelBodies, SkipsChangeNoBit) {
    const Problem problem = lattice(make_grid({70, 21, 9}, [](int x, int y, int z) {
        return (x - 50) * (x - 50) + (y - 9) * (y - 9) + (z - 4) * (z - 4) < 36;
    }));
    Problem unladen = problem;
    unladen.load.assign(problem.particle_count(), glm::dvec3(0));
    const State start = random_state(problem, 0.05, 7);
    const BlockShape shape{8, 4, 2};

    ImplicitSimulation<TypeParam> skips(problem, start, shape), every_block(problem, start, shape),
        every_group(problem, start, shape), every_load(unladen, start, shape),
        without_masks(problem, start, shape);
    every_block.cover_the_lattice();
    every_group.use(Kernel::general);
    without_masks.use(Kernel::interior);
    const auto lists = lists_by_groups<TypeParam>(problem);
    ExplicitSimulation<TypeParam> paper(problem, start, lists), general(problem, start, lists);
    general.use(Kernel::general);
    skips.step(5);
    const State expected = skips.download();
    for (Simulation<TypeParam>* other : std::vector<Simulation<TypeParam>*>{
             &every_block, &every_group, &every_load, &without_masks, &paper, &general}) {
        other->step(5);
        EXPECT_EQ(other->download().displacement, expected.displacement);
    }
}

// The paper's ways to find neighbours: masks bit by bit, and lists whose rows say where they begin and end.
TYPED_TEST(KernelBodies, ThePapersWaysChangeNoBit) {
    auto problems = networks();
    const auto all = lattices();
    for (const char* name : {"all_groups", "materials", "loads_and_pins"}) problems[name] = all.at(name);
    for (const auto& [name, problem] : problems) {
        SCOPED_TRACE(name);
        const State start = random_state(problem, 0.05, 7);
        for (const ListLayout layout : {ListLayout::vertical, ListLayout::concatenated}) {
            std::vector kinds = {lists_by_springs<TypeParam>(problem, layout)};
            if (grouped_list_refusal(problem).empty())
                kinds.push_back(lists_by_groups<TypeParam>(problem, layout));
            for (const auto& lists : kinds) {
                ExplicitSimulation<TypeParam> rows(problem, start, lists);
                rows.use_rows();
                expect_same_steps(rows, ExplicitSimulation<TypeParam>(problem, start, lists), {2});
            }
        }
        if (!problem.springs.empty()) continue;
        const BlockShape shape{16, 16, 1};
        ImplicitSimulation<TypeParam> bits(problem, start, shape);
        bits.cover_the_lattice();
        bits.use(Kernel::bit_by_bit);
        bits.poison();
        expect_same_steps(bits, ImplicitSimulation<TypeParam>(problem, start, shape), {2});
        TileSimulation<TypeParam, 16, 16> tile(problem, start);
        tile.cover_the_lattice();
        tile.use(Kernel::bit_by_bit);
        expect_same_steps(tile, TileSimulation<TypeParam, 16, 16>(problem, start), {2});
    }
}

TEST(Masks, BitByBitFetchOnlyNeighboursThatExist) {
    using V = Variant<float, Formulation::paper>;
    const Problem problem = lattice(solid({3, 3, 3}), NEIGHBOUR_BITS);
    const auto step = make_implicit_step<float>(problem, place_on_grid(problem.lattice), V::formulation);
    int fetched = 0;
    const auto neighbour = [&](int, int, int) {
        ++fetched;
        return Point<float, false>{};
    };
    const auto compliance = [](int, int, int) { return 1.0F; };
    const Self<float, false> self{{}, ACTIVE_BIT | 0x00300105U};
    implicit_force<V::AllTerms, false>(step, self, neighbour, compliance);
    EXPECT_EQ(std::exchange(fetched, 0), neighbour_count);
    implicit_force<V::BitByBit, false>(step, self, neighbour, compliance);
    EXPECT_EQ(fetched, std::popcount(self.bits & NEIGHBOUR_BITS));
}

// A block is left out where nothing in it or around it changed in the step before.
TYPED_TEST(KernelBodies, BlocksAtRestAreLeftOutToTheBit) {
    constexpr bool drifts = TypeParam::formulation == Formulation::paper;
    Problem box = make_lattice_problem(solid({40, 12, 10}), FACE_BITS | EDGE_BITS);
    // The sparse body has neighbours side by side and across corners, and blocks without any particle.
    Problem sparse = make_lattice_problem(random_grid({44, 12, 10}, 0.6, 11), FACE_BITS | EDGE_BITS);
    for (Problem* problem : {&box, &sparse}) {
        problem->damping = 0.01;
        problem->time_step = 0.25;
        State start = state_at_rest(*problem);
        start.displacement[0] = {0.3, -0.2, 0.1};
        for (const char* shape : {"8x2x2", "4x4x4", "8x4x1"}) {
            SCOPED_TRACE(shape);
            ImplicitSimulation<TypeParam> plain(*problem, start, BlockShape::parse(shape)),
                resting(*problem, start, BlockShape::parse(shape)),
                looking(*problem, start, BlockShape::parse(shape)),
                flushing(*problem, start, BlockShape::parse(shape));

            resting.leave_out_resting();
            resting.poison();
            looking.leave_out_resting();
            looking.look_first();
            std::size_t fewest = resting.blocks();
            for (int n = 0; n < 32; ++n) {
                plain.step(1);
                resting.step(1);
                looking.step(1);
                fewest = std::min(fewest, resting.blocks_stepped());
                for (const auto* skipping : {&resting, &looking}) {
                    testing::expect_same_bits(skipping->download(), plain.download());
                }
                // The block of the corner, and the blocks around those that it pulls at.
                if (n > 0) {
                    EXPECT_EQ(looking.blocks_stepped(), resting.blocks_stepped());
                } else if (!drifts) {
                    EXPECT_LE(looking.blocks_stepped(), 27u);
                }
            }
            EXPECT_EQ(fewest < resting.blocks() / 2, !drifts);
            if constexpr (by_increments(TypeParam::formulation)) {
                flushing.leave_out_resting(Kernel::flushing);
                flushing.step(32);
                EXPECT_LT(flushing.blocks_stepped(), resting.blocks_stepped());
            }
        }
    }
}

// From the middle of a block everything reaches all 26 surrounding blocks in the same step, and none of these
// would list the others.
TYPED_TEST(KernelBodies, AChangeListsEveryBlockAroundIt) {
    Problem problem = make_lattice_problem(solid({15, 15, 15}), NEIGHBOUR_BITS);
    problem.time_step = 0.2;
    State start = state_at_rest(problem);
    start.displacement[problem.particle_count() / 2] = {0.1, -0.2, 0.15};
    const BlockShape shape{5, 5, 5};
    ImplicitSimulation<TypeParam> plain(problem, start, shape), resting(problem, start, shape);
    resting.leave_out_resting();
    expect_same_steps(resting, plain, std::vector<int>(8, 1));
}

// Gravity stops the particle for one step, in every formulation without rounding: it stays where it is, but
// is not at rest.
TYPED_TEST(KernelBodies, AParticleThatTurnsRoundIsNotAtRest) {
    Problem problem = make_lattice_problem(solid({1, 1, 1}), FACE_BITS);
    problem.time_step = 0.25;
    problem.gravity = {0, 0, -1};
    State start = state_at_rest(problem);
    start.increment[0] = {0, 0, 0.0625};
    ImplicitSimulation<TypeParam> resting(problem, start, BlockShape{1, 1, 1});
    resting.leave_out_resting();
    resting.step(1);
    EXPECT_EQ(resting.download().displacement[0], glm::dvec3(0));
    resting.step(2);
    EXPECT_EQ(resting.download().displacement[0], glm::dvec3(0, 0, -0.1875));
}

// --- Layouts ---------------------------------------------------------------------------------------------

TEST(NeighbourLists, NeighboursComeInSummationOrder) {
    const Problem problem = lattice(solid({3, 3, 3}), NEIGHBOUR_BITS);
    const auto lists = list_by_springs<float>(problem, ListLayout::vertical, Formulation::position);
    const std::uint32_t centre = 13;
    ASSERT_EQ(lists.bits[centre] & list_count_bits, 26U);
    for (const Direction& direction : directions()) {
        EXPECT_EQ(lists.neighbour[lists.shape.at(centre, std::uint32_t(direction.bit))],
                  std::uint32_t(std::ptrdiff_t(centre) + problem.lattice.stride(direction)));
    }
}

TEST(NeighbourLists, LayoutsDifferInOrderAlone) {
    const Problem problem = lattices().at("dense");
    const auto vertical = list_by_groups<float>(problem, ListLayout::vertical, Formulation::position);
    const auto concatenated = list_by_groups<float>(problem, ListLayout::concatenated, Formulation::position);
    EXPECT_EQ(vertical.shape.at(5, 3) + 1, vertical.shape.at(6, 3));
    EXPECT_EQ(vertical.shape.at(0, 3) % 32, 0U);
    EXPECT_EQ(concatenated.shape.at(5, 3) + 1, concatenated.shape.at(5, 4));
    for (std::uint32_t i = 0; i < problem.particle_count(); ++i) {
        for (std::uint32_t slot = 0; slot < vertical.shape.slots; ++slot)
            EXPECT_EQ(vertical.neighbour[vertical.shape.at(i, slot)],
                      concatenated.neighbour[concatenated.shape.at(i, slot)]);
    }
}

TEST(NeighbourLists, IndicesOfLargeLatticesDoNotWrap) {
    // Box 512^3 with 26 neighbours: 3.5e9 entries.
    const std::uint32_t particles = 512U * 512U * 512U;
    const ListShape vertical{.particle_stride = 1, .slot_stride = particles, .slots = 26};
    EXPECT_EQ(vertical.at(particles - 1, 25), 26ULL * particles - 1);
    EXPECT_EQ(list_size(particles, 26, ListLayout::vertical), 26ULL * particles);
    EXPECT_EQ(list_size(particles, 26, ListLayout::concatenated), 26ULL * particles);
}

TEST(NeighbourLists, EntriesNumberAsManyParticlesAsTheirBitsDo) {
    constexpr std::size_t most = std::size_t(1) << LISTED_INDEX_BITS;
    for (const Formulation formulation : every_formulation) {
        EXPECT_EQ(list_entry_refusal(most, formulation), "");
        EXPECT_EQ(list_entry_refusal(most + 1, formulation),
                  on_positions(formulation) ? ""
                                            : "134217729 particles exceed the 134217728 that an entry of a "
                                              "neighbour list can number beside a direction");
    }
    const std::uint32_t last = entry_of(std::uint32_t(most - 1), -1, Formulation::displacement);
    EXPECT_EQ(last & LISTED_INDEX, most - 1);
    EXPECT_EQ(last >> LISTED_INDEX_BITS, OWN_DIRECTION);
}

TEST(DeltaLists, AreSharedByRuns) {
    // A box has one list for all but its first and last slice and row, where deltas would lead out of it.
    EXPECT_LE(compress_lists(lattice(solid({50, 40, 30}))).lists.size(), 8U);
    // The number of lists may differ by one where a row ends and the next one begins.
    const Problem ball = lattice(make_grid({41, 41, 41}, [](int x, int y, int z) {
        return (x - 20) * (x - 20) + (y - 20) * (y - 20) + (z - 20) * (z - 20) < 400;
    }));
    std::size_t rows = 0;
    for (std::size_t i = 0; i < ball.particle_count(); ++i)
        rows += i == 0 || ball.lattice.voxel[i] != ball.lattice.voxel[i - 1] + 1 ? 1 : 0;
    EXPECT_LE(compress_lists(ball).lists.size(), rows);
}

// Cuts change masks; lists made afterwards lead to the same neighbours.
TEST(DeltaLists, DoNotDependOnLatticeSprings) {
    Problem problem = lattices().at("dense");
    const DeltaLists before = compress_lists(problem);
    SpringEditor(problem).cut(Plane{problem.rest_position[problem.particle_count() / 2], {1, 0.2, -0.1}});
    const DeltaLists after = compress_lists(problem);
    EXPECT_EQ(before.slices, after.slices);
    EXPECT_EQ(before.lists, after.lists);
}

TEST(SpringArrays, AreOrderedByDirection) {
    const auto springs = list_every_spring<double>(lattice(solid({4, 4, 4})), Formulation::position);
    EXPECT_EQ(springs.ends[0], (SpringEnds{0, 1}));
    EXPECT_EQ(springs.ends[1], (SpringEnds{1, 2}));
}

TEST(ActiveBlocks, AreListedOnlyWhereTheyDoNotCoverTheLattice) {
    EXPECT_TRUE(occupied_blocks(lattice(solid({33, 5, 3})).lattice, BlockShape::parse("32x4x2")).empty());
    // More blocks along z than a grid of blocks may have.
    const std::vector<BlockOrigin> tall =
        occupied_blocks(lattice(solid({1, 1, 70000})).lattice, BlockShape::parse("32x8"));
    ASSERT_EQ(tall.size(), 70000U);
    EXPECT_EQ(tall.back(), (BlockOrigin{0, 0, 69999, 1 + 3 + 70000 * 9}));
    EXPECT_FALSE(fits_launch(lattice(solid({1, 1, 70000})).lattice, BlockShape::parse("32x8")));
    EXPECT_TRUE(fits_launch(lattice(solid({1, 1, 70000})).lattice, BlockShape::parse("32x4x2")));
}

TEST(ActiveBlocks, ShapesAreParsed) {
    EXPECT_EQ(BlockShape::parse("32x4x2"), (BlockShape{32, 4, 2}));
    EXPECT_EQ(BlockShape::parse("64x4"), (BlockShape{64, 4, 1}));
    EXPECT_EQ(BlockShape::parse("128"), (BlockShape{128, 1, 1}));
}

TEST(BeyondGroups, SaysWhyNot) {
    EXPECT_EQ(grouped_list_refusal(lattices().at("all_groups")), "");
    EXPECT_NE(grouped_list_refusal(lattices().at("anisotropic")), "");
    EXPECT_NE(grouped_list_refusal(lattices().at("materials")), "");
    EXPECT_NE(grouped_list_refusal(networks().at("unstructured")), "");
    EXPECT_NE(grouped_list_refusal(networks().at("sutured_box")), "");
}

// --- Edits -----------------------------------------------------------------------------------------------

TYPED_TEST(KernelBodies, EditedListsAreThoseOfTheEditedProblem) {
    using Real = typename TypeParam::Real;
    for (const auto& [name, problem] : lattices_and_networks()) {
        for (const ListLayout layout : {ListLayout::vertical, ListLayout::concatenated}) {
            for (const bool by_groups : {true, false}) {
                SCOPED_TRACE(name + (by_groups ? " by groups" : " by springs"));
                Problem edited = problem;
                const std::vector<SpringEdit> edits = edit_everything(edited, false);
                // Edits may cut all springs beyond groups; in between there are some.
                if (by_groups && !(grouped_list_refusal(problem) + grouped_list_refusal(edited)).empty())
                    continue;
                // Sutures between the faces of `corners` are no lattice springs.
                if (std::any_of(edits.begin(), edits.end(),
                                [](const SpringEdit& edit) { return edit.leaves_lattice(); }))
                    continue;
                const auto list = [&](const Problem& p) {
                    auto lists = by_groups ? list_by_groups<Real>(p, layout, TypeParam::formulation)
                                           : list_by_springs<Real>(p, layout, TypeParam::formulation);
                    measure(lists.constants, TypeParam::formulation);
                    return lists;
                };
                NeighbourLists<Real> lists = list(problem);
                Problem now = problem;
                for (const SpringEdit& edit : edits) {
                    apply(now, edit);
                    ASSERT_LE(longest_list(edit), lists.shape.slots);
                    const auto rows =
                        by_groups
                            ? edited_by_groups<Real>(now, edit, lists.shape.slots, TypeParam::formulation)
                            : edited_by_springs<Real>(now, edit, lists.shape.slots, TypeParam::formulation);
                    const EditedRows<Real> on_device{rows.particle.data(),
                                                     rows.lists.bits.data(),
                                                     rows.lists.neighbour.data(),
                                                     by_groups ? nullptr : rows.lists.constants.data(),
                                                     data_of(rows.lists.off_lattice_rest),
                                                     !by_increments(TypeParam::formulation)};
                    for (std::size_t n = 0; n < rows.lists.neighbour.size(); ++n) {
                        write_slot(on_device, n, lists.shape, lists.neighbour.data(), lists.constants.data(),
                                   lists.off_lattice_rest.data());
                    }
                    for (std::size_t r = 0; r < rows.particle.size(); ++r)
                        lists.bits[rows.particle[r]] = rows.lists.bits[r];
                }
                const NeighbourLists<Real> built = list(edited);
                EXPECT_EQ(lists.bits, built.bits);
                // A particle's springs are in its first slots, or in the first slots of their group. The
                // slots that are left hold the particle itself.
                for (std::uint32_t i = 0; i < problem.particle_count(); ++i) {
                    const std::uint32_t unused =
                        on_positions(TypeParam::formulation) ? i : i | NO_DIRECTION << LISTED_INDEX_BITS;
                    for (std::uint32_t s = 0; s < lists.shape.slots; ++s) {
                        const bool there = s < built.shape.slots;
                        const std::size_t at = lists.shape.at(i, s);
                        ASSERT_EQ(lists.neighbour[at],
                                  there ? built.neighbour[built.shape.at(i, s)] : unused);
                        if (by_groups) continue;
                        const SpringConstants<Real> none{0, 0};
                        const auto& expected = there ? built.constants[built.shape.at(i, s)] : none;
                        ASSERT_EQ(lists.constants[at].stiffness, expected.stiffness);
                        ASSERT_EQ(lists.constants[at].rest_length, expected.rest_length);
                    }
                }
            }
        }
    }
}

TYPED_TEST(KernelBodies, EditedDeltaListsStepLikeThoseOfTheEditedProblem) {
    for (const auto& [name, problem] : lattices_and_networks()) {
        for (const bool beyond : {false, true}) {
            SCOPED_TRACE(name + (beyond ? " beyond the lattice" : ""));
            Problem edited = problem;
            const std::vector<SpringEdit> edits = edit_everything(edited, beyond);
            const State start = random_state(problem, 0.05, 7);
            // The problem that was built with the edits has a way without masks.
            DeltaSimulation<TypeParam> played(problem, start), built(edited, start, true);
            Problem now = problem;
            for (const SpringEdit& edit : edits) {
                apply(now, edit);
                played.edit(now, edit);
            }
            played.step(3);
            built.step(3);
            testing::expect_same_bits(played.download(), built.download());
        }
    }
}

// Only what changed is sent to the device.
TEST(OffLatticeLists, ChangesAreAllThatChanged) {
    const Problem problem = lattice(solid({40, 12, 11}));
    Problem edited = problem;
    const std::vector<SpringEdit> edits = edit_everything(edited, true);
    std::vector<Slice> slices = compress_lists(problem).slices;
    OffLatticeLists<float> own(problem, place_guarded(problem), Formulation::increment, slices);
    EXPECT_TRUE(own.empty());
    std::vector<Slice> sent_slices = slices;
    std::vector<std::uint32_t> sent;
    Problem now = problem;
    for (const SpringEdit& edit : edits) {
        apply(now, edit);
        const auto changes = own.change(now, edit, slices);
        sent.resize(own.neighbour().size());
        for (const EditedSlice& changed : changes.slices) sent_slices[changed.number] = changed.slice;
        const NeighbourLists<float>& columns = changes.columns.lists;
        for (std::size_t n = 0; n < columns.neighbour.size(); ++n)
            sent[columns.shape.at(changes.columns.particle[n / slice_particles],
                                  std::uint32_t(n % slice_particles))] = columns.neighbour[n];
        EXPECT_EQ(columns.neighbour.size(), changes.columns.particle.size() * slice_particles);
        EXPECT_EQ(columns.off_lattice_rest.size(), columns.neighbour.size());
        EXPECT_EQ(sent_slices, slices);
    }
    EXPECT_FALSE(own.empty());
    // Columns that a slice no longer uses are empty.
    for (const Slice& slice : slices) {
        const std::size_t begin = std::size_t(slice.off_lattice_begin) * slice_particles;
        for (std::size_t n = 0; n < std::size_t(slice.off_lattice_slots) * slice_particles; ++n)
            ASSERT_EQ(sent[begin + n], own.neighbour()[begin + n]);
    }
}

// An edit is one kernel, whose threads write in any order.
TEST(SpringSlots, AnEditWritesEachSlotOnce) {
    const Problem problem = sutured(lattice(solid({4, 3, 3})));
    const auto springs = list_every_spring<float>(problem, Formulation::position);
    SpringSlots slots(problem, springs.begin, Formulation::position);
    SpringEdit edit;
    const ChangedSpring of_lattice{{0, 1, 1, 1}, 1};
    edit.removed = {of_lattice, {problem.springs[0], -1}, {problem.springs[1], -1}};
    edit.added = {of_lattice, {{2, 20, 0.5, 1.5}, -1}};
    std::set<std::pair<std::size_t, std::uint32_t>> written;
    for (const auto& change : slots.slots_of<float>(edit)) {
        const bool searched = change.begin < change.end;
        EXPECT_TRUE(written.emplace(change.begin, searched ? change.ends.first : 0).second) << change.begin;
        if (searched) {
            EXPECT_EQ(change.constants.stiffness, 1.0F);
        }
    }
    // Slots that were given back are available to the next edit.
    SpringEdit next;
    next.added = {{{3, 21, 0.5, 1.5}, -1}};
    EXPECT_LT(slots.slots_of<float>(next).front().begin, springs.ends.size());
}

TYPED_TEST(KernelBodies, SpringSlotsHoldTheSpringsOfTheEditedProblem) {
    using Real = typename TypeParam::Real;
    // Sorted, since slots have no order.
    using Listed = std::vector<std::tuple<std::uint32_t, std::uint32_t, Real, Real>>;
    const auto listed = [](const std::vector<SpringEnds>& ends,
                           const std::vector<SpringConstants<Real>>& constants) {
        Listed springs;
        for (std::size_t s = 0; s < ends.size(); ++s) {
            if (constants[s].stiffness != 0)
                springs.emplace_back(ends[s].first, ends[s].second, constants[s].stiffness,
                                     constants[s].rest_length);
        }
        std::sort(springs.begin(), springs.end());
        return springs;
    };
    for (const auto& [name, problem] : lattices_and_networks()) {
        SCOPED_TRACE(name);
        Problem edited = problem;
        std::vector<SpringEdit> edits = edit_everything(edited, true);
        for (SpringEdit& edit : edit_everything(edited, true)) edits.push_back(std::move(edit));
        SpringArrays<Real> springs = list_every_spring<Real>(problem, TypeParam::formulation);
        measure(springs.constants, TypeParam::formulation);
        SpringSlots slots(problem, springs.begin, TypeParam::formulation);
        std::size_t max_beyond = problem.springs.size();
        Problem now = problem;
        for (const SpringEdit& edit : edits) {
            apply(now, edit);
            max_beyond = std::max(max_beyond, now.springs.size());
            const auto changes = slots.template slots_of<Real>(edit);
            springs.ends.resize(std::max(springs.ends.size(), slots.used()));
            springs.constants.resize(springs.ends.size(), {0, 0});
            if (!on_positions(TypeParam::formulation)) springs.off_lattice_rest.resize(springs.ends.size());
            for (const auto& change : changes)
                write_spring(change, springs.ends.data(), springs.constants.data(),
                             data_of(springs.off_lattice_rest));
            SpringArrays<Real> built = list_every_spring<Real>(now, TypeParam::formulation);
            measure(built.constants, TypeParam::formulation);
            ASSERT_TRUE(listed(springs.ends, springs.constants) == listed(built.ends, built.constants));
        }
        // Slots are given back and taken again.
        EXPECT_EQ(slots.used(), springs.begin.back() + max_beyond);
    }
}

}  // namespace
}  // namespace voxspring::cuda
