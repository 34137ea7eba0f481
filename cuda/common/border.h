// Reads and writes the places (positions or displacements) of border particles in the state of a backend that
// launches each step separately. Border particles are shared with a neighbouring part of the body.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "backends/backend.h"
#include "cuda/common/borders_first.h"
#include "cuda/device/buffer.h"
#include "cuda/device/stream.h"
#include "cuda/kernels/border.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// The state of one part of a body, as seen by the code that sends and receives its border particles.
template <class Real>
struct BorderState {
    const Stream& stream;  ///< the backend's stream
    /// Returns where the particles' places are after the steps enqueued so far. The caller sets `element` and
    /// `count`.
    std::function<BorderPlaces<Real>()> now;
    std::function<void()> written;  ///< to be called once the writing of a received message is enqueued
    WaitLimit wait;                 ///< limit for kernels that wait for another part
    BordersFirst* first = nullptr;  ///< has a second stream for borders; null: all work is in `stream`

    /// The stream in which borders are sent and received.
    const Stream& lane() const { return first == nullptr ? stream : first->stream(); }
    void begin_send() const {
        if (first != nullptr) first->begin_send();
    }
    void end_receive() const {
        if (first != nullptr) first->end_receive();
    }

    /// The result of now(), for the particles that are in `elements`.
    BorderPlaces<Real> places(const Buffer<std::uint32_t>& elements) const {
        BorderPlaces<Real> places = now();
        places.element = elements.data();
        places.count = elements.size();
        return places;
    }
};

/// How exchange_places() launches its kernel.
struct ExchangeLaunch {
    unsigned blocks;  ///< blocks per link, that is per border with another part
    bool stores;      ///< whether the kernel sends messages
    bool takes;       ///< whether the kernel waits for messages and writes them to the state
    bool dependent;   ///< whether the kernel may begin while the previous step still runs
    /// How many threads serve one link.
    std::size_t threads() const { return std::size_t(blocks) * exchange_threads; }
};

/// All links (borders with other parts) of one part of a body, in device memory.
template <class Real>
using BorderLinks = Buffer<BorderLink<Real>>;

// Each of the next three functions enqueues one kernel, or none if there are no particles or links. A message
// may be in the memory of this device or of a peer, or in pinned host memory.

template <class Real>
void gather_places(const BorderPlaces<Real>& places, Real* message, const Stream& stream);
template <class Real>
void scatter_places(const BorderPlaces<Real>& places, const Real* message, const Stream& stream);
/// Over each of `links`, sends one message if `launch.stores`, and takes one if `launch.takes`. A kernel that
/// takes messages ends once the other parts have sent them, or when a wait exceeds `limit`.
template <class Real>
void exchange_places(const BorderPlaces<Real>& places, const BorderLinks<Real>& links,
                     const ExchangeLaunch& launch, const WaitLimit& limit, const Stream& stream);

/// `elements`: where the border's particles are in the state. `state.stream` must outlive the border.
template <class Real>
std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>& elements, BorderState<Real> state);

}  // namespace voxspring::cuda
