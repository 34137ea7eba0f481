#include "harness/study/study_bench.h"

#include <omp.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <stdexcept>
#include <utility>

#include "backends/api.h"
#include "backends/disk_cache.h"
#include "harness/base/interruption.h"
#include "harness/base/text.h"
#include "harness/choice/auto_choice.h"
#include "harness/ranks/rank_run.h"
#include "harness/results/capabilities.h"
#include "harness/study/selection.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

bool has_driver(const BackendSpec& spec) { return spec.entry->api != host_api; }

bool shares_process(const BackendSpec& spec) {
    const auto api = apis().find(spec.entry->api);
    return api != apis().end() && api->second.shares_process;
}

/// The most processes that the cases of a group share. On a server with an H200, opening the card takes
/// 0.18 s of each process and closing it 0.07 s, one process after the other. Kernels are compiled in as many
/// threads as there are processes, so one process would be too few.
constexpr std::size_t max_shared_processes = 4;

/// The time-out of look_for_devices(): longer than a driver takes to report whether there is a device. A
/// backend that hangs there hangs again when its case begins, and its row then says so.
constexpr std::chrono::seconds patience_for_devices{20};

/// Empty, or why a backend on the card `uuid` may not be in one result with `backends`, which are described
/// in it.
std::string other_card(const nlohmann::json& backends, const std::string& uuid) {
    for (const auto& [name, backend] : backends.items()) {
        const std::string card = capabilities_of(backend).uuid;
        if (uuid.empty() || card.empty() || card == uuid) continue;
        return "is on card " + uuid + ", but " + name + " on card " + card +
               ": a study compares backends on one card only";
    }
    return {};
}

}  // namespace

StudyBench::StudyBench(const Study& study, const StudyOptions& options, Journal& journal, Progress& progress,
                       const StudyKind& kind, Result& result)
    : study_(study),
      options_(options),
      journal_(journal),
      progress_(progress),
      kind_(kind),
      result_(result),
      workers_(options.worker),
      references_(DiskCache{}, [this](int done, int steps) {
          if (interrupted()) throw Interrupted();
          show("float64 reference, " + std::to_string(done) + " of " + counted(std::uint64_t(steps), "step"),
               0, 1);
      }) {}

void StudyBench::look_for_devices(const std::vector<StudyScene>& items) {
    std::set<std::string> asked;
    for (const StudyScene& item : items) {
        for (const BackendSpec& spec : known_specs(study_, item)) {
            if (interrupted() || !has_driver(spec) || !asked.insert(spec.entry->api).second) continue;
            (void)failure_of([&] {
                try {
                    (void)introduce(spec, workers_, std::min(options_.timeout, {patience_for_devices}));
                } catch (const Unavailable&) {
                    absent_.insert(spec.entry->api);
                }
            });
        }
    }
    for (std::size_t n = 0; n < items.size(); ++n) {
        const std::vector<BackendSpec> known = known_specs(study_, items[n]);
        progress_.expect(n, int(std::count_if(known.begin(), known.end(),
                                              [&](const auto& spec) { return !is_absent(spec); })));
    }
}

bool StudyBench::is_absent(const BackendSpec& spec) const {
    return absent_.contains(spec.entry->api) || absent_.contains(spec.entry->name);
}

int StudyBench::expected_cases() const { return int(specs_.size() - refused_.size()); }

void StudyBench::expect_less(const BackendSpec& spec) {
    refused_.insert(spec.label());
    progress_.expect(number_ - 1, expected_cases());
}

void StudyBench::turn_to(const StudyScene& item, std::shared_ptr<const Scene> scene, std::size_t number) {
    item_ = &item;
    workers_.turn_to(scene.get());
    scene_ = std::move(scene);
    number_ = number;
    specs_ = select(expand_all(with_choices(patterns_of(study_, item))), with_choices(item.only));
    refused_.clear();
    for (const BackendSpec& spec : specs_) {
        if (is_absent(spec)) refused_.insert(spec.label());
    }
    progress_.expect(number_ - 1, expected_cases());
}

std::vector<std::vector<BackendSpec>> StudyBench::groups() const {
    const auto most = std::size_t(options_.together);
    std::vector<BackendSpec> specs = specs_;
    const auto of_host = std::stable_partition(specs.begin(), specs.end(), has_driver);
    std::vector<std::vector<BackendSpec>> groups;
    for (const auto& [first, last] : {std::pair(specs.begin(), of_host), std::pair(of_host, specs.end())}) {
        const auto size = std::size_t(last - first), count = (size + most - 1) / most;
        for (std::size_t n = 0; n < count; ++n)
            groups.emplace_back(first + std::ptrdiff_t(size * n / count),
                                first + std::ptrdiff_t(size * (n + 1) / count));
    }
    return groups;
}

Case StudyBench::case_of(const BackendSpec& spec, const CaseProgram& program,
                         std::shared_ptr<SharedProcess> shared) {
    return Case(spec, workers_, program,
                JournalScope(journal_, std::to_string(number_) + " " + spec.label() + " "), options_.timeout,
                std::move(shared));
}

std::optional<Case> StudyBench::enter(const BackendSpec& spec, const CaseProgram& program) {
    return entered(case_of(spec, program), false);
}

std::optional<Case> StudyBench::entered(Case one, bool limits) {
    const BackendSpec& spec = one.spec();
    if (const nlohmann::json* failed = one.scope().find("not entered")) {
        fail(spec, *failed);
        expect_less(spec);
        return std::nullopt;
    }
    std::string unavailable, reason;
    const auto failure = failure_of([&] {
        try {
            reason = refusal_of(one);
            if (reason.empty() && limits) measure_limits(one);
        } catch (const Unavailable& absent) {
            unavailable = absent.what();
        }
    });
    if ((failure || !unavailable.empty()) && one.shares_process()) {
        if (failure) one.say_measured_again(*failure);
        return entered(one.alone(), limits);
    }
    // A backend that has been described found its device earlier in this study, so the device has been lost
    // since.
    const bool lost = context()["backends"].contains(spec.entry->name);
    if (failure) {
        one.scope().keep("not entered", *failure);
        fail(spec, *failure);
    }
    if (!unavailable.empty()) put(lost ? "failed" : "skipped", spec, unavailable);
    if (!unavailable.empty() && !lost) absent_.insert(spec.entry->name);
    if (!reason.empty()) skip(spec, reason);
    if (!reason.empty()) one.dismiss();
    if (failure || !unavailable.empty() || !reason.empty()) expect_less(spec);
    if (failure || !unavailable.empty() || !reason.empty() || interrupted()) return std::nullopt;
    return one;
}

std::size_t StudyBench::side_by_side() const {
    const int half = std::max(1, omp_get_num_procs() / 2);
    return std::size_t(options_.side_by_side.value_or(half));
}

std::size_t StudyBench::uploads_side_by_side() const {
    constexpr std::size_t of_heavy = 3;
    return is_heavy(scene()) ? std::min(of_heavy, side_by_side()) : side_by_side();
}

/// Constructs the backends of all cases side by side, before the first of them measures its device's limits.
void StudyBench::introduce_at_once(std::vector<Case>& cases) const {
    at_once(
        cases.size(), side_by_side(), [&](std::size_t n) { cases[n].begin_introduction(); },
        [&](std::size_t n) { cases[n].await_introduction(); });
}

std::vector<Case> StudyBench::enter_all(std::span<const BackendSpec> specs, const CaseProgram& program,
                                        EnterOptions how) {
    CaseProgram with_its_share = program;
    // omp_get_num_procs() counts only the processors that this process may use, for example under taskset or
    // in a container with a set of processors.
    with_its_share.threads = std::max(1, omp_get_num_procs() / int(uploads_side_by_side()));
    std::vector<std::shared_ptr<SharedProcess>> processes(std::min(side_by_side(), max_shared_processes));
    for (auto& process : processes) process = std::make_shared<SharedProcess>();
    std::vector<Case> made, cases;
    // With a process for each case none is shared, and a case that fails fails by its own fault.
    const auto sharers = std::size_t(std::count_if(specs.begin(), specs.end(), shares_process));
    const bool share = how.at_once && !how.alone && sharers > processes.size();
    std::size_t sharing = 0;
    for (const BackendSpec& spec : specs) {
        const bool shares = share && shares_process(spec);
        made.push_back(case_of(spec, how.at_once && has_driver(spec) ? with_its_share : program,
                               shares ? processes[sharing++ % processes.size()] : nullptr));
    }
    if (how.at_once) {
        show("constructing " + counted(made.size(), "backend"), 0, 1);
        introduce_at_once(made);
    }
    for (Case& one : made) {
        show(one.spec().label(), 0, 1);
        if (auto can = entered(std::move(one), how.limits)) cases.push_back(*std::move(can));
    }
    return cases;
}

void StudyBench::identify(Row& row, const BackendSpec& spec, int steps) const {
    row.identity = row_of(scene_->name, spec).identity;
    row.workpiece = Workpiece{.steps = steps,
                              .particles = scene_->problem.particle_count(),
                              .springs = count_springs(scene_->problem).total()};
}

void StudyBench::put(const char* list, const BackendSpec& spec, const std::string& reason) {
    Row row = row_of(scene_->name, spec);
    row.reason = reason;
    add(list, row);
}

void StudyBench::refuse(const BackendSpec& spec, const std::string& reason) {
    skip(spec, reason);
    expect_less(spec);
}
void StudyBench::skip(const BackendSpec& spec, const std::string& reason) { put("skipped", spec, reason); }
void StudyBench::fail(const BackendSpec& spec, const std::string& reason) { put("failed", spec, reason); }

void StudyBench::add_failure(Case& benchmark_case) {
    if (const nlohmann::json* reason = benchmark_case.scope().find("failed"))
        fail(benchmark_case.spec(), *reason);
}

/// Returns `patterns` with "auto" replaced by what the rules choose for the scene. Adds a row to the list
/// `auto` for each choice.
std::vector<std::string> StudyBench::with_choices(std::vector<std::string> patterns) {
    for (std::string& pattern : patterns) {
        if (!asks_for_auto(pattern)) continue;
        std::string passed_over;
        const DeviceNumber device = RankPlan{.devices = options_.devices}.first_device();
        const Chosen choice = choose_by_rules(pattern, *scene_, [&](const BackendSpec& spec) {
            bool taken = false;
            (void)failure_of([&] {
                const nlohmann::json introduction = introduce(spec, workers_, options_.timeout, device);
                const Capabilities capabilities = capabilities_of(introduction.at("capabilities"));
                taken = may_be_chosen(capabilities) && kind_.takes(capabilities) &&
                        introduction.at("unsupported") == "";
                const std::string why = introduction.at("outpaced");
                if (!taken || why.empty()) return;
                passed_over += passed_over_text(spec, why);
                taken = false;
            });
            return taken;
        });
        Row row = row_of(scene_->name, choice.spec);
        row.pattern = pattern;
        row.reason = choice.reason + passed_over;
        add("auto", row);
        pattern = choice.spec.text();
    }
    return patterns;
}

/// Makes the case construct and describe its backend. Returns why the backend cannot run the scene; empty if
/// it can.
std::string StudyBench::refusal_of(Case& benchmark_case) {
    const nlohmann::json introduction = benchmark_case.introduce();
    const nlohmann::json& described = introduction.at("capabilities");
    const std::string uuid = capabilities_of(described).uuid;
    nlohmann::json& backends = context()["backends"];
    if (std::string other = other_card(backends, uuid); !other.empty()) return other;
    std::string unsupported = introduction.at("unsupported");
    if (unsupported.empty()) {
        const BackendEntry& entry = *benchmark_case.spec().entry;
        nlohmann::json& known = backends[entry.name] = described;
        known["addressing"] = to_string(entry.addressing);
        if (const auto api = apis().find(entry.api); api != apis().end()) known["title"] = api->second.title;
        watch_card(uuid);
    }
    return unsupported;
}

std::mt19937& StudyBench::order() {
    if (!order_) {
        const std::uint32_t seed = std::random_device{}();
        context()["order_seed"] = seed;
        order_.emplace(seed);
    }
    return *order_;
}

/// Begins to watch the first card that a backend uses. A study uses only this card, unless it shares a scene
/// among ranks: refusal_of() refuses backends on others.
void StudyBench::watch_card(const std::string& uuid) {
    if (uuid.empty() || context().contains("card_watched")) return;
    try {
        card_ = std::make_unique<Card>(uuid);
        context()["card_watched"] = "yes";
        context()["card"] = card_->settings();
    } catch (const std::runtime_error& reason) {
        context()["card_watched"] = std::string("not known: ") + reason.what();
    }
}

/// Sets the case's limits. A device's limits are measured once, by the first case on that device.
void StudyBench::measure_limits(Case& benchmark_case) {
    benchmark_case.limits = limits_.of(capabilities_of(benchmark_case.capabilities()), [&] {
        return benchmark_case.measure_limits(JournalScope(journal_, "limits "));
    });
}

void StudyBench::describe_devices() {
    nlohmann::json& all = context();
    for (const auto& [name, backend] : all.at("backends").items()) {
        const Capabilities device = capabilities_of(backend);
        if (device.steps_on_host()) continue;
        const auto api = apis().find(device.family);
        if (api != apis().end() && !api->second.device_field.empty())
            all[api->second.device_field] = device.device;
        if (all["driver"].is_null()) all["driver"] = device.driver;
    }
    all["limits"] = limits_.json();
}

}  // namespace voxspring
