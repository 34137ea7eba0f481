// VOXSPRING_REQUIRE names the backends whose device must be available, by name or prefix
// (VOXSPRING_REQUIRE=cuda,gl_fragment). Without their device they fail, while others are skipped.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "backends/registry.h"

namespace voxspring::testing {

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

}  // namespace voxspring::testing
