#include "harness/base/histogram.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace voxspring {
namespace {

const int bin_count = int(std::lround(bins_a_decade * std::log10(histogram_end / histogram_begin)));

double begin_of(int bin) { return histogram_begin * std::pow(10, double(bin) / bins_a_decade); }

int bin_of(double seconds) {
    int bin =
        int(std::floor(bins_a_decade * std::log10(std::max(seconds, histogram_begin) / histogram_begin)));
    // The logarithm is rounded. These corrections put a value at an edge into the bin that begins there.
    if (seconds >= begin_of(bin + 1)) ++bin;
    if (seconds < begin_of(bin)) --bin;
    return std::clamp(bin, 0, bin_count - 1);
}

}  // namespace

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
