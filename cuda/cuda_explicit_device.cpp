// Neighbour lists and positions are read from global memory past L1 or, with fetch=l1, through L1. By default
// stiffness and rest length are stored per spring only where a scene needs them.
#include "cuda/common/explicit.h"

namespace voxspring::cuda {
namespace {

const Registered entry(explicit_entry(
    "cuda_explicit_device", "One thread per particle, neighbours by list from global memory past L1.",
    {"cg", "l1"}, Secondary::where_needed));

}  // namespace
}  // namespace voxspring::cuda
