// Pragmas before a loop. UNROLLED repeats its body, so that arrays that it indexes may be in registers;
// ROLLED does not.
#pragma once

#ifdef __CUDACC__
#define UNROLLED _Pragma("unroll")
#define ROLLED _Pragma("unroll 1")
#else
#define UNROLLED
#define ROLLED
#endif
