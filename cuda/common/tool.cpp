#include "cuda/common/tool.h"

#include "cuda/common/support_kernels.h"

namespace voxspring::cuda {

template <class Real>
void pull_held(const Holding<Real>& holding, const Stream& stream) {
    launch_for_each(*support_kernels<Real>().pull_held_particles, holding.count, stream, holding);
}

template void pull_held(const Holding<float>&, const Stream&);
template void pull_held(const Holding<double>&, const Stream&);

}  // namespace voxspring::cuda
