// What plans of the march cost, predicted (backends/layout/march_cost.h) and measured.
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "backends/layout/march_plan.h"
#include "tests/support.h"

namespace voxspring::layout {
namespace {

using testing::solid;

const MarchDevice h200{.multiprocessors = 132,
                       .threads = 2048,
                       .shared_bytes = 228 << 10U,
                       .reserved_bytes = 1 << 10U,
                       .block_shared_bytes = 227 << 10U,
                       .hertz = 1.98e9,
                       .bytes_per_second = 4.8e12,
                       .cache_bytes = 6e7};

/// A box as the scene `box` has it.
Problem box(int size) {
    Problem problem = make_lattice_problem(solid({size, size, size}), FACE_BITS | EDGE_BITS);
    testing::pin_base(problem);
    return problem;
}

struct Measured {
    int size;
    const char* tile;
    double microseconds;
};
// Medians on an NVIDIA H200, `position` in float32, with the items that are planned here: measured with the
// source of commit 7f1df66 with items from 3 planes on, those of the box of 192^3 in two tiles. The model's
// constants were fitted to these and 24 other times of `position`, `increment` and float64.
const std::vector<Measured> measured = {{48, "64x8", 6.3},     {64, "64x8", 7.9},    {64, "64x16", 7.7},
                                        {96, "32x20", 17.0},   {128, "64x16", 26.0}, {192, "64x16", 79.0},
                                        {192, "128x20", 98.7}, {256, "128x20", 168}};

TEST(MarchCost, PredictsWhatWasMeasured) {
    for (const auto& [size, tile, microseconds] : measured) {
        SCOPED_TRACE(std::to_string(size) + " in " + tile);
        const MarchPlan plan = plan_march(box(size), {march_tile(tile, Precision::float32)},
                                          Precision::float32, Formulation::position, h200);
        RecordProperty("predicted_of_" + std::to_string(size) + "_" + tile,
                       std::to_string(1e6 * plan.seconds));
        // The worst, 64^3 in 64x16, is 11.8% off.
        EXPECT_NEAR(1e6 * plan.seconds, microseconds, 0.12 * microseconds);
    }
}

// The plan takes the tile that was measured to be the fastest. Without max_alike 128^3 would go to 128x16 and
// 192^3 to 64x8, which are predicted to be 2% and 1% faster.
TEST(MarchCost, ChoosesTheTileThatWasMeasuredToBeTheFastest) {
    const std::vector<std::pair<int, const char*>> fastest = {
        {48, "64x8"}, {64, "64x16"}, {96, "32x20"}, {128, "64x16"}, {192, "64x16"}, {256, "128x20"}};
    for (const auto& [size, tile] : fastest) {
        const MarchPlan plan = plan_march(box(size), march_tiles(Precision::float32), Precision::float32,
                                          Formulation::position, h200);
        EXPECT_EQ(plan.tile.name, tile) << size;
    }
}

/// Counts the components along which the springs of visit_springs() have rest offsets.
struct OffsetComponents {
    int count = 0;
    void both(int, int z, int r, int c, int z2, int r2, int c2) {
        count += (z2 != z) + (r2 != r) + (c2 != c);
    }
    void half(int bit, int z, int r, int c, int z2, int r2, int c2) { both(bit, z, r, c, z2, r2, c2); }
};
template <int rows>
int offset_components() {
    OffsetComponents components;
    visit_springs<rows>(components);
    return components.count;
}

// Each component takes an instruction, for which the pipe of float64 takes two cycles.
TEST(MarchCost, RestOffsetsTakeTheCyclesOfTheirInstructions) {
    const auto extra = [](Precision precision, double MarchRates::*of) {
        const MarchTile tile = march_tile("64x8", precision);
        return march_rates(tile, precision, Formulation::displacement).*of -
               march_rates(tile, precision, Formulation::position).*of;
    };
    for (double MarchRates::*const of : {&MarchRates::full, &MarchRates::masked}) {
        EXPECT_EQ(extra(Precision::float32, of), offset_components<2>());
        EXPECT_EQ(extra(Precision::float64, of), 2 * offset_components<1>());
    }
}

// Computed by hand: two multiprocessors with one block each; three items of 10 planes, one of them with 8
// warps' work.
TEST(MarchCost, TheEmptiestMultiprocessorTakesTheNextItem) {
    MarchDevice device = h200;
    device.multiprocessors = 2;
    const MarchTile tile = march_tile("128x20", Precision::float32);
    const MarchCost cost(tile, Precision::float32, Formulation::position, device);
    ASSERT_EQ(cost.slots(), 2);
    const double full = tile.shape.warps() * cost.rates().full;
    const MarchLoad item{10, 10 * full};
    const double one = cost.start_seconds(2) + 10 * cost.plane_seconds(full, 1);
    EXPECT_NEAR(cost.work_seconds({item, item}), one, 1e-9 * one);
    EXPECT_NEAR(cost.work_seconds({item, item, item}), 2 * one, 1e-9 * one);
    // A short item leaves room for the third.
    const MarchLoad brief{1, full};
    const double rest = cost.start_seconds(2) + cost.plane_seconds(full, 1);
    EXPECT_NEAR(cost.work_seconds({item, brief, brief}), one, 1e-9 * one);
    EXPECT_NEAR(cost.work_seconds({item, brief, item}), one + rest, 1e-9 * one);
}

TEST(MarchCost, BlocksThatShareAMultiprocessorTakeTurns) {
    MarchDevice device = h200;
    device.multiprocessors = 1;
    const MarchTile tile = march_tile("64x8", Precision::float32);
    const MarchCost cost(tile, Precision::float32, Formulation::position, device);
    const MarchLoad item{100, 100 * tile.shape.warps() * cost.rates().full};
    const double alone = cost.work_seconds({item});
    double before = alone;
    for (int count = 2; count <= tile.blocks; ++count) {
        const double together = cost.work_seconds(std::vector<MarchLoad>(std::size_t(count), item));
        EXPECT_GT(together, before) << count;
        EXPECT_LT(together, count * alone) << "they hide each other's waits";
        before = together;
    }
    EXPECT_GT(cost.work_seconds(std::vector<MarchLoad>(std::size_t(tile.blocks + 1), item)),
              before + alone / 2);
}

TEST(MarchCost, ASmallCardHasFewerBlocks) {
    MarchDevice small = h200;  // compute capability 12.0
    small.shared_bytes = 100 << 10U;
    small.block_shared_bytes = 99 << 10U;
    small.threads = 1536;
    EXPECT_EQ(resident_blocks(march_tile("64x8", Precision::float32), Precision::float32, h200), 5);
    EXPECT_EQ(resident_blocks(march_tile("64x8", Precision::float32), Precision::float32, small), 2);
    EXPECT_EQ(resident_blocks(march_tile("128x20", Precision::float32), Precision::float32, h200), 1);
    EXPECT_EQ(resident_blocks(march_tile("128x20", Precision::float32), Precision::float32, small), 0);
}

TEST(MarchCost, MemoryBindsWhatNoCacheHolds) {
    const MarchTile tile = march_tile("128x20", Precision::float32);
    const MarchCost cost(tile, Precision::float32, Formulation::position, h200);
    const std::vector<MarchLoad> loads(132, MarchLoad{10, 10 * 20 * cost.rates().full});
    const double cached = cost.step_seconds(loads, 1e9, 1e7), streamed = cost.step_seconds(loads, 1e9, 1e9);
    EXPECT_GT(cached, cost.work_seconds(loads));
    EXPECT_GT(streamed, 1e9 / h200.bytes_per_second);
    EXPECT_GT(streamed, cached);
}

}  // namespace
}  // namespace voxspring::layout
