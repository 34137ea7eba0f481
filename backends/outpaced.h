// Which of two backends that the rules of `auto` rank is faster on a device unlike those the rules come from.
#pragma once

#include <string>

#include "backends/backend.h"

namespace voxspring {

/// A backend that knows on which devices another one is faster. Only the choice of `auto` asks it.
class Outpaced {
public:
    /// Empty, or why another backend is predicted to step `problem` faster on the same device. The rules of
    /// `auto` then go on to the next backend. Only for a problem that this backend accepts.
    virtual std::string outpaced(const Problem& problem) const = 0;

protected:
    ~Outpaced() = default;
};

/// Outpaced::outpaced(); empty for a backend that is no Outpaced.
inline std::string outpaced_by_another(const Backend& backend, const Problem& problem) {
    const auto* const asked = dynamic_cast<const Outpaced*>(&backend);
    return asked == nullptr ? "" : asked->outpaced(problem);
}

}  // namespace voxspring
