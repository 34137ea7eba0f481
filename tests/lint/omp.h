// For the preset `lint`: clang-tidy 14 reads what Clang 16 compiles, and Clang 16's omp.h lies where it does
// not look.
#pragma once

extern "C" {
int omp_get_max_threads();
int omp_get_num_procs();
int omp_get_num_threads();
int omp_get_thread_limit();
int omp_get_thread_num();
void omp_set_num_threads(int count);
}
