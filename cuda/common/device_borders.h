// Borders between parts of a body that are on devices of one process: messages go from device to device.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "cuda/common/border.h"
#include "cuda/device/device.h"

namespace voxspring::cuda {

/// Values for Capabilities::border_ways: "peer", "stores" and "nccl". If `splits_steps`, also each of these
/// with the suffix `_overlap`, which means: borders are stepped first, and are sent while the other particles
/// are stepped.
std::vector<std::string> border_ways(bool splits_steps);
/// Whether `way` has the suffix `_overlap`.
bool overlaps(const std::string& way);

/// Lets the current device, `own`, read and write the memory of `other`. Returns false if the hardware does
/// not connect the two in this way.
bool enable_peer_access(int own, int other);
/// Throws Unavailable unless words of 16 bytes arrive whole (kernels/exchange.h), which takes NVLink between
/// two devices. Devices count as joined by NVLink if they support native atomics in each other's memory; over
/// PCIe they do not.
void require_whole_words(int own, int other);
/// Calls enable_peer_access(), and throws Unavailable if that returns false.
void require_peer_access(int own, int other);

/// The elements of a state's arrays that hold `particles`. element_of(i): the index of particle i's element.
template <class ElementOf>
std::vector<std::uint32_t> elements_of(const std::vector<std::uint32_t>& particles,
                                       const ElementOf& element_of) {
    std::vector<std::uint32_t> elements;
    for (const std::uint32_t i : particles) elements.push_back(std::uint32_t(element_of(i)));
    return elements;
}

/// `borders` with elements in place of particles.
template <class ElementOf>
std::vector<SharedParticles> in_elements(std::vector<SharedParticles> borders, const ElementOf& element_of) {
    for (SharedParticles& shared : borders) {
        shared.sent = elements_of(shared.sent, element_of);
        shared.received = elements_of(shared.received, element_of);
    }
    return borders;
}

/// The result of BorderFacet::device_borders() for a state that is stepped on `device`. `borders`: the result
/// of in_elements(). If overlaps(way), the caller has to set `state.first`, which steps the borders before
/// the rest.
template <class Real>
std::shared_ptr<DeviceBorders> make_device_borders(const std::vector<SharedParticles>& borders,
                                                   const std::string& way, const Device& device,
                                                   const BorderState<Real>& state);

}  // namespace voxspring::cuda
