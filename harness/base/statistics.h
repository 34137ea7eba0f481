// Statistics of measured values. Each takes at least one value.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace voxspring {

double mean(const std::vector<double>& values);

/// The value in the middle, or the mean of the two in the middle if their number is even.
double median(std::vector<double> values);

/// The value below which `fraction` of the values lie, interpolated linearly between two of them: 0.5 gives
/// median().
double quantile(std::vector<double> values, double fraction);

/// Half of the interquartile range, divided by the median.
double relative_spread(const std::vector<double>& values);

/// The standard deviation of a sample: the divisor is the number of values less one. It is 0 for a single
/// value.
double standard_deviation(const std::vector<double>& values);

/// The smallest value that at least the share `fraction` of the values does not exceed. `sorted` is ascending
/// and not empty.
double percentile(const std::vector<double>& sorted, double fraction);

/// The bins that are not empty, ascending: where each begins, in seconds, and how many values lie in it.
using Histogram = std::vector<std::pair<double, std::int64_t>>;

/// Bins of histogram_of(): each ends at 10^(1 / bins_per_decade) times its beginning, the last at
/// histogram_end. The first bin also holds all lower values, the last one all higher values.
inline constexpr int bins_per_decade = 20;
inline constexpr double histogram_begin = 1e-7, histogram_end = 1;

/// The histogram of `sorted`: seconds, ascending.
Histogram histogram_of(const std::vector<double>& sorted);

}  // namespace voxspring
