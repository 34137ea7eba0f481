#include "cuda/common/edit.h"

#include <cstring>

#include "cuda/common/support_kernels.h"

namespace voxspring::cuda {
namespace {

template <class Argument>
void send_in_words(const Kernel& kernel, std::byte* to, std::span<const std::byte> from, unsigned words,
                   const Stream& stream) {
    Argument argument{};
    std::memcpy(&argument, from.data(), from.size());
    auto* const first = reinterpret_cast<ArgumentWord*>(to);
    constexpr auto threads = unsigned(sizeof(Argument) / sizeof(ArgumentWord));
    kernel.launch(stream, dim3(1), dim3(threads), 0, argument, words, first);
}

}  // namespace

void send_as_argument(std::byte* to, std::span<const std::byte> from, const Stream& stream) {
    // A launch with a shorter argument is cheaper. Both kernels are the same in either precision.
    const SupportKernels& kernels = any_support_kernels();
    const auto words = unsigned((from.size() + sizeof(ArgumentWord) - 1) / sizeof(ArgumentWord));
    if (from.size() <= sizeof(ShortArgument)) {
        send_in_words<ShortArgument>(*kernels.write_short_argument, to, from, words, stream);
    } else {
        send_in_words<LongArgument>(*kernels.write_long_argument, to, from, words, stream);
    }
}

template <class Real>
void write_bits(ParticleRecord<Real>* words, const EditedWord* edited, std::size_t count,
                const Stream& stream) {
    launch_for_each(*support_kernels<Real>().write_particle_bits, count, stream, words, edited, count);
}

void write_words(std::uint32_t* words, const EditedWord* edited, std::size_t count, const Stream& stream) {
    launch_for_each(*any_support_kernels().write_bare_words, count, stream, words, edited, count);
}

void write_slots_and_bits(std::uint16_t* slot, std::size_t slots, ParticleRecord<float>* words,
                          const EditedWord* edited, std::size_t count, const Stream& stream) {
    launch_for_each(*support_kernels<float>().write_slots_and_bits, count, stream, slot, slots, words, edited,
                    count);
}

template <class Real>
void write_rows(const EditedRows<Real>& rows, std::size_t count, const ListShape& shape,
                ParticleRecord<Real>* words, std::uint32_t* neighbour, SpringConstants<Real>* constants,
                SpringRest<Real>* off_lattice_rest, const Stream& stream) {
    const std::size_t slots = count * shape.slots;
    launch_for_each(*support_kernels<Real>().write_rows, slots, stream, rows, slots, shape, words, neighbour,
                    constants, off_lattice_rest);
}

template <class Real>
void write_springs(const EditedSpring<Real>* edited, std::size_t count, SpringEnds* ends,
                   SpringConstants<Real>* constants, SpringRest<Real>* off_lattice_rest,
                   const Stream& stream) {
    launch_for_each(*support_kernels<Real>().write_springs, count, stream, edited, count, ends, constants,
                    off_lattice_rest);
}

void write_slices(const EditedSlice* edited, std::size_t count, Slice* slices, const Stream& stream) {
    launch_for_each(*any_support_kernels().write_slices, count, stream, edited, count, slices);
}

#define FOR_PRECISION(Real)                                                                                  \
    template void write_bits(ParticleRecord<Real>*, const EditedWord*, std::size_t, const Stream&);          \
    template void write_rows(const EditedRows<Real>&, std::size_t, const ListShape&, ParticleRecord<Real>*,  \
                             std::uint32_t*, SpringConstants<Real>*, SpringRest<Real>*, const Stream&);      \
    template void write_springs(const EditedSpring<Real>*, std::size_t, SpringEnds*, SpringConstants<Real>*, \
                                SpringRest<Real>*, const Stream&);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::cuda
