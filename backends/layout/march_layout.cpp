#include "backends/layout/march_layout.h"

#include <algorithm>
#include <array>
#include <limits>

#include "backends/layout/rounding.h"
#include "backends/layout/springs.h"
#include "backends/physics/huge_pages.h"

namespace voxspring::layout {
namespace {

/// One lattice direction of each spring class (spring_class()).
constexpr std::array<glm::ivec3, spring_classes> class_offsets = {glm::ivec3{1, 0, 0}, {0, 1, 0}, {0, 0, 1},
                                                                  {1, 1, 0},           {1, 0, 1}, {0, 1, 1}};

const Direction& direction_to(const glm::ivec3& offset) {
    return *std::find_if(directions().begin(), directions().end(),
                         [&](const Direction& direction) { return direction.offset == offset; });
}

/// The factor that turns the density which the kernel computes for a spring of class k into force per length.
/// This density is (l - |d|) / |d| in formulations by increments, otherwise (l - |d|) / (l |d|).
double pull_of_class(const Problem& problem, std::size_t k, Formulation formulation) {
    const Direction& direction = direction_to(class_offsets[k]);
    const double stiffness = problem.group_stiffness[std::size_t(direction.group)];
    return by_increments(formulation) ? stiffness : stiffness * rest_spring(problem, direction).length;
}

}  // namespace

SoaStrides march_strides(const Lattice& lattice, std::size_t real_bytes) {
    constexpr std::size_t line = 128;
    const std::size_t row = rounded_up(std::size_t(lattice.dims.x) * real_bytes, line) / real_bytes;
    const std::size_t plane = row * std::size_t(lattice.dims.y);
    return {row, plane, plane * std::size_t(lattice.dims.z)};
}

SoaPlaces march_places(const Lattice& lattice, std::size_t real_bytes) {
    const SoaStrides axes = march_strides(lattice, real_bytes);
    return {axes.size(), axes.axis,
            [axes, &lattice](std::size_t i) { return axes.element(lattice.coordinates(lattice.voxel[i])); }};
}

namespace {

/// Calls visit(particle, element) for each particle; `element` is the index of the particle's x in an array
/// with `places`.
template <class Visit>
void visit_particles(const Problem& problem, const SoaPlaces& places, Visit visit) {
    const auto particles = std::ptrdiff_t(problem.particle_count());
#pragma omp parallel for
    for (std::ptrdiff_t n = 0; n < particles; ++n) {
        const auto i = std::size_t(n);
        visit(i, places.element(i));
    }
}

}  // namespace

template <class Real>
SoaState<Real> pack_soa(const Problem& problem, const State& state, Formulation formulation,
                        const SoaPlaces& places) {
    SoaState<Real> packed;
    resize_in_huge_pages(packed.current, places.size);
    resize_in_huge_pages(packed.before, places.size);
    visit_particles(problem, places, [&](std::size_t i, std::size_t at) {
        glm::dvec3 point = state.displacement_of(i);
        if (on_positions(formulation)) point += problem.rest_position[i];
        const glm::dvec3 before =
            by_increments(formulation) ? state.increment_of(i) : point - state.increment_of(i);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            packed.current[axis * places.axis + at] = Real(point[int(axis)]);
            packed.before[axis * places.axis + at] = Real(before[int(axis)]);
        }
    });
    return packed;
}

template <class Real>
State unpack_soa(const Problem& problem, const SoaState<Real>& packed, Formulation formulation,
                 const SoaPlaces& places) {
    State state = state_at_rest(problem);
    visit_particles(problem, places, [&](std::size_t i, std::size_t at) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double point = double(packed.current[axis * places.axis + at]);
            const double before = double(packed.before[axis * places.axis + at]);
            const double rest = on_positions(formulation) ? problem.rest_position[i][int(axis)] : 0;
            state.displacement[i][int(axis)] = point - rest;
            state.increment[i][int(axis)] = by_increments(formulation) ? before : point - before;
        }
    });
    return state;
}

bool has_inverse_lengths(const Problem& problem, Precision precision, Formulation formulation) {
    if (by_increments(formulation)) return true;
    const double smallest = precision == Precision::float32 ? double(std::numeric_limits<float>::min())
                                                            : std::numeric_limits<double>::min();
    return std::all_of(directions().begin(), directions().end(), [&](const Direction& direction) {
        return (problem.group_bits >> direction.bit & 1U) == 0 ||
               squared_rest_length(problem, direction) >= smallest;
    });
}

bool has_class_lengths(const Problem& problem) {
    return std::all_of(directions().begin(), directions().end(), [&](const Direction& direction) {
        const glm::ivec3 o = direction.offset;
        const Direction& of_class = direction_to(class_offsets[std::size_t(spring_class(o.x, o.y, o.z))]);
        return (problem.group_bits >> direction.bit & 1U) == 0 ||
               problem.rest_length[std::size_t(direction.bit)] ==
                   problem.rest_length[std::size_t(of_class.bit)];
    });
}

bool equal_edges(const Problem& problem, Formulation formulation) {
    if ((problem.group_bits & EDGE_BITS) == 0) return false;
    const double first = pull_of_class(problem, 3, formulation);
    return first > 0 && first == pull_of_class(problem, 4, formulation) &&
           first == pull_of_class(problem, 5, formulation);
}

template <class Real>
MarchStep<Real> make_march_step(const Problem& problem, Formulation formulation) {
    const Lattice& lattice = problem.lattice;
    const SoaStrides axes = march_strides(lattice, sizeof(Real));
    MarchStep<Real> step{};
    step.nx = lattice.dims.x;
    step.ny = lattice.dims.y;
    step.nz = lattice.dims.z;
    step.row = axes.row;
    step.plane = axes.plane;
    step.axis = axes.axis;
    step.spacing = {Real(lattice.spacing.x), Real(lattice.spacing.y), Real(lattice.spacing.z)};
    const double unit = equal_edges(problem, formulation) ? pull_of_class(problem, 3, formulation) : 1;
    for (std::size_t k = 0; k < spring_classes; ++k) {
        const Direction& direction = direction_to(class_offsets[k]);
        step.rest_length[k] = listed_length<Real>(problem, direction, formulation);
        step.deficit[k] = Real(rest_spring(problem, direction).deficit);
        step.stiffness[k] = Real(pull_of_class(problem, k, formulation) / unit);
    }
    const double squared = problem.time_step * problem.time_step;
    step.scale = Real(unit * squared / problem.materials.front().mass);
    step.gravity = {Real(problem.gravity.x * squared), Real(problem.gravity.y * squared),
                    Real(problem.gravity.z * squared)};
    step.damping = Real(problem.damping);
    step.retained = Real(1 - problem.damping);
    step.shortest_squared = Real(problem.shortest_squared());
    return step;
}

#define FOR_PRECISION(Real)                                                                          \
    template SoaState<Real> pack_soa(const Problem&, const State&, Formulation, const SoaPlaces&);   \
    template State unpack_soa(const Problem&, const SoaState<Real>&, Formulation, const SoaPlaces&); \
    template MarchStep<Real> make_march_step(const Problem&, Formulation);
FOR_PRECISION(float)
FOR_PRECISION(double)
#undef FOR_PRECISION

}  // namespace voxspring::layout
