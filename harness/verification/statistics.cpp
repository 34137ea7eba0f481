#include "harness/verification/statistics.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <vector>

#include "harness/verification/conserved.h"

namespace voxspring {
namespace {

glm::dvec3 centre_of_mass(const Problem& problem, const State& state) {
    glm::dvec3 sum(0);
    double mass = 0;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        sum += problem.material_of(i).mass * state.displacement[i];
        mass += problem.material_of(i).mass;
    }
    return mass > 0 ? sum / mass : sum;
}

/// One number an octave, from distance 1 on.
std::vector<double> spectrum_of(const Problem& problem, const std::vector<std::uint32_t>& particle_of,
                                const State& state) {
    const Lattice& lattice = problem.lattice;
    const glm::ivec3 dims = lattice.dims;
    const std::ptrdiff_t strides[] = {1, dims.x, std::ptrdiff_t(dims.x) * dims.y};
    std::vector<double> bands;
    for (int apart = 1; apart < std::max({dims.x, dims.y, dims.z}); apart *= 2) {
        double sum = 0;
        std::size_t pairs = 0;
        for (std::size_t i = 0; i < problem.particle_count(); ++i) {
            const glm::ivec3 at = lattice.coordinates(lattice.voxel[i]);
            for (int axis = 0; axis < 3; ++axis) {
                if (at[axis] + apart >= dims[axis]) continue;
                const std::uint32_t j = particle_of[std::size_t(lattice.voxel[i] + strides[axis] * apart)];
                if (j == no_particle) continue;
                const glm::dvec3 difference = state.displacement[j] - state.displacement[i];
                sum += glm::dot(difference, difference);
                ++pairs;
            }
        }
        bands.push_back(pairs > 0 ? std::sqrt(sum / double(pairs)) : 0);
    }
    return bands;
}

Statistic spectra(const Problem& problem, const State& state, const State& reference) {
    if (problem.lattice.mask.empty()) return {};
    const std::vector<std::uint32_t> particle_of = particle_of_voxel(problem.lattice);
    const std::vector<double> one = spectrum_of(problem, particle_of, state);
    const std::vector<double> other = spectrum_of(problem, particle_of, reference);
    Statistic result;
    for (std::size_t band = 0; band < one.size(); ++band) {
        result.difference = std::hypot(result.difference, one[band] - other[band]);
        result.size = std::hypot(result.size, other[band]);
    }
    return result;
}

}  // namespace

std::string to_string(Statistic::Kind kind) {
    constexpr std::array<const char*, Statistic::count> names = {"centre of mass", "kinetic energy",
                                                                 "spring energy", "spectrum"};
    return names[kind];
}

Statistics statistics(const Problem& problem, const State& start, const State& state,
                      const State& reference) {
    double squares = 0;
    for (std::size_t i = 0; i < problem.particle_count(); ++i) {
        const glm::dvec3 moved = reference.displacement[i] - start.displacement[i];
        squares += glm::dot(moved, moved);
    }
    const Energy energy_of_state = energy(problem, state), energy_of_reference = energy(problem, reference);
    const double size = energy_of_reference.size();
    Statistics result;
    result[Statistic::centre_of_mass] = {
        glm::length(centre_of_mass(problem, state) - centre_of_mass(problem, reference)),
        std::sqrt(squares / double(std::max<std::size_t>(1, problem.particle_count())))};
    result[Statistic::kinetic_energy] = {std::abs(energy_of_state.kinetic - energy_of_reference.kinetic),
                                         size};
    result[Statistic::spring_energy] = {std::abs(energy_of_state.springs - energy_of_reference.springs),
                                        size};
    result[Statistic::spectrum] = spectra(problem, state, reference);
    return result;
}

}  // namespace voxspring
