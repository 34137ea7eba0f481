#include "backends/cpu/perturbed_kernel.h"

#include <bit>

#include "backends/physics/neighbours.h"

// These SIMD targets are left out: the compiler's types for their registers have no fixed size, and so cannot
// be members of class Lanes.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
// This file, up to HWY_ONCE, is compiled for every SIMD target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backends/cpu/perturbed_kernel.cpp"
#include <hwy/foreach_target.h>
// What is included from here on is compiled for every target.
#include "backends/cpu/simd/lanes-inl.h"

#ifndef VOXSPRING_PERTURBED_CONSTANTS
#define VOXSPRING_PERTURBED_CONSTANTS
namespace voxspring::perturbed {

/// Odd numbers without a pattern (from SplitMix64 and MurmurHash3).
constexpr std::uint32_t multiplier[] = {0xBF58476D, 0x94D049BB, 0x85EBCA6B, 0xC2B2AE35};
/// Makes the random numbers of one particle differ for different `which`.
constexpr std::uint32_t salt(std::uint64_t which) { return std::uint32_t(0x9E3779B9u * (which + 1)); }

}  // namespace voxspring::perturbed
#endif

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {
namespace {

using namespace perturbed;
using L = Lanes<double, Root::exact>;
using V = Lanes3<L>;
constexpr hn::ScalableTag<double> real_tag{};
constexpr hn::ScalableTag<std::uint64_t> bits_tag{};
using Bits = hn::Vec<hn::ScalableTag<std::uint64_t>>;

HWY_INLINE V absolute(V v) { return {L(hn::Abs(v.x.v)), L(hn::Abs(v.y.v)), L(hn::Abs(v.z.v))}; }

/// The product of the low 32 bits of `a` with `by`, whose high bits are then XORed into its low bits.
HWY_INLINE Bits mixed(Bits a, std::uint32_t by) {
#if HWY_TARGET == HWY_SCALAR
    const Bits product = hn::Set(bits_tag, (hn::GetLane(a) & 0xFFFFFFFFu) * by);
#else
    const hn::Repartition<std::uint32_t, hn::ScalableTag<std::uint64_t>> half_tag;
    const Bits product = hn::MulEven(hn::BitCast(half_tag, a), hn::Set(half_tag, by));
#endif
    return hn::Xor(product, hn::ShiftRight<29>(product));
}

/// The random numbers of the particles of a SIMD register in one step. Each is a hash of the step, the
/// element and `which`, so the order of the calls does not matter.
class Random {
public:
    HWY_INLINE Random(const RoundingBits& rounding, std::ptrdiff_t i) : rounding_(rounding) {
        const Bits element = hn::Add(hn::Set(bits_tag, std::uint64_t(i)), hn::Iota(bits_tag, 0));
        const Bits first = mixed(hn::Xor(element, hn::Set(bits_tag, rounding.key)), multiplier[0]);
        base_ = mixed(hn::Xor(first, hn::Set(bits_tag, rounding.key >> 32)), multiplier[1]);
    }
    HWY_INLINE Bits bits(std::uint64_t which) const {
        return mixed(mixed(hn::Xor(base_, hn::Set(bits_tag, salt(which))), multiplier[2]), multiplier[3]);
    }
    /// A random number in [-1, 1).
    HWY_INLINE L number(std::uint64_t which) const {
        const auto one_to_two = hn::Or(hn::And(bits(which), hn::Set(bits_tag, 0x000FFFFFFFFFFFFFu)),
                                       hn::Set(bits_tag, 0x3FF0000000000000u));
        return L(hn::Sub(hn::Add(hn::BitCast(real_tag, one_to_two), hn::BitCast(real_tag, one_to_two)),
                         hn::Set(real_tag, 3.0)));
    }
    HWY_INLINE V numbers(std::uint64_t which) const {
        return {number(which), number(which + 1), number(which + 2)};
    }
    HWY_INLINE V rounded(V v, std::uint64_t which) const {
        return {rounded(v.x, which), rounded(v.y, which + 1), rounded(v.z, which + 2)};
    }

private:
    /// Rounds `value` as rounding_ says. Zero stays zero.
    HWY_INLINE L rounded(L value, std::uint64_t which) const {
        const Bits random = bits(which);
        const Bits added =
            hn::Add(hn::And(random, hn::Set(bits_tag, rounding_.random)),
                    hn::And(hn::ShiftRight<32>(random), hn::Set(bits_tag, rounding_.also_random)));
        const Bits sum =
            hn::Add(hn::Add(hn::BitCast(bits_tag, value.v), added), hn::Set(bits_tag, rounding_.constant));
        const auto cut = hn::BitCast(real_tag, hn::And(sum, hn::Set(bits_tag, rounding_.kept)));
        return L(hn::IfThenElseZero(hn::Ne(value.v, hn::Zero(real_tag)), cut));
    }

    const RoundingBits& rounding_;
    Bits base_;
};

/// The forces on the particles of a SIMD register. The rounding error of `force` is in proportion to `size`.
struct Forces {
    V force, size;
};

template <Formulation formulation, bool perturbed>
HWY_INLINE Forces sum_forces(const Task& task, std::ptrdiff_t i, V here, Bits mask) {
    Forces sum{zero3<L>(), zero3<L>()};
    const L shortest_squared(task.shortest_squared);
    for (std::size_t p = 0; p < task.pull_count; ++p) {
        const Pull& pull = task.pulls[p];
        const std::ptrdiff_t neighbour = i + pull.stride;
        const V relative = here - load3<L>(task.at, neighbour);
        const V rest_offset = broadcast3<L>(pull.rest_offset);
        L stiffness(pull.stiffness);
        if (task.compliance != nullptr)
            stiffness = series_stiffness(L::load(task.compliance + i), L::load(task.compliance + neighbour));
        const L rest_length(pull.rest_length);
        V offset = relative;
        if constexpr (!on_positions(formulation)) offset = rest_offset + relative;
        const L density = [&]() HWY_ATTR {
            if constexpr (by_increments(formulation)) {
                return strain_density(relative, rest_offset, rest_length, L(pull.rest_deficit), stiffness,
                                      shortest_squared);
            } else {
                return force_density(offset, rest_length, stiffness, shortest_squared);
            }
        }();
        const V force = offset * density;
        const auto joined = hn::TestBit(mask, hn::Set(bits_tag, pull.bit));
        sum.force = select(joined, sum.force + force, sum.force);
        if constexpr (perturbed) {
            const V size =
                by_increments(formulation) ? absolute(force) : absolute(force) + absolute(offset) * stiffness;
            sum.size = select(joined, sum.size + size, sum.size);
        }
    }
    if (task.load[0] != nullptr) sum.force = sum.force + load3<L>(task.load, i);
    if (task.extra[0] != nullptr) {
        sum.force = sum.force + load3<L>(task.extra, i);
        if constexpr (perturbed) sum.size = sum.size + load3<L>(task.extra_size, i);
    }
    return sum;
}

/// Values of `which`: what a particle's random numbers are for. Each use has three numbers, for x, y and z.
enum : std::uint64_t {
    for_force = 0,
    for_product = 3,
    for_other = 6,
    for_change = 9,
    for_state = 12,
    for_difference = 15
};

template <Formulation formulation, bool perturbed>
HWY_INLINE void step_register(const Task& task, std::ptrdiff_t i) {
    const Bits mask = hn::LoadU(bits_tag, task.mask + i);
    const V here = load3<L>(task.at, i);
    const Forces forces = sum_forces<formulation, perturbed>(task, i, here, mask);
    const L inverse_mass = L::load(task.inverse_mass + i);
    V gravity = broadcast3<L>(task.gravity);
    const Random random(task.rounding, i);
    // Rounds a number that a backend stores. The compensated formulation keeps what rounding removes, so its
    // numbers are not rounded.
    const auto stored = [&](V v, std::uint64_t which) HWY_ATTR {
        if constexpr (perturbed && formulation != Formulation::compensated) {
            return random.rounded(v, which);
        } else {
            return v;
        }
    };
    if constexpr (perturbed) {
        // One random number per axis stands for the rounding of the force and of the acceleration that
        // contains it.
        const V noise = random.numbers(for_force);
        const V size = (forces.size + absolute(forces.force)) * inverse_mass + absolute(gravity);
        const L unit(task.rounding.unit + task.rounding.root_error);
        gravity = gravity + V{noise.x * size.x * unit, noise.y * size.y * unit, noise.z * size.z * unit};
    }
    const L time_step_squared(task.time_step_squared);
    const auto moving =
        hn::Eq(hn::And(mask, hn::Set(bits_tag, ACTIVE_BIT | PINNED_BIT)), hn::Set(bits_tag, ACTIVE_BIT));
    if constexpr (by_increments(formulation)) {
        const V before = load3<L>(task.increment, i);
        const V change = stored(
            increment_change(before, forces.force, inverse_mass, gravity, L(task.damping), time_step_squared),
            for_change);
        const V increment = stored(before + change, for_product);
        store3(select(moving, increment, before), task.increment, i);
        store3(select(moving, stored(here + increment, for_state), here), task.next, i);
    } else {
        const V previous = load3<L>(task.next, i);
        const V change = stored((forces.force * inverse_mass + gravity) * time_step_squared, for_change);
        const V carried = [&]() HWY_ATTR {
            if constexpr (formulation == Formulation::paper) {
                return stored(stored(here * L(task.doubled), for_product) -
                                  stored(previous * L(task.retained), for_other),
                              for_difference) +
                       change;
            } else {
                return here +
                       stored(stored((here - previous) * L(task.retained), for_product) + change, for_other);
            }
        }();
        store3(select(moving, stored(carried, for_state), here), task.next, i);
    }
}

template <Formulation formulation, bool perturbed>
HWY_FLATTEN void step_blocks(const Task& shared) {
    const Task task = shared;
    for (const std::ptrdiff_t* block = task.begin; block != task.end; ++block) {
        for (std::ptrdiff_t lane = 0; lane < block_size; lane += std::ptrdiff_t(L::count()))
            step_register<formulation, perturbed>(task, *block + lane);
    }
}

template <bool perturbed>
void step_formulation(const Task& task, Formulation formulation) {
    switch (formulation) {
        case Formulation::paper:
            return step_blocks<Formulation::paper, perturbed>(task);
        case Formulation::position:
            return step_blocks<Formulation::position, perturbed>(task);
        case Formulation::displacement:
            return step_blocks<Formulation::displacement, perturbed>(task);
        case Formulation::increment:
            return step_blocks<Formulation::increment, perturbed>(task);
        case Formulation::compensated:
            return step_blocks<Formulation::compensated, perturbed>(task);
    }
}

void step_on_target(const Task& task, Formulation formulation) {
    if (task.rounding.any()) {
        step_formulation<true>(task, formulation);
    } else {
        step_formulation<false>(task, formulation);
    }
}

}  // namespace
}  // namespace voxspring::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace voxspring::perturbed {
namespace {

HWY_EXPORT(step_on_target);

std::uint64_t mixed(std::uint64_t a, std::uint32_t by) {
    const std::uint64_t product = (a & 0xFFFFFFFFu) * by;
    return product ^ product >> 29;
}

std::uint64_t random_bits(const RoundingBits& bits, std::uint64_t element, std::uint64_t which) {
    const std::uint64_t base =
        mixed(mixed(element ^ bits.key, multiplier[0]) ^ bits.key >> 32, multiplier[1]);
    return mixed(mixed(base ^ salt(which), multiplier[2]), multiplier[3]);
}

}  // namespace

void step(const Task& task, Formulation formulation) {
    HWY_DYNAMIC_DISPATCH(step_on_target)(task, formulation);
}

double rounded(double value, const RoundingBits& bits, std::uint64_t element, std::uint64_t which) {
    if (value == 0) return value;
    const std::uint64_t random = random_bits(bits, element, which);
    const std::uint64_t sum = std::bit_cast<std::uint64_t>(value) + (random & bits.random) +
                              (random >> 32 & bits.also_random) + bits.constant;
    return std::bit_cast<double>(sum & bits.kept);
}

double random_number(const RoundingBits& bits, std::uint64_t element, std::uint64_t which) {
    const std::uint64_t random = random_bits(bits, element, which);
    return 2 * std::bit_cast<double>((random & 0x000FFFFFFFFFFFFFu) | 0x3FF0000000000000u) - 3;
}

}  // namespace voxspring::perturbed
#endif
