// The kind of study `scaling`: a scene stepped by several ranks, each of which steps a part of the scene.
#include <fmt/format.h>
#include <omp.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "backends/layout/decomposition.h"
#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/statistics.h"
#include "harness/base/text.h"
#include "harness/device/noise.h"
#include "harness/ranks/mpi_ranks.h"
#include "harness/ranks/rank_run.h"
#include "harness/ranks/sample.h"
#include "harness/results/capabilities.h"
#include "harness/results/print.h"
#include "harness/scene/scene_runner.h"
#include "harness/study/kernel_trial.h"
#include "harness/study/measure.h"
#include "harness/study/scaling_row.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"
#include "harness/verification/errors.h"
#include "harness/verification/verify.h"

namespace voxspring {
namespace {

// --- In the process of a case ---------------------------------------------------------------------------

/// Whether the backend takes any number of threads on the processor. Backends on a card may have an option
/// `threads` with another meaning, which has a list of values.
bool has_host_threads(const BackendSpec& spec) {
    const auto found = spec.entry->tuning.find("threads");
    return found != spec.entry->tuning.end() && found->second.empty();
}

/// Runs all ranks as threads of the case's process.
class ScalingRunner final : public CaseRunner {
public:
    ScalingRunner(BackendSpec spec, const Scene& scene, const nlohmann::json& parameters, SharedState* shared)
        : spec_(std::move(spec)),
          scene_(scene),
          plan_(parameters.at("plan").get<RankPlan>()),
          shared_(*shared) {}

    nlohmann::json answer(Backend&, const nlohmann::json&, const OnEvent&) override {
        State state = room_for_state(scene_.problem, plan_);
        nlohmann::json reports = nlohmann::json::array();
        for (const RankReport& report : run_ranks_as_threads(spec_, scene_, plan_, state))
            reports.push_back(report);
        return {{"reports", reports}, {"state", shared_.put(state)}};
    }

private:
    const BackendSpec spec_;
    const Scene& scene_;
    const RankPlan plan_;
    SharedState& shared_;
};

const RegisteredCaseRunner scaling_runner("scaling", case_runner_of<ScalingRunner>);

// --- In the process of the study ------------------------------------------------------------------------

/// Takes all times from the batch with the median time. The time of a step is that of the rank that ends
/// last. The times of computing, exchanging and waiting are those of the rank with the most work.
void take_times(const std::vector<RankReport>& reports, int steps, ScalingRow& row) {
    std::vector<double> totals;
    for (std::size_t b = 0; b < reports.front().batches.size(); ++b) {
        double longest = 0;
        for (const RankReport& report : reports) longest = std::max(longest, report.batches[b].total);
        totals.push_back(longest);
    }
    row.noisy = reasons_of_noise({.seconds = totals});
    // If two times are in the middle, the larger one counts, since their mean would be the time of no batch.
    std::vector<double> sorted = totals;
    std::sort(sorted.begin(), sorted.end());
    const double middle = sorted[sorted.size() / 2];
    const auto b = std::size_t(std::find(totals.begin(), totals.end(), middle) - totals.begin());
    const auto work = [b](const RankReport& report) {
        return report.batches[b].compute + report.batches[b].exchange;
    };
    const RankBatch& busiest =
        std::max_element(reports.begin(), reports.end(), [&](const RankReport& one, const RankReport& other) {
            return work(one) < work(other);
        })->batches[b];
    row.seconds_per_step = middle / steps;
    row.compute_seconds = busiest.compute / steps;
    row.exchange_seconds = busiest.exchange / steps;
    row.waiting_seconds = busiest.waiting / steps;
}

/// Adds to `row` the clocks and other users of each rank's card. If ranks are separate processes, other ranks
/// on the same card do not count as other users.
void take_cards(const std::vector<RankReport>& reports, bool processes, ScalingRow& row) {
    for (const RankReport& report : reports) {
        Observed seen{.card_mhz = report.card_mhz, .other_users = report.other_users};
        const auto is_beside = [&](const RankReport& other) { return other.uuid == report.uuid; };
        const auto beside = unsigned(std::count_if(reports.begin(), reports.end(), is_beside) - 1);
        for (unsigned& users : seen.other_users) users -= std::min(users, processes ? beside : 0);
        for (const unsigned mhz : seen.card_mhz) {
            row.min_card_mhz = std::min(row.min_card_mhz.value_or(mhz), mhz);
            row.max_card_mhz = std::max(row.max_card_mhz.value_or(mhz), mhz);
        }
        for (std::string reason : reasons_of_noise(seen)) {
            reason.insert(reason.size() - 1, ", rank " + std::to_string(&report - reports.data()));
            row.noisy.push_back(reason);
        }
    }
}

void take_sizes(const std::vector<RankReport>& reports, ScalingRow& row) {
    for (const RankReport& report : reports) {
        row.largest_part = std::max<std::uint64_t>(row.largest_part, report.own + report.ghosts);
        row.ghosts += report.ghosts;
        row.border_bytes = std::max<std::uint64_t>(row.border_bytes, report.border_bytes);
        if (reports.size() == 1) continue;
        row.latency_seconds = std::max(row.latency_seconds.value_or(0), report.latency);
        row.seconds_per_byte = std::max(row.seconds_per_byte.value_or(0), report.seconds_per_byte);
    }
}

/// The largest number of ranks that share a device. Ranks without a device UUID do not count.
int ranks_of_a_device(const std::vector<RankReport>& reports) {
    std::map<std::string, int> ranks;
    int most = 0;
    for (const RankReport& report : reports) {
        if (!report.uuid.empty()) most = std::max(most, ++ranks[report.uuid]);
    }
    return most;
}

/// The ways in which ranks exchange their borders (RankPlan::way), and "mpi".
const std::vector<std::string> known_ways = {
    "memory", "mpi", "peer", "peer_overlap", "stores", "stores_overlap", "nccl", "nccl_overlap"};

/// The ways to cut a scene into subdomains (Decomposition). `slabs` cut across the longest axis; `layers`
/// always cut across z, so that a border is contiguous in memory (most backends store the particles of one
/// layer side by side); `bricks` cut along several axes.
const std::vector<std::string> known_cuts = {"slabs", "layers", "bricks"};

/// A cut as text: "2x2x1".
std::string text_of(glm::ivec3 cut) { return fmt::format("{}x{}x{}", cut.x, cut.y, cut.z); }

/// The key of a scene in a study file for the thickness, in layers of voxels, of each brick of a Sample,
/// which is the part of the body that is verified. Without this key the whole body is verified.
constexpr const char* sample_key = "sample_layers";
constexpr int max_sample_layers = 1024;

/// The key of a study, and of a scene in a study file, for the ways of exchanging borders to measure.
constexpr const char* ways_key = "ways";

class ScalingStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        if (const auto ranks = study.find("ranks")) counts_ = read_counts(*ranks);
        if (const auto ways = study.find(ways_key)) ways_ = read_ways(*ways);
        if (const auto cuts = study.find("cuts")) {
            cuts_.clear();
            for (const JsonValue& cut : cuts->array(1)) cuts_.push_back(cut.one_of(known_cuts));
        }
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto ranks = item.find("ranks")) (void)read_counts(*ranks);
        if (const auto ways = item.find(ways_key)) (void)read_ways(*ways);
        if (const auto weak = item.find("weak")) (void)weak->string();
        if (const auto layers = item.find(sample_key)) (void)layers->integer(1, max_sample_layers);
        if (const auto strained = item.find(StudyScene::strained_key)) (void)strained->boolean();
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene& item, const Scene& scene) const override {
        if (!item.settings.contains(sample_key)) return;
        const int layers = item.settings.at(sample_key);
        if (const std::string why = Sample::refusal(scene, layers); !why.empty())
            throw BadInput("study " + study.name, std::string(sample_key) + " of " + scene.name,
                           std::to_string(layers), "a number of layers that can be verified: " + why);
    }
    bool takes(const Capabilities& capabilities) const override {
        return capabilities.has_borders || !capabilities.border_ways.empty();
    }
    int rows_of_case(const Study&, const StudyScene& item) const override {
        return int(counts_of(item).size());
    }
    double steps_of_case(const Study& study, const StudyScene& item) const override {
        return double(counts_of(item).size()) * item.steps * (study.repetitions + 1);
    }
    void run(StudyBench& bench) override;
    void make_lists(Result& result) const override { result.rows<ScalingRow>("scaling"); }
    void summarise(Result& result) const override;
    void print(const Result& result, std::ostream& out, TableWidth width) const override;

private:
    static std::vector<int> read_counts(const JsonValue& list) {
        std::vector<int> counts;
        for (const JsonValue& item : list.array(1)) {
            counts.push_back(int(item.integer(1, max_ranks)));
            if (counts.size() > 1 && counts.back() <= counts[counts.size() - 2])
                item.refuse("numbers of ranks in ascending order");
        }
        return counts;
    }
    static std::vector<std::string> read_ways(const JsonValue& list) {
        std::vector<std::string> ways;
        for (const JsonValue& way : list.array(1)) ways.push_back(way.one_of(known_ways));
        return ways;
    }
    std::vector<int> counts_of(const StudyScene& item) const { return item.settings.value("ranks", counts_); }
    /// The ways to measure on a scene, whether or not a backend has them.
    std::vector<std::string> known_ways_of(const StudyScene& item) const {
        return item.settings.value(ways_key, ways_);
    }
    static int limit_of(const StudyBench& bench) {
        const MpiRanks* const mpi = bench.options().mpi;
        const int most = mpi != nullptr ? mpi->ranks() : max_ranks;
        const std::size_t devices = bench.options().devices.size();
        const int here = devices > 0 ? int(devices) : omp_get_num_procs();
        return std::min(most, bench.options().ranks.value_or(mpi != nullptr ? most : here));
    }
    int most_ranks(const Study& study, int limit) const;
    std::vector<glm::ivec3> cuts_for(const Problem& problem, int ranks) const;
    void find_cuts(const StudyBench& bench);
    void run_backend(StudyBench& bench, const BackendSpec& spec, int threads);

    std::vector<std::string> ways_of(int ranks, const StudyBench& bench,
                                     const Capabilities& capabilities) const;
    void skip_other_ways(StudyBench& bench, const BackendSpec& spec, int ranks,
                         const std::vector<std::string>& ways) const;

    std::vector<int> counts_ = {1, 2};
    std::vector<std::string> ways_ = known_ways;
    std::vector<std::string> cuts_ = known_cuts;
    /// Cuts of the current scene, by number of ranks; a cut is the number of parts along x, y and z.
    std::map<int, std::vector<glm::ivec3>> cuts_of_ranks_;
    int begun_ = 0;
};

/// The study's largest number of ranks that is not above `limit`; 1 if there is none.
int ScalingStudy::most_ranks(const Study& study, int limit) const {
    int most = 1;
    for (const StudyScene& item : study.scenes) {
        for (const int count : counts_of(item)) {
            if (count <= limit) most = std::max(most, count);
        }
    }
    return most;
}

/// The cuts for a number of ranks, each once. Decomposition::bricks() returns slabs if bricks would not send
/// less; these slabs are left out here.
std::vector<glm::ivec3> ScalingStudy::cuts_for(const Problem& problem, int ranks) const {
    const glm::ivec3 slabs = Decomposition::slabs(problem, ranks);
    if (ranks == 1) return {slabs};
    std::vector<glm::ivec3> cuts;
    for (const std::string& cut : cuts_) {
        const glm::ivec3 parts = cut == "slabs"    ? slabs
                                 : cut == "layers" ? glm::ivec3(1, 1, ranks)
                                                   : Decomposition::bricks(problem, ranks);
        const bool is_new = std::find(cuts.begin(), cuts.end(), parts) == cuts.end();
        if (is_new && (cut != "bricks" || parts != slabs)) cuts.push_back(parts);
    }
    return cuts;
}

void ScalingStudy::find_cuts(const StudyBench& bench) {
    cuts_of_ranks_.clear();
    for (const int ranks : counts_of(bench.item())) {
        if (ranks <= limit_of(bench)) cuts_of_ranks_[ranks] = cuts_for(bench.scene().problem, ranks);
    }
}

/// The ways to exchange borders that both the study and the backend have. The ways between threads require
/// that all ranks are on one host.
std::vector<std::string> ScalingStudy::ways_of(int ranks, const StudyBench& bench,
                                               const Capabilities& capabilities) const {
    if (ranks == 1) return {"none"};
    const MpiRanks* const mpi = bench.options().mpi;
    std::vector<std::string> ways;
    if (mpi == nullptr || mpi->ranks_here() == mpi->ranks()) {
        ways = capabilities.border_ways;
        if (capabilities.has_borders) ways.insert(ways.begin(), "memory");
    }
    if (mpi != nullptr && capabilities.has_borders) ways.push_back("mpi");
    std::erase_if(ways, [known = known_ways_of(bench.item())](const std::string& way) {
        return std::find(known.begin(), known.end(), way) == known.end();
    });
    return ways;
}

/// The results of all ranks.
struct Found {
    std::vector<RankReport> reports = {};
    State state = {};  ///< of the size of room_for_state()
};

/// The reference for the whole body, or for one brick of a Sample.
struct Judgement {
    Problem problem;  ///< after the edits within the steps
    State start;
    std::vector<std::uint32_t> particle;  ///< indices in the scene, ascending; empty: the whole body
    std::vector<std::uint32_t> place;     ///< indices of `particle` in the state that ranks leave
    std::string reference;                ///< name of the reference
    std::optional<ReferenceSolution> solution = {};  ///< for `problem`
};

/// One backend on one scene, measured with each number of ranks.
class RankedCase {
public:
    RankedCase(StudyBench& bench, BackendSpec spec) : bench_(bench), spec_(std::move(spec)) {
        const nlohmann::json& settings = bench.item().settings;
        if (settings.contains(sample_key)) sampled_ = Sample::bricks(bench.scene(), settings.at(sample_key));
    }

    /// Measures one row, with the subdomains of `cut`, in a separate process: a rank that hangs ends with
    /// that process, before the next row is measured.
    void measure(glm::ivec3 cut, const std::string& way);

private:
    RankPlan plan(glm::ivec3 cut, const std::string& way) const {
        RankPlan plan{.steps = bench_.item().steps, .repetitions = bench_.study().repetitions};
        plan.start_patience = bench_.options().timeout;
        // Shorter than the time-out of the whole row, so that the message can name the rank that hangs.
        plan.patience = std::min(plan.patience, plan.start_patience / 4);
        plan.devices = bench_.options().devices;
        plan.cut = cut;
        plan.sampled = sampled_;
        if (way != "none" && way != "mpi") plan.way = way;
        return plan;
    }
    RankTask task(glm::ivec3 cut) const;
    Found run_as_threads(Case& entered, const SharedState& shared) const;
    Found run_by_mpi(Case& entered, const RankTask& task, const SharedMemory& mailroom,
                     const SharedState& shared) const;
    nlohmann::json judged(const Found& found, const RankPlan& plan, const std::string& way, bool keeps_bits);
    void make_judgements();
    ScalingRow row_from(const std::vector<RankReport>& reports, const std::string& way) const;

    StudyBench& bench_;
    const BackendSpec spec_;
    std::vector<Decomposition::Brick> sampled_ = {};  ///< empty: the whole body is judged
    std::uint64_t judged_particles_ = 0;
    std::vector<std::unique_ptr<Judgement>> judgements_ = {};
    std::string bits_of_one_ = {};  ///< hash of the state that one rank left; empty: not known
};

void RankedCase::make_judgements() {
    if (!judgements_.empty()) return;
    const Scene& scene = bench_.scene();
    const int steps = bench_.item().steps;
    if (sampled_.empty()) {
        Judgement& whole = *judgements_.emplace_back(std::make_unique<Judgement>());
        whole.problem = problem_after(scene, steps);
        whole.reference = References::name_of_backend(scene, steps);
        whole.solution.emplace(solution_of(bench_, scene, whole.problem, steps, {spec_}));
        return;
    }
    const std::vector<std::uint32_t> left = Sample::particles(scene.problem, sampled_);
    judged_particles_ = left.size();
    for (const Decomposition::Brick& brick : sampled_) {
        Sample sample(scene, brick, steps);
        Judgement& part = *judgements_.emplace_back(std::make_unique<Judgement>());
        part.problem = problem_after(sample.judged, steps);
        part.start = std::move(sample.judged.state);
        part.particle = std::move(sample.particle);
        part.place = places_of(part.particle, left);
        part.reference = References::name_of_backend(sample.around, steps);
        const State after = bench_.references().after(sample.around, steps);
        part.solution.emplace(
            ReferenceSolution{part.problem, steps, part_of(after, sample.in_around), {}, part.start});
        part.solution->refined.reason = "only a sample of the body is verified";
        const RoundingModel model = rounding_model_of(spec_);
        part.solution->spreads.emplace_back(model,
                                            bench_.references().spread(sample.around, steps, after, model));
    }
}

ScalingRow RankedCase::row_from(const std::vector<RankReport>& reports, const std::string& way) const {
    const Scene& scene = bench_.scene();
    const nlohmann::json& settings = bench_.item().settings;
    ScalingRow row;
    bench_.identify(row, spec_, bench_.item().steps);
    row.family = settings.value("weak", scene.name);
    row.scaling = settings.contains("weak") ? "weak" : "strong";
    row.ranks = int(reports.size());
    row.way = way;
    take_sizes(reports, row);
    take_times(reports, bench_.item().steps, row);
    take_cards(reports, way == "mpi", row);
    // With MPI each rank has one more busy process, which passes on the messages of the rank's worker.
    const int stepping = has_host_threads(spec_) ? std::stoi(spec_.options.tuning.at("threads")) : 1;
    const int busy = stepping + (way == "mpi" ? 1 : 0);
    const int here = way == "mpi" ? std::min(row.ranks, bench_.options().mpi->ranks_here()) : row.ranks;
    const int most = ranks_of_a_device(reports);
    if (most > 1)
        row.noisy.push_back("ranks share a device (" + std::to_string(most) + " of " +
                            std::to_string(row.ranks) + " ranks on one)");
    if (here * busy > omp_get_num_procs())
        row.noisy.push_back("ranks share processors (" + std::to_string(here) + " ranks of " +
                            counted(std::uint64_t(busy), "thread") + " on " +
                            std::to_string(omp_get_num_procs()) + ")");
    return row;
}

Found RankedCase::run_as_threads(Case& entered, const SharedState& shared) const {
    const nlohmann::json answer = entered.ask({{"do", "run"}}, "stepping its parts");
    Found found;
    for (const auto& report : answer.at("reports")) found.reports.push_back(report.get<RankReport>());
    shared.take(answer.at("state"), found.state);
    return found;
}

Found RankedCase::run_by_mpi(Case& entered, const RankTask& task, const SharedMemory& mailroom,
                             const SharedState& shared) const {
    const Problem& problem = bench_.scene().problem;
    entered.ask({{"do", "prepare"}}, "preparing its rank");
    Found found{.state = room_for_state(problem, task.plan)};
    nlohmann::json answer;
    try {
        found.reports = bench_.options().mpi->run(
            task, bench_.scene(), mailroom, entered.process().value(),
            [&] {
                return answer = entered.ask({{"do", "run"}}, "stepping its part");
            },
            found.state);
    } catch (const std::exception&) {
        if (interrupted()) throw Interrupted();
        throw;
    }
    State part;
    shared.take(answer.at("state"), part);
    const std::vector<std::uint32_t> places = places_of_rank(problem, task.plan, 0);
    for (std::size_t n = 0; n < places.size(); ++n) {
        found.state.displacement[places[n]] = part.displacement[n];
        found.state.increment[places[n]] = part.increment[n];
    }
    return found;
}

/// Judges `found` and returns the journal's entry: the row and the hash of the state. Throws if the ranks are
/// on devices of different names, if the state is wrong, or if `keeps_bits` is set and the bits of the state
/// are not those that one rank left.
nlohmann::json RankedCase::judged(const Found& found, const RankPlan& plan, const std::string& way,
                                  bool keeps_bits) {
    if (const std::string reason = different_devices(found.reports); !reason.empty())
        throw Unavailable(reason);
    ScalingRow row = row_from(found.reports, way);
    row.cut = text_of(plan.cut);
    make_judgements();
    for (const std::unique_ptr<Judgement>& one : judgements_) {
        const State part = part_of(found.state, one->place);
        const State& state = sampled_.empty() ? found.state : part;
        Row judged = judged_row(*one->solution, state, spec_, strained_share(*one->solution, spec_));
        if (!judged.verdict->passed)
            throw std::runtime_error("does not agree with " + one->reference + ": " +
                                     judged.reason.value_or(""));
        if (row.errors && row.errors->relative_l2 >= judged.errors->relative_l2) continue;
        if (judged.errors->worst_particle && !one->particle.empty())
            judged.errors->worst_particle = one->particle[*judged.errors->worst_particle];
        row.errors = std::move(judged.errors);
        row.verdict = std::move(judged.verdict);
    }
    if (!sampled_.empty()) row.judged_particles = judged_particles_;
    const std::string bits = fingerprint_of(found.state);
    if (!bits_of_one_.empty()) row.same_bits = bits == bits_of_one_;
    if (row.same_bits == false && keeps_bits)
        throw std::runtime_error("its state has other bits than the state that one rank leaves");
    return {{"row", json_of(row)}, {"bits", bits}};
}

RankTask RankedCase::task(glm::ivec3 cut) const {
    return {.scene = bench_.item().scene,
            .strained = bench_.item().is_strained(),
            .fingerprint = fingerprint_of(bench_.scene()),
            .backend = spec_.text(),
            .plan = plan(cut, "mpi"),
            .routes = routes_of(Decomposition(bench_.scene().problem, cut))};
}

void RankedCase::measure(glm::ivec3 cut, const std::string& way) {
    const bool by_mpi = way == "mpi";
    const RankPlan plan = this->plan(cut, way);
    const int ranks = plan.ranks();
    make_judgements();  // before the processes start, since this takes all cores
    SharedState shared(bench_.scene().problem.particle_count());
    const RankTask task = by_mpi ? this->task(cut) : RankTask();
    const SharedMemory mailroom =
        SharedMemory::of_bytes(by_mpi ? Mailroom::lines(task.routes) * sizeof(Line) : 0);
    const CaseProgram program = by_mpi ? rank_program(task, 0, mailroom, &shared)
                                       : CaseProgram{.runner = "scaling",
                                                     .parameters = {{"plan", plan}},
                                                     .shared = &shared,
                                                     .device = plan.first_device()};
    auto entered = bench_.enter(spec_, program);
    if (!entered) return;
    JournalScope& scope = entered->scope();
    const std::string name =
        ranks == 1 ? "1 rank" : fmt::format("{} ranks of {} by {}", ranks, text_of(cut), way);
    if (scope.find(name) == nullptr) {
        const auto failure = failure_of([&] {
            try {
                const Found found =
                    by_mpi ? run_by_mpi(*entered, task, mailroom, shared) : run_as_threads(*entered, shared);
                // With the option `sleep` a tile that barely moves stops. The cut decides which tiles stop,
                // so bits may differ from those of one rank.
                const bool keeps_bits = capabilities_of(entered->capabilities()).deterministic &&
                                        spec_.admitted_spacings_per_step() == 0;
                scope.keep(name, judged(found, plan, way, keeps_bits));
            } catch (const Unavailable& reason) {
                scope.keep(name, {{"skipped", reason.what()}});
            }
        });
        if (failure) scope.keep(name, {{"failed", *failure}});
    }
    const nlohmann::json* const kept = scope.find(name);
    if (kept == nullptr) return;
    if (kept->contains("skipped")) {
        bench_.skip(spec_, "as " + name + ": " + kept->at("skipped").get<std::string>());
        return;
    }
    if (kept->contains("failed")) {
        bench_.fail(spec_, "as " + name + ": " + kept->at("failed").get<std::string>());
        return;
    }
    if (ranks == 1) bits_of_one_ = kept->at("bits");
    bench_.add("scaling", kept->at("row"));
}

/// Reports as skipped the study's ways that are not in `ways`, but not "mpi" without mpirun. For a backend
/// that exchanges borders within its steps, and therefore has no ways but `ways`.
void ScalingStudy::skip_other_ways(StudyBench& bench, const BackendSpec& spec, int ranks,
                                   const std::vector<std::string>& ways) const {
    std::vector<std::string> others = known_ways_of(bench.item());
    std::erase_if(others, [&](const std::string& way) {
        return std::find(ways.begin(), ways.end(), way) != ways.end() ||
               (way == "mpi" && bench.options().mpi == nullptr);
    });
    if (others.empty()) return;
    bench.skip(spec, "as " + std::to_string(ranks) + " ranks by " + joined(others) +
                         ": its borders travel within its steps");
}

void ScalingStudy::run_backend(StudyBench& bench, const BackendSpec& spec, int threads) {
    BackendSpec of_rank = spec;
    // Every rank has the same number of threads, however many ranks there are, so that one rank is a fair
    // baseline for several.
    if (has_host_threads(spec) && spec.options.tuning.at("threads") == "auto")
        of_rank.options.tuning["threads"] = std::to_string(threads);
    Capabilities capabilities;
    const RankPlan any{.devices = bench.options().devices};
    if (const auto entered = bench.enter(of_rank, {.runner = "", .device = any.first_device()}); !entered) {
        return;
    } else {
        capabilities = capabilities_of(entered->capabilities());
    }
    const bool by_device = !capabilities.border_ways.empty();
    if (by_device && bench.options().mpi == nullptr && bench.options().devices.empty()) {
        bench.refuse(of_rank, "its ranks run on CUDA devices: choose them with --devices");
        return;
    }
    if (!capabilities.has_borders && !by_device) {
        bench.refuse(of_rank, "it cannot step a part of a body: it cannot exchange borders");
        return;
    }
    if (cuts_of_ranks_.empty()) {
        bench.refuse(of_rank, fmt::format("the study asks for {} ranks or more here, and {} are the most",
                                          counts_of(bench.item()).front(), limit_of(bench)));
        return;
    }
    RankedCase ranked(bench, of_rank);
    for (const int ranks : counts_of(bench.item())) {
        if (interrupted()) return;
        if (ranks > limit_of(bench)) continue;
        bench.show(of_rank.label() + ", ranks: " + std::to_string(ranks), begun_++,
                   bench.expected_cases() * int(cuts_of_ranks_.size()));
        const std::vector<std::string> ways = ways_of(ranks, bench, capabilities);
        if (ranks > 1 && !capabilities.has_borders) skip_other_ways(bench, of_rank, ranks, ways);
        if (ways.empty() && capabilities.has_borders)
            bench.skip(of_rank, fmt::format("as {} ranks by {}: no such way is available {} mpirun", ranks,
                                            joined(known_ways_of(bench.item())),
                                            bench.options().mpi == nullptr ? "without" : "under"));
        for (const glm::ivec3 cut : cuts_of_ranks_.at(ranks)) {
            if (const std::string reason = cut_refusal(bench.scene(), cut); !reason.empty()) {
                bench.skip(of_rank, fmt::format("as {} ranks: {}", ranks, reason));
                continue;
            }
            for (const std::string& way : ways) ranked.measure(cut, way);
        }
    }
}

void ScalingStudy::run(StudyBench& bench) {
    begun_ = 0;
    find_cuts(bench);
    int most = most_ranks(bench.study(), limit_of(bench));
    if (bench.options().mpi != nullptr) most = std::min(most, bench.options().mpi->ranks_here());
    const int threads = std::max(1, omp_get_num_procs() / most);
    for (const BackendSpec& spec : bench.specs()) run_backend(bench, spec, threads);
}

void ScalingStudy::summarise(Result& result) const {
    using Family = std::tuple<std::string, std::string>;
    std::map<Family, ScalingRow> of_one;
    const auto family = [](const ScalingRow& row) {
        return Family(row.family, row.identity.name.substr(row.identity.scene.size()));
    };
    auto& rows = result.rows<ScalingRow>("scaling");
    for (const ScalingRow& row : rows) {
        if (row.ranks == 1) of_one.emplace(family(row), row);
    }
    for (ScalingRow& row : rows) {
        const auto one = of_one.find(family(row));
        if (one != of_one.end()) compare(row, one->second);
    }
}

void ScalingStudy::print(const Result& result, std::ostream& out, TableWidth width) const {
    const auto& rows = result.rows<ScalingRow>("scaling");
    const auto seconds = [](double ScalingRow::*figure) {
        return [figure](const ScalingRow& row) { return si(row.*figure, "s"); };
    };
    print_rows<ScalingRow>(
        rows,
        {{{"ranks"}, [](const auto& row) { return std::to_string(row.ranks); }},
         {{"cut"}, [](const auto& row) { return row.cut; }},
         {{"way"}, [](const auto& row) { return row.way; }},
         {{"a step"}, [](const auto& row) { return row.noise_mark() + si(row.seconds_per_step, "s"); }},
         {{"compute", 2}, seconds(&ScalingRow::compute_seconds)},
         {{"exchange", 2}, seconds(&ScalingRow::exchange_seconds)},
         {{"waiting", 2}, seconds(&ScalingRow::waiting_seconds)},
         {{"efficiency"}, [](const auto& row) { return percent_cell(row.efficiency); }},
         {{"predicted", 1},
          [](const auto& row) { return row.predicted_seconds ? si(*row.predicted_seconds, "s") : "-"; }},
         {{"error", 3},
          [](const auto& row) { return error_cell(row.errors ? row.errors->max : std::nullopt); }},
         {{"threshold/motion", 4}, [](const auto& row) { return threshold_text(row.verdict); }}},
        width, out);
    print_samples(rows, out);
    print_what_pays(rows, out);
    print_noise({rows.begin(), rows.end()}, out);
    print_unmeasured(result, out);
}

const RegisteredStudyKind scaling_kind("scaling", [] { return std::make_unique<ScalingStudy>(); });

}  // namespace
}  // namespace voxspring
