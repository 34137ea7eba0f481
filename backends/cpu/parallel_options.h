// What the options of cpu_parallel mean (README.md), and what follows from them for a problem. cpu_explicit
// also uses `threads`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "backends/backend.h"
#include "backends/cpu/simd/root.h"

namespace voxspring::cpu_parallel {

/// The number of threads. Throws BadSpecification, which names the backend, if the option asks for too many.
int thread_count(const Options& options, const std::string& backend);

/// How many threads share `blocks` blocks. With threads=auto each thread gets at least 128 blocks, which take
/// a core about 10 us: a smaller share would be less work than a barrier costs.
std::ptrdiff_t share_count(const Options& options, std::ptrdiff_t blocks);

/// Whether every term is computed, with neutral values for what the scene lacks, and no work is skipped or
/// shared between the two ends of a spring. Tests compare the skipping code with this.
bool all_terms(const Options& options);

Root root_of(const Options& options);
/// The relative error of square roots and divisions on the SIMD target in use, in addition to rounding.
double root_error(const Options& options);

/// Empty, or why these options do not go together.
std::string refused_options(const Options& options);

/// A tile falls asleep only while its particles move by less than this per step, in spacings. 0: no tile
/// sleeps.
double sleep_threshold(const Options& options);

/// Components of the state that are closer to 0 than this, in spacings, are set to 0. 0: none is.
double flush_threshold(const Options& options);

/// Scalars per particle in the state: x or u of two steps; by increments also v; in `compensated` also the
/// low parts of all these.
int state_arrays(Formulation formulation);

/// Mask bits of the directions to visit: those in which a particle has a neighbour, or all with terms=all.
std::uint32_t bits_in_use(const Problem& problem, const Options& options);

}  // namespace voxspring::cpu_parallel
