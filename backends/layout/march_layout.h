// How a lattice lies in device memory for cuda_march (kernels/march.h): the order of the elements, the state
// and the kernel's constants. Computed on the host, without a device. march_plan.h says what blocks do.
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

/// Where elements are in an array of vectors (a structure of arrays) that has every x of the lattice, then
/// every y, then every z.
struct SoaStrides {
    /// Elements from one row, plane or axis to the next. A row fills whole cache lines.
    std::size_t row = 0, plane = 0, axis = 0;
    std::size_t size() const { return 3 * axis; }
    /// The index of a voxel's x.
    std::size_t element(glm::ivec3 at) const {
        return std::size_t(at.x) + row * std::size_t(at.y) + plane * std::size_t(at.z);
    }
};
SoaStrides march_strides(const Lattice& lattice, std::size_t real_bytes);

/// Where particles are in an array of vectors.
struct SoaPlaces {
    std::size_t size = 0;                             ///< elements of the array
    std::size_t axis = 0;                             ///< elements from x to y and from y to z of a particle
    std::function<std::size_t(std::size_t)> element;  ///< index of particle i's x
};
/// The places of particles in an array with march_strides(). The result keeps a reference to `lattice`.
SoaPlaces march_places(const Lattice& lattice, std::size_t real_bytes);

/// The state of all particles in the variables of a formulation. Elements without a particle are zero.
template <class Real>
struct SoaState {
    std::vector<Real> current;  ///< x or u
    std::vector<Real> before;   ///< x or u at t - dt or, by increments, v
};
template <class Real>
SoaState<Real> pack_soa(const Problem& problem, const State& state, Formulation formulation,
                        const SoaPlaces& places);
template <class Real>
State unpack_soa(const Problem& problem, const SoaState<Real>& packed, Formulation formulation,
                 const SoaPlaces& places);

/// Whether inverse_root() of the square of every rest length in use is finite in this precision. Always true
/// in formulations by increments, which do not use such inverses.
bool has_inverse_lengths(const Problem& problem, Precision precision, Formulation formulation);

/// Whether all springs of a class (spring_class()) have the same rest length, as the kernel's argument says.
bool has_class_lengths(const Problem& problem);

/// Whether there are edge springs and all have the same stiffness times rest length (in formulations by
/// increments, the same stiffness). Then forces can be computed in units of this product.
bool equal_edges(const Problem& problem, Formulation formulation);
/// The kernel's argument, with null pointers. In formulations without increments its rest_length holds the
/// squares of rest lengths, which the device then replaces by inverse_root() of them.
template <class Real>
MarchStep<Real> make_march_step(const Problem& problem, Formulation formulation);

}  // namespace voxspring::layout
