// `voxspring completion`: scripts by which a shell completes the program's command line.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace voxspring {

/// What kind of value an option or argument takes.
enum class ValueKind : std::uint8_t {
    none,  ///< the option takes no value
    scene,
    study,
    backend,
    colour,
    shell,
    file,
    folder,
    other,  ///< a value that cannot be listed
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
    std::vector<ValueKind> arguments;  ///< positional arguments, in their order
};

/// The script for the shell "bash" or "zsh", with the scenes, studies and backends of this build. Throws
/// BadInput for another shell.
std::string completion_script(const std::string& shell, const std::vector<CommandWords>& commands);

}  // namespace voxspring
