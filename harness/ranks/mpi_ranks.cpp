#include "harness/ranks/mpi_ranks.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdlib>
#include <future>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "backends/layout/decomposition.h"
#include "harness/base/bad_input.h"
#include "harness/base/clock.h"
#include "harness/base/json.h"
#include "harness/process/case.h"
#include "harness/process/signal_process.h"
#include "harness/process/worker_main.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/reference.h"

namespace voxspring {
namespace {

enum Tag : int { tag_build = 1, tag_order, tag_verdict, tag_state, tag_border };

/// The tag of a task's border messages. It differs from the previous task's tag, whose last messages may
/// still be on their way.
int border_tag(const RankTask& task) { return tag_border + task.number % 1000; }

std::string name_of_rank(int rank) {
    std::array<char, 256> host{};
    gethostname(host.data(), host.size() - 1);
    return "rank " + std::to_string(rank) + " on " + host.data();
}

// --- In a rank's worker ---------------------------------------------------------------------------------

class RankRunner final : public CaseRunner {
public:
    RankRunner(BackendSpec spec, const Scene& scene, const nlohmann::json& parameters, SharedState* shared)
        : spec_(std::move(spec)),
          scene_(scene),
          rank_(parameters.at("rank")),
          plan_(parameters.at("plan").get<RankPlan>()),
          memory_(parameters.at("segment").get<int>()),
          mailroom_(static_cast<Line*>(memory_.data()), parameters.at("routes").get<Routes>()),
          shared_(*shared) {}

    /// "prepare" only makes sure that the process exists and its id is known before the rank begins to "run".
    nlohmann::json answer(Backend&, const nlohmann::json& question, const OnEvent&) override {
        if (question.at("do") == "prepare") return nullptr;
        Exchange exchange(mailroom_, rank_);
        try {
            State left = room_for_state(scene_.problem, plan_);
            const RankReport report = run_rank(spec_, scene_, plan_, exchange, left);
            const State own = part_of(left, places_of_rank(scene_.problem, plan_, rank_));
            return {{"report", report}, {"state", shared_.put(own)}};
        } catch (const std::exception& error) {
            exchange.fail(name_of_rank(rank_) + ": " + error.what());
            throw;
        }
    }

private:
    const BackendSpec spec_;
    const Scene& scene_;
    const int rank_;
    const RankPlan plan_;
    const SharedMemory memory_;
    const Mailroom mailroom_;
    SharedState& shared_;
};

const RegisteredCaseRunner registered_rank("rank", case_runner_of<RankRunner>);

// --- In the process of mpirun ---------------------------------------------------------------------------

/// Carries messages between one worker's mailroom and MPI during one task.
class Carrier {
public:
    Carrier(OpenMpi& mpi, const RankTask& task, const Mailroom& mailroom, std::optional<pid_t> worker)
        : mpi_(mpi), task_(task), mailroom_(mailroom), worker_(worker) {
        for (const int other : mailroom.routes().from(mpi.rank())) links_.push_back({other, nullptr});
    }

    /// Carries messages until every rank has a verdict (its report, or why it failed), and returns the
    /// verdicts. `ask` returns the report of this rank's worker.
    std::vector<nlohmann::json> carry(const std::function<nlohmann::json()>& ask);

private:
    struct Link {
        int rank;
        std::unique_ptr<OpenMpi::Sending> sending;  ///< null: no message is on its way
    };

    bool is_own_missing() const { return verdicts_[std::size_t(mpi_.rank())].is_null(); }
    bool send_borders();
    bool receive_borders();
    void judge_own(std::future<nlohmann::json>& answer);
    void announce();
    void hear();
    void end_worker_that_hangs();

    OpenMpi& mpi_;
    const RankTask& task_;
    const Mailroom& mailroom_;
    const std::optional<pid_t> worker_;
    std::vector<Link> links_;
    std::vector<nlohmann::json> verdicts_ = std::vector<nlohmann::json>(std::size_t(task_.plan.ranks()));
    std::vector<std::byte> unwanted_;
    bool announced_ = false;
    std::optional<Clock::time_point> failed_;
};

bool Carrier::send_borders() {
    bool moved = false;
    for (Link& link : links_) {
        Mailbox box = mailroom_.box(mpi_.rank(), link.rank);
        if (link.sending != nullptr && link.sending->is_gone()) {
            link.sending.reset();
            box.take();
            moved = true;
        }
        if (link.sending != nullptr || !box.has_message()) continue;
        link.sending = mpi_.start_to_send(link.rank, border_tag(task_), box.message(), box.message_bytes());
        moved = true;
    }
    return moved;
}

/// Receives the neighbours' borders for the worker. Messages that the worker no longer needs are also
/// received, since their sender waits for that.
bool Carrier::receive_borders() {
    bool moved = false;
    const bool wanted = is_own_missing() && !mailroom_.has_failed();
    for (const Link& link : links_) {
        Mailbox box = mailroom_.box(link.rank, mpi_.rank());
        if (wanted && !box.has_room()) continue;
        const auto message = mpi_.arrived(border_tag(task_), link.rank);
        if (!message) continue;
        moved = true;
        if (!wanted) unwanted_.resize(std::max(unwanted_.size(), message->bytes));
        mpi_.receive(link.rank, border_tag(task_), wanted ? box.room() : unwanted_.data(), message->bytes);
        if (wanted) box.send(message->bytes);
    }
    return moved;
}

void Carrier::judge_own(std::future<nlohmann::json>& answer) {
    if (!is_own_missing() || answer.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
    nlohmann::json& own = verdicts_[std::size_t(mpi_.rank())];
    try {
        own = {{"report", answer.get()}};
    } catch (const std::exception& error) {
        mailroom_.fail(name_of_rank(mpi_.rank()) + ": " + error.what());
        own = {{"failed", mailroom_.reason()}};
    }
}

/// Sends this rank's verdict to the other ranks, once none of its borders is on its way or waits to be sent:
/// so all borders arrive before the verdict.
void Carrier::announce() {
    const auto is_idle = [this](const Link& link) {
        return link.sending == nullptr && !mailroom_.box(mpi_.rank(), link.rank).has_message();
    };
    if (announced_ || is_own_missing() || !std::all_of(links_.begin(), links_.end(), is_idle)) return;
    for (int other = 0; other < task_.plan.ranks(); ++other) {
        if (other != mpi_.rank()) mpi_.send_json(other, tag_verdict, verdicts_[std::size_t(mpi_.rank())]);
    }
    announced_ = true;
}

void Carrier::hear() {
    while (const auto message = mpi_.arrived(tag_verdict)) {
        nlohmann::json& verdict = verdicts_[std::size_t(message->from)];
        verdict = mpi_.receive_json(*message, tag_verdict);
        if (verdict.contains("failed")) mailroom_.fail(verdict.at("failed").get<std::string>());
    }
}

/// Kills the worker if it is still at work a second after a rank failed. A worker that waits for a neighbour
/// notices the failure by itself.
void Carrier::end_worker_that_hangs() {
    constexpr std::chrono::seconds grace(1);
    if (!mailroom_.has_failed() || !is_own_missing()) return;
    if (!failed_) failed_ = Clock::now();
    if (worker_ && Clock::now() - *failed_ > grace) signal_process(*worker_, SIGKILL);
}

std::vector<nlohmann::json> Carrier::carry(const std::function<nlohmann::json()>& ask) {
    constexpr int spins = 2000, between_looks = 64;
    std::future<nlohmann::json> answer = std::async(std::launch::async, ask);
    int idle = 0;
    const auto is_missing = [](const nlohmann::json& verdict) { return verdict.is_null(); };
    // The rank must not leave while its verdict is on its way: MPI might move the verdict only within a
    // further call of this rank, and the others would wait for it.
    const auto is_over = [&] {
        return announced_ && std::none_of(verdicts_.begin(), verdicts_.end(), is_missing) &&
               mpi_.has_sent_all();
    };
    for (int i = 0; !is_over(); ++i) {
        const bool sent = send_borders();
        idle = receive_borders() || sent ? 0 : idle + 1;
        if (idle > spins) std::this_thread::yield();
        if (i % between_looks != 0) continue;
        judge_own(answer);
        announce();
        hear();
        end_worker_that_hangs();
    }
    return std::move(verdicts_);
}

constexpr std::size_t most_at_once = std::size_t(1) << 20;  // vectors per message; MPI counts bytes in an int

/// Returns once the vectors may change, maybe only when rank 0 receives them. This cannot deadlock: rank 0
/// receives from one rank after the other and sends nothing meanwhile.
void send_vectors(const OpenMpi& mpi, const std::vector<glm::dvec3>& vectors) {
    for (std::size_t begin = 0; begin < vectors.size(); begin += most_at_once) {
        const std::size_t count = std::min(most_at_once, vectors.size() - begin);
        (void)mpi.start_to_send(0, tag_state, &vectors[begin], count * sizeof(glm::dvec3));
    }
}

void receive_vectors(const OpenMpi& mpi, int from, const std::vector<std::uint32_t>& places,
                     std::vector<glm::dvec3>& left) {
    std::vector<glm::dvec3> vectors(places.size());
    for (std::size_t begin = 0; begin < vectors.size(); begin += most_at_once)
        mpi.receive(from, tag_state, &vectors[begin],
                    std::min(most_at_once, vectors.size() - begin) * sizeof(glm::dvec3));
    for (std::size_t n = 0; n < places.size(); ++n) left[places[n]] = vectors[n];
}

void wait_a_little() { std::this_thread::sleep_for(std::chrono::milliseconds(1)); }

}  // namespace

CaseProgram rank_program(const RankTask& task, int rank, const SharedMemory& mailroom, SharedState* shared) {
    return {.runner = "rank",
            .parameters = {{"rank", rank},
                           {"plan", task.plan},
                           {"routes", task.routes},
                           {"segment", mailroom.segment()}},
            .shared = shared,
            // Rank 0's backend is first asked whether it supports the whole scene. So this backend is made as
            // if no other rank used its device.
            .device = rank == 0 ? task.plan.first_device() : task.plan.device_of(rank)};
}

std::unique_ptr<MpiRanks> MpiRanks::join() {
    std::unique_ptr<OpenMpi> mpi = OpenMpi::join();
    if (mpi == nullptr) return nullptr;
    std::unique_ptr<MpiRanks> all(new MpiRanks(std::move(mpi)));
    all->compare_builds();
    return all;
}

int MpiRanks::ranks_here() const {
    const char* const here = std::getenv("OMPI_COMM_WORLD_LOCAL_SIZE");
    return here != nullptr ? std::max(1, std::atoi(here)) : 1;
}

void MpiRanks::compare_builds() const {
    const nlohmann::json own = {{"build", build_of_workers()}, {"name", name_of_rank(rank())}};
    if (rank() != 0) {
        mpi_->send_json(0, tag_build, own);
        return;
    }
    std::string refused, theirs;
    for (int heard = 1; heard < ranks();) {
        const auto message = mpi_->arrived(tag_build);
        if (!message) {
            wait_a_little();
            continue;
        }
        ++heard;
        const nlohmann::json other = mpi_->receive_json(*message, tag_build);
        if (other.at("build") == own.at("build")) continue;
        refused = other.at("name");
        theirs = json_text(other.at("build"));
    }
    if (!refused.empty())
        throw BadInput("mpirun", refused, theirs,
                       "a program of the same build as rank 0's, " + json_text(own.at("build")));
}

MpiRanks::~MpiRanks() {
    if (rank() != 0) return;
    for (int other = 1; other < ranks(); ++other) mpi_->send_json(other, tag_order, {{"do", "leave"}});
}

/// Polls with pauses: a blocking receive would spin on a core that another rank may need.
nlohmann::json MpiRanks::next_order() const {
    for (;;) {
        if (const auto message = mpi_->arrived(tag_order, 0)) return mpi_->receive_json(*message, tag_order);
        wait_a_little();
    }
}

void MpiRanks::serve(const Means& means) {
    for (;;) {
        const nlohmann::json order = next_order();
        if (order.at("do") == "leave") return;
        take_part(order.at("task").get<RankTask>(), means);
    }
}

void MpiRanks::take_part(const RankTask& task, const Means& means) {
    const SharedMemory memory = SharedMemory::of_bytes(Mailroom::lines(task.routes) * sizeof(Line));
    const Mailroom mailroom(static_cast<Line*>(memory.data()), task.routes);
    std::optional<SharedState> shared;
    std::unique_ptr<Worker> worker;
    std::string failure;
    try {
        if (argument_ != task.scene || strained_ != task.strained) {
            workers_.reset();
            argument_.clear();
            scene_ = std::make_unique<Scene>(means.load(task.scene));
            if (task.strained) scene_->state = strained_start(scene_->problem);
            workers_ = std::make_unique<Workers>(means.worker, scene_.get());
            argument_ = task.scene;
            strained_ = task.strained;
        }
        if (fingerprint_of(*scene_) != task.fingerprint)
            throw std::runtime_error("the scene " + task.scene + " of rank " + std::to_string(rank()) +
                                     " differs from that of rank 0");
        shared.emplace(scene_->problem.particle_count());
        const CaseProgram program = rank_program(task, rank(), memory, &*shared);
        worker = std::make_unique<Worker>(
            *workers_, case_description(BackendSpec::parse(task.backend), program), means.timeout);
        worker->ask({{"do", "construct"}}, "constructing its backend");
        worker->ask({{"do", "prepare"}}, "preparing its rank");
    } catch (const std::exception& error) {
        failure = error.what();
    }
    const auto ask = [&] {
        if (!failure.empty()) throw std::runtime_error(failure);
        return worker->ask({{"do", "run"}}, "stepping its part");
    };
    const auto process = worker != nullptr ? worker->process() : std::nullopt;
    const std::vector<nlohmann::json> verdicts = Carrier(*mpi_, task, mailroom, process).carry(ask);
    if (mailroom.has_failed()) return;
    State own;
    shared->take(verdicts[std::size_t(rank())].at("report").at("state"), own);
    send_vectors(*mpi_, own.displacement);
    send_vectors(*mpi_, own.increment);
}

std::vector<RankReport> MpiRanks::run(RankTask task, const Scene& scene, const SharedMemory& memory,
                                      pid_t worker, const std::function<nlohmann::json()>& ask, State& left) {
    task.number = ++tasks_;
    for (int other = 1; other < task.plan.ranks(); ++other)
        mpi_->send_json(other, tag_order, {{"do", "run"}, {"task", task}});
    const Mailroom mailroom(static_cast<Line*>(memory.data()), task.routes);
    const std::vector<nlohmann::json> verdicts = Carrier(*mpi_, task, mailroom, worker).carry(ask);
    if (mailroom.has_failed()) throw std::runtime_error(mailroom.reason());
    std::vector<RankReport> reports;
    for (int rank = 0; rank < task.plan.ranks(); ++rank) {
        reports.push_back(verdicts[std::size_t(rank)].at("report").at("report").get<RankReport>());
        if (rank == 0) continue;
        const std::vector<std::uint32_t> places = places_of_rank(scene.problem, task.plan, rank);
        receive_vectors(*mpi_, rank, places, left.displacement);
        receive_vectors(*mpi_, rank, places, left.increment);
    }
    return reports;
}

}  // namespace voxspring
