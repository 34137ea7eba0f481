// Statistics of a few measured values. Each takes at least one value.
#pragma once

#include <vector>

namespace voxspring {

double mean(const std::vector<double>& values);

/// The value in the middle; of an even number of them the mean of the two in the middle.
double median(std::vector<double> values);

/// The value below which `fraction` of them lie, between two of them linearly: 0.5 gives median().
double quantile(std::vector<double> values, double fraction);

/// Half of what the middle half of the values spans, over their median.
double relative_spread(const std::vector<double>& values);

/// Of a sample, by one less than the number of values; 0 of a single value.
double standard_deviation(const std::vector<double>& values);

}  // namespace voxspring
