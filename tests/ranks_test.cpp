// Ranks as threads: messages, bits, and what happens to a run if a rank fails or hangs.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "backends/device_choice.h"
#include "harness/process/case.h"
#include "harness/process/shared_state.h"
#include "harness/ranks/exchange.h"
#include "harness/ranks/mpi_ranks.h"
#include "harness/ranks/rank_run.h"
#include "harness/ranks/sample.h"
#include "harness/scene/scene_runner.h"
#include "tests/support.h"
#include "tests/surroundings.h"
#include "tests/wrapped_backend.h"

// Sanitizers start threads themselves.
#if !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__) && !defined(__clang__)
#define VOXSPRING_COUNTS_THREADS
/// How many more std::threads may be started; without limit if it is negative.
static std::atomic<int> threads_to_start = -1;

/// Replaces the function of the system.
extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                              void* of) noexcept {
    static const auto start = reinterpret_cast<decltype(&pthread_create)>(dlsym(RTLD_NEXT, "pthread_create"));
    Dl_info from{};
    const bool is_counted = dladdr(reinterpret_cast<void*>(run), &from) != 0 &&
                            std::strstr(from.dli_fname, "libstdc++") != nullptr;  // and not OpenMP
    if (is_counted && threads_to_start == 0) return EAGAIN;
    if (is_counted && threads_to_start > 0) --threads_to_start;
    return start(thread, attributes, run, of);
}
#endif

namespace voxspring::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class Mailrooms : public ::testing::Test {
protected:
    static constexpr std::size_t capacity = 1000;
    static constexpr int ranks = 3;
    static Routes routes() {
        Routes routes(ranks);
        for (int rank = 0; rank + 1 < ranks; ++rank) routes.add(rank, rank + 1, capacity);
        return routes;
    }
    std::vector<Line> memory_{Mailroom::lines(routes())};
    const Mailroom mailroom_{memory_.data(), routes()};
};

TEST_F(Mailrooms, HandMessagesOnInTheirOrder) {
    constexpr int messages = 10000;
    const auto relay = [&](int rank) {
        Exchange exchange(mailroom_, rank);
        for (int i = 0; i < messages; ++i) {
            const int from = rank - 1, to = rank + 1;
            int value = i;
            if (from >= 0) {
                std::memcpy(&value, exchange.inbox(from), sizeof value);
                exchange.release(from);
            }
            if (to < ranks) {
                std::memcpy(exchange.outbox(to, sizeof value), &value, sizeof value);
                exchange.post(to);
            } else {
                ASSERT_EQ(value, i);
            }
        }
    };
    std::vector<std::thread> threads;
    for (int rank = 0; rank < ranks; ++rank) threads.emplace_back(relay, rank);
    for (std::thread& thread : threads) thread.join();
}

TEST_F(Mailrooms, TellEveryRankOfTheFirstFailure) {
    Exchange first(mailroom_, 0), last(mailroom_, 2);
    EXPECT_TRUE(last.fail("rank 2: no more paper"));
    EXPECT_FALSE(first.fail("rank 0: another"));
    EXPECT_EQ(message_of([&] { (void)first.inbox(1); }), "rank 2: no more paper");
}

TEST_F(Mailrooms, WaitNoLongerThanTheirPatience) {
    Exchange exchange(mailroom_, 0);
    exchange.set_patience(std::chrono::milliseconds(50));
    EXPECT_EQ(message_of([&] { meet(exchange); }), "rank 0 waited for rank 1 for 0.05 s");
    EXPECT_TRUE(mailroom_.has_failed());
}

TEST(Routes, GoBothWaysAndFromEachRankToTheNext) {
    Routes routes(4);
    routes.add(3, 0, 100);
    routes.add(0, 3, 40);
    EXPECT_THAT(routes.from(0), ElementsAre(1, 3));
    EXPECT_THAT(routes.from(2), ElementsAre(1, 3));
    EXPECT_EQ(routes.capacities().at({3, 0}), 100u);
    EXPECT_EQ(routes.capacities().at({0, 3}), 40u);
    EXPECT_EQ(routes.capacities().at({1, 2}), 0u);
    EXPECT_EQ(nlohmann::json(routes).get<Routes>().capacities(), routes.capacities());
    std::vector<Line> memory(Mailroom::lines(routes));
    const Mailroom mailroom(memory.data(), routes);
    Exchange one(mailroom, 0), other(mailroom, 3);
    EXPECT_THAT(message_of([&] { (void)one.outbox(3, 41); }), HasSubstr("longer than its mailbox"));
    std::memset(other.outbox(0, 100), 7, 100);
    other.post(0);
    EXPECT_EQ(one.inbox(3)[99], std::byte(7));
}

// --- Runs ------------------------------------------------------------------------------------------------

/// A body with holes, a load, a pinned base and edits.
Scene scene(const VoxelGrid& grid = random_grid({8, 9, 29}, 0.7, 5)) {
    Problem problem = make_lattice_problem(grid, FACE_BITS | EDGE_BITS);
    problem.damping = 0.01;
    problem.gravity = {0, 0, -2e-3};
    problem.time_step = 0.2;
    pin_base(problem);
    State state = random_state(problem, 0.05, 6);
    Scene scene{.name = "test",
                .source = "",
                .description = "",
                .problem = problem,
                .state = std::move(state),
                .edits = {}};
    int step = 0;
    for (SpringEdit& edit : edit_everything(problem, false))
        scene.edits.push_back({step += 3, std::move(edit)});
    return scene;
}

const RankPlan plan{.steps = 20,
                    .repetitions = 2,
                    .start_patience = std::chrono::seconds(10),
                    .patience = std::chrono::seconds(1)};

RankPlan plan_of(glm::ivec3 cut, const std::string& way = "memory") {
    RankPlan cut_so = plan;
    cut_so.way = way;
    cut_so.cut = cut;
    return cut_so;
}
/// Slabs of scene().
RankPlan plan_of(int ranks, const std::string& way = "memory") { return plan_of({1, 1, ranks}, way); }

/// The reports of a run and the state that it leaves.
struct Run {
    std::vector<RankReport> reports;
    State state;
};

Run run_ranks(const std::string& backend, const Scene& scene, const RankPlan& how) {
    Run run{.reports = {}, .state = room_for_state(scene.problem, how)};
    run.reports = run_ranks_as_threads(BackendSpec::parse(backend), scene, how, run.state);
    return run;
}

TEST(RankRuns, GiveTheBitsOfOneRank) {
    const Scene whole = scene();
    const std::string backend = "cpu_parallel:threads=1";
    const std::unique_ptr<Backend> one = BackendSpec::parse(backend).make();
    SceneRunner runner(whole);
    runner.rewind(*one);
    runner.run(*one, plan.steps);
    for (const glm::ivec3 cut : {glm::ivec3(1), {1, 1, 2}, {1, 1, 4}, {1, 3, 1}, {2, 1, 2}, {2, 2, 2}}) {
        const RankPlan of_cut = plan_of(cut);
        const int ranks = of_cut.ranks();
        const auto [reports, state] = run_ranks(backend, whole, of_cut);
        expect_same_bits(state, one->download());
        EXPECT_EQ(reports.size(), std::size_t(ranks));
        std::size_t own = 0;
        for (const RankReport& report : reports) {
            own += report.own;
            ASSERT_EQ(report.batches.size(), 2u);
            const RankBatch& batch = report.batches.back();
            EXPECT_GT(batch.compute, 0);
            EXPECT_LE(batch.compute + batch.exchange + batch.waiting, batch.total);
            EXPECT_EQ(report.latency > 0, ranks > 1);
            EXPECT_EQ(report.border_bytes > 0, ranks > 1);
            EXPECT_EQ(nlohmann::json(nlohmann::json(report).get<RankReport>()), nlohmann::json(report));
        }
        EXPECT_EQ(own, whole.problem.particle_count());
    }
}

/// The state after `steps` steps in float64.
State stepped(const Scene& scene, int steps) {
    const std::unique_ptr<Backend> backend = BackendSpec::parse("cpu_reference").make();
    SceneRunner runner(scene);
    runner.rewind(*backend);
    runner.run(*backend, steps);
    return backend->download();
}

/// Bodies that are longest along z, x or y. Only the samples across z follow each other in a list.
const std::vector<glm::ivec3> longest_along_each = {{8, 9, 29}, {29, 8, 9}, {8, 29, 9}};

void expect_samples_depend_on_layers_around(const Scene& whole) {
    constexpr int layers = 3, steps = 5;
    ASSERT_EQ(Sample::refusal(whole, layers), "");
    ASSERT_LT(whole.edits.front().step, steps);
    const State expected = stepped(whole, steps);
    const std::vector<Decomposition::Brick> bricks = Sample::bricks(whole, layers);
    ASSERT_EQ(bricks.size(), 3u);
    std::vector<std::uint32_t> particles;
    for (const Decomposition::Brick& brick : bricks) {
        const Sample sample(whole, brick, steps);
        EXPECT_LT(sample.around.problem.particle_count(), whole.problem.particle_count());
        const State of_sample = part_of(expected, sample.particle);
        expect_same_bits(part_of(stepped(sample.around, steps), sample.in_around), of_sample);
        const Sample narrow(whole, brick, 1);
        EXPECT_NE(part_of(stepped(narrow.around, steps), narrow.in_around).displacement,
                  of_sample.displacement);
        particles.insert(particles.end(), sample.particle.begin(), sample.particle.end());
    }
    std::sort(particles.begin(), particles.end());
    // The layers beside a brick may have particles that no spring can join to it. They belong to the list,
    // but to no Sample.
    const std::vector<std::uint32_t> all = Sample::particles(whole.problem, bricks);
    EXPECT_TRUE(std::is_sorted(all.begin(), all.end()));
    EXPECT_EQ(std::adjacent_find(all.begin(), all.end()), all.end()) << "each once";
    EXPECT_TRUE(std::includes(all.begin(), all.end(), particles.begin(), particles.end()));
    for (const std::uint32_t i : all) {
        const glm::ivec3 at = whole.problem.lattice.coordinates(whole.problem.lattice.voxel[i]);
        EXPECT_TRUE(std::any_of(bricks.begin(), bricks.end(), [&](const Decomposition::Brick& brick) {
            return glm::all(glm::greaterThanEqual(at, brick.begin - 1)) &&
                   glm::all(glm::lessThanEqual(at, brick.end));
        })) << to_string(at);
    }
    EXPECT_THAT(Sample::refusal(whole, 9), HasSubstr("take 31 layers, and the body has 29"));
}
TEST(Samples, DependOnTheLayersAroundThemAndOnNothingElse) {
    for (const glm::ivec3 dims : longest_along_each) {
        SCOPED_TRACE(to_string(dims));
        expect_samples_depend_on_layers_around(scene(random_grid(dims, 0.7, 5)));
    }
}

void expect_ranks_leave_the_sample(const Scene& whole) {
    const std::string backend = "cpu_parallel:threads=1";
    const State all = run_ranks(backend, whole, plan_of(1)).state;
    for (const glm::ivec3 cut : {glm::ivec3(1), {1, 1, 3}, {2, 1, 2}}) {
        RankPlan sampling = plan_of(cut);
        sampling.sampled = Sample::bricks(whole, 2);
        EXPECT_EQ(nlohmann::json(nlohmann::json(sampling).get<RankPlan>()), nlohmann::json(sampling));
        const State state = run_ranks(backend, whole, sampling).state;
        expect_same_bits(state, part_of(all, Sample::particles(whole.problem, sampling.sampled)));
        std::vector<std::uint32_t> places;
        for (int rank = 0; rank < sampling.ranks(); ++rank) {
            const auto of_rank = places_of_rank(whole.problem, sampling, rank);
            places.insert(places.end(), of_rank.begin(), of_rank.end());
        }
        std::sort(places.begin(), places.end());
        EXPECT_EQ(places.size(), state.displacement.size());
        EXPECT_EQ(std::unique(places.begin(), places.end()), places.end()) << "each has its own";
    }
}
TEST(RankRuns, LeaveTheStateOfASample) {
    for (const glm::ivec3 dims : longest_along_each) {
        SCOPED_TRACE(to_string(dims));
        expect_ranks_leave_the_sample(scene(random_grid(dims, 0.7, 5)));
    }
}

TEST(RankRuns, RefuseEditsBeyondTheLattice) {
    Scene whole = scene();
    EXPECT_EQ(cut_refusal(whole, {1, 1, 4}), "");
    EXPECT_THAT(cut_refusal(whole, {9, 1, 1}), HasSubstr("8 layers"));
    Problem edited = problem_after(whole, 1000);
    SpringEditor editor(edited);
    const std::vector<std::pair<std::uint32_t, std::uint32_t>> ends = {{0, 100}};
    whole.edits.push_back({50, editor.suture(ends)});
    EXPECT_THAT(cut_refusal(whole, {1, 1, 2}), HasSubstr("suture after step 50"));
}

/// Borders in one process that behave as those of devices, and check the order of calls that DeviceBorders
/// requires.
class FakeBorders final : public DeviceBorders {
public:
    FakeBorders(Backend& of, const std::vector<SharedParticles>& borders, bool refuses) : refuses_(refuses) {
        for (const SharedParticles& shared : borders) {
            Link& link = links_.emplace_back();
            link.part = shared.part;
            link.sent = of.borders()->border(shared.sent);
            link.received = of.borders()->border(shared.received);
            link.own = std::make_shared<BorderInbox>();
        }
    }
    std::size_t bytes() const override {
        std::size_t bytes = 0;
        for (const Link& link : links_) bytes += link.sent->bytes();
        return bytes;
    }
    void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) override {
        if (refuses_ && part == 1) throw Unavailable("there is no way");
        if (std::exchange(connected_, true)) throw std::logic_error("connected twice");
        for (Link& link : links_) {
            for (const Link& back : dynamic_cast<FakeBorders&>(*parts.at(std::size_t(link.part))).links_) {
                if (back.part == int(part)) link.theirs = back.own;
            }
        }
    }
    void take_over(DeviceBorders& before) override {
        if (connected_ || !dynamic_cast<FakeBorders&>(before).connected_)
            throw std::logic_error("taken over when it is connected, or from what is not");
        ++taken_over;
    }
    void disconnect() override { ++disconnected; }
    /// Counts over all borders.
    static inline std::atomic<int> taken_over = 0, disconnected = 0;

    /// Whether everything that these borders await has been sent.
    bool is_here() const {
        return std::all_of(links_.begin(), links_.end(),
                           [&](const Link& link) { return link.own->sent > received_; });
    }
    void send() override {
        ++sent_;
        for (Link& link : links_) {
            BorderInbox& to = *link.theirs;
            if (to.taken + 2 < sent_) throw std::logic_error("a message is replaced before it was taken");
            to.messages[sent_ % 2].resize(link.sent->bytes());
            link.sent->read(to.messages[sent_ % 2].data());
            to.sent = sent_;
        }
    }
    void receive() override {
        ++received_;
        for (Link& link : links_) {
            if (link.own->sent < received_) throw std::logic_error("a message is taken before it was sent");
            link.received->write(link.own->messages[received_ % 2].data());
            link.own->taken = received_;
        }
    }

private:
    /// The inbox for messages.
    struct BorderInbox {
        std::array<std::vector<std::byte>, 2> messages;
        std::atomic<int> sent = 0, taken = 0;
    };
    struct Link {
        int part = 0;
        std::unique_ptr<Border> sent, received;
        std::shared_ptr<BorderInbox> own, theirs;
    };

    const bool refuses_;
    bool connected_ = false;
    std::vector<Link> links_;
    int sent_ = 0, received_ = 0;
};

/// A cpu_reference in place of a backend with devices.
class Wrapped : public MonitoredBackend {
public:
    Capabilities capabilities() const override {
        Capabilities all = MonitoredBackend::capabilities();
        all.border_ways = {"peer", "stores"};
        return all;
    }
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& borders,
                                                  const std::string& way) override {
        return std::make_shared<FakeBorders>(inner(), borders, way == "stores");
    }
};

/// Does what its name says in the tenth step, on every rank that does not have the lowest layer.
class Faulty final : public Wrapped {
public:
    explicit Faulty(std::string what) : what_(std::move(what)) {}
    Capabilities capabilities() const override {
        Capabilities all = Wrapped::capabilities();
        all.has_borders = what_ != "without";
        return all;
    }

private:
    void begin(const Problem& problem, const State& state) override {
        is_first_ = problem.rest_position.front().z == 0;
        Wrapped::begin(problem, state);
        if (what_ != "fails") return;
        if (is_first_) throw DeviceError("out of memory");
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        throw Unavailable("there is no device");
    }
    void integrate(int count) override {
        Wrapped::integrate(count);
        if (is_first_ || ++steps_ != 10) return;
        if (what_ == "throws") throw DeviceError("the device is lost");
        for (;;) pause();
    }

    const std::string what_;
    bool is_first_ = false;
    int steps_ = 0;
};

/// A backend on one of two devices, which keeps its start there.
class Numbered final : public Wrapped {
public:
    bool keep_start() override { return keeps_start_ = true; }
    void rewind() override { Wrapped::begin(*problem_, start_); }
    Capabilities capabilities() const override {
        Capabilities all = Wrapped::capabilities();
        all.uuid = std::to_string(device_);
        return all;
    }

private:
    void begin(const Problem& problem, const State& state) override {
        // A backend that keeps its start on the device must not get another upload.
        if (keeps_start_) throw std::logic_error("uploaded though the start was kept");
        problem_ = &problem;
        start_ = state;
        Wrapped::begin(problem, state);
    }

    const Problem* problem_ = nullptr;
    State start_;
    bool keeps_start_ = false;
    const int device_ = DeviceOfThread::now().among(2, "test");
};

/// Keeps its start only on the rank that has the lowest layer, as if other devices had too little memory.
class Forgetful final : public Wrapped {
public:
    bool keep_start() override { return problem_->rest_position.front().z == 0; }
    void rewind() override { Wrapped::begin(*problem_, start_); }

private:
    void begin(const Problem& problem, const State& state) override {
        problem_ = &problem;
        start_ = state;
        Wrapped::begin(problem, state);
    }

    const Problem* problem_ = nullptr;
    State start_;
};

/// Records on which devices this thread has made such backends, in order.
class Placed final : public Wrapped {
public:
    Placed() { devices.push_back(DeviceOfThread::now().among(4, "test")); }
    static inline thread_local std::vector<int> devices;
};

const Registered backends[] = {
    registered_as<Placed>("rank_placed"),           registered_as<Numbered>("rank_numbered"),
    registered_as<Faulty>("rank_throws", "throws"), registered_as<Faulty>("rank_fails", "fails"),
    registered_as<Faulty>("rank_hangs", "hangs"),   registered_as<Faulty>("rank_without", "without"),
    registered_as<Forgetful>("rank_forgetful")};

/// Borders that a simulated device exchanges, which waits for its neighbours: `within_steps`, or after a step
/// without its host.
class BordersInSteps final : public DeviceBorders {
public:
    BordersInSteps(std::shared_ptr<DeviceBorders> of, bool within_steps)
        : inner_(std::move(of)), within_steps_(within_steps) {}
    std::size_t bytes() const override { return inner_->bytes(); }
    void connect(const std::vector<std::shared_ptr<DeviceBorders>>& parts, std::size_t part) override {
        std::vector<std::shared_ptr<DeviceBorders>> inner;
        for (const auto& other : parts) inner.push_back(dynamic_cast<BordersInSteps&>(*other).inner_);
        inner_->connect(inner, part);
    }
    int steps_per_call() const override { return within_steps_ ? 3 : 0; }
    bool waits_on_device() const override { return !within_steps_; }
    void send() override {
        if (within_steps_) throw std::logic_error("sent between steps");
    }
    void receive() override {
        if (within_steps_) throw std::logic_error("received between steps");
        exchange();
    }

    void exchange() {
        inner_->send();
        while (!dynamic_cast<FakeBorders&>(*inner_).is_here()) std::this_thread::yield();
        inner_->receive();
    }

private:
    const std::shared_ptr<DeviceBorders> inner_;
    const bool within_steps_;
};

/// Its edits take long on one rank; meanwhile no other rank may be in the steps after them. Another rank is
/// late for its steps; no rank may edit before it has begun them, since an edit may wait for everything on a
/// device. Getting ready for steps with exchanges is such work as an edit.
class WithinSteps final : public Wrapped {
public:
    explicit WithinSteps(bool within_steps) : within_steps_(within_steps) {
        const std::lock_guard lock(mutex_);
        all_.push_back(this);
    }
    ~WithinSteps() override {
        const std::lock_guard lock(mutex_);
        std::erase(all_, this);
    }
    Capabilities capabilities() const override {
        Capabilities all = Wrapped::capabilities();
        all.has_borders = false;
        all.border_ways = {"stores"};
        return all;
    }
    std::shared_ptr<DeviceBorders> device_borders(const std::vector<SharedParticles>& borders,
                                                  const std::string&) override {
        borders_ = std::make_shared<BordersInSteps>(Wrapped::device_borders(borders, "peer"), within_steps_);
        return borders_;
    }
    bool prepare_exchanges(DeviceBorders& borders, int count) override {
        if (!borders.waits_on_device() || count < 2) return false;
        alone([] {});
        return true;
    }
    void step_and_exchange(DeviceBorders& borders, int count) override {
        replays_ = true;
        ++replayed;
        step(count);
        replays_ = false;
        static_cast<void>(borders);
    }
    /// Counts calls of step_and_exchange() over all ranks.
    static inline std::atomic<int> replayed = 0;
    void edit(const Problem& edited, const SpringEdit& edit) override {
        if (edit.empty()) throw std::logic_error("an edit of nothing");
        alone([&] { Wrapped::edit(edited, edit); });
    }

private:
    /// Does work that no rank may do while another steps.
    void alone(const std::function<void()>& work) {
        {
            const std::lock_guard lock(mutex_);
            for (const WithinSteps* other : all_) {
                if (other->calls_ < calls_) throw std::logic_error("a rank had yet to step");
            }
        }
        edits_ = true;
        if (is_first_) std::this_thread::sleep_for(std::chrono::milliseconds(5));
        work();
        edits_ = false;
    }
    void begin(const Problem& problem, const State& state) override {
        is_first_ = problem.rest_position.front().z == 0;
        is_last_ = problem.rest_position.back().z == 28;
        Wrapped::begin(problem, state);
    }
    void integrate(int count) override {
        if (is_last_) std::this_thread::sleep_for(std::chrono::milliseconds(2));
        ++calls_;
        {
            const std::lock_guard lock(mutex_);
            for (const WithinSteps* other : all_) {
                if (other->edits_ && other->calls_ < calls_) throw std::logic_error("a rank was not ready");
            }
        }
        for (int n = 0; n < count; ++n) {
            Wrapped::integrate(1);
            if (borders_ && (within_steps_ || replays_)) borders_->exchange();
        }
    }

    inline static std::mutex mutex_;
    inline static std::vector<const WithinSteps*> all_;
    const bool within_steps_;
    bool replays_ = false;
    std::shared_ptr<BordersInSteps> borders_;
    bool is_first_ = false, is_last_ = false;
    std::atomic<bool> edits_ = false;
    std::atomic<int> calls_ = 0;
};

const Registered within_steps[] = {registered_as<WithinSteps>("rank_within_steps", true),
                                   registered_as<WithinSteps>("rank_replays", false)};

/// Records the largest number of steps in one call, over all ranks.
class Counting final : public Wrapped {
public:
    static inline std::atomic<int> most = 0;

private:
    void integrate(int count) override {
        for (int seen = most; seen < count && !most.compare_exchange_weak(seen, count);) {
        }
        Wrapped::integrate(count);
    }
};

const Registered counting = registered_as<Counting>("rank_counting");

/// The error with which a run of two ranks ends; it has to end within seconds.
std::string error_of(const std::string& backend, const std::string& way = "memory") {
    // A hanging thread reads the scene until the process ends.
    static const Scene whole = scene();
    const auto begin = std::chrono::steady_clock::now();
    const std::string message = message_of([&] { (void)run_ranks(backend, whole, plan_of(2, way)); });
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
    return message;
}

// As in MPI's workers: if a process took the first device first, it would leave a context of each rank there.
TEST(RanksInProcessesOfTheirOwn, MakeEveryBackendOnTheirDevice) {
    const Scene whole = scene();
    for (const std::vector<int>& devices : {std::vector<int>{}, {3, 2}}) {
        RankTask task{.scene = whole.name,
                      .fingerprint = "",
                      .backend = "rank_placed",
                      .plan = plan_of(2),
                      .routes = routes_of(Decomposition(whole.problem, {1, 1, 2}))};
        task.plan.devices = devices;
        const SharedMemory mailroom = SharedMemory::of_bytes(Mailroom::lines(task.routes) * sizeof(Line));
        std::vector<std::vector<int>> found(2);
        const auto run = [&](int rank) {
            SharedState shared(whole.problem.particle_count());
            const CaseProgram program = rank_program(task, rank, mailroom, &shared);
            const auto answerer =
                case_answerer(case_description(BackendSpec::parse(task.backend), program), &whole);
            for (const char* question : {"construct", "prepare", "run"})
                (void)answerer({{"do", question}}, {});
            found[std::size_t(rank)] = std::exchange(Placed::devices, {});
        };
        std::thread other(run, 1);
        run(0);
        other.join();
        const int first = devices.empty() ? 0 : 3, second = devices.empty() ? 1 : 2;
        EXPECT_THAT(found[0], ElementsAre(first, first));
        EXPECT_THAT(found[1], ElementsAre(second, second));
    }
    EXPECT_EQ(DeviceOfThread::now().number, 0) << "as before";
}

TEST(RankRuns, EndWhereARankFails) {
    FakeBorders::disconnected = 0;
    for (const char* way : {"memory", "peer"})
        EXPECT_EQ(error_of("rank_throws", way), "rank 1: the device is lost");
    EXPECT_EQ(FakeBorders::disconnected, 0);
}

// A study would skip the case, and end with exit code 0.
TEST(RankRuns, ThatFailAreNotUnavailableBecauseALaterRankIs) {
    const Scene whole = scene();
    try {
        (void)run_ranks("rank_fails", whole, plan_of(2));
        ADD_FAILURE() << "nothing was thrown";
    } catch (const Unavailable& reason) {
        ADD_FAILURE() << "unavailable: " << reason.what();
    } catch (const std::runtime_error& error) {
        EXPECT_STREQ(error.what(), "rank 0: out of memory");
    }
}

#ifdef VOXSPRING_COUNTS_THREADS
TEST(RankRuns, EndWhereTheSystemStartsNoFurtherThread) {
    for (const int started : {0, 1}) {
        threads_to_start = started;
        const std::string message = error_of("cpu_reference");
        threads_to_start = -1;
        EXPECT_THAT(message,
                    HasSubstr("rank " + std::to_string(started) + ": its thread could not be started: "));
    }
}
#endif

TEST(RankRuns, EndWhereARankHangs) {
    for (const char* way : {"memory", "peer"})
        EXPECT_EQ(error_of("rank_hangs", way), "rank 0 waited for rank 1 for 1 s");
}

TEST(RankRuns, GiveTheBitsOfOneRankFromDeviceToDevice) {
    for (const bool edited : {false, true}) {
        Scene whole = scene();
        if (!edited) whole.edits.clear();
        // One rank has nothing to send.
        const State one = run_ranks("rank_numbered", whole, plan_of(1, "peer")).state;
        for (const glm::ivec3 cut : {glm::ivec3(1, 1, 2), {1, 1, 3}, {1, 1, 4}, {2, 1, 2}, {2, 2, 2}}) {
            FakeBorders::taken_over = FakeBorders::disconnected = 0;
            const auto [reports, state] = run_ranks("rank_numbered", whole, plan_of(cut, "peer"));
            expect_same_bits(state, one);
            const int ranks = int(reports.size());
            // With edits each repetition uploads again, and so does the one that measures the parts.
            EXPECT_EQ(FakeBorders::taken_over, edited ? (plan.repetitions + 1) * ranks : 0);
            EXPECT_EQ(FakeBorders::disconnected, ranks);
            for (const RankReport& report : reports) {
                ASSERT_EQ(report.batches.size(), std::size_t(plan.repetitions));
                for (const RankBatch& batch : report.batches) {
                    EXPECT_GT(batch.total, 0);
                    EXPECT_GT(batch.compute, 0);
                    EXPECT_GT(batch.exchange, 0);
                    EXPECT_EQ(batch.waiting, 0);
                }
                EXPECT_GT(report.latency, 0);
                EXPECT_GT(report.border_bytes, 0u);
            }
        }
    }
}

// If some ranks uploaded again and others did not, they would no longer exchange the same borders.
TEST(RankRuns, KeepTheStartOnAllDevicesOrOnNone) {
    Scene whole = scene();
    whole.edits.clear();
    const State one = run_ranks("rank_numbered", whole, plan_of(1)).state;
    for (const char* way : {"memory", "peer"}) {
        FakeBorders::taken_over = 0;
        expect_same_bits(run_ranks("rank_forgetful", whole, plan_of(3, way)).state, one);
        EXPECT_EQ(FakeBorders::taken_over, way == std::string("peer") ? (plan.repetitions + 1) * 3 : 0);
    }
}

// Some edits touch only the first part: all ranks stop at the same steps.
TEST(RankRuns, GiveTheBitsOfOneRankWhereBordersTravelWithinSteps) {
    Scene whole = scene();
    const int last = whole.edits.back().step + 1;
    ASSERT_LT(last, plan.steps);
    Problem edited = problem_after(whole, last);
    const Spring lowest = list_springs(edited).front();
    SpringEditor editor(edited);
    const std::vector<std::pair<std::uint32_t, std::uint32_t>> ends = {{lowest.first, lowest.second}};
    whole.edits.push_back({last, editor.cut(ends)});
    const State one = run_ranks("rank_within_steps", whole, plan_of(1, "stores")).state;
    for (int ranks = 2; ranks <= 4; ++ranks) {
        const auto [reports, state] = run_ranks("rank_within_steps", whole, plan_of(ranks, "stores"));
        for (const RankReport& report : reports) {
            ASSERT_EQ(report.batches.size(), std::size_t(plan.repetitions));
            EXPECT_GT(report.batches.back().compute, 0);
            EXPECT_EQ(report.batches.back().exchange, 0);
            EXPECT_EQ(report.latency, 0);
            EXPECT_GT(report.border_bytes, 0u);
        }
        expect_same_bits(state, one);
    }
    EXPECT_THAT(error_of("rank_within_steps", "peer"), HasSubstr("it cannot exchange borders by peer"));
    for (const char* backend : {"rank_within_steps", "rank_without"})
        EXPECT_THAT(error_of(backend), HasSubstr("it cannot exchange borders"));
}

TEST(RankRuns, GiveTheBitsOfOneRankWhereDevicesWaitForEachOther) {
    Scene whole = scene();
    whole.edits.clear();
    const State one = run_ranks("rank_replays", whole, plan_of(1, "stores")).state;
    for (int ranks = 2; ranks <= 4; ++ranks) {
        WithinSteps::replayed = 0;
        const auto [reports, state] = run_ranks("rank_replays", whole, plan_of(ranks, "stores"));
        // All repetitions but the one that measures the parts.
        EXPECT_EQ(WithinSteps::replayed, (plan.repetitions + 1) * ranks);
        for (const RankReport& report : reports) {
            ASSERT_EQ(report.batches.size(), std::size_t(plan.repetitions));
            EXPECT_GT(report.batches.back().compute, 0);
            EXPECT_GT(report.batches.back().exchange, 0);
            EXPECT_GT(report.latency, 0);
        }
        expect_same_bits(state, one);
    }
}

// Two bodies in one lattice: the last of three ranks has the second one.
TEST(RankRuns, MayHaveARankWithoutBorders) {
    Scene whole = scene(make_grid({8, 9, 29}, [](int, int, int z) { return z == 18 || z == 19 ? 0 : 1; }));
    whole.edits.clear();
    ASSERT_TRUE(Decomposition(whole.problem, {1, 1, 3}).subdomain(whole.problem, 2).borders.empty());
    for (const char* way : {"memory", "peer", "stores"}) {
        const std::string backend = way == std::string("stores") ? "rank_replays" : "rank_numbered";
        const State one = run_ranks(backend, whole, plan_of(1)).state;
        expect_same_bits(run_ranks(backend, whole, plan_of(3, way)).state, one);
    }
}

TEST(RankRuns, SayWhyDevicesHaveNoWayToEachOther) {
    const Scene whole = scene();
    EXPECT_THAT([&] { (void)run_ranks("rank_numbered", whole, plan_of(3, "stores")); },
                ThrowsMessage<Unavailable>("rank 1: there is no way"));
}

/// Which devices three ranks take.
std::vector<std::string> devices_of(const std::vector<int>& asked) {
    static const Scene whole = scene();
    RankPlan on_devices = plan_of(3);
    on_devices.devices = asked;
    std::vector<std::string> taken;
    for (const RankReport& report : run_ranks("rank_numbered", whole, on_devices).reports)
        taken.push_back(report.uuid);
    return taken;
}

TEST(RankRuns, KnowHowManyRanksShareADevice) {
    RankPlan on_devices = plan_of(3);
    EXPECT_EQ(on_devices.device_of(2).parts_among(2), 2);
    on_devices.devices = {0, 1};
    EXPECT_EQ(on_devices.device_of(2).parts_among(2), 2);
    EXPECT_EQ(on_devices.device_of(1).parts_among(2), 1);
    on_devices.devices = {0, 0};
    on_devices.cut = {2, 1, 1};
    EXPECT_EQ(on_devices.device_of(1).parts_among(2), 2);
}

TEST(RankRuns, SayWhichRanksAreOnOtherDevices) {
    const RankReport one{.device = "a card", .uuid = "1"}, alike{.device = "a card", .uuid = "2"},
        other{.device = "another card", .uuid = "3"};
    EXPECT_EQ(different_devices({one, alike}), "");
    EXPECT_EQ(
        different_devices({one, alike, other}),
        "rank 0 has a card, rank 2 has another card: ranks on devices of different names are not measured "
        "together");
    EXPECT_EQ(nlohmann::json(other).get<RankReport>().device, "another card");
    EXPECT_EQ(nlohmann::json(other).get<RankReport>().uuid, "3");
}

TEST(RankRuns, TakeTheDevicesThatAreAskedForOverAndOver) {
    using Devices = std::vector<std::string>;
    EXPECT_EQ(devices_of({}), (Devices{"0", "1", "0"}));
    EXPECT_EQ(devices_of({1, 0}), (Devices{"1", "0", "1"}));
    EXPECT_EQ(devices_of({1}), (Devices{"1", "1", "1"}));
    EXPECT_THAT(
        [] {
            (void)devices_of({0, 1, 2});
        },
        ThrowsMessage<Unavailable>("rank 2: no test device 2: there are devices 0 to 1"));
}

// The single rank that several are compared with must not be slowed by exchanges, of which it has none.
TEST(RankRuns, OfOneRankStepAsManyAtOnceAsTheyAreAskedFor) {
    Scene whole = scene();
    whole.edits.clear();
    (void)run_ranks("rank_counting", whole, plan_of(1));
    // A check for divergence lies between.
    EXPECT_GT(Counting::most, 1);
    Counting::most = 0;
    (void)run_ranks("rank_counting", whole, plan_of(2));
    EXPECT_EQ(Counting::most, 1);
}

}  // namespace
}  // namespace voxspring::testing
