// The command line: its commands, its options and the values that they accept.
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
    std::optional<std::filesystem::path> save;  ///< where the key w saves the state; empty: SCENE.npz
};

/// `voxspring view`, which needs a display: shows the scene and returns the exit code.
using ViewScene = std::function<int(const std::string& scene, const ViewOptions& options, std::ostream& out)>;

/// Runs the command line and returns the exit code. Throws BadInput, BadSpecification and what the commands
/// throw.
int run_command_line(int argc, char** argv, std::ostream& out, const ViewScene& view);

/// The main function of a program with this command line, on standard output. If a study started this process
/// as a worker, it serves as one. Exit codes: 0 (done), 1 (a backend failed, an error exceeded its tolerance,
/// or nothing was measured), 2 (bad input or usage), 130 (interrupted).
int run_program(int argc, char** argv, const ViewScene& view);

}  // namespace voxspring
