// Compares a backend's state with the reference's, and bounds the difference.
#pragma once

#include <cstddef>
#include <limits>
#include <string>

#include "backends/backend.h"

namespace voxspring {

/// The difference of a state from the reference, over all particles. Lengths are in the scene's unit of
/// length.
struct Comparison {
    bool finite = false;     ///< whether every displacement is finite; if not, the errors are infinite
    double relative_l2 = 0;  ///< ||u - u_ref|| / ||u_ref||, u the displacement; 0 if both vanish,
                             ///< infinite if only u_ref does
    double max = 0;          ///< largest |u_i - u_ref_i|
    double rms = 0;          ///< root mean square of |u_i - u_ref_i|
    double mean = 0;         ///< |mean of u_i - u_ref_i|
    std::size_t worst = 0;   ///< particle with the largest difference, or the first that is not finite
    double tolerance = 0;    ///< bound on `max`; infinite: `max` is not judged
    /// Bound on `rms`; infinite: `rms` is not judged.
    double tolerance_rms = std::numeric_limits<double>::infinity();
    double tolerance_mean = std::numeric_limits<double>::infinity();  ///< bound on `mean`; infinite: none
    std::string reason;  ///< why the state failed; empty: it passed
    bool passed() const { return reason.empty(); }
};

/// Largest values over all springs at rest.
struct SpringLengths {
    double longest = 0;  ///< longest rest length
    double strain = 0;   ///< largest difference between a spring's length at rest and its rest length
};
SpringLengths spring_lengths(const Problem& problem);

/// An upper bound on the acceleration of any particle by gravity and loads.
double forced_acceleration(const Problem& problem);

/// Bound on the largest rounding error of any particle after the few `steps` of a test, computed without a
/// further run. It is quick, and far too wide for long runs, for which judge() (errors.h) uses measured
/// spreads.
///
/// Rounding errors of independent sign, of size d per step, drive a free mode as a doubly summed random walk,
/// by d sqrt(n^3 / 3) / sqrt(3) in the mean. The tolerance is three times that, d n^1.5. n is `steps` + 2,
/// since a start has two successive states, each rounded as a step would round it. Let u be half
/// an ulp of 1, l the longest rest length, and U = max|displacement| + n max|increment|, which is taken for a
/// bound on how far any particle has been from rest. Then
///
/// | formulation | d / u | |
/// | --- | --- | --- |
/// | position | max abs(x) + 16 l | rounding of the state; forces, a few u of lengths under 4 l in sum |
/// | paper | 3 max abs(x) + 16 l | two products of x and their difference are rounded as well |
/// | displacement | U + 16 l | the state is as small as U; forces are still differences of lengths |
/// | increment | U + 16 w | forces are off by a few u of w, by which a spring's ends move apart |
/// | compensated | 16 w | the state itself has no rounding error |
///
/// The stability limit keeps the forces of a step below 4 times the change of a spring's length. w = min(2 U
/// + s, 2 l), where s is the largest strain at rest (a length): the cancellation-free force between ends that
/// moved 2 U apart has an error of a few u times that distance, and times at most 2 l, however far the spring
/// was rotated.
///
/// `paper` has an additional bias: fl(2 - lambda) - fl(1 - lambda) differs from 1 by up to 1.5 u unless
/// lambda is 0. It acts in every step and always in the same direction, like a force proportional to x: 1.5 u
/// max|x| n^2 / 2.
///
/// Errors also have the same sign if gravity or loads act on particles that no wave of springs has reached
/// yet. The same a dt^2 is then added to a state X (x or the displacement) in each step, and rounded in the
/// same way. The error is e = min(half an ulp of X, a dt^2) per step and e n^2 / 2 after n steps, but no more
/// than the motion U. If a dt^2 is the smaller one, motion stalls. `increment` adds to v, which is as small
/// as what is added.
///
/// A tool's springs behave like others as long as the tool moves no farther than the longest spring.
///
/// The reference is rounded too, at worst in float64 and `position`: d is at least that of such a run.
///
/// `root_error` is the relative error of approximate roots and divisions (BackendEntry::root_error). If a
/// force is computed from the strain, its error is root_error times the force, at most root_error k w. If it
/// is a difference of lengths, its error is root_error k l. k is the stiffness. The sign is always the same,
/// because the same length has the same error. Such an error drives a mode of frequency o, o dt < 2, in
/// resonance, and the amplitude grows per step by no more than root_error times w or l.
double rounding_tolerance(const Problem& problem, const State& reference, Precision precision, int steps,
                          Formulation formulation = Formulation::position, double root_error = 0);

/// A hash that is the same for states with the same bits.
std::string fingerprint_of(const State& state);
/// A hash of a backend's state, computed by the backend itself if it can do so. It can be compared only with
/// hashes of the same backend object.
std::string fingerprint_of(Backend& backend);

/// Compares displacements without a tolerance. Comparison::reason is set, and the errors are infinite, if a
/// displacement or the reference is not finite or if the number of displacements differs from the
/// reference's. A reference without displacements is at rest.
Comparison differences(const State& state, const State& reference);

/// Sets comparison.reason if `max`, `rms` or `mean` exceeds its tolerance, and otherwise makes it empty.
void judge(Comparison& comparison);

/// Compares as differences() does, and judges the result by rounding_tolerance().
Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps, Formulation formulation = Formulation::position, double root_error = 0);

}  // namespace voxspring
