// A kind of study decides what is measured. To add a kind, add one file in harness/study/kinds that
// implements StudyKind and registers itself.
#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "harness/base/json.h"
#include "harness/results/result.h"
#include "harness/results/table.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {

class StudyBench;

/// One kind of study. An object serves one study, and may keep what it learns from scene to scene. All
/// members throw BadInput for bad input of a user.
class StudyKind {
public:
    StudyKind() = default;
    StudyKind(const StudyKind&) = delete;
    StudyKind& operator=(const StudyKind&) = delete;
    virtual ~StudyKind() = default;

    /// Reads those keys of a study file that belong to the kind. Other keys are refused, unless every kind of
    /// study has them.
    virtual void read(JsonObject&) {}
    /// The key of the list of scenes, usually "scenes"; with another key --scene is refused. read_scene()
    /// returns the scene that an item of the list names, and checks the keys of the item that belong to the
    /// kind. Later these keys are in StudyScene::settings.
    virtual std::string scenes_key() const { return "scenes"; }
    virtual std::string read_scene(JsonObject& item) const { return item.require("scene").string(); }
    /// The scene of an item of the study, if the kind makes the scene; null if load_scene() is to load it.
    virtual std::shared_ptr<const Scene> own_scene(const StudyScene&) const { return nullptr; }

    /// Throws BadInput, before anything is measured, if the scene cannot be studied by this kind.
    virtual void check(const Study&, const StudyScene&, const Scene&) const {}
    /// Whether the kind measures backends with these capabilities, so that `--backend auto` may choose one.
    virtual bool takes(const Capabilities&) const { return true; }
    /// The number of rows that a case adds to the result if it runs, as far as is known beforehand.
    virtual int rows_of_case(const Study&, const StudyScene&) const { return 1; }
    /// The number of steps of a case over all repetitions and all time steps. Used to estimate the time left.
    virtual double steps_of_case(const Study& study, const StudyScene& item) const {
        return double(item.steps) * study.repetitions;
    }

    /// Measures one scene and adds rows to the bench.
    virtual void run(StudyBench& bench) = 0;

    /// Makes the lists of the result that belong to the kind, with the types of their rows (Result::rows()).
    virtual void make_lists(Result&) const {}
    /// Adds what follows from all rows so far. Called whenever the result is written.
    virtual void summarise(Result&) const {}
    /// Prints the result for people.
    virtual void print(const Result& result, std::ostream& out, TableWidth width) const = 0;
};

/// Registers a kind, in the kind's file:
/// `static const RegisteredStudyKind kind("timing", [] { return std::make_unique<Timing>(); });`
struct RegisteredStudyKind {
    RegisteredStudyKind(const std::string& name, std::function<std::unique_ptr<StudyKind>()> make);
};

std::vector<std::string> study_kind_names();
/// Makes a kind by name. Throws std::out_of_range for a name that is not registered.
std::unique_ptr<StudyKind> make_study_kind(const std::string& name);
/// The study's kind, which has read the study's settings. Throws BadInput.
std::unique_ptr<StudyKind> kind_of(const Study& study);

/// Prints a result by its kind.
void print_result(const Result& result, std::ostream& out, TableWidth width = 0);

/// Reads a result from the JSON of its file, which messages call `name`. Its kind of study must be
/// registered. Throws BadInput for a row that cannot be read.
Result read_result(const nlohmann::json& file, const std::string& name = "result");
/// Reads the result of a study of kind `kind`, whose rows are in a list of the same name. Throws BadInput if
/// the file has no such result, a row that could not be printed or in which one of `figures` is not a number
/// from 0 on, or no row of `scene`.
Result read_result_of(const std::string& kind, JsonObject file, const std::string& scene,
                      const std::vector<std::string>& figures);

}  // namespace voxspring
