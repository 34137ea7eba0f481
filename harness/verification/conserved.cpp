#include "harness/verification/conserved.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <limits>
#include <vector>

#include "harness/verification/sum.h"

namespace voxspring {
namespace {

double quotient(double difference, double size) {
    if (difference == 0) return 0;
    return size > 0 ? difference / size : std::copysign(std::numeric_limits<double>::infinity(), difference);
}

/// The energy of a spring of stiffness 1. `rest` is the spring at rest as particle i sees it, `relative` is
/// u_i - u_j.
double spring_energy(const RestSpring& rest, const glm::dvec3& relative) {
    const glm::dvec3 offset = rest.offset + relative;
    // |d| - l = (|d|^2 - l^2) / (|d| + l), the numerator as in strain_density().
    const double excess = glm::dot(relative, rest.offset + offset) - rest.deficit;
    const double sum = glm::length(offset) + rest.length;
    const double stretch = sum > 0 ? excess / sum : 0;
    return stretch * stretch / 2;
}

/// Sums over particles: squared distance from the start, mass, and mass times displacement.
struct Moved {
    double squares = 0, mass = 0;
    glm::dvec3 moment{0};
    Moved& operator+=(const Moved& other) {
        squares += other.squares;
        mass += other.mass;
        moment += other.moment;
        return *this;
    }
};

/// For each octave of distances: the sum of squared differences of displacement, and the number of pairs of
/// particles.
struct Bands {
    static constexpr std::size_t most = 31;  // octaves of distances below 2^31
    std::array<double, most> squares{};
    std::array<std::uint64_t, most> pairs{};
    Bands& operator+=(const Bands& other) {
        for (std::size_t band = 0; band < most; ++band) {
            squares[band] += other.squares[band];
            pairs[band] += other.pairs[band];
        }
        return *this;
    }
};

/// The spectrum of the displacement, one number per octave, from distance 1 on.
std::vector<double> spectrum_of(const Problem& problem, const State& state) {
    const Lattice& lattice = problem.lattice;
    if (lattice.mask.empty()) return {};
    const std::vector<std::uint32_t> particle_of = particle_of_voxel(lattice);
    const glm::ivec3 dims = lattice.dims;
    const std::ptrdiff_t strides[] = {1, dims.x, std::ptrdiff_t(dims.x) * dims.y};
    std::vector<std::ptrdiff_t> distances;
    for (std::ptrdiff_t apart = 1; apart < std::max({dims.x, dims.y, dims.z}); apart *= 2)
        distances.push_back(apart);
    const auto sums = sum_of<Bands>(problem.particle_count(), [&](Bands& part, std::size_t i) {
        const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
        for (std::size_t band = 0; band < distances.size(); ++band) {
            for (int axis = 0; axis < 3; ++axis) {
                if (at[axis] + distances[band] >= dims[axis]) continue;
                const std::uint32_t j =
                    particle_of[std::size_t(lattice.voxel[i] + strides[axis] * distances[band])];
                if (j == no_particle) continue;
                const glm::dvec3 difference = state.displacement[j] - state.displacement[i];
                part.squares[band] += glm::dot(difference, difference);
                ++part.pairs[band];
            }
        }
    });
    std::vector<double> spectrum;
    for (std::size_t band = 0; band < distances.size(); ++band) {
        const auto pairs = double(sums.pairs[band]);
        spectrum.push_back(pairs > 0 ? std::sqrt(sums.squares[band] / pairs) : 0);
    }
    return spectrum;
}

}  // namespace

Momentum& Momentum::operator+=(const Momentum& other) {
    sum += other.sum;
    size += other.size;
    return *this;
}

Energy& Energy::operator+=(const Energy& other) {
    kinetic += other.kinetic;
    springs += other.springs;
    field += other.field;
    field_size += other.field_size;
    return *this;
}

Momentum momentum(const Problem& problem, const State& state) {
    return sum_of<Momentum>(problem.particle_count(), [&](Momentum& part, std::size_t i) {
        if (problem.is_pinned(i)) return;
        const glm::dvec3 p = problem.material_of(i).mass / problem.time_step * state.increment[i];
        part += {p, glm::length(p)};
    });
}

Energy energy(const Problem& problem, const State& state) {
    const double time_step_squared = problem.time_step * problem.time_step;
    Energy result = sum_of<Energy>(problem.particle_count(), [&](Energy& part, std::size_t i) {
        if (problem.is_pinned(i)) return;
        const double mass = problem.material_of(i).mass;
        part.kinetic += mass * glm::dot(state.increment[i], state.increment[i]) / time_step_squared / 2;
        glm::dvec3 force = mass * problem.gravity;
        if (!problem.load.empty()) force += problem.load[i];
        const double work = glm::dot(force, state.displacement[i]);
        part.field -= work;
        part.field_size += std::abs(work);
    });
    std::array<RestSpring, neighbour_count> rest{};
    for (const Direction& direction : directions())
        rest[std::size_t(direction.bit)] = rest_spring(problem, direction);
    const LatticeSprings springs(problem);
    const bool by_group = !problem.has_materials();
    result += sum_of<Energy>(problem.lattice.mask.size(), [&](Energy& part, std::size_t i) {
        springs.of(i, [&](std::uint32_t j, const Direction& direction) {
            const double stiffness = by_group ? problem.group_stiffness[std::size_t(direction.group)]
                                              : problem.spring_stiffness(i, j, direction);
            part.springs += stiffness * spring_energy(rest[std::size_t(direction.bit)],
                                                      state.displacement[i] - state.displacement[j]);
        });
    });
    result += sum_of<Energy>(problem.springs.size(), [&](Energy& part, std::size_t s) {
        const Spring& spring = problem.springs[s];
        part.springs += spring.stiffness *
                        spring_energy(rest_spring(problem, spring),
                                      state.displacement[spring.first] - state.displacement[spring.second]);
    });
    return result;
}

Conserved conserved(const Problem& problem, const State& state) {
    return {momentum(problem, state), energy(problem, state)};
}

Drift drift(const Conserved& run, const Conserved& reference) {
    return {quotient(glm::length(run.momentum.sum - reference.momentum.sum), reference.momentum.size),
            quotient(run.energy.total() - reference.energy.total(), reference.energy.size())};
}

std::string to_string(Statistic::Kind kind) {
    constexpr std::array<const char*, Statistic::count> names = {"centre of mass", "kinetic energy",
                                                                 "spring energy", "spectrum"};
    return names[kind];
}

StateSummary summary_of(const Problem& problem, const State& start, const State& state) {
    return summary_of(problem, start, state, energy(problem, state));
}

StateSummary summary_of(const Problem& problem, const State& start, const State& state, const Energy& known) {
    const std::size_t count = problem.particle_count();
    const auto sums = sum_of<Moved>(count, [&](Moved& part, std::size_t i) {
        const glm::dvec3 moved = state.displacement[i] - start.displacement_of(i);
        const double mass = problem.material_of(i).mass;
        part.squares += glm::dot(moved, moved);
        part.mass += mass;
        part.moment += mass * state.displacement[i];
    });
    StateSummary summary;
    if (count > 0) summary.moved = std::sqrt(sums.squares / double(count));
    if (sums.mass > 0) summary.centre_of_mass = sums.moment / sums.mass;
    summary.energy = known;
    summary.spectrum = spectrum_of(problem, state);
    return summary;
}

Statistics statistics(const StateSummary& run, const StateSummary& reference) {
    const double size = reference.energy.size();
    Statistics result;
    result[Statistic::centre_of_mass] = {glm::length(run.centre_of_mass - reference.centre_of_mass),
                                         reference.moved};
    result[Statistic::kinetic_energy] = {std::abs(run.energy.kinetic - reference.energy.kinetic), size};
    result[Statistic::spring_energy] = {std::abs(run.energy.springs - reference.energy.springs), size};
    Statistic& spectrum = result[Statistic::spectrum];
    for (std::size_t band = 0; band < reference.spectrum.size(); ++band) {
        spectrum.difference =
            std::hypot(spectrum.difference, run.spectrum.at(band) - reference.spectrum[band]);
        spectrum.size = std::hypot(spectrum.size, reference.spectrum[band]);
    }
    return result;
}

}  // namespace voxspring
