// What the options of cpu_parallel mean (README.md), and what follows from them for a problem. cpu_explicit
// has `threads` as well.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "backends/backend.h"
#include "backends/cpu/simd/root.h"

namespace voxspring::cpu_parallel {

/// Throws BadSpecification, which names the backend, where the option names too many.
int thread_count(const Options& options, const std::string& backend);

/// How many threads share that many blocks: all there are, but where the number is left to us none for less
/// work than a barrier is worth. 128 blocks take a core about 10 us.
std::ptrdiff_t share_count(const Options& options, std::ptrdiff_t blocks);

/// Whether everything is computed, with neutral values where the scene has none, and nothing is skipped
/// or shared: what the skips are tested against.
bool all_terms(const Options& options);

Root root_of(const Options& options);
/// By how much such roots and divisions are off, relatively, beyond the precision: on the SIMD target in use.
double root_error(const Options& options);

/// Empty, or why these options do not go together.
std::string refused_options(const Options& options);

/// How far a particle of a tile that falls asleep moves in a step at most, in spacings; 0: none sleeps.
double sleep_threshold(const Options& options);

/// How close to 0 a part of the state is set to it, in spacings; 0: not at all.
double flush_threshold(const Options& options);

/// Scalars of a particle's state: positions or displacements of two steps, or those and the increment.
int state_arrays(Formulation formulation);

/// The neighbour bits of the directions to visit: those in which any particle has a neighbour.
std::uint32_t bits_in_use(const Problem& problem, const Options& options);

}  // namespace voxspring::cpu_parallel
