// The kernels that run before, between and after steps: they serve borders, edits, feeds, the tool, checks
// for divergence, hashes of the state, and rest lengths by the device's own root. REAL is the only macro.
// SupportKernels (cuda/common/support_kernels.h) holds the kernels under the names that they have here.
#include "backends/physics/state_hash.h"
#include "cuda/kernels/border.h"
#include "cuda/kernels/divergence_check.h"
#include "cuda/kernels/edit.h"
#include "cuda/kernels/exchange.h"
#include "cuda/kernels/feed.h"
#include "cuda/kernels/layout.h"
#include "cuda/kernels/tool.h"
#include "cuda/kernels/wait.h"

namespace voxspring::cuda {

using Real = REAL;

#define KERNEL extern "C" __global__ void

// A kernel that begins with this macro may be launched early: it waits here until the step before has ended.
#if __CUDA_ARCH__ >= 900
#define BEGIN_AFTER_THE_STEP asm volatile("griddepcontrol.wait;" ::: "memory")
#else
#define BEGIN_AFTER_THE_STEP
#endif

__device__ inline std::size_t thread_number() { return std::size_t(blockIdx.x) * blockDim.x + threadIdx.x; }

KERNEL gather_border(BorderPlaces<Real> places, Real* message) {
    if (thread_number() < places.count) gather_place(places, thread_number(), message);
}
KERNEL scatter_border(BorderPlaces<Real> places, const Real* message) {
    if (thread_number() < places.count) scatter_place(places, thread_number(), message);
}

// Each row of blocks serves one link. A thread stores its share of the message first and waits afterwards, so
// that a wait depends on nothing but the stores of the other part. If parts must not wait for each other, the
// host launches this kernel twice: once with `stores` alone, and once with `takes` alone.
extern "C" __global__ void __launch_bounds__(exchange_threads, exchange_blocks)
    exchange_borders(BorderPlaces<Real> places, const BorderLink<Real>* links, bool stores, bool takes,
                     WaitLimit limit) {
    BEGIN_AFTER_THE_STEP;
    const BorderLink<Real> link = links[blockIdx.y];
    const std::size_t threads = std::size_t(gridDim.x) * blockDim.x;
    const std::uint32_t number = link.taken[thread_number()], tag = number + 1;
    if (stores) {
        const BorderPlaces<Real> leaving = link.leaving(places);
        for (std::size_t n = thread_number(); n < leaving.count; n += threads) {
            TaggedPoint* const to = link.outbox[number % 2] + n;
            split_place(leaving, n, [&](int k, Vector<float> numbers) {
                store_word_system(to + std::size_t(k) * leaving.count, numbers, tag);
            });
        }
    }
    if (!takes) return;
    const BorderPlaces<Real> arriving = link.arriving(places);
    BoundedWait wait(limit, tag);
    for (std::size_t n = thread_number(); n < arriving.count; n += threads) {
        const TaggedPoint* const from = link.inbox[number % 2] + n;
        join_place(arriving, n, [&](int k) {
            TaggedPoint word = load_word_system(from + std::size_t(k) * arriving.count);
            while (word.tag != tag && !wait.is_over())
                word = load_word_system(from + std::size_t(k) * arriving.count);
            return word.point;
        });
    }
    link.taken[thread_number()] = tag;
}

KERNEL check_words(ParticlesInWords<Real> particles, std::size_t count, Real max_squared, long long step,
                   long long last_check, FirstDivergence* first) {
    check_divergence(particles, count, max_squared, step, last_check, first);
}
KERNEL check_axes(ParticlesInAxes<Real> particles, std::size_t count, Real max_squared, long long step,
                  long long last_check, FirstDivergence* first) {
    check_divergence(particles, count, max_squared, step, last_check, first);
}

KERNEL hash_words(const std::uint32_t* words, std::size_t count, unsigned array, unsigned* sums) {
    unsigned own[STATE_HASH_SUMS] = {};
    const std::size_t threads = std::size_t(gridDim.x) * blockDim.x;
    for (std::size_t n = thread_number(); n < count; n += threads) {
        for (unsigned sum = 0; sum < STATE_HASH_SUMS; ++sum)
            own[sum] += hashed_word(words[n], unsigned(n), array, sum);
    }
    for (unsigned sum = 0; sum < STATE_HASH_SUMS; ++sum) {
        for (unsigned apart = 16; apart > 0; apart /= 2)
            own[sum] += __shfl_xor_sync(0xFFFFFFFFu, own[sum], apart);
        if (threadIdx.x % 32 == 0) atomicAdd(sums + sum, own[sum]);
    }
}

KERNEL write_particle_bits(ParticleRecord<Real>* words, const EditedWord* edited, std::size_t count) {
    if (thread_number() < count) write_bits(words, edited[thread_number()]);
}
KERNEL write_bare_words(std::uint32_t* words, const EditedWord* edited, std::size_t count) {
    if (thread_number() < count) words[edited[thread_number()].word] = edited[thread_number()].bits;
}
KERNEL write_slots_and_bits(std::uint16_t* slot, std::size_t slots, ParticleRecord<Real>* words,
                            const EditedWord* edited, std::size_t count) {
    if (thread_number() < count) write_slot_or_bits(slot, slots, words, edited, thread_number());
}
KERNEL write_rows(EditedRows<Real> rows, std::size_t slots, ListShape shape, ParticleRecord<Real>* words,
                  std::uint32_t* neighbour, SpringConstants<Real>* constants,
                  SpringRest<Real>* off_lattice_rest) {
    const std::size_t n = thread_number();
    if (n >= slots) return;
    write_slot(rows, n, shape, neighbour, constants, off_lattice_rest);
    // The thread of a row's first slot also writes the bits of the row's particle.
    const std::size_t row = n / shape.slots;
    if (words != nullptr && n % shape.slots == 0)
        write_bits(words, EditedWord{rows.particle[row], rows.bits[row]});
}
KERNEL write_slices(const EditedSlice* edited, std::size_t count, Slice* slices) {
    if (thread_number() < count) slices[edited[thread_number()].number] = edited[thread_number()].slice;
}
KERNEL write_springs(const EditedSpring<Real>* edited, std::size_t count, SpringEnds* ends,
                     SpringConstants<Real>* constants, SpringRest<Real>* off_lattice_rest) {
    if (thread_number() < count) write_spring(edited[thread_number()], ends, constants, off_lattice_rest);
}

// These two kernels write a few values, which they get as an argument, since a separate copy would take
// longer.
KERNEL write_short_argument(__grid_constant__ const ShortArgument argument, unsigned words,
                            ArgumentWord* to) {
    if (thread_number() < words) to[thread_number()] = argument.word[thread_number()];
}
KERNEL write_long_argument(__grid_constant__ const LongArgument argument, unsigned words, ArgumentWord* to) {
    if (thread_number() < words) to[thread_number()] = argument.word[thread_number()];
}

KERNEL feed(Feeding<Real> feeding, FedDisplacement* displacements) {
    const std::size_t n = thread_number();
    if (n < feeding.count) displacements[n] = fed_displacement(feeding, n);
}

KERNEL pull_held_particles(Holding<Real> holding) {
    if (thread_number() < holding.count) pull_held(holding, thread_number());
}

KERNEL measure_lengths(Real* lengths, std::size_t count) {
    const std::size_t i = thread_number();
    if (i < count) lengths[i] = measured_or_zero(lengths[i]);
}
KERNEL measure_springs(SpringConstants<Real>* springs, std::size_t count) {
    const std::size_t i = thread_number();
    if (i < count) springs[i].rest_length = measured_or_zero(springs[i].rest_length);
}
KERNEL measure_inverse_roots(Real* squared, std::size_t count) {
    const std::size_t i = thread_number();
    if (i < count) squared[i] = inverse_root(squared[i]);
}

}  // namespace voxspring::cuda
