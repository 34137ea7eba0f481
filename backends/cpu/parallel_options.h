// What the options of cpu_parallel mean (README.md), and what follows from them for a problem. cpu_explicit
// also uses `threads`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "backends/backend.h"
#include "backends/cpu/simd/root.h"

namespace voxspring::cpu_parallel {

/// The largest accepted number of threads, and the largest that threads=auto means; OMP_THREAD_LIMIT may
/// lower it. The system may refuse to start more, and OpenMP would then end the process.
inline constexpr int max_threads = 1024;

/// The number of threads. Throws BadSpecification, which names the backend, if the option asks for too many.
int thread_count(const Options& options, const std::string& backend);

/// How many threads share `blocks` blocks. With threads=auto each of several threads gets at least 128
/// blocks, which take a core about 10 us. A smaller share would be less work than a barrier costs.
std::ptrdiff_t share_count(const Options& options, std::ptrdiff_t blocks);

/// Whether terms=all: loads, masses and directions that the scene lacks are computed with neutral values, and
/// no work is skipped (except by `sleep`) or shared between the two ends of a spring. Tests compare it with
/// terms=needed.
bool all_terms(const Options& options);

Root root_of(const Options& options);
/// The relative error of square roots and divisions on the SIMD target in use, in addition to rounding.
double root_error(const Options& options);

/// An empty string, or why these options do not go together.
std::string refused_options(const Options& options);

/// The tuning `sleep`: a tile falls asleep (its particles stop) only if they move by less than this per step,
/// in lattice spacings. 0: no tile falls asleep.
double sleep_threshold(const Options& options);

/// Components of displacements and increments that are closer to 0 than this, in lattice spacings, are set to
/// 0. If the result is 0, none are.
double flush_threshold(const Options& options);

/// Scalars per particle in the state: positions or displacements of two steps; by increments also the
/// increment; in `compensated` also the low parts of all these.
int state_arrays(Formulation formulation);

/// Mask bits of the directions to visit: those in which a particle has a neighbour, or all with terms=all.
std::uint32_t bits_in_use(const Problem& problem, const Options& options);

}  // namespace voxspring::cpu_parallel
