#include <cstring>

#include "cuda/common/edit.h"

namespace voxspring::cuda {
namespace {

constexpr unsigned block = 128;

template <std::size_t Words>
struct Argument {
    uint4 word[Words];  // NOLINT(modernize-avoid-c-arrays)
};

__device__ std::size_t thread_number() { return std::size_t(blockIdx.x) * blockDim.x + threadIdx.x; }

template <class Real>
__global__ void bits_kernel(ParticleRecord<Real>* words, const EditedWord* edited, std::size_t count) {
    if (thread_number() < count) write_bits(words, edited[thread_number()]);
}

__global__ void words_kernel(std::uint32_t* words, const EditedWord* edited, std::size_t count) {
    if (thread_number() < count) words[edited[thread_number()].word] = edited[thread_number()].bits;
}

__global__ void slots_and_bits_kernel(std::uint16_t* slot, std::size_t slots, ParticleRecord<float>* words,
                                      const EditedWord* edited, std::size_t count) {
    if (thread_number() < count) write_slot_or_bits(slot, slots, words, edited, thread_number());
}

template <class Real>
__global__ void rows_kernel(EditedRows<Real> rows, std::size_t slots, ListShape shape,
                            ParticleRecord<Real>* words, std::uint32_t* neighbour,
                            SpringConstants<Real>* constants, SpringRest<Real>* off_lattice_rest) {
    const std::size_t n = thread_number();
    if (n >= slots) return;
    write_slot(rows, n, shape, neighbour, constants, off_lattice_rest);
    // One thread of a row.
    const std::size_t row = n / shape.slots;
    if (words != nullptr && n % shape.slots == 0)
        write_bits(words, EditedWord{rows.particle[row], rows.bits[row]});
}

__global__ void slices_kernel(const EditedSlice* edited, std::size_t count, Slice* slices) {
    if (thread_number() < count) slices[edited[thread_number()].number] = edited[thread_number()].slice;
}

template <class Real>
__global__ void springs_kernel(const EditedSpring<Real>* edited, std::size_t count, SpringEnds* ends,
                               SpringConstants<Real>* constants, SpringRest<Real>* off_lattice_rest) {
    if (thread_number() < count) write_spring(edited[thread_number()], ends, constants, off_lattice_rest);
}

template <std::size_t Words>
__global__ void argument_kernel(__grid_constant__ const Argument<Words> argument, unsigned words, uint4* to) {
    if (thread_number() < words) to[thread_number()] = argument.word[thread_number()];
}

template <std::size_t Words>
void send_in_words(std::byte* to, std::span<const std::byte> from, unsigned words, const Stream& stream) {
    Argument<Words> argument{};
    std::memcpy(&argument, from.data(), from.size());
    argument_kernel<Words><<<1, Words, 0, stream.get()>>>(argument, words, reinterpret_cast<uint4*>(to));
    check(cudaGetLastError());
}

unsigned blocks_for(std::size_t count) { return unsigned((count + block - 1) / block); }

}  // namespace

void send_as_argument(std::byte* to, std::span<const std::byte> from, const Stream& stream) {
    constexpr std::size_t few = 16;  // a launch with a short argument is cheaper
    const std::size_t words = (from.size() + sizeof(uint4) - 1) / sizeof(uint4);
    if (words <= few) {
        send_in_words<few>(to, from, unsigned(words), stream);
    } else {
        send_in_words<max_argument_bytes / sizeof(uint4)>(to, from, unsigned(words), stream);
    }
}

template <class Real>
void write_bits(ParticleRecord<Real>* words, const EditedWord* edited, std::size_t count,
                const Stream& stream) {
    if (count == 0) return;
    bits_kernel<<<blocks_for(count), block, 0, stream.get()>>>(words, edited, count);
    check(cudaGetLastError());
}

void write_words(std::uint32_t* words, const EditedWord* edited, std::size_t count, const Stream& stream) {
    if (count == 0) return;
    words_kernel<<<blocks_for(count), block, 0, stream.get()>>>(words, edited, count);
    check(cudaGetLastError());
}

void write_slots_and_bits(std::uint16_t* slot, std::size_t slots, ParticleRecord<float>* words,
                          const EditedWord* edited, std::size_t count, const Stream& stream) {
    if (count == 0) return;
    slots_and_bits_kernel<<<blocks_for(count), block, 0, stream.get()>>>(slot, slots, words, edited, count);
    check(cudaGetLastError());
}

template <class Real>
void write_rows(const EditedRows<Real>& rows, std::size_t count, const ListShape& shape,
                ParticleRecord<Real>* words, std::uint32_t* neighbour, SpringConstants<Real>* constants,
                SpringRest<Real>* off_lattice_rest, const Stream& stream) {
    const std::size_t slots = count * shape.slots;
    if (slots == 0) return;
    rows_kernel<<<blocks_for(slots), block, 0, stream.get()>>>(rows, slots, shape, words, neighbour,
                                                               constants, off_lattice_rest);
    check(cudaGetLastError());
}

template <class Real>
void write_springs(const EditedSpring<Real>* edited, std::size_t count, SpringEnds* ends,
                   SpringConstants<Real>* constants, SpringRest<Real>* off_lattice_rest,
                   const Stream& stream) {
    if (count == 0) return;
    springs_kernel<<<blocks_for(count), block, 0, stream.get()>>>(edited, count, ends, constants,
                                                                  off_lattice_rest);
    check(cudaGetLastError());
}

void write_slices(const EditedSlice* edited, std::size_t count, Slice* slices, const Stream& stream) {
    if (count == 0) return;
    slices_kernel<<<blocks_for(count), block, 0, stream.get()>>>(edited, count, slices);
    check(cudaGetLastError());
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
