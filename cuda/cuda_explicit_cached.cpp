// Neighbour lists with a secondary list of stiffness and rest length. Positions are read through a texture
// object or, with fetch=l1, through L1.
#include "cuda/common/explicit.h"

namespace voxspring::cuda {
namespace {

const Registered entry(
    explicit_entry("cuda_explicit_cached",
                   "One thread per particle, neighbours, stiffness and rest length by list, "
                   "positions through a texture object.",
                   {"texture", "l1"}, Secondary::always));

}  // namespace
}  // namespace voxspring::cuda
