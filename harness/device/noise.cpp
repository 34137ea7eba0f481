#include "harness/device/noise.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>

#include "harness/base/clock.h"
#include "harness/base/statistics.h"

namespace voxspring {
namespace {

/// The widest gap between two groups of values, as a fraction of the median of all; 0 if the values do not
/// form two groups. Each group must have at least a quarter of the values and at least two, and the gap must
/// be more than three times as wide as either group.
double parting(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    const std::size_t fewest = std::max<std::size_t>(2, (values.size() + 3) / 4);
    double widest = 0;
    for (std::size_t n = fewest; n + fewest <= values.size(); ++n) {
        const double gap = values[n] - values[n - 1];
        const double wider = std::max(values[n - 1] - values.front(), values.back() - values[n]);
        constexpr double times_as_wide = 3;
        if (gap > times_as_wide * wider) widest = std::max(widest, gap);
    }
    return widest / median(values);
}

/// The change from the median of the first third of the values to that of the last third, relative to the
/// first median. The result is 0 unless the Mann-Kendall trend test (Mann 1945) finds a trend at the 1%
/// level. That test finds none in fewer than six values.
double drift(const std::vector<double>& values) {
    const std::size_t count = values.size(), third = count / 3;
    double rises = 0;
    for (std::size_t n = 0; n < count; ++n) {
        for (std::size_t m = 0; m < n; ++m)
            rises += double(values[n] > values[m]) - double(values[n] < values[m]);
    }
    constexpr double one_percent = 2.576;  // two-sided quantile of the normal distribution
    const double by_chance = std::sqrt(double(count * (count - 1) * (2 * count + 5)) / 18);
    if (third == 0 || std::abs(rises) <= one_percent * by_chance) return 0;
    const auto part = std::ptrdiff_t(third);
    return median({values.end() - part, values.end()}) / median({values.begin(), values.begin() + part}) - 1;
}

std::string percent(double fraction) { return std::to_string(std::lround(100 * fraction)) + "%"; }

}  // namespace

double spin_seconds() {
    constexpr int tries = 3, additions = 20000;
    double least = std::numeric_limits<double>::infinity();
    volatile std::uint64_t result = 1;
    for (int i = 0; i < tries; ++i) {
        const auto begin = Clock::now();
        std::uint64_t x = result;
        // Each operation needs the result of the previous one, so neither compiler nor core can overlap them.
        for (int k = 0; k < additions; ++k) x = x * 6364136223846793005u + 1442695040888963407u;
        result = x;
        least = std::min(least, seconds_since(begin));
    }
    return least;
}

std::optional<double> waited_seconds() {
    std::error_code none;
    std::optional<double> sum;
    for (const auto& thread : std::filesystem::directory_iterator("/proc/self/task", none)) {
        std::ifstream schedstat(thread.path() / "schedstat");
        std::uint64_t ran = 0, waited = 0;
        if (schedstat >> ran >> waited) sum = sum.value_or(0) + 1e-9 * double(waited);
    }
    return sum;
}

unsigned other_processes(const std::vector<pid_t>& on_card, const OwnProcesses& own) {
    const auto is_own = [&](pid_t process) {
        return std::find(own.all.begin(), own.all.end(), process) != own.all.end();
    };
    const auto known = unsigned(std::count_if(on_card.begin(), on_card.end(), is_own));
    const auto all = unsigned(on_card.size());
    return all - (known > 0 ? known : std::min(all, own.on_card));
}

std::vector<std::string> reasons_of_noise(const Observed& observed) {
    std::vector<std::string> reasons;
    const auto add = [&](const std::string& kind, const std::string& figure) {
        reasons.push_back(kind + " (" + figure + ")");
    };
    // The quartiles of fewer than four repetitions mean nothing.
    constexpr std::size_t fewest = 4;
    if (observed.seconds.size() >= fewest) {
        const double spread = 2 * relative_spread(observed.seconds);
        if (spread > max_spread)
            add("the middle half of the repetitions spreads", "over " + percent(spread) + " of their median");
        // If the repetitions form two groups, their median only tells which group is larger.
        if (const double apart = parting(observed.seconds); apart > max_parting)
            add("its repetitions form two groups", percent(apart) + " apart");
        if (const double change = drift(observed.seconds); std::abs(change) > max_drift)
            add("its repetitions drift", percent(change) + " from the first third to the last");
    }
    if (!observed.spins.empty()) {
        const auto [least, most] = std::minmax_element(observed.spins.begin(), observed.spins.end());
        const double change = *most / *least - 1;
        if (change > max_clock_change) add("the processor's clock moved", "by " + percent(change));
    }
    if (!observed.waits.empty()) {
        const double waiting = voxspring::median(observed.waits);
        if (waiting > max_waiting)
            add("its threads waited for a processor", percent(waiting) + " of the time");
    }
    if (!observed.card_mhz.empty()) {
        const auto [least, most] = std::minmax_element(observed.card_mhz.begin(), observed.card_mhz.end());
        if (*most > (1 + max_clock_change) * *least)
            add("the card's clock moved",
                "between " + std::to_string(*least) + " and " + std::to_string(*most) + " MHz");
    }
    if (!observed.other_users.empty()) {
        const unsigned most = *std::max_element(observed.other_users.begin(), observed.other_users.end());
        if (most > 0) add("other processes computed on the card", std::to_string(most));
    }
    return reasons;
}

}  // namespace voxspring
