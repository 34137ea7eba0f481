// The grid in global memory, read through a texture object or, with fetch=l1, through L1.
#include "cuda/common/implicit.h"

namespace voxspring::cuda {
namespace {

const Registered entry(
    implicit_entry("cuda_implicit_cached",
                   "One thread per voxel, neighbours by grid offset and mask through a texture object.",
                   {"texture", "l1"}, voxel_blocks));

}  // namespace
}  // namespace voxspring::cuda
