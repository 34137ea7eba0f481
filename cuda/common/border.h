// The border particles of a backend that launches one kernel per step: where their places (positions or
// displacements) are in its state. Such particles are shared with a neighbouring part of the body.
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

/// A state that has some particles at borders.
template <class Real>
struct BorderState {
    const Stream& stream;  ///< the stream in which the state is stepped
    /// Where the places are after the steps so far; `element` and `count` are unset.
    std::function<BorderPlaces<Real>()> now;
    std::function<void()> written;  ///< called once places have been written between steps
    WaitLimit wait;                 ///< of a kernel that waits for another part
    BordersFirst* first = nullptr;  ///< set if borders are stepped first; null: `stream` does all

    /// The stream in which borders are sent and received.
    const Stream& lane() const { return first == nullptr ? stream : first->stream(); }
    void begin_send() const {
        if (first != nullptr) first->begin_send();
    }
    void end_receive() const {
        if (first != nullptr) first->end_receive();
    }

    /// Where the particles of these elements are now.
    BorderPlaces<Real> places(const Buffer<std::uint32_t>& elements) const {
        BorderPlaces<Real> places = now();
        places.element = elements.data();
        places.count = elements.size();
        return places;
    }
};

/// A launch of exchange_places().
struct ExchangeLaunch {
    unsigned blocks;  ///< per link
    bool stores;      ///< whether it sends
    bool takes;       ///< whether it waits for messages and writes them to the state
    bool dependent;   ///< whether the launch may begin while the step before still runs
    /// How many threads serve one link.
    std::size_t threads() const { return std::size_t(blocks) * threads_per_block; }
    static constexpr unsigned threads_per_block = 512;
};

/// Links of one part, in device memory.
template <class Real>
using BorderLinks = Buffer<BorderLink<Real>>;

// Each of these functions enqueues one kernel, or none if there are no particles or links. A message may be
// in device memory, a peer's included, or in pinned memory of the host.

template <class Real>
void gather_places(const BorderPlaces<Real>& places, Real* message, const Stream& stream);
template <class Real>
void scatter_places(const BorderPlaces<Real>& places, const Real* message, const Stream& stream);
/// Sends one message over each of the links, and takes one. A kernel that takes ends once the other parts
/// have sent.
template <class Real>
void exchange_places(const BorderPlaces<Real>& places, const BorderLinks<Real>& links,
                     const ExchangeLaunch& launch, const WaitLimit& limit, const Stream& stream);

/// `elements`: elements of the state that hold the border's particles. The stream must outlive the border.
template <class Real>
std::unique_ptr<Border> make_border(const std::vector<std::uint32_t>& elements, BorderState<Real> state);

}  // namespace voxspring::cuda
