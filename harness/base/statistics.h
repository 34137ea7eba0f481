// Statistics of a few measured values. Each takes at least one value.
#pragma once

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

}  // namespace voxspring
