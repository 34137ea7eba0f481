#include "harness/ranks/rank_run.h"

#include <omp.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

#include "harness/device/card.h"
#include "harness/device/noise.h"
#include "harness/ranks/sample.h"
#include "harness/scene/scene_runner.h"
#include "harness/verification/divergence.h"

namespace voxspring {
namespace {

/// The seconds that one call of `action` takes. All ranks repeat this call at the same time. The fastest of
/// several batches counts, since other activity of the machine only adds time.
double seconds_of(Exchange& exchange, RankBackend& backend, const std::function<void()>& action) {
    constexpr int batches = 10, rounds = 20;
    double least = std::numeric_limits<double>::infinity();
    for (int batch = 0; batch < batches; ++batch) {
        meet(exchange);
        const auto begin = Clock::now();
        for (int round = 0; round < rounds; ++round) action();
        backend.synchronize();
        least = std::min(least, seconds_since(begin) / rounds);
    }
    return least;
}

/// Copies the state of a rank's particles to their places in `left`, the final state of the run. If
/// plan.sampled is not empty, `left` has only the sampled particles.
void leave(const Subdomain& subdomain, const State& state, const Problem& whole, const RankPlan& plan,
           State& left) {
    if (plan.sampled.empty()) return subdomain.copy_own(state, left);
    const std::vector<std::uint32_t> sampled = Sample::particles(whole, plan.sampled);
    auto place = sampled.begin();
    for (const std::uint32_t i : subdomain.own) {
        while (place != sampled.end() && *place < subdomain.particle[i]) ++place;
        if (place == sampled.end()) return;
        if (*place != subdomain.particle[i]) continue;
        left.displacement[std::size_t(place - sampled.begin())] = state.displacement[i];
        left.increment[std::size_t(place - sampled.begin())] = state.increment[i];
    }
}

/// A lock that a rank holds while it needs much temporary memory, above all a state in float64: there may be
/// memory for only one rank of this process at a time. For a small scene the lock is empty.
std::unique_lock<std::mutex> turn_of_rank(const Scene& scene) {
    static std::mutex turns;
    return is_heavy(scene) ? std::unique_lock(turns) : std::unique_lock<std::mutex>();
}

/// Measures exchanges of borders. Must be called before the first step: the ghosts then equal the borders
/// that are written to them, so that no bit changes.
void measure_exchange(Exchange& exchange, RankBackend& backend, RankReport& report) {
    report.border_bytes = backend.border_bytes();
    if (exchange.ranks() == 1 || backend.exchanges_in_steps()) return;
    const std::vector<int> neighbours = backend.neighbours();
    report.latency = seconds_of(exchange, backend, [&] { greet(exchange, neighbours); });
    const double with_borders = seconds_of(exchange, backend, [&] { backend.exchange_borders(); });
    if (report.border_bytes > 0)
        report.seconds_per_byte = std::max(0.0, with_borders - report.latency) / double(report.border_bytes);
}

/// Notes the clock and the other users of a rank's card after each batch.
class WatchedCard {
public:
    /// If there is no card with this UUID, or if it cannot be watched, look() reports nothing.
    explicit WatchedCard(const std::string& uuid) {
        if (uuid.empty()) return;
        try {
            card_.emplace(uuid);
        } catch (const std::runtime_error&) {
            // The study's result gives the reason once, for the first card.
        }
    }
    /// Must be called right after a batch, before the card's clock falls.
    void look(RankReport& report) const {
        if (!card_) return;
        if (const auto mhz = card_->clock_mhz()) report.card_mhz.push_back(*mhz);
        if (const auto processes = card_->processes())
            report.other_users.push_back(other_processes(*processes, {.all = {getpid()}, .on_card = 1}));
    }

private:
    std::optional<Card> card_;
};

/// Data that the threads of one run share. It lives as long as the last of these threads.
struct Together {
    BackendSpec spec;
    const Scene& scene;
    RankPlan plan;
    std::vector<Line> memory;
    Mailroom mailroom;
    std::vector<RankReport> reports;
    State left;
    PartsOnDevices parts;
    std::mutex mutex = {};
    std::condition_variable changed = {};
    int at_work = 0;
    std::atomic<bool> unavailable = false;  ///< whether the first failure was Unavailable
};

void run_as_thread(const std::shared_ptr<Together>& all, int rank) {
    Exchange exchange(all->mailroom, rank);
    // Backends copy with all OpenMP threads: each rank gets its share of them.
    omp_set_num_threads(std::max(1, omp_get_max_threads() / exchange.ranks()));
    try {
        all->reports[std::size_t(rank)] =
            run_rank(all->spec, all->scene, all->plan, exchange, all->left, &all->parts);
    } catch (const Unavailable& error) {
        // The caller reads this once all threads have ended, or else a second after the failure.
        if (exchange.fail("rank " + std::to_string(rank) + ": " + error.what())) all->unavailable = true;
    } catch (const std::exception& error) {
        exchange.fail("rank " + std::to_string(rank) + ": " + error.what());
    }
    const std::lock_guard lock(all->mutex);
    --all->at_work;
    all->changed.notify_all();
}

/// Starts one thread per rank. If the system refuses a thread, the run has failed, and the threads already
/// started end as after any rank's failure. Until they end they use the caller's scene.
void start_threads(const std::shared_ptr<Together>& all) {
    for (int rank = 0, ranks = all->at_work; rank < ranks; ++rank) {
        try {
            std::thread(run_as_thread, all, rank).detach();
        } catch (const std::system_error& error) {
            all->mailroom.fail("rank " + std::to_string(rank) +
                               ": its thread could not be started: " + error.what());
            const std::lock_guard lock(all->mutex);
            all->at_work -= ranks - rank;
            return;
        }
    }
}

/// Waits for all threads. Once a rank has failed, the others get one second to end.
void wait_for(Together& all) {
    constexpr Seconds between_looks(0.05), grace(1);
    std::unique_lock lock(all.mutex);
    const auto done = [&] { return all.at_work == 0; };
    while (!done() && !all.mailroom.has_failed()) all.changed.wait_for(lock, between_looks, done);
    all.changed.wait_for(lock, grace, done);
}

}  // namespace

DeviceNumber RankPlan::device_of(int rank) const {
    if (devices.empty()) return {.number = rank, .wraps = true, .parts = ranks()};
    const auto number_of = [&](int other) { return devices[std::size_t(other) % devices.size()]; };
    int parts = 0;
    for (int other = 0; other < ranks(); ++other) parts += number_of(other) == number_of(rank) ? 1 : 0;
    return {.number = number_of(rank), .wraps = false, .parts = parts};
}

DeviceNumber RankPlan::first_device() const {
    DeviceNumber first = device_of(0);
    first.parts = 1;
    return first;
}

std::string different_devices(const std::vector<RankReport>& reports) {
    const auto other = std::find_if(reports.begin(), reports.end(), [&](const RankReport& report) {
        return report.device != reports.front().device;
    });
    if (other == reports.end()) return {};
    return "rank 0 has " + reports.front().device + ", rank " + std::to_string(other - reports.begin()) +
           " has " + other->device + ": ranks on devices of different names are not measured together";
}

std::string cut_refusal(const Scene& scene, glm::ivec3 cut) {
    if (std::string reason = Decomposition::refusal(scene.problem, cut); !reason.empty()) return reason;
    for (const ScheduledEdit& scheduled : scene.edits) {
        if (scheduled.edit.leaves_lattice())
            return "a part knows one layer of voxels of its neighbours, and a suture after step " +
                   std::to_string(scheduled.step) + " reaches farther";
    }
    return {};
}

Routes routes_of(const Decomposition& decomposition) {
    // In float64 a position is three numbers, and three more in the formulation `compensated`.
    constexpr std::size_t bytes_of_place = 6 * sizeof(double);
    Routes routes(decomposition.count());
    for (int from = 0; from < decomposition.count(); ++from) {
        for (int to = 0; to < decomposition.count(); ++to) {
            const std::size_t places = decomposition.most_sent(from, to);
            if (places > 0) routes.add(from, to, places * bytes_of_place);
        }
    }
    return routes;
}

State room_for_state(const Problem& problem, const RankPlan& plan) {
    if (plan.sampled.empty()) return state_at_rest(problem);
    const std::vector<glm::dvec3> none(Sample::particles(problem, plan.sampled).size());
    return {none, none};
}

std::vector<std::uint32_t> places_of_rank(const Problem& problem, const RankPlan& plan, int rank) {
    std::vector<std::uint32_t> own = Decomposition(problem, plan.cut).own(problem, rank);
    if (plan.sampled.empty()) return own;
    const std::vector<std::uint32_t> sampled = Sample::particles(problem, plan.sampled);
    std::vector<std::uint32_t> places;
    for (std::size_t n = 0; n < sampled.size(); ++n) {
        if (std::binary_search(own.begin(), own.end(), sampled[n])) places.push_back(std::uint32_t(n));
    }
    return places;
}

RankReport run_rank(const BackendSpec& spec, const Scene& scene, const RankPlan& plan, Exchange& exchange,
                    State& left, PartsOnDevices* parts) {
    std::unique_lock<std::mutex> turn = turn_of_rank(scene);
    Subdomain subdomain = Decomposition(scene.problem, plan.cut).subdomain(scene.problem, exchange.rank());
    Scene part = part_of(scene, subdomain);
    const DeviceOfThread device(plan.device_of(exchange.rank()));
    const std::unique_ptr<Backend> inner = spec.make();
    // A single rank has no borders.
    const bool by_device = plan.way != "memory" && exchange.ranks() > 1;
    if (by_device && parts == nullptr)
        throw std::logic_error("only ranks of one process can exchange borders by " + plan.way);
    RankBackend backend(*inner, subdomain, exchange, plan.way, by_device ? parts : nullptr);
    SceneRunner runner(part);
    if (const std::string reason = runner.unsupported(backend); !reason.empty()) throw Unavailable(reason);
    const DivergenceMonitor monitor = divergence_monitor(scene, plan.steps);
    backend.monitor(monitor);

    RankReport report{.own = subdomain.own.size(),
                      .ghosts = subdomain.particle.size() - subdomain.own.size(),
                      .device = backend.capabilities().device,
                      .uuid = backend.capabilities().uuid};
    runner.rewind(backend);
    turn = {};
    const WatchedCard card(report.uuid);
    exchange.set_patience(plan.start_patience);
    meet(exchange);
    // Ranks connect after an upload, so all of them must upload at the same points. With edits one rank might
    // keep its start while another cannot, since edits may cancel in one subdomain only. So the start is kept
    // only without edits. It is kept after all uploads, which may share a device and need the memory more.
    if (scene.edits.empty() && runner.keep_start(backend)) part.state = {};
    backend.connect();
    meet(exchange);
    exchange.set_patience(plan.patience);
    measure_exchange(exchange, backend, report);
    // If borders go from device to device, one more batch, which waits within steps, measures the parts of a
    // step. Its total time does not count.
    const int last = plan.repetitions + (backend.goes_by_device() ? 1 : 0);
    for (int repetition = 0; repetition <= last; ++repetition) {
        if (repetition > 0) runner.rewind(backend);
        meet(exchange);
        backend.connect();
        backend.wait_in_steps(repetition > plan.repetitions);
        (void)backend.take_seconds();
        const double total = backend.timed([&] { runner.run(backend, plan.steps); }).host_seconds;
        const RankSeconds seconds = backend.take_seconds();
        if (const auto divergence = backend.divergence())
            throw std::runtime_error(describe(*divergence, monitor));
        if (repetition > 0 && repetition <= plan.repetitions) {
            card.look(report);
            report.batches.push_back({total, seconds.compute, seconds.exchange, seconds.waiting});
        }
        if (repetition <= plan.repetitions) continue;
        for (RankBatch& batch : report.batches)
            batch = {batch.total, seconds.compute, seconds.exchange, seconds.waiting};
    }
    if (backend.goes_by_device()) {
        meet(exchange);
        backend.disconnect();
    }
    turn = turn_of_rank(scene);
    leave(subdomain, backend.download(), scene.problem, plan, left);
    return report;
}

std::vector<RankReport> run_ranks_as_threads(const BackendSpec& spec, const Scene& scene,
                                             const RankPlan& plan, State& left) {
    const int ranks = plan.ranks();
    const Routes routes = routes_of(Decomposition(scene.problem, plan.cut));
    std::vector<Line> memory(Mailroom::lines(routes));
    const Mailroom mailroom(memory.data(), routes);
    const std::shared_ptr<Together> all(new Together{.spec = spec,
                                                     .scene = scene,
                                                     .plan = plan,
                                                     .memory = std::move(memory),
                                                     .mailroom = mailroom,
                                                     .reports = std::vector<RankReport>(std::size_t(ranks)),
                                                     .left = std::move(left),
                                                     .parts = PartsOnDevices(std::size_t(ranks)),
                                                     .at_work = ranks});
    start_threads(all);
    wait_for(*all);
    if (all->mailroom.has_failed() && all->unavailable) throw Unavailable(all->mailroom.reason());
    if (all->mailroom.has_failed()) throw std::runtime_error(all->mailroom.reason());
    left = std::move(all->left);
    return std::move(all->reports);
}

}  // namespace voxspring
