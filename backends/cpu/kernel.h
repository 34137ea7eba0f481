// One thread's share of a step of cpu_parallel, compiled for every SIMD target and dispatched to the best.
#pragma once

#include <hwy/base.h>

#include <array>
#include <cstddef>
#include <cstdint>

#include "backends/cpu/simd/root.h"
#include "backends/physics/formulation.h"

namespace voxspring::cpu_parallel {

/// A particle's mask (bits for each of its springs, for active and for pinned) in an integer as wide as a
/// scalar. So a SIMD register holds as many masks as scalars.
template <class T>
using MaskOf = hwy::MakeUnsigned<T>;

/// Elements of a block: as many as a register of the widest SIMD target holds.
template <class T>
constexpr std::ptrdiff_t block_size = 64 / sizeof(T);

struct Block {
    std::ptrdiff_t first;     ///< index of its first element in the arrays
    std::ptrdiff_t in_slice;  ///< `first`, counted from the start of its slice (one z)
    std::uint32_t tile;       ///< index of its tile (tiles.h)
    bool odd_slice;
    bool full_stencil;  ///< every voxel has a particle that can move and has a spring in every direction in
                        ///< use; not set with terms=all
    std::uint8_t active_quarters;  ///< one bit per quarter: whether it has a particle; all with terms=all
};

/// What a step does with a tile. The last two can be combined.
enum TileAction : std::uint8_t {
    tile_steps = 1,
    tile_leaves_densities = 2,  ///< the tile rests, but stores force densities for tiles beside it
    tile_falls_asleep = 4,      ///< the tile's particles stop where they are
};

/// Two opposite directions of springs: a lower and a higher neighbour. Blocks in even slices and blocks in
/// odd slices use different objects.
template <class T>
struct Opposites {
    std::ptrdiff_t stride;  ///< elements from a particle to the higher neighbour; to the lower: -stride
    MaskOf<T> lower_bit, higher_bit;
    std::array<T, 3> rest_offset;  ///< rest position minus that of the higher neighbour
    T rest_length;
    T rest_deficit;
    T stiffness;
    /// Force densities of springs, indexed by the stepped particle's element in its slice (one z). A particle
    /// evaluates the spring to its higher neighbour (+stride) and writes the density to `higher_density`. It
    /// reads the density of the spring to its lower neighbour, which that neighbour wrote, from
    /// `lower_density`. If both are null, both ends evaluate the spring.
    const T* lower_density;
    T* higher_density;
};

/// One thread's share of one step. x is a position, u a displacement. Arrays that the formulation does not
/// have are null.
template <class T>
struct Task {
    std::array<const T*, 3> at;  ///< x or u
    std::array<T*, 3> next;      ///< holds the previous x or u until it is overwritten
    std::array<const T*, 3> at_low;
    std::array<T*, 3> next_low;
    std::array<T*, 3> increment, increment_low;  ///< changed in place
    std::array<const T*, 3> load;                ///< constant forces; null: none
    const MaskOf<T>* mask;
    const T* inverse_mass;                         ///< one per particle; null: `uniform_inverse_mass`
    const T* compliance;                           ///< one per particle; null: one stiffness per direction
    std::array<const Opposites<T>*, 2> opposites;  ///< for even and for odd slices
    std::size_t opposites_count;
    std::ptrdiff_t farthest;  ///< the largest stride: how far ahead a block reads
    /// The blocks [begin, end) are stepped. Those in [lead, begin) only store force densities for them.
    const Block *lead, *begin, *end;
    /// The TileAction of each tile. Null: all tiles step, and `active_tile` is not written.
    const std::uint8_t* action;
    /// For each tile that is stepped, whether it stays active. If `slow` is 0: whether the step changed a bit
    /// of it. Otherwise: whether the step moved one of its particles by at least `slow`.
    std::uint8_t* active_tile;
    T slow;
    T flush;  ///< components of u and of the increment closer to 0 than this are set to 0; 0: none
    T shortest_squared;
    T uniform_inverse_mass;
    std::array<T, 3> gravity;
    T damping, retained, doubled;  ///< lambda, 1 - lambda and 2 - lambda
    T time_step_squared;
};

/// Steps the task's particles. float64 always uses the exact root.
void step(const Task<float>& task, Formulation formulation, Root root);
void step(const Task<double>& task, Formulation formulation, Root root);

/// Whether every particle of the task's blocks is finite and moved by at most `largest_increment` in the step
/// that led to `at`.
bool within(const Task<float>& task, Formulation formulation, double largest_increment);
bool within(const Task<double>& task, Formulation formulation, double largest_increment);

/// The name of the SIMD target in use.
const char* target_name();
/// The largest relative error of the approximate reciprocals of the SIMD target in use (error_of_roots()).
double approximation_error();
/// The largest relative error of 1 / sqrt(x) computed with `root`, over some ten thousand x from 1 to 4.
double measured_root_error(Root root);

}  // namespace voxspring::cpu_parallel
