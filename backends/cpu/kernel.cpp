#include "backends/cpu/kernel.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "backends/physics/neighbours.h"

// These SIMD targets are left out: the compiler's types for their registers have no fixed size, and so cannot
// be members of class Lanes.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
// This file, up to HWY_ONCE, is compiled for every SIMD target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "backends/cpu/kernel.cpp"
#include <hwy/foreach_target.h>
// What is included from here on is compiled for every target.
#include <hwy/cache_control.h>

#include "backends/cpu/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace voxspring::HWY_NAMESPACE {
namespace {

using namespace cpu_parallel;

/// Where the particles in one SIMD register are: their positions or displacements and, in the compensated
/// formulation, the low parts of these.
template <Formulation formulation, class L>
struct Place {
    Lanes3<L> high;
};
template <class L>
struct Place<Formulation::compensated, L> {
    Lanes3<L> high, low;
};

template <Formulation formulation, class L>
HWY_INLINE Place<formulation, L> place(const Task<typename L::T>& task, std::ptrdiff_t i) {
    if constexpr (formulation == Formulation::compensated) {
        return {load3<L>(task.at, i), load3<L>(task.at_low, i)};
    } else {
        return {load3<L>(task.at, i)};
    }
}

/// The springs between the particles i of a SIMD register and their neighbours j in one direction.
template <Formulation formulation, class L>
struct Springs {
    Lanes3<L> relative;     ///< x_i - x_j or u_i - u_j
    Lanes3<L> rest_offset;  ///< X_i - X_j

    HWY_INLINE Springs(const Place<formulation, L>& i, const Place<formulation, L>& j, Lanes3<L> rest)
        : relative(i.high - j.high), rest_offset(rest) {
        if constexpr (formulation == Formulation::compensated) relative = relative + (i.low - j.low);
    }
    HWY_INLINE Lanes3<L> offset() const {
        if constexpr (on_positions(formulation)) {
            return relative;
        } else {
            return rest_offset + relative;
        }
    }
    /// The force densities of the springs. Both ends of a spring compute the same bits.
    HWY_INLINE L density(const Opposites<typename L::T>& pair, L stiffness, L shortest_squared) const {
        const L rest_length(pair.rest_length);
        if constexpr (by_increments(formulation)) {
            return strain_density(relative, rest_offset, rest_length, L(pair.rest_deficit), stiffness,
                                  shortest_squared);
        } else {
            return force_density(offset(), rest_length, stiffness, shortest_squared);
        }
    }
};

/// Stiffness of the springs between the registers that begin at elements `i` and `neighbour`.
template <class L, class T>
HWY_INLINE L stiffness(const Task<T>& task, const Opposites<T>& pair, std::ptrdiff_t i,
                       std::ptrdiff_t neighbour) {
    if (task.compliance == nullptr) return L(pair.stiffness);
    return series_stiffness(L::load(task.compliance + i), L::load(task.compliance + neighbour));
}

/// Stores the force densities of the springs from the particles of a SIMD register to their higher
/// neighbours. Leaves out a direction in which all these neighbours lie before element `least`.
template <Formulation formulation, class L, class T>
HWY_INLINE void leave_densities(const Task<T>& task, const Block& block, std::ptrdiff_t lane,
                                std::ptrdiff_t least) {
    const std::ptrdiff_t i = block.first + lane;
    const auto here = place<formulation, L>(task, i);
    for (std::size_t p = 0; p < task.opposites_count; ++p) {
        const Opposites<T>& pair = task.opposites[block.odd_slice][p];
        const std::ptrdiff_t higher = i + pair.stride;
        if (pair.higher_density == nullptr || higher + std::ptrdiff_t(L::count()) <= least) continue;
        const Springs<formulation, L> springs(here, place<formulation, L>(task, higher),
                                              broadcast3<L>(pair.rest_offset));
        springs.density(pair, stiffness<L>(task, pair, i, higher), L(task.shortest_squared))
            .store(pair.higher_density + block.in_slice + lane);
    }
}

/// The spring forces on the particles of a SIMD register. With `full_stencil` (Block::full_stencil) no spring
/// is masked.
template <Formulation formulation, bool full_stencil, class L, class T, class Mask>
HWY_INLINE Lanes3<L> sum_forces(const Task<T>& task, const Block& block, std::ptrdiff_t lane, Mask mask,
                                const Place<formulation, L>& here) {
    const std::ptrdiff_t i = block.first + lane;
    const L shortest_squared(task.shortest_squared);
    Lanes3<L> force = zero3<L>();
    const auto add = [&](MaskOf<T> bit, Lanes3<L> f) HWY_ATTR {
        force = full_stencil ? force + f
                             : select(hn::TestBit(mask, hn::Set(MaskTag<L>(), bit)), force + f, force);
    };
    for (std::size_t p = 0; p < task.opposites_count; ++p) {
        const Opposites<T>& pair = task.opposites[block.odd_slice][p];
        const std::ptrdiff_t lower = i - pair.stride;
        const std::ptrdiff_t higher = i + pair.stride;
        const Lanes3<L> rest_offset = broadcast3<L>(pair.rest_offset);
        const Springs<formulation, L> to_lower(here, place<formulation, L>(task, lower), -rest_offset);
        const Springs<formulation, L> to_higher(here, place<formulation, L>(task, higher), rest_offset);
        const L higher_density =
            to_higher.density(pair, stiffness<L>(task, pair, i, higher), shortest_squared);
        if (pair.higher_density == nullptr) {
            const L lower_density =
                to_lower.density(pair, stiffness<L>(task, pair, i, lower), shortest_squared);
            add(pair.lower_bit, to_lower.offset() * lower_density);
        } else {
            higher_density.store(pair.higher_density + block.in_slice + lane);
            add(pair.lower_bit, to_lower.offset() * L::load(pair.lower_density + block.in_slice + lane));
        }
        add(pair.higher_bit, to_higher.offset() * higher_density);
    }
    return force;
}

/// `v` with 0 for each component that is closer to 0 than `flush`.
template <class L>
HWY_INLINE Lanes3<L> flushed(Lanes3<L> v, L flush) {
    const auto far = [&](L a) HWY_ATTR { return L(hn::IfThenZeroElse(hn::Lt(hn::Abs(a.v), flush.v), a.v)); };
    return {far(v.x), far(v.y), far(v.z)};
}
/// `low` with 0 for each component whose `high` is 0.
template <class L>
HWY_INLINE Lanes3<L> low_of(Lanes3<L> high, Lanes3<L> low) {
    const auto kept = [](L h, L l) HWY_ATTR {
        return L(hn::IfThenElseZero(hn::Ne(h.v, hn::Zero(typename L::Tag())), l.v));
    };
    return {kept(high.x, low.x), kept(high.y, low.y), kept(high.z, low.z)};
}

/// The bits in which a and b differ in any of x, y and z; 0 in lanes where they are equal.
template <class L>
HWY_INLINE auto difference(Lanes3<L> a, Lanes3<L> b) {
    const MaskTag<L> tag;
    const auto bits = [&](L p, L q) HWY_ATTR { return hn::BitCast(tag, hn::Xor(p.v, q.v)); };
    return hn::Or(hn::Or(bits(a.x, b.x), bits(a.y, b.y)), bits(a.z, b.z));
}

/// `moved` in lanes whose particle can move, otherwise `held`. With `full_stencil` (Block::full_stencil) all
/// particles can move.
template <bool full_stencil, class L, class Chosen>
HWY_INLINE Lanes3<L> where_moving(Chosen moving, Lanes3<L> moved, Lanes3<L> held) {
    if constexpr (full_stencil) {
        return moved;
    } else {
        return select(moving, moved, held);
    }
}

/// How a step changed the particles of a SIMD register.
template <class L>
struct Motion {
    hn::Vec<MaskTag<L>> changes;  ///< all bits of the state that changed
    Lanes3<L> increment;          ///< how far they moved
};

/// What acts on the particles of a SIMD register.
template <class L>
struct Action {
    Lanes3<L> force, gravity;
    L inverse_mass, time_step_squared;
};

/// The step of the formulations by increments.
template <Formulation formulation, bool full_stencil, class L, class T, class Chosen>
HWY_INLINE Motion<L> integrate_increment(const Task<T>& task, std::ptrdiff_t i, Chosen moving,
                                         const Place<formulation, L>& here, const Action<L>& action) {
    const Lanes3<L> before = load3<L>(task.increment, i);
    const Lanes3<L> change = increment_change(before, action.force, action.inverse_mass, action.gravity,
                                              L(task.damping), action.time_step_squared);
    Lanes3<L> increment = before + change;
    Lanes3<L> increment_low = zero3<L>();
    Lanes3<L> next = here.high + increment;
    Lanes3<L> next_low = zero3<L>();
    if constexpr (formulation == Formulation::compensated) {
        const Lanes3<L> before_low = load3<L>(task.increment_low, i);
        increment = split_high(before, before_low, change, zero3<L>());
        increment_low = split_low(before, before_low, change, zero3<L>());
        next = split_high(here.high, here.low, increment, increment_low);
        next_low = split_low(here.high, here.low, increment, increment_low);
    }
    if (task.flush > 0) {
        increment = flushed(increment, L(task.flush));
        next = flushed(next, L(task.flush));
        increment_low = low_of(increment, increment_low);
        next_low = low_of(next, next_low);
    }
    increment = where_moving<full_stencil>(moving, increment, zero3<L>());
    next = where_moving<full_stencil>(moving, next, here.high);
    auto changes = hn::Or(difference(increment, before), difference(next, here.high));
    if constexpr (formulation == Formulation::compensated) {
        increment_low = where_moving<full_stencil>(moving, increment_low, zero3<L>());
        next_low = where_moving<full_stencil>(moving, next_low, here.low);
        changes = hn::Or(changes, difference(increment_low, load3<L>(task.increment_low, i)));
        changes = hn::Or(changes, difference(next_low, here.low));
        store3(increment_low, task.increment_low, i);
        store3(next_low, task.next_low, i);
    }
    store3(increment, task.increment, i);
    store3(next, task.next, i);
    return {changes, increment};
}

/// The step of the formulations that keep two positions or two displacements.
template <Formulation formulation, bool full_stencil, class L, class T, class Chosen>
HWY_INLINE Motion<L> integrate_place(const Task<T>& task, std::ptrdiff_t i, Chosen moving,
                                     const Place<formulation, L>& here, const Action<L>& action) {
    const Lanes3<L> previous = load3<L>(task.next, i);
    Lanes3<L> next = here.high;
    if constexpr (formulation == Formulation::paper) {
        next = paper_position(here.high, previous, action.force, action.inverse_mass, action.gravity,
                              L(task.doubled), L(task.retained), action.time_step_squared);
    } else {
        next = next_position(here.high, previous, action.force, action.inverse_mass, action.gravity,
                             L(task.retained), action.time_step_squared);
    }
    next = where_moving<full_stencil>(moving, next, here.high);
    store3(next, task.next, i);
    return {hn::Or(difference(next, here.high), difference(here.high, previous)), next - here.high};
}

/// Whether the particles of a SIMD register keep their tile active. If task.slow is 0: whether a bit of their
/// state changed. Otherwise: whether one of them moved by at least task.slow.
template <class L, class T, class Mask>
HWY_INLINE bool is_active(const Task<T>& task, Mask mask, const Motion<L>& motion) {
    const MaskTag<L> tag;
    if (!(task.slow > 0)) return !hn::AllTrue(tag, hn::Eq(motion.changes, hn::Zero(tag)));
    const auto empty = hn::Eq(hn::And(mask, hn::Set(tag, ACTIVE_BIT)), hn::Zero(tag));
    const auto slow =
        hn::Lt(dot(motion.increment, motion.increment).v, hn::Set(typename L::Tag(), task.slow * task.slow));
    return !hn::AllTrue(tag, hn::Or(hn::RebindMask(tag, slow), empty));
}

/// Steps the particles of a SIMD register.
template <Formulation formulation, bool full_stencil, class L, class T>
HWY_INLINE void step_particles(const Task<T>& task, const Block& block, std::ptrdiff_t lane) {
    const std::ptrdiff_t i = block.first + lane;
    const MaskTag<L> tag;
    const auto mask = hn::LoadU(tag, task.mask + i);
    const auto here = place<formulation, L>(task, i);
    Lanes3<L> force = sum_forces<formulation, full_stencil, L>(task, block, lane, mask, here);
    if (task.load[0] != nullptr) force = force + load3<L>(task.load, i);
    const L inverse_mass =
        task.inverse_mass != nullptr ? L::load(task.inverse_mass + i) : L(task.uniform_inverse_mass);
    // Gravity and damping of 0 are computed rather than skipped. This takes six of some three hundred
    // instructions, and no cost could be measured.
    const Action<L> action{force, broadcast3<L>(task.gravity), inverse_mass, L(task.time_step_squared)};
    const auto moving =
        hn::Eq(hn::And(mask, hn::Set(tag, ACTIVE_BIT | PINNED_BIT)), hn::Set(tag, ACTIVE_BIT));
    const Motion<L> motion = [&]() HWY_ATTR {
        if constexpr (by_increments(formulation)) {
            return integrate_increment<formulation, full_stencil>(task, i, moving, here, action);
        } else {
            return integrate_place<formulation, full_stencil>(task, i, moving, here, action);
        }
    }();
    if (task.action != nullptr) task.active_tile[block.tile] |= std::uint8_t(is_active(task, mask, motion));
}

/// Stops the particles of a SIMD register where they are.
template <Formulation formulation, class L, class T>
HWY_INLINE void fall_asleep(const Task<T>& task, const Block& block, std::ptrdiff_t lane) {
    const std::ptrdiff_t i = block.first + lane;
    const auto here = place<formulation, L>(task, i);
    store3(here.high, task.next, i);
    if constexpr (by_increments(formulation)) store3(zero3<L>(), task.increment, i);
    if constexpr (formulation == Formulation::compensated) {
        store3(here.low, task.next_low, i);
        store3(zero3<L>(), task.increment_low, i);
    }
}

/// Prefetches data that no earlier block has touched: the neighbours farthest ahead of the block, and the
/// data that the block overwrites. The processor's own prefetchers lose track of this many streams. Without
/// this function one core of an AMD EPYC took 1.37 times as long for a step of the box of 128^3.
template <Formulation formulation, class T>
HWY_INLINE void prefetch(const Task<T>& task, const Block& block) {
    const auto fetch = [&](const auto& from, std::ptrdiff_t i) HWY_ATTR {
        for (const auto* const part : from) hwy::Prefetch(part + i);
    };
    fetch(task.at, block.first + task.farthest);
    fetch(task.next, block.first);
    if (!block.full_stencil) hwy::Prefetch(task.mask + block.first);
    if constexpr (by_increments(formulation)) fetch(task.increment, block.first);
    if constexpr (formulation == Formulation::compensated) {
        fetch(task.at_low, block.first + task.farthest);
        fetch(task.next_low, block.first);
        fetch(task.increment_low, block.first);
    }
}

template <Formulation formulation, class L, class T>
HWY_FLATTEN void run_task(const Task<T>& shared) {
    // A local copy that nothing points to. The compiler sees that a store to the state cannot change it, and
    // keeps it in registers.
    const Task<T> task = shared;
    // How many blocks ahead of its use data is prefetched: enough to hide the latency of memory. Steps take
    // equally long with 2 to 8. With 24, prefetched data evicted data from the first-level cache that earlier
    // blocks still had to read.
    constexpr std::ptrdiff_t ahead = 8;
    constexpr std::ptrdiff_t size = block_size<T>, count = std::ptrdiff_t(L::count());
    // Calls run(lane) for each register of a block, except those that Block::active_quarters shows to be
    // without a particle.
    const auto each_register = [](const Block& block, auto run) HWY_ATTR {
        constexpr unsigned quarters = (1U << std::max<std::ptrdiff_t>(count * 4 / size, 1)) - 1;
        for (std::ptrdiff_t lane = 0; lane < size; lane += count) {
            if (count == size || (block.active_quarters >> (lane * 4 / size) & quarters) != 0) run(lane);
        }
    };
    for (const Block* block = task.lead; block != task.begin; ++block) {
        if (task.action != nullptr && task.action[block->tile] == 0) continue;
        each_register(*block, [&](std::ptrdiff_t lane) HWY_ATTR {
            leave_densities<formulation, L>(task, *block, lane, task.begin->first);
        });
    }
    for (const Block* block = task.begin; block != task.end; ++block) {
        const std::uint8_t action =
            task.action != nullptr ? task.action[block->tile] : std::uint8_t(tile_steps);
        if ((action & tile_steps) != 0) {
            if (task.end - block > ahead) prefetch<formulation>(task, block[ahead]);
            if (block->full_stencil) {
                for (std::ptrdiff_t lane = 0; lane < size; lane += count)
                    step_particles<formulation, true, L>(task, *block, lane);
            } else {
                each_register(*block, [&](std::ptrdiff_t lane) HWY_ATTR {
                    step_particles<formulation, false, L>(task, *block, lane);
                });
            }
            continue;
        }
        if ((action & tile_falls_asleep) != 0) {
            each_register(*block, [&](std::ptrdiff_t lane)
                                      HWY_ATTR { fall_asleep<formulation, L>(task, *block, lane); });
        }
        if ((action & tile_leaves_densities) != 0) {
            each_register(*block, [&](std::ptrdiff_t lane)
                                      HWY_ATTR { leave_densities<formulation, L>(task, *block, lane, 0); });
        }
    }
}

template <class L, class T>
void run_formulation(const Task<T>& task, Formulation formulation) {
    switch (formulation) {
        case Formulation::paper:
            return run_task<Formulation::paper, L>(task);
        case Formulation::position:
            return run_task<Formulation::position, L>(task);
        case Formulation::displacement:
            return run_task<Formulation::displacement, L>(task);
        case Formulation::increment:
            return run_task<Formulation::increment, L>(task);
        case Formulation::compensated:
            return run_task<Formulation::compensated, L>(task);
    }
}

void step_float32(const Task<float>& task, Formulation formulation, Root root) {
    switch (root) {
        case Root::exact:
            return run_formulation<Lanes<float, Root::exact>>(task, formulation);
        case Root::refined:
            return run_formulation<Lanes<float, Root::refined>>(task, formulation);
        case Root::raw:
            return run_formulation<Lanes<float, Root::raw>>(task, formulation);
    }
}
void step_float64(const Task<double>& task, Formulation formulation) {
    run_formulation<Lanes<double, Root::exact>>(task, formulation);
}

template <class T>
HWY_FLATTEN bool all_within(const Task<T>& task, Formulation formulation, T largest_increment) {
    using L = Lanes<T, Root::exact>;
    const typename L::Tag tag;
    const MaskTag<L> mask_tag;
    const auto largest_squared = hn::Set(tag, largest_increment * largest_increment);
    for (const Block* block = task.begin; block != task.end; ++block) {
        for (std::ptrdiff_t lane = 0; lane < block_size<T>; lane += std::ptrdiff_t(L::count())) {
            const std::ptrdiff_t i = block->first + lane;
            const Lanes3<L> at = load3<L>(task.at, i);
            const Lanes3<L> moved =
                by_increments(formulation) ? load3<L>(task.increment, i) : at - load3<L>(task.next, i);
            // Zero, or NaN where a component is not finite.
            const Lanes3<L> none = at - at;
            const auto good = hn::And(hn::Le(dot(moved, moved).v, largest_squared),
                                      hn::Eq((none.x + none.y + none.z).v, hn::Zero(tag)));
            const auto active = hn::And(hn::LoadU(mask_tag, task.mask + i), hn::Set(mask_tag, ACTIVE_BIT));
            const auto empty = hn::Eq(active, hn::Zero(mask_tag));
            if (!hn::AllTrue(mask_tag, hn::Or(hn::RebindMask(mask_tag, good), empty))) return false;
        }
    }
    return true;
}
bool within_float32(const Task<float>& task, Formulation formulation, float largest_increment) {
    return all_within(task, formulation, largest_increment);
}
bool within_float64(const Task<double>& task, Formulation formulation, double largest_increment) {
    return all_within(task, formulation, largest_increment);
}

/// The largest relative error of 1 / sqrt(1 + n / 4096), for all n from 0 to 3 * 4096 - 1, with the root and
/// the division that steps use.
template <Root root>
double largest_root_error() {
    using L = Lanes<float, root>;
    double largest = 0;
    for (int n = 0; n < 3 * 4096; ++n) {
        const float value = 1 + float(n) / 4096;
        std::array<float, L::count()> inverse{};
        (L(1.0F) / sqrt(L(value))).store(inverse.data());
        largest = std::max(largest, std::abs(double(inverse[0]) * std::sqrt(double(value)) - 1));
    }
    return largest;
}

double measured_error(Root root) {
    switch (root) {
        case Root::exact:
            return largest_root_error<Root::exact>();
        case Root::refined:
            return largest_root_error<Root::refined>();
        case Root::raw:
            return largest_root_error<Root::raw>();
    }
    return 0;
}

double error_of_approximation() { return approximation_error; }

const char* name_of_target() { return hwy::TargetName(HWY_TARGET); }

}  // namespace
}  // namespace voxspring::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace voxspring {
namespace {

HWY_EXPORT(step_float32);
HWY_EXPORT(step_float64);
HWY_EXPORT(within_float32);
HWY_EXPORT(within_float64);
HWY_EXPORT(measured_error);
HWY_EXPORT(error_of_approximation);
HWY_EXPORT(name_of_target);

}  // namespace

namespace cpu_parallel {

void step(const Task<float>& task, Formulation formulation, Root root) {
    HWY_DYNAMIC_DISPATCH(step_float32)(task, formulation, root);
}
void step(const Task<double>& task, Formulation formulation, Root) {
    HWY_DYNAMIC_DISPATCH(step_float64)(task, formulation);
}
bool within(const Task<float>& task, Formulation formulation, double largest_increment) {
    return HWY_DYNAMIC_DISPATCH(within_float32)(task, formulation, float(largest_increment));
}
bool within(const Task<double>& task, Formulation formulation, double largest_increment) {
    return HWY_DYNAMIC_DISPATCH(within_float64)(task, formulation, largest_increment);
}
double approximation_error() { return HWY_DYNAMIC_DISPATCH(error_of_approximation)(); }
double measured_root_error(Root root) { return HWY_DYNAMIC_DISPATCH(measured_error)(root); }
const char* target_name() { return HWY_DYNAMIC_DISPATCH(name_of_target)(); }

}  // namespace cpu_parallel
}  // namespace voxspring
#endif
