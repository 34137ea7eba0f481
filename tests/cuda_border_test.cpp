// Borders on CUDA: kernels take them out of one state and put them into another, here on the host. Subdomains
// that exchange borders this way give the bits of the whole.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/bodies.h"
#include "tests/host_kernels.h"
#include "tests/host_subdomains.h"
#include "tests/support.h"

namespace voxspring::testing {
namespace {

using cuda::BorderPlaces;
using cuda::ParticleRecord;

template <class Real>
class Borders : public ::testing::Test {
protected:
    const std::vector<std::uint32_t> some_ = {1, 4, 5};
};
using Precisions = ::testing::Types<float, double>;
TYPED_TEST_SUITE(Borders, Precisions);

TYPED_TEST(Borders, ComeFromWordsAndLeaveTheirBits) {
    using Real = TypeParam;
    std::vector<ParticleRecord<Real>> words(6), low(6);
    for (unsigned i = 0; i < 6; ++i) {
        words[i] = {{Real(10 * i), Real(10 * i + 1), Real(10 * i + 2)}, 100 + i};
        low[i] = {{Real(1000 + i), Real(2000 + i), Real(3000 + i)}, 0};
    }
    const auto at = [&](std::vector<ParticleRecord<Real>>& high, std::vector<ParticleRecord<Real>>* lows) {
        return BorderPlaces<Real>{this->some_.data(),
                                  this->some_.size(),
                                  &high[0].position.x,
                                  lows == nullptr ? nullptr : &(*lows)[0].position.x,
                                  sizeof(ParticleRecord<Real>) / sizeof(Real),
                                  1};
    };
    EXPECT_EQ(gathered(at(words, nullptr)), (std::vector<Real>{10, 40, 50, 11, 41, 51, 12, 42, 52}));
    const std::vector<Real> message = gathered(at(words, &low));
    EXPECT_EQ(message, (std::vector<Real>{10, 40, 50, 11, 41, 51, 12, 42, 52,  //
                                          1001, 1004, 1005, 2001, 2004, 2005, 3001, 3004, 3005}));

    // Another state, in which the message replaces the places of the border.
    std::vector<ParticleRecord<Real>> other(6, {{7, 8, 9}, 55}), other_low(6, {{4, 5, 6}, 0});
    scatter(at(other, &other_low), message);
    for (unsigned i = 0; i < 6; ++i) {
        const bool is_there = i == 1 || i == 4 || i == 5;
        EXPECT_EQ(other[i].position, is_there ? words[i].position : (cuda::Vector<Real>{7, 8, 9})) << i;
        EXPECT_EQ(other_low[i].position, is_there ? low[i].position : (cuda::Vector<Real>{4, 5, 6})) << i;
        EXPECT_EQ(other[i].bits, 55u) << i;
    }
}

TYPED_TEST(Borders, ComeFromStructureOfArrays) {
    using Real = TypeParam;
    constexpr std::size_t axis = 8;
    std::vector<Real> state(3 * axis);
    for (std::size_t i = 0; i < state.size(); ++i) state[i] = Real(i);
    const auto at = [&](std::vector<Real>& values) {
        return BorderPlaces<Real>{this->some_.data(), this->some_.size(), values.data(), nullptr, 1, axis};
    };
    EXPECT_EQ(gathered(at(state)), (std::vector<Real>{1, 4, 5, 9, 12, 13, 17, 20, 21}));
    std::vector<Real> other(3 * axis, Real(-1));
    scatter(at(other), gathered(at(state)));
    for (std::size_t i = 0; i < state.size(); ++i) {
        const std::size_t element = i % axis;
        EXPECT_EQ(other[i], element == 1 || element == 4 || element == 5 ? state[i] : -1) << i;
    }
}

// --- Blocks that go first ---------------------------------------------------------------------------------

TEST(BorderBlocks, AreThoseWithAParticleOfABorder) {
    using Numbers = std::vector<std::uint32_t>;
    const auto parted = cuda::part_blocks(10, 4, {9, 0});
    EXPECT_EQ(parted.blocks, (Numbers{0, 2, 1}));
    EXPECT_EQ(parted.border, 2U);
    EXPECT_EQ(parted.begin_of(cuda::StepPart::interior), 2U);
    EXPECT_EQ(parted.count_of(cuda::StepPart::interior), 1U);
    EXPECT_EQ(cuda::part_blocks(10, 4, {7}).blocks, (Numbers{1, 0, 2}));
    EXPECT_EQ(cuda::part_blocks(10, 4, {}).border, 0U);

    const Lattice row = make_lattice_problem(solid({6, 1, 1}), FACE_BITS).lattice;
    const auto origins = cuda::part_blocks(row, cuda::BlockShape{2, 1, 1}, {3});
    ASSERT_EQ(origins.blocks.size(), 3U);
    EXPECT_EQ(origins.border, 1U);
    EXPECT_EQ(origins.blocks[0].x, 2);
    EXPECT_EQ(origins.blocks[1].x, 0);
    EXPECT_EQ(origins.blocks[2].x, 4);
}

// --- Bits ------------------------------------------------------------------------------------------------

const std::vector<glm::ivec3> bricks = {{2, 1, 2}, {2, 2, 2}, {3, 2, 1}};

template <class V>
class SubdomainsOnKernels : public ::testing::Test {};
using Variants = ::testing::Types<
    cuda::Variant<float, Formulation::increment>, cuda::Variant<float, Formulation::position>,
    cuda::Variant<float, Formulation::displacement>, cuda::Variant<float, Formulation::compensated>,
    cuda::Variant<double, Formulation::position>>;
TYPED_TEST_SUITE(SubdomainsOnKernels, Variants);

TYPED_TEST(SubdomainsOnKernels, GiveTheBitsOfTheWholeByGrid) {
    expect_bits_of_each(bodies_to_cut(), bricks, [](const Problem& problem, const State& start) {
        return std::make_unique<cuda::ImplicitSimulation<TypeParam>>(problem, start,
                                                                     cuda::BlockShape{8, 4, 2});
    });
}

TYPED_TEST(SubdomainsOnKernels, GiveTheBitsOfTheWholeByDeltas) {
    expect_bits_of_each(bodies_to_cut(), bricks, [](const Problem& problem, const State& start) {
        return std::make_unique<cuda::DeltaSimulation<TypeParam>>(problem, start, true);
    });
}

TYPED_TEST(SubdomainsOnKernels, GiveTheBitsOfTheWholeByLists) {
    expect_bits_of_each(bodies_to_cut(), bricks, [](const Problem& problem, const State& start) {
        using Real = typename TypeParam::Real;
        return std::make_unique<cuda::ExplicitSimulation<TypeParam>>(
            problem, start,
            cuda::list_by_springs<Real>(problem, cuda::ListLayout::vertical, TypeParam::formulation));
    });
}

}  // namespace
}  // namespace voxspring::testing
