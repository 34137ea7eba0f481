// Odd bodies, drawn by number, through every function of backends/layout, for cards of many sizes: nothing
// throws, every particle and every spring is there once, and nothing exceeds the sizes that a kernel is
// compiled for.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "backends/layout/blocks.h"
#include "backends/layout/delta_lists.h"
#include "backends/layout/march_plan.h"
#include "backends/layout/neighbour_lists.h"
#include "backends/layout/particles.h"
#include "backends/layout/resident_layout.h"
#include "backends/layout/spring_array.h"
#include "backends/layout/springs.h"
#include "backends/layout/work.h"
#include "tests/support.h"

namespace voxspring::cuda {
namespace {

using testing::make_grid;
using testing::random_grid;
using testing::random_network;
using testing::solid;

struct Card {
    int multiprocessors;
    std::size_t shared_bytes;  ///< of a block
};

struct Body {
    std::string name;
    Problem problem;
};

/// Bodies that have gone wrong, or look as if they might.
Body named_body(std::size_t number, std::uint32_t groups) {
    const auto lattice = [&](const char* name, const VoxelGrid& grid) {
        return Body{name, make_lattice_problem(grid, groups)};
    };
    switch (number) {
        case 0:
            return lattice("29x46x46", solid({29, 46, 46}));
        case 1:
            return lattice("29x42x42", solid({29, 42, 42}));
        case 2:
            return lattice("1x1x97", solid({1, 1, 97}));
        case 3:
            return lattice("97x1x1", solid({97, 1, 1}));
        case 4:
            return lattice("1x97x1", solid({1, 97, 1}));
        case 5:
            return lattice("one voxel", solid({1, 1, 1}));
        case 6:
            return lattice("one voxel of many", make_grid({31, 17, 9}, [](int x, int y, int z) {
                               return x == 30 && y == 16 && z == 8;
                           }));
        case 7:
            return lattice("checkerboard",
                           make_grid({31, 13, 12}, [](int x, int y, int z) { return (x + y + z) % 2; }));
        case 8:
            return lattice("a random 37%", random_grid({31, 33, 29}, 0.37, 1));
        case 9:
            return lattice("two islands",
                           make_grid({70, 9, 9}, [](int x, int, int) { return x < 5 || x > 64; }));
        case 10: {
            Body body = lattice("all pinned", solid({9, 8, 7}));
            pin(body.problem, std::vector<std::uint8_t>(body.problem.particle_count(), 1));
            return body;
        }
        case 11:
            return {"network", random_network(60, 200, 6)};
        case 12:
            return {"no springs", random_network(33, 0, 6)};
        default: {
            Body body = lattice("sutured", random_grid({40, 9, 9}, 0.8, 3));
            const auto last = std::uint32_t(body.problem.particle_count() - 1);
            body.problem.springs = {{0, last, 0.5, 3.0}, {1, last - 1, 0.25, 2.0}, {1, last, 0.125, 0}};
            return body;
        }
    }
}
constexpr std::size_t named_bodies = 14;

/// A box of odd sides, of which a part is active: at random, in planes, or a shell.
Body drawn_body(std::mt19937& generator, std::uint32_t groups) {
    const auto draw = [&](int low, int high) {
        return std::uniform_int_distribution<int>(low, high)(generator);
    };
    glm::ivec3 dims(draw(1, 70), draw(1, 24), draw(1, 24));
    if (draw(0, 3) == 0) std::swap(dims.x, dims[draw(1, 2)]);
    const int kind = draw(0, 3), step = draw(1, 5);
    const double fill = draw(1, 10) / 10.0;
    std::uniform_real_distribution<double> uniform(0, 1);
    VoxelGrid grid = make_grid(dims, [&](int x, int y, int z) {
        if (kind == 0) return uniform(generator) < fill ? 1 : 0;
        if (kind == 1) return (x + y + z) % step == 0 ? 1 : 0;
        if (kind == 2) return x == 0 || y == 0 || z == 0 || x + 1 == dims.x || y + 1 == dims.y ? 1 : 0;
        return 1;
    });
    grid.label[std::size_t(draw(0, int(grid.label.size()) - 1))] = 1;
    Body body{"kind " + std::to_string(kind) + " of " + std::to_string(dims.x) + "x" +
                  std::to_string(dims.y) + "x" + std::to_string(dims.z),
              make_lattice_problem(grid, groups)};
    const auto count = std::uint32_t(body.problem.particle_count());
    if (draw(0, 3) == 0 && count > 2) {
        for (int n = draw(1, 50); n > 0; --n) {
            const auto a = std::uint32_t(draw(0, int(count) - 1)), b = std::uint32_t(draw(0, int(count) - 1));
            if (a != b) body.problem.springs.push_back({std::min(a, b), std::max(a, b), 0.5, 1.5});
        }
    }
    return body;
}

/// Both ends of every spring as (particle, neighbour), found without the layouts' help; sorted.
using Ends = std::vector<std::pair<std::uint32_t, std::uint32_t>>;
Ends ends_of(const Problem& problem) {
    Ends ends;
    const Lattice& lattice = problem.lattice;
    const auto particle = particle_of_voxel(lattice);
    for (std::uint32_t i = 0; i < lattice.mask.size(); ++i) {
        const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
        for (const Direction& direction : directions()) {
            if ((lattice.mask[i] >> direction.bit & 1U) == 0) continue;
            const glm::ivec3 to = at + direction.offset;
            ends.emplace_back(i,
                              particle[(std::size_t(to.z) * std::size_t(lattice.dims.y) + std::size_t(to.y)) *
                                           std::size_t(lattice.dims.x) +
                                       std::size_t(to.x)]);
        }
    }
    for (const Spring& spring : problem.springs) {
        ends.emplace_back(spring.first, spring.second);
        ends.emplace_back(spring.second, spring.first);
    }
    std::sort(ends.begin(), ends.end());
    return ends;
}

void expect_lists(const Problem& problem, const Ends& ends, ListLayout layout) {
    const auto count = std::uint32_t(problem.particle_count());
    const auto compare = [&](const NeighbourLists<float>& lists, auto entries_of) {
        ASSERT_EQ(lists.neighbour.size(), list_size(count, lists.shape.slots, layout));
        Ends listed;
        for (std::uint32_t i = 0; i < count; ++i) {
            std::size_t used = 0;
            for (const std::uint32_t slot : entries_of(lists, i)) {
                listed.emplace_back(i, lists.neighbour.at(lists.shape.at(i, slot)));
                ++used;
            }
            for (std::uint32_t slot = 0; slot < lists.shape.slots; ++slot)
                used += lists.neighbour.at(lists.shape.at(i, slot)) == i ? 1 : 0;
            ASSERT_EQ(used, lists.shape.slots) << "an unused slot holds its own particle";
        }
        std::sort(listed.begin(), listed.end());
        ASSERT_TRUE(listed == ends);
    };
    compare(list_by_springs<float>(problem, layout, Formulation::position),
            [](const auto& lists, std::uint32_t i) {
                std::vector<std::uint32_t> slots(lists.bits[i] & list_count_bits);
                for (std::uint32_t n = 0; n < slots.size(); ++n) slots[n] = n;
                return slots;
            });
    if (!beyond_groups(problem).empty()) return;
    compare(list_by_groups<float>(problem, layout, Formulation::position),
            [](const auto& lists, std::uint32_t i) {
                std::vector<std::uint32_t> slots;
                for (int g = 0; g < 3; ++g) {
                    for (std::uint32_t n = 0; n < GroupCounters::count(lists.bits[i], g); ++n)
                        slots.push_back(lists.first_slot[std::size_t(g)] + n);
                }
                return slots;
            });
}

void expect_every_spring(const Problem& problem, const Ends& ends) {
    const SpringArrays<float> springs = list_every_spring<float>(problem, Formulation::position);
    Ends listed;
    for (const SpringEnds& spring : springs.ends) {
        listed.emplace_back(spring.first, spring.second);
        listed.emplace_back(spring.second, spring.first);
    }
    std::sort(listed.begin(), listed.end());
    ASSERT_TRUE(listed == ends);
    ASSERT_EQ(springs.begin.back() + problem.springs.size(), springs.ends.size());
}

void expect_deltas(const Problem& problem) {
    DeltaLists deltas = compress_lists(problem);
    const auto count = std::int64_t(problem.particle_count());
    ASSERT_EQ(deltas.slices.size(), std::size_t((count + slice_particles - 1) / slice_particles));
    ASSERT_LE(deltas.lists.size(), std::size_t(count));
    const auto particle = particle_of_voxel(problem.lattice);
    for (std::int64_t i = 0; i < count; ++i) {
        const Slice& slice = deltas.slices[std::size_t(i / slice_particles)];
        const std::uint32_t up_to = 0xFFFFFFFFU >> (31 - i % slice_particles);
        const RowDeltas& list =
            deltas.lists.at(std::size_t(slice.list + std::popcount(slice.starts & up_to)));
        for (const Direction& direction : directions()) {
            const glm::ivec3 o = direction.offset;
            const int row = row_number(o.y, o.z);
            std::int64_t to = i + o.x;
            if (row < row_count) {
                to += list.rows[row / 4].row[row % 4];
                if (o.x > 0) to -= list.gaps >> row & 1U;
            }
            // Absent neighbours are read as well.
            ASSERT_TRUE(to >= -2 && to <= count + 1) << to;
            if (problem.lattice.mask.empty() ||
                (problem.lattice.mask[std::size_t(i)] >> direction.bit & 1U) == 0)
                continue;
            const auto voxel =
                std::ptrdiff_t(problem.lattice.voxel[std::size_t(i)]) + problem.lattice.stride(direction);
            ASSERT_EQ(to, std::int64_t(particle[std::size_t(voxel)]));
        }
    }
    const OffLatticeLists<float> own(problem, place_guarded(problem), Formulation::increment, deltas.slices);
    std::size_t stiff = 0;
    for (const auto& constants : own.constants()) stiff += constants.stiffness != 0 ? 1 : 0;
    ASSERT_EQ(stiff, 2 * problem.springs.size());
    ASSERT_LE(own.columns(), 2 * problem.springs.size() * off_lattice_chunk)
        << "the bound that a backend asks memory by";
    for (const Slice& slice : deltas.slices)
        ASSERT_LE(slice.off_lattice_begin + slice.off_lattice_slots, own.columns());
}

void expect_blocks(const Problem& problem, BlockShape shape) {
    const Lattice& lattice = problem.lattice;
    const BlockGrid grid(lattice, shape);
    std::map<std::size_t, int> particles;
    for (const std::uint32_t voxel : lattice.voxel) ++particles[grid.place_of(lattice, voxel)];
    const auto blocks = list_blocks(lattice, shape);
    ASSERT_EQ(blocks.size(), particles.size());
    for (const BlockOrigin& block : blocks) {
        ASSERT_EQ(particles.erase(std::size_t(block.place)), 1U) << "listed twice, or without a particle";
        ASSERT_LT(std::size_t(block.place), grid.places());
        ASSERT_EQ(std::size_t(block.place),
                  grid.place(block.x / shape.x, block.y / shape.y, block.z / shape.z));
    }
    const auto active = occupied_blocks(lattice, shape);
    ASSERT_TRUE(active.empty() || active == blocks);
}

void expect_march(const Problem& problem, const std::vector<MarchTile>& tiles, Precision precision,
                  Formulation formulation, const Card& card) {
    const MarchDevice device{.multiprocessors = card.multiprocessors,
                             .threads = 1536,
                             .shared_bytes = card.shared_bytes + 1024,
                             .reserved_bytes = 1024,
                             .block_shared_bytes = card.shared_bytes,
                             .hertz = 2e9,
                             .bytes_per_second = 1e12,
                             .cache_bytes = 1e5};
    const MarchPlan plan = plan_march(problem, tiles, precision, formulation, device);
    const MarchShape& shape = plan.tile.shape;
    ASSERT_TRUE(std::isfinite(plan.seconds) && plan.seconds > 0) << plan.seconds;
    ASSERT_TRUE(tiles.size() == 1 || resident_blocks(plan.tile, precision, device) > 0);
    std::size_t words = 0;
    std::size_t particles = 0;
    std::set<std::tuple<int, int, int>> planes;
    const Lattice& lattice = problem.lattice;
    std::vector<std::uint32_t> active(lattice.voxel_count());
    for (const std::uint32_t voxel : lattice.voxel) active[voxel] = 1;
    for (const MarchItem& item : plan.items) {
        ASSERT_LT(item.begin, item.end);
        ASSERT_LE(item.end, lattice.dims.z);
        ASSERT_TRUE(item.x % shape.width() == 0 && item.y % shape.height() == 0);
        for (int z = item.begin; z < item.end; ++z) {
            ASSERT_TRUE(planes.emplace(item.x, item.y, z).second) << "a plane twice";
            for (int y = item.y; y < std::min(item.y + shape.height(), lattice.dims.y); ++y) {
                for (int x = item.x; x < std::min(item.x + shape.width(), lattice.dims.x); ++x)
                    particles += active[(std::size_t(z) * std::size_t(lattice.dims.y) + std::size_t(y)) *
                                            std::size_t(lattice.dims.x) +
                                        std::size_t(x)];
            }
        }
        if (item.full_stencils == (std::size_t(1) << shape.warps()) - 1) continue;
        ASSERT_EQ(item.words, words);
        words += std::size_t(item.end - item.begin + 1) * std::size_t(shape.threads());
    }
    ASSERT_EQ(particles, problem.particle_count());
    ASSERT_EQ(words, plan.words.size());
    ASSERT_LE(plan.items.size() * sizeof(MarchItem) + words * sizeof(std::uint64_t),
              max_plan_bytes(lattice, shape));
}

void expect_resident(const Problem& problem, const Card& card, Partition partition, int pollers,
                     bool overlap) {
    if (problem.particle_count() > std::size_t(card.multiprocessors) * max_resident_lanes) return;
    const ResidentLayout layout =
        lay_out_resident(problem, card.multiprocessors, pollers, partition, overlap);
    ASSERT_LE(layout.blocks, card.multiprocessors);
    ASSERT_EQ(layout.lanes % 32, 0);
    std::vector<int> lanes(problem.particle_count());
    for (const std::uint32_t i : layout.particle) {
        if (i != resident_none) ++lanes.at(i);
    }
    ASSERT_EQ(std::count(lanes.begin(), lanes.end(), 1), std::ptrdiff_t(lanes.size()));
    if (!too_much_for_a_block(layout).empty()) {
        // Equal shares of single particles always fit; what they reach in other blocks may be too much.
        ASSERT_TRUE(partition == Partition::rows || layout.lanes <= max_resident_lanes);
        return;
    }
    ASSERT_LE(layout.lanes + layout.pollers, 1024) << "threads of a block";
    ASSERT_LE(2 * 3 * std::size_t(layout.slots) * sizeof(float), std::size_t(48) << 10U)
        << "shared memory of any card";
    const std::vector<std::uint16_t> slots = slots_with(layout, problem.lattice.mask);
    for (const std::uint16_t slot : layout.neighbour_slot) ASSERT_LT(int(slot), layout.slots);
    for (const std::uint16_t slot : layout.own_slot) ASSERT_LT(int(slot), layout.slots);
    // Every spring's other end is in the slot that its direction names.
    const auto particle = particle_of_voxel(problem.lattice);
    for (int block = 0; block < layout.blocks; ++block) {
        std::map<int, std::uint32_t> point;
        const std::size_t first = std::size_t(block) * std::size_t(layout.lanes);
        for (std::size_t at = first; at < first + std::size_t(layout.lanes); ++at) {
            if (layout.particle[at] != resident_none) point[layout.own_slot[at]] = layout.particle[at];
        }
        for (int n = 0; n < layout.rounds; ++n) {
            for (int p = 0; p < pollers; ++p) {
                const std::size_t poll = (std::size_t(n) * std::size_t(layout.blocks) + std::size_t(block)) *
                                             std::size_t(pollers) +
                                         std::size_t(p);
                if (layout.polled[poll] == resident_none) continue;
                ASSERT_LT(layout.polled[poll], layout.published_count);
                point[layout.polled_slot[poll]] = layout.polled_word[poll];
            }
        }
        for (std::size_t at = first; at < first + std::size_t(layout.lanes); ++at) {
            if (layout.particle[at] == resident_none) continue;
            const std::uint32_t i = layout.particle[at];
            for (const Direction& direction : directions()) {
                if ((problem.lattice.mask[i] >> direction.bit & 1U) == 0) continue;
                glm::ivec3 o = direction.offset;
                if ((layout.border[at / 32] & mirrored_y) != 0) o.y = -o.y;
                if ((layout.border[at / 32] & mirrored_z) != 0) o.z = -o.z;
                const int slot = slots[std::size_t(bit_of(o.x, o.y, o.z)) * layout.lane_count() + at];
                const auto voxel =
                    std::ptrdiff_t(problem.lattice.voxel[i]) + problem.lattice.stride(direction);
                ASSERT_EQ(point.at(slot), particle[std::size_t(voxel)]);
            }
        }
    }
}

void expect_states(const Problem& problem, const Placement& placement, Formulation formulation) {
    const State start = testing::random_state(problem, 0.25, 1);
    const auto packed = pack<double>(problem, start, placement, state_bits(problem), formulation);
    const State back = unpack(problem, packed, placement, formulation);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        // A position of up to 100 in float64, and the difference of two.
        for (int axis = 0; axis < 3; ++axis) {
            ASSERT_NEAR(back.displacement[i][axis], start.displacement[i][axis], 1e-13);
            ASSERT_NEAR(back.increment[i][axis], start.increment[i][axis], 1e-13);
        }
    }
}

void expect_all(const Body& body, const Card& card, std::mt19937& generator) {
    SCOPED_TRACE(body.name + " on " + std::to_string(card.multiprocessors) + " multiprocessors, " +
                 std::to_string(card.shared_bytes) + " bytes");
    const auto draw = [&](std::size_t count) {
        return std::uniform_int_distribution<std::size_t>(0, count - 1)(generator);
    };
    const Problem& problem = body.problem;
    const Ends ends = ends_of(problem);
    ASSERT_EQ(ends.size(), 2 * count_springs(problem).total());
    expect_lists(problem, ends, draw(2) == 0 ? ListLayout::vertical : ListLayout::concatenated);
    expect_every_spring(problem, ends);
    expect_deltas(problem);
    const Formulation formulation = all_formulations[draw(all_formulations.size())];
    expect_states(problem, draw(2) == 0 ? place_compact(problem) : place_guarded(problem), formulation);
    ASSERT_GT(explicit_work<float>(problem, true, formulation).bytes, 0U);
    if (problem.lattice.voxel_count() == 0) return;
    expect_states(problem, place_on_grid(problem.lattice), formulation);
    const std::vector<const char*> blocks = {"32x4x2", "32x8x1", "64x4x1", "128x1x1", "16x4x4", "8x8x4"};
    expect_blocks(problem, BlockShape::parse(blocks[draw(blocks.size())]));
    if (!problem.springs.empty()) return;
    if ((problem.group_bits & CORNER_BITS) == 0) {
        for (const Precision precision : {Precision::float32, Precision::float64})
            expect_march(problem, march_tiles(precision), precision, formulation, card);
        const MarchTile& tile = march_tiles(Precision::float32)[draw(march_tiles(Precision::float32).size())];
        expect_march(problem, {tile}, Precision::float32, formulation, card);
    }
    const std::vector<int> pollers = {256, 128, 512};
    expect_resident(problem, card, Partition::automatic, pollers[draw(3)], draw(2) == 0);
    if (problem.particle_count() < 4000) {
        expect_resident(problem, card, Partition::rows, pollers[draw(3)], draw(2) == 0);
        expect_resident(problem, card, Partition::bisection, pollers[draw(3)], draw(2) == 0);
    }
}

const std::vector<std::uint32_t> groups = {FACE_BITS | EDGE_BITS, FACE_BITS, NEIGHBOUR_BITS, EDGE_BITS};

Card draw_card(std::mt19937& generator) {
    const std::vector<std::size_t> kibibytes = {48, 64, 99, 100, 163, 227};
    const int multiprocessors = std::uniform_int_distribution<int>(20, 200)(generator);
    return {multiprocessors, kibibytes[std::uniform_int_distribution<std::size_t>(0, 5)(generator)] << 10U};
}

TEST(LayoutProperties, HoldForBodiesThatHaveGoneWrong) {
    std::mt19937 generator(1);
    for (std::size_t number = 0; number < named_bodies; ++number) {
        const Body body = named_body(number, groups[0]);
        const bool large = body.problem.particle_count() > 20000;
        for (const int multiprocessors : {20, 108, 132, 200}) {
            if (large && multiprocessors != 108 && multiprocessors != 132) continue;
            expect_all(body, {multiprocessors, std::size_t(99) << 10U}, generator);
        }
    }
}

TEST(LayoutProperties, HoldForDrawnBodies) {
    for (unsigned number = 0; number < 300; ++number) {
        SCOPED_TRACE("body " + std::to_string(number));
        std::mt19937 generator(number);
        const Body body = drawn_body(generator, groups[number % groups.size()]);
        expect_all(body, draw_card(generator), generator);
        if (::testing::Test::HasFailure()) return;
    }
}

}  // namespace
}  // namespace voxspring::cuda
