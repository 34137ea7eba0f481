// The stencil as lists that expand in place, identical in C++, CUDA and GLSL.
//
// X(bit, dx, dy, dz): the neighbour at voxel (x+dx, y+dy, z+dz). Bit `bit` of a particle's mask says whether
// it is there. The order is part of the contract: a backend that gathers adds a particle's spring forces in
// this order, since float addition is not associative. The opposite direction of bit b is bit b ^ 1. The
// directions of even bits point to a lower voxel index (z slowest, x fastest).
#ifndef VOXSPRING_NEIGHBOURS_H
#define VOXSPRING_NEIGHBOURS_H

// clang-format off
// Group 1 of the paper: rest length 1 on a unit lattice.
#define FACE_NEIGHBOURS(X) \
    X(0, -1, 0, 0) X(1, 1, 0, 0) X(2, 0, -1, 0) X(3, 0, 1, 0) X(4, 0, 0, -1) X(5, 0, 0, 1)

// Group 2: rest length sqrt(2).
#define EDGE_NEIGHBOURS(X) \
    X(6, -1, -1, 0) X(7, 1, 1, 0) X(8, 1, -1, 0) X(9, -1, 1, 0) \
    X(10, -1, 0, -1) X(11, 1, 0, 1) X(12, 1, 0, -1) X(13, -1, 0, 1) \
    X(14, 0, -1, -1) X(15, 0, 1, 1) X(16, 0, 1, -1) X(17, 0, -1, 1)

// Group 3: rest length sqrt(3).
#define CORNER_NEIGHBOURS(X) \
    X(18, -1, -1, -1) X(19, 1, 1, 1) X(20, 1, -1, -1) X(21, -1, 1, 1) \
    X(22, -1, 1, -1) X(23, 1, -1, 1) X(24, 1, 1, -1) X(25, -1, -1, 1)
// clang-format on

#define FACE_BITS 0x0000003Fu
#define EDGE_BITS 0x0003FFC0u
#define CORNER_BITS 0x03FC0000u
#define NEIGHBOUR_BITS 0x03FFFFFFu

// A voxel without this bit is inactive: its whole mask is zero. It sits among the exponent bits of a
// float, so that a mask stored in the fourth float of a texel is a normal number, which no hardware
// flushes to zero, and never a NaN.
#define ACTIVE_BIT 0x04000000u
// The particle does not move.
#define PINNED_BIT 0x08000000u

// A list entry names a neighbour. Its highest bits say how the neighbour lies at rest, seen from the
// particle: the bit of a lattice direction, or one of the two values below. Formulations on displacements
// (formulation.h) need it.
#define LISTED_INDEX_BITS 27
#define LISTED_INDEX 0x07FFFFFFu
// Marks an unused slot, which names the particle itself.
#define NO_DIRECTION 26u
// Not a lattice neighbour: another list has the rest offset of this spring.
#define OWN_DIRECTION 31u

#endif
