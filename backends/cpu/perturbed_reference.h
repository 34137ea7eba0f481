// The reference on all cores, and the same with the rounding of a formulation and a precision put in at
// random (Monte Carlo arithmetic; D. S. Parker, 1997).
//
// It is no backend that a user names: it shares the functions of spring.h and the registers of simd/ with
// cpu_parallel, and nothing else.
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
        nearest,  ///< every stored number is rounded to the nearest of `precision`, as a backend rounds it
        random  ///< stored numbers are rounded up or down at random, the nearer neighbour more often; forces
                ///< are off by as much as their arithmetic may be, parameters by half a unit
    };
    Kind kind = Kind::none;
    Formulation formulation = Formulation::increment;
    Precision precision = Precision::float64;
    /// Relative error of a length and a division beyond `precision`, of backends that approximate them.
    double root_error = 0;
    std::uint64_t seed = 0;  ///< of the random numbers, which depend on it, the step and the particle alone
};

/// One run of the reference after another, each perturbed as it is told.
///
/// Float64, every core and SIMD register. Each particle sums its lattice springs in the order of
/// neighbours.h, then Problem::springs in their order; no bit depends on the number of threads or the width
/// of a register. What is rounded, by formulation:
///
/// | formulation | stored | force, relative to |
/// | --- | --- | --- |
/// | paper | x, both products, their difference | the springs' lengths |
/// | position | x, (1-lambda)(x - x_prev), the change | the springs' lengths |
/// | displacement | as position, of u | the springs' lengths |
/// | increment | u, v, the change of v | the springs' forces |
/// | compensated | nothing: two numbers hold it | the springs' forces |
///
/// A force is off by up to half a unit of `precision` of the sum of what its springs are relative to.
/// Backends round some ten operations a spring, whose errors are independent: of about that size together.
class PerturbedReference : public CpuBackend {
public:
    /// From the next upload() on.
    virtual void perturb(const Perturbation& perturbation) = 0;
    /// download() to where an earlier state may have been: for a large one new memory takes longer than a
    /// step.
    virtual void read(State& state) const = 0;
};
std::unique_ptr<PerturbedReference> make_perturbed_reference(const Perturbation& perturbation);

/// What result rows call the one that is not perturbed.
inline const std::string parallel_reference_name = "parallel_reference";

}  // namespace voxspring
