// The march along z (cuda/kernels/march.h) without a device: its layout, its plan, and its kernel body. The
// body runs on the host, every thread of every item, with windows filled as by a device's copy engine.
#include <gtest/gtest.h>

#include <algorithm>
#include <barrier>
#include <bit>
#include <cmath>
#include <cstring>
#include <deque>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "backends/layout/march_layout.h"
#include "backends/layout/march_plan.h"
#include "backends/layout/springs.h"
#include "backends/physics/inverse_root.h"
#include "cuda/kernels/march.h"
#include "tests/bodies.h"
#include "tests/host_subdomains.h"
#include "tests/support.h"

// What a device has for async_ring.h, with one host thread for each of a block's threads. A copy spoils its
// destination when it is asked for, and brings its values only when its thread waits for it.
#define __device__
namespace voxspring::cuda {
namespace {

struct AsyncCopy {
    void* to;
    const void* from;
    int bytes;
};
thread_local std::vector<AsyncCopy> open_copies;
thread_local std::deque<std::vector<AsyncCopy>> ended_copies;
thread_local std::barrier<>* block_barrier = nullptr;
constexpr int copied_bytes = 16;

void copy_async(void* to, const void* from, int bytes) {
    std::memset(to, 0xFF, copied_bytes);
    open_copies.push_back({to, from, bytes});
}
void end_copies() { ended_copies.push_back(std::exchange(open_copies, {})); }
template <std::size_t pending>
void await_copies() {
    for (; ended_copies.size() > pending; ended_copies.pop_front()) {
        for (const AsyncCopy& copy : ended_copies.front()) {
            std::memset(copy.to, 0, copied_bytes);
            std::memcpy(copy.to, copy.from, std::size_t(copy.bytes));
        }
    }
}
bool any_of_warp(bool here) { return here; }
template <int threads>
void meet_block() {
    block_barrier->arrive_and_wait();
}

}  // namespace
}  // namespace voxspring::cuda
#include "cuda/kernels/async_ring.h"

namespace voxspring::cuda {
namespace {

using testing::expect_bits_of_each;
using testing::lattice;
using testing::make_grid;
using testing::pinned;
using testing::random_grid;
using testing::random_state;
using testing::solid;

MarchPlan plan_for(const Problem& problem, const MarchShape& shape, int multiprocessors = 4,
                   Precision precision = Precision::float32, Formulation formulation = Formulation::position,
                   MarchInterior interior = {}) {
    return plan_march(problem, {{"", shape, 1}}, precision, formulation,
                      testing::march_device_of(multiprocessors), interior);
}

Problem cut(Problem problem) {
    SpringEditor editor(problem);
    editor.cut(Plane{{9.5, 0, 0}, {1, 0.3, 0}});
    editor.cut(Ball{{5, 5, 3}, 2.2});
    return problem;
}

/// Problems that the march accepts.
std::map<std::string, Problem> lattices() {
    std::map<std::string, Problem> problems = testing::bodies_by_class();
    problems["aligned_box"] = lattice(solid({32, 8, 20}));
    problems["wide_box"] = lattice(solid({67, 22, 5}));
    problems["high_box"] = lattice(solid({20, 12, 41}));
    problems["two_runs"] = lattice(make_grid({9, 8, 28}, [](int, int, int z) { return z < 9 || z > 20; }));
    problems["soft_edges"] = lattice(solid({21, 9, 10}));
    problems["soft_edges"].group_stiffness = {1.0, 0, 0};
    problems["pinned_box"] = pinned(lattice(solid({18, 12, 36})));
    problems["cut"] = cut(lattice(solid({20, 10, 8})));
    problems["heavy"] = lattice(solid({6, 5, 4}));
    problems["heavy"].materials = {{3.0, 1.0}};
    return problems;
}

template <class Scalar, Formulation f, int rows, int lanes, int wide, int high, int planes = 3,
          int befores = 2>
struct Variant {
    using Real = Scalar;
    static constexpr Formulation formulation = f;
    static constexpr MarchShape shape{rows, lanes, wide, high, planes, befores};
    static constexpr Precision precision = sizeof(Real) == 4 ? Precision::float32 : Precision::float64;
};

/// The windows of an item as a device copies them: values outside of the lattice are zero.
template <class V>
class HostPlanes {
    using Real = typename V::Real;
    static constexpr MarchShape shape = V::shape;
    static constexpr int real = sizeof(Real);

public:
    HostPlanes(const MarchStep<Real>& step, const MarchItem& item, const std::vector<Real>& positions,
               const std::vector<Real>& previous_windows)
        : step_(step), item_(item), first_(item.begin == 0 ? 0 : item.begin - 1) {
        const int last = item.end == step.nz ? item.end - 1 : item.end;
        for (int z = first_; z <= last; ++z)
            windows_.push_back(box(positions, item.x - MarchShape::margin(real), item.y - 1, z,
                                   shape.pitch(real), shape.height() + 2));
        for (int z = item.begin; z < item.end; ++z)
            previous_windows_.push_back(
                box(previous_windows, item.x, item.y, z, shape.width(), shape.height()));
    }
    void start(int thread) {
        thread_ = thread;
        arrived_ = released_ = before_ = 0;
    }
    /// Whether the thread asked for every window, and gave back all except the newest window of positions.
    bool complete() const {
        return arrived_ == windows_.size() && released_ + 1 == arrived_ &&
               before_ == previous_windows_.size();
    }

    void refill(int plane) {
        if (plane != first_ + int(arrived_)) throw std::logic_error("another plane than the next");
    }
    static bool any(bool here) { return here; }
    const Real* arrive() { return windows_.at(arrived_++).data() + shape.own(thread_, real); }
    void release() { ++released_; }
    const Real* before() const { return previous_windows_.at(before_).data() + shape.before_own(thread_); }
    static void store(Pair<Real>* to, Pair<Real> pair) { *to = pair; }
    void release_before() { ++before_; }

private:
    std::vector<Real> box(const std::vector<Real>& values, int x, int y, int z, int width, int height) const {
        std::vector<Real> out;
        out.reserve(std::size_t(3) * std::size_t(width) * std::size_t(height));
        for (std::size_t axis = 0; axis < 3; ++axis) {
            for (int j = y; j < y + height; ++j) {
                for (int i = x; i < x + width; ++i) {
                    const bool inside = i >= 0 && j >= 0 && i < step_.nx && j < step_.ny;
                    out.push_back(inside ? values[axis * step_.axis + std::size_t(z) * step_.plane +
                                                  std::size_t(j) * step_.row + std::size_t(i)]
                                         : Real(0));
                }
            }
        }
        return out;
    }

    const MarchStep<Real>& step_;
    const MarchItem& item_;
    int first_, thread_ = 0;
    std::vector<std::vector<Real>> windows_, previous_windows_;
    std::size_t arrived_ = 0, released_ = 0, before_ = 0;
};

/// A backend's state and steps, on the host.
template <class V>
class Simulation {
public:
    using Real = typename V::Real;

    Simulation(const Problem& problem, const State& start, int multiprocessors = 4)
        : problem_(problem),
          state_(pack_soa<Real>(problem, start, V::formulation, march_places(problem.lattice, sizeof(Real)))),
          plan_(plan_for(problem, V::shape, multiprocessors, V::precision, V::formulation)),
          step_(make_march_step<Real>(problem, V::formulation)) {
        if (!by_increments(V::formulation)) {
            for (Real& length : step_.rest_length) length = inverse_root(length);
        }
        step_.words = plan_.words.data();
    }
    Simulation(const Simulation&) = delete;

    /// Fills windows by asynchronous copies.
    void copy_async() { async_ = true; }
    /// Makes every warp use masks.
    void mask_everything() {
        for (MarchItem& item : plan_.items) item.full_stencils = 0;
    }
    void step(int count) {
        for (int n = 0; n < count; ++n) {
            begin_step();
            items_ = plan_.items;
            launch();
            std::swap(state_, after_);
        }
    }
    State download() const {
        return unpack_soa<Real>(problem_, state_, V::formulation,
                                march_places(problem_.lattice, sizeof(Real)));
    }
    const MarchPlan& plan() const { return plan_; }
    /// Arrays as in the backend.
    BorderPlaces<Real> places(const std::vector<std::uint32_t>& elements) {
        return {elements.data(), elements.size(), state_.current.data(), nullptr, 1, step_.axis};
    }
    /// Arrays as in Simulation of host_kernels.h.
    std::size_t split(const std::vector<std::uint32_t>& border) {
        plan_ = plan_for(problem_, V::shape, 4, V::precision, V::formulation, interior_of(problem_, border));
        step_.words = plan_.words.data();
        return plan_.items.size() - plan_.border_items;
    }
    void step_part(StepPart part) {
        if (part == StepPart::border) {
            begin_step();
            items_ = std::span(plan_.items).first(plan_.border_items);
        } else {
            std::swap(state_, after_);
            items_ = std::span(plan_.items).subspan(plan_.border_items);
        }
        launch();
        std::swap(state_, after_);
    }
    std::vector<std::uint32_t> elements_of(const std::vector<std::uint32_t>& particles) const {
        const SoaStrides axes = march_strides(problem_.lattice, sizeof(Real));
        std::vector<std::uint32_t> elements;
        for (const std::uint32_t i : particles)
            elements.push_back(
                std::uint32_t(axes.element(problem_.lattice.coordinates(problem_.lattice.voxel[i]))));
        return elements;
    }

private:
    /// A copy of what the step overwrites.
    void begin_step() {
        constexpr bool increments = by_increments(V::formulation);
        after_.current = increments ? std::vector<Real>(state_.current.size()) : state_.before;
        after_.before = increments ? state_.before : state_.current;
    }
    void launch() {
        switch (problem_.group_bits) {
            case FACE_BITS:
                launch<FACE_BITS>();
                break;
            case EDGE_BITS:
                launch<EDGE_BITS>();
                break;
            default:
                launch<FACE_BITS | EDGE_BITS>();
        }
    }
    template <std::uint32_t groups>
    void launch() {
        const MarchOutput<Real> output{after_.current.data(),
                                       by_increments(V::formulation) ? after_.before.data() : nullptr};
        for (const MarchItem& item : items_) {
            if (async_) {
                launch_async<groups>(item, output);
                continue;
            }
            HostPlanes<V> planes(step_, item, state_.current, state_.before);
            for (int thread = 0; thread < V::shape.threads(); ++thread) {
                planes.start(thread);
                step_thread<groups>(item, output, thread, planes);
                ASSERT_TRUE(planes.complete());
            }
        }
    }
    template <std::uint32_t groups>
    void launch_async(const MarchItem& item, const MarchOutput<Real>& output) {
        constexpr int threads = V::shape.threads(), real = sizeof(Real);
        const MarchArrays<Real> from{state_.current.data(), by_increments(V::formulation)
                                                                ? after_.before.data()
                                                                : after_.current.data()};
        std::barrier<> barrier(threads);
        std::vector<Pair<double>> shared(std::size_t(V::shape.shared_bytes(real)) / sizeof(Pair<double>));
        std::vector<std::jthread> all;
        for (int thread = 0; thread < threads; ++thread) {
            all.emplace_back([&, thread] {
                block_barrier = &barrier;
                AsyncRings<Real, V::shape> planes(reinterpret_cast<unsigned char*>(shared.data()), step_,
                                                  from, item, thread);
                step_thread<groups>(item, output, thread, planes);
            });
        }
    }
    template <std::uint32_t groups, class Planes>
    void step_thread(const MarchItem& item, const MarchOutput<Real>& output, int thread, Planes& planes) {
        if (equal_edges(problem_, V::formulation)) {
            step_thread<groups, true>(item, output, thread, planes);
        } else {
            step_thread<groups, false>(item, output, thread, planes);
        }
    }
    template <std::uint32_t groups, bool equal, class Planes>
    void step_thread(const MarchItem& item, const MarchOutput<Real>& output, int thread, Planes& planes) {
        constexpr std::uint32_t both = term_damping | term_gravity;
        if (problem_.damping == 0 && !problem_.has_gravity()) {
            step_thread<KernelTerms<V::formulation, groups, 0, false>, equal>(item, output, thread, planes);
        } else {
            step_thread<KernelTerms<V::formulation, groups, both, false>, equal>(item, output, thread,
                                                                                 planes);
        }
    }
    template <class Terms, bool equal, class Planes>
    void step_thread(const MarchItem& item, const MarchOutput<Real>& output, int thread, Planes& planes) {
        if ((item.full_stencils >> (thread / 32) & 1U) != 0) {
            march<Terms, V::shape, false, equal>(step_, item, output, thread, planes);
        } else {
            march<Terms, V::shape, true, equal>(step_, item, output, thread, planes);
        }
    }

    const Problem& problem_;
    SoaState<Real> state_, after_;  ///< before the step at hand, and as far as it goes
    MarchPlan plan_;
    std::span<const MarchItem> items_;  ///< that it takes
    MarchStep<Real> step_;
    bool async_ = false;
};

template <class V>
class MarchBody : public ::testing::Test {};
using Variants = ::testing::Types<
    Variant<float, Formulation::position, 2, 8, 1, 2>, Variant<float, Formulation::position, 2, 32, 2, 1>,
    Variant<float, Formulation::displacement, 2, 16, 1, 3>,
    Variant<float, Formulation::increment, 2, 8, 2, 1>, Variant<float, Formulation::increment, 1, 4, 1, 1>,
    Variant<double, Formulation::position, 1, 8, 1, 2>,
    Variant<double, Formulation::displacement, 2, 8, 1, 1>,
    Variant<double, Formulation::increment, 1, 32, 1, 2>>;
TYPED_TEST_SUITE(MarchBody, Variants);

TYPED_TEST(MarchBody, AgreesWithTheReferenceAndStaysAtRest) {
    testing::expect_agreement<Simulation<TypeParam>>(lattices(), TypeParam::precision,
                                                     TypeParam::formulation);
}

// A cut may make a warp use masks that did without. It must change nothing but the springs.
TYPED_TEST(MarchBody, MasksChangeNoBit) {
    const std::size_t all = (std::size_t(1) << TypeParam::shape.warps()) - 1;
    int warps = 0;
    for (const auto& [name, problem] : lattices()) {
        SCOPED_TRACE(name);
        const State start = random_state(problem, 0.05, 7);
        Simulation<TypeParam> simulation(problem, start), masked(problem, start);
        const std::vector<MarchItem>& items = simulation.plan().items;
        // Items without any masks have no words for them.
        if (std::any_of(items.begin(), items.end(),
                        [all](const auto& item) { return item.full_stencils == all; }))
            continue;
        for (const MarchItem& item : items) warps += std::popcount(item.full_stencils);
        masked.mask_everything();
        testing::expect_same_steps(simulation, masked, {3});
    }
    // In tiles this narrow and high some of these lattices have whole warps beside others.
    const bool in_some = TypeParam::shape.width() == 16 && TypeParam::shape.high > 1;
    if (in_some) {
        EXPECT_GT(warps, 0);
    }
}

// The card determines how runs of planes are cut into items, but must not influence the result of a step.
TYPED_TEST(MarchBody, CutsChangeNoBit) {
    int shortest = std::numeric_limits<int>::max();
    std::size_t parted = 0;
    for (const auto& [name, problem] : lattices()) {
        SCOPED_TRACE(name);
        const State start = random_state(problem, 0.05, 7);
        Simulation<TypeParam> whole(problem, start, 1);
        whole.step(3);
        for (const int multiprocessors : {7, 150}) {
            Simulation<TypeParam> cut(problem, start, multiprocessors);
            parted += cut.plan().items.size() - whole.plan().items.size();
            for (const MarchItem& item : cut.plan().items)
                shortest = std::min(shortest, item.end - item.begin);
            cut.step(3);
            testing::expect_same_bits(cut.download(), whole.download());
        }
    }
    EXPECT_LE(shortest, 3);
    EXPECT_GT(parted, 100U);
}

// All of these bodies are cut along z.
TYPED_TEST(MarchBody, SlabsGiveTheBitsOfTheWhole) {
    std::vector<Problem> wholes;
    for (const char* name : {"high_box", "two_runs", "pinned_box"}) wholes.push_back(lattices().at(name));
    expect_bits_of_each(wholes, {}, [](const Problem& problem, const State& start) {
        return std::make_unique<Simulation<TypeParam>>(problem, start);
    });
}

/// The tiles of march_tiles(), for which kernels are compiled. A card's plan takes one of them.
template <class V>
class MarchTiles : public ::testing::Test {};
using Tiles = ::testing::Types<Variant<float, Formulation::position, 2, 32, 2, 10, 4, 2>,
                               Variant<float, Formulation::increment, 2, 32, 1, 8, 4, 3>,
                               Variant<float, Formulation::position, 2, 32, 1, 4, 3, 2>,
                               Variant<float, Formulation::increment, 2, 16, 1, 5, 3, 2>,
                               Variant<float, Formulation::position, 2, 32, 1, 10, 4, 2>,
                               Variant<float, Formulation::increment, 2, 32, 2, 8, 4, 3>,
                               Variant<double, Formulation::position, 1, 32, 1, 8, 4, 3>,
                               Variant<double, Formulation::increment, 1, 32, 1, 4, 3, 2>,
                               Variant<double, Formulation::position, 1, 32, 2, 8, 4, 3>>;
TYPED_TEST_SUITE(MarchTiles, Tiles);

TYPED_TEST(MarchTiles, StepAsTheReferenceDoes) {
    std::map<std::string, Problem> bodies = lattices();
    std::erase_if(bodies, [](const auto& body) { return body.first != "wide_box" && body.first != "cut"; });
    testing::expect_agreement<Simulation<TypeParam>>(bodies, TypeParam::precision, TypeParam::formulation);
}

template <class... V>
bool steps_by(::testing::Types<V...> /*of*/, Precision precision, const MarchShape& shape) {
    return ((V::precision == precision && V::shape == shape) || ...);
}
TEST(MarchTile, OfEachCardIsRunHere) {
    for (const Precision precision : {Precision::float32, Precision::float64}) {
        for (const MarchTile& tile : march_tiles(precision))
            EXPECT_TRUE(steps_by(Tiles{}, precision, tile.shape)) << tile.name << " " << to_string(precision);
    }
}

template <class V>
class MarchCopies : public ::testing::Test {};
/// Rings of every depth.
using Rings = ::testing::Types<Variant<float, Formulation::position, 2, 8, 1, 2, 3, 2>,
                               Variant<float, Formulation::increment, 2, 8, 1, 2, 4, 3>,
                               Variant<float, Formulation::displacement, 2, 16, 2, 1, 4, 2>,
                               Variant<double, Formulation::position, 1, 8, 1, 2, 4, 3>>;
TYPED_TEST_SUITE(MarchCopies, Rings);

// Threads are in windows of other threads at any time: no copy comes too early, and no wait is too short.
TYPED_TEST(MarchCopies, OfThreadsGiveTheBitsOfTheCopyEngine) {
    for (const auto& [name, multiprocessors] :
         {std::pair{"wide_box", 150}, {"high_box", 1}, {"two_runs", 4}, {"pinned_box", 4}}) {
        SCOPED_TRACE(name);
        const Problem problem = lattices().at(name);
        const State start = random_state(problem, 0.05, 7);
        Simulation<TypeParam> by_engine(problem, start, multiprocessors);
        Simulation<TypeParam> by_threads(problem, start, multiprocessors);
        by_threads.copy_async();
        testing::expect_same_steps(by_threads, by_engine, {2});
    }
}

// A particle that is not finite affects only particles that it has a spring to.
TYPED_TEST(MarchBody, AStrayParticleStaysAlone) {
    Problem problem = lattice(solid({13, 9, 8}));
    const std::size_t stray = (std::size_t(4) * 9 + 4) * 13 + 6;
    for (const Direction& direction : directions()) {  // a full box: voxel index equals particle index
        const auto other = std::size_t(std::ptrdiff_t(stray) + problem.lattice.stride(direction));
        problem.lattice.mask[stray] &= ~(1U << direction.bit);
        problem.lattice.mask[other] &= ~(1U << (direction.bit ^ 1));
    }
    State start = random_state(problem, 0.05, 7);
    Simulation<TypeParam> sound(problem, start);
    sound.step(3);
    start.displacement[stray] = glm::dvec3(std::numeric_limits<double>::quiet_NaN());
    Simulation<TypeParam> simulation(problem, start);
    simulation.step(3);
    const State expected = sound.download(), state = simulation.download();
    ASSERT_EQ(problem.lattice.mask[stray] & NEIGHBOUR_BITS, 0U);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        if (i != stray) {
            ASSERT_EQ(state.displacement[i], expected.displacement[i]) << i;
        }
    }
    EXPECT_TRUE(std::isnan(state.displacement[stray].x));
}

TEST(MarchShape, CoversItsTileOnce) {
    for (const char* name : {"32x20", "64x4", "64x8", "64x16", "64x20", "128x8", "128x16", "128x20"}) {
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            const MarchTile tile = march_tile(name, precision);
            const MarchShape& shape = tile.shape;
            if (shape.warps() == 0) continue;
            SCOPED_TRACE(name);
            EXPECT_EQ(std::to_string(shape.width()) + "x" + std::to_string(shape.height()), name);
            std::set<std::pair<int, int>> columns;
            for (int thread = 0; thread < shape.threads(); ++thread) {
                for (int r = 0; r < shape.rows; ++r) {
                    for (int c = 0; c < 2; ++c)
                        columns.emplace(shape.column(thread) + c, shape.row(thread) + r);
                }
            }
            EXPECT_EQ(int(columns.size()), shape.width() * shape.height());
            EXPECT_EQ(columns.rbegin()->first, shape.width() - 1);
            // An SM of compute capability 9.0 has 228 KiB, of which each block takes 1 KiB more.
            const int real = precision == Precision::float32 ? 4 : 8;
            EXPECT_LE(tile.blocks * (shape.shared_bytes(real) + 1024), 228 * 1024);
            EXPECT_LE(shape.pitch(real), 256);  // limit of the copy engine for a box
        }
    }
}

TEST(MarchPlan, TakesTheTileThatIsPredictedToBeTheFastestOfThoseThatFit) {
    const std::map<std::string, Problem> problems = {{"dense", lattice(solid({96, 24, 40}))},
                                                     {"sparse", lattice(random_grid({96, 24, 40}, 0.2, 1))},
                                                     {"narrow", lattice(solid({20, 20, 20}))}};
    // Compute capability 9.0 lets a block have 227 KiB of shared memory, 8.0 163, 12.0 99, all 48.
    for (const std::size_t kibibytes : {227, 163, 99, 48}) {
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            for (const auto& [name, problem] : problems) {
                SCOPED_TRACE(name + " " + to_string(precision) + " " + std::to_string(kibibytes));
                MarchDevice device = testing::march_device_of(8);
                device.block_shared_bytes = kibibytes << 10U;
                device.shared_bytes = device.block_shared_bytes + device.reserved_bytes;
                const auto planned = [&, &of = problem](const std::vector<MarchTile>& tiles) {
                    return plan_march(of, tiles, precision, Formulation::position, device);
                };
                const MarchPlan best = planned(march_tiles(precision));
                EXPECT_GT(resident_blocks(best.tile, precision, device), 0);
                for (const MarchTile& tile : march_tiles(precision)) {
                    if (resident_blocks(tile, precision, device) > 0) {
                        EXPECT_LE(best.seconds, max_alike * planned({tile}).seconds) << tile.name;
                    }
                }
            }
        }
    }
}

// The blocks that registers are compiled for are on a multiprocessor at once.
TEST(MarchPlan, SuitsEveryCard) {
    const Problem problem = lattice(solid({96, 96, 40}));
    for (const testing::CardProfile& card : testing::card_profiles()) {
        MarchDevice device = card.device;
        device.tensor_copies = card.architecture >= 90;
        for (const Precision precision : {Precision::float32, Precision::float64}) {
            SCOPED_TRACE(std::string(card.name) + " " + to_string(precision));
            const MarchPlan plan =
                plan_march(problem, march_tiles(precision), precision, Formulation::position, device);
            const auto bytes =
                std::size_t(plan.tile.shape.shared_bytes(precision == Precision::float32 ? 4 : 8));
            const int blocks = resident_blocks(plan.tile, precision, device);
            ASSERT_GT(blocks, 0);
            EXPECT_LE(bytes, device.block_shared_bytes);
            EXPECT_LE(std::size_t(blocks) * (bytes + device.reserved_bytes), device.shared_bytes);
            EXPECT_LE(blocks * plan.tile.shape.threads(), device.threads);
            if (!device.tensor_copies) {
                EXPECT_LE(blocks * plan.tile.shape.threads() * 128, 65536) << "registers";
            }
        }
    }
}

TEST(MarchPlan, TellsL2WhatToKeepWhereTheStateIsSomewhatLarger) {
    MarchDevice device = testing::march_device_of(132);
    const auto kept = [&](const Problem& problem) {
        return plan_march(problem, {march_tile("64x16", Precision::float32)}, Precision::float32,
                          Formulation::position, device)
            .kept_planes;
    };
    const Problem box = pinned(lattice(solid({64, 64, 64})));  // 6.3 MB
    device.cache_bytes = 5e6;
    EXPECT_EQ(kept(box), 2);
    device.multiprocessors = 1;
    EXPECT_EQ(kept(box), 0) << "several rounds of items";
    device.multiprocessors = 132;
    device.tensor_copies = false;
    EXPECT_EQ(kept(box), 0) << "copies of threads have no policy";
    device.tensor_copies = true;
    device.cache_bytes = 8e6;
    EXPECT_EQ(kept(box), 0) << "it fits";
    device.cache_bytes = 3e6;
    EXPECT_EQ(kept(box), 0) << "it is too large";
}

// This holds whatever the interior of a slab is.
TEST(MarchPlan, HoldsEveryParticleOnceAndBordersFirst) {
    constexpr MarchShape shape{2, 8, 1, 2, 3, 2};
    for (const auto& [name, problem] : lattices()) {
        SCOPED_TRACE(name);
        const int planes = problem.lattice.dims.z;
        for (const MarchInterior interior : {MarchInterior{2, planes - 2},
                                             {0, planes - 1},
                                             {3, planes},
                                             {planes / 2, planes / 2},
                                             {2, planes - 2, 1, planes - 1}}) {
            std::map<std::tuple<int, int, int>, int> items;
            const MarchPlan plan =
                plan_for(problem, shape, 4, Precision::float32, Formulation::position, interior);
            for (std::size_t n = 0; n < plan.items.size(); ++n) {
                const MarchItem& item = plan.items[n];
                for (int z = item.begin; z < item.end; ++z) {
                    ++items[{item.x, item.y, z}];
                    EXPECT_TRUE(z >= interior.own_begin && z < interior.own_end);
                    EXPECT_EQ(z < interior.begin || z >= interior.end, n < plan.border_items);
                }
            }
            for (const auto& [place, count] : items) EXPECT_EQ(count, 1);
            std::set<std::tuple<int, int, int>> needed;
            for (const std::uint32_t voxel : problem.lattice.voxel) {
                const glm::ivec3 c = problem.lattice.coordinates(voxel);
                if (c.z < interior.own_begin || c.z >= interior.own_end) continue;
                needed.emplace(c.x / shape.width() * shape.width(), c.y / shape.height() * shape.height(),
                               c.z);
            }
            EXPECT_EQ(items.size(), needed.size());
        }
    }
}

TEST(MarchPlan, HasTheLongestRunOfPlanesBetweenBordersAsItsInterior) {
    Problem box = lattice(solid({1, 1, 9}));  // each plane is one particle
    EXPECT_EQ(interior_of(box, {}), (MarchInterior{0, 9, 0, 9}));
    EXPECT_EQ(interior_of(box, {0, 1}), (MarchInterior{2, 9, 0, 9}));
    EXPECT_EQ(interior_of(box, {7, 8}), (MarchInterior{0, 7, 0, 9}));
    EXPECT_EQ(interior_of(box, {0, 1, 7, 8}), (MarchInterior{2, 7, 0, 9}));
    const MarchInterior none = interior_of(box, {0, 1, 2, 3, 4, 5, 6, 7, 8});
    EXPECT_EQ(none.begin, none.end);
    box.ghosts = {0, 8};
    EXPECT_EQ(interior_of(box, {0, 1, 7, 8}), (MarchInterior{2, 7, 1, 8}));
    box.ghosts = {0, 1, 2, 3, 4, 5, 6, 7, 8};
    const MarchInterior nothing = interior_of(box, {0});
    EXPECT_EQ(nothing.own_begin, nothing.own_end);
}

TEST(MarchPlan, NeedsMasksOnlyWhereSpringsAreMissing) {
    constexpr MarchShape shape{2, 32, 1, 8, 4, 3};  // 64 x 16
    // Only the first and last rows have masks.
    const Problem box = lattice(solid({128, 48, 5}));
    int whole = 0;
    for (const MarchItem& item : plan_for(box, shape, 1).items) whole += std::popcount(item.full_stencils);
    EXPECT_EQ(whole, 2 * 3 * 8 - 2 * 2);
    // Removing one spring makes one warp use masks, or two if the spring ends in another.
    Problem edited = box;
    SpringEditor(edited).cut(Ball{{20.5, 20, 2}, 0.6});
    int left = 0;
    for (const MarchItem& item : plan_for(edited, shape, 1).items) left += std::popcount(item.full_stencils);
    EXPECT_EQ(left, whole - 1);
}

TEST(MarchStep, NeedsRestLengthsButByIncrements) {
    Problem problem = lattice(solid({3, 3, 3}));
    EXPECT_TRUE(has_inverse_lengths(problem, Precision::float32, Formulation::position));
    problem.rest_length.fill(1e-20);
    EXPECT_FALSE(has_inverse_lengths(problem, Precision::float32, Formulation::position));
    EXPECT_TRUE(has_inverse_lengths(problem, Precision::float64, Formulation::displacement));
    EXPECT_TRUE(has_inverse_lengths(problem, Precision::float32, Formulation::increment));
}

TEST(MarchPlan, LeavesMasksToPlanesOfPins) {
    constexpr MarchShape shape{2, 8, 1, 1, 3, 2};  // 16 x 8
    const Problem box = pinned(lattice(solid({16, 24, 100})));
    // The middle of three tiles steps without masks, except in the pinned plane.
    for (const MarchItem& item : plan_for(box, shape, 1).items) {
        if (item.y == shape.height()) {
            EXPECT_EQ(item.full_stencils, item.begin == 0 ? 0U : 1U);
            EXPECT_EQ(item.end, item.begin == 0 ? 1 : 100);
        }
    }
}

TEST(MarchPlan, FillsTheDevice) {
    constexpr MarchShape shape{2, 8, 1, 2, 3, 2};  // 16 x 16
    // Three columns on four multiprocessors: in four parts each, three rounds of 64 planes, rather than one
    // of 256.
    EXPECT_EQ(plan_for(lattice(solid({48, 16, 256})), shape).items.size(), 12U);
    // As many columns as multiprocessors stay whole.
    EXPECT_EQ(plan_for(lattice(solid({64, 16, 256})), shape).items.size(), 4U);
    // A card with many more multiprocessors than there are columns: items of few planes.
    const MarchPlan many = plan_for(lattice(solid({32, 32, 64})), shape, 132);
    EXPECT_EQ(many.items.size(), 4 * 22U);
    for (const MarchItem& item : many.items) EXPECT_LE(item.end - item.begin, 3);
}

// The number of a part times the length of the run exceeds 32 bits.
TEST(MarchPlan, CutsALongRunIntoManyParts) {
    constexpr MarchShape shape{2, 8, 1, 1, 3, 2};
    constexpr int planes = 100'000;
    const MarchPlan plan = plan_for(lattice(solid({1, 1, planes})), shape, planes);
    std::set<int> begins;
    int covered = 0;
    for (const MarchItem& item : plan.items) {
        begins.insert(item.begin);
        covered += item.end - item.begin;
        ASSERT_GT(item.end, item.begin);
        ASSERT_LE(item.end - item.begin, 3);
    }
    EXPECT_EQ(covered, planes);
    EXPECT_EQ(begins.size(), plan.items.size());
}

TEST(MarchPlan, TakesTheLongestFirstAndThenTheLowest) {
    constexpr MarchShape shape{2, 8, 1, 2, 3, 2};
    const auto place = [](const MarchItem& item) {
        return std::make_pair(item.begin - item.end, item.begin);
    };
    // Parts of 2 and 3 planes, also if there are two runs of different length.
    for (const char* name : {"high_box", "two_runs", "sparse"}) {
        const MarchPlan plan = plan_for(lattices().at(name), shape, 150);
        EXPECT_GT(plan.items.size(), 3U) << name;
        EXPECT_TRUE(std::is_sorted(plan.items.begin(), plan.items.end(), [&](const auto& a, const auto& b) {
            return place(a) < place(b);
        })) << name;
    }
}

// More bodies and cards of every size are in layout_property_test.
TEST(MarchPlan, PredictsMoreForMore) {
    constexpr MarchShape shape{2, 8, 1, 2, 3, 2};
    const auto seconds = [&](const Problem& problem, int multiprocessors, Formulation formulation) {
        return plan_for(problem, shape, multiprocessors, Precision::float32, formulation).seconds;
    };
    const Problem box = lattice(solid({48, 48, 64}));
    const double at_first = seconds(box, 8, Formulation::position);
    EXPECT_GT(at_first, seconds(lattice(solid({48, 48, 32})), 8, Formulation::position)) << "planes";
    EXPECT_GT(at_first, seconds(box, 16, Formulation::position)) << "multiprocessors";
    EXPECT_LT(at_first, seconds(box, 8, Formulation::increment)) << "instructions";
    EXPECT_LT(at_first, seconds(lattice(random_grid({48, 48, 64}, 0.95, 1)), 8, Formulation::position))
        << "masks";
}

}  // namespace
}  // namespace voxspring::cuda
