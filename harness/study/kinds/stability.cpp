// The kind of study `stability`: the largest time step at which backends are stable.
#include "harness/study/kinds/stability.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "backends/physics/spring.h"
#include "harness/base/bad_input.h"
#include "harness/base/text.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/stability.h"
#include "harness/study/study_kind.h"
#include "harness/verification/conserved.h"
#include "harness/verification/random_starts.h"

namespace voxspring {
namespace {

/// A row of the list `stability`.
struct StabilityRow : Row {
    double damping = 0;
    std::string start_kind = {};  ///< "random" or "stretched"
    double amplitude = 0, stretch = 0;
    double theory_time_step = 0, measured_time_step = 0, ratio = 0;
    int steps = 0;
    std::optional<double> tolerance = {};
    bool passed = false;

    static void fields(auto& row, auto& of) {
        of.required("damping", row.damping);
        of.object("start", [&](auto& start) {
            start.required("kind", row.start_kind);
            start.required("amplitude", row.amplitude);
            start.required("stretch", row.stretch);
        });
        of.required("theory_time_step", row.theory_time_step);
        of.required("measured_time_step", row.measured_time_step);
        of.required("ratio", row.ratio);
        of.required("steps", row.steps);
        of.nullable("tolerance", row.tolerance);
        of.required("passed", row.passed);
    }
};

constexpr std::array dampings = {0.0, 0.1, 1.0};
constexpr std::array large_amplitudes = {0.01, 0.1, 0.3};
constexpr double stretch = 1;  ///< displacement over position: the body is stretched to twice its size

/// A time step that exceeds the limit by this fraction must show growth.
constexpr double seen_excess = 1e-3;
/// For small amplitudes, the measured limit of the time step may differ from the theory's by this share of
/// it: by `seen_excess`, and by as much again since springs are not linear.
constexpr double tolerance = 2e-3;
constexpr int steps_of_large_starts = 2000;

constexpr std::array map_dampings = {0.0, 1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0, 1.5};
constexpr std::array map_fractions = {0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 1.0, 1.1};
constexpr double map_amplitude = 0.3;
constexpr int map_steps = 2000;
/// A map says `heating` if the final energy exceeds this multiple of the energy at the start. In bounded runs
/// rounding and the error of the time step add less.
constexpr double heating = 1.1;

double shortest_spacing(const Problem& problem) {
    const glm::dvec3 s = problem.lattice.spacing;
    return std::min({s.x, s.y, s.z});
}

/// Pins the particles that lack a neighbour. The other particles of a uniformly stretched lattice of one
/// material are in equilibrium.
void pin_surface(Problem& problem) {
    std::vector<std::uint8_t> pinned(problem.particle_count());
    for (std::size_t i = 0; i < pinned.size(); ++i)
        pinned[i] = (problem.lattice.mask[i] & problem.group_bits) != problem.group_bits;
    pin(problem, std::move(pinned));
}

/// Sets loads that keep the particles in equilibrium at `displacement`. Sets none if the particles are in
/// equilibrium without loads. Where springs of different stiffness meet, or with sutures, a stretched body
/// without loads would leave that state at once.
void balance(Problem& problem, const std::vector<glm::dvec3>& displacement) {
    const std::vector<Spring> springs = list_springs(problem);
    const std::vector<RestSpring> rest = list_rest_springs(problem);
    std::vector<glm::dvec3> load(problem.particle_count(), glm::dvec3(0));
    double strongest = 0;
    for (std::size_t s = 0; s < springs.size(); ++s) {
        const glm::dvec3 relative = displacement[springs[s].first] - displacement[springs[s].second];
        const glm::dvec3 force = strain_force(relative, rest[s].offset, rest[s].length, rest[s].deficit,
                                              springs[s].stiffness, problem.shortest_squared());
        load[springs[s].first] -= force;
        load[springs[s].second] += force;
        strongest = std::max(strongest, glm::length(force));
    }
    constexpr double rounding = 1e-12;  // relative rounding error of a sum of about 26 forces
    bool balanced = true;
    for (std::size_t i = 0; i < load.size(); ++i) {
        if (problem.is_pinned(i)) load[i] = glm::dvec3(0);
        balanced = balanced && glm::length(load[i]) <= rounding * strongest;
    }
    if (!balanced) problem.load = std::move(load);
}

nlohmann::json map_of(Backend& backend, Problem problem) {
    const double frequency = true_frequency_squared(problem).squared.value();
    const double amplitude = map_amplitude * shortest_spacing(problem);
    const State start = random_start(problem, amplitude);
    nlohmann::json map = {{"damping", map_dampings},
                          {"fraction", map_fractions},
                          {"amplitude", map_amplitude},
                          {"steps", map_steps},
                          {"region", nlohmann::json::array()}};
    for (const double damping : map_dampings) {
        nlohmann::json row = nlohmann::json::array();
        for (const double fraction : map_fractions) {
            problem.damping = damping;
            problem.time_step = fraction * stable_time_step(frequency, damping);
            backend.upload(problem, start);
            const double energy_of_start = energy_before_step(problem, backend);
            backend.step(map_steps - 2);
            const double energy_of_end = energy_before_step(problem, backend);
            row.push_back(!(farthest(backend.download()) <= max_growth * amplitude) ? "diverged"
                          : energy_of_end > heating * energy_of_start               ? "heating"
                                                                                    : "bounded");
        }
        map["region"].push_back(row);
    }
    return map;
}

/// One search for the largest stable time step.
struct Search {
    Problem problem;
    double damping = 0;
    double relative_amplitude = 0;  ///< amplitude of the start, in spacings
    double stretch = 0;             ///< displacement over position of the start; 0: no stretch
    bool exact = false;             ///< whether theory gives the limit within `tolerance`
    double theory = 0;              ///< the largest stable time step in theory
    double amplitude = 0;           ///< amplitude of the start, in units of length
    int steps = 0;
    State state = {};

    /// Displacements of the stretched state.
    std::vector<glm::dvec3> shape() const {
        std::vector<glm::dvec3> displacements = problem.rest_position;
        for (glm::dvec3& u : displacements) u *= stretch;
        return displacements;
    }

    /// The largest time step at which the run stays bounded.
    double measured_limit(Backend& backend) {
        const auto bounded = [&](double fraction) {
            problem.time_step = fraction * theory;
            return farthest(run_from(state, problem, backend, steps)) <= max_growth * amplitude;
        };
        // Theory gives the expected result for small starts, and an upper bound for large ones.
        const double resolution = exact ? 2e-4 : 4e-3;
        double low = exact ? 0.99 : 0.6, high = exact ? 1.01 : 1.02;
        while (low > 0.01 && !bounded(low)) {
            high = low;
            low /= 2;
        }
        while (high < 4 && bounded(high)) {
            low = high;
            high *= 2;
        }
        while (high - low > resolution) {
            const double middle = (low + high) / 2;
            (bounded(middle) ? low : high) = middle;
        }
        return low * theory;
    }
};

std::vector<Search> planned_searches(const Scene& scene) {
    Problem problem = scene.problem;
    problem.gravity = glm::dvec3(0);
    problem.load.clear();
    problem.tool = {};
    std::vector<Search> searches;
    for (const double damping : dampings)
        searches.push_back(
            {.problem = problem, .damping = damping, .relative_amplitude = small_amplitude, .exact = true});
    for (const double amplitude : large_amplitudes)
        searches.push_back({.problem = problem, .relative_amplitude = amplitude});
    pin_surface(problem);
    searches.push_back(
        {.problem = problem, .relative_amplitude = small_amplitude, .stretch = stretch, .exact = true});
    balance(searches.back().problem, searches.back().shape());
    for (Search& search : searches) search.problem.damping = search.damping;
    return searches;
}

Rows rows_of_search(const BackendSpec& spec, Backend& backend, const std::string& scene, Search& search) {
    if (const std::string why = backend.unsupported(search.problem); !why.empty()) {
        Row skipped = row_of(scene, spec);
        skipped.reason = "from a stretched start: " + why;
        return {{"skipped", {to_json(skipped)}}};
    }
    const double measured = search.measured_limit(backend);
    const double ratio = measured / search.theory;
    StabilityRow row{row_of(scene, spec)};
    row.damping = search.damping;
    row.start_kind = search.stretch > 0 ? "stretched" : "random";
    row.amplitude = search.relative_amplitude;
    row.stretch = search.stretch;
    row.theory_time_step = search.theory;
    row.measured_time_step = measured;
    row.ratio = ratio;
    row.steps = search.steps;
    if (search.exact) row.tolerance = tolerance;
    row.passed = !search.exact || std::abs(ratio - 1) <= tolerance;
    Rows rows;
    if (!row.passed) {
        Row failed = row_of(scene, spec);
        failed.reason = "the largest stable time step is " + fixed_text(ratio, 4) +
                        " of the theoretical limit at damping " + fixed_text(search.damping, 1) +
                        ", not within 0.2% of it";
        rows["failed"].push_back(to_json(failed));
    }
    rows["stability"].push_back(json_of(row));
    return rows;
}

void print_map(const nlohmann::json& map, std::ostream& out) {
    out << "\n" << map.at("name").get<std::string>() << ": b bounded, h heating, D diverged\n";
    std::vector<Column> columns = {{"damping", 0, true}};
    for (const double fraction : map.at("fraction")) columns.push_back({fixed_text(fraction, 2)});
    std::vector<std::vector<std::string>> grid;
    for (std::size_t d = 0; d < map.at("damping").size(); ++d) {
        grid.push_back({fixed_text(map.at("damping")[d], 4)});
        for (const std::string region : map.at("region")[d])
            grid.back().push_back(region == "diverged" ? "D" : region.substr(0, 1));
    }
    print_columns(columns, grid, 0, out);
}

/// Prints one line per scene, start and damping, with the least and the greatest result of the cases. Then
/// prints each map, which tells for each damping and time step whether the run is bounded, heats or diverges.
void print_stability(const Result& result, std::ostream& out, TableWidth width) {
    // There is one line per scene, start and damping, since the results of the cases differ by a few 1e-4
    // only.
    using Key = std::array<std::string, 4>;
    std::vector<Key> lines;
    std::map<Key, std::vector<StabilityRow>> rows;
    for (const StabilityRow& row : result.rows<StabilityRow>("stability")) {
        const Key key = {row.identity.scene, row.start_kind + " " + fixed_text(row.amplitude, 3),
                         fixed_text(row.damping, 2), fixed_text(row.theory_time_step, 6)};
        if (!rows.contains(key)) lines.push_back(key);
        rows[key].push_back(row);
    }
    const std::vector<Column> columns = {{"scene", 0, true},
                                         {"start", 0, true},
                                         {"damping"},
                                         {"limit in theory", 1},
                                         {"cases", 3},
                                         {"steps", 4},
                                         {"min measured / theory"},
                                         {"of", 2, true},
                                         {"max"},
                                         {"of", 2, true}};
    std::vector<std::vector<std::string>> table;
    for (const Key& key : lines) {
        const auto [min, max] =
            std::minmax_element(rows[key].begin(), rows[key].end(),
                                [](const auto& a, const auto& b) { return a.ratio < b.ratio; });
        table.push_back({key[0], key[1], key[2], key[3], std::to_string(rows[key].size()),
                         std::to_string(min->steps), fixed_text(min->ratio, 4), min->label(),
                         fixed_text(max->ratio, 4), max->label()});
    }
    print_columns(columns, table, width, out);
    for (const auto& map : result.rows<nlohmann::json>("stability_map")) print_map(map, out);
}

class StabilityRunner final : public SuiteRunner {
public:
    StabilityRunner(BackendSpec spec, const Scene& scene, const nlohmann::json& parameters, SharedState*)
        : spec_(std::move(spec)),
          scene_(scene),
          limits_(parameters.at("limits")),
          map_(parameters.at("map")) {}

private:
    void run(Backend& backend, const nlohmann::json&, const Once& once, const OnEvent&) override {
        run_stability(spec_, backend, scene_, limits_, map_, once);
    }

    const BackendSpec spec_;
    const Scene& scene_;
    const std::vector<double> limits_;
    const bool map_;
};

const RegisteredCaseRunner stability_runner("stability", case_runner_of<StabilityRunner>);

class StabilityKind final : public StudyKind {
public:
    std::string read_scene(JsonObject& item) const override {
        if (const auto map = item.find("map")) (void)map->boolean();
        return StudyKind::read_scene(item);
    }
    void check(const Study& study, const StudyScene&, const Scene& scene) const override {
        if (scene.problem.lattice.voxel.empty())
            throw BadInput("study " + study.name, "scene " + scene.name, "particles on no lattice",
                           "particles on a lattice: starts are measured in its spacings");
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 7; }
    void run(StudyBench& bench) override {
        const std::vector<double> limits = stability_limits(bench.scene());
        const bool empty = std::count(limits.begin(), limits.end(), 0) == std::ptrdiff_t(limits.size());
        bool map = bench.item().settings.value("map", false);  // only the first case makes the map
        const auto enter = [&](const BackendSpec& spec) {
            std::optional<Case> entered =
                bench.enter(spec, {"stability", {{"limits", limits}, {"map", map}}});
            if (entered && empty) {
                bench.refuse(spec, "nothing oscillates, or the frequency is not known");
                entered.reset();
            }
            if (entered) map = false;
            return entered;
        };
        measure_suites(bench, {.enter = enter});
    }
    void make_lists(Result& result) const override {
        result.rows<StabilityRow>("stability");
        result.rows<nlohmann::json>("stability_map");
    }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_stability(result, out, width);
        print_unmeasured(result, out);
    }
};

const RegisteredStudyKind stability_kind("stability", [] { return std::make_unique<StabilityKind>(); });

}  // namespace

std::vector<double> stability_limits(const Scene& scene) {
    std::vector<double> limits;
    for (const Search& search : planned_searches(scene)) {
        const Frequency frequency = true_frequency_squared(search.problem, search.shape());
        const double squared = frequency.squared.value_or(0);
        limits.push_back(squared == 0 ? 0 : stable_time_step(squared, search.damping));
    }
    return limits;
}

void run_stability(const BackendSpec& spec, Backend& backend, const Scene& scene,
                   const std::vector<double>& limits, bool map, const Once& once) {
    std::vector<Search> searches;
    std::size_t planned = 0;
    for (Search& search : planned_searches(scene)) {
        search.theory = limits.at(planned++);
        if (search.theory == 0) continue;
        search.amplitude = search.relative_amplitude * shortest_spacing(search.problem);
        search.state = random_start(search.problem, search.amplitude);
        const std::vector<glm::dvec3> shape = search.shape();
        for (std::size_t i = 0; i < shape.size(); ++i) search.state.displacement[i] += shape[i];
        search.steps = search.exact ? steps_to_grow(search.problem, seen_excess) : steps_of_large_starts;
        searches.push_back(std::move(search));
    }
    int number = 0;
    for (Search& search : searches) {
        once("search " + std::to_string(++number) + " of " + std::to_string(searches.size()),
             [&] { return rows_of_search(spec, backend, scene.name, search); });
    }
    if (!map || searches.empty()) return;
    once("map", [&] {
        nlohmann::json row = to_json(row_of(scene.name, spec));
        row.update(map_of(backend, searches.front().problem));
        return Rows{{"stability_map", {row}}};
    });
}

}  // namespace voxspring
