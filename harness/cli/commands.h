// The commands of the program, with their options as C++ structures.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "harness/export/export.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {

/// The program's version as text: "voxspring 0.1.0 (commit 0123456789ab)".
std::string version_text();

/// `voxspring list`: prints all backends (for those that are not available, why), the devices of each API,
/// and built-in scenes and studies.
void list_everything(bool json, std::ostream& out);

/// `voxspring limits`: measures and prints the limits of each device: bandwidth, arithmetic, launch time.
void list_limits(bool json, std::ostream& out);

/// `voxspring info`: prints the size, particles, springs, memory and time step of a scene. Throws BadInput.
void describe_scene(const std::string& scene, const VolumeOptions& volume, bool json, std::ostream& out);

/// The largest number of steps of a run.
inline constexpr int max_run_steps = 1'000'000'000;

struct RunOptions {
    std::string backend;
    int steps = 100;                              ///< number of the last step, from the scene's start
    std::optional<double> time;                   ///< end time instead of `steps`, in the scene's unit
    std::optional<double> time_step;              ///< replaces the scene's time step; empty: it is kept
    std::optional<std::filesystem::path> resume;  ///< the .npz file to continue from
    VolumeOptions volume;
    ExportOptions out;
};

/// `voxspring run`: runs a scene on a backend and returns the exit code. Throws BadInput, BadSpecification
/// and, if the run fails, std::runtime_error.
int run_scene(const std::string& scene, const RunOptions& options, std::ostream& out);

/// The command that runs `backend` on the same body and device, each word as a shell reads it: "voxspring run
/// SCENE --labels 2 --backend vulkan_implicit --vulkan-device 1".
std::string run_command_of(const std::string& scene, const VolumeOptions& volume, const std::string& backend);

/// `voxspring study`: runs a study, prints its result and returns the exit code. Throws BadInput,
/// BadSpecification.
int run_and_print_study(const std::string& study, const StudyOptions& options, std::ostream& out);

struct AdviseOptions {
    /// The largest acceptable total error, relative L2. Empty: the advice is whether several ranks, each with
    /// a part of the body, are faster than one.
    std::optional<double> error;
    /// Whether `error` is the error of a deflection at rest against the continuum. If so, the scene is the
    /// name of a case of the study `truth`, such as cantilever.
    bool continuum = false;
    /// The result of a pareto, truth or scaling study to take the advice from; empty: measure.
    std::optional<std::filesystem::path> results;
    StudyOptions study;  ///< how to measure; `study.volume` applies to the scene
    bool json = false;
};

/// `voxspring advise`: prints advice and returns the exit code, which is 1 if no configuration reaches the
/// error or nothing was measured. If the measurement is interrupted, the advice follows from what was
/// measured until then, and the exit code is 130. Throws BadInput, BadSpecification.
int print_advice(const std::string& scene, const AdviseOptions& options, std::ostream& out);

// --- `voxspring report` and `voxspring diff`: Python scripts that come with the program ----------------

/// What a script does, and what it needs: `modules` are the Python modules that it imports, `packages` the
/// Debian packages that contain them, empty unless Debian has all of them.
struct Script {
    std::string description, modules, packages;
};
/// All scripts. The key is the command that starts the script.
const std::map<std::string, Script>& scripts();

/// Replaces this process by the script of `command` with these arguments; returns only by throwing. The
/// script is looked for in results/ and share/voxspring/results/ in the program's folder and in the three
/// folders above. Throws BadInput if the script is not found, or if no Python of this machine has the modules
/// that it needs.
int run_script(const std::string& command, const std::vector<std::string>& arguments);

}  // namespace voxspring
