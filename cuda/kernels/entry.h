// What a kernel file is compiled with at run time (cuda/device/compiler.h): REAL, FETCH, TERMS, THREADS and
// BLOCKS are macros. A kernel's arguments are those of cuda/common/particles.h.
#pragma once

#include "cuda/kernels/fetch.h"
#include "cuda/kernels/terms.h"

namespace voxspring::cuda {

using Real = REAL;
using Fetch = FETCH<Real>;
using Terms = TERMS;

/// An SM has to have room for BLOCKS blocks. The compiler may use the registers that this leaves for fetches
/// in flight.
#define KERNEL extern "C" __global__ void __launch_bounds__(THREADS, BLOCKS)

/// With LISTED_BLOCKS a launch is a part of the blocks: a last argument lists their numbers.
#ifdef LISTED_BLOCKS
#define AND_BLOCKS , const unsigned* __restrict__ blocks
#define BLOCK_NUMBER blocks[blockIdx.x]
#else
#define AND_BLOCKS
#define BLOCK_NUMBER blockIdx.x
#endif

/// With DEPENDENT_LAUNCH the next step is launched while this one runs: as soon as all blocks of this one
/// have come by here and there is room. Here each thread waits for the step before this one to have ended,
/// and for nothing where it was not launched so.
#if defined(DEPENDENT_LAUNCH) && __CUDA_ARCH__ >= 900
#define AWAIT_STEP_BEFORE()                            \
    asm volatile("griddepcontrol.wait;" ::: "memory"); \
    asm volatile("griddepcontrol.launch_dependents;")
#else
#define AWAIT_STEP_BEFORE()
#endif

}  // namespace voxspring::cuda
