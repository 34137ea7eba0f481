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

}  // namespace voxspring::cuda
