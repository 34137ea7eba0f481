// Where the particles of a feed (FeedFacet) lie in memory. Built on the host, without a device.
#pragma once

#include <vector>

#include "backends/layout/particles.h"
#include "backends/layout/records/feed.h"
#include "backends/layout/vectors.h"

namespace voxspring::layout {

/// The words of `particles`, in their order. word_of(i): the index of particle i's word.
template <class Real, class WordOf>
std::vector<FedWord<Real>> pack_fed(const Problem& problem, const std::vector<std::uint32_t>& particles,
                                    Formulation formulation, WordOf word_of) {
    std::vector<FedWord<Real>> fed;
    fed.reserve(particles.size());
    for (const std::uint32_t i : particles) {
        const glm::dvec3 rest = on_positions(formulation) ? problem.rest_position[i] : glm::dvec3(0);
        fed.push_back({vector_of<Real>(rest), std::uint32_t(word_of(i))});
    }
    return fed;
}

}  // namespace voxspring::layout
