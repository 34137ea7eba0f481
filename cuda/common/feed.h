// Displacements for a picture: into a window's buffer, which OpenGL lends to CUDA, into host memory, or
// for another library into an array on the device.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "backends/backend.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/feed.h"

namespace voxspring::cuda {

/// What fills the OpenGL buffer `buffer`, whose context is current, with what `feeding` says when it is
/// asked. The stream must outlive it. The result is null if that context is on another device, or on none.
template <class Real>
std::unique_ptr<Feed> make_feed(const std::vector<FedWord<Real>>& fed, std::uint32_t buffer,
                                const Stream& stream, std::function<Feeding<Real>()> feeding);
/// What fills host memory with what `feeding` says when it is asked.
template <class Real>
std::unique_ptr<HostFeed> make_host_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                         std::function<Feeding<Real>()> feeding);
/// What fills an array on the device with what `feeding` says when it is asked.
template <class Real>
std::unique_ptr<DeviceFeed> make_device_feed(const std::vector<FedWord<Real>>& fed, const Stream& stream,
                                             std::function<Feeding<Real>()> feeding);

}  // namespace voxspring::cuda
