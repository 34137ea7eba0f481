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

/// How many threads share `blocks` blocks. If the user does not choose the number, it is all threads there
/// are, except that none is used for less work than a barrier is worth. 128 blocks take a core about 10 us.
std::ptrdiff_t share_count(const Options& options, std::ptrdiff_t blocks);

/// Whether everything is computed, with neutral values where the scene has none, and nothing is skipped or
/// shared. The skips are tested against this.
bool all_terms(const Options& options);

Root root_of(const Options& options);
/// The relative error of roots and divisions beyond the precision, on the SIMD target in use.
double root_error(const Options& options);

/// Empty, or why these options do not go together.
std::string refused_options(const Options& options);

/// The most that a particle of a tile that falls asleep moves per step, in spacings. 0: no tile sleeps.
double sleep_threshold(const Options& options);

/// A part of the state closer to 0 than this, in spacings, is set to 0. A result of 0 means that none is.
double flush_threshold(const Options& options);

/// Scalars in a particle's state: positions or displacements of two steps, or those and the increment.
int state_arrays(Formulation formulation);

/// The neighbour bits of the directions to visit: those in which any particle has a neighbour.
std::uint32_t bits_in_use(const Problem& problem, const Options& options);

}  // namespace voxspring::cpu_parallel
