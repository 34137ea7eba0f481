// Bricks on the chip (cuda/kernels/brick.h) without a device: their plan, their tables, and their kernel
// body. The body runs on the host, every thread of every block, and blocks send each other points as on a
// device.
#include "cuda/kernels/brick.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "backends/layout/brick_layout.h"
#include "backends/layout/march_layout.h"
#include "backends/physics/edit.h"
#include "backends/physics/inverse_root.h"
#include "tests/bodies.h"
#include "tests/support.h"

namespace voxspring::cuda {
namespace {

using testing::expect_same_bits;
using testing::lattice;
using testing::make_grid;
using testing::pinned;
using testing::random_grid;
using testing::random_state;
using testing::solid;

const MarchDevice server = testing::march_device_of(132);

std::map<std::string, Problem> lattices() {
    std::map<std::string, Problem> problems = testing::bodies_by_class();
    problems["apart"] = lattice(make_grid({28, 8, 9}, [](int x, int, int) { return x < 5 || x > 20; }));
    return problems;
}

template <Formulation f, int tx, int ty, int tz, int wx, int wy, int wz, bool both, int row_pad = 0,
          int plane_pad = 0, bool in_memory = false>
struct Variant {
    static constexpr Formulation formulation = f;
    static constexpr bool increments_in_memory = in_memory;
    static constexpr BrickShape shape{tx, ty, tz, wx, wy, wz, both, row_pad, plane_pad};
};

/// A backend's state and steps, on the host.
template <class V>
class Simulation {
public:
    static constexpr BrickShape shape = V::shape;
    static constexpr int pollers = 32;
    static constexpr bool pollers_send = shape.tile() == 8;  ///< as in plans

    /// `bodies`, less those that these bricks cannot hold.
    static std::map<std::string, Problem> that_fit(std::map<std::string, Problem> bodies) {
        std::erase_if(bodies, [](const auto& body) { return !fits(body.second); });
        return bodies;
    }
    static bool fits(const Problem& problem) {
        int low = problem.lattice.dims.x, high = 0;
        for (const std::uint32_t voxel : problem.lattice.voxel) {
            low = std::min(low, problem.lattice.coordinates(voxel).x);
            high = std::max(high, problem.lattice.coordinates(voxel).x);
        }
        return shape.both || high - low < 2 * shape.nx();
    }

    /// `by_side`: plain blocks have the masks of plain blocks, as on a device; otherwise those of any block.
    Simulation(const Problem& problem, const State& start, bool by_side = true)
        : problem_(problem),
          by_side_(by_side),
          state_(
              pack_soa<float>(problem, start, V::formulation, march_places(problem.lattice, sizeof(float)))),
          layout_(problem, {.shape = shape, .pollers = pollers, .pollers_send = pollers_send}) {
        static_cast<MarchStep<float>&>(step_) = make_march_step<float>(problem, V::formulation);
        if (!by_increments(V::formulation)) {
            for (float& length : step_.rest_length) length = inverse_root(length);
        }
        step_.lane_count = layout_.lane_count();
    }
    Simulation(const Simulation&) = delete;

    std::vector<EditedWord> edit(const SpringEdit& edit) { return layout_.edit(edit); }
    const BrickLayout& layout() const { return layout_; }
    /// The number of plain blocks, summed over all launches.
    std::size_t plain_blocks() const { return plain_blocks_; }
    std::size_t launches() const { return launches_; }
    State download() const {
        return unpack_soa<float>(problem_, state_, V::formulation,
                                 march_places(problem_.lattice, sizeof(float)));
    }

    /// A launch of `count` steps.
    void step(int count) {
        if (problem_.group_bits == FACE_BITS) return launch<FACE_BITS, false>(count);
        if (equal_edges(problem_, V::formulation)) return launch<FACE_BITS | EDGE_BITS, true>(count);
        launch<FACE_BITS | EDGE_BITS, false>(count);
    }

private:
    /// Reads masks as a thread does, and checks that each requested bit lies within its words.
    template <class Tile>
    struct Words {
        static constexpr bool by_side = false;
        const BrickLayout* layout;
        std::size_t lane;
        std::uint32_t word(int number) const {
            return layout->masks().at(std::size_t(number) * layout->lane_count() + lane);
        }
        bool has(int bit) const { return (word(bit / 32) >> bit % 32 & 1U) != 0; }
        bool spring(int bit, std::uint32_t /*crossed*/) const { return has(bit); }
        bool moves(int n) const { return has(Tile::moves_bit + n); }
        bool exists(int n) const { return has(Tile::exists_bit + n); }
        TileSides sides() const { return {word(Tile::mask_words)}; }
    };

    template <std::uint32_t groups, bool equal>
    void launch(int count) {
        using Terms = KernelTerms<V::formulation, groups, term_damping | term_gravity, false>;
        using Tile = BrickTile<Terms, shape, equal, V::increments_in_memory>;
        const std::size_t blocks = layout_.blocks().size();
        const float nan = std::numeric_limits<float>::quiet_NaN();
        std::vector<float> increments(blocks * std::size_t(Tile::increment_words), nan);
        std::vector<std::vector<float>> points(blocks,
                                               std::vector<float>(std::size_t(shape.shared_words()), nan));
        std::vector<std::vector<Tile>> tiles(blocks);
        std::map<std::pair<std::size_t, int>, Vector<float>> sent;  // by element and number of steps taken
        const auto words = [&](std::size_t b, int lane) {
            return Words<Tile>{&layout_, b * std::size_t(shape.lanes()) + std::size_t(lane)};
        };
        std::vector<char> plain(blocks, by_side_ ? 1 : 0);
        ++launches_;
        for (std::size_t b = 0; b < blocks; ++b) {
            for (int lane = 0; lane < shape.threads(); ++lane) {
                if (!words(b, lane).sides().is_plain()) plain[b] = 0;
            }
            plain_blocks_ += std::size_t(plain[b]);
        }
        const auto with_words = [&](std::size_t b, int lane, auto visit) {
            if (plain[b] != 0) {
                visit(FullTileMasks(words(b, lane).sides(), words(b, lane), Tile::particles));
            } else {
                visit(words(b, lane));
            }
        };
        const auto axes = [&](const std::vector<float>& from, std::size_t element) {
            return Vector<float>{from.at(element), from.at(element + step_.axis),
                                 from.at(element + 2 * step_.axis)};
        };
        const auto for_points = [&](const BrickLayout::Points& of, std::size_t b, auto visit) {
            const std::size_t of_block = std::size_t(of.rounds) * std::size_t(pollers);
            for (std::size_t n = 0; n < of_block; ++n) {
                const BrickPoint& point = of.points.at(b * of_block + n);
                if (point.element != resident_none) visit(point);
            }
        };
        // What pollers or threads with tiles send from a half of the points after `n` steps.
        const auto send_by_pollers = [&](std::size_t b, int half, int n) {
            for_points(layout_.sent(), b, [&](const BrickPoint& point) {
                sent[{point.element, n}] = Tile::load(points[b].data() + half, int(point.slot));
            });
        };
        const auto send = [&](const Tile& tile, std::uint32_t border, int m, int i, int j, int k, int n,
                              Vector<float> point) {
            if ((border >> m & 1U) == 0) return;
            const std::size_t first = tile.element(step_, 0, 0, 0);
            sent[{first + std::size_t(tile.from_first(step_, i, j, k)), n}] = point;
        };
        for (std::size_t b = 0; b < blocks; ++b) {
            for (int lane = 0; lane < shape.threads(); ++lane) {
                Tile& tile = tiles[b].emplace_back(
                    step_, layout_.blocks()[b], lane,
                    increments.data() + b * std::size_t(Tile::increment_words) + std::size_t(lane));
                Tile::visit_particles([&](int n, int i, int j, int k) {
                    if constexpr (Terms::increments) tile.set_increment(n, {0, 0, 0});
                    if (!words(b, lane).exists(n)) return;
                    const std::size_t element = tile.element(step_, i, j, k);
                    Tile::store(points[b].data(), tile.slot(i, j, k), axes(state_.current, element));
                    if constexpr (Terms::increments) {
                        tile.set_increment(n, axes(state_.before, element));
                    } else {
                        Tile::store(points[b].data() + shape.half(), tile.slot(i, j, k),
                                    axes(state_.before, element));
                    }
                });
                tile.start(points[b].data());
            }
            send_by_pollers(b, 0, 0);
            for_points(layout_.received(), b, [&](const BrickPoint& point) {
                Tile::store(points[b].data(), int(point.slot), {nan, nan, nan});
                Tile::store(points[b].data() + shape.half(), int(point.slot), {nan, nan, nan});
            });
        }
        int now = 0, next = shape.half();
        for (int n = 1; n <= count; ++n) {
            for (std::size_t b = 0; b < blocks; ++b) {
                for (int lane = 0; lane < shape.threads(); ++lane) {
                    with_words(b, lane, [&](const auto& masks) {
                        tiles[b][std::size_t(lane)].add_early(step_, points[b].data() + now, masks);
                    });
                }
            }
            for (std::size_t b = 0; b < blocks; ++b) {
                // `sent.at()` throws if no block has sent the point.
                for_points(layout_.received(), b, [&](const BrickPoint& point) {
                    Tile::store(points[b].data() + now, int(point.slot), sent.at({point.element, n - 1}));
                });
            }
            for (std::size_t b = 0; b < blocks; ++b) {
                for (int lane = 0; lane < shape.threads(); ++lane) {
                    Tile& tile = tiles[b][std::size_t(lane)];
                    const std::uint32_t border =
                        pollers_send ? 0 : tile.border(layout_.blocks()[b], words(b, lane));
                    with_words(b, lane, [&](const auto& masks) {
                        tile.add_late(step_, points[b].data() + now, masks);
                        tile.integrate(step_, points[b].data() + next, masks,
                                       [&](int m, int i, int j, int k, Vector<float> point) {
                                           send(tile, border, m, i, j, k, n, point);
                                       });
                    });
                }
                if (pollers_send) send_by_pollers(b, next, n);
                for_points(layout_.received(), b, [&](const BrickPoint& point) {
                    Tile::store(points[b].data() + now, int(point.slot), {nan, nan, nan});
                });
            }
            std::swap(now, next);
        }
        write_state<Tile>(points, tiles, now, next);
    }
    /// Writes the state as the kernel does: each warp by rows.
    template <class Tile>
    void write_state(std::vector<std::vector<float>>& points, const std::vector<std::vector<Tile>>& tiles,
                     int now, int next) {
        std::set<std::size_t> written;
        for (std::size_t b = 0; b < points.size(); ++b) {
            const auto words = [&](int lane) {
                return Words<Tile>{&layout_, b * std::size_t(shape.lanes()) + std::size_t(lane)};
            };
            if constexpr (by_increments(V::formulation)) {
                for (int lane = 0; lane < shape.threads(); ++lane) {
                    const Tile& tile = tiles[b][std::size_t(lane)];
                    Tile::visit_particles([&](int m, int i, int j, int k) {
                        if (words(lane).exists(m))
                            Tile::store(points[b].data() + next, tile.slot(i, j, k), tile.increment(m));
                    });
                }
            }
            for (int lane = 0; lane < shape.lanes(); ++lane) {
                const WarpRows<shape> rows(step_, layout_.blocks()[b], lane);
                rows.visit([&](int m, int slot, std::size_t element) {
                    const int n = m % shape.tx;
                    if (!words(lane / 32 * 32 + rows.lane[n]).exists(m - n + rows.i[n])) return;
                    EXPECT_TRUE(written.insert(element).second) << "element " << element;
                    const auto write = [&](std::vector<float>& to, Vector<float> v) {
                        to.at(element) = v.x;
                        to.at(element + step_.axis) = v.y;
                        to.at(element + 2 * step_.axis) = v.z;
                    };
                    write(state_.current, Tile::load(points[b].data() + now, slot));
                    write(state_.before, Tile::load(points[b].data() + next, slot));
                });
            }
        }
        EXPECT_EQ(written.size(), problem_.particle_count());
    }

    const Problem& problem_;
    const bool by_side_;
    std::size_t plain_blocks_ = 0, launches_ = 0;
    SoaState<float> state_;
    BrickLayout layout_;
    BrickStep step_{};
};

template <class V>
class BrickBody : public ::testing::Test {};
using Variants = ::testing::Types<Variant<Formulation::position, 2, 2, 2, 8, 2, 2, false>,
                                  Variant<Formulation::position, 3, 1, 1, 4, 6, 6, true, 3, 5>,
                                  Variant<Formulation::increment, 2, 2, 2, 8, 4, 2, true>,
                                  Variant<Formulation::increment, 3, 2, 3, 4, 2, 4, true, 0, 0, true>,
                                  Variant<Formulation::displacement, 3, 2, 3, 4, 2, 4, true>>;
TYPED_TEST_SUITE(BrickBody, Variants);

TYPED_TEST(BrickBody, AgreesWithTheReferenceAndStaysAtRest) {
    testing::expect_agreement<Simulation<TypeParam>>(Simulation<TypeParam>::that_fit(lattices()),
                                                     Precision::float32, TypeParam::formulation);
}

// One launch and several launches give the same bits.
TYPED_TEST(BrickBody, LaunchesChangeNoBit) {
    for (const auto& [name, problem] : Simulation<TypeParam>::that_fit(lattices())) {
        SCOPED_TRACE(name);
        const State start = random_state(problem, 0.05, 7);
        Simulation<TypeParam> one(problem, start), several(problem, start);
        one.step(5);
        for (const int count : {2, 1, 2}) several.step(count);
        expect_same_bits(one.download(), several.download());
    }
}

// Testing sides rather than bits skips instructions and changes no bit of the result. Beyond the end of a
// body this test has NaN, while a device has zeros.
TYPED_TEST(BrickBody, PlainBlocksStepAsMasksSay) {
    const BrickShape shape = TypeParam::shape;
    std::map<std::string, Problem> problems = lattices();
    problems["whole_bricks"] = pinned(lattice(solid({2 * shape.nx(), 2 * shape.ny(), 2 * shape.nz()})));
    problems["one_brick"] = lattice(solid({shape.nx(), shape.ny(), shape.nz()}));
    problems["faces_of_bricks"] = lattice(solid({2 * shape.nx(), shape.ny(), 2 * shape.nz()}), FACE_BITS);
    problems["hole"] = lattice(make_grid({2 * shape.nx(), 2 * shape.ny(), 2 * shape.nz()},
                                         [](int x, int y, int z) { return x != 3 || y != 2 || z != 1; }));
    for (const auto& [name, problem] : Simulation<TypeParam>::that_fit(problems)) {
        SCOPED_TRACE(name);
        const State start = random_state(problem, 0.05, 7);
        Simulation<TypeParam> by_side(problem, start), by_bit(problem, start, false);
        testing::expect_same_steps(by_side, by_bit);
        EXPECT_EQ(by_bit.plain_blocks(), 0U);
        EXPECT_EQ(by_side.plain_blocks() == by_side.layout().blocks().size(), by_side.layout().all_plain());
        const std::map<std::string, std::size_t> expected = {
            {"whole_bricks", 8}, {"one_brick", 1}, {"faces_of_bricks", 4}, {"hole", 7}, {"sparse", 0}};
        if (const auto known = expected.find(name); known != expected.end()) {
            EXPECT_EQ(by_side.plain_blocks(), known->second);
        }
    }
}

TYPED_TEST(BrickBody, AnEditLeavesTheTablesAndTheStepsOfTheEditedProblem) {
    const BrickShape shape = TypeParam::shape;
    std::size_t changed = 0, cut_blocks = 0;
    for (Problem problem :
         {lattice(random_grid({12, 10, 11}, 1.0, 3)), lattice(random_grid({12, 10, 11}, 0.95, 3)),
          lattice(random_grid({12, 10, 11}, 0.63, 3)),
          lattice(solid({2 * shape.nx(), 2 * shape.ny(), shape.nz()}))}) {
        SCOPED_TRACE(problem.particle_count());
        if (!Simulation<TypeParam>::fits(problem)) return;
        Simulation<TypeParam> simulation(problem, random_state(problem, 0.05, 7));
        simulation.step(2);
        changed += testing::expect_edits(
            simulation, problem, [](auto& masks, std::uint32_t n) -> auto& { return masks.at(n); },
            [](const BrickLayout& layout, const BrickLayout& expected) {
                EXPECT_EQ(layout.blocks(), expected.blocks());
                EXPECT_EQ(layout.sent().points, expected.sent().points);
                EXPECT_EQ(layout.received().points, expected.received().points);
            });
        if (problem.lattice.dims.x == 2 * shape.nx()) {
            // Before an edit all blocks are plain; afterwards some of them are not.
            EXPECT_GT(simulation.plain_blocks(), 0U);
            cut_blocks +=
                simulation.launches() * simulation.layout().blocks().size() - simulation.plain_blocks();
        }
    }
    EXPECT_GT(changed, 50U);
    EXPECT_GT(cut_blocks, 0U);
}

// Every particle belongs to one thread, and every point that a thread may read has its distinct slot.
TYPED_TEST(BrickBody, EveryParticleIsInOneTile) {
    for (const auto& [name, problem] : Simulation<TypeParam>::that_fit(lattices())) {
        SCOPED_TRACE(name);
        const BrickShape shape = TypeParam::shape;
        const BrickLayout layout(problem, {.shape = shape, .pollers = 32});
        std::multiset<std::tuple<int, int, int>> seen;
        for (const BrickBlock& block : layout.blocks()) {
            std::set<int> slots;
            for (int lane = 0; lane < shape.threads(); ++lane) {
                const TilePlace place(shape, block, lane);
                for (int n = 0; n < shape.tile(); ++n) {
                    const int i = n % shape.tx, j = n / shape.tx % shape.ty, k = n / (shape.tx * shape.ty);
                    EXPECT_TRUE(slots.insert(place.slot_of(shape, i, j, k)).second);
                    seen.emplace(place.x + place.dx * i, place.y + place.dy * j, place.z + place.dz * k);
                }
            }
        }
        for (const std::uint32_t voxel : problem.lattice.voxel) {
            const glm::ivec3 at = problem.lattice.coordinates(voxel);
            EXPECT_EQ(seen.count({at.x, at.y, at.z}), 1U);
        }
    }
}

/// The brick that a card takes for a box. The brick's shape is known when its kernel is compiled, so it
/// stands here too. `number`: of testing::card_profiles().
template <std::size_t number, int nx, int ny, int nz, class V>
struct OnCard {
    static const testing::CardProfile& card() {
        static const std::vector<testing::CardProfile> cards = testing::card_profiles();
        return cards.at(number);
    }
    static Problem box() { return lattice(solid({nx, ny, nz})); }
    using Body = V;
};
template <class V>
class BrickCard : public ::testing::Test {};
// The paper's box, and on the smallest card, which does not hold it, a quarter of it.
using Cards =
    ::testing::Types<OnCard<0, 32, 16, 16, Variant<Formulation::increment, 2, 1, 2, 8, 8, 2, false, 7, 0>>,
                     OnCard<1, 32, 32, 32, Variant<Formulation::position, 3, 1, 1, 2, 8, 8, true, 0, 0>>,
                     OnCard<2, 32, 32, 32, Variant<Formulation::increment, 2, 1, 2, 16, 6, 4, false, 0, 8>>,
                     OnCard<3, 32, 32, 32, Variant<Formulation::position, 3, 1, 1, 2, 7, 8, true, 0, 2>>,
                     OnCard<4, 32, 32, 32, Variant<Formulation::increment, 3, 1, 1, 2, 5, 8, true, 0, 6>>>;
TYPED_TEST_SUITE(BrickCard, Cards);

TYPED_TEST(BrickCard, StepsABoxByTheBrickThatItPlans) {
    using V = typename TypeParam::Body;
    const testing::CardProfile& card = TypeParam::card();
    SCOPED_TRACE(card.name);
    const Problem box = TypeParam::box();
    const std::optional<BrickPlan> plan =
        plan_bricks(box, V::formulation, card.device, card.architecture >= 90);
    ASSERT_TRUE(plan);
    const BrickShape& s = plan->shape;
    EXPECT_EQ(s, V::shape) << "planned: " << s.tx << " " << s.ty << " " << s.tz << " " << s.wx << " " << s.wy
                           << " " << s.wz << " " << s.both << " " << s.row_pad << " " << s.plane_pad;
    EXPECT_FALSE(plan->increments_in_memory);
    testing::expect_agreement<Simulation<V>>({{"box", box}}, Precision::float32, V::formulation);
}

// A thread that requests registers which no other thread releases waits for ever.
TEST(BrickPlan, AsksForNoMoreRegistersThanTheCompilerGave) {
    BrickPlan plan;
    plan.shape = {3, 2, 3, 16, 6, 4, false, 0, 0};
    plan.pollers = 128;
    EXPECT_EQ(registers_refusal(plan, 40), "") << "none are moved";
    plan.lane_registers = 144;
    plan.poller_registers = 80;
    EXPECT_EQ(registers_refusal(plan, 128), "");
    EXPECT_EQ(registers_refusal(plan, 121), "") << "warps get multiples of eight";
    EXPECT_NE(registers_refusal(plan, 120), "");
    EXPECT_NE(registers_refusal(plan, 152), "") << "lanes cannot take what they have more of";
    EXPECT_NE(registers_refusal(plan, 72), "") << "pollers cannot give what they do not have";
}

// The box of the paper is on the chip of every card but the smallest.
TEST(BrickPlan, SuitsEveryCard) {
    const Problem box = lattice(solid({32, 32, 32}));
    for (const testing::CardProfile& card : testing::card_profiles()) {
        SCOPED_TRACE(card.name);
        const std::optional<BrickPlan> plan =
            plan_bricks(box, Formulation::increment, card.device, card.architecture >= 90);
        ASSERT_EQ(plan.has_value(), card.device.block_shared_bytes > 48U << 10U);
        if (!plan) continue;
        EXPECT_LE(std::size_t(plan->shape.shared_bytes()), card.device.block_shared_bytes);
        EXPECT_LE(plan->shape.lanes() + plan->pollers, 1024);
        EXPECT_LE(BrickLayout(box, *plan).blocks().size(), std::size_t(card.device.multiprocessors));
        // Latencies are in cycles: a card at half the clock takes twice the time.
        MarchDevice slow = card.device;
        slow.hertz /= 2;
        const std::optional<BrickPlan> slower =
            plan_bricks(box, Formulation::increment, slow, card.architecture >= 90);
        EXPECT_EQ(slower->shape, plan->shape);
        EXPECT_NEAR(slower->seconds, 2 * plan->seconds, 1e-12);
    }
}

TEST(BrickPlan, FitsTheDevice) {
    struct Body {
        const char* name;
        Problem problem;
    };
    for (const auto& [name, problem] :
         {Body{"box 48", lattice(solid({48, 48, 48}))}, Body{"box 64", lattice(solid({64, 64, 64}))},
          Body{"box 96", lattice(solid({96, 96, 96}))},
          Body{"5% missing", lattice(random_grid({64, 64, 64}, 0.95, 1))},
          Body{"128 lanes per block", lattice(solid({16, 80, 80}))},
          Body{"ellipsoid", lattice(make_grid({80, 68, 60}, [](int x, int y, int z) {
                   return std::hypot((x - 39.5) / 40, (y - 33.5) / 34, (z - 29.5) / 30) < 1;
               }))}}) {
        for (const Formulation formulation : {Formulation::position, Formulation::increment}) {
            SCOPED_TRACE(std::string(name) + " " + to_string(formulation));
            const std::optional<BrickPlan> best = plan_bricks(problem, formulation, server, true);
            ASSERT_TRUE(best);
            // 96^3 by increments has more state than the registers hold.
            EXPECT_EQ(best->increments_in_memory,
                      name == std::string("box 96") && formulation == Formulation::increment);
            for (const BrickTileSize& size : brick_tile_sizes()) {
                const std::optional<BrickPlan> plan = plan_bricks(problem, formulation, server, true, size);
                if (!plan) continue;
                EXPECT_LE(best->seconds, plan->seconds);
                const BrickShape& s = plan->shape;
                SCOPED_TRACE(std::to_string(s.tx) + "x" + std::to_string(s.ty) + "x" + std::to_string(s.tz));
                const int threads = s.lanes() + plan->pollers;
                EXPECT_LE(threads, 1024);
                EXPECT_LE(std::size_t(s.shared_bytes()), server.block_shared_bytes);
                // If the plan asked for more registers than the launch gave, warps would wait for ever.
                const int at_launch = std::min(255, 65536 / ((threads + 127) / 128 * 128) / 8 * 8);
                EXPECT_EQ(registers_refusal(*plan, at_launch), "");
                if (plan->lane_registers > 0) {
                    EXPECT_LE(plan->lane_registers * s.lanes() + plan->poller_registers * plan->pollers,
                              65536 / threads / 8 * 8 * threads);
                }
                const BrickLayout layout(problem, *plan);
                EXPECT_LE(layout.blocks().size(), std::size_t(server.multiprocessors));
                // Pollers send with tiles of 8 particles, and only if they keep all points that they receive.
                if (plan->pollers_send) {
                    EXPECT_LT(layout.received().rounds, kept_polls);
                    EXPECT_EQ(s.tile(), 8);
                }
                if (name == std::string("box 64") && s.tile() == 8) {
                    EXPECT_TRUE(plan->pollers_send);
                    EXPECT_EQ(plan->lane_registers, 176);
                }
            }
        }
    }
    // These bodies fit on no chip.
    EXPECT_EQ(plan_bricks(lattice(solid({160, 160, 160})), Formulation::position, server, true),
              std::nullopt);
}

}  // namespace
}  // namespace voxspring::cuda
