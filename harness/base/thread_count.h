// Changes the number of OpenMP's threads temporarily.
#pragma once

#include <omp.h>

namespace voxspring {

/// While this object lives, OpenMP's parallel regions that this thread begins have `count` threads.
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
