// What a kind of study measures one scene with: the backends, each in a process of its own, the references
// and the lists that rows go to.
#pragma once

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
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
#include "harness/results/row.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"
#include "harness/verification/reference.h"

namespace voxspring {

/// Calls begin(n) and, later, finish(n) for each n below `count`, in order, with at most `most` begun and not
/// finished.
template <class Begin, class Finish>
void at_once(std::size_t count, std::size_t most, Begin begin, Finish finish) {
    for (std::size_t n = 0; n < count + most; ++n) {
        if (n >= most) finish(n - most);
        if (n < count) begin(n);
    }
}

/// How a case is made ready.
struct Entering {
    bool limits = false;  ///< what its device can do at best is measured as well, once a device
    /// Construct several at once, side_by_side() of them, and in processes of cases before, where nobody
    /// wants to know how long that takes.
    bool at_once = false;
};

/// Serves one study, scene after scene.
class StudyBench {
public:
    /// All must outlive it. Results gather in `result`.
    StudyBench(const Study& study, const StudyOptions& options, Journal& journal, Progress& progress,
               nlohmann::json& result);
    StudyBench(const StudyBench&) = delete;
    StudyBench& operator=(const StudyBench&) = delete;

    /// Looks for the devices that `items` need: a backend of each API is constructed. Whose device is not
    /// here is not expected to run, which the time left is estimated by.
    void look_for_devices(const std::vector<StudyScene>& items);

    /// Turns to a scene of the study, whose number, from 1, names it in the journal: one may be there twice.
    void turn_to(const StudyScene& item, std::shared_ptr<const Scene> scene, std::size_t number);

    const Study& study() const { return study_; }
    const StudyOptions& options() const { return options_; }
    const StudyScene& item() const { return *item_; }
    const Scene& scene() const { return *scene_; }
    /// The backends that the study asks for on this scene, choices of the rules included.
    const std::vector<BackendSpec>& specs() const { return specs_; }
    /// The same in as few groups of at most StudyOptions::together as it takes, whose sizes differ by one at
    /// most.
    std::vector<std::span<const BackendSpec>> groups() const;

    /// The case of a backend, ready to be asked; nothing where it cannot run the scene, which the result then
    /// says.
    std::optional<Case> enter(const BackendSpec& spec, const CaseProgram& program, Entering how = {});
    /// Those of `specs` that can run the scene. Where they construct at once, each has its share of the
    /// processors from then on, but for backends that step on these.
    std::vector<Case> enter_all(std::span<const BackendSpec> specs, const CaseProgram& program, Entering how);
    /// How many cases do at once what is not timed.
    std::size_t side_by_side() const;
    /// How many of them upload at once: of a heavy scene enough that one computes while others compile or
    /// wait for their device.
    std::size_t uploads_side_by_side() const;

    /// Adds a row to a list of the result.
    void add(const std::string& list, nlohmann::json row);
    void add(const std::string& list, const Row& row) { add(list, to_json(row)); }
    /// How many of specs() run the scene, as far as that is known by now.
    int expected_cases() const;

    /// Adds a row to `skipped`: the backend does not run the scene, or there is something that it cannot do
    /// there.
    void refuse(const BackendSpec& spec, const std::string& reason);
    void skip(const BackendSpec& spec, const std::string& reason);
    /// Adds a row to `failed`.
    void fail(const BackendSpec& spec, const std::string& reason);
    /// Adds to `failed` what the journal says of a case that failed.
    void add_failure(Case& benchmark_case);

    References& references() { return references_; }
    /// Puts repetitions of several cases in a random order. The result tells its seed.
    std::mt19937& order();
    const Card* card() const { return card_.get(); }  ///< null: there is none, or it cannot be watched
    /// What is being done, and how much of the scene's measurements is; `total` is of expected_cases().
    void show(const std::string& what, int done, int total) { progress_.show(what, done, total); }

    /// Fills `context.voxspring` with the devices and limits of all scenes so far.
    void describe_devices();

private:
    Case case_of(const BackendSpec& spec, const CaseProgram& program, bool second_hand);
    /// The case, unless it cannot run the scene.
    std::optional<Case> entered(Case one, bool limits);
    void introduce_at_once(std::vector<Case>& cases) const;
    void expect_less(const BackendSpec& spec);
    bool is_absent(const BackendSpec& spec) const;
    void put(const char* list, const BackendSpec& spec, const std::string& reason);
    std::vector<std::string> with_choices(std::vector<std::string> patterns);
    std::string refusal_of(Case& benchmark_case);
    void watch_card(const std::string& uuid);
    void measure_limits(Case& benchmark_case);
    nlohmann::json& context() { return result_["context"]["voxspring"]; }

    const Study& study_;
    const StudyOptions& options_;
    Journal& journal_;
    Progress& progress_;
    nlohmann::json& result_;
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
    References references_;  ///< tells how far they are, and ends with Interrupted
};

/// The backends that are known before the scene is loaded: without what the rules would take.
std::vector<BackendSpec> known_specs(const Study& study, const StudyScene& item);

}  // namespace voxspring
