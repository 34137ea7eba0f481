// Expands a study's patterns and the command line's globs into backends and scenes.
#pragma once

#include <string>
#include <vector>

#include "backends/registry.h"
#include "harness/study/study.h"

namespace voxspring {

/// Whether `text` matches `glob`, a pattern as in a shell.
bool matches(const std::string& glob, const std::string& text);

/// Whether a backend's name or its label matches `glob`.
bool matches(const std::string& glob, const BackendSpec& spec);

/// The specifications that a pattern GLOB[:options] stands for, in the registry's order. KEY=* stands for
/// each value that the backend lists for the key. Backends that do not take the options are left out. Throws
/// BadSpecification if backends match but none of them takes the options.
std::vector<BackendSpec> expand(const std::string& pattern);
/// The specifications of all `patterns`, without repetition. Patterns may name backends that this build left
/// out.
std::vector<BackendSpec> expand_all(const std::vector<std::string>& patterns);
/// Whether a pattern names a backend that this build left out.
bool matches_left_out(const std::string& pattern);

/// Whether a glob of the command line leaves backends out: "!cpu_*".
bool leaves_out(const std::string& glob);

/// Applies the command line's --backend to a scene's cases: it removes some of them, and may add others. The
/// glob `auto` adds none, since the rules' choice is not known here.
std::vector<BackendSpec> select(std::vector<BackendSpec> specs, const std::vector<std::string>& globs);

/// The backend patterns of an item: its own if it has some, otherwise those of the study.
const std::vector<std::string>& patterns_of(const Study& study, const StudyScene& item);
/// The backends that are known before the scene is loaded: all except those that rules choose for `auto`.
std::vector<BackendSpec> known_specs(const Study& study, const StudyScene& item);
/// Whether there are known_specs(), or the rules choose a backend for the scene.
bool has_backends(const Study& study, const StudyScene& item);

/// Applies --scene to the study's scenes: it keeps some of them, each once, and may add others.
void select_scenes(Study& study, const std::vector<std::string>& globs);

/// Distributes the globs of --backend over the study's scenes, as StudyOptions::backends says. A glob that
/// matches backends of the study applies to the scenes that have these, and a "!GLOB" to all scenes. Removes
/// items that are left without a backend, and returns the names of the scenes that then have no item. Throws
/// BadInput for a glob that no backend matches, for a "!GLOB" with options (NAME:key=value), and if all
/// scenes are left without a backend. Also throws what expand() throws.
std::vector<std::string> select_backends(Study& study, const std::vector<std::string>& globs);

/// The globs "!GLOB" of --backend that leave nothing out: they match no backend of the study's scenes and
/// none that another glob names. Empty if the study or a glob asks for `auto`, or if the study lists no
/// scenes. To be called before select_backends(), which changes the study.
std::vector<std::string> globs_without_effect(const Study& study, const std::vector<std::string>& globs);

/// Text for the message about a `pattern` that matches no backend: what is accepted, and which name may have
/// been meant.
std::string accepted_globs(const std::string& pattern);

}  // namespace voxspring
