// The grid in global memory, read past L1 or, with fetch=l1, through L1.
#include "cuda/common/implicit.h"

namespace voxspring::cuda {
namespace {

const Registered entry(
    implicit_entry("cuda_implicit_device",
                   "One thread per voxel, neighbours by grid offset and mask from global memory past L1.",
                   {"cg", "l1"}, voxel_blocks));

}  // namespace
}  // namespace voxspring::cuda
