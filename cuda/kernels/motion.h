// The parts of a step that kernels share: the pull of one spring, and the integrators. Kernels that evaluate
// springs by class (march.h) have their own.
#pragma once

#include "backends/layout/records/motion.h"
#include "backends/layout/records/springs.h"
#include "backends/physics/inverse_root.h"
#include "backends/physics/neighbours.h"
#include "backends/physics/spring.h"
#include "cuda/kernels/terms.h"
#include "cuda/kernels/words.h"

namespace voxspring::cuda {

/// The place of a particle as its neighbours see it: a position or a displacement.
template <class Real, bool split>
struct Point {
    Vector<Real> high;
};
template <class Real>
struct Point<Real, true> {
    Vector<Real> high, low;
};

template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> operator-(const Point<Real, false>& a, const Point<Real, false>& b) {
    return a.high - b.high;
}
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> operator-(const Point<Real, true>& a, const Point<Real, true>& b) {
    return (a.high - b.high) + (a.low - b.low);
}

/// A particle and its bits.
template <class Real, bool split>
struct Self {
    Point<Real, split> point;
    std::uint32_t bits;
};

/// Reads particles by a `Fetch`, one of the types of fetch.h.
template <class Real, bool split, class Fetch>
struct Reader {
    const Fetch& high;
    const Fetch& low;  ///< read only if split

    VOXSPRING_HOST_DEVICE Point<Real, split> point(int index, int dx) const {
        if constexpr (split) {
            return {high.at(index, dx).position, low.at(index, dx).position};
        } else {
            return {high.at(index, dx).position};
        }
    }
    VOXSPRING_HOST_DEVICE Self<Real, split> self(int index) const {
        const Particle<Real> word = high.at(index, 0);
        if constexpr (split) {
            return {{word.position, low.at(index, 0).position}, word.bits};
        } else {
            return {{word.position}, word.bits};
        }
    }
    template <class T>
    VOXSPRING_HOST_DEVICE T entry(const T* p) const {
        return high.entry(p);
    }
};

/// The spring force on particle i is `offset` times `density`, at stiffness 1 unless `density` has been
/// multiplied by the stiffness.
template <class Real>
struct Pull {
    Vector<Real> offset;
    Real density;
};

/// l^2 - |d|^2 without cancellation (strain_density() of spring.h). d = `offset` = `relative` - rest.offset.
template <class Real>
VOXSPRING_HOST_DEVICE Real strain_deficit(Vector<Real> relative, Vector<Real> offset,
                                          const SpringRest<Real>& rest) {
    const Vector<Real> sum = offset - rest.offset;
    return std::fma(-relative.x, sum.x,
                    std::fma(-relative.y, sum.y, std::fma(-relative.z, sum.z, rest.deficit)));
}

/// The pull on particle i of its spring to j. `relative`: x_i - x_j or u_i - u_j. `rest_length`: the result
/// of measured_length() or, by increments, the rest length itself.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE Pull<Real> unit_pull(Vector<Real> relative, const SpringRest<Real>& rest,
                                           Real rest_length, Real shortest_squared) {
    // The rest offset is subtracted, not added with the opposite sign: the compiler can leave out the
    // subtraction of a zero, but not the addition of one, which turns -0 into 0.
    const Vector<Real> offset = Terms::positions ? relative : relative - rest.offset;
    const Real squared = squared_length(offset.x, offset.y, offset.z, shortest_squared);
    if constexpr (Terms::increments) {
        return {offset, unit_strain_density(squared, rest_length, strain_deficit(relative, offset, rest))};
    } else {
        return {offset, unit_force_density(squared, rest_length, inverse_root(squared))};
    }
}

/// The part of a particle's state that a step overwrites: x or u at t - dt, or v.
template <class Real>
struct PreviousOrVelocity {
    Vector<Real> high, low;
};

template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> load_axes(const Real* from, std::size_t pitch) {
    return {from[0], from[pitch], from[2 * pitch]};
}
template <class Real>
VOXSPRING_HOST_DEVICE void store_axes(Real* to, std::size_t pitch, Vector<Real> v) {
    to[0] = v.x;
    to[pitch] = v.y;
    to[2 * pitch] = v.z;
}

template <class Terms, class Real>
VOXSPRING_HOST_DEVICE PreviousOrVelocity<Real> load_before(const Output<Real>& output, int index) {
    if constexpr (Terms::split) {
        return {load_axes(output.increment + index, output.pitch),
                load_axes(output.increment_low + index, output.pitch)};
    } else if constexpr (Terms::increments) {
        return {load_axes(output.increment + index, output.pitch), {}};
    } else {
        return {load_past_l1(output.next + index).position, {}};
    }
}

/// `v`, with each component set to zero whose magnitude is less than `below`.
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> flushed(Vector<Real> v, Real below) {
    const auto far = [below](Real a) { return a < below && a > -below ? Real(0) : a; };
    return {far(v.x), far(v.y), far(v.z)};
}
/// `low`, with each component set to zero whose component in `high` is zero.
template <class Real>
VOXSPRING_HOST_DEVICE Vector<Real> low_of(Vector<Real> high, Vector<Real> low) {
    const auto kept = [](Real h, Real l) { return h != 0 ? l : Real(0); };
    return {kept(high.x, low.x), kept(high.y, low.y), kept(high.z, low.z)};
}

/// The state of one particle after a step.
template <class Real, bool split>
struct Integrated {
    Point<Real, split> point;
    PreviousOrVelocity<Real> before;  ///< what the next step overwrites
};

/// The particle of word `index` after one step under `force`. A pinned particle stays where it is.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE Integrated<Real, Terms::split> integrate(const Motion<Real>& motion, int index,
                                                               const Self<Real, Terms::split>& self,
                                                               const PreviousOrVelocity<Real>& before,
                                                               Vector<Real> force) {
    const bool pinned = Terms::template has<term_pins>(true) && (self.bits & PINNED_BIT) != 0;
    if (Terms::template has<term_loads>(motion.load != nullptr)) force = force + motion.load[index];
    const Real inverse_mass = Terms::template has<term_materials>(motion.inverse_masses != nullptr)
                                  ? motion.inverse_masses[index]
                                  : motion.inverse_mass;
    // If the scene lacks a term, the term's operand is a constant that changes no bit and is folded away.
    // Only `paper` keeps its operands for damping.
    const Real zero = -Real(0);
    const Vector<Real> gravity =
        Terms::compiled(term_gravity) ? motion.gravity : Vector<Real>{zero, zero, zero};
    const Real retained = Terms::compiled(term_damping) ? motion.retained : Real(1);
    const Real squared = motion.time_step_squared;
    const Vector<Real> at = self.point.high;
    if constexpr (Terms::increments) {
        Vector<Real> change;
        if constexpr (Terms::compiled(term_damping)) {
            change = increment_change(before.high, force, inverse_mass, gravity, motion.damping, squared);
        } else {
            change = increment_change(Vector<Real>{0, 0, 0}, force, inverse_mass, gravity, Real(0), squared);
        }
        if constexpr (Terms::split) {
            const Vector<Real> none{0, 0, 0};
            Vector<Real> v = split_high(before.high, before.low, change, none);
            Vector<Real> v_low = split_low(before.high, before.low, change, none);
            if (pinned) v = v_low = none;
            Vector<Real> u = split_high(at, self.point.low, v, v_low);
            Vector<Real> u_low = split_low(at, self.point.low, v, v_low);
            if constexpr (Terms::compiled(term_flush)) {
                v = flushed(v, motion.flushed_below);
                u = flushed(u, motion.flushed_below);
                v_low = low_of(v, v_low);
                u_low = low_of(u, u_low);
            }
            return {{pinned ? at : u, pinned ? self.point.low : u_low}, {v, v_low}};
        } else {
            Vector<Real> v = before.high + change;
            if (pinned) v = {0, 0, 0};
            Vector<Real> u = at + v;
            if constexpr (Terms::compiled(term_flush)) {
                v = flushed(v, motion.flushed_below);
                u = flushed(u, motion.flushed_below);
            }
            return {{pinned ? at : u}, {v, {}}};
        }
    } else {
        Vector<Real> next;
        if constexpr (Terms::formulation == Formulation::paper) {
            next = paper_position(at, before.high, force, inverse_mass, gravity, motion.doubled,
                                  motion.retained, squared);
        } else {
            next = next_position(at, before.high, force, inverse_mass, gravity, retained, squared);
        }
        return {{pinned ? at : next}, {at, {}}};
    }
}

/// Moves the particle of word `index` by one step under `force`, and returns whether a bit of its state
/// changed. If `stores` is false, the particle stays where it is, and the result is whether the step would
/// change a bit.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE bool integrate_and_store(const Motion<Real>& motion, const Output<Real>& output,
                                               int index, const Self<Real, Terms::split>& self,
                                               const PreviousOrVelocity<Real>& before, Vector<Real> force,
                                               bool stores = true) {
    const Integrated<Real, Terms::split> next = integrate<Terms>(motion, index, self, before, force);
    if (stores) {
        if constexpr (Terms::increments) store_axes(output.increment + index, output.pitch, next.before.high);
        store(output.next + index, Particle<Real>{next.point.high, self.bits});
        if constexpr (Terms::split) {
            store_axes(output.increment_low + index, output.pitch, next.before.low);
            store(output.next_low + index, Particle<Real>{next.point.low, 0});
        }
    }
    bool same = same_bits(next.before.high, before.high) && same_bits(next.point.high, self.point.high);
    if constexpr (Terms::split)
        same = same && same_bits(next.before.low, before.low) && same_bits(next.point.low, self.point.low);
    return !same;
}

}  // namespace voxspring::cuda
