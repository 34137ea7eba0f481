// Statistics of measured values. Each function but histogram_of() needs at least one value.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace voxspring {

double mean(const std::vector<double>& values);

/// The value in the middle of the sorted values, or the mean of the two in the middle.
double median(std::vector<double> values);

/// The medians of every second value, from the first and from the second value on. The fastest of many rows
/// is chosen by the first of them and reported by the second, since the least of many medians is partly luck.
/// With fewer than four values both are the median of all.
std::pair<double, double> medians_of_halves(const std::vector<double>& values);

/// The quantile of `fraction`: about this fraction of the values lie below the result, which is interpolated
/// linearly between two values. 0.5 gives median().
double quantile(std::vector<double> values, double fraction);

/// Half of the interquartile range, divided by the median.
double relative_spread(const std::vector<double>& values);

/// The standard deviation of a sample: the divisor is the number of values less one. The result is 0 for a
/// single value.
double standard_deviation(const std::vector<double>& values);

/// The smallest value v of `sorted` such that at least the fraction `fraction` of the values are at most v.
/// `sorted` must be ascending and not empty.
double percentile(const std::vector<double>& sorted, double fraction);

/// The bins that are not empty, ascending: pairs of the bin's beginning in seconds and its number of values.
using Histogram = std::vector<std::pair<double, std::int64_t>>;

/// The bins of histogram_of(). The first begins at histogram_begin and the last ends at histogram_end. Each
/// ends at 10^(1 / bins_per_decade) times its beginning. Values outside count in the first or the last bin.
inline constexpr int bins_per_decade = 20;
inline constexpr double histogram_begin = 1e-7, histogram_end = 1;

/// The histogram of `sorted`, which are times in seconds, ascending.
Histogram histogram_of(const std::vector<double>& sorted);

}  // namespace voxspring
