// Runs tests on a SIMD target that is not the best one of this processor.
#pragma once

#include <hwy/targets.h>

#include <cstdint>
#include <stdexcept>
#include <string>

namespace voxspring::testing {

/// Makes Highway choose `target` until the end of the scope.
class ChosenTarget {
public:
    explicit ChosenTarget(std::int64_t target) { hwy::SetSupportedTargetsForTest(target); }
    ~ChosenTarget() { hwy::SetSupportedTargetsForTest(0); }
    ChosenTarget(const ChosenTarget&) = delete;
    ChosenTarget& operator=(const ChosenTarget&) = delete;
};

/// The target with that name; this processor has to support it.
inline std::int64_t simd_target(const std::string& name) {
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
        if (hwy::TargetName(target) == name) return target;
    }
    throw std::invalid_argument("no SIMD target " + name + " here");
}

}  // namespace voxspring::testing
