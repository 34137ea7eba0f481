// The number of threads that OpenMP uses, for a while.
#pragma once

#include <omp.h>

namespace voxspring {

/// While this object lives, parallel regions that this thread begins have `count` threads.
class ThreadCount {
public:
    explicit ThreadCount(int count) : before_(omp_get_max_threads()) { omp_set_num_threads(count); }
    ThreadCount(const ThreadCount&) = delete;
    ThreadCount& operator=(const ThreadCount&) = delete;
    ~ThreadCount() { omp_set_num_threads(before_); }

private:
    const int before_;
};

}  // namespace voxspring
