// The command line: parses commands and options, and runs a command.
#pragma once

#include <filesystem>
#include <functional>
#include <glm/vec2.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "harness/scene/scene.h"

namespace voxspring {

/// The options of `voxspring view`.
struct ViewOptions {
    std::string backend = "auto";
    VolumeOptions volume;
    glm::ivec2 size{1280, 800};                 ///< size of the window, in the window system's units
    std::optional<int> steps;                   ///< steps per frame; empty: as many as fit into a frame
    std::optional<double> seconds;              ///< time after which the window closes by itself
    std::optional<std::filesystem::path> save;  ///< the file that the key w writes; empty: SCENE.npz
};

/// The function that runs `voxspring view`: it shows the scene in a window and returns the exit code.
using ViewScene = std::function<int(const std::string& scene, const ViewOptions& options, std::ostream& out)>;

/// Parses the command line, runs the command and returns the exit code. `view` runs `voxspring view`. Throws
/// BadInput, BadSpecification and what the commands throw.
int run_command_line(int argc, char** argv, std::ostream& out, const ViewScene& view);

/// The main function of a program with this command line. It prints to standard output, and errors to
/// standard error. If a study has started this process as a worker, it does not return. Exit codes: 0 (done),
/// 1 (a backend failed, an error exceeded its tolerance, nothing was measured, or anything else went wrong),
/// 2 (bad input or usage), 130 (interrupted).
int run_program(int argc, char** argv, const ViewScene& view);

}  // namespace voxspring
