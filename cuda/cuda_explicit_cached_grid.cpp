// Neighbour lists of a regular grid, with one counter per spring group instead of a secondary list. Positions
// are read through the texture path.
#include "cuda/common/explicit.h"

namespace voxspring::cuda {
namespace {

const Registered entry(
    explicit_entry("cuda_explicit_cached_grid",
                   "One thread per particle, neighbours by list with one counter per spring group, "
                   "positions through a texture object.",
                   {"texture", "l1"}, Secondary::never));

}  // namespace
}  // namespace voxspring::cuda
