// The tables of the resident kernel, and its body run on the host through them.
#include "backends/layout/resident_layout.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "backends/layout/blocks.h"
#include "backends/layout/decomposition.h"
#include "cuda/kernels/edit.h"
#include "cuda/kernels/resident.h"
#include "harness/scene/scene.h"
#include "tests/bodies.h"
#include "tests/support.h"

namespace voxspring::cuda {
namespace {

using testing::random_grid;
using testing::solid;

/// A card whose blocks have `threads` threads with particles.
ResidentCard card_of(int blocks, int threads = max_resident_threads) { return {blocks, 99 << 10U, threads}; }

struct Case {
    const char* name;
    glm::ivec3 dims;
    double active;
    int blocks, pollers;
    Partition partition;
    bool overlap;
    int edits = 0;  ///< edits before the layout
    int threads = max_resident_threads;
    int turns = 1;  ///< expected
};

class Resident : public ::testing::TestWithParam<Case> {
protected:
    Resident()
        : problem_(edited(
              make_lattice_problem(random_grid(GetParam().dims, GetParam().active, 5), NEIGHBOUR_BITS))),
          layout_(lay_out(problem_)),
          slot_(slots_with(layout_, problem_.lattice.mask)) {}

    static Problem edited(Problem problem) {
        voxspring::testing::random_edits(problem, GetParam().edits, 6);
        return problem;
    }
    static ResidentLayout lay_out(const Problem& problem) {
        return lay_out_resident(problem, card_of(GetParam().blocks, GetParam().threads), GetParam().pollers,
                                GetParam().partition, GetParam().overlap);
    }

    std::size_t lane_of(std::size_t block, std::size_t lane) const {
        return block * std::size_t(layout_.lanes) + lane;
    }

    /// The slot where a lane finds its neighbour in `direction`.
    int slot_of(std::size_t at, const Direction& direction) const {
        glm::ivec3 o = direction.offset;
        if ((layout_.border[at / 32] & mirrored_y) != 0) o.y = -o.y;
        if ((layout_.border[at / 32] & mirrored_z) != 0) o.z = -o.z;
        return slot_[layout_.slot_index(bit_of(o.x, o.y, o.z), at)];
    }

    /// The particle in each slot of a block; fails the test if a slot has two.
    std::map<int, std::uint32_t> slots_of(std::size_t block) const {
        std::map<int, std::uint32_t> particle;
        const auto has = [&](int slot, std::uint32_t i) {
            EXPECT_LT(slot, layout_.slots);
            EXPECT_TRUE(particle.emplace(slot, i).second) << "slot " << slot << " twice";
        };
        for (std::size_t lane = 0; lane < std::size_t(layout_.lanes); ++lane) {
            const std::uint32_t i = layout_.particle[lane_of(block, lane)];
            if (i != resident_none) has(layout_.own_slot[lane_of(block, lane)], i);
        }
        for (std::size_t n = 0; n < layout_.polled.size(); ++n) {
            const auto pollers = std::size_t(layout_.pollers);
            if (n / pollers % std::size_t(layout_.blocks) != block || layout_.polled[n] == resident_none)
                continue;
            has(layout_.polled_slot[n], layout_.polled_word[n]);
        }
        return particle;
    }

    const Problem problem_;
    const ResidentLayout layout_;
    const std::vector<std::uint16_t> slot_;
};

// Particles without neighbours in other blocks come first, so that a thread waits for the border once.
TEST_P(Resident, ThreadsStepTheirParticlesInTurns) {
    EXPECT_EQ(layout_.turns, GetParam().turns);
    EXPECT_EQ(layout_.threads() % 32, 0);
    EXPECT_LE(layout_.threads(), GetParam().threads);
    if (layout_.turns == 1) return;
    int inner = 0;
    for (std::size_t block = 0; block < std::size_t(layout_.blocks); ++block) {
        const auto begin = layout_.border.begin() + std::ptrdiff_t(lane_of(block, 0) / 32);
        const auto end = begin + layout_.lanes / 32;
        EXPECT_TRUE(std::is_sorted(begin, end));
        inner += int(std::count(begin, end, 0));
    }
    EXPECT_GT(inner, 0);
    Problem pinned = problem_;
    voxspring::testing::pin_base(pinned);
    const std::vector<std::uint16_t> own = own_slots_with(layout_, pinned.lattice.mask);
    for (std::size_t at = 0; at < own.size(); ++at) {
        EXPECT_EQ(own[at] % pinned_slot, layout_.own_slot[at]);
        const std::uint32_t i = layout_.particle[at];
        if (i == resident_none) continue;
        EXPECT_EQ(own[at] >= pinned_slot, (pinned.lattice.mask[i] & PINNED_BIT) != 0);
    }
}

TEST_P(Resident, EveryPollNamesThePointThatItsOwnerPublishes) {
    std::map<std::uint32_t, std::uint32_t> publisher;
    for (std::size_t at = 0; at < layout_.published.size(); ++at) {
        if (layout_.published[at] == resident_none) continue;
        EXPECT_LT(layout_.published[at], layout_.published_count);
        EXPECT_TRUE(publisher.emplace(layout_.published[at], layout_.particle[at]).second);
    }
    EXPECT_EQ(publisher.size(), layout_.published_count);
    std::set<std::uint32_t> polled;
    for (std::size_t n = 0; n < layout_.polled.size(); ++n) {
        if (layout_.polled[n] == resident_none) continue;
        EXPECT_EQ(publisher.at(layout_.polled[n]), layout_.polled_word[n]);
        polled.insert(layout_.polled[n]);
    }
    EXPECT_EQ(polled.size(), layout_.published_count) << "published in vain";
}

TEST_P(Resident, WhatIsAddedEarlyIsWithinTheBlock) {
    for (std::size_t block = 0; block < std::size_t(layout_.blocks); ++block) {
        const auto slots = slots_of(block);
        const auto first = layout_.particle.begin() + std::ptrdiff_t(lane_of(block, 0));
        const std::set<std::uint32_t> own(first, first + layout_.lanes);
        for (std::size_t at = lane_of(block, 0); at < lane_of(block + 1, 0); ++at) {
            const int border = layout_.border[at / 32], kind = border & border_kind_bits;
            EXPECT_NE(layout_.border_kinds >> kind & 1U, 0U);
            if (!GetParam().overlap && layout_.turns == 1) {
                EXPECT_EQ(border, mixed_border);
            }
            if (kind == mixed_border || layout_.particle[at] == resident_none) continue;
            for (const Direction& direction : directions()) {
                if ((problem_.lattice.mask[layout_.particle[at]] >> direction.bit & 1U) == 0) continue;
                const int y = (border & mirrored_y) != 0 ? -1 : 1, z = (border & mirrored_z) != 0 ? -1 : 1;
                const bool across =
                    (kind / 2 != 0 && direction.offset.y == y) || (kind % 2 != 0 && direction.offset.z == z);
                EXPECT_EQ(own.contains(slots.at(slot_of(at, direction))), !across);
            }
        }
    }
}

// A warp's neighbours in one direction lie in as many different banks as its own points.
TEST_P(Resident, PointsOfAWarpAreInFewBanksTwice) {
    std::size_t taken = 0, warps = 0;
    for (std::size_t first = 0; first < layout_.particle.size(); first += 32) {
        std::array<std::size_t, 32> banks{};
        std::size_t most = 0;
        for (std::size_t at = first; at < first + 32; ++at) {
            if (layout_.particle[at] != resident_none)
                most = std::max(most, ++banks[layout_.own_slot[at] % 32U]);
        }
        taken += most;
        warps += most > 0 ? 1 : 0;
    }
    // Rows have no conflict; a random body, which has no order to exploit, has at most two on average.
    const bool rows = GetParam().partition == Partition::rows;
    EXPECT_LE(taken, (rows ? 1 : 3) * warps);
}

template <class Neighbour>
Vector<float> force(const ImplicitStep<float>& step, const Self<float, false>& self, Neighbour neighbour) {
    using Terms = KernelTerms<Formulation::increment, NEIGHBOUR_BITS, 0, false>;
    return implicit_force<Terms, false>(step, self, neighbour, [](int, int, int) { return 0.0F; });
}

template <class Border, class Neighbour>
Vector<float> force_in_two(const ImplicitStep<float>& step, const Vector<float>& spacing,
                           const Self<float, false>& self, Neighbour neighbour) {
    using Terms = KernelTerms<Formulation::increment, NEIGHBOUR_BITS, 0, false>;
    const auto compliance = [](int, int, int) { return 0.0F; };
    GroupSums<float> sums;
    add_springs<Terms, true, Except<Border>>(step, spacing, self, neighbour, compliance, sums);
    add_springs<Terms, true, Border>(step, spacing, self, neighbour, compliance, sums);
    return force_of<Terms>(step, sums);
}

// It needs no mask, since an absent neighbour is the particle itself, which pulls with no force.
TEST_P(Resident, SlotsGiveTheForcesOfTheGrid) {
    const auto particle = particle_of_voxel(problem_.lattice);
    const State state = voxspring::testing::random_state(problem_, 0.1, 3);
    const auto point = [&](std::uint32_t i) -> Point<float, false> {
        const glm::dvec3 u = state.displacement[i];
        return {{float(u.x), float(u.y), float(u.z)}};
    };
    const auto step =
        make_implicit_step<float>(problem_, place_on_grid(problem_.lattice), Formulation::increment);
    for (std::size_t block = 0; block < std::size_t(layout_.blocks); ++block) {
        const auto slots = slots_of(block);
        for (std::size_t lane = 0; lane < std::size_t(layout_.lanes); ++lane) {
            const std::size_t at = lane_of(block, lane);
            const std::uint32_t i = layout_.particle[at];
            if (i == resident_none) continue;
            const Self<float, false> self{point(i), problem_.lattice.mask[i]};
            const auto by_slot = [&](int dx, int dy, int dz) {
                return point(slots.at(slot_[layout_.slot_index(bit_of(dx, dy, dz), at)]));
            };
            const auto by_grid = [&](int dx, int dy, int dz) {
                if ((self.bits >> bit_of(dx, dy, dz) & 1U) == 0) return self.point;
                const auto& lattice = problem_.lattice;
                const std::ptrdiff_t stride =
                    (std::ptrdiff_t(dz) * lattice.dims.y + dy) * lattice.dims.x + dx;
                return point(particle[std::size_t(std::ptrdiff_t(lattice.voxel[i]) + stride)]);
            };
            const Vector<float> expected = force(step, self, by_grid);
            const int border = layout_.border[at / 32];
            Vector<float> spacing = step.spacing;
            if ((border & mirrored_y) != 0) spacing.y = -spacing.y;
            if ((border & mirrored_z) != 0) spacing.z = -spacing.z;
            if ((border & (mirrored_y | mirrored_z)) == 0) {
                EXPECT_EQ(force_in_two<EveryNeighbour>(step, spacing, self, by_slot), expected);
            }
            // In two sums and in another order: up to 26 roundings of a sum of terms of up to 1 each, at half
            // an ulp of 26.
            const Vector<float> in_two = force_in_two<Across<true, true>>(step, spacing, self, by_slot);
            const float tolerance = 26 * 26 * 6e-8F;
            EXPECT_NEAR(in_two.x, expected.x, tolerance);
            EXPECT_NEAR(in_two.y, expected.y, tolerance);
            EXPECT_NEAR(in_two.z, expected.z, tolerance);
        }
    }
}

INSTANTIATE_TEST_SUITE_P(
    Bodies, Resident,
    ::testing::Values(
        Case{"box_in_rows", {32, 8, 8}, 1, 8, 256, Partition::rows, true},
        Case{"long_box_in_rows", {64, 8, 4}, 1, 7, 64, Partition::automatic, true},
        Case{"box_by_bisection", {12, 11, 10}, 1, 6, 256, Partition::bisection, false},
        Case{"sparse", {14, 13, 12}, 0.4, 9, 32, Partition::automatic, true},
        Case{"sparse_in_rows", {40, 6, 5}, 0.3, 4, 128, Partition::rows, true},
        Case{"cut_in_rows", {32, 8, 8}, 1, 8, 256, Partition::rows, true, 3},
        Case{"sparse_and_cut", {14, 13, 12}, 0.63, 9, 64, Partition::automatic, true, 4},
        Case{"more_blocks_than_particles", {2, 2, 1}, 1, 9, 32, Partition::bisection, true},
        Case{"rows_in_turns", {32, 8, 8}, 1, 2, 256, Partition::automatic, true, 3, 256, 4},
        Case{"sparse_in_turns", {14, 13, 12}, 0.63, 3, 128, Partition::automatic, false, 4, 192, 3}),
    [](const auto& tested) { return std::string(tested.param.name); });

// After a series of edits, each written as on a device, everything that a launch reads equals a new layout of
// the edited problem.
TEST_P(Resident, AnEditLeavesTheTablesOfTheEditedProblem) {
    Problem now = problem_, edited = problem_;
    std::vector<std::uint16_t> slot = slot_;
    std::vector<ParticleRecord<float>> words(problem_.particle_count());
    for (std::size_t i = 0; i < words.size(); ++i) words[i].bits = problem_.lattice.mask[i];
    for (const SpringEdit& edit : voxspring::testing::random_edits(edited, 6, 7)) {
        apply(now, edit);
        const ResidentEdit written = resident_edit(layout_, edit);
        EXPECT_EQ(written.slots, 2 * (edit.removed.size() + edit.added.size()));
        EXPECT_EQ(written.words.size(), written.slots + edit.touched.size());
        for (std::size_t n = 0; n < written.words.size(); ++n)
            write_slot_or_bits(slot.data(), written.slots, words.data(), written.words.data(), n);
        EXPECT_EQ(layout_, lay_out(now));
        EXPECT_EQ(slot, slots_with(layout_, now.lattice.mask));
        for (std::size_t i = 0; i < words.size(); ++i) ASSERT_EQ(words[i].bits, now.lattice.mask[i]);
    }
    EXPECT_EQ(now.lattice.mask, edited.lattice.mask);
}

TEST(ResidentLayout, TheBoxOfThePaperIsInRowsWhoseBordersAreOnOneSide) {
    const Problem problem = make_lattice_problem(solid({32, 32, 32}), FACE_BITS | EDGE_BITS);
    const ResidentLayout layout = lay_out_resident(problem, card_of(132), 256, Partition::automatic, true);
    EXPECT_EQ(layout.blocks, 128);
    EXPECT_EQ(layout.lanes, 256);
    EXPECT_EQ(layout.border_kinds >> mixed_border & 1U, 0U);
    for (std::size_t block = 0; block < 128; ++block) {
        std::set<int> kinds;
        for (std::size_t row = 0; row < 8; ++row)
            kinds.insert(layout.border[8 * block + row] & border_kind_bits);
        EXPECT_LE(kinds.size(), 2U) << "code of one block";
    }
    EXPECT_EQ(block_refusal(layout, card_of(132)), "");
}

// In turns the box took 4.3 us on 24 multiprocessors of an H100, and bricks 2.3 us.
TEST(ResidentLayout, PredictsWhatFewMultiprocessorsTook) {
    MarchDevice few = voxspring::testing::march_device_of(24);
    few.hertz = 1.98e9;
    const Problem box = load_scene("box").problem;
    const ResidentCard card{few.multiprocessors, few.block_shared_bytes};
    const ResidentLayout layout = lay_out_resident(box, card, 256, Partition::automatic, true);
    EXPECT_NEAR(seconds_in_turns(layout, few.hertz), 4.3e-6, 0.4e-6);
    const auto bricks = plan_bricks(box, Formulation::position, few, true);
    ASSERT_TRUE(bricks);
    EXPECT_NEAR(bricks->seconds, 2.3e-6, 0.3e-6);
    EXPECT_EQ(
        outpaced_by_bricks(layout, bricks, few.hertz),
        "each thread would step 3 particles, so that a step is predicted to take 4.3 us, but cuda_bricks is "
        "predicted to take 2.3 us");
    EXPECT_EQ(outpaced_by_bricks(layout, std::nullopt, few.hertz), "") << "no other backend to go on to";
    // One particle per thread has been measured beside bricks, which predict less than they took there.
    const ResidentLayout large = lay_out_resident(box, card_of(132), 256, Partition::automatic, true);
    EXPECT_EQ(outpaced_by_bricks(large, BrickPlan{.seconds = 1e-9}, few.hertz), "");
}

// The paper's own bodies are on the chip of small cards, whatever the tool. Bricks compute their whole box,
// whether it is full or not: small cards leave the box to them, and the heart stays where it is.
TEST(ResidentLayout, SmallCardsHoldTheBodiesOfThePaperAndLeaveTheBoxAloneToBricks) {
    int kept = 0, left = 0;
    for (const char* scene : {"box", "heart"}) {
        const Problem problem = load_scene(scene).problem;
        for (const voxspring::testing::CardProfile& profile : voxspring::testing::card_profiles()) {
            SCOPED_TRACE(std::string(scene) + " on " + profile.name);
            const ResidentCard card{profile.device.multiprocessors, profile.device.block_shared_bytes};
            const ResidentLayout layout = lay_out_resident(problem, card, 256, Partition::automatic, true);
            const std::string refusal = block_refusal(layout, card, ToolMode::ticks);
            // 16 blocks of 48 KiB have room for 32,768 points, and none for those of their neighbours.
            EXPECT_EQ(refusal.empty(), card.shared_bytes > 48U << 10U) << refusal;
            EXPECT_EQ(layout.turns > 1, card.blocks < 100);
            if (!block_refusal(layout, card).empty()) continue;
            for (const Formulation formulation : {Formulation::position, Formulation::increment}) {
                const auto bricks =
                    plan_bricks(problem, formulation, profile.device, profile.architecture >= 90);
                const std::string why = outpaced_by_bricks(layout, bricks, profile.device.hertz);
                const bool in_turns = layout.turns > 1;
                ++(in_turns ? left : kept);
                EXPECT_EQ(!why.empty(), in_turns && scene == std::string("box")) << why;
                EXPECT_EQ(!why.empty(), in_turns && bricks &&
                                            bricks->seconds < seconds_in_turns(layout, profile.device.hertz));
            }
        }
    }
    EXPECT_EQ(kept, 12) << "A100, H200 and RTX 5090, two bodies, two formulations";
    EXPECT_EQ(left, 4) << "RTX 4060";
}

// Here rows waste no more than a tenth, but the busiest block would have 17 of them, 544 lanes.
TEST(ResidentLayout, DealsOutParticlesWhereABlockCannotHoldItsRows) {
    for (const auto& [dims, blocks] :
         {std::pair{glm::ivec3(29, 46, 46), 132}, {glm::ivec3(29, 42, 42), 108}}) {
        const Problem problem = make_lattice_problem(solid(dims), FACE_BITS | EDGE_BITS);
        const ResidentCard card = card_of(blocks);
        EXPECT_EQ(lay_out_resident(problem, card, 256, Partition::rows, true).turns, 2);
        const ResidentLayout layout = lay_out_resident(problem, card, 256, Partition::automatic, true);
        EXPECT_EQ(layout.turns, 1);
        EXPECT_EQ(block_refusal(layout, card), "");
    }
}

TEST_P(Resident, EveryHeldParticleHasItsLane) {
    const auto last = std::uint32_t(problem_.particle_count() - 1);
    const std::vector<std::uint32_t> held = {0, last - 1, last};
    const std::vector<std::uint32_t> number = held_by_lanes(layout_, held);
    ASSERT_EQ(number.size(), layout_.particle.size());
    std::size_t found = 0;
    for (std::size_t lane = 0; lane < number.size(); ++lane) {
        const bool is_held = std::find(held.begin(), held.end(), layout_.particle[lane]) != held.end();
        ASSERT_EQ(number[lane] != resident_none, is_held);
        if (!is_held) continue;
        EXPECT_EQ(held[number[lane]], layout_.particle[lane]);
        ++found;
    }
    EXPECT_EQ(found, held.size());
}

/// One of the slabs that a body is cut into.
Subdomain slab_of(const Problem& whole, int ranks, int number) {
    return Decomposition(whole, Decomposition::slabs(whole, ranks)).subdomain(whole, number);
}

/// Parts of a body, their layouts, and what they send to each other.
class ResidentParts : public ::testing::TestWithParam<Case> {
protected:
    static constexpr int ranks = 3;
    ResidentParts()
        : whole_(make_lattice_problem(random_grid(GetParam().dims, GetParam().active, 5), NEIGHBOUR_BITS)),
          cuts_(whole_, Decomposition::slabs(whole_, ranks)) {
        for (int rank = 0; rank < ranks; ++rank) {
            slabs_.push_back(cuts_.subdomain(whole_, rank));
            layouts_.push_back(
                lay_out_resident(slabs_.back().problem, card_of(GetParam().blocks, GetParam().threads),
                                 GetParam().pollers, GetParam().partition, GetParam().overlap));
        }
    }
    /// What `rank` sends.
    std::vector<ResidentSending> sendings_of(int rank) const {
        std::vector<ResidentSending> sendings;
        for (const Subdomain::Border& border : slabs_[std::size_t(rank)].borders) {
            const auto other = std::size_t(border.subdomain);
            const auto& back =
                border.subdomain < rank ? slabs_[other].borders.back() : slabs_[other].borders.front();
            sendings.push_back(
                {border.sent, words_of_ghosts(layouts_[other], slabs_[other].problem, back.received)});
        }
        return sendings;
    }

    const Problem whole_;
    const Decomposition cuts_;
    std::vector<Subdomain> slabs_;
    std::vector<ResidentLayout> layouts_;
};

TEST_P(ResidentParts, StepTheirOwnParticlesAlone) {
    for (int rank = 0; rank < ranks; ++rank) {
        std::vector<std::uint32_t> stepped;
        const ResidentLayout& layout = layouts_[std::size_t(rank)];
        for (const std::uint32_t i : layout.particle) {
            if (i != resident_none) stepped.push_back(i);
        }
        std::sort(stepped.begin(), stepped.end());
        const Subdomain& slab = slabs_[std::size_t(rank)];
        EXPECT_EQ(stepped, slab.own);
        for (const std::uint32_t ghost : slab.problem.ghosts) EXPECT_EQ(layout.lane[ghost], resident_none);
    }
}

// Each word is written by one lane, of this part or of a neighbour, and polled for the same particle. Exactly
// one poll stores each ghost.
TEST_P(ResidentParts, EveryPollNamesThePointThatSomePartSends) {
    std::vector<std::map<std::uint32_t, std::uint32_t>> writer(ranks);  // particle of the whole, by word
    for (int rank = 0; rank < ranks; ++rank) {
        const ResidentLayout& layout = layouts_[std::size_t(rank)];
        const Subdomain& slab = slabs_[std::size_t(rank)];
        ASSERT_EQ(sent_refusal(sendings_of(rank)), "");
        const std::vector<std::uint32_t> sent = sent_by_lanes(layout, sendings_of(rank));
        ASSERT_EQ(sent.size(), layout.particle.size());
        for (std::size_t at = 0; at < sent.size(); ++at) {
            const auto writes = [&](int part, std::uint32_t word) {
                const std::uint32_t i = slab.particle[layout.particle[at]];
                EXPECT_TRUE(writer[std::size_t(part)].emplace(word, i).second) << "written twice";
            };
            if (layout.published[at] != resident_none) writes(rank, layout.published[at]);
            if (sent[at] == resident_none) continue;
            const int first = slab.borders[0].subdomain;
            writes(sent[at] < second_neighbour ? first : rank + 1, sent[at] % second_neighbour);
        }
    }
    for (std::size_t rank = 0; rank < ranks; ++rank) {
        const ResidentLayout& layout = layouts_[rank];
        EXPECT_EQ(writer[rank].size(), layout.published_count) << "a word that nobody writes";
        std::set<std::uint32_t> polled, kept;
        for (std::size_t n = 0; n < layout.polled.size(); ++n) {
            if (layout.polled[n] == resident_none) continue;
            polled.insert(layout.polled[n]);
            const std::uint32_t i = layout.polled_word[n] & resident_word_bits;
            EXPECT_EQ(writer[rank].at(layout.polled[n]), slabs_[rank].particle[i]);
            if ((layout.polled_word[n] & keeps_ghost) != 0) {
                EXPECT_TRUE(kept.insert(i).second) << "kept twice";
            }
        }
        EXPECT_EQ(polled.size(), layout.published_count) << "written in vain";
        std::set<std::uint32_t> reached;
        for (std::size_t n = 0; n < layout.ghost_word.size(); ++n) {
            if (layout.ghost_word[n] != resident_none) reached.insert(slabs_[rank].problem.ghosts[n]);
        }
        EXPECT_EQ(kept, reached);
    }
}

INSTANTIATE_TEST_SUITE_P(
    Bodies, ResidentParts,
    ::testing::Values(Case{"box_in_rows", {32, 8, 12}, 1, 8, 256, Partition::rows, false},
                      Case{"cut_along_x", {96, 8, 4}, 1, 8, 128, Partition::automatic, false},
                      Case{"box_by_bisection", {7, 13, 10}, 1, 6, 256, Partition::bisection, false},
                      Case{"sparse", {14, 13, 22}, 0.4, 9, 64, Partition::automatic, true}),
    [](const auto& tested) { return std::string(tested.param.name); });

// Rows begin behind the ghosts in front of them.
TEST(ResidentLayout, APartThatIsCutAlongXIsInWholeRows) {
    const Problem whole = make_lattice_problem(solid({96, 8, 8}), FACE_BITS | EDGE_BITS);
    const ResidentLayout layout =
        lay_out_resident(slab_of(whole, 3, 1).problem, card_of(8), 256, Partition::automatic, false);
    EXPECT_EQ(layout.lanes, 8 * 32);
    EXPECT_EQ(std::count(layout.particle.begin(), layout.particle.end(), resident_none), 0);
}

// The card only has to hold the part's own particles.
TEST(ResidentRefusal, DoesNotCountGhosts) {
    const Problem whole = make_lattice_problem(solid({32, 8, 16}), FACE_BITS);
    EXPECT_EQ(resident_refusal(slab_of(whole, 2, 0).problem, 1, true), "");
}

TEST(ResidentRefusal, IsOfPartsThatSendAPointToBothSides) {
    const Problem whole = make_lattice_problem(solid({4, 4, 6}), FACE_BITS);
    const auto refusal = [&](int ranks) {
        const Subdomain slab = slab_of(whole, ranks, 1);
        return sent_refusal({{slab.borders[0].sent, {}}, {slab.borders[1].sent, {}}});
    };
    EXPECT_EQ(slab_of(whole, 6, 1).own.size(), 16U);
    EXPECT_EQ(refusal(6),
              "a particle of this part is needed by both neighbours, but a thread can send it to one only");
    EXPECT_EQ(slab_of(whole, 3, 1).own.size(), 32U);
    EXPECT_EQ(refusal(3), "");
}

// The order of a tick takes room in shared memory from points.
TEST(ResidentLayout, HasRoomForAnOrderInTicks) {
    ResidentLayout layout;
    layout.slots = max_resident_slots;
    EXPECT_EQ(block_refusal(layout, card_of(1)), "");
    EXPECT_EQ(block_refusal(layout, card_of(1), ToolMode::ticks),
              "a block would have 2048 points, and may have at most 2016");
    layout.slots = max_slots_in_ticks;
    EXPECT_EQ(block_refusal(layout, card_of(1), ToolMode::ticks), "");
    // In turns the card limits both together.
    layout.turns = 2;
    const ResidentCard exact{1, layout.shared_bytes(ToolMode::none)};
    EXPECT_EQ(block_refusal(layout, exact), "");
    EXPECT_EQ(block_refusal(layout, exact, ToolMode::ticks),
              "a block would have 48404 bytes of shared memory, and may have at most 48384");
}

TEST(ResidentLayout, SaysWhatIsTooMuch) {
    const Problem problem = make_lattice_problem(solid({32, 8, 8}), FACE_BITS);
    const ResidentCard small = card_of(1, 256);
    const ResidentLayout one = lay_out_resident(problem, small, 256, Partition::automatic, true);
    EXPECT_EQ(block_refusal(one, small),
              "a block would have 2048 places for particles, and may have at most 1024");
    const ResidentLayout few = lay_out_resident(problem, card_of(4), 16, Partition::rows, true);
    EXPECT_NE(block_refusal(few, card_of(4))
                  .find("places for neighbours in other blocks, and may have at most 128"),
              std::string::npos)
        << block_refusal(few, card_of(4));
}

// Blocks wait for each other. If a card did not start all of them at once they would wait for ever.
TEST(ResidentRefusal, IsOfCardsWithoutCooperativeLaunches) {
    const Problem problem = make_lattice_problem(solid({32, 8, 8}), FACE_BITS);
    EXPECT_EQ(resident_refusal(problem, 132, true), "");
    EXPECT_EQ(resident_refusal(problem, 132, false), "the device has no cooperative launches");
}

TEST(ResidentRefusal, IsOfBodiesThatNoLayoutHolds) {
    Problem problem = make_lattice_problem(solid({32, 8, 8}), FACE_BITS);
    EXPECT_EQ(resident_refusal(problem, 1, true), "");
    EXPECT_EQ(resident_refusal(make_lattice_problem(solid({32, 8, 9}), FACE_BITS), 1, true),
              "2304 particles exceed the 2048 that 1 multiprocessor holds");
    EXPECT_EQ(resident_refusal(make_lattice_problem(solid({32, 8, 17}), FACE_BITS), 2, true),
              "4352 particles exceed the 4096 that 2 multiprocessors hold");
    EXPECT_EQ(resident_refusal(Problem{}, 132, true), "the scene has no particle");

    Problem several = problem;
    several.material.assign(several.particle_count(), 0);
    EXPECT_NE(resident_refusal(several, 132, true).find("several materials"), std::string::npos);

    problem.springs.push_back({0, 2000, 1, 1});
    EXPECT_EQ(resident_refusal(problem, 132, true),
              "some springs are not those of the lattice, which needs neighbour lists");
}

}  // namespace
}  // namespace voxspring::cuda
