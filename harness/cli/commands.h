// The subcommands, without the parsing of the command line.
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

/// The version: "voxspring 0.1.0 (commit 0123456789ab)".
std::string version_text();

/// `voxspring list`: backends, with the reason if one is not available; built-in scenes and studies.
void list_everything(bool json, std::ostream& out);

/// `voxspring limits`: measures the limits of each device.
void list_limits(bool json, std::ostream& out);

/// `voxspring info`: dims, particles, springs, memory and time step of a scene. Throws BadInput.
void describe_scene(const std::string& scene, const VolumeOptions& volume, bool json, std::ostream& out);

/// The largest number of steps of a run.
inline constexpr int max_run_steps = 1'000'000'000;

struct RunOptions {
    std::string backend;
    int steps = 100;                              ///< the step at which the run ends, from the scene's start
    std::optional<double> time;                   ///< end time instead of `steps`, in the scene's unit
    std::optional<double> time_step;              ///< replaces the scene's time step; empty: it is kept
    std::optional<std::filesystem::path> resume;  ///< the .npz file to continue from
    VolumeOptions volume;
    ExportOptions out;
};

/// `voxspring run`: returns the exit code. Throws BadInput, BadSpecification.
int run_scene(const std::string& scene, const RunOptions& options, std::ostream& out);

/// `voxspring study`: returns the exit code. Throws BadInput, BadSpecification.
int run_and_print_study(const std::string& study, const StudyOptions& options, std::ostream& out);

struct AdviseOptions {
    /// The largest acceptable total error, relative L2. Empty: the advice is whether several ranks are faster
    /// than one.
    std::optional<double> error;
    /// Whether `error` is that of a deflection at rest against the continuum. The scene is then a case of the
    /// study `truth`.
    bool continuum = false;
    std::optional<std::filesystem::path> results;  ///< a pareto, truth or scaling result; empty: measure
    StudyOptions study;                            ///< how to measure; `study.volume` is for the scene
    bool json = false;
};

/// `voxspring advise`: returns the exit code, 1 if no configuration reaches the error. An interruption ends
/// the measurement, and the advice is based on what was measured until then. Throws BadInput,
/// BadSpecification.
int print_advice(const std::string& scene, const AdviseOptions& options, std::ostream& out);

// --- `voxspring report` and `voxspring diff`: Python scripts that come with the program ----------------

/// What a script does, and the Python packages that it needs: `modules` are their import names, `packages`
/// their Debian packages, empty unless Debian has every one of them.
struct Script {
    std::string description, modules, packages;
};
/// All scripts, by the command that starts each.
const std::map<std::string, Script>& scripts();

/// Replaces this process by the script with these arguments; returns only by throwing. The script is looked
/// for in the folders results/ and share/voxspring/results/ beside the program and above it: in the source
/// tree, an installation or a package. Throws BadInput if it is not found, or if no Python here has the
/// packages that it needs.
int run_script(const std::string& command, const std::vector<std::string>& arguments);

}  // namespace voxspring
