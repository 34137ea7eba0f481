// How far a backend's state is from the oracle's, and how far it may be.
#pragma once

#include <cstddef>
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
    double tolerance = 0;    ///< on `max`
    std::string reason;      ///< empty: passed; otherwise why not
    bool passed() const { return reason.empty(); }
};

/// Bound on the largest rounding error of any particle after `steps` steps.
///
/// One step rounds a position by at most u |x| (u half an ulp of 1) and its spring forces by a few u of
/// their sum, which the stability limit keeps under 4 rest lengths: d = u (max|x| + 16 l). Rounding
/// errors of independent sign drive a free mode as a doubly summed random walk, d sqrt(n^3 / 3) / sqrt(3)
/// in the mean; three times that, d n^1.5, is the tolerance. n is two more than `steps`: a start is two
/// positions, each rounded to the backend's precision as a step would round it.
double rounding_tolerance(const Problem& problem, const State& reference, Precision precision, int steps);

/// Finiteness first, then sizes, then every component, against rounding_tolerance().
Comparison compare(const Problem& problem, const State& state, const State& reference, Precision precision,
                   int steps);

}  // namespace voxspring
