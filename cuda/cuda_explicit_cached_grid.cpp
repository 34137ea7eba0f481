// Neighbour lists for a regular grid. All springs of a group (face, edge, corner) have the same constants, so
// a list has one counter per group instead of a secondary list. Positions are read through a texture object
// or, with fetch=l1, through L1.
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
