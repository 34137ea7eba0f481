#include "harness/verification/statistics.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <vector>

#include "harness/verification/sum.h"

namespace voxspring {
namespace {

/// Sums over particles: squared displacement, mass, and moment of mass.
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

/// For each octave the sum of squared differences, and their number.
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

std::string to_string(Statistic::Kind kind) {
    constexpr std::array<const char*, Statistic::count> names = {"centre of mass", "kinetic energy",
                                                                 "spring energy", "spectrum"};
    return names[kind];
}

StateSummary summary_of(const Problem& problem, const State& start, const State& state) {
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
    summary.energy = energy(problem, state);
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
