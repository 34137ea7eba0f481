// The 26 neighbours of a voxel as lists of macros that expand in place, the same in C++, CUDA and GLSL.
//
// X(bit, dx, dy, dz): the neighbour of voxel (x, y, z) at (x+dx, y+dy, z+dz). Bit `bit` of a particle's mask
// says whether a spring leads there. If a backend sums the forces of springs particle by particle, it must
// add them in this order, because float addition is not associative. Only cuda_resident with overlap=on adds
// springs across the border of a block last. The opposite direction of bit b is bit b ^ 1. The directions of
// even bits point to a lower voxel index (z slowest, x fastest).
#ifndef VOXSPRING_NEIGHBOURS_H
#define VOXSPRING_NEIGHBOURS_H

// clang-format off
// Group 1 of the paper, face springs: rest length 1 on a unit lattice.
#define FACE_NEIGHBOURS(X) \
    X(0, -1, 0, 0) X(1, 1, 0, 0) X(2, 0, -1, 0) X(3, 0, 1, 0) X(4, 0, 0, -1) X(5, 0, 0, 1)

// Group 2, edge springs: rest length sqrt(2).
#define EDGE_NEIGHBOURS(X) \
    X(6, -1, -1, 0) X(7, 1, 1, 0) X(8, 1, -1, 0) X(9, -1, 1, 0) \
    X(10, -1, 0, -1) X(11, 1, 0, 1) X(12, 1, 0, -1) X(13, -1, 0, 1) \
    X(14, 0, -1, -1) X(15, 0, 1, 1) X(16, 0, 1, -1) X(17, 0, -1, 1)

// Group 3, corner springs: rest length sqrt(3).
#define CORNER_NEIGHBOURS(X) \
    X(18, -1, -1, -1) X(19, 1, 1, 1) X(20, 1, -1, -1) X(21, -1, 1, 1) \
    X(22, -1, 1, -1) X(23, 1, -1, 1) X(24, 1, 1, -1) X(25, -1, -1, 1)
// clang-format on

#define FACE_BITS 0x0000003Fu
#define EDGE_BITS 0x0003FFC0u
#define CORNER_BITS 0x03FC0000u
#define NEIGHBOUR_BITS 0x03FFFFFFu

// Set in the mask of every particle. A voxel without a particle has mask 0. The bit is among the exponent
// bits of a float. So a mask in the fourth float of a texel is a normal number, which no hardware flushes to
// zero, and never a NaN.
#define ACTIVE_BIT 0x04000000u
// Set in the mask of a particle that does not move.
#define PINNED_BIT 0x08000000u

// An entry of a neighbour list has the neighbour's index in its lowest bits. In formulations on displacements
// (formulation.h) its highest bits are a direction code, which says how the neighbour lies at rest: the mask
// bit of its direction, as seen from the particle, or one of the two codes below.
#define LISTED_INDEX_BITS 27
#define LISTED_INDEX 0x07FFFFFFu
// Direction code of an unused slot of a list. The index in such a slot is that of the particle itself.
#define NO_DIRECTION 26u
// Direction code of a spring beyond the lattice. Its rest offset is in another array, at the same place.
#define OWN_DIRECTION 31u

#endif
