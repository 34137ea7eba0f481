// Which backends a study's patterns and the command line's globs stand for.
#pragma once

#include <string>
#include <vector>

#include "backends/registry.h"

namespace voxspring {

/// Whether `text` matches a shell's pattern.
bool matches(const std::string& glob, const std::string& text);

/// Whether a backend's name or its label does.
bool matches(const std::string& glob, const BackendSpec& spec);

/// The specifications that a pattern GLOB[:options] stands for, in the registry's order. KEY=* is each value
/// that the backend has for it. Those that do not take the options are left out; throws BadSpecification if
/// there are some and none does.
std::vector<BackendSpec> expand(const std::string& pattern);
/// All of `patterns` without repetition. A study may name backends that this build left out.
std::vector<BackendSpec> expand_all(const std::vector<std::string>& patterns);
/// Whether a pattern names a backend that this build left out.
bool matches_left_out(const std::string& pattern);

/// Whether a glob of the command line says what is not to take part: "!cpu_*".
bool leaves_out(const std::string& glob);

/// What the command line's --backend leaves of a scene's cases, and what it adds to them.
std::vector<BackendSpec> select(std::vector<BackendSpec> specs, const std::vector<std::string>& globs);

/// "cpu_parallel, cpu_reference, ..."
std::string registered_names();

/// What stands for backends that `pattern` does not match, for messages; and which one may have been meant.
std::string accepted_globs(const std::string& pattern);

}  // namespace voxspring
