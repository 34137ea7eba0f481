// Pragmas before a loop of a kernel; on the host they are empty. UNROLLED repeats the body of the loop, so
// that arrays that the body indexes may be in registers. ROLLED keeps the loop.
#pragma once

#ifdef __CUDACC__
#define UNROLLED _Pragma("unroll")
#define ROLLED _Pragma("unroll 1")
#else
#define UNROLLED
#define ROLLED
#endif
