// The float64 reference on all cores. It can also round at random as much as a formulation in a precision
// does (Monte Carlo arithmetic; D. S. Parker, 1997).
//
// Users cannot name this reference as a backend. Its arithmetic shares only the functions of spring.h and the
// registers of simd/ with that of cpu_parallel.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "backends/cpu/cpu_backend.h"

namespace voxspring {

/// How a run of the reference is perturbed.
struct Perturbation {
    enum class Kind : std::uint8_t {
        none,     ///< the reference itself: `increment` in float64
        nearest,  ///< every stored number (see the table below) is rounded to the nearest of `precision`
        /// Stored numbers are rounded up or down at random, more often to the nearer number; in float64 they
        /// change by a unit in the last place or not at all. Forces get errors as large as those of their
        /// arithmetic, and parameters errors of up to half a unit in the last place plus root_error.
        random
    };
    Kind kind = Kind::none;
    Formulation formulation = Formulation::increment;
    Precision precision = Precision::float64;
    /// Relative error of roots and divisions in addition to rounding, for backends that approximate them.
    double root_error = 0;
    std::uint64_t seed = 0;  ///< random numbers depend only on it, the step, the particle and the use
};

/// Runs the reference, one run after another, each with a given perturbation.
///
/// It uses float64, all cores and SIMD registers. Each particle sums its lattice springs in the order of
/// neighbours.h, then its other springs in the order of Problem::springs. No bit depends on the number of
/// threads or the width of a register. The table says what each formulation rounds:
///
/// | formulation | stored | force, relative to |
/// | --- | --- | --- |
/// | paper | x, both products, their difference, a dt^2 | the springs' lengths |
/// | position | x, (1-lambda)(x - x_prev), a dt^2, the sum of these two | the springs' lengths |
/// | displacement | as position, of u | the springs' lengths |
/// | increment | u, v, the change of v | the springs' forces |
/// | compensated | nothing: low parts keep what rounding removes | the springs' forces |
///
/// A force gets an error of up to half a unit in the last place of `precision`, relative to the sum over its
/// springs of the table's last column, plus the force itself and that of gravity. Backends round some ten
/// operations per spring; these errors are independent and together have about that size.
class PerturbedReference : public CpuBackend {
public:
    /// The perturbation from the next upload() on.
    virtual void perturb(const Perturbation& perturbation) = 0;
    /// Like download(), but into an existing State, whose memory is used again: new memory for a large body
    /// takes longer than a step.
    virtual void read(State& state) const = 0;
};
std::unique_ptr<PerturbedReference> make_perturbed_reference(const Perturbation& perturbation);

/// The name of the unperturbed reference in result rows.
inline const std::string parallel_reference_name = "parallel_reference";

}  // namespace voxspring
