// Backends as parameters of tests.
#pragma once

#include <gtest/gtest.h>

#include <cctype>
#include <string>
#include <vector>

#include "backends/registry.h"

namespace voxspring::testing {

/// Every backend, or only those with the tuning parameter `key`, in every precision and formulation.
inline std::vector<std::string> in_every_formulation(const std::string& key = "") {
    std::vector<std::string> all;
    for (const auto& [name, entry] : registry()) {
        if (!key.empty() && !entry.tuning.contains(key)) continue;
        for (const Precision precision : entry.precisions) {
            for (const Formulation formulation : entry.formulations)
                all.push_back(name + ":precision=" + to_string(precision) +
                              ",formulation=" + to_string(formulation));
        }
    }
    return all;
}

/// A text as the name of a test.
inline std::string name_of_test(std::string name) {
    for (char& c : name) {
        if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
    }
    return name;
}
/// A specification as the name of its tests.
inline std::string test_name(const ::testing::TestParamInfo<std::string>& tested) {
    return name_of_test(tested.param);
}

}  // namespace voxspring::testing
