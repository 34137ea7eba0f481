// `voxspring completion`: what a shell needs in order to complete the program's command line.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace voxspring {

/// What may stand in the place of a value.
enum class ValueKind : std::uint8_t {
    none,  ///< the option takes no value
    scene,
    study,
    backend,
    colour,
    shell,
    file,
    folder,
    other,  ///< nothing that could be listed
};

struct OptionWords {
    std::string name;  ///< with its dashes
    std::string description;
    ValueKind value = ValueKind::none;
};

struct CommandWords {
    std::string name;
    std::string description;
    std::vector<OptionWords> options;
    std::vector<ValueKind> arguments;  ///< those without an option, in their order
};

/// A script for the shell "bash" or "zsh". The names of scenes, studies and backends are those of this build.
/// Throws BadInput for another shell.
std::string completion_script(const std::string& shell, const std::vector<CommandWords>& commands);

}  // namespace voxspring
