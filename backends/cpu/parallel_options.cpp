#include "backends/cpu/parallel_options.h"

#include <omp.h>

#include <algorithm>

#include "backends/cpu/kernel.h"
#include "backends/physics/neighbours.h"
#include "backends/registry.h"
#include "backends/rest_policy.h"

namespace voxspring::cpu_parallel {

int thread_count(const Options& options, const std::string& backend) {
    const std::string& threads = options.tuning.at("threads");
    const int most = std::min(omp_get_thread_limit(), max_threads);
    if (threads == "auto") return std::min(omp_get_max_threads(), most);
    const int count = std::stoi(threads);
    if (count > most) {
        throw BadSpecification("backend " + backend + ": threads=" + threads + " is more than the maximum, " +
                               std::to_string(most) +
                               (most < max_threads ? ", which OMP_THREAD_LIMIT sets" : ""));
    }
    return count;
}

std::ptrdiff_t share_count(const Options& options, std::ptrdiff_t blocks) {
    const std::ptrdiff_t min_blocks = options.tuning.at("threads") == "auto" ? 128 : 1;
    return std::min<std::ptrdiff_t>(
        {thread_count(options, "cpu_parallel"), blocks, std::max<std::ptrdiff_t>(1, blocks / min_blocks)});
}

bool all_terms(const Options& options) { return options.tuning.at("terms") == "all"; }

Root root_of(const Options& options) {
    const std::string& root = options.tuning.at("root");
    if (root == "exact") return Root::exact;
    return root == "refined" ? Root::refined : Root::raw;
}

double root_error(const Options& options) { return error_of_roots(root_of(options), approximation_error()); }

std::string refused_options(const Options& options) {
    const std::string& root = options.tuning.at("root");
    if (root != "exact" && options.precision == Precision::float64)
        return "root=" + root + " requires precision=float32";
    return refused_rest(options);
}

double sleep_threshold(const Options& options) {
    const std::string& sleep = options.tuning.at("sleep");
    return sleep == "off" ? 0 : std::stod(sleep);
}

double flush_threshold(const Options& options) { return rest_of(options) == Rest::flush ? flushed_below : 0; }

int state_arrays(Formulation formulation) {
    if (formulation == Formulation::compensated) return 2 * (6 + 3);
    return by_increments(formulation) ? 6 + 3 : 6;
}

std::uint32_t bits_in_use(const Problem& problem, const Options& options) {
    if (all_terms(options)) return NEIGHBOUR_BITS;
    std::uint32_t bits = 0;
    for (const std::uint32_t mask : problem.lattice.mask) bits |= mask;
    return bits & NEIGHBOUR_BITS;
}

}  // namespace voxspring::cpu_parallel
