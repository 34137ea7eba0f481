// How far a loaded lattice of springs, once at rest, is from the continuum that it stands for.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/physics/problem.h"
#include "harness/results/row.h"

namespace voxspring {

/// A body that is clamped at its lowest side and loaded, and how far its highest side moves. The unit of
/// length is the width of the body, the unit of stress its Young's modulus. results/continuum.py solves the
/// same cases by finite elements.
struct TruthCase {
    std::string name;  ///< "tension", "torsion", "cantilever", "cube" or "ball"
    /// Height of the bar, whose section is a square of width 1, or of the ball between its planes.
    double height = 1;
    /// Whether the body is a ball of diameter 1, cut off by two planes `height` apart; otherwise a bar.
    bool is_ball = false;
    bool is_body_load = false;  ///< the load is a weight, otherwise a traction on the highest side
    char pattern = 'z';  ///< the load's direction: 'x', 'z', or 't' for a turn about the axis, (-y, x, 0)
    /// Approximate angular frequency of the slowest motion, for E = density = 1.
    double slowest = 1;
    /// The order of convergence that the study claims, and that judge_truth() demands, for small and large
    /// strain: with particles at the corners of voxels, and at the centres. Empty: no order is claimed, since
    /// errors of different signs cancel at some pitch.
    std::optional<double> order_at_corners = 2, order_at_centres = 1;
};
const std::vector<TruthCase>& truth_cases();
/// The case of this name. Throws BadInput, which names `where`, if there is none.
const TruthCase& truth_case(const std::string& name, const std::string& where);

/// What finite elements find for a case, from harness/study/continuum.json.
struct ContinuumAnswer {
    double load = 0;        ///< strength of the weight or traction
    double deflection = 0;  ///< deflection of the material that the lattice becomes as its pitch goes to 0
    double error = 0;       ///< relative error of `deflection`, estimated from a coarser mesh
    /// Deflections by other material laws with the same E and nu, relative to `deflection`, minus 1. Only for
    /// large strain.
    std::optional<double> neo_hookean, st_venant_kirchhoff;
};
/// `strain` is "small" or "large".
ContinuumAnswer continuum_answer(const TruthCase& of, const std::string& strain);

/// A case as a lattice.
struct TruthLattice {
    Problem problem;
    std::vector<std::uint32_t> end;   ///< particles of the highest side
    std::vector<glm::dvec3> pattern;  ///< for each particle of `end`: area times the load's pattern
    double size = 0;                  ///< the sum of area times the square of the pattern
    static constexpr double fraction_of_stable = 0.8;  ///< time step over the stable one
    /// Number of steps between two checks for rest. They shrink the deflection's error about sevenfold.
    int steps_between_looks = 0;

    /// Mean displacement of the highest side along the load's pattern, weighted by area and pattern.
    double deflection(const State& state) const;
};
/// `across` is the number of voxels in a width. Particles are at the corners of voxels if `corners`,
/// otherwise at their centres.
TruthLattice truth_lattice(const TruthCase& of, double load, int across, bool corners);

struct RestAnswer {
    double deflection = 0, seconds = 0;
    int steps = 0;
};
/// Steps the lattice until it is at rest, and returns its deflection, the time of all steps and their number.
/// Throws std::runtime_error if it does not come to rest.
RestAnswer come_to_rest(Backend& backend, const TruthLattice& lattice);

/// A row of the list `truth`.
struct TruthRow : Row {
    std::string particles_at = {}, strain = {};  ///< "corners" or "centres"; "small" or "large"
    int across = 0;                              ///< number of voxels in a width
    double time_step_fraction = 0;               ///< time step over the stable one
    double deflection = 0, continuum = 0, continuum_error = 0;
    double model_error = 0;  ///< |deflection / continuum - 1|
    /// Relative difference from float64 `increment` on the same lattice.
    std::optional<double> rounding_error = {};
    std::optional<double> order = {};  ///< order of convergence from the coarsest pitch to this one
    std::optional<double> claimed_order = {};
    std::optional<double> neo_hookean = {}, st_venant_kirchhoff = {};  ///< as in ContinuumAnswer
    double seconds = 0;

    static void fields(auto& row, auto& of) {
        of.required("particles_at", row.particles_at);
        of.required("strain", row.strain);
        of.required("across", row.across);
        of.required("fraction_of_stable", row.time_step_fraction);
        of.required("deflection", row.deflection);
        of.required("continuum", row.continuum);
        of.required("continuum_error", row.continuum_error);
        of.required("model_error", row.model_error);
        of.nullable("rounding_error", row.rounding_error);
        of.nullable("order", row.order);
        of.nullable("claimed_order", row.claimed_order);
        of.nullable("neo_hookean", row.neo_hookean);
        of.nullable("st_venant_kirchhoff", row.st_venant_kirchhoff);
        of.required("seconds", row.seconds);
    }
};

/// Fills in the orders and rounding errors of one scene's rows. Returns a text per row: why the row fails, or
/// empty. A row fails if it has the finest pitch and its order is below the claimed one by more than a
/// tolerance, unless its error is too small to be known.
std::vector<std::string> judge_truth(std::vector<TruthRow>& rows);

/// The fastest row at small strain of the case `name` whose `model_error`, rounding included, is at most
/// `error`. Rows without a claimed order do not count. Null if there is none.
const TruthRow* fastest_truth(const std::vector<TruthRow>& rows, const std::string& name, double error);

}  // namespace voxspring
