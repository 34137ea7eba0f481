// Parallel sums over all particles.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace voxspring {

/// Sums over all i < count. add(part, i) adds element i to the partial sum `part`. The order of summation
/// does not depend on the number of threads.
template <class Sum, class Add>
Sum sum_of(std::size_t count, Add add) {
    constexpr std::size_t chunk = 65536;
    std::vector<Sum> parts((count + chunk - 1) / chunk);
    // For a single chunk it is not worth waking the threads.
#pragma omp parallel for if (parts.size() > 1)
    for (std::ptrdiff_t c = 0; c < std::ptrdiff_t(parts.size()); ++c) {
        const std::size_t begin = std::size_t(c) * chunk;
        for (std::size_t i = begin; i < std::min(begin + chunk, count); ++i) add(parts[std::size_t(c)], i);
    }
    Sum sum{};
    for (const Sum& part : parts) sum += part;
    return sum;
}

}  // namespace voxspring
