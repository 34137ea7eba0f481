// Lists of active tiles (backends/layout/tile_lists.h) without a device: their tables, and the body of their
// kernel (cuda/kernels/tiles.h), every thread of every block, which runs on the host.
#include "backends/layout/tile_lists.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "backends/layout/decomposition.h"
#include "backends/layout/march_layout.h"
#include "backends/physics/inverse_root.h"
#include "cuda/kernels/tiles.h"
#include "tests/bodies.h"
#include "tests/support.h"

namespace voxspring::cuda {
namespace {

using testing::expect_same_bits;
using testing::lattice;
using testing::make_grid;
using testing::random_grid;
using testing::random_state;
using testing::solid;

constexpr std::uint32_t block_tiles = 64;

template <Formulation f, class R, int n>
struct Variant {
    static constexpr Formulation formulation = f;
    using Real = R;
    static constexpr int threads = n;  ///< per tile
};

/// A backend's state and steps, on the host.
template <class V>
class Simulation {
public:
    using Real = typename V::Real;

    Simulation(const Problem& problem, const State& start)
        : problem_(problem),
          lists_(problem, ActiveTiles(problem), block_tiles),
          state_(pack_soa<Real>(problem, start, V::formulation, places())) {
        static_cast<MarchStep<Real>&>(step_) = make_march_step<Real>(problem, V::formulation);
        if (!by_increments(V::formulation)) {
            for (Real& length : step_.rest_length) length = inverse_root(length);
        }
        // What is no particle may hold anything.
        std::set<std::size_t> elements;
        for (std::size_t i = 0; i < problem.particle_count(); ++i) elements.insert(places().element(i));
        const Real nan = std::numeric_limits<Real>::quiet_NaN();
        for (std::size_t at = 0; at < lists_.elements(); ++at) {
            if (at / tile_axis % 3 != 0 || elements.count(at) != 0) continue;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                state_.current[at + axis * tile_axis] = state_.before[at + axis * tile_axis] = nan;
            }
        }
    }
    Simulation(const Simulation&) = delete;

    std::vector<EditedWord> edit(const SpringEdit& edit) { return lists_.edit(edit); }
    const TileLists& layout() const { return lists_; }
    State download() const { return unpack_soa<Real>(problem_, state_, V::formulation, places()); }

    void step(int count) {
        for (int n = 0; n < count; ++n) {
            if (problem_.group_bits == FACE_BITS) {
                launch<FACE_BITS, false>();
            } else if (problem_.group_bits == EDGE_BITS) {
                launch<EDGE_BITS, false>();
            } else if (equal_edges(problem_, V::formulation)) {
                launch<FACE_BITS | EDGE_BITS, true>();
            } else {
                launch<FACE_BITS | EDGE_BITS, false>();
            }
        }
    }

private:
    SoaPlaces places() const {
        return {lists_.elements(), tile_axis, [this](std::size_t i) {
                    return lists_.element(problem_.lattice.coordinates(problem_.lattice.voxel[i]));
                }};
    }
    template <std::uint32_t groups, bool equal>
    void launch() {
        using Terms = KernelTerms<V::formulation, groups, term_damping | term_gravity, false>;
        step_.rows = lists_.rows().data();
        step_.masks = lists_.masks().data();
        std::vector<Real> next = by_increments(V::formulation) ? state_.current : state_.before;
        const MarchOutput<Real> output{next.data(), state_.before.data()};
        const std::uint32_t tiles = lists_.blocks() * block_tiles;
        for (std::uint32_t tile = group_tiles; tile < group_tiles + tiles; ++tile) {
            for (unsigned thread = 0; thread < unsigned(V::threads); ++thread)
                step_tile<Terms, equal, V::threads>(step_, TileRows(step_.rows, tile), state_.current.data(),
                                                    output, tile, thread);
        }
        if (!by_increments(V::formulation)) state_.before = state_.current;
        state_.current = next;
    }

    const Problem& problem_;
    TileLists lists_;
    SoaState<Real> state_;
    TileStep<Real> step_{};
};

std::map<std::string, Problem> lattices() {
    std::map<std::string, Problem> problems = testing::bodies_by_class();
    problems["edges"] = lattice(solid({9, 8, 7}), EDGE_BITS);
    problems["several_groups"] = lattice(random_grid({41, 17, 19}, 0.5, 4));
    problems["apart"] = lattice(make_grid({28, 8, 9}, [](int x, int, int) { return x < 5 || x > 20; }));
    return problems;
}

template <class V>
class TileBody : public ::testing::Test {};
using Variants =
    ::testing::Types<Variant<Formulation::position, float, 1>, Variant<Formulation::increment, float, 2>,
                     Variant<Formulation::displacement, double, 2>,
                     Variant<Formulation::increment, double, 1>>;
TYPED_TEST_SUITE(TileBody, Variants);

// Beside particles there is nothing but NaN, so a spring to what is no particle, a wrong row or a wrong bit
// shows at once.
TYPED_TEST(TileBody, AgreesWithTheReferenceAndStaysAtRest) {
    constexpr Precision precision =
        sizeof(typename TypeParam::Real) == sizeof(float) ? Precision::float32 : Precision::float64;
    testing::expect_agreement<Simulation<TypeParam>>(lattices(), precision, TypeParam::formulation);
}

TYPED_TEST(TileBody, AnEditLeavesTheMasksAndTheStepsOfTheEditedProblem) {
    std::size_t changed = 0;
    for (const double fill : {1.0, 0.95, 0.63}) {
        SCOPED_TRACE(fill);
        Problem problem = lattice(random_grid({12, 10, 11}, fill, 3));
        Simulation<TypeParam> simulation(problem, random_state(problem, 0.05, 7));
        simulation.step(2);
        changed += testing::expect_edits(
            simulation, problem,
            [](auto& masks, std::uint32_t n) -> auto& { return masks.at(n / 4).word[n % 4]; },
            [](const TileLists& lists, const TileLists& expected) {
                EXPECT_EQ(lists.rows(), expected.rows());
            });
    }
    EXPECT_GT(changed, 50U);
}

// Wherever a body is cut, its parts have the bits of the whole: sums have the same order in both.
TYPED_TEST(TileBody, PartsHaveTheBitsOfTheWhole) {
    std::map<std::string, Problem> problems = lattices();
    for (const char* const name : {"sparse", "dense", "prime_box", "anisotropic"}) {
        const Problem& problem = problems.at(name);
        for (const glm::ivec3 cut :
             {glm::ivec3(2, 1, 1), glm::ivec3(1, 3, 1), glm::ivec3(1, 1, 3), glm::ivec3(2, 2, 2)}) {
            if (!Decomposition::refusal(problem, cut).empty()) continue;
            SCOPED_TRACE(std::string(name) + " cut into " + std::to_string(cut.x) + "x" +
                         std::to_string(cut.y) + "x" + std::to_string(cut.z));
            const State start = random_state(problem, 0.05, 7);
            Simulation<TypeParam> whole(problem, start);
            whole.step(1);
            State joined = state_at_rest(problem);
            const Decomposition parts(problem, cut);
            for (int n = 0; n < parts.count(); ++n) {
                const Subdomain part = parts.subdomain(problem, n);
                Simulation<TypeParam> simulation(part.problem, part.part_of(start));
                simulation.step(1);
                part.copy_own(simulation.download(), joined);
            }
            expect_same_bits(joined, whole.download());
        }
    }
}

// As measured on 132 multiprocessors with 512 threads each, where two threads take 4.9 us instead of 6.7 per
// step of the heart, and 12.4 instead of 11.2 of the box.
TEST(TileThreads, AreTwoWhereTilesDoNotFillTheCard) {
    constexpr std::size_t resident = std::size_t(132) * 512;
    EXPECT_EQ(threads_per_tile(ActiveTiles(lattice(solid({96, 96, 96}))).count, resident), 1U);
    EXPECT_EQ(threads_per_tile(ActiveTiles(lattice(solid({64, 64, 64}))).count, resident), 2U);
    EXPECT_EQ(threads_per_tile(35000, resident), 2U);
    EXPECT_EQ(threads_per_tile(35000, resident / 4), 1U) << "a smaller card is full";
}

template <class A, class B>
void expect_same_bits_by(const Problem& problem) {
    const State start = random_state(problem, 0.05, 7);
    testing::expect_same_steps(Simulation<A>(problem, start), Simulation<B>(problem, start), {3});
}

// However many threads share a tile: the planner may choose by the body's size, and parts of a body differ in
// size from the whole.
TEST(TileThreads, DoNotChangeBits) {
    for (const auto& [name, problem] : lattices()) {
        SCOPED_TRACE(name);
        expect_same_bits_by<Variant<Formulation::position, float, 1>,
                            Variant<Formulation::position, float, 2>>(problem);
        expect_same_bits_by<Variant<Formulation::increment, float, 1>,
                            Variant<Formulation::increment, float, 2>>(problem);
    }
}

// A thread reads no tile beyond the list, whether a row holds a neighbour or not, and no two particles share
// an element.
TEST(TileLists, LiesWithinItsArrays) {
    for (const auto& [name, problem] : lattices()) {
        SCOPED_TRACE(name);
        const TileLists lists(problem, ActiveTiles(problem), block_tiles);
        const auto listed = std::uint32_t(lists.masks().size());
        EXPECT_EQ(listed, lists.blocks() * block_tiles + 2 * group_tiles);
        for (const TileRow& row : lists.rows()) {
            for (const int dx : {-1, 0, 1}) EXPECT_LT(row.at(dx), listed);
        }
        std::set<std::size_t> elements;
        for (const std::uint32_t voxel : problem.lattice.voxel) {
            const std::size_t element = lists.element(problem.lattice.coordinates(voxel));
            EXPECT_LT(element + 2 * tile_axis, lists.elements());
            EXPECT_TRUE(elements.insert(element).second);
        }
        EXPECT_EQ(lists.elements(), tile_elements(ActiveTiles(problem), block_tiles));
        EXPECT_EQ(
            tile_bytes<float>(problem, block_tiles, 2),
            listed * (sizeof(TileMask) + tile_rows * sizeof(TileRow)) + 2 * lists.elements() * sizeof(float));
    }
}

// A tile that has all springs takes 36 evaluations for its 24 face springs and 84 for its 48 edge springs:
// fewer than one by one, where springs within a tile count for both ends.
TEST(TileLists, CountsWorkBySprings) {
    const Problem faces = lattice(solid({64, 64, 64}), FACE_BITS), both = lattice(solid({64, 64, 64}));
    const StepWork few = tile_work<float>(faces, Formulation::position),
                   many = tile_work<float>(both, Formulation::position);
    EXPECT_EQ(few.bytes, many.bytes);
    EXPECT_EQ(few.bytes, 36ULL * faces.particle_count() + 48ULL * faces.particle_count() / 8);
    EXPECT_GT(many.operations, 3 * few.operations / 2);
}

}  // namespace
}  // namespace voxspring::cuda
