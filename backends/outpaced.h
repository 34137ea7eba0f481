// The rules of --backend auto rank backends as they were measured on some devices. A backend can correct that
// ranking for other devices.
#pragma once

#include <string>

#include "backends/backend.h"

namespace voxspring {

/// A backend that knows on which devices another one is faster. Only --backend auto heeds it.
class Outpaced {
public:
    /// Why another backend is predicted to step `problem` faster on the same device. Empty: none is. If there
    /// is a reason, the rules of `auto` go on to the next backend. This backend must accept `problem`.
    virtual std::string outpaced(const Problem& problem) const = 0;

protected:
    ~Outpaced() = default;
};

/// Returns the result of Outpaced::outpaced(), or an empty string if `backend` is not an Outpaced.
inline std::string outpaced_by_another(const Backend& backend, const Problem& problem) {
    const auto* const asked = dynamic_cast<const Outpaced*>(&backend);
    return asked == nullptr ? "" : asked->outpaced(problem);
}

}  // namespace voxspring
