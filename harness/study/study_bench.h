// What a kind of study needs to measure one scene: the backends, in other processes, the references, and the
// lists of the result.
#pragma once

#include <concepts>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/base/progress.h"
#include "harness/device/card.h"
#include "harness/device/limits.h"
#include "harness/process/case.h"
#include "harness/process/case_runner.h"
#include "harness/process/journal.h"
#include "harness/process/launcher.h"
#include "harness/results/result.h"
#include "harness/results/row.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"
#include "harness/verification/reference.h"

namespace voxspring {

class StudyKind;

/// Calls begin(n) and, later, finish(n) for each n below `count`, in order. At most `most` are begun and not
/// yet finished at any time.
template <class Begin, class Finish>
void at_once(std::size_t count, std::size_t most, Begin begin, Finish finish) {
    for (std::size_t n = 0; n < count + most; ++n) {
        if (n >= most) finish(n - most);
        if (n < count) begin(n);
    }
}

/// How a case, one backend on one scene, is made ready to be measured.
struct EnterOptions {
    bool limits = false;  ///< also measure the limits of the case's device, once per device
    /// For enter_all(): construct several cases at once, side_by_side() of them, and let those of an API that
    /// takes long to open its device (Api::shares_process) share a few processes, if there are more such
    /// cases than these processes. For studies that do not report the time of construction. A case that fails
    /// in a shared process has to be measured again, alone.
    bool at_once = false;
    bool alone = false;  ///< for enter_all(): no case shares a process
};

/// What a StudyKind measures with. It serves one study, scene after scene.
class StudyBench {
public:
    /// All arguments must outlive this object. Results are collected in `result`.
    StudyBench(const Study& study, const StudyOptions& options, Journal& journal, Progress& progress,
               const StudyKind& kind, Result& result);
    StudyBench(const StudyBench&) = delete;
    StudyBench& operator=(const StudyBench&) = delete;

    /// Looks for the devices that `items` need, by constructing one backend of each API. Backends without a
    /// device are not expected to run, and do not count in the estimate of the time left.
    void look_for_devices(const std::vector<StudyScene>& items);

    /// Turns to a scene of the study. `number`, from 1, identifies `item` in the journal, since a study may
    /// have two items of one scene.
    void turn_to(const StudyScene& item, std::shared_ptr<const Scene> scene, std::size_t number);

    const Study& study() const { return study_; }
    const StudyOptions& options() const { return options_; }
    const StudyScene& item() const { return *item_; }
    const Scene& scene() const { return *scene_; }
    /// The backends that the study asks for on this scene, including those that rules chose for `auto`.
    const std::vector<BackendSpec>& specs() const { return specs_; }
    /// specs() divided into groups, whose cases are measured in turns. There are as few groups of at most
    /// StudyOptions::together backends as possible, and their sizes differ by at most one. Backends that step
    /// on the host are divided in the same way, into groups after all others.
    std::vector<std::vector<BackendSpec>> groups() const;

    /// The case of a backend, ready to be asked. Empty if the backend cannot run the scene or fails, in which
    /// case the result has the reason, or if the study is interrupted.
    std::optional<Case> enter(const BackendSpec& spec, const CaseProgram& program);
    /// The cases of `specs` that can run the scene. If they are constructed at once, each process uses an
    /// equal share of the processors from then on; a backend that steps on the processor uses all of them.
    std::vector<Case> enter_all(std::span<const BackendSpec> specs, const CaseProgram& program,
                                EnterOptions how);
    /// How many cases do untimed work at the same time.
    std::size_t side_by_side() const;
    /// How many cases upload at once. For a heavy scene (is_heavy()) there are at most three: enough that one
    /// computes while the others compile or wait for their device.
    std::size_t uploads_side_by_side() const;

    /// Adds a row to a list of the result. A row that a case's process has made arrives as JSON.
    template <std::derived_from<Row> T>
    void add(const std::string& list, T row) {
        result_.rows<T>(list).push_back(std::move(row));
    }
    void add(const std::string& list, const nlohmann::json& row) { result_.add(list, row); }
    /// Sets the row's identity (the scene and the backend) and its workpiece (the scene's size and `steps`).
    void identify(Row& row, const BackendSpec& spec, int steps) const;
    /// How many of specs() run the scene, as far as is known by now.
    int expected_cases() const;

    /// Both functions add a row to `skipped`. refuse(): the backend does not run the scene at all. skip(): it
    /// runs the scene, but cannot do something that the study asks for.
    void refuse(const BackendSpec& spec, const std::string& reason);
    void skip(const BackendSpec& spec, const std::string& reason);
    /// Adds a row to `failed`.
    void fail(const BackendSpec& spec, const std::string& reason);
    /// Adds a row to `failed` if the journal says that the case failed.
    void add_failure(Case& benchmark_case);

    References& references() { return references_; }
    /// The generator that shuffles the repetitions of several cases. Its seed is in the result.
    std::mt19937& order();
    /// What the devices of the cases that have been entered can do.
    MeasuredLimits& limits() { return limits_; }
    const Card* card() const { return card_.get(); }  ///< null: there is no card, or it cannot be watched
    /// Shows what is being done, and how many of the scene's measurements are done. `total` is the number of
    /// measurements of all expected_cases().
    void show(const std::string& what, int done, int total) { progress_.show(what, done, total); }

    /// Writes the devices of all scenes so far, and their limits, to `context.voxspring` of the result.
    void describe_devices();

private:
    Case case_of(const BackendSpec& spec, const CaseProgram& program,
                 std::shared_ptr<SharedProcess> shared = nullptr);
    /// Returns the case, or nothing if it cannot run the scene, if it failed, or if the study is interrupted.
    /// `limits`: also measures the limits of the case's device.
    std::optional<Case> entered(Case one, bool limits);
    void introduce_at_once(std::vector<Case>& cases) const;
    void expect_less(const BackendSpec& spec);
    bool is_absent(const BackendSpec& spec) const;
    void put(const char* list, const BackendSpec& spec, const std::string& reason);
    std::vector<std::string> with_choices(std::vector<std::string> patterns);
    std::string refusal_of(Case& benchmark_case);
    void watch_card(const std::string& uuid);
    void measure_limits(Case& benchmark_case);
    nlohmann::json& context() { return result_.own_context(); }

    const Study& study_;
    const StudyOptions& options_;
    Journal& journal_;
    Progress& progress_;
    const StudyKind& kind_;
    Result& result_;
    const StudyScene* item_ = nullptr;
    std::shared_ptr<const Scene> scene_;
    Workers workers_;
    std::size_t number_ = 0;
    std::vector<BackendSpec> specs_;
    std::set<std::string> absent_;   ///< APIs and backends that have no device here
    std::set<std::string> refused_;  ///< labels of specs_ that do not run the scene
    MeasuredLimits limits_;
    std::unique_ptr<Card> card_;
    std::optional<std::mt19937> order_;
    References references_;  ///< its computations report progress, and throw Interrupted
};

}  // namespace voxspring
