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

}  // namespace voxspring::cuda
