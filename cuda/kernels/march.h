// A march along z through a lattice in structure of arrays: every thread owns MarchShape::rows x 2 columns of
// particles and steps them plane by plane. It reads windows, each of which holds one plane of a tile with a
// frame around it. This is the body of the kernel. A device fills the windows with its copy engine or by its
// threads' asynchronous copies, a test with a loop.
#pragma once

#include <type_traits>

#include "backends/layout/records/march.h"
#include "cuda/kernels/motion.h"

namespace voxspring::cuda {

/// One component of each of two neighbours along x, which one access loads or stores.
template <class Real>
struct alignas(2 * sizeof(Real)) Pair {
    Real a, b;
};

/// The particles of a thread in one plane, or the sums of their forces.
template <class Real, int rows>
struct Own {
    Vector<Real> at[rows][2];

    VOXSPRING_HOST_DEVICE void clear() {
        UNROLLED
        for (int r = 0; r < rows; ++r) at[r][0] = at[r][1] = {0, 0, 0};
    }
    /// Loads the particles from a window. `from` points at x of the thread's first particle there.
    VOXSPRING_HOST_DEVICE void load(const Real* from, int pitch, int axis) {
        UNROLLED
        for (int r = 0; r < rows; ++r) load_pair(from + r * pitch, axis, at[r][0], at[r][1]);
    }
    static VOXSPRING_HOST_DEVICE void load_pair(const Real* from, int axis, Vector<Real>& a,
                                                Vector<Real>& b) {
        const auto x = *reinterpret_cast<const Pair<Real>*>(from);
        const auto y = *reinterpret_cast<const Pair<Real>*>(from + axis);
        const auto z = *reinterpret_cast<const Pair<Real>*>(from + 2 * axis);
        a = {x.a, y.a, z.a};
        b = {x.b, y.b, z.b};
    }
};

/// Whether sums of springs across the lattice's first and last column are predicated. If not, their densities
/// have factors of 0 or 1, which takes a multiplication each. In float64 the compiler turns predicates into
/// selections. In tiles of two warps along x, which have fewer registers, a step took longer with predicates.
template <class Real, MarchShape shape>
inline constexpr bool predicates_sides = sizeof(Real) == sizeof(float) && shape.wide == 1;

/// Whether the lattice goes on to the left and right of a thread's particles: 0 or 1.
template <class Real, MarchShape shape>
struct Sides {
    using Side = std::conditional_t<predicates_sides<Real, shape>, std::uint32_t, Real>;
    Side left, right;
};

/// Whether springs of class k are among the groups in use.
template <class Terms>
VOXSPRING_HOST_DEVICE constexpr bool has_class(int k) {
    return (Terms::groups & bits_of_class(k)) != 0;
}

/// The pull on particle i of its spring to neighbour j, (dx, dy, dz) voxels away on a lattice with `spacing`.
/// The spring is of class k (records/march.h): along an axis, or in the plane of two axes. `relative`:
/// x_i - x_j, or u_i - u_j if the state consists of displacements.
template <class Terms, bool equal_edges, class Real>
VOXSPRING_HOST_DEVICE Pull<Real> class_pull(const MarchStep<Real>& step, const Vector<Real>& spacing,
                                            Vector<Real> relative, int k, int dx, int dy, int dz) {
    const SpringRest<Real> rest{
        {dx == 0 ? Real(0) : Real(dx) * spacing.x, dy == 0 ? Real(0) : Real(dy) * spacing.y,
         dz == 0 ? Real(0) : Real(dz) * spacing.z},
        step.deficit[k]};
    Pull<Real> spring;
    spring.offset = Terms::positions ? relative : relative - rest.offset;
    const Real squared =
        squared_length(spring.offset.x, spring.offset.y, spring.offset.z, step.shortest_squared);
    if constexpr (Terms::increments) {
        spring.density =
            lean_strain_density(squared, step.rest_length[k], strain_deficit(relative, spring.offset, rest));
    } else {
        // The force density of stiffness 1, (l - |d|) / |d|, divided by l: 1 / |d| - 1 / l. Here
        // `rest_length` is 1 / l, and `stiffness` has been multiplied by l. If `squared` has the bits from
        // which 1 / l was computed, the result is zero.
        spring.density = inverse_root(squared) - step.rest_length[k];
    }
    if (k < 3 || !equal_edges) spring.density = spring.density * step.stiffness[k];
    return spring;
}

/// Adds the force of a spring to `force` if the spring exists. Otherwise `force` stays as it is, even if the
/// spring's force is not finite.
template <class Real>
VOXSPRING_HOST_DEVICE void add_where(Vector<Real> offset, Real density, bool is_there, Vector<Real>& force) {
    const Vector<Real> sum = fused(offset, density, force);
    if (is_there) force = sum;
}
/// add_where(), in float32 by predicated instructions. If several sums share one condition, the compiler
/// would add a selection to each of them; predicates need no instruction beyond the sum. `there` is nonzero
/// if the spring exists. Pass a masked bit, which one instruction tests; a bit shifted into a bool would take
/// three.
template <class Real>
VOXSPRING_HOST_DEVICE void add_predicated(Vector<Real> offset, Real density, std::uint32_t there,
                                          Vector<Real>& force) {
#ifdef __CUDA_ARCH__
    if constexpr (sizeof(Real) == sizeof(float)) {
        asm("{\n"
            " .reg .pred there;\n"
            " setp.ne.u32 there, %7, 0;\n"
            " @there fma.rn.f32 %0, %3, %6, %0;\n"
            " @there fma.rn.f32 %1, %4, %6, %1;\n"
            " @there fma.rn.f32 %2, %5, %6, %2;\n"
            "}"
            : "+f"(force.x), "+f"(force.y), "+f"(force.z)
            : "f"(offset.x), "f"(offset.y), "f"(offset.z), "f"(density), "r"(there));
        return;
    }
#endif
    add_where(offset, density, there != 0, force);
}

/// Which springs are evaluated when a plane arrives. `plane`: those within it; `between`: those to the plane
/// before; `both`: both kinds.
enum class PlaneSpringsOf { plane, both, between };

/// Evaluates springs when a plane arrives, and adds their forces to those on the thread's particles in that
/// plane and in the one before. `masked`: only springs whose bits are set count; the forces of others are
/// dropped by selection.
template <class Terms, MarchShape shape, bool masked, bool equal_edges, PlaneSpringsOf which, class Real>
class PlaneSprings {
public:
    using Particles = Own<Real, shape.rows>;

    /// `window` and `window_before` point at the thread's first particle in the windows of the two planes.
    VOXSPRING_HOST_DEVICE PlaneSprings(const MarchStep<Real>& step, const Sides<Real, shape>& sides,
                                       std::uint64_t word, const Real* window, const Real* window_before,
                                       const Particles& now, const Particles& before, Particles& force,
                                       Particles& force_before)
        : step_(step),
          sides_(sides),
          word_(word),
          windows_{window_before, window},
          own_{&before, &now},
          force_{&force_before, &force} {}

    VOXSPRING_HOST_DEVICE void both(int bit, int z, int r, int c, int z2, int r2, int c2) {
        const int k = spring_class(c2 - c, r2 - r, z2 - z);
        if (!counts(z, z2) || !has_class<Terms>(k)) return;
        const Pull<Real> spring = pull(own_[z]->at[r][c] - own_[z2]->at[r2][c2], k, c2 - c, r2 - r, z2 - z);
        add(bit, spring.offset, spring.density, force_[z]->at[r][c]);
        add(bit, spring.offset, -spring.density, force_[z2]->at[r2][c2]);
    }
    VOXSPRING_HOST_DEVICE void half(int bit, int z, int r, int c, int z2, int r2, int c2) {
        const int k = spring_class(c2 - c, r2 - r, z2 - z);
        if (!counts(z, z2) || !has_class<Terms>(k)) return;
        const Pull<Real> spring =
            pull(own_[z]->at[r][c] - neighbour(windows_[z2], r2, c2), k, c2 - c, r2 - r, z2 - z);
        Vector<Real>& force = force_[z]->at[r][c];
        if (masked || (c2 != -1 && c2 != 2)) return add(bit, spring.offset, spring.density, force);
        const auto side = c2 == -1 ? sides_.left : sides_.right;
        if constexpr (predicates_sides<Real, shape>) {
            add_predicated(spring.offset, spring.density, side, force);
        } else {
            add(bit, spring.offset, spring.density * side, force);
        }
    }

private:
    static constexpr int pitch = shape.pitch(sizeof(Real));
    static constexpr int axis = shape.axis(sizeof(Real));

    static VOXSPRING_HOST_DEVICE constexpr bool counts(int z, int z2) {
        return which != (z == z2 ? PlaneSpringsOf::between : PlaneSpringsOf::plane);
    }
    static VOXSPRING_HOST_DEVICE Vector<Real> neighbour(const Real* window, int r, int c) {
        const Real* const row = window + r * pitch;
        if (c == -1 || c == 2) return {row[c], row[axis + c], row[2 * axis + c]};
        Vector<Real> a, b;
        Particles::load_pair(row, axis, a, b);
        return c == 0 ? a : b;
    }
    VOXSPRING_HOST_DEVICE Pull<Real> pull(Vector<Real> relative, int k, int dx, int dy, int dz) const {
        return class_pull<Terms, equal_edges>(step_, step_.spacing, relative, k, dx, dy, dz);
    }
    /// A spring that is masked out leaves `force` as it is, even if the neighbour is not finite.
    VOXSPRING_HOST_DEVICE void add(int bit, Vector<Real> offset, Real density, Vector<Real>& force) const {
        const Vector<Real> sum = fused(offset, density, force);
        if (!masked || (word_ >> bit & 1U) != 0) force = sum;
    }

    const MarchStep<Real>& step_;
    const Sides<Real, shape>& sides_;
    const std::uint64_t word_;
    const Real* const windows_[2];
    const Particles* const own_[2];
    Particles* const force_[2];
};

/// What a step adds to one component of x or u or, by increments, of v, which needs no `at`. `before` is what
/// the step overwrites: x or u at t - dt, or v at t. MarchStep::scale turns `force` into a displacement.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE Real component_change(const MarchStep<Real>& step, Real at, Real before, Real force,
                                            Real gravity) {
    const Real moved = Terms::increments ? before : at - before;
    const Real kept = Terms::increments ? -step.damping : step.retained;
    Real change = Terms::increments ? -Real(0) : moved;
    if constexpr (Terms::compiled(term_damping) && Terms::compiled(term_gravity)) {
        change = std::fma(moved, kept, gravity);
    } else if constexpr (Terms::compiled(term_damping)) {
        change = moved * kept;
    } else if constexpr (Terms::compiled(term_gravity)) {
        change = change + gravity;
    }
    return std::fma(force, step.scale, change);
}
/// One component of x or u at t + dt or, by increments, of v at t + dt.
template <class Terms, class Real>
VOXSPRING_HOST_DEVICE Real integrate_component(const MarchStep<Real>& step, Real at, Real before, Real force,
                                               Real gravity) {
    return (Terms::increments ? before : at) + component_change<Terms>(step, at, before, force, gravity);
}

/// Moves a thread's particles of one plane by one step. The first of them is element `index` of each axis.
/// `before`: their old values, which the step overwrites, from the first particle on.
template <class Terms, MarchShape shape, bool masked, class Real, class Planes>
VOXSPRING_HOST_DEVICE void integrate_plane(const MarchStep<Real>& step, const MarchOutput<Real>& output,
                                           std::size_t index, std::uint64_t word, const Real* before,
                                           const Own<Real, shape.rows>& own,
                                           const Own<Real, shape.rows>& force, const Planes& planes) {
    using Bits = PlaneMask<shape.rows>;
    UNROLLED
    for (int r = 0; r < shape.rows; ++r) {
        if (masked && (word >> Bits::stored(r) & 1U) == 0) continue;
        const bool moves_a = !masked || (word >> Bits::moves(r, 0) & 1U) != 0;
        const bool moves_b = !masked || (word >> Bits::moves(r, 1) & 1U) != 0;
        const auto store = [&](int axis, Real Vector<Real>::*of, Real gravity) {
            const auto old =
                *reinterpret_cast<const Pair<Real>*>(before + axis * shape.before_axis() + r * shape.width());
            const Real at_a = own.at[r][0].*of, at_b = own.at[r][1].*of;
            Pair<Real> next{integrate_component<Terms>(step, at_a, old.a, force.at[r][0].*of, gravity),
                            integrate_component<Terms>(step, at_b, old.b, force.at[r][1].*of, gravity)};
            const std::size_t to = index + std::size_t(r) * step.row + std::size_t(axis) * step.axis;
            if constexpr (Terms::increments) {
                if (!moves_a) next.a = 0;
                if (!moves_b) next.b = 0;
                planes.store(reinterpret_cast<Pair<Real>*>(output.increment + to), next);
                next = {at_a + next.a, at_b + next.b};
            } else {
                if (!moves_a) next.a = at_a;
                if (!moves_b) next.b = at_b;
            }
            planes.store(reinterpret_cast<Pair<Real>*>(output.next + to), next);
        };
        store(0, &Vector<Real>::x, step.gravity.x);
        store(1, &Vector<Real>::y, step.gravity.y);
        store(2, &Vector<Real>::z, step.gravity.z);
    }
}

/// Loads a thread's particles from the window that arrived into `above`. Adds the forces of springs to them
/// (`force_above`) and to the thread's particles in the window before (`force`).
template <class Terms, MarchShape shape, bool masked, bool equal_edges, PlaneSpringsOf which, class Real,
          class Planes>
VOXSPRING_HOST_DEVICE void add_springs(const MarchStep<Real>& step, const Sides<Real, shape>& sides,
                                       std::uint64_t word, const Real* arrived, const Real* window,
                                       const Planes& planes, Own<Real, shape.rows>& above,
                                       const Own<Real, shape.rows>& own, Own<Real, shape.rows>& force_above,
                                       Own<Real, shape.rows>& force) {
    above.load(arrived, shape.pitch(sizeof(Real)), shape.axis(sizeof(Real)));
    force_above.clear();
    PlaneSprings<Terms, shape, masked, equal_edges, which, Real> springs(step, sides, word, arrived, window,
                                                                         above, own, force_above, force);
    if (!masked || planes.any(word != 0)) visit_springs<shape.rows>(springs);
}

/// The march of one thread over the planes of an item. `Planes` provides the windows:
///
/// - arrive(): waits for the next plane and returns its window.
/// - release(): says that the window before the newest one is no longer needed.
/// - before(): waits for the old values that the step of the next plane overwrites, and returns their window.
/// - release_before(): says that the window of before() is no longer needed.
/// - store(to, pair): stores what the step of the next plane computes.
///
/// - refill(plane): may ask for later planes. It is called just before the arrive() that waits for `plane`.
/// - any(here): whether `here` holds for any thread that steps together with this one.
///
/// A returned window begins at the thread's first particle.
template <class Terms, MarchShape shape, bool masked, bool equal_edges, class Real, class Planes>
VOXSPRING_HOST_DEVICE void march(const MarchStep<Real>& step, const MarchItem& item,
                                 const MarchOutput<Real>& output, int thread, Planes& planes) {
    using Particles = Own<Real, shape.rows>;
    const std::uint64_t* words = masked ? step.words + item.words + thread : nullptr;
    std::uint64_t next_word = masked ? *words : 0;
    // Each mask word is fetched one plane before it is needed.
    const auto word_of = [&](int plane) {
        const std::uint64_t word = next_word;
        if (masked && plane < item.end) {
            words += shape.threads();
            next_word = *words;
        }
        return word;
    };

    const int x = item.x + shape.column(thread);
    using Side = typename Sides<Real, shape>::Side;
    const Sides<Real, shape> sides{Side(x > 0), Side(x + 2 < step.nx)};
    std::size_t index = std::size_t(x) + std::size_t(item.y + shape.row(thread)) * step.row +
                        std::size_t(item.begin) * step.plane;
    const auto finish = [&](std::uint64_t word, const Particles& own, const Particles& force) {
        integrate_plane<Terms, shape, masked>(step, output, index, word, planes.before(), own, force, planes);
        planes.release_before();
        index += step.plane;
    };

    Particles own, force, above, force_above;
    const Real* window = planes.arrive();
    own.load(window, shape.pitch(sizeof(Real)), shape.axis(sizeof(Real)));
    force.clear();
    int plane = item.begin;
    if (plane == 0) {
        PlaneSprings<Terms, shape, masked, equal_edges, PlaneSpringsOf::plane, Real> springs(
            step, sides, word_of(plane), window, window, own, own, force, force);
        visit_springs<shape.rows>(springs);
        ++plane;
    }
    ROLLED
    for (; plane < item.end; ++plane) {
        planes.refill(plane);
        const std::uint64_t word = word_of(plane);
        const Real* const arrived = planes.arrive();
        add_springs<Terms, shape, masked, equal_edges, PlaneSpringsOf::both>(
            step, sides, word, arrived, window, planes, above, own, force_above, force);
        planes.release();
        window = arrived;
        if (plane > item.begin) finish(word, own, force);
        own = above;
        force = force_above;
    }
    const std::uint64_t word = word_of(plane);
    // The plane above does not belong to this item, which leaves out the springs within that plane.
    if (plane < step.nz) {
        add_springs<Terms, shape, masked, equal_edges, PlaneSpringsOf::between>(
            step, sides, word, planes.arrive(), window, planes, above, own, force_above, force);
        planes.release();
    }
    finish(word, own, force);
}

}  // namespace voxspring::cuda
