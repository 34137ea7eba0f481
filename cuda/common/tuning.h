// The tuning parameters that every strategy has.
#pragma once

#include <map>
#include <string>

#include "backends/registry.h"

namespace voxspring::cuda {

/// Whether a step is launched while the one before it still runs, of strategies with one kernel a step.
inline const TuningValues dependent_launches = {"off", "on"};

/// `own` and the shared ones.
inline std::map<std::string, TuningValues> tuning(std::map<std::string, TuningValues> own) {
    // What a scene needs, or everything, decided at run time.
    own["terms"] = {"needed", "all"};
    // Whether strain_density() takes the hardware's root and reciprocal as they are or with a Newton step.
    own["root"] = {"hardware", "refined"};
    return own;
}

}  // namespace voxspring::cuda
