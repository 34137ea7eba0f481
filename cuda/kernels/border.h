// The bodies of the kernels that copy the places (positions or displacements) of a border's particles from a
// state into a message, and from a message into a state. A message is an array of numbers, or consists of
// words (TaggedPoint) that a device stores into the memory of the device that receives them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "backends/layout/records/resident.h"
#include "backends/physics/portable.h"
#include "cuda/kernels/layout.h"

namespace voxspring::cuda {

/// Where the places (positions or displacements) of some particles are in a state. The state is an array of
/// words, each with x, y and z of one particle, or a structure of arrays: x of all particles or of a group of
/// them, then their y, then their z.
template <class Real>
struct BorderPlaces {
    const std::uint32_t* element;  ///< the element of each particle
    std::size_t count;
    Real* at;                               ///< address of x of element 0
    Real* low;                              ///< address of the low part of x of element 0, or null
    std::size_t element_pitch, axis_pitch;  ///< distance to the next element, and from x to y

    /// Numbers in a message: x of all particles, then y, then z, and then any low parts in the same order.
    VOXSPRING_HOST_DEVICE std::size_t numbers() const { return (low != nullptr ? 6 : 3) * count; }
    /// How many words (TaggedPoint) a message has if it consists of words.
    VOXSPRING_HOST_DEVICE std::size_t words() const {
        return numbers() * sizeof(Real) / sizeof(Vector<float>);
    }
};

/// A vector's bits as vectors of three 32-bit numbers: one such vector in float32, two in float64.
template <class Real>
struct SplitVector {
    static constexpr int parts = sizeof(Real) / sizeof(float);
    Vector<float> part[parts];
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

/// Splits the place of particle n into groups of three 32-bit numbers. Calls put(k, numbers) for each group,
/// for k from 0 on.
template <class Real, class Put>
VOXSPRING_HOST_DEVICE void split_place(const BorderPlaces<Real>& places, std::size_t n, Put put) {
    const std::size_t first = places.element[n] * places.element_pitch;
    int k = 0;
    for (const Real* const part : {places.at, places.low}) {
        if (part == nullptr) continue;
        const Real* const at = part + first;
        const Vector<Real> place{at[0], at[places.axis_pitch], at[2 * places.axis_pitch]};
        const auto split = __builtin_bit_cast(SplitVector<Real>, place);
        for (const Vector<float>& numbers : split.part) put(k++, numbers);
    }
}

/// Writes the place of particle n, for which get(k) returns the numbers that split_place() passed to put(k).
template <class Real, class Get>
VOXSPRING_HOST_DEVICE void join_place(const BorderPlaces<Real>& places, std::size_t n, Get get) {
    const std::size_t first = places.element[n] * places.element_pitch;
    int k = 0;
    for (Real* const part : {places.at, places.low}) {
        if (part == nullptr) continue;
        SplitVector<Real> split;
        for (Vector<float>& numbers : split.part) numbers = get(k++);
        const auto place = __builtin_bit_cast(Vector<Real>, split);
        Real* const at = part + first;
        at[0] = place.x;
        at[places.axis_pitch] = place.y;
        at[2 * places.axis_pitch] = place.z;
    }
}

/// Threads per block of the kernel `exchange_borders`, and the number of its blocks for which a
/// multiprocessor must have registers. That leaves 40 registers per thread, so that a block also fits beside
/// the blocks of a march, which leave 4096 of 65536.
inline constexpr unsigned exchange_threads = 96, exchange_blocks = 16;

/// One border as the kernel `exchange_borders` sees it from one of the two parts. A message consists of words
/// (kernels/exchange.h): word 0 of all particles, then word 1, numbered as by split_place(). Successive
/// messages use two buffers in turn. The tag of a message is its number, from 1 on.
template <class Real>
struct BorderLink {
    const std::uint32_t *sent, *received;  ///< elements of the particles, as in BorderPlaces
    std::size_t sent_count, received_count;
    TaggedPoint* outbox[2];       ///< in the memory of the other part's device
    const TaggedPoint* inbox[2];  ///< in this device's memory
    std::uint32_t* taken;         ///< per thread: the number of messages of which it has taken its share

    /// `all`, restricted to the particles that this part sends; arriving(): to those that it receives.
    VOXSPRING_HOST_DEVICE BorderPlaces<Real> leaving(BorderPlaces<Real> all) const {
        all.element = sent;
        all.count = sent_count;
        return all;
    }
    VOXSPRING_HOST_DEVICE BorderPlaces<Real> arriving(BorderPlaces<Real> all) const {
        all.element = received;
        all.count = received_count;
        return all;
    }
};

}  // namespace voxspring::cuda
