// Before a loop: its body as often as it runs, so that what it indexes may be registers; or once.
#pragma once

#ifdef __CUDACC__
#define UNROLLED _Pragma("unroll")
#define ROLLED _Pragma("unroll 1")
#else
#define UNROLLED
#define ROLLED
#endif
