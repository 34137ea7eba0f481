// The records of backends/layout by their short names.
#pragma once

namespace voxspring::layout {}
namespace voxspring::cuda {
using namespace layout;
}
