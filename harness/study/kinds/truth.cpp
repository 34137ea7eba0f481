// The kind of study `truth`: how far a lattice at rest is from the continuum, over pitches.
#include "harness/study/kinds/truth.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/geometric.hpp>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <stdexcept>
#include <utility>

#include "backends/layout/boxes.h"
#include "backends/physics/neighbours.h"
#include "continuum_files.h"  // generated
#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/json.h"
#include "harness/base/text.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/corners.h"
#include "harness/scene/stability.h"
#include "harness/scene/units.h"
#include "harness/study/study_bench.h"
#include "harness/study/study_kind.h"

namespace voxspring {
namespace {

/// A lattice counts as at rest when its deflection changes by at most this fraction between two checks, twice
/// in succession. Once would not do: at large strain the lattice swings a little, and hardly moves where it
/// turns back. The remaining error is about a sixth of this.
constexpr double rest_change = 3e-5;
constexpr int most_looks = 60;
/// A measured order of convergence may be below the claimed one by this much. The claimed orders are those
/// from 4 to 12 voxels across; at other pitches the order differs by about a tenth.
constexpr double order_tolerance = 0.2;

glm::dvec3 pattern_at(char pattern, glm::dvec3 place) {
    if (pattern == 'x') return {1, 0, 0};
    if (pattern == 'z') return {0, 0, 1};
    return {0.5 - place.y, place.x - 0.5, 0};
}

VoxelGrid voxels_of(const TruthCase& of, int across) {
    const double pitch = 1.0 / across;
    VoxelGrid grid{{across, across, int(std::lround(of.height * across))}, glm::dvec3(pitch), {}};
    layout::visit_box(glm::ivec3(0), grid.dims, [&](const glm::ivec3& at) {
        const glm::dvec3 centre = (glm::dvec3(at) + 0.5) * pitch;
        const bool inside = !of.is_ball || glm::length(centre - glm::dvec3(0.5, 0.5, of.height / 2)) < 0.5;
        grid.label.push_back(inside ? 1 : 0);
    });
    return grid;
}

}  // namespace

const std::vector<TruthCase>& truth_cases() {
    // Angular frequencies of a clamped bar of width 1, with E = density = 1 and G = 0.4: pi / (2 L) c for
    // tension (c = 1) and torsion (c = sqrt(G J / I), J / I = 0.1406 / (1/6)), 3.516 sqrt(1/12) / L^2 for
    // bending.
    using std::numbers::pi;
    static const std::vector<TruthCase> cases = {
        {.name = "tension", .height = 3, .pattern = 'z', .slowest = pi / 6, .order_at_corners = 1.4},
        {.name = "torsion",
         .height = 3,
         .pattern = 't',
         .slowest = 0.58 * pi / 6,
         .order_at_corners = 1.55,
         .order_at_centres = std::nullopt},
        {.name = "cantilever",
         .height = 4,
         .is_body_load = true,
         .pattern = 'x',
         .slowest = 3.516 * 0.2887 / 16,
         .order_at_corners = 1.75},
        {.name = "cube",
         .height = 1,
         .is_body_load = true,
         .pattern = 'z',
         .slowest = pi / 2,
         .order_at_corners = 1.25},
        {.name = "ball",
         .height = 0.75,
         .is_ball = true,
         .pattern = 'z',
         .slowest = pi / 2,
         .order_at_corners = 0.9,
         .order_at_centres = 0.9},
    };
    return cases;
}

const TruthCase& truth_case(const std::string& name, const std::string& where) {
    std::vector<std::string> known;
    for (const TruthCase& one : truth_cases()) {
        if (one.name == name) return one;
        known.push_back(one.name);
    }
    throw BadInput(where, "scene", name, "one of the cases " + joined(known));
}

ContinuumAnswer continuum_answer(const TruthCase& of, const std::string& strain) {
    static const nlohmann::json all = parsed_json(continuum_files.at("continuum.json"));
    const nlohmann::json& one = all.at(of.name);
    const nlohmann::json& laws = one.at("deflection").at(strain);
    const auto value = [&](const char* law) { return laws.at(law).at("value").get<double>(); };
    ContinuumAnswer answer{.load = one.at("load").at(strain),
                           .deflection = value("springs"),
                           .error = laws.at("springs").at("error"),
                           .neo_hookean = {},
                           .st_venant_kirchhoff = {}};
    if (strain == "large") {
        answer.neo_hookean = value("neo_hookean") / answer.deflection - 1;
        answer.st_venant_kirchhoff = value("st_venant_kirchhoff") / answer.deflection - 1;
    }
    return answer;
}

double TruthLattice::deflection(const State& state) const {
    double sum = 0;
    for (std::size_t n = 0; n < end.size(); ++n) sum += glm::dot(pattern[n], state.displacement[end[n]]);
    return sum / size;
}

TruthLattice truth_lattice(const TruthCase& of, double load, int across, bool corners) {
    const double pitch = 1.0 / across;
    const VoxelGrid grid = voxels_of(of, across);
    const std::uint32_t groups = FACE_BITS | EDGE_BITS;
    const VoxelMaterial material{std::pow(pitch, 3), isotropic_stiffness(1, pitch, groups).value()};
    TruthLattice lattice;
    Problem& problem = lattice.problem;
    if (corners) {
        problem = make_corner_problem(grid, groups, {material});
    } else {
        problem = make_lattice_problem(grid, groups);
        problem.materials = {{material.mass, material.stiffness[0]}};
        problem.group_stiffness = material.stiffness;
    }
    double top = 0;
    for (const glm::dvec3& place : problem.rest_position) top = std::max(top, place.z);
    const glm::dvec3 shift = corners ? glm::dvec3(0) : glm::dvec3(pitch / 2);
    std::vector<std::uint8_t> pinned(problem.particle_count());
    double area = 0;
    for (std::uint32_t i = 0; i < problem.particle_count(); ++i) {
        const glm::dvec3 place = problem.rest_position[i];
        pinned[i] = place.z == 0;
        if (place.z < top) continue;
        // Up to four voxels meet at a corner on the highest side. Each gives the particle there an eighth of
        // its mass and a quarter of its face.
        const double share = problem.material_of(i).mass / pitch * (corners ? 2 : 1);
        const glm::dvec3 pattern = pattern_at(of.pattern, place + shift);
        lattice.end.push_back(i);
        lattice.pattern.push_back(share * pattern);
        lattice.size += share * glm::dot(pattern, pattern);
        area += share;
    }
    pin(problem, std::move(pinned));
    if (of.is_body_load) {
        problem.gravity = load * pattern_at(of.pattern, {});
    } else {
        // The highest side of a ball made of voxels has another area than the circle that it stands for. The
        // total force is the circle's.
        const double radius_squared = 0.25 - of.height * of.height / 4;
        const double wanted = of.is_ball ? std::numbers::pi * radius_squared : 1;
        problem.load.resize(problem.particle_count());
        for (std::size_t n = 0; n < lattice.end.size(); ++n)
            problem.load[lattice.end[n]] = load * wanted / area * lattice.pattern[n];
    }
    // The damping is critical for the slowest motion. On coarse lattices this damping lowers the stable time
    // step, which is therefore computed once more.
    const double g = of.slowest * TruthLattice::fraction_of_stable * stable_time_step(problem);
    problem.damping = 2 * g / (1 + g);
    problem.time_step = TruthLattice::fraction_of_stable * stable_time_step(problem);
    lattice.steps_between_looks = int(std::ceil(2 / (of.slowest * problem.time_step)));
    return lattice;
}

RestAnswer come_to_rest(Backend& backend, const TruthLattice& lattice) {
    backend.upload(lattice.problem, State());
    RestAnswer answer;
    double before = 0;
    int at_rest = 0;
    for (int look = 0; look < most_looks; ++look) {
        answer.seconds += backend.timed([&] { backend.step(lattice.steps_between_looks); }).device_seconds;
        answer.steps += lattice.steps_between_looks;
        answer.deflection = lattice.deflection(backend.download());
        if (!std::isfinite(answer.deflection)) throw std::runtime_error("the run has diverged");
        const bool rests = std::abs(answer.deflection - before) <= rest_change * std::abs(answer.deflection);
        at_rest = rests ? at_rest + 1 : 0;
        if (at_rest == 2) return answer;
        before = answer.deflection;
    }
    throw std::runtime_error("the body is not at rest after " + counted(std::uint64_t(answer.steps), "step"));
}

std::vector<std::string> judge_truth(std::vector<TruthRow>& rows) {
    using Key = std::array<std::string, 4>;
    const auto lattice_of = [](const TruthRow& row) {
        return Key{row.identity.scene, row.particles_at, row.strain, std::to_string(row.across)};
    };
    std::map<Key, double> exact;
    std::map<Key, std::vector<TruthRow*>> sequences;
    for (TruthRow& row : rows) {
        if (row.identity.precision == "float64" && row.identity.formulation == "increment")
            exact.emplace(lattice_of(row), row.deflection);
        sequences[{row.identity.scene, row.particles_at, row.strain, row.label()}].push_back(&row);
    }
    std::vector<std::string> reasons(rows.size());
    for (TruthRow& row : rows) {
        const auto found = exact.find(lattice_of(row));
        if (found != exact.end()) row.rounding_error = std::abs(row.deflection / found->second - 1);
    }
    for (auto& [key, sequence] : sequences) {
        std::sort(sequence.begin(), sequence.end(),
                  [](const TruthRow* a, const TruthRow* b) { return a->across < b->across; });
        for (TruthRow* row : sequence) {
            const TruthRow& coarsest = *sequence.front();
            if (row->across == coarsest.across || !(row->model_error > 0)) continue;
            row->order = std::log(coarsest.model_error / row->model_error) /
                         std::log(double(row->across) / coarsest.across);
        }
        TruthRow& finest = *sequence.back();
        // Errors below `floor` do not count: neither the finite elements nor the test for rest is more
        // accurate.
        const double floor = 3 * finest.continuum_error + rest_change;
        if (finest.order && finest.claimed_order && finest.model_error > floor &&
            *finest.order < *finest.claimed_order - order_tolerance)
            reasons[std::size_t(&finest - rows.data())] = fmt::format(
                "converges to the continuum with order {:.2f}, not {:.2f}: particles at {}, {} strain",
                *finest.order, *finest.claimed_order, finest.particles_at, finest.strain);
    }
    return reasons;
}

const TruthRow* fastest_truth(const std::vector<TruthRow>& rows, const std::string& name, double error) {
    const TruthRow* best = nullptr;
    for (const TruthRow& row : rows) {
        if (row.identity.scene != name || row.strain != "small" || row.model_error > error) continue;
        if (!row.claimed_order) continue;  // without a claimed order the error may be small by chance
        if (best == nullptr || row.seconds < best->seconds) best = &row;
    }
    return best;
}

namespace {

void print_truth(const Result& result, std::ostream& out, TableWidth width) {
    const std::vector<TruthRow>& rows = result.rows<TruthRow>("truth");
    print_cells<TruthRow>(
        rows,
        {{{"case", 0, true}, [](const auto& row) { return row.identity.scene; }},
         {{"strain", 0, true}, [](const auto& row) { return row.strain; }},
         {{"particles at", 0, true}, [](const auto& row) { return row.particles_at; }},
         {{"backend", 1, true}, [](const auto& row) { return row.label(); }},
         {{"across"}, [](const auto& row) { return std::to_string(row.across); }},
         {{"particles", 3}, [](const auto& row) { return std::to_string(row.workpiece->particles); }},
         {{"steps", 2}, [](const auto& row) { return std::to_string(row.workpiece->steps); }},
         {{"time"}, [](const auto& row) { return si(row.seconds, "s"); }},
         {{"deflection", 4}, [](const auto& row) { return fmt::format("{:.5g}", row.deflection); }},
         {{"model error"}, [](const auto& row) { return error_cell(row.model_error); }},
         {{"order"}, [](const auto& row) { return row.order ? fixed_text(*row.order, 2) : "-"; }},
         {{"rounding", 1}, [](const auto& row) { return error_cell(row.rounding_error); }}},
        width, out);
    constexpr double wanted = 0.05;
    for (const TruthCase& one : truth_cases()) {
        if (const TruthRow* best = fastest_truth(rows, one.name, wanted))
            out << fmt::format(
                "{}: an error of {} of the continuum's deflection is reached soonest by {}, particles at "
                "{}, {} voxels across, in {}\n",
                one.name, percent_text(wanted), best->label(), best->particles_at, best->across,
                si(best->seconds, "s"));
    }
    for (const TruthCase& one : truth_cases()) {
        for (const TruthRow& row : rows) {
            if (row.identity.scene != one.name || !row.neo_hookean) continue;
            out << fmt::format(
                "{} at large strain: with the same E and nu, the deflection of a neo-Hookean material "
                "differs by {:+.1f}% from that of springs as their pitch goes to 0, and the deflection of a "
                "St. Venant-Kirchhoff material by {:+.1f}%\n",
                one.name, 100 * *row.neo_hookean, 100 * *row.st_venant_kirchhoff);
            break;
        }
    }
}

// --- In the process of a case ---------------------------------------------------------------------------

class TruthRunner final : public CaseRunner {
public:
    TruthRunner(const BackendSpec&, const Scene& scene, const nlohmann::json&, SharedState*)
        : case_(truth_case(scene.name, "study")) {}

    /// Returns a TruthRow as JSON, or an object with `unsupported` if the backend does not take the lattice.
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

const RegisteredCaseRunner truth_runner("truth", case_runner_of<TruthRunner>);

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
    /// The runner makes the lattices. A study needs some scene all the same, so it gets one that every
    /// backend accepts.
    std::shared_ptr<const Scene> own_scene(const StudyScene& item) const override {
        Scene scene = load_scene("box@2");
        scene.name = truth_case(item.scene, "study").name;
        return std::make_shared<const Scene>(std::move(scene));
    }
    /// A height between two numbers of voxels would be rounded, and the body would not be the continuum's.
    void check(const Study& study, const StudyScene& item, const Scene& scene) const override {
        const double height = truth_case(scene.name, "study").height;
        for (const int across : across_of(item)) {
            if (height * across != std::floor(height * across))
                throw BadInput(
                    "study " + study.name, "voxels_across of " + scene.name, std::to_string(across),
                    fmt::format("numbers whose product with the height, {:g} widths, is whole", height));
        }
    }
    int rows_of_case(const Study&, const StudyScene& item) const override {
        return 4 * int(across_of(item).size());
    }
    void run(StudyBench& bench) override {
        std::vector<TruthRow> rows;
        // One case runs after another, since their steps are timed.
        for (const BackendSpec& spec : bench.specs()) measure(bench, spec, rows);
        const std::vector<std::string> reasons = judge_truth(rows);
        for (std::size_t n = 0; n < rows.size(); ++n) {
            bench.add("truth", rows[n]);
            if (reasons[n].empty()) continue;
            Row failed = static_cast<const Row&>(rows[n]);
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
    /// The numbers of voxels across of the lattices that a backend does not take, by its reason.
    using Refusals = std::map<std::string, std::set<int>>;

    /// Adds a row to `skipped` for each reason. It names the numbers of voxels across, unless they are all
    /// that the study asks for.
    void skip(StudyBench& bench, const BackendSpec& spec, const std::string& particles_at,
              const Refusals& refusals) const {
        const std::vector<int> all = across_of(bench.item());
        for (const auto& [reason, refused] : refusals) {
            std::string lattices = "particles at " + particles_at;
            if (refused != std::set<int>(all.begin(), all.end()))
                lattices += fmt::format(", {} across", fmt::join(refused, ", "));
            bench.skip(spec, lattices + ": " + reason);
        }
    }
    /// Measures a backend and adds its rows to `rows`.
    void measure(StudyBench& bench, const BackendSpec& spec, std::vector<TruthRow>& rows) const {
        auto entered = bench.enter(spec, {"truth"});
        if (!entered) return;
        for (const std::string particles_at : {"corners", "centres"}) {
            Refusals refusals;
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
                        refusals[measured->at("unsupported").get<std::string>()].insert(across);
                        continue;
                    }
                    auto row = row_of_json<TruthRow>(*measured);
                    row.identity = row_of(bench.scene().name, spec).identity;
                    rows.push_back(std::move(row));
                }
            }
            skip(bench, spec, particles_at, refusals);
        }
        bench.add_failure(*entered);
    }

    std::vector<int> across_;
};

const RegisteredStudyKind truth_kind("truth", [] { return std::make_unique<TruthStudy>(); });

}  // namespace

}  // namespace voxspring
