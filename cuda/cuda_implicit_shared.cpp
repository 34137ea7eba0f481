// The grid is read through shared memory: a block loads three slices of a tile with a frame of one particle,
// and steps the middle slice (the paper's Figure 4).
#include "cuda/common/implicit.h"

namespace voxspring::cuda {
namespace {

const Registered entry(
    implicit_entry("cuda_implicit_shared",
                   "One thread per voxel, neighbours by grid offset and mask from a tile of three slices in "
                   "shared memory.",
                   {}, {"64x4", "32x8", "32x4", "16x16"}));

}  // namespace
}  // namespace voxspring::cuda
