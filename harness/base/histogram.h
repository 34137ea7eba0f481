// Histograms of values between a tenth of a microsecond and a second, with logarithmic bins, and percentiles.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace voxspring {

/// The value that `fraction` of the values do not exceed. `sorted` is ascending and not empty.
double percentile(const std::vector<double>& sorted, double fraction);

/// The bins that are not empty, ascending: where each begins, in seconds, and how many values lie in it.
using Histogram = std::vector<std::pair<double, std::int64_t>>;

/// Bins of histogram_of(): each ends at 10^(1 / bins_a_decade) times its beginning, the last at
/// histogram_end. The first bin also holds all lower values, the last one all higher values.
inline constexpr int bins_a_decade = 20;
inline constexpr double histogram_begin = 1e-7, histogram_end = 1;

/// The histogram of `sorted`: seconds, ascending.
Histogram histogram_of(const std::vector<double>& sorted);

}  // namespace voxspring
