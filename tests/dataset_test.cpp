// The datasets have exactly the expected numbers of particles and springs.
#include "harness/volume/dataset.h"

#include <gtest/gtest.h>

#include "backends/physics/neighbours.h"
#include "harness/base/memory.h"
#include "tests/volume_files.h"

namespace voxspring::testing {
namespace {

struct Counts {
    glm::ivec3 dims;
    std::size_t voxels;
    std::size_t particles;
    std::array<std::uint64_t, 3> springs;
};

void expect_counts(const VoxelGrid& grid, const Counts& expected) {
    const Problem problem = make_lattice_problem(grid, NEIGHBOUR_BITS);
    EXPECT_EQ(problem.lattice.voxel_count(), expected.voxels);
    EXPECT_EQ(grid.label.size(), expected.voxels);
    EXPECT_EQ(problem.particle_count(), expected.particles);
    EXPECT_EQ(count_springs(problem).group, expected.springs);
}

TEST(Dataset, BoxOfDifferentSides) {
    // Counts the springs of a W x H x D box by one direction of the stencil at a time.
    expect_counts(
        make_box({3, 2, 5}),
        {{}, 30, 30, {2 * 10 + 3 * 5 + 6 * 4, 2 * (2 * 1 * 5 + 2 * 2 * 4 + 3 * 1 * 4), 4 * 2 * 1 * 4}});
}

class Heart : public ::testing::TestWithParam<Counts> {};

TEST_P(Heart, HasItsCounts) { expect_counts(make_heart(GetParam().dims), GetParam()); }

INSTANTIATE_TEST_SUITE_P(
    Dataset, Heart,
    ::testing::Values(Counts{{60, 51, 46}, 140760, 29449, {77101, 143406, 90356}},
                      Counts{{120, 102, 92}, 1126080, 236609, {664619, 1284842, 834663}},
                      Counts{{148, 126, 113}, 2107224, 440695, {1252978, 2437827, 1591574}},
                      Counts{{240, 204, 184}, 9008640, 1887153, {5479345, 10778407, 7096254}},
                      Counts{{296, 251, 227}, 16865192, 3532872, {10322276, 20371435, 13445616}}),
    [](const auto& tested) { return "x" + std::to_string(tested.param.dims.x); });

TEST(Dataset, NoVoxelOfTheHeartTouchesTheBorder) {
    const glm::ivec3 dims{60, 51, 46};
    const VoxelGrid grid = make_heart(dims);
    Lattice lattice;
    lattice.dims = dims;
    for (std::uint32_t voxel = 0; voxel < grid.label.size(); ++voxel) {
        if (grid.label[voxel] == 0) continue;
        const glm::ivec3 at = lattice.coordinates(voxel);
        for (int axis = 0; axis < 3; ++axis) {
            EXPECT_GT(at[axis], 0);
            EXPECT_LT(at[axis], dims[axis] - 1);
        }
    }
}

TEST(Dataset, DimsAreCheckedWithoutOverflow) {
    const SceneSizeLimits thousand{1000, 0};
    EXPECT_EQ(checked_voxel_count({10, 10, 10}, thousand, "f", "k"), 1000u);
    EXPECT_EQ(refusal([&] {
                  checked_voxel_count({10, 10, 11}, thousand, "f", "k");
              }),
              "f: k: 10 x 10 x 11 is not accepted; expected at most 1000 voxels on this machine, not 1100");
    // With enough memory, the width of an index is the limit.
    EXPECT_EQ(
        refusal([&] {
            checked_voxel_count({65536, 65536, 1}, {0xFFFFFFFF, 0}, "f", "k");
        }),
        "f: k: 65536 x 65536 x 1 is not accepted; expected at most 4294967295 voxels, whose indices have "
        "32 bits, not 4294967296");
    // 2^60 voxels; in 32 bits the product would be 0.
    const SceneSizeLimits limits = SceneSizeLimits::of_this_machine();
    for (const glm::ivec3 dims : {glm::ivec3(1 << 20), {5, 0, 5}, {5, 5, -5}})
        EXPECT_EQ(refused([&] { checked_voxel_count(dims, limits, "f", "k"); }),
                  "k: " + to_string(GridSides(dims)));
    EXPECT_LE(limits.voxels, 0xFFFFFFFFu);
    EXPECT_GT(limits.particles, 1000000u);
}

// A container may use less than the machine has.
TEST(Memory, ControlGroupsLimitIt) {
    const TemporaryFolder folder;
    const auto write = [&](const std::string& file, const std::string& text) {
        std::filesystem::create_directories((folder.path() / file).parent_path());
        return folder.write(file, text);
    };
    const std::filesystem::path root = folder.path() / "fs";
    // Version 2: the minimum over the group and the groups above it.
    const std::string second = write("second", "0::/a/b\n");
    EXPECT_EQ(cgroup_memory_limit(second, root), no_memory_limit);
    write("fs/a/b/memory.max", "max\n");
    EXPECT_EQ(cgroup_memory_limit(second, root), no_memory_limit);
    write("fs/a/memory.max", "1073741824\n");
    EXPECT_EQ(cgroup_memory_limit(second, root), 1073741824u);
    write("fs/a/b/memory.max", "2147483648\n");
    EXPECT_EQ(cgroup_memory_limit(second, root), 1073741824u);
    // A container sees this as the root.
    write("fs/memory.max", "1000\n");
    EXPECT_EQ(cgroup_memory_limit(second, root), 1000u);

    // Version 1: each controller has a hierarchy, beside others and an empty version 2.
    const std::string first = write("first", "3:cpu,cpuacct:/c\n2:blkio,memory:/c/d\n0::/\n");
    const std::filesystem::path old = folder.path() / "old";
    write("old/memory/c/d/memory.limit_in_bytes", "9223372036854771712\n");
    EXPECT_EQ(cgroup_memory_limit(first, old), 9223372036854771712u);
    write("old/memory/c/memory.limit_in_bytes", "4096\n");
    EXPECT_EQ(cgroup_memory_limit(first, old), 4096u);

    EXPECT_EQ(cgroup_memory_limit(folder.path() / "absent", root), no_memory_limit);
    EXPECT_LE(memory_limit(), cgroup_memory_limit());
    EXPECT_GT(memory_limit(), 0u);
}

}  // namespace
}  // namespace voxspring::testing
