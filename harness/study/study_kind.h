// What a study measures. Adding a kind: one file in harness/study/kinds that implements StudyKind and
// registers itself.
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "harness/base/json.h"
#include "harness/results/table.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {

class StudyBench;

/// One kind of study. An object serves one study: it may keep what it learns from scene to scene. All throw
/// BadInput for what a user wrote.
class StudyKind {
public:
    StudyKind() = default;
    StudyKind(const StudyKind&) = delete;
    StudyKind& operator=(const StudyKind&) = delete;
    virtual ~StudyKind() = default;

    /// Reads its own keys of a study file; what it does not ask for is refused.
    virtual void read(JsonObject& study);
    /// The key of the list of scenes, "scenes", and what such an item names; and its own keys of one, which
    /// the item's settings have later.
    virtual std::string scenes_key() const { return "scenes"; }
    virtual std::string read_scene(JsonObject& item) const;
    /// The scene of an item, where that is not load_scene()'s; null: it is. Such a kind takes no --scene.
    virtual std::shared_ptr<const Scene> own_scene(const StudyScene& item) const;

    /// Whether the scene can be studied so, before anything is measured.
    virtual void check(const Study& study, const StudyScene& item, const Scene& scene) const;
    /// Whether it measures backends with these capabilities, so that `auto` may choose one.
    virtual bool takes(const Capabilities&) const { return true; }
    /// How many rows a case that runs adds to the result, as far as that is known beforehand.
    virtual int rows_of_case(const Study& study, const StudyScene& item) const;
    /// How many steps a case takes, all repetitions and time steps together: what the time left is estimated
    /// by.
    virtual double steps_of_case(const Study& study, const StudyScene& item) const;

    /// Measures one scene; rows go to the bench.
    virtual void run(StudyBench& bench) = 0;

    /// Names of the lists that its results have beside `benchmarks`, `verification`, `skipped` and `failed`.
    virtual std::vector<std::string> lists() const { return {}; }
    /// The schema that these lists are described by.
    virtual std::string schema() const { return "urn:voxspring:result:1"; }
    /// What follows from all rows so far; called whenever the result is written.
    virtual void summarise(nlohmann::json& result) const;
    /// For people.
    virtual void print(const nlohmann::json& result, std::ostream& out, TableWidth width) const = 0;
};

/// `static const RegisteredStudyKind kind("timing", [] { return std::make_unique<Timing>(); });` in its file.
struct RegisteredStudyKind {
    RegisteredStudyKind(const std::string& name, std::function<std::unique_ptr<StudyKind>()> make);
};

std::vector<std::string> study_kind_names();
/// Throws std::out_of_range for a name that is not registered.
std::unique_ptr<StudyKind> make_study_kind(const std::string& name);
/// One that has read the study's settings. Throws BadInput.
std::unique_ptr<StudyKind> kind_of(const Study& study);

/// Prints a result as its kind does.
void print_result(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
