// Up to which time step a backend is stable, found by trying, against what theory says.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "harness/results/row.h"
#include "harness/results/table.h"
#include "harness/scene/scene.h"
#include "harness/study/suite.h"

namespace voxspring {

/// Of a backend the largest stable time step on the particles and springs of `scene`, without gravity,
/// loads and damping of its own, by bisection, and stable_time_step() of the true frequency:
///
/// | start | damping | |
/// | --- | --- | --- |
/// | random within +-0.001 of the spacing | 0, 0.1, 1 | theory holds: within 0.2% |
/// | random within +-0.01, 0.1, 0.3 | 0 | springs meet and turn: the limit falls |
/// | twice the size of rest, and +-0.001 | 0 | theory about the stretched state; the surface is pinned |
///
/// Where the stretched body is not in equilibrium, between materials for example, constant loads hold it
/// there: theory is about a state that does not leave by itself. A backend without loads skips that start.
///
/// A time step is stable if, after the steps that a mode takes to grow 30-fold from its share of a random
/// start where theory is exceeded by 0.1%, no particle moves 30 times the start's amplitude a step. With
/// `map` there is a map of damping against time step as well.
///
/// Rows of the list `stability`, one a start and damping, or the list `stability_map`; and `failed`, what
/// left theory's 0.2%. Rows as in results/schema.json.
class StabilityStudy {
public:
    /// Largest stable time steps in theory, one a search; nothing where nothing oscillates, or how fast is
    /// not known.
    using Limits = std::vector<std::optional<double>>;
    static Limits limits_of(const Scene& scene);

    StabilityStudy(const Scene& scene, const Limits& limits);
    explicit StabilityStudy(const Scene& scene) : StabilityStudy(scene, limits_of(scene)) {}
    /// Runs all searches and, with `map`, the map. Throws what the backend does.
    void run(const BackendSpec& spec, Backend& backend, bool map, const Once& once);

private:
    struct Search;
    static std::vector<Search> planned_searches(const Scene& scene);
    Rows search(const BackendSpec& spec, Backend& backend, Search& search) const;

    std::string scene_;
    std::vector<std::shared_ptr<Search>> searches_;
};

/// A row of the list `stability`.
struct StabilityRow {
    Row row;
    double damping = 0;
    std::string start = {};  ///< "random" or "stretched"
    double amplitude = 0, stretch = 0;
    double theory_time_step = 0, measured_time_step = 0, ratio = 0;
    int steps = 0;
    std::optional<double> tolerance = {};
    bool passed = false;
};
nlohmann::json to_json(const StabilityRow& row);
StabilityRow stability_row_from_json(const nlohmann::json& json);

/// A line a scene, start and damping, with the range of what cases reach, and each map.
void print_stability(const nlohmann::json& result, std::ostream& out, TableWidth width = 0);

}  // namespace voxspring
