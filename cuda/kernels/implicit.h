// Implicit addressing: a particle's neighbours are at fixed offsets in the grid and its mask says which of
// them exist. The body of the kernels, with the neighbour fetch as its parameter.
#pragma once

#include "cuda/kernels/motion.h"

namespace voxspring::cuda {

/// Everything a step needs besides positions. Grid arrays are x fastest, with guard words on either side:
/// voxel (x, y, z) is element first + x + nx (y + ny z), and the neighbours of any voxel, inside the lattice
/// or not, are elements that may be read.
template <class Real>
struct ImplicitStep {
    int nx, ny, nz;
    int first;
    const BlockOrigin* origins;  ///< of the blocks with an active voxel; null: blocks cover the lattice
    std::uint32_t group_bits;
    Real rest_length[13];    ///< of mask bits 2 b and 2 b + 1
    Real stiffness[3];       ///< of each spring group, where there is one material
    const Real* compliance;  ///< 1 / stiffness of each voxel's material, where there are several
    Motion<Real> motion;
    bool operator==(const ImplicitStep&) const = default;
};

/// What of a scene changes the loop over springs, and so is compiled apart.
template <bool has_materials, bool has_face_and_edge>
struct ImplicitTerms {
    /// Stiffness from the two particles' materials rather than from the group.
    static constexpr bool materials = has_materials;
    /// The scene's groups are the paper's two; otherwise any, tested at run time.
    static constexpr bool face_and_edge = has_face_and_edge;
};

/// Force of all springs of `self`. `neighbour(dx, dy, dz)` is the position at that offset and
/// `compliance(dx, dy, dz)` the compliance. Both are called for absent neighbours too, so that a fetch waits
/// for no mask; what they give is then dropped by selection, and a NaN in an inactive voxel stays there.
template <class Terms, class Real, class Neighbour, class Compliance>
VOXSPRING_HOST_DEVICE Vector<Real> implicit_force(const ImplicitStep<Real>& step, Particle<Real> self,
                                                  Neighbour neighbour, Compliance compliance) {
    Vector<Real> force{0, 0, 0};
    Vector<Real> group{0, 0, 0};
    // All fetches of a group come before the first use: with few warps an SM, as on a small lattice, a step
    // is as long as the memory latencies that a thread waits for one after another.
#define FETCH_NEIGHBOUR(bit, dx, dy, dz) const Vector<Real> neighbour##bit = neighbour(dx, dy, dz);
#define ADD_SPRING(bit, dx, dy, dz)                                                                         \
    {                                                                                                       \
        const Vector<Real> offset = self.position - neighbour##bit;                                         \
        Real scale = unit_force_density(offset, step.rest_length[(bit) / 2], step.motion.shortest_squared); \
        if constexpr (Terms::materials)                                                                     \
            scale *= fast_series_stiffness(own_compliance, compliance(dx, dy, dz));                         \
        if ((self.bits >> (bit)&1U) != 0) group = group + offset * scale;                                   \
    }
    [[maybe_unused]] Real own_compliance{};
    if constexpr (Terms::materials) own_compliance = compliance(0, 0, 0);
    if (Terms::face_and_edge || (step.group_bits & FACE_BITS) != 0) {
        FACE_NEIGHBOURS(FETCH_NEIGHBOUR)
        FACE_NEIGHBOURS(ADD_SPRING)
        force = Terms::materials ? group : group * step.stiffness[0];
        group = {0, 0, 0};
    }
    if (Terms::face_and_edge || (step.group_bits & EDGE_BITS) != 0) {
        EDGE_NEIGHBOURS(FETCH_NEIGHBOUR)
        EDGE_NEIGHBOURS(ADD_SPRING)
        force = force + (Terms::materials ? group : group * step.stiffness[1]);
        group = {0, 0, 0};
    }
    if (!Terms::face_and_edge && (step.group_bits & CORNER_BITS) != 0) {
        CORNER_NEIGHBOURS(FETCH_NEIGHBOUR)
        CORNER_NEIGHBOURS(ADD_SPRING)
        force = force + (Terms::materials ? group : group * step.stiffness[2]);
    }
#undef FETCH_NEIGHBOUR
#undef ADD_SPRING
    return force;
}

/// Steps the particle of element `index`, if there is one. `previous` holds its x(t - dt) and receives
/// x(t + dt); `self` is what `current` holds.
template <class Terms, class Real, class Neighbour, class Compliance>
VOXSPRING_HOST_DEVICE void step_voxel(const ImplicitStep<Real>& step, int index, Particle<Real> self,
                                      Word<Real>* previous, Neighbour neighbour, Compliance compliance) {
    if (self.bits == 0) return;
    const Vector<Real> before = load_past_l1(previous + index).position;
    const Vector<Real> force = implicit_force<Terms>(step, self, neighbour, compliance);
    store(previous + index, moved(step.motion, index, self, before, force));
}

/// A neighbour fetch from memory: `current.at(index, dx)` is the particle of element index + dx.
template <class Real, class Current>
struct GridNeighbours {
    const Current& current;
    int index, row, slice;
    VOXSPRING_HOST_DEVICE Vector<Real> operator()(int dx, int dy, int dz) const {
        return current.at(index + dy * row + dz * slice, dx).position;
    }
};

/// The compliance of the voxels about element `index`.
template <class Real>
struct GridCompliance {
    const Real* compliance;
    int index, row, slice;
    VOXSPRING_HOST_DEVICE Real operator()(int dx, int dy, int dz) const {
        return compliance[index + dy * row + dz * slice + dx];
    }
};

/// One thread of a kernel that fetches neighbours from memory: the voxel (x, y, z), which may lie outside.
template <class Terms, class Real, class Current>
VOXSPRING_HOST_DEVICE void step_from_memory(const ImplicitStep<Real>& step, int x, int y, int z,
                                            const Current& current, Word<Real>* previous) {
    if (x >= step.nx || y >= step.ny || z >= step.nz) return;
    const int row = step.nx;
    const int slice = step.nx * step.ny;
    const int index = step.first + x + row * y + slice * z;
    step_voxel<Terms>(step, index, current.at(index, 0), previous,
                      GridNeighbours<Real, Current>{current, index, row, slice},
                      GridCompliance<Real>{step.compliance, index, row, slice});
}

/// Three slices of a tile of W x H particles and a frame of one particle around it, in shared memory: the
/// paper's Figure 4. Three arrays, so that neighbouring threads read neighbouring banks.
template <class Real, int W, int H>
struct Tile {
    Real x[3][H + 2][W + 2];
    Real y[3][H + 2][W + 2];
    Real z[3][H + 2][W + 2];

    /// The three particles above one another at column (cx, cy) of the tile, whose middle one is element
    /// `index`. Returns that one.
    template <class Current>
    VOXSPRING_HOST_DEVICE Particle<Real> load(int cx, int cy, int index, int slice, const Current& current) {
        Particle<Real> middle{};
        for (int k = 0; k < 3; ++k) {
            const Particle<Real> particle = current.at(index + (k - 1) * slice, 0);
            x[k][cy][cx] = particle.position.x;
            y[k][cy][cx] = particle.position.y;
            z[k][cy][cx] = particle.position.z;
            if (k == 1) middle = particle;
        }
        return middle;
    }

    /// Thread (tx, ty) loads its own column, and those of the frame that it borders. Returns its particle.
    /// What lies outside of the lattice is left unset and belongs to no spring.
    template <class Current>
    VOXSPRING_HOST_DEVICE Particle<Real> fill(int tx, int ty, int index, int row, int slice,
                                              const Current& current) {
        const Particle<Real> self = load(tx + 1, ty + 1, index, slice, current);
        const bool left = tx == 0, right = tx == W - 1, front = ty == 0, back = ty == H - 1;
        if (left) load(0, ty + 1, index - 1, slice, current);
        if (right) load(W + 1, ty + 1, index + 1, slice, current);
        if (front) load(tx + 1, 0, index - row, slice, current);
        if (back) load(tx + 1, H + 1, index + row, slice, current);
        if (left && front) load(0, 0, index - row - 1, slice, current);
        if (right && front) load(W + 1, 0, index - row + 1, slice, current);
        if (left && back) load(0, H + 1, index + row - 1, slice, current);
        if (right && back) load(W + 1, H + 1, index + row + 1, slice, current);
        return self;
    }
};

/// A neighbour fetch from the tile.
template <class Real, int W, int H>
struct TileNeighbours {
    const Tile<Real, W, H>& tile;
    int tx, ty;
    VOXSPRING_HOST_DEVICE Vector<Real> operator()(int dx, int dy, int dz) const {
        return {tile.x[1 + dz][ty + 1 + dy][tx + 1 + dx], tile.y[1 + dz][ty + 1 + dy][tx + 1 + dx],
                tile.z[1 + dz][ty + 1 + dy][tx + 1 + dx]};
    }
};

}  // namespace voxspring::cuda
