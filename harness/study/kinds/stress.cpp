// The kind of study `stress`: how backends behave at the limits of what can be simulated, on built-in scenes.
#include "harness/study/kinds/stress.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "backends/physics/neighbours.h"
#include "harness/base/text.h"
#include "harness/results/print.h"
#include "harness/results/row_fields.h"
#include "harness/scene/scene.h"
#include "harness/scene/stability.h"
#include "harness/study/study_kind.h"
#include "harness/verification/conserved.h"
#include "harness/verification/random_starts.h"
#include "harness/verification/verify.h"
#include "harness/volume/dataset.h"

namespace voxspring {
namespace {

/// A row of the list `stress`.
struct StressRow : Row {
    int part = 0;
    std::string measurement = {}, unit = {}, detail = {};
    int steps = 0;
    std::optional<double> measured = {};   ///< empty: not finite
    std::optional<double> threshold = {};  ///< empty: the figure is only recorded
    std::string threshold_is = {};         ///< "at most" or "at least"
    bool passed = false;

    static void fields(auto& row, auto& of) {
        of.required("part", row.part);
        of.required("measurement", row.measurement);
        of.required("steps", row.steps);
        of.nullable("measured", row.measured);
        of.nullable("gate", row.threshold);
        of.required("gate_is", row.threshold_is);
        of.required("passed", row.passed);
        of.required("unit", row.unit);
        of.required("detail", row.detail);
    }
};

/// The bound of a measured figure.
struct Threshold {
    enum class Bound : std::uint8_t { none, at_most, at_least };
    Bound bound = Bound::none;
    double value = 0;

    bool holds(double measured) const {
        if (bound == Bound::none) return true;
        return bound == Bound::at_most ? measured <= value : measured >= value;
    }
};
Threshold at_most(double value) { return {Threshold::Bound::at_most, value}; }
Threshold at_least(double value) { return {Threshold::Bound::at_least, value}; }

static_assert(sizeof(glm::dvec3) == 3 * sizeof(double));

/// A state as bytes, for another process: displacements, then as many increments.
std::vector<std::uint8_t> packed(const State& state) {
    std::vector<std::uint8_t> bytes;
    for (const auto* vectors : {&state.displacement, &state.increment}) {
        const auto* first = reinterpret_cast<const std::uint8_t*>(vectors->data());
        bytes.insert(bytes.end(), first, first + vectors->size() * sizeof(glm::dvec3));
    }
    return bytes;
}

State unpacked(const std::vector<std::uint8_t>& bytes) {
    State state;
    const std::size_t size = bytes.size() / 2;
    const std::uint8_t* from = bytes.data();
    for (auto* vectors : {&state.displacement, &state.increment}) {
        vectors->resize(size / sizeof(glm::dvec3));
        std::memcpy(vectors->data(), from, size);
        from += size;
    }
    return state;
}

/// One run of the suite.
class StressSuite {
public:
    StressSuite(const BackendSpec& spec, Backend& backend, StressLengths lengths,
                StressReferences& references, const Once& once)
        : spec_(spec), backend_(backend), lengths_(lengths), references_(references), once_(once) {}

    void run() {
        using Part = void (StressSuite::*)();
        for (const Part part :
             {&StressSuite::rest, &StressSuite::limit, &StressSuite::large_start, &StressSuite::larger_start,
              &StressSuite::degenerate, &StressSuite::stray_nan, &StressSuite::rope,
              &StressSuite::free_particle, &StressSuite::stiffness_ratio, &StressSuite::skipping,
              &StressSuite::accuracy, &StressSuite::equilibrium, &StressSuite::momentum_of_a_long_run}) {
            (this->*part)();
        }
    }

private:
    /// Describes a measurement before it is made.
    struct Subject {
        int part;
        std::string name, scene, unit;
        int steps;
        Threshold threshold;
        std::string detail = {};
    };

    template <class T>
    T by_length(T full, T brief, T shortest) const {
        return std::array{full, brief, shortest}[std::size_t(lengths_)];
    }

    /// The threshold for rounding errors in the formulations `increment` and `compensated`. It is set for
    /// float32, and float64 stays far below it. In other formulations there is none.
    Threshold rounding_threshold(double increment, double compensated) const {
        if (spec_.options.formulation == Formulation::increment) return at_most(increment);
        if (spec_.options.formulation == Formulation::compensated) return at_most(compensated);
        return {};
    }

    /// The threshold of a bitwise comparison: no difference. There is no threshold if the backend adds forces
    /// in any order, by atomics, since then runs differ anyway.
    Threshold same_bits_threshold() const {
        return backend_.capabilities().deterministic ? at_most(0) : Threshold{};
    }

    /// Adds the row of `subject` with the figure that `measure()` returns, or the reason why there is none.
    template <class Measure>
    void record(const Subject& subject, const Problem& problem, const Measure& measure) {
        const std::string of = subject.detail.empty() ? "" : ", " + subject.detail;
        once_(subject.name + of + ", " + subject.scene + ", " + std::to_string(subject.steps) + " steps",
              [&] { return rows_of(subject, problem, measure); });
    }
    template <class Measure>
    Rows rows_of(const Subject& subject, const Problem& problem, const Measure& measure) {
        StressRow row{row_of(subject.scene, spec_)};
        row.part = subject.part;
        row.measurement = subject.name;
        row.unit = subject.unit;
        row.detail = subject.detail;
        row.steps = subject.steps;
        Rows rows;
        const auto put = [&](const char* list, const std::string& reason) {
            Row unmeasured = static_cast<const Row&>(row);
            unmeasured.reason = subject.name + ": " + reason;
            rows[list].push_back(to_json(unmeasured));
        };
        if (const std::string why = backend_.unsupported(problem); !why.empty()) {
            put("skipped", why);
            return rows;
        }
        double measured = 0;
        try {
            measured = measure();
        } catch (const std::exception& error) {
            put("failed", error.what());
            return rows;
        }
        row.measured = measured;
        row.threshold_is = subject.threshold.bound == Threshold::Bound::at_least ? "at least" : "at most";
        row.passed = subject.threshold.holds(measured);
        if (subject.threshold.bound != Threshold::Bound::none) row.threshold = subject.threshold.value;
        if (!row.passed)
            put("failed", error_text(measured) + " is not " + row.threshold_is + " " +
                              error_text(subject.threshold.value));
        rows["stress"].push_back(json_of(row));
        return rows;
    }

    State run_from(const State& start, const Problem& problem, int steps) {
        return voxspring::run_from(start, problem, backend_, steps);
    }

    /// Relative L2 error of the displacement against float64; infinite if the state is not finite.
    double error(const std::string& name, const Problem& problem, int steps) {
        const State state = run_from(state_at_rest(problem), problem, steps);
        return relative_error(problem, state, references_.of(name, problem, steps), steps);
    }
    double relative_error(const Problem& problem, const State& state, const State& reference, int steps) {
        return compare(problem, state, reference, spec_.options.precision, steps).relative_l2;
    }

    /// A cube with face and edge springs, whose time step is `fraction` of 2 / sqrt(12), the stable time step
    /// of an infinite lattice.
    static Problem cube(int side, double fraction) { return lattice(make_box(glm::ivec3(side)), fraction); }
    static Problem lattice(const VoxelGrid& grid, double fraction) {
        Problem problem = make_lattice_problem(grid, FACE_BITS | EDGE_BITS);
        problem.time_step = fraction * 2 / std::sqrt(12.0);
        return problem;
    }
    static void pin_lowest_slice(Problem& problem) {
        std::vector<std::uint8_t> pinned(problem.particle_count());
        for (std::size_t i = 0; i < pinned.size(); ++i)
            pinned[i] = problem.rest_position[i].z == problem.rest_position[0].z;
        pin(problem, std::move(pinned));
    }
    static Problem sagging_cube(int side, double fraction) {
        Problem problem = cube(side, fraction);
        pin_lowest_slice(problem);
        problem.gravity = {8e-4, 0, -2e-3};
        return problem;
    }
    static std::string box_name(int side) { return "box@" + std::to_string(side); }

    static double farthest_from_rest(const State& state) {
        double largest = 0;
        for (const glm::dvec3& u : state.displacement) {
            if (!std::isfinite(glm::length(u))) return std::numeric_limits<double>::infinity();
            largest = std::max(largest, glm::length(u));
        }
        return largest;
    }

    /// The number of particles whose displacements or increments differ. Particle `except` does not count.
    static double different(const State& a, const State& b, std::size_t except = no_particle) {
        double count = 0;
        for (std::size_t i = 0; i < a.displacement.size(); ++i) {
            if (i != except && (a.displacement[i] != b.displacement[i] || a.increment[i] != b.increment[i]))
                ++count;
        }
        return count;
    }

    void rest() {
        const int steps = by_length(1000, 200, 50), side = by_length(16, 16, 8);
        for (const double damping : {0.0, 0.01, 0.1}) {
            Problem problem = cube(side, 0.5);
            problem.damping = damping;
            // A body at rest drifts by the formulation `paper`, since fl(2 - lambda) - fl(1 - lambda) is not
            // 1 there.
            const bool drifts = spec_.options.formulation == Formulation::paper && damping > 0;
            record({1, "rest", box_name(side), "spacings", steps, drifts ? Threshold{} : at_most(0),
                    "damping " + short_text(damping)},
                   problem,
                   [&] { return farthest_from_rest(run_from(state_at_rest(problem), problem, steps)); });
        }
    }

    void limit() {
        Problem problem = cube(8, 1);
        const double frequency = true_frequency_squared(problem).squared.value();
        for (const double damping : {0.0, 0.1, 0.5, 1.0}) {
            for (const double fraction : {0.999, 1.005}) {
                problem.damping = damping;
                problem.time_step = fraction * stable_time_step(frequency, damping);
                const int steps = steps_to_grow(problem, 0.005);
                record({2, fraction < 1 ? "below the limit" : "above the limit", box_name(8), "growth", steps,
                        fraction < 1 ? at_most(max_growth) : at_least(max_growth),
                        short_text(fraction) + " of the limit, damping " + short_text(damping)},
                       problem, [&] {
                           const State start = random_start(problem, small_amplitude);
                           // A growth beyond the range of numbers is recorded as the largest number.
                           return std::min(farthest(run_from(start, problem, steps)) / small_amplitude,
                                           std::numeric_limits<double>::max());
                       });
            }
        }
    }

    void large_start() {
        const int side = by_length(10, 8, 6);
        const Problem problem = cube(side, 0.577);
        const int steps = int(by_length(3000, 600, 150) / problem.time_step);
        constexpr int checks = 20;
        double least = 1, largest = 1;
        bool watched = false;
        const auto watch = [&] {
            if (watched) return;
            backend_.upload(problem, random_start(problem, 0.3));
            const double start = energy_before_step(problem, backend_);
            for (int check = 0; check < checks; ++check) {
                backend_.step(steps / checks - 1);
                const double ratio = energy_before_step(problem, backend_) / start;
                least = ratio >= least ? least : ratio;
                largest = ratio <= largest ? largest : ratio;
            }
            watched = true;
        };
        record({3, "least energy", box_name(side), "of the start", steps, at_least(0.8)}, problem, [&] {
            watch();
            return least;
        });
        record({3, "largest energy", box_name(side), "of the start", steps, at_most(1.1)}, problem, [&] {
            watch();
            return largest;
        });
    }

    void larger_start() {
        const int side = by_length(10, 8, 6), steps = by_length(3000, 1500, 500);
        Problem problem = cube(side, 0.577);
        problem.damping = 0.01;
        record({4, "energy after +-1", box_name(side), "of the start", steps, at_most(0.1)}, problem, [&] {
            const State start = random_start(problem, 1);
            return energy(problem, run_from(start, problem, steps)).total() / energy(problem, start).total();
        });
    }

    void degenerate() {
        const int steps = by_length(20000, 4000, 2000);
        Problem problem = cube(8, 0.5);
        problem.damping = 0.05;
        pin_lowest_slice(problem);
        const std::size_t middle = (4 * 8 + 4) * 8 + 4;
        State coincident = state_at_rest(problem), swapped = coincident;
        coincident.displacement[middle] = {1, 0, 0};
        swapped.displacement[middle] = {1, 0, 0};
        swapped.displacement[middle + 1] = {-1, 0, 0};
        // Float32 positions are multiples of 5e-7 here, and the error stays of that size. `paper` has a bias
        // in addition.
        const Formulation formulation = spec_.options.formulation;
        const Threshold threshold = at_most(formulation == Formulation::paper ? 1e-2
                                            : on_positions(formulation)       ? 1e-5
                                                                              : 1e-6);
        for (const auto& [name, start] :
             {std::pair{"coincident", coincident}, std::pair{"swapped", swapped}}) {
            record({5, name, box_name(8), "spacings", steps, threshold}, problem,
                   [&, &from = start] { return farthest_from_rest(run_from(from, problem, steps)); });
        }
    }

    void stray_nan() {
        Problem problem = sagging_cube(8, 0.5);
        const std::size_t middle = (4 * 8 + 4) * 8 + 4;
        const auto particle = particle_of_voxel(problem.lattice);
        for (const Direction& direction : directions()) {
            const auto neighbour = std::size_t(std::ptrdiff_t(middle) + problem.lattice.stride(direction));
            problem.lattice.mask[middle] &= ~(1u << direction.bit);
            problem.lattice.mask[neighbour] &= ~(1u << (direction.bit ^ 1));
        }
        State start = state_at_rest(problem);
        constexpr int steps = 100;
        record({6, "stray NaN", box_name(8), "particles", steps, same_bits_threshold()}, problem, [&] {
            const State without = run_from(start, problem, steps);
            start.displacement[middle] = glm::dvec3(std::numeric_limits<double>::quiet_NaN());
            return different(run_from(start, problem, steps), without, middle);
        });
    }

    void rope() {
        const int side = by_length(64, 64, 16), steps = by_length(10000, 2000, 500);
        Problem problem = make_lattice_problem(make_box({1, 1, side}), FACE_BITS);
        problem.time_step = 0.5;  // the stable time step is 1
        problem.damping = 0.01;
        problem.gravity = {8e-4, 0, -2e-3};
        pin_lowest_slice(problem);
        const std::string name = "rope@1x1x" + std::to_string(side);
        record({7, "rope", name, "relative", steps, rounding_threshold(2e-5, 5e-7)}, problem,
               [&] { return error(name, problem, steps); });
    }

    void free_particle() {
        VoxelGrid grid = make_box({101, 1, 1});
        std::fill(grid.label.begin(), grid.label.end() - 1, std::uint8_t(0));
        Problem problem = lattice(grid, 0.5);
        problem.gravity = {8e-4, 0, -2e-3};
        const int steps = by_length(10000, 2000, 500);
        record({7, "free particle", "particle at x = 100", "relative", steps, rounding_threshold(2e-4, 1e-6)},
               problem, [&] {
                   // The exact displacement is g dt^2 times the sum of 1 to n.
                   State exact = state_at_rest(problem);
                   exact.displacement[0] = problem.gravity * (problem.time_step * problem.time_step *
                                                              (0.5 * steps * (steps + 1.0)));
                   const State state = run_from(state_at_rest(problem), problem, steps);
                   return relative_error(problem, state, exact, steps);
               });
    }

    void stiffness_ratio() {
        VoxelGrid grid = make_box({8, 8, 8});
        for (std::size_t voxel = grid.label.size() / 2; voxel < grid.label.size(); ++voxel)
            grid.label[voxel] = 2;
        Problem problem = lattice(grid, 0.5);
        problem.materials = {{1, 1}, {1, 1e6}};
        problem.time_step *= 1e-3;  // so that the stiff half is stable
        pin_lowest_slice(problem);
        problem.gravity = {8e-4, 0, -2e-3};
        const int steps = by_length(50000, 5000, 500);
        const std::string name = "box@8 of stiffness 1 and 1e6";
        record({7, "stiffness ratio", name, "relative", steps, rounding_threshold(2e-5, 5e-7)}, problem,
               [&] { return error(name, problem, steps); });
    }

    /// Compares runs with and without each shortcut of a backend, such as skipping terms that a scene does
    /// not need, or tiles at rest.
    void skipping() {
        const int side = by_length(24, 24, 12), steps = by_length(200, 100, 50);
        Problem problem = cube(side, 0.5);
        problem.damping = 0.01;
        State start = state_at_rest(problem);
        start.displacement[0] = {0.3, 0.2, 0.1};
        for (const Skip& skip : spec_.entry->skips()) {
            record(
                {8, "skipping " + skip.parameter, box_name(side), "particles", steps, same_bits_threshold()},
                problem, [&] {
                    const auto run_with = [&](const std::string& value) {
                        BackendSpec spec = spec_;
                        spec.options.tuning[skip.parameter] = value;
                        return voxspring::run_from(start, problem, *spec.make(), steps);
                    };
                    return different(run_with(skip.skipping), run_with(skip.stepping));
                });
        }
    }

    void accuracy() {
        const int side = by_length(32, 32, 8);
        for (const int steps : {by_length(1000, 100, 50), by_length(10000, 1000, 200)}) {
            const Problem problem = sagging_cube(side, 0.5);
            record({9, "box", box_name(side), "relative", steps,
                    steps <= 1000 ? rounding_threshold(1.5e-6, by_length(1.5e-7, 1.5e-7, 5e-7))
                                  : rounding_threshold(1.2e-5, 8e-6)},
                   problem, [&] { return error(box_name(side), problem, steps); });
        }
        const int steps = by_length(10000, 1000, 200);
        const std::string beam = by_length("beam", "beam", "beam@4x4x32");
        // Without damping the whipping end makes two float64 runs differ by 1e-3, so errors would not show
        // rounding.
        Problem bending = load_scene(beam).problem;
        bending.damping = 0.001;
        record({9, "damped beam", beam, "relative", steps, rounding_threshold(4e-6, 5e-8)}, bending,
               [&] { return error(beam, bending, steps); });
        const std::string heart = by_length("heart", "heart", "heart@20x17x15");
        const Problem damped = load_scene(heart).problem;
        // After 1000 steps the heart has moved less than after 10000, so the same rounding is 4.9e-7 of the
        // movement instead of 8e-8.
        record({9, "damped heart", heart, "relative", steps,
                rounding_threshold(5e-6, by_length(3e-7, 1.5e-6, 3e-7))},
               damped, [&] { return error(heart, damped, steps); });
        // At full length this run ends at the time of 100 steps at half the limit.
        const int refined_side = by_length(32, 16, 8), refined_steps = by_length(3200, 1600, 400);
        const Problem refined = sagging_cube(refined_side, 1.0 / 64);
        const std::string name = box_name(refined_side) + " at 1/64 of the limit";
        record({9, "small time step", name, "relative", refined_steps,
                rounding_threshold(6e-6, by_length(1e-7, 1e-7, 3e-7))},
               refined, [&] { return error(name, refined, refined_steps); });
    }

    /// Measures the error of the state in which a loaded body comes to rest. In exact arithmetic that state
    /// does not depend on the time step. The damping per unit of time is the same for all time steps.
    void equilibrium() {
        const int side = by_length(32, 16, 8);
        const double rate = 2.2 / side;  // damping rate near the critical one of the slowest mode
        const int settled = by_length(3000, 1500, 750);  // steps at half the limit
        Problem reference = sagging_cube(side, 0.5);
        reference.damping = rate * reference.time_step;
        for (const int divisor : {2, by_length(32, 8, 8)}) {
            Problem problem = sagging_cube(side, 1.0 / divisor);
            problem.damping = rate * problem.time_step;
            const int steps = settled * divisor / 2;
            record({9, "static box", box_name(side), "relative", steps,
                    divisor == 2 ? rounding_threshold(5e-7, 3e-7) : rounding_threshold(5e-4, 3e-7),
                    "1/" + std::to_string(divisor) + " of the limit"},
                   problem, [&] {
                       const State state = run_from(state_at_rest(problem), problem, steps);
                       const std::string name = box_name(side) + " static";
                       return relative_error(problem, state, references_.of(name, reference, settled), steps);
                   });
        }
    }

    void momentum_of_a_long_run() {
        const int side = by_length(24, 24, 8), steps = by_length(100000, 2000, 500);
        const Scene scene = load_scene("free@" + std::to_string(side));
        record({9, "momentum", scene.name, "relative", steps, rounding_threshold(4e-7, 4e-7)}, scene.problem,
               [&] {
                   const Momentum p = momentum(scene.problem, run_from(scene.state, scene.problem, steps));
                   return glm::length(p.sum) / p.size;
               });
    }

    static std::string short_text(double value) { return fmt::format("{:g}", value); }

    const BackendSpec& spec_;
    Backend& backend_;
    const StressLengths lengths_;
    StressReferences& references_;
    const Once& once_;
};

}  // namespace

const State& StressReferences::of(const std::string& name, const Problem& problem, int steps) {
    const std::string key = name + "/" + std::to_string(steps);
    const auto found = states_.find(key);
    if (found != states_.end()) return found->second;
    const auto backend = BackendSpec::parse("cpu_parallel:precision=float64,formulation=increment").make();
    const State& state = states_[key] = run_from(state_at_rest(problem), problem, *backend, steps);
    if (on_event_) on_event_({{"reference", key}, {"state", nlohmann::json::binary(packed(state))}});
    return state;
}

void StressReferences::take(const nlohmann::json& event) {
    states_[event.at("reference")] = unpacked(event.at("state").get_binary());
}

nlohmann::json StressReferences::known() const {
    nlohmann::json all = nlohmann::json::object();
    for (const auto& [key, state] : states_) all[key] = nlohmann::json::binary(packed(state));
    return all;
}

void StressReferences::take_all(const nlohmann::json& known) {
    for (const auto& [key, state] : known.items()) states_[key] = unpacked(state.get_binary());
}

void run_stress(const BackendSpec& spec, Backend& backend, StressLengths lengths,
                StressReferences& references, const Once& once) {
    StressSuite(spec, backend, lengths, references, once).run();
}

namespace {

/// Prints one line per measurement, scene, backend and precision, with the figures of all formulations, and
/// "!" after those outside their threshold.
void print_stress(const Result& result, std::ostream& out, TableWidth width) {
    std::vector<std::vector<std::string>> lines;
    std::map<std::vector<std::string>, std::map<std::string, std::string>> figures;
    for (const StressRow& row : result.rows<StressRow>("stress")) {
        const std::string name = row.measurement + (row.detail.empty() ? "" : ", " + row.detail);
        const std::vector<std::string> line = {
            std::to_string(row.part),  name,
            row.identity.scene,        row.identity.backend + " " + row.identity.precision,
            std::to_string(row.steps), row.unit};
        if (!figures.contains(line)) lines.push_back(line);
        figures[line][row.identity.formulation] = error_cell(row.measured) + (row.passed ? " " : "!");
    }
    std::stable_sort(lines.begin(), lines.end(), [](const auto& a, const auto& b) { return a[0] < b[0]; });
    std::vector<Column> columns = {{"part", 3, true},  {"measurement", 0, true},
                                   {"scene", 0, true}, {"backend", 0, true},
                                   {"steps", 2},       {"unit", 1}};
    for (const Formulation formulation : all_formulations) columns.push_back({to_string(formulation)});
    std::vector<std::vector<std::string>> table;
    for (const auto& line : lines) {
        table.push_back(line);
        for (const Formulation formulation : all_formulations) {
            const auto figure = figures[line].find(to_string(formulation));
            table.back().push_back(figure == figures[line].end() ? "- " : figure->second);
        }
    }
    print_columns(columns, table, width, out);
}

const std::map<std::string, StressLengths> lengths_by_name = {
    {"full", StressLengths::full}, {"brief", StressLengths::brief}, {"shortest", StressLengths::shortest}};

class StressRunner final : public SuiteRunner {
public:
    StressRunner(BackendSpec spec, const Scene&, const nlohmann::json& parameters, SharedState*)
        : spec_(std::move(spec)), lengths_(lengths_by_name.at(parameters.at("lengths"))) {}

private:
    void run(Backend& backend, const nlohmann::json& known, const Once& once,
             const OnEvent& on_event) override {
        StressReferences references;
        references.take_all(known);
        references.report_to(on_event);
        run_stress(spec_, backend, lengths_, references, once);
    }

    const BackendSpec spec_;
    const StressLengths lengths_;
};

const RegisteredCaseRunner stress_runner("stress", case_runner_of<StressRunner>);

class StressStudy final : public StudyKind {
public:
    std::string scenes_key() const override { return "suites"; }
    std::string read_scene(JsonObject& item) const override {
        std::vector<std::string> names;
        for (const auto& [name, lengths] : lengths_by_name) names.push_back(name);
        (void)item.require("lengths", "full, brief or shortest").one_of(names);
        return "stress";
    }
    /// The suite makes the scenes that it runs. The study needs some scene: this one every backend takes.
    std::shared_ptr<const Scene> own_scene(const StudyScene& item) const override {
        Scene scene = load_scene("box@2");
        scene.name = item.scene;
        return std::make_shared<const Scene>(std::move(scene));
    }
    int rows_of_case(const Study&, const StudyScene&) const override { return 30; }
    /// The references that the first case computes are passed on to the later ones.
    void run(StudyBench& bench) override {
        const std::string lengths = bench.item().settings.at("lengths");
        measure_suites(bench, {.enter =
                                   [&](const BackendSpec& spec) {
                                       return bench.enter(spec, {"stress", {{"lengths", lengths}}});
                                   },
                               .known = [&] { return references_.known(); },
                               .on_event = [&](const nlohmann::json& event) { references_.take(event); }});
    }
    void make_lists(Result& result) const override { result.rows<StressRow>("stress"); }
    void print(const Result& result, std::ostream& out, TableWidth width) const override {
        print_stress(result, out, width);
        print_unmeasured(result, out);
    }

private:
    StressReferences references_;
};

const RegisteredStudyKind stress_kind("stress", [] { return std::make_unique<StressStudy>(); });

}  // namespace

}  // namespace voxspring
