// Backends as parameters of tests. VOXSPRING_REQUIRE names those whose device must be available, by name or
// prefix (VOXSPRING_REQUIRE=cuda,gl_fragment). Without their device they fail, while others are skipped.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <iterator>
#include <memory>
#include <sstream>
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

inline std::vector<std::string> required_prefixes() {
    const char* value = std::getenv("VOXSPRING_REQUIRE");
    std::istringstream list(value == nullptr ? "" : value);
    std::vector<std::string> prefixes;
    for (std::string item; std::getline(list, item, ',');) {
        std::string prefix;
        std::remove_copy(item.begin(), item.end(), std::back_inserter(prefix), ' ');
        // An empty name would be a prefix of every name.
        if (!prefix.empty()) prefixes.push_back(prefix);
    }
    return prefixes;
}

inline bool is_required(const std::string& backend) {
    const auto prefixes = required_prefixes();
    return std::any_of(prefixes.begin(), prefixes.end(),
                       [&](const std::string& prefix) { return backend.starts_with(prefix); });
}

/// For SetUp(): calls `make`, which needs a device of `backend`, and skips or fails the test without one.
template <class Make>
void skip_without(const std::string& backend, Make make) {
    try {
        make();
    } catch (const Unavailable& absent) {
        if (is_required(backend)) FAIL() << "required and unavailable: " << absent.what();
        GTEST_SKIP() << absent.what();
    }
}

/// For SetUp(): makes the backend, or leaves it null and skips or fails the test.
inline void make_or_skip(const BackendSpec& spec, std::unique_ptr<Backend>& backend) {
    skip_without(spec.entry->name, [&] { backend = spec.make(); });
}

/// Makes the backend that `text` specifies, which this build may have left out.
inline void make_or_skip(const std::string& text, std::unique_ptr<Backend>& backend) {
    const auto absent = left_out().find(text.substr(0, text.find(':')));
    if (absent == left_out().end()) return make_or_skip(BackendSpec::parse(text), backend);
    if (is_required(absent->first)) FAIL() << "required and not in this build: " << absent->second;
    GTEST_SKIP() << "not in this build: " << absent->second;
}

/// Tests of the backend that the parameter specifies.
class BackendTest : public ::testing::TestWithParam<std::string> {
protected:
    void SetUp() override { make_or_skip(spec, backend); }

    const BackendSpec spec = BackendSpec::parse(GetParam());
    std::unique_ptr<Backend> backend;
};

}  // namespace voxspring::testing
