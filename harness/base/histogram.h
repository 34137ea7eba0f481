// How often values between a tenth of a microsecond and a second occur, in bins of equal ratio, and
// percentiles.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace voxspring {

/// The value that a fraction of them does not exceed. `sorted`: ascending, not empty.
double percentile(const std::vector<double>& sorted, double fraction);

/// Of bins that are not empty, ascending: where a bin begins, in seconds, and how many values lie in it.
using Histogram = std::vector<std::pair<double, std::int64_t>>;

/// Bins of histogram_of(): each ends 10^(1 / bins_a_decade) times where it begins, the last at histogram_end.
/// The first and the last also hold what lies below and above.
inline constexpr int bins_a_decade = 20;
inline constexpr double histogram_begin = 1e-7, histogram_end = 1;

/// `sorted`: seconds, ascending.
Histogram histogram_of(const std::vector<double>& sorted);

}  // namespace voxspring
