// How a lattice lies in device memory for the march along z (kernels/march.h), built on the host and without
// a device: axes, items of work and the words of those that need masks.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "backends/backend.h"
#include "backends/layout/records/march.h"
#include "backends/physics/formulation.h"
#include "backends/physics/problem.h"

namespace voxspring::cuda {

/// A tile of the march as the tuning parameter `tile` names it.
struct MarchTile {
    MarchShape shape;
    int blocks;  ///< that share an SM
};
/// By its width and height in particles, "128x16". Empty shapes (no warps) where a precision has none such.
MarchTile march_tile(const std::string& name, Precision precision);
/// The tile for a problem, by the shape of its lattice and how full it is: the best of those that
/// `shared_bytes` of a block hold, or the smallest.
std::string best_march_tile(const Problem& problem, Precision precision, std::size_t shared_bytes);

/// Elements of an array of vectors: every x of the lattice, then every y, then every z.
struct SoaStrides {
    std::size_t row = 0, plane = 0, axis = 0;  ///< elements from one to the next; rows begin on cache lines
    std::size_t size() const { return 3 * axis; }
};
SoaStrides march_strides(const Lattice& lattice, std::size_t real_bytes);

/// The state of every particle, as a formulation has it; voxels without one are zero.
template <class Real>
struct MarchState {
    std::vector<Real> current;  ///< x or u
    std::vector<Real> before;   ///< x or u at t - dt or, by increments, v: what a step overwrites
};
template <class Real>
MarchState<Real> pack_march(const Problem& problem, const State& state, Formulation formulation);
template <class Real>
State unpack_march(const Problem& problem, const MarchState<Real>& packed, Formulation formulation);

/// What blocks do.
struct MarchPlan {
    std::vector<MarchItem> items;
    std::vector<std::uint64_t> words;
    bool operator==(const MarchPlan&) const = default;
};
/// Items for all particles. `slots`: blocks that run at once, for which items are cut to lengths that keep
/// them all busy to the end.
MarchPlan plan_march(const Problem& problem, const MarchShape& shape, int slots);
/// Bytes of a plan, at most.
std::uint64_t max_plan_bytes(const Lattice& lattice, const MarchShape& shape);

/// Whether no rest length is so short that its inverse, in which forces are unless by increments, is none.
bool has_inverse_lengths(const Problem& problem, Precision precision, Formulation formulation);

/// Whether all edge springs pull alike, so that forces are in units of theirs.
bool equal_edges(const Problem& problem, Formulation formulation);
/// The kernel's argument, with squares of rest lengths unless by increments (what inverse_root() takes) and
/// pointers null.
template <class Real>
MarchStep<Real> make_march_step(const Problem& problem, Formulation formulation);

}  // namespace voxspring::cuda
