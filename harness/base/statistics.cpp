#include "harness/base/statistics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace voxspring {
namespace {

const int bin_count = int(std::lround(bins_per_decade * std::log10(histogram_end / histogram_begin)));

double begin_of(int bin) { return histogram_begin * std::pow(10, double(bin) / bins_per_decade); }

int bin_of(double seconds) {
    int bin =
        int(std::floor(bins_per_decade * std::log10(std::max(seconds, histogram_begin) / histogram_begin)));
    // The logarithm is rounded. These corrections put a value at an edge into the bin that begins with it.
    if (seconds >= begin_of(bin + 1)) ++bin;
    if (seconds < begin_of(bin)) --bin;
    return std::clamp(bin, 0, bin_count - 1);
}

}  // namespace

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / double(values.size());
}

double median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const std::size_t middle = values.size() / 2;
    return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

std::pair<double, double> medians_of_halves(const std::vector<double>& values) {
    constexpr std::size_t fewest = 4;
    if (values.size() < fewest) return {median(values), median(values)};
    std::array<std::vector<double>, 2> halves;
    for (std::size_t n = 0; n < values.size(); ++n) halves[n % 2].push_back(values[n]);
    return {median(halves[0]), median(halves[1])};
}

double quantile(std::vector<double> values, double fraction) {
    std::sort(values.begin(), values.end());
    const double place = fraction * double(values.size() - 1);
    const auto below = std::size_t(place);
    const auto above = std::min(below + 1, values.size() - 1);
    return values[below] + (place - double(below)) * (values[above] - values[below]);
}

double relative_spread(const std::vector<double>& values) {
    return (quantile(values, 0.75) - quantile(values, 0.25)) / 2 / median(values);
}

double standard_deviation(const std::vector<double>& values) {
    if (values.size() < 2) return 0;
    const double centre = mean(values);
    double squares = 0;
    for (const double value : values) squares += (value - centre) * (value - centre);
    return std::sqrt(squares / double(values.size() - 1));
}

double percentile(const std::vector<double>& sorted, double fraction) {
    const auto rank = std::size_t(std::ceil(fraction * double(sorted.size())));
    return sorted[std::max<std::size_t>(rank, 1) - 1];
}

Histogram histogram_of(const std::vector<double>& sorted) {
    Histogram histogram;
    for (const double seconds : sorted) {
        const double begin = begin_of(bin_of(seconds));
        if (histogram.empty() || histogram.back().first != begin) histogram.emplace_back(begin, 0);
        ++histogram.back().second;
    }
    return histogram;
}

}  // namespace voxspring
