#include "harness/study/stability_study.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <iomanip>
#include <limits>
#include <random>
#include <sstream>

#include "harness/base/text.h"
#include "harness/results/result.h"
#include "harness/scene/stability.h"
#include "harness/verification/conserved.h"

namespace voxspring {
namespace {

constexpr std::array dampings = {0.0, 0.1, 1.0};
constexpr std::array large_amplitudes = {0.01, 0.1, 0.3};
constexpr double stretch = 1;  ///< twice the size

constexpr double seen_excess = 1e-3;  ///< over the limit, at which growth must show
/// On the ratio of a small start: that excess, and as much for springs that are not linear.
constexpr double tolerance = 2e-3;
constexpr int steps_of_large_starts = 2000;

constexpr std::array map_dampings = {0.0, 1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0, 1.5};
constexpr std::array map_fractions = {0.3, 0.4, 0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 1.0, 1.1};
constexpr double map_amplitude = 0.3;
constexpr int map_steps = 2000;
/// Energy over that of the start beyond which a map says `heating`: what rounding and the error of the time
/// step make of it where a run is bounded stays under that.
constexpr double heating = 1.1;

double shortest_spacing(const Problem& problem) {
    const glm::dvec3 s = problem.lattice.spacing;
    return std::min({s.x, s.y, s.z});
}

/// Pins the particles that lack a neighbour: the others of a uniformly stretched lattice are in equilibrium.
void pin_surface(Problem& problem) {
    std::vector<std::uint8_t> pinned(problem.particle_count());
    for (std::size_t i = 0; i < pinned.size(); ++i)
        pinned[i] = (problem.lattice.mask[i] & problem.group_bits) != problem.group_bits;
    pin(problem, std::move(pinned));
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
            row.push_back(!(farthest(backend.download()) <= most_growth * amplitude) ? "diverged"
                          : energy_of_end > heating * energy_of_start                ? "heating"
                                                                                     : "bounded");
        }
        map["region"].push_back(row);
    }
    return map;
}

std::string fixed(double value, int digits) {
    std::ostringstream text;
    text << std::fixed << std::setprecision(digits) << value;
    return text.str();
}

}  // namespace

State random_start(const Problem& problem, double amplitude) {
    State state = state_at_rest(problem);
    std::mt19937_64 generator(7);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            const double uniform = std::ldexp(double(generator() >> 11), -52) - 1;
            if (!problem.is_pinned(i)) state.displacement[i][axis] = amplitude * uniform;
        }
    }
    return state;
}

double farthest(const State& state) {
    double largest = 0;
    for (std::size_t i = 0; i < state.increment.size(); ++i) {
        const double moved = glm::length(state.increment[i]);
        if (!std::isfinite(moved + glm::length(state.displacement[i])))
            return std::numeric_limits<double>::infinity();
        largest = std::max(largest, moved);
    }
    return largest;
}

int steps_to_grow(const Problem& problem, double excess) {
    const double lambda = problem.damping;
    const double half = (2 - lambda - (4 - 2 * lambda) * (1 + excess) * (1 + excess)) / 2;
    const double growth = -half + std::sqrt(half * half - (1 - lambda));
    // A mode's share of a random start of n components is 1 / sqrt(n) in the mean; a tenth of that will do.
    const double wanted = most_growth * 10 * std::sqrt(3 * double(problem.particle_count()));
    return int(std::ceil(std::log(wanted) / std::log(growth)));
}

State run_from(const State& start, const Problem& problem, Backend& backend, int steps) {
    backend.upload(problem, start);
    backend.step(steps);
    return backend.download();
}

double energy_before_step(const Problem& problem, Backend& backend) {
    State state = backend.download();
    backend.step(1);
    const State next = backend.download();
    for (std::size_t i = 0; i < state.increment.size(); ++i)
        state.increment[i] = (state.increment[i] + next.increment[i]) * 0.5;
    return energy(problem, state).total();
}

/// One search for the largest stable time step.
struct StabilityStudy::Search {
    Problem problem;
    nlohmann::json start = {};  ///< as a row says it
    State state = {};
    double amplitude = 0;  ///< of the start, in units of length
    int steps = 0;
    double theory = 0;   ///< time step
    bool exact = false;  ///< theory holds within the tolerance

    /// The largest time step at which it stays bounded.
    double measured_limit(Backend& backend) {
        const auto bounded = [&](double fraction) {
            problem.time_step = fraction * theory;
            return farthest(run_from(state, problem, backend, steps)) <= most_growth * amplitude;
        };
        // Theory is met by small starts and an upper end for large ones.
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

StabilityStudy::StabilityStudy(const Scene& scene) : scene_(scene.name) {
    Problem problem = scene.problem;
    problem.gravity = glm::dvec3(0);
    problem.load.clear();
    const double spacing = shortest_spacing(problem);
    const auto add = [&](Search search, double stretched, double amplitude, double damping, bool exact) {
        search.problem.damping = damping;
        std::vector<glm::dvec3> shape = search.problem.rest_position;
        for (glm::dvec3& u : shape) u *= stretched;
        const Frequency frequency = true_frequency_squared(search.problem, shape);
        if (frequency.squared.value_or(0) == 0) return;
        search.theory = stable_time_step(*frequency.squared, damping);
        search.amplitude = amplitude * spacing;
        search.state = random_start(search.problem, search.amplitude);
        for (std::size_t i = 0; i < shape.size(); ++i) search.state.displacement[i] += shape[i];
        search.start = {{"kind", stretched > 0 ? "stretched" : "random"},
                        {"amplitude", amplitude},
                        {"stretch", stretched}};
        search.steps = exact ? steps_to_grow(search.problem, seen_excess) : steps_of_large_starts;
        search.exact = exact;
        searches_.push_back(std::make_shared<Search>(std::move(search)));
    };
    for (const double damping : dampings) add({.problem = problem}, 0, small_amplitude, damping, true);
    for (const double amplitude : large_amplitudes) add({.problem = problem}, 0, amplitude, 0, false);
    pin_surface(problem);
    add({.problem = problem}, stretch, small_amplitude, 0, true);
}

Rows StabilityStudy::search(const BackendSpec& spec, Backend& backend, Search& search) const {
    const double measured = search.measured_limit(backend);
    const double ratio = measured / search.theory;
    nlohmann::json row = row_identity(scene_, spec);
    Rows rows;
    const bool passed = !search.exact || std::abs(ratio - 1) <= tolerance;
    if (!passed) {
        rows["failed"].push_back(row);
        rows["failed"].back()["reason"] = "is stable up to " + fixed(ratio, 4) + " of the limit at damping " +
                                          fixed(search.problem.damping, 1) + ", not within 0.2% of it";
    }
    row["damping"] = search.problem.damping;
    row["start"] = search.start;
    row["theory_time_step"] = search.theory;
    row["measured_time_step"] = measured;
    row["ratio"] = ratio;
    row["steps"] = search.steps;
    row["tolerance"] = search.exact ? nlohmann::json(tolerance) : nlohmann::json();
    row["passed"] = passed;
    rows["stability"].push_back(std::move(row));
    return rows;
}

void StabilityStudy::run(const BackendSpec& spec, Backend& backend, bool map, const Once& once) {
    int number = 0;
    for (const auto& one : searches_) {
        once("search " + std::to_string(++number) + " of " + std::to_string(searches_.size()),
             [&] { return search(spec, backend, *one); });
    }
    if (!map || empty()) return;
    once("map", [&] {
        nlohmann::json row = row_identity(scene_, spec);
        row.update(map_of(backend, searches_.front()->problem));
        return Rows{{"stability_map", {row}}};
    });
}

void print_stability(const nlohmann::json& result, std::ostream& out) {
    // One line a scene, start and damping: what the cases reach lies within a few 1e-4.
    using Key = std::array<std::string, 4>;
    std::vector<Key> lines;
    std::map<Key, std::vector<const nlohmann::json*>> rows;
    for (const auto& row : result.at("stability")) {
        const auto& start = row.at("start");
        const std::string kind = start.at("kind").get<std::string>() + " " + fixed(start.at("amplitude"), 3);
        const Key key = {row.at("scene"), kind, fixed(row.at("damping"), 2),
                         fixed(row.at("theory_time_step"), 6)};
        if (!rows.contains(key)) lines.push_back(key);
        rows[key].push_back(&row);
    }
    std::vector<std::vector<std::string>> table = {{"scene", "start", "damping", "limit in theory", "cases",
                                                    "steps", "least measured / theory", "of", "most", "of"}};
    for (const Key& key : lines) {
        const auto ratio = [](const nlohmann::json* row) { return row->at("ratio").get<double>(); };
        const auto [least, most] = std::minmax_element(rows[key].begin(), rows[key].end(),
                                                       [&](auto a, auto b) { return ratio(a) < ratio(b); });
        table.push_back({key[0], key[1], key[2], key[3], std::to_string(rows[key].size()),
                         std::to_string((*least)->at("steps").get<int>()), fixed(ratio(*least), 4),
                         case_label(**least), fixed(ratio(*most), 4), case_label(**most)});
    }
    print_aligned(table, out);
    for (const auto& map : result.at("stability_map")) {
        out << "\n" << map.at("name").get<std::string>() << ": b bounded, h heating, D diverged\n";
        std::vector<std::vector<std::string>> grid(1, {"damping"});
        for (const double fraction : map.at("fraction")) grid[0].push_back(fixed(fraction, 2));
        for (std::size_t d = 0; d < map.at("damping").size(); ++d) {
            grid.push_back({fixed(map.at("damping")[d], 4)});
            for (const std::string region : map.at("region")[d])
                grid.back().push_back(region == "diverged" ? "D" : region.substr(0, 1));
        }
        print_aligned(grid, out, 1);
    }
}

}  // namespace voxspring
