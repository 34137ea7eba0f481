// The bodies of the kernels that copy the places of a border's particles from a state into a message, and
// from a message into another state.
#pragma once

#include <cstddef>
#include <cstdint>

#include "backends/physics/portable.h"

namespace voxspring::cuda {

/// Where the places (positions or displacements) of some particles are in a state. The state is an array of
/// words, each with x, y and z of one particle, or a structure of arrays: all x, then all y, then all z.
template <class Real>
struct BorderPlaces {
    const std::uint32_t* element;  ///< the element of each particle
    std::size_t count;
    Real* at;                               ///< address of x of element 0
    Real* low;                              ///< address of the low part of x of element 0, or null
    std::size_t element_pitch, axis_pitch;  ///< distance to the next element, and from x to y

    /// Numbers in a message: x of all particles, then y, then z, and then their low parts in the same order.
    VOXSPRING_HOST_DEVICE std::size_t numbers() const { return (low != nullptr ? 6 : 3) * count; }
};

/// Copies particle n from the state into the message.
template <class Real>
VOXSPRING_HOST_DEVICE void gather_place(const BorderPlaces<Real>& places, std::size_t n, Real* message) {
    const std::size_t first = places.element[n] * places.element_pitch;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t from = first + axis * places.axis_pitch;
        message[axis * places.count + n] = places.at[from];
        if (places.low != nullptr) message[(3 + axis) * places.count + n] = places.low[from];
    }
}

/// Copies particle n from the message into the state. What lies beside the place, such as a particle's bits,
/// stays.
template <class Real>
VOXSPRING_HOST_DEVICE void scatter_place(const BorderPlaces<Real>& places, std::size_t n,
                                         const Real* message) {
    const std::size_t first = places.element[n] * places.element_pitch;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::size_t to = first + axis * places.axis_pitch;
        places.at[to] = message[axis * places.count + n];
        if (places.low != nullptr) places.low[to] = message[(3 + axis) * places.count + n];
    }
}

}  // namespace voxspring::cuda
