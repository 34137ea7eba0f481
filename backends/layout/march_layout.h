// How a lattice lies in device memory for the march along z (kernels/march.h): axes, state and the kernel's
// constants. Built on the host, without a device. march_plan.h says what blocks do.
#pragma once

#include <cstdint>
#include <functional>
#include <glm/vec3.hpp>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/records/march.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::layout {

/// The elements of an array of vectors: every x of the lattice, then every y, then every z.
struct SoaStrides {
    std::size_t row = 0, plane = 0, axis = 0;  ///< elements from one to the next; rows begin on cache lines
    std::size_t size() const { return 3 * axis; }
    /// The element of a voxel's x.
    std::size_t element(glm::ivec3 at) const {
        return std::size_t(at.x) + row * std::size_t(at.y) + plane * std::size_t(at.z);
    }
};
SoaStrides march_strides(const Lattice& lattice, std::size_t real_bytes);

/// Where particles lie in an array of vectors.
struct SoaPlaces {
    std::size_t size = 0;                             ///< elements of the array
    std::size_t axis = 0;                             ///< elements from x to y and from y to z of a particle
    std::function<std::size_t(std::size_t)> element;  ///< index of particle i's x
};
/// The places of particles in an array with march_strides(). They keep a reference to `lattice`.
SoaPlaces march_places(const Lattice& lattice, std::size_t real_bytes);

/// The state of every particle in a formulation. Elements without a particle are zero.
template <class Real>
struct SoaState {
    std::vector<Real> current;  ///< x or u
    std::vector<Real> before;   ///< x or u at t - dt or, by increments, v: what a step overwrites
};
template <class Real>
SoaState<Real> pack_soa(const Problem& problem, const State& state, Formulation formulation,
                        const SoaPlaces& places);
template <class Real>
State unpack_soa(const Problem& problem, const SoaState<Real>& packed, Formulation formulation,
                 const SoaPlaces& places);

/// Whether every rest length in use has a finite inverse in this precision. Always true in formulations by
/// increments, which do not use these inverses.
bool has_inverse_lengths(const Problem& problem, Precision precision, Formulation formulation);

/// Whether there are edge springs and all of them pull alike, so that forces can be in units of this pull.
bool equal_edges(const Problem& problem, Formulation formulation);
/// The kernel's argument with null pointers. Except in formulations by increments, its rest_length has the
/// squares of rest lengths, which the device replaces by inverse_root() of them.
template <class Real>
MarchStep<Real> make_march_step(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
