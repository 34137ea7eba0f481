// How far a backend's state is from the oracle's, and how far it may be.
#pragma once

#include <cstddef>
#include <limits>
#include <string>

#include "backends/backend.h"

namespace voxspring {

/// A state against the reference, over all particles. Lengths are in the scene's unit of length.
struct Comparison {
    bool finite = false;     ///< every component of the state is; if not, the errors are infinite
    double relative_l2 = 0;  ///< ||u - u_ref|| / ||u_ref||, u the displacement; 0 if both vanish,
                             ///< infinite if only u_ref does
    double max = 0;          ///< largest |u_i - u_ref_i|
    double rms = 0;          ///< root mean square of |u_i - u_ref_i|
    std::size_t worst = 0;   ///< particle with the largest difference, or the first that is not finite
    double tolerance = 0;    ///< on `max`; infinite: it is not judged by that
    double tolerance_rms = std::numeric_limits<double>::infinity();  ///< likewise on `rms`
    std::string reason;                                              ///< empty: passed; otherwise why not
    bool passed() const { return reason.empty(); }
};

/// Over all springs at rest.
struct SpringLengths {
    double longest = 0;  ///< rest length
    double strain = 0;   ///< by how much one is longer or shorter at rest than its rest length
};
SpringLengths spring_lengths(const Problem& problem);

/// The most that gravity and loads together accelerate a particle by.
double forced_acceleration(const Problem& problem);

/// Bound on the largest rounding error of any particle after the few `steps` of a test, from the number of
/// steps and the precision alone: quick, and far too wide for a long run, which judge() (errors.h) measures.
///
/// Rounding errors of independent sign, d a step, drive a free mode as a doubly summed random walk, d
/// sqrt(n^3 / 3) / sqrt(3) in the mean; three times that, d n^1.5, is the tolerance. n is two more than
/// `steps`: a start is two states, each rounded to the backend's precision as a step would round it. With u
/// half an ulp of 1, l the longest rest length and U = max|displacement| + n max|increment|, which bounds how
/// far any particle has been from rest,
///
/// | formulation | d / u | |
/// | --- | --- | --- |
/// | position | max abs(x) + 16 l | the state's own rounding; forces, a few u of lengths under 4 l in sum |
/// | paper | 3 max abs(x) + 16 l | two products of x and their difference are rounded as well |
/// | displacement | U + 16 l | the state is as small as U; forces are still differences of lengths |
/// | increment | U + 16 w | forces are off by a few u of w, by how much a spring's ends move apart |
/// | compensated | 16 w | the state's own rounding is gone |
///
/// The stability limit keeps the forces of a step under 4 times what a spring changes by: w = min(2 U + s, 2
/// l), s the largest strain at rest (a length), since the cancellation-free force of ends that went 2 U apart
/// is off by a few u of that, and of no more than 2 l however far they were rotated.
///
/// `paper` has a bias on top: fl(2 - lambda) - fl(1 - lambda) differs from 1 by up to 1.5 u unless lambda is
/// 0, which acts each step and always the same way, as a force proportional to x: 1.5 u max|x| n^2 / 2.
///
/// Nor are errors of independent sign where gravity or loads act on what springs have not reached yet: the
/// same a dt^2 is added to a state X, x or the displacement, each step, and rounded with it in the same way.
/// That costs e = min(half an ulp of X, a dt^2) a step, e n^2 / 2 after n and no more than the motion itself,
/// U; where a dt^2 is the smaller one, motion stalls. `increment` adds to v, which is as small as what is
/// added.
///
/// A tool's springs are as others, as long as it moves no farther than the longest spring.
///
/// The reference has been rounded too, in float64 and at worst in `position`: d is no less than its.
///
/// `root_error` is that of approximate roots and divisions (BackendEntry::root_error). It makes a spring's
/// force off by that share of it where it comes from the strain, of k l where it is a difference of lengths:
/// w or l times the error, and always to the same side, since the same length has the same error. A force
/// that is off so drives a mode of frequency o, o dt < 2, in its own rhythm, whose amplitude then grows by no
/// more than that per step.
double rounding_tolerance(const Problem& problem, const State& reference, Precision precision, int steps,
                          Formulation formulation = Formulation::position, double root_error = 0);

/// Finiteness first, then sizes, then every component; against no tolerance. A reference without
/// displacements is one at rest.
Comparison differences(const State& state, const State& reference);

/// The same against rounding_tolerance().
Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps, Formulation formulation = Formulation::position, double root_error = 0);

}  // namespace voxspring
