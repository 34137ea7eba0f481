// The kind of study `truth`: how far a lattice at rest is from the continuum, over pitches.
#include "harness/study/truth.h"

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "harness/base/interruption.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

// --- In the process of a case ---------------------------------------------------------------------------

class TruthRunner final : public CaseRunner {
public:
    explicit TruthRunner(const Scene& scene) : case_(truth_case(scene.name, "study")) {}

    /// An object with `unsupported` if the backend does not take the lattice.
    nlohmann::json answer(Backend& backend, const nlohmann::json& question, const OnEvent&) override {
        const std::string strain = question.at("strain");
        const bool corners = question.at("particles_at") == "corners";
        const ContinuumAnswer truth = continuum_answer(case_, strain);
        const TruthLattice lattice = truth_lattice(case_, truth.load, question.at("across"), corners);
        if (const std::string why = backend.unsupported(lattice.problem); !why.empty())
            return {{"unsupported", why}};
        const RestAnswer rest = come_to_rest(backend, lattice);
        TruthRow row;
        row.particles_at = question.at("particles_at");
        row.strain = strain;
        row.across = question.at("across");
        row.time_step_fraction = lattice.fraction_of_stable;
        row.deflection = rest.deflection;
        row.continuum = truth.deflection;
        row.continuum_error = truth.error;
        row.model_error = std::abs(rest.deflection / truth.deflection - 1);
        row.claimed_order = corners ? case_.order_at_corners : case_.order_at_centres;
        row.neo_hookean = truth.neo_hookean;
        row.st_venant_kirchhoff = truth.st_venant_kirchhoff;
        row.seconds = rest.seconds;
        row.workpiece = Workpiece{.steps = rest.steps,
                                  .particles = lattice.problem.particle_count(),
                                  .springs = count_springs(lattice.problem).total()};
        return json_of(row);
    }

private:
    const TruthCase& case_;
};

const RegisteredCaseRunner truth_runner("truth",
                                        [](const BackendSpec&, const Scene& scene, const nlohmann::json&,
                                           SharedState*) { return std::make_unique<TruthRunner>(scene); });

// --- In the process of the study ------------------------------------------------------------------------

class TruthStudy final : public StudyKind {
public:
    void read(JsonObject& study) override {
        for (const JsonValue& item : study.require("voxels_across", "numbers of voxels").array(1, 16))
            across_.push_back(int(item.integer(2, 64)));
    }
    std::string read_scene(JsonObject& item) const override {
        if (const auto across = item.find("voxels_across")) {
            for (const JsonValue& number : across->array(1, 16)) (void)number.integer(2, 64);
        }
        return StudyKind::read_scene(item);
    }
    /// The runner makes the lattices. This placeholder is a scene that every backend takes.
    std::shared_ptr<const Scene> own_scene(const StudyScene& item) const override {
        Scene scene = load_scene("box@2");
        scene.name = truth_case(item.scene, "study").name;
        return std::make_shared<const Scene>(std::move(scene));
    }
    int rows_of_case(const Study&, const StudyScene& item) const override {
        return 4 * int(across_of(item).size());
    }
    void run(StudyBench& bench) override {
        std::vector<TruthRow> rows;
        // One case after another, since they are timed.
        for (const BackendSpec& spec : bench.specs()) measure(bench, spec, rows);
        const std::vector<std::string> reasons = judge_truth(rows);
        for (std::size_t n = 0; n < rows.size(); ++n) {
            bench.add("truth", rows[n]);
            if (reasons[n].empty()) continue;
            Row failed = rows[n];
            failed.reason = reasons[n];
            bench.add("failed", failed);
        }
    }

    void make_lists(Result& result) const override { result.rows<TruthRow>("truth"); }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_truth(result, out, width);
        print_unmeasured(result, out);
    }

private:
    std::vector<int> across_of(const StudyScene& item) const {
        return item.settings.value("voxels_across", across_);
    }
    /// Measures a backend and adds its rows to `rows`.
    void measure(StudyBench& bench, const BackendSpec& spec, std::vector<TruthRow>& rows) const {
        auto entered = bench.enter(spec, {"truth"});
        if (!entered) return;
        for (const std::string particles_at : {"corners", "centres"}) {
            for (const std::string strain : {"small", "large"}) {
                for (const int across : across_of(bench.item())) {
                    if (interrupted()) return;
                    const std::string name =
                        particles_at + ", " + strain + " strain, " + std::to_string(across) + " across";
                    bench.show(spec.label() + ", " + name, int(rows.size()),
                               rows_of_case(bench.study(), bench.item()) * bench.expected_cases());
                    const nlohmann::json question = {{"do", "rest"},
                                                     {"particles_at", particles_at},
                                                     {"strain", strain},
                                                     {"across", across}};
                    const nlohmann::json* measured = entered->kept(
                        name, [&] { return entered->ask(question, "coming to rest"); }, name + ": ");
                    if (measured == nullptr) continue;
                    if (measured->contains("unsupported")) {
                        if (across == across_of(bench.item()).front() && strain == "small")
                            bench.skip(spec, "particles at " + particles_at + ": " +
                                                 measured->at("unsupported").get<std::string>());
                        continue;
                    }
                    auto row = row_of_json<TruthRow>(*measured);
                    row.identity = row_of(bench.scene().name, spec).identity;
                    rows.push_back(std::move(row));
                }
            }
        }
        bench.add_failure(*entered);
    }

    std::vector<int> across_;
};

const RegisteredStudyKind truth_kind("truth", [] { return std::make_unique<TruthStudy>(); });

}  // namespace
}  // namespace voxspring
