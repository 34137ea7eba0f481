// The tuning parameters that every strategy has.
#pragma once

#include <map>
#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// `own` together with the shared parameters.
inline std::map<std::string, TuningValues> tuning(std::map<std::string, TuningValues> own) {
    // Compile in the terms that the scene needs, or all of them, chosen at run time.
    own["terms"] = {"needed", "all"};
    return own;
}

}  // namespace voxspring::cuda
