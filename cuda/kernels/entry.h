// What every kernel file of a step begins with. REAL, FETCH, TERMS, THREADS and BLOCKS are macros that are
// defined when the file is compiled, at run time (cuda/device/compiler.h).
#pragma once

#include "cuda/kernels/fetch.h"
#include "cuda/kernels/terms.h"

namespace voxspring::cuda {

using Real = REAL;
using Fetch = FETCH<Real>;
using Terms = TERMS;

/// An SM must have room for BLOCKS blocks. The compiler may use the registers per thread that this allows,
/// for example to have more fetches in flight.
#define KERNEL extern "C" __global__ void __launch_bounds__(THREADS, BLOCKS)

/// With LISTED_BLOCKS a launch steps only some blocks, whose numbers are in an additional last argument.
#ifdef LISTED_BLOCKS
#define AND_BLOCKS , const unsigned* __restrict__ blocks
#define BLOCK_NUMBER blocks[blockIdx.x]
#else
#define AND_BLOCKS
#define BLOCK_NUMBER blockIdx.x
#endif

/// With DEPENDENT_LAUNCH the next step may start while this one still runs, once all blocks of this step have
/// passed AWAIT_STEP_BEFORE() and there is room. Each thread waits there until the previous step has ended.
/// Without DEPENDENT_LAUNCH there is no wait.
#if defined(DEPENDENT_LAUNCH) && __CUDA_ARCH__ >= 900
#define AWAIT_STEP_BEFORE()                            \
    asm volatile("griddepcontrol.wait;" ::: "memory"); \
    asm volatile("griddepcontrol.launch_dependents;")
#else
#define AWAIT_STEP_BEFORE()
#endif

}  // namespace voxspring::cuda
