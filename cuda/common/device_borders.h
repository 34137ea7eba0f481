// Borders between backends whose devices are of one process, from device to device.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "cuda/common/border.h"
#include "cuda/device/device.h"

namespace voxspring::cuda {

/// "peer", "stores" and "nccl", and with `_overlap` behind them those in which borders are stepped and sent
/// first: Capabilities::border_ways of backends whose steps can be split so, or not.
std::vector<std::string> border_ways(bool splits_steps);
/// Whether borders are stepped first.
bool overlaps(const std::string& way);

/// Has the current device, `own`, read and write the memory of `other`, if the hardware connects them so.
/// Whether it does.
bool enable_peer_access(int own, int other);
/// The same for what cannot do without: throws Unavailable where the hardware does not.
void require_peer_access(int own, int other);

/// The elements that particles of a border are.
struct SharedElements {
    int part;  ///< SharedParticles
    std::vector<std::uint32_t> sent, received;
};

/// Backend::device_borders() of a state that is stepped on `device`; `state.first` where `way` overlaps.
template <class Real>
std::shared_ptr<DeviceBorders> make_device_borders(const std::vector<SharedElements>& borders,
                                                   const std::string& way, const Device& device,
                                                   const BorderState<Real>& state);

}  // namespace voxspring::cuda
