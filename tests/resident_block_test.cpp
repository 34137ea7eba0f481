// The body of the resident kernel on the host, with one host thread for each device thread: steps, the tool,
// ticks that the host orders during a launch, and parts of a body whose launches exchange their borders. With
// one fiber for each device thread: the paper's bodies as they are planned for whole cards.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <glm/geometric.hpp>
#include <iterator>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/layout/decomposition.h"
#include "backends/layout/resident_layout.h"
#include "backends/layout/tick_desk.h"
#include "harness/volume/dataset.h"
#include "tests/host_blocks.h"
// The kernel bodies need the functions above, which a device has built in.
#include "cuda/kernels/edit.h"
#include "cuda/kernels/resident_block.h"
#include "tests/bodies.h"
#include "tests/host_kernels.h"
#include "tests/support.h"

#ifdef __has_feature
#if __has_feature(thread_sanitizer)
#define WATCHES_THREADS
#endif
#if __has_feature(thread_sanitizer) || __has_feature(address_sanitizer)
#define NO_FIBERS
#endif
#endif

namespace voxspring::cuda {
namespace {

using testing::expect_same_bits;
using testing::random_edits;
using testing::random_grid;
using testing::random_state;
using testing::solid;

using testing::lattice;
Problem lattice(glm::ivec3 dims) { return lattice(solid(dims)); }

/// The problem with a tool; one of the particles also has a load.
Problem held(Problem problem, const State& start, const std::vector<std::uint32_t>& particles) {
    Tool tool{.particles = particles, .held = {}, .stiffness = 0.125};
    for (const std::uint32_t i : tool.particles) tool.held.push_back(start.displacement[i]);
    problem.load.assign(problem.particle_count(), glm::dvec3(0));
    problem.load[31] = {0.01, -0.02, 0.03};
    take_hold(problem, tool);
    return problem;
}
/// Held particles in several blocks, for bodies of at least 120 particles.
const std::vector<std::uint32_t> anywhere = {0, 31, 112, 119};

/// A body and how it is divided among blocks.
struct Body {
    glm::ivec3 dims;
    Partition partition;
    bool overlap;
    ResidentShape shape;
    ResidentCard card = {0, 0};  ///< of a body that takes a whole card, whose threads are fibers
};
/// All springs wait for the border, so sums have the order of the implicit kernels.
inline constexpr Body mixed{
    {8, 4, 4}, Partition::bisection, false, {32, 16, 2, 128, 1U << mixed_border, false, {}}};
/// As `mixed`, for a lattice with stress at rest.
inline constexpr Body masked{
    mixed.dims, Partition::bisection, false, {32, 16, 2, 128, 1U << mixed_border, true, {}}};
#ifndef WATCHES_THREADS
/// As `mixed`, with lanes that have no particle.
inline constexpr Body idle{{6, 5, 4}, Partition::bisection, false, mixed.shape};
#endif
/// One warp per row, with borders on one or two sides: springs within a block are added first.
inline constexpr Body rows{
    {32, 2, 2}, Partition::rows, true, {32, 64, 2, 160, (1U << border_kinds) - 1, false, {}}};
/// Three particles per thread, some of which have neighbours in their own block only.
constexpr ResidentShape in_turns(bool stressed) {
    return {32, 32, 2, 256, 1U << 0 | 1U << mixed_border, stressed, {}, false, 3};
}
inline constexpr Body turns{{10, 9, 4}, Partition::bisection, true, in_turns(false)};
inline constexpr Body masked_turns{turns.dims, Partition::bisection, true, in_turns(true)};
/// A part of a body: its own particles are {4, 4, 8}, and no lane is idle.
constexpr ResidentShape as_part() {
    ResidentShape shape = mixed.shape;
    shape.part = true;
    return shape;
}
inline constexpr Body part{{4, 4, 8}, Partition::bisection, false, as_part()};
inline constexpr Body part_in_turns{{8, 4, 8},
                                    Partition::bisection,
                                    false,
                                    {32, 32, 2, 256, 1U << 0 | 1U << mixed_border, false, {}, true, 2}};
constexpr int max_blocks = 4;

constexpr ResidentShape with(ToolMode mode, ResidentShape shape) {
    shape.tool = mode;
    return shape;
}

/// cuda_resident's tables and state, on the host.
template <Formulation f, const Body& body, ToolMode mode>
class Simulation {
public:
    using Terms =
        KernelTerms<f, FACE_BITS | EDGE_BITS,
                    term_damping | term_gravity | term_pins | (mode == ToolMode::none ? 0 : term_loads),
                    false>;
    using Block = ResidentBlock<Terms, with(mode, body.shape)>;

    /// `tag` and `tick`: the numbers before the first. `rank`: the rank of this part.
    Simulation(const Problem& problem, const State& start, std::uint32_t tag = 0, std::uint32_t tick = 0,
               int rank = 0)
        : problem_(problem),
          placement_(place_compact(problem)),
          layout_(lay_out_resident(
              problem, is_of_card ? body.card : ResidentCard{max_blocks, 48U << 10U, body.shape.lanes},
              body.shape.pollers, body.partition, body.overlap)),
          slot_(slots_with(layout_, problem.lattice.mask)),
          own_slot_(own_slots_with(layout_, problem.lattice.mask)),
          packed_(pack<float>(problem, start, placement_, problem.lattice.mask, f)),
          load_(pack_load<float>(problem, placement_)),
          held_(pack_held<float>(problem, placement_, f)),
          held_by_lane_(held_by_lanes(layout_, problem.tool.particles)),
          exchange_(2 * layout_.published_count),
          forces_(held_.size()),
          answers_(held_.size()),
          tag_(tag),
          desk_(tick),
          rank_(rank) {
        const ResidentShape& shape = body.shape;
        if ((!is_of_card && layout_.blocks != max_blocks) || layout_.threads() != shape.lanes ||
            layout_.turns != shape.turns || layout_.rounds != shape.rounds || layout_.slots > shape.slots ||
            (layout_.border_kinds & ~shape.borders) != 0)
            throw std::logic_error(
                "the kernel is of another shape: lanes " + std::to_string(layout_.lanes) + ", turns " +
                std::to_string(layout_.turns) + ", rounds " + std::to_string(layout_.rounds) + ", slots " +
                std::to_string(layout_.slots) + ", borders " + std::to_string(layout_.border_kinds));
        packed_.previous.resize(placement_.words);
        static_cast<ImplicitStep<float>&>(step_) =
            make_implicit_step<float>(problem, place_on_grid(problem.lattice), f);
        measure<float>(step_.rest_length, f);
        step_.motion.load = load_.empty() ? nullptr : load_.data();
        step_.particle = layout_.particle.data();
        step_.published = layout_.published.data();
        step_.own_slot = own_slot_.data();
        step_.slot = slot_.data();
        step_.border = layout_.border.data();
        step_.polled = layout_.polled.data();
        step_.polled_word = layout_.polled_word.data();
        step_.polled_slot = layout_.polled_slot.data();
        step_.lane_count = layout_.lane_count();
        step_.published_count = layout_.published_count;
        step_.exchange = exchange_.data();
        step_.started_blocks = &started_blocks_;
        step_.wait = {&stall_, std::uint64_t(std::chrono::nanoseconds(std::chrono::minutes(1)).count())};
        step_.held_by_lane = held_by_lane_.data();
        step_.held = held_.data();
        step_.tool.stiffness = float(problem.tool.stiffness);
        step_.forces = forces_.data();
        if constexpr (mode == ToolMode::ticks) desk_.open(&asked_, answers_);
    }
    Simulation(const Simulation&) = delete;

    /// For a part of a body, before its first launch: the words where the neighbours put the points of
    /// `ghosts`.
    std::vector<std::uint32_t> words_of(const std::vector<std::uint32_t>& ghosts) const {
        return words_of_ghosts(layout_, problem_, ghosts);
    }
    ResidentNeighbour as_neighbour() { return {exchange_.data(), layout_.published_count}; }
    /// Connects a part to its neighbours, before its first launch: what it sends, and to which of them.
    void connect(const std::vector<ResidentSending>& sendings, const std::vector<ResidentNeighbour>& to) {
        ASSERT_EQ(sent_refusal(sendings), "");
        sent_ = sent_by_lanes(layout_, sendings);
        links_.sent = sent_.data();
        std::copy(to.begin(), to.end(), links_.neighbour);
    }

    /// Edits between launches.
    void edit(const SpringEdit& edit) {
        const ResidentEdit written = resident_edit(layout_, edit);
        for (std::size_t n = 0; n < written.words.size(); ++n)
            write_slot_or_bits(slot_.data(), written.slots, packed_.current.data(), written.words.data(), n);
    }

    void move_tool(const glm::dvec3& displacement) { step_.tool.moved = vector_of<float>(displacement); }

    /// A launch of `count` steps.
    void step(int count) {
        launch(count);
        end();
        tag_ += std::uint32_t(count);
    }
    glm::dvec3 tool_force() const { return force_on_tool(forces_); }

    // In ticks, as cuda/common/ticks.h does it:

    void order(const glm::dvec3& moved, int steps) {
        desk_.order(vector_of<float>(moved), std::uint32_t(steps));
        if (!launch_) begin();
        tag_ += desk_.steps();
    }
    void order_again() {
        desk_.order_again();
        begin();
        tag_ += desk_.steps();
    }
    glm::dvec3 wait_for_force() {
        while (!desk_.answered()) std::this_thread::yield();
        return force_on_tool(desk_.forces());
    }
    void order_end() {
        desk_.order_end();
        end();
    }
    /// Waits until all blocks have stored their state.
    void end() { launch_.reset(); }

    TickDesk& desk() { return desk_; }
    void set_max_idle(std::chrono::nanoseconds most) { max_idle_ = most; }
    void set_max_wait(std::chrono::nanoseconds most) { step_.wait.nanoseconds = std::uint64_t(most.count()); }
    /// Which wait was in vain; empty if none was.
    std::optional<ResidentStall> stall() const {
        if (stall_ == 0) return std::nullopt;
        return ResidentStall::unpacked(stall_);
    }
    State download() const { return unpack<float>(problem_, packed_, placement_, f); }

private:
    void begin() {
        taken_blocks_ = 0;
        step_.line = {&asked_,         &handed_on_,  &taken_blocks_,
                      answers_.data(), desk_.tick(), std::uint64_t(max_idle_.count())};
        launch(0);
    }
    typename Block::Step step_of_launch() const {
        const typename Block::StepOfWhole& of_whole = step_;
        if constexpr (body.shape.part) {
            return {of_whole, links_};
        } else {
            return of_whole;
        }
    }
    void launch(int count) {
        const typename Block::Memory memory{packed_.current.data(), packed_.previous.data(),
                                            packed_.increment.data(), increment_pitch(placement_)};
        const auto thread = [step = step_of_launch(), memory, count, tag = tag_, launches = ++launches_,
                             rank = rank_](auto& shared) {
            host_rank = rank;
            Block(shared, step).run(memory, count, tag, launches);
        };
        using Shared = typename Block::Shared;
        const auto blocks = unsigned(layout_.blocks);
        if constexpr (is_of_card) {
            HostFibers::run<Shared>(blocks, Block::all_threads, body.shape.lanes, thread);
        } else {
            launch_ = HostLaunch::of<Shared>(blocks, Block::all_threads, body.shape.lanes, thread);
        }
    }
    static constexpr bool is_of_card = body.card.blocks > 0;

    const Problem& problem_;
    const Placement placement_;
    const ResidentLayout layout_;
    std::vector<std::uint16_t> slot_, own_slot_;
    PackedState<float> packed_;
    std::vector<Vector<float>> load_;
    std::vector<HeldWord<float>> held_;
    std::vector<std::uint32_t> held_by_lane_;
    std::vector<TaggedPoint> exchange_;
    std::vector<HeldForce<float>> forces_;
    std::vector<AnswerWords> answers_;
    OrderWords asked_{}, handed_on_{};
    std::uint32_t started_blocks_ = 0, taken_blocks_ = 0, launches_ = 0;
    std::uint64_t stall_ = 0;
    std::uint32_t tag_;
    TickDesk desk_;
    std::chrono::nanoseconds max_idle_ = std::chrono::minutes(1);
    HeldResidentStep step_{};
    ResidentLinks links_{};
    std::vector<std::uint32_t> sent_;
    const int rank_;
    std::optional<HostLaunch> launch_;
};

template <class V>
class Resident : public ::testing::Test {};
using Formulations =
    ::testing::Types<Variant<float, Formulation::position>, Variant<float, Formulation::increment>>;
TYPED_TEST_SUITE(Resident, Formulations);

const std::vector<int> launches = {1, 4, 1, 3};

template <class V, const Body& body>
void expect_steps_as_implicit(const Problem& problem) {
    const State start = random_state(problem, 0.05, 1);
    testing::expect_same_steps(Simulation<V::formulation, body, ToolMode::none>(problem, start),
                               ImplicitSimulation<V>(problem, start, {8, 4, 4}), launches);
}

// In turns, pins are in the tables.
TYPED_TEST(Resident, StepsAsTheImplicitKernelDoes) {
    expect_steps_as_implicit<TypeParam, mixed>(lattice(mixed.dims));
    expect_steps_as_implicit<TypeParam, turns>(testing::pinned(lattice(turns.dims)));
}

#ifndef NO_FIBERS
constexpr Body on(int multiprocessors, std::size_t kibibytes, int lanes, int rounds, int slots,
                  std::uint32_t borders, int particles = 1) {
    return {{},
            Partition::automatic,
            true,
            {lanes, 256, rounds, slots, borders, false, {}, false, particles},
            {multiprocessors, kibibytes << 10U}};
}
// The plans for the cards of card_profiles(). 16 multiprocessors of 48 KiB have no room for either body.
inline constexpr Body box_on_a100 = on(108, 163, 320, 3, 1024, 0x1F),
                      box_on_rtx_4060 = on(24, 99, 480, 4, 2432, 0x11, 3),
                      box_on_h200 = on(132, 227, 256, 2, 768, 0x0A),
                      box_on_rtx_5090 = on(170, 99, 224, 3, 864, 0x1E);
inline constexpr Body heart_on_a100 = on(108, 163, 288, 2, 928, 0x13),
                      heart_on_rtx_4060 = on(24, 99, 416, 3, 2080, 0x11, 3),
                      heart_on_h200 = on(132, 227, 224, 2, 960, 0x11),
                      heart_on_rtx_5090 = on(170, 99, 192, 2, 896, 0x10);

template <const Body& body>
void expect_steps_on_card(const Problem& problem, const char* card) {
    SCOPED_TRACE(card);
    bool found_card = false;
    for (const testing::CardProfile& profile : testing::card_profiles()) {
        if (profile.name != std::string(card)) continue;
        found_card = true;
        ASSERT_EQ(body.card.blocks, profile.device.multiprocessors);
        ASSERT_EQ(body.card.shared_bytes, profile.device.block_shared_bytes);
    }
    ASSERT_TRUE(found_card);
    constexpr Formulation f = Formulation::position;
    const State start = random_state(problem, 0.05, 1);
    Simulation<f, body, ToolMode::none> resident(problem, start);
    ImplicitSimulation<Variant<float, f>> implicit(problem, start, {8, 4, 4});
    for (const int count : {3, 2}) {
        resident.step(count);
        implicit.step(count);
    }
    EXPECT_FALSE(resident.stall().has_value());
    const State found = resident.download(), expected = implicit.download();
    if (body.shape.turns > 1 || body.shape.borders == 1U << mixed_border)
        return expect_same_bits(found, expected);
    // Springs within a block do not wait for its border, so sums have another order. A position of up to 60
    // is rounded by 2e-6 in each of five steps. A spring too many or too few moves its ends by a thousandth.
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const double apart = glm::length(found.displacement[i] - expected.displacement[i]);
        ASSERT_TRUE(apart <= 3e-5) << "particle " << i << ": " << apart;  // NaN fails, too
    }
}

// Every block, lane and poller of the card runs, and every wait between them.
TEST(ResidentCards, StepTheBodiesOfThePaperAsTheImplicitKernelDoes) {
    const Problem box = lattice({32, 32, 32});
    expect_steps_on_card<box_on_a100>(box, "A100");
    expect_steps_on_card<box_on_rtx_4060>(box, "RTX 4060");
    expect_steps_on_card<box_on_h200>(box, "H200");
    expect_steps_on_card<box_on_rtx_5090>(box, "RTX 5090");
    const Problem heart = lattice(make_heart({60, 51, 46}));
    expect_steps_on_card<heart_on_a100>(heart, "A100");
    expect_steps_on_card<heart_on_rtx_4060>(heart, "RTX 4060");
    expect_steps_on_card<heart_on_h200>(heart, "H200");
    expect_steps_on_card<heart_on_rtx_5090>(heart, "RTX 5090");
}

// A thread that leaves its block early keeps the others waiting, and the launch says so.
TEST(ResidentCards, ABarrierThatAThreadDoesNotReachEndsTheLaunch) {
    struct Nothing {};
    const auto launch = [](unsigned absent) {
        HostFibers::run<Nothing>(2, 40, 8, [=](Nothing&) {
            if (blockIdx.x == 1 && threadIdx.x == absent) return;
            __syncthreads();
            if (threadIdx.x < 8) meet<2, 8>();
        });
    };
    EXPECT_NO_THROW(launch(40));
    EXPECT_THROW(launch(17), std::logic_error);
}
#endif

/// A body with repeated edits steps as one that is uploaded again after each edit.
template <Formulation f, const Body& body>
void expect_edits_as_uploads(const Problem& problem) {
    const State start = random_state(problem, 0.05, 3);
    Problem now = problem, edited = problem;
    Simulation<f, body, ToolMode::none> in_place(now, start);
    in_place.step(2);
    for (const SpringEdit& edit : random_edits(edited, 4, 8)) {
        ASSERT_FALSE(edit.empty());
        const State midway = in_place.download();
        apply(now, edit);
        in_place.edit(edit);
        in_place.step(3);
        Simulation<f, body, ToolMode::none> anew(now, midway);
        anew.step(3);
        expect_same_bits(in_place.download(), anew.download());
    }
}

TYPED_TEST(Resident, AnEditStepsAsTheEditedProblemDoes) {
    expect_edits_as_uploads<TypeParam::formulation, mixed>(lattice(mixed.dims));
    expect_edits_as_uploads<TypeParam::formulation, rows>(lattice(rows.dims));
    expect_edits_as_uploads<TypeParam::formulation, turns>(lattice(turns.dims));
    // Springs pull at rest, so masks are tested and all springs wait for the border.
    const auto stressed = [](glm::ivec3 dims) {
        Problem problem = lattice(dims);
        for (double& length : problem.rest_length) length *= 0.9;
        return problem;
    };
    expect_edits_as_uploads<TypeParam::formulation, masked>(stressed(masked.dims));
    expect_edits_as_uploads<TypeParam::formulation, masked_turns>(stressed(masked_turns.dims));
}

/// Where the tool is in tick n.
glm::dvec3 hand(std::size_t n) { return {0.05 * double(n % 3), -0.1 * double(n % 2), 0.02 * double(n + 1)}; }

template <class V, const Body& body>
void expect_tool_as_implicit() {
    const State start = random_state(lattice(body.dims), 0.05, 1);
    const Problem problem = held(lattice(body.dims), start, anywhere);
    ImplicitSimulation<V> expected(problem, start, {8, 4, 4});
    Simulation<V::formulation, body, ToolMode::launch> resident(problem, start);
    for (std::size_t n = 0; n < launches.size(); ++n) {
        expected.move_tool(hand(n));
        expected.step(launches[n]);
        resident.move_tool(hand(n));
        resident.step(launches[n]);
        expect_same_bits(resident.download(), expected.download());
        EXPECT_EQ(resident.tool_force(), expected.tool_force());
        EXPECT_NE(resident.tool_force(), glm::dvec3(0));
    }
}
TYPED_TEST(Resident, AToolPullsAsThePassBeforeAnImplicitStepDoes) {
    expect_tool_as_implicit<TypeParam, mixed>();
    expect_tool_as_implicit<TypeParam, turns>();
}

/// Compares ticks of the body with a launch for each.
template <Formulation f, const Body& body>
void expect_ticks_as_launches(const std::vector<int>& ticks, std::uint32_t before_first = 0,
                              const std::vector<std::uint32_t>& particles = anywhere) {
    const State start = random_state(lattice(body.dims), 0.05, 2);
    const Problem problem = held(lattice(body.dims), start, particles);
    Simulation<f, body, ToolMode::launch> by_launch(problem, start);
    Simulation<f, body, ToolMode::ticks> in_ticks(problem, start, before_first, before_first);
    // Another launch continues from the memory that the first one leaves.
    const std::size_t half = ticks.size() / 2;
    for (const auto& [begin, end] : {std::pair(std::size_t(0), half), std::pair(half, ticks.size())}) {
        std::vector<glm::dvec3> forces;
        for (std::size_t n = begin; n < end; ++n) {
            by_launch.move_tool(hand(n));
            by_launch.step(ticks[n]);
            forces.push_back(by_launch.tool_force());
        }
        // Each order goes out as soon as the answer to the previous one has arrived.
        for (std::size_t n = begin; n < end; ++n) {
            in_ticks.order(hand(n), ticks[n]);
            ASSERT_EQ(in_ticks.wait_for_force(), forces[n - begin]) << "tick " << n;
        }
        in_ticks.order_end();
        expect_same_bits(in_ticks.download(), by_launch.download());
    }
}

TYPED_TEST(Resident, ATickGivesTheBitsOfALaunch) {
    expect_ticks_as_launches<TypeParam::formulation, mixed>({1, 1, 4, 3, 1, 2, 5, 1});
    expect_ticks_as_launches<TypeParam::formulation, rows>({1, 1, 4, 3, 1, 2, 5, 1});
    expect_ticks_as_launches<TypeParam::formulation, turns>({1, 1, 4, 3, 1, 2, 5, 1});
}

// An edit between two ticks: the launch ends, and another one begins.
TYPED_TEST(Resident, AnEditBetweenTicksStepsAsTheEditedProblemDoes) {
    const State start = random_state(lattice(rows.dims), 0.05, 2);
    Problem now = held(lattice(rows.dims), start, anywhere), edited = now;
    Simulation<TypeParam::formulation, rows, ToolMode::ticks> in_ticks(now, start);
    in_ticks.order(hand(0), 2);
    (void)in_ticks.wait_for_force();
    for (const SpringEdit& edit : random_edits(edited, 3, 9)) {
        in_ticks.order_end();
        apply(now, edit);
        in_ticks.edit(edit);
        Simulation<TypeParam::formulation, rows, ToolMode::launch> anew(now, in_ticks.download());
        for (const int steps : {1, 3}) {
            anew.move_tool(hand(std::size_t(steps)));
            anew.step(steps);
            in_ticks.order(hand(std::size_t(steps)), steps);
            ASSERT_EQ(in_ticks.wait_for_force(), anew.tool_force());
        }
    }
    in_ticks.order_end();
}

/// A body of `ranks` parts, each stepped by separate launches.
template <Formulation f, const Body& body, ToolMode mode>
class Parts {
public:
    Parts(const Problem& whole, const State& start, int ranks, std::uint32_t tag = 0) : whole_(whole) {
        const Decomposition cuts(whole, Decomposition::slabs(whole, ranks));
        for (int rank = 0; rank < ranks; ++rank) slabs_.push_back(cuts.subdomain(whole, rank));
        for (int rank = 0; rank < ranks; ++rank) {
            const Subdomain& slab = slabs_[std::size_t(rank)];
            all_.push_back(
                std::make_unique<Simulation<f, body, mode>>(slab.problem, slab.part_of(start), tag, 0, rank));
        }
        for (std::size_t rank = 0; rank < all_.size(); ++rank) {
            std::vector<ResidentSending> sendings;
            std::vector<ResidentNeighbour> to;
            for (const Subdomain::Border& border : slabs_[rank].borders) {
                const auto other = std::size_t(border.subdomain);
                const Subdomain::Border& back =
                    other < rank ? slabs_[other].borders.back() : slabs_[other].borders.front();
                sendings.push_back({border.sent, all_[other]->words_of(back.received)});
                to.push_back(all_[other]->as_neighbour());
            }
            all_[rank]->connect(sendings, to);
        }
    }

    /// Each part runs these launches by itself. Rank `slow` sleeps before each of its launches, so that the
    /// others get as far ahead of it as they can.
    void step(const std::vector<int>& counts, std::size_t slow = 0) {
        static constexpr std::chrono::milliseconds delay(20);
        std::vector<std::jthread> hosts;
        for (std::size_t rank = 0; rank < all_.size(); ++rank) {
            hosts.emplace_back([this, rank, slow, &counts] {
                for (const int count : counts) {
                    if (rank == slow) std::this_thread::sleep_for(delay);
                    all_[rank]->step(count);
                }
            });
        }
    }
    void edit(const SpringEdit& edit) {
        for (std::size_t rank = 0; rank < all_.size(); ++rank) all_[rank]->edit(slabs_[rank].part_of(edit));
    }
    void move_tool(const glm::dvec3& displacement) {
        for (const auto& simulation : all_) simulation->move_tool(displacement);
    }
    Simulation<f, body, mode>& of(std::size_t rank) { return *all_[rank]; }

    State download() const {
        State state = state_at_rest(whole_);
        for (std::size_t rank = 0; rank < all_.size(); ++rank)
            slabs_[rank].copy_own(all_[rank]->download(), state);
        return state;
    }
    /// Expects each part to have its ghosts where the others have these particles, both now and one step
    /// before.
    void expect_ghosts_are_kept() const {
        const State whole = download();
        for (std::size_t rank = 0; rank < all_.size(); ++rank) {
            const State here = all_[rank]->download();
            for (const std::uint32_t i : slabs_[rank].problem.ghosts) {
                ASSERT_EQ(here.displacement[i], whole.displacement[slabs_[rank].particle[i]]);
                if (!by_increments(f)) {
                    ASSERT_EQ(here.increment[i], glm::dvec3(0));
                }
            }
        }
    }

private:
    const Problem& whole_;
    std::vector<Subdomain> slabs_;
    std::vector<std::unique_ptr<Simulation<f, body, mode>>> all_;
};

glm::ivec3 dims_of_parts(int ranks) { return {4, 4, 8 * ranks}; }

template <class V, const Body& body>
void expect_parts_as_implicit(glm::ivec3 dims, int ranks) {
    const Problem problem = lattice(dims);
    const State start = random_state(problem, 0.05, 1);
    ImplicitSimulation<V> expected(problem, start, {8, 4, 4});
    Parts<V::formulation, body, ToolMode::none> parts(problem, start, ranks);
    for (std::size_t slow = 0; slow < std::size_t(ranks); ++slow) {
        for (const int count : launches) expected.step(count);
        parts.step(launches, slow);
        expect_same_bits(parts.download(), expected.download());
        parts.expect_ghosts_are_kept();
    }
}

TYPED_TEST(Resident, PartsGiveTheBitsOfTheWhole) {
    for (const int ranks : {2, 3}) expect_parts_as_implicit<TypeParam, part>(dims_of_parts(ranks), ranks);
    expect_parts_as_implicit<TypeParam, part_in_turns>({8, 4, 16}, 2);
}

// Launches of one step: the point of the next step is sent before a late part has read the latest. 2^32 is
// among the step numbers.
TEST(ResidentParts, TakeTurnsWhateverTheLaunches) {
    const Problem problem = lattice(dims_of_parts(2));
    const State start = random_state(problem, 0.05, 1);
    constexpr Formulation f = Formulation::position;
    ImplicitSimulation<Variant<float, f>> expected(problem, start, {8, 4, 4});
    Parts<f, part, ToolMode::none> parts(problem, start, 2, 0xFFFFFFFCU);
    const std::vector<int> single = {1, 1, 1, 1, 1, 1, 1, 1};
    expected.step(int(single.size()));
    late_rank = 1;
    parts.step(single);
    late_rank = -1;
    expect_same_bits(parts.download(), expected.download());
}

TYPED_TEST(Resident, PartsTakeEditsAcrossTheirBorders) {
    Problem now = lattice(dims_of_parts(2)), edited = now;
    const Problem whole = now;
    const State start = random_state(whole, 0.05, 3);
    Parts<TypeParam::formulation, part, ToolMode::none> parts(whole, start, 2);
    parts.step({2});
    for (const SpringEdit& edit : random_edits(edited, 4, 8)) {
        const State midway = parts.download();
        apply(now, edit);
        parts.edit(edit);
        parts.step({3, 1}, 1);
        ImplicitSimulation<TypeParam> expected(now, midway, {8, 4, 4});
        expected.step(4);
        expect_same_bits(parts.download(), expected.download());
    }
}

TYPED_TEST(Resident, PartsAreHeldByATool) {
    const State start = random_state(lattice(dims_of_parts(2)), 0.05, 1);
    // On both sides of the border, which lies before particle 128.
    const Problem problem = held(lattice(dims_of_parts(2)), start, {0, 127, 128, 255});
    ImplicitSimulation<TypeParam> expected(problem, start, {8, 4, 4});
    Parts<TypeParam::formulation, part, ToolMode::launch> parts(problem, start, 2);
    for (std::size_t n = 0; n < launches.size(); ++n) {
        expected.move_tool(hand(n));
        expected.step(launches[n]);
        parts.move_tool(hand(n));
        parts.step({launches[n]}, n % 2);
        expect_same_bits(parts.download(), expected.download());
    }
}

// The neighbouring part is never launched. Only the first wait takes the longest permitted time; the launch
// after it does not wait.
TEST(ResidentParts, DoNotWaitForEver) {
    using Clock = std::chrono::steady_clock;
    const Problem problem = lattice(dims_of_parts(2));
    Parts<Formulation::position, part, ToolMode::none> parts(problem, state_at_rest(problem), 2);
    constexpr auto longest = std::chrono::seconds(1);
    parts.of(1).set_max_wait(longest);
    const auto begin = Clock::now();
    parts.of(1).step(100);
    EXPECT_GE(Clock::now() - begin, longest / 2);
    ASSERT_TRUE(parts.of(1).stall().has_value());
    // A block that meets the border only after some steps may be the first to give up.
    EXPECT_GE(parts.of(1).stall()->step, 1U);
    EXPECT_LT(parts.of(1).stall()->block, unsigned(max_blocks));
    parts.of(1).step(100);
    EXPECT_LT(Clock::now() - begin, 60 * longest) << "it waits in each step";
}

// Idle lanes write into one slot that no thread reads: a race that ThreadSanitizer need not report.
#ifndef WATCHES_THREADS
TYPED_TEST(Resident, StepsWithIdleLanes) {
    expect_steps_as_implicit<TypeParam, idle>(lattice(idle.dims));
    expect_ticks_as_launches<TypeParam::formulation, idle>({1, 3, 2, 1});
}

TYPED_TEST(Resident, AnEditOfAPorousBodyStepsAsTheEditedProblemDoes) {
    for (const double fill : {0.95, 0.63})
        expect_edits_as_uploads<TypeParam::formulation, mixed>(lattice(random_grid(mixed.dims, fill, 4)));
}
#endif

// Numbers of ticks and of steps wrap around: 2^32 is among them.
TEST(Ticks, NumbersBeginAnew) {
    expect_ticks_as_launches<Formulation::position, mixed>({1, 1, 3, 1, 2, 1, 1, 1}, 0xFFFFFFFCU);
}

// Only block 0 answers. An order is not replaced until the slow block has read it.
TEST(Ticks, WaitForASlowBlock) {
    for (const unsigned slow : {1U, 2U, 3U}) {
        slow_block = slow;
        expect_ticks_as_launches<Formulation::position, mixed>({1, 1, 1, 1, 1, 1, 1, 1, 1, 1}, 0, {0});
    }
    slow_block = ~0U;
}

// Block 0, which reads the host's orders, passes none on for longer than the other blocks may wait.
TEST(Ticks, EndAfterAWaitInVain) {
    const State start = random_state(lattice(rows.dims), 0.05, 2);
    const Problem problem = held(lattice(rows.dims), start, anywhere);
    Simulation<Formulation::position, rows, ToolMode::ticks> in_ticks(problem, start);
    in_ticks.set_max_wait(std::chrono::milliseconds(500));
    in_ticks.set_max_idle(std::chrono::seconds(3));
    in_ticks.order(hand(0), 3);
    (void)in_ticks.wait_for_force();
    in_ticks.end();
    ASSERT_TRUE(in_ticks.stall().has_value());
    EXPECT_EQ(in_ticks.stall()->step, 3U);
}

// The launch ends although the host orders no end.
TEST(Ticks, EndWhereTheHostIsSilentAndGoOnWhenItIsNot) {
    const State start = random_state(lattice(rows.dims), 0.05, 2);
    const Problem problem = held(lattice(rows.dims), start, anywhere);
    Simulation<Formulation::increment, rows, ToolMode::launch> by_launch(problem, start);
    Simulation<Formulation::increment, rows, ToolMode::ticks> in_ticks(problem, start);
    in_ticks.set_max_idle(std::chrono::milliseconds(50));
    in_ticks.order(hand(0), 3);
    in_ticks.end();
    by_launch.move_tool(hand(0));
    by_launch.step(3);
    EXPECT_EQ(in_ticks.wait_for_force(), by_launch.tool_force());
    expect_same_bits(in_ticks.download(), by_launch.download());

    // No launch sees this order: the next launch takes it, as a separate tick.
    in_ticks.desk().order(vector_of<float>(hand(1)), 2);
    EXPECT_FALSE(in_ticks.desk().answered());
    EXPECT_EQ(force_on_tool(in_ticks.desk().forces()), by_launch.tool_force()) << "of the tick before";
    in_ticks.order_again();
    by_launch.move_tool(hand(1));
    by_launch.step(2);
    EXPECT_EQ(in_ticks.wait_for_force(), by_launch.tool_force());
    in_ticks.order_end();
    expect_same_bits(in_ticks.download(), by_launch.download());
}

TEST(Ticks, AnAnswerIsThereWhenAllOfItIs) {
    std::vector<AnswerWords> answers(2);
    OrderWords asked{};
    TickDesk desk(6);
    desk.open(&asked, answers);
    EXPECT_TRUE(desk.answered()) << "nothing was asked";
    desk.order({1, 2, 3}, 4);
    EXPECT_EQ(desk.tick(), 7U);
    EXPECT_FALSE(desk.answered());
    answer({-1, -2, -3}, 7, &answers[1]);
    answer({5, 6, 7}, 6, &answers[0]);
    EXPECT_FALSE(desk.answered());
    answers[0].word[2] = tick_word(-6.0F, 7);
    answers[0].word[0] = tick_word(-4.0F, 7);
    EXPECT_FALSE(desk.answered());
    answers[0].word[1] = tick_word(-5.0F, 7);
    EXPECT_TRUE(desk.answered());
    EXPECT_EQ(force_on_tool(desk.forces()), glm::dvec3(5, 7, 9));
    // An order to end has no answer, and keeps the latest answer.
    desk.order_end();
    EXPECT_TRUE(desk.answered());
    EXPECT_EQ(force_on_tool(desk.forces()), glm::dvec3(5, 7, 9));
    // What is left in memory belongs to no later tick.
    desk.open(&asked, answers);
    desk.order({0, 0, 0}, 1);
    EXPECT_EQ(desk.tick(), 9U);
    EXPECT_FALSE(desk.answered());
}

TEST(Ticks, AnOrderIsThereWhenAllOfItIs) {
    std::vector<AnswerWords> answers(1);
    OrderWords asked{};
    TickDesk desk;
    desk.open(&asked, answers);
    desk.order({1, -2, 0.5F}, 1000);
    TickOrder order{};
    EXPECT_FALSE(look_for_order(&asked, 2, order));
    ASSERT_TRUE(look_for_order(&asked, 1, order));
    EXPECT_EQ(order.moved, (Vector<float>{1, -2, 0.5F}));
    EXPECT_EQ(order.steps, 1000U);
    EXPECT_EQ(order.tick, 1U);
    for (std::uint64_t& word : asked.word) {
        const std::uint64_t whole = std::exchange(word, tick_word(count_in(word), 0));
        EXPECT_FALSE(look_for_order(&asked, 1, order));
        word = whole;
    }
    desk.order_again();
    ASSERT_TRUE(look_for_order(&asked, 2, order));
    EXPECT_EQ(order.steps, 1000U);
    desk.order_end();
    ASSERT_TRUE(look_for_order(&asked, 3, order));
    EXPECT_EQ(order.steps, 0U);
}

}  // namespace
}  // namespace voxspring::cuda
