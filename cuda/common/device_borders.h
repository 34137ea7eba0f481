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

/// Values for Capabilities::border_ways: "peer", "stores" and "nccl". If `splits_steps`, each of them also
/// with the suffix `_overlap`: borders are then stepped first, and are sent while the other particles are
/// stepped.
std::vector<std::string> border_ways(bool splits_steps);
/// Whether `way` has the suffix `_overlap`.
bool overlaps(const std::string& way);

/// Lets the current device, `own`, read and write the memory of `other`. Returns false if the hardware does
/// not connect the two in this way.
bool enable_peer_access(int own, int other);
/// Throws Unavailable unless words of 16 bytes arrive whole (kernels/exchange.h), which takes NVLink. NVLink
/// is told from PCIe by the support for atomics between the devices.
void require_whole_words(int own, int other);
/// Calls enable_peer_access(), and throws Unavailable if that returns false.
void require_peer_access(int own, int other);

/// Like SharedParticles, but `sent` and `received` have the indices of the particles' elements in the state.
struct SharedElements {
    int part;  ///< as in SharedParticles
    std::vector<std::uint32_t> sent, received;
};

/// The result of BorderFacet::device_borders() for a state that is stepped on `device`. For a way that
/// overlaps(), the caller has to set `state.first`, which steps the borders before the rest.
template <class Real>
std::shared_ptr<DeviceBorders> make_device_borders(const std::vector<SharedElements>& borders,
                                                   const std::string& way, const Device& device,
                                                   const BorderState<Real>& state);

}  // namespace voxspring::cuda
