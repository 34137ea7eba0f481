// Chooses a scalar type by the precision that options name.
#pragma once

#include <cstddef>
#include <memory>
#include <utility>

#include "backends/backend.h"

namespace voxspring {

/// Calls act(Real(0)), where Real is the scalar type of `precision`. Returns the result.
template <class Act>
auto by_precision(Precision precision, const Act& act) {
    return precision == Precision::float32 ? act(0.0F) : act(0.0);
}

/// Makes a Made<float> or a Made<double>, by the precision that `options` name, from `arguments`.
template <template <class> class Made, class... Arguments>
std::unique_ptr<Backend> make_by_precision(const Options& options, Arguments&&... arguments) {
    return by_precision(options.precision, [&]<class Real>(Real) -> std::unique_ptr<Backend> {
        return std::make_unique<Made<Real>>(std::forward<Arguments>(arguments)...);
    });
}

/// Bytes of a number in this precision.
inline std::size_t scalar_bytes(Precision precision) {
    return precision == Precision::float32 ? sizeof(float) : sizeof(double);
}

}  // namespace voxspring
