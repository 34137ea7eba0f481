// Feeds write displacements of particles for a picture. They write to a window's buffer, which OpenGL lends
// to CUDA, to host memory, or, for another library, to an array on the device.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "backends/backend.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/feed.h"

namespace voxspring::cuda {

/// Makes a feed that fills the OpenGL buffer `buffer`, whose context is current. On each write, the feed asks
/// `feeding` where the particles are. `stream` must outlive the feed. The result is null if the context is on
/// another device than the current one, or on no CUDA device.
template <class Real>
std::unique_ptr<Feed> make_feed(const std::vector<FedWord<Real>>& fed, std::uint32_t buffer,
                                const Stream& stream, std::function<Feeding<Real>()> feeding);
/// Makes a feed that fills host memory. On each read, it asks `feeding` where the particles are.
template <class Real>
std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                         std::function<Feeding<Real>()> feeding);
/// Makes a feed that fills an array on the device. On each read, it asks `feeding` where the particles are.
template <class Real>
std::unique_ptr<DeviceFeed> make_device_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                             std::function<Feeding<Real>()> feeding);

}  // namespace voxspring::cuda
