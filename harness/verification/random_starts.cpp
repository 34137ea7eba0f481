#include "harness/verification/random_starts.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>
#include <random>

#include "backends/physics/huge_pages.h"
#include "harness/verification/conserved.h"

namespace voxspring {

namespace {

std::vector<glm::dvec3> random_displacement(const Problem& problem, double amplitude) {
    std::vector<glm::dvec3> displacement;
    resize_in_huge_pages(displacement, problem.particle_count());
    std::mt19937_64 generator(7);
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            // A product with a power of two is exact, as std::ldexp() is, and takes a third of its time.
            const double uniform = double(generator() >> 11) * 0x1p-52 - 1;
            if (!problem.is_pinned(i)) displacement[i][axis] = amplitude * uniform;
        }
    }
    return displacement;
}

}  // namespace

State random_start(const Problem& problem, double amplitude) {
    State state{random_displacement(problem, amplitude), {}};
    resize_in_huge_pages(state.increment, problem.particle_count());
    return state;
}

State strained_start(const Problem& problem) {
    const double shortest = 1e6 * std::sqrt(problem.shortest_squared());
    // An empty list of increments means zeros. A full one takes gigabytes for a body of 10^8 particles.
    return {random_displacement(problem, 0.1 * shortest), {}};
}

double farthest(const State& state) {
    double largest = 0;
    for (std::size_t i = 0; i < state.increment.size(); ++i) {
        const double moved = glm::length(state.increment[i]);
        if (!std::isfinite(moved + glm::length(state.displacement[i])))
            return std::numeric_limits<double>::infinity();
        largest = std::max(largest, moved);
    }
    return largest;
}

int steps_to_grow(const Problem& problem, double excess) {
    const double lambda = problem.damping;
    const double half = (2 - lambda - (4 - 2 * lambda) * (1 + excess) * (1 + excess)) / 2;
    const double growth = -half + std::sqrt(half * half - (1 - lambda));
    // A mode's mean share of a random start with n components is 1 / sqrt(n). A tenth of that is assumed
    // here, to be safe.
    const double wanted = max_growth * 10 * std::sqrt(3 * double(problem.particle_count()));
    return int(std::ceil(std::log(wanted) / std::log(growth)));
}

State run_from(const State& start, const Problem& problem, Backend& backend, int steps) {
    backend.upload(problem, start);
    backend.step(steps);
    return backend.download();
}

double energy_before_step(const Problem& problem, Backend& backend) {
    State state = backend.download();
    backend.step(1);
    const State next = backend.download();
    for (std::size_t i = 0; i < state.increment.size(); ++i)
        state.increment[i] = (state.increment[i] + next.increment[i]) * 0.5;
    return energy(problem, state).total();
}

}  // namespace voxspring
