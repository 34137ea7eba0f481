#include "harness/cli/arguments.h"

#include <fmt/format.h>
#include <malloc.h>
#include <omp.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <new>
#include <numeric>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <vector>

#include "backends/api.h"
#include "backends/cpu/parallel_options.h"
#include "backends/registry.h"
#include "backends/suggestion.h"
#include "completion_scripts.h"  // generated
#include "harness/base/bad_input.h"
#include "harness/base/files.h"
#include "harness/base/interruption.h"
#include "harness/base/progress.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/export/export.h"
#include "harness/process/worker_main.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {
namespace {

/// The values of the options, and the exit code of the command that ran.
struct Values {
    bool json = false;
    std::string scene, study, shell;
    RunOptions run;
    StudyOptions of_study;
    AdviseOptions advise;
    ViewOptions view;
    std::optional<double> timeout;
    int exit_code = 0;
};

/// Bounds of a time-out in seconds: from a millisecond to eleven days.
constexpr double min_timeout = 1e-3, max_timeout = 1e6;

const char* const scene_help =
    "Built-in scene (box, or resized: box@64, heart@120x102x92), scene file, volume file or mesh file";

// --- Parsing of values ---------------------------------------------------------------------------------

[[noreturn]] void refuse(const std::string& option, const std::string& text, const std::string& accepted) {
    throw BadInput("command line", option, text, accepted);
}

/// Parses a number from `low` to `high`. Throws BadInput with that range for any other text.
template <class Number>
Number number_of(const std::string& option, const std::string& text, Number low, Number high) {
    Number number{};
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, number);
    if (error == std::errc() && stop == end && number >= low && number <= high) return number;
    if constexpr (std::is_integral_v<Number>) {
        refuse(option, text, fmt::format("a whole number from {} to {}", low, high));
    } else {
        refuse(option, text, fmt::format("a number from {:g} to {:g}", low, high));
    }
}

template <class Target, class Number>
CLI::Option* add_number(CLI::App& command, const std::string& option, Target& target, Number low, Number high,
                        const std::string& description) {
    return command
        .add_option_function<std::string>(
            option,
            [=, &target](const std::string& text) { target = number_of<Number>(option, text, low, high); },
            description)
        ->type_name(std::is_integral_v<Number> ? "N" : "NUMBER");
}

/// Splits `text` at commas. The added comma at the end keeps CLI11 from dropping an empty last part.
std::vector<std::string> parts_of(const std::string& text) { return CLI::detail::split(text + ",", ','); }

/// Parses a vector such as "0,0,-0.002". With `one`, a single number is accepted too, for all components.
glm::dvec3 vector_of(const std::string& option, const std::string& text, double low, double high, bool one) {
    std::vector<std::string> parts = parts_of(text);
    if (one && parts.size() == 1) parts.resize(3, text);
    if (parts.size() != 3)
        refuse(option, text, one ? "one number, or three as X,Y,Z" : "three numbers as X,Y,Z");
    glm::dvec3 vector;
    for (int axis = 0; axis < 3; ++axis)
        vector[axis] = number_of(option, parts[std::size_t(axis)], low, high);
    return vector;
}

/// Parses --labels: numbers or names of segments. Names are not checked, since only the volume's file has
/// them.
std::vector<std::string> labels_of(const std::string& text) {
    std::vector<std::string> labels = parts_of(text);
    for (std::string& label : labels) CLI::detail::trim(label);
    const std::set<std::string> different(labels.begin(), labels.end());
    if (different.contains("")) refuse("--labels", text, "whole numbers or names of segments: 1,2,5");
    if (different.size() < labels.size()) refuse("--labels", text, "each label once");
    return labels;
}

/// Parses --devices: "4" means devices 0 to 3, "0,2" means devices 0 and 2. A list may repeat a number.
std::vector<int> devices_of(const std::string& text) {
    const std::vector<std::string> parts = parts_of(text);
    std::vector<int> devices;
    if (parts.size() == 1) {
        devices.resize(std::size_t(number_of("--devices", text, 1, max_ranks)));
        std::iota(devices.begin(), devices.end(), 0);
    } else {
        for (const std::string& part : parts)
            devices.push_back(number_of("--devices", part, 0, max_ranks - 1));
    }
    return devices;
}

// --- Options that commands share -----------------------------------------------------------------------

void add_scene(CLI::App& command, Values& values) {
    command.add_option("SCENE", values.scene, scene_help)->required();
}

void add_json(CLI::App& command, Values& values) { command.add_flag("--json", values.json, "Print JSON"); }

CLI::Option* add_repetitions(CLI::App& command, StudyOptions& study, const char* description) {
    return add_number(command, "--repetitions", study.repetitions, 1, 10'000, description);
}

/// Adds the option that chooses the device of `api`. The option sets an environment variable, which processes
/// that the command starts inherit.
void add_device(CLI::App& command, const Api& api) {
    const std::string option = device_option(api.name);
    command
        .add_option_function<std::string>(
            option,
            [&api, option](const std::string& wanted) {
                const std::vector<ListedDevice> devices = api.devices();
                if (devices_to_try(devices, wanted).empty())
                    refuse(option, wanted,
                           "the number or a part of the name of one of the devices: " +
                               (devices.empty() ? "there are none" : names_of(devices)));
                setenv(device_variable(api.name).c_str(), wanted.c_str(), 1);
            },
            "Device of " + api.title +
                "'s backends, by number or part of its name (default: the card that CUDA measures, or "
                "else the first that can be used)")
        ->type_name("DEVICE");
}
void add_devices(CLI::App& command) {
    for (const auto& [name, api] : apis()) {
        if (api.devices) add_device(command, api);
    }
}

/// Adds the options for a volume or mesh that has no scene file.
void add_volume_options(CLI::App& command, VolumeOptions& volume) {
    const auto add_text = [&](const std::string& name, const std::string& type, auto take,
                              const std::string& description) {
        return command.add_option_function<std::string>(name, take, description)->type_name(type);
    };
    CLI::Option* threshold = add_number(command, "--threshold", volume.threshold, -max_quantity, max_quantity,
                                        "Voxels with a larger value are active (default: 0)");
    std::vector<CLI::Option*> options = {
        threshold,
        add_text(
            "--labels", "LABEL,...", [&volume](const std::string& text) { volume.labels = labels_of(text); },
            "Active voxels: those with one of these values, 1,2,5, or in one of these named segments")
            ->excludes(threshold),
        add_number(command, "--frame", volume.frame, 0, 1'000'000'000,
                   "Which of several values per voxel to use, such as the time of a 4D file; counted from 0"),
        add_text(
            "--spacing", "LENGTH",
            [&volume](const std::string& text) {
                volume.spacing = vector_of("--spacing", text, min_quantity, max_quantity, true);
            },
            "Distance between voxel centres, one number or three as X,Y,Z (default: the file's)"),
        add_number(
            command, "--pitch", volume.pitch, min_quantity, max_quantity,
            "Edge length of cubic voxels: of those made from a mesh, or that replace a volume's voxels"),
        add_number(command, "--fill", volume.fill, min_quantity, 1.0,
                   "A voxel is active if at least this share of it is in the body (default: 0.5)"),
        add_text(
            "--gravity", "X,Y,Z",
            [&volume](const std::string& text) {
                volume.gravity = vector_of("--gravity", text, -max_quantity, max_quantity, false);
            },
            "Gravity as X,Y,Z; in m/s2 if --young is given (default: that of the scene heart, each component "
            "times the spacing along its axis; with --young, 9.81 m/s2 in the same direction)"),
        add_text(
            "--parts", "largest|N",
            [&volume](const std::string& text) {
                volume.parts = PartsToKeep{};
                if (text == "largest") return;
                std::int64_t least = 0;
                const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), least);
                if (error != std::errc() || *stop != '\0' || least < 2 || least > max_part_particles)
                    refuse("--parts", text,
                           fmt::format("largest, or a whole number from 2 to {}", max_part_particles));
                volume.parts->least = std::size_t(least);
            },
            "Parts to keep of a body that springs do not join into one: only the largest part, or all parts "
            "of at least N particles (default: all)")};
    CLI::Option* young = add_text(
        "--young", "MODULUS",
        [&volume](const std::string& text) {
            volume.young = pascals_of(text);
            if (!volume.young) refuse("--young", text, accepted_young);
        },
        "Young's modulus, 5000 (Pa) or \"5 kPa\"; with --density, sets spring stiffness and mass");
    CLI::Option* density = add_text(
        "--density", "DENSITY",
        [&volume](const std::string& text) {
            volume.density = kilograms_per_cubic_metre_of(text);
            if (!volume.density) refuse("--density", text, accepted_density);
        },
        "Density, 1050 (kg/m3) or \"1.05 g/cm3\"; needs --young");
    options.insert(
        options.end(),
        {young->needs(density), density->needs(young),
         add_text(
             "--unit", "m|cm|mm|um",
             [&volume](const std::string& text) {
                 if (!metres_in(text)) refuse("--unit", text, accepted_lengths());
                 volume.unit = text;
             },
             "Unit of the spacing; needs --young (default: the file's)")
             ->needs(young),
         add_number(command, "--damping", volume.damping, 0.0, max_quantity,
                    "Share of its velocity that a particle loses per second (default: 0.00115 per step)"),
         command.add_flag(
             "--corners", volume.corners,
             "Place particles at the corners of voxels, not at their centres: the body is then as "
             "wide as its voxels, and its surface as stiff as the material")});
    for (CLI::Option* option : options) option->group("For a volume or mesh without a scene file");
}

// --- Commands ------------------------------------------------------------------------------------------

void add_list(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* list = app.add_subcommand(
        "list", "List backends (or why one is not available), built-in scenes and studies");
    add_json(*list, values);
    add_devices(*list);
    list->callback([&] { list_everything(values.json, out); });
}

void add_limits(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* limits = app.add_subcommand(
        "limits", "Measure what each device can do at best: bandwidth, arithmetic, launches");
    add_json(*limits, values);
    add_devices(*limits);
    limits->callback([&] { list_limits(values.json, out); });
}

void add_info(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* info = app.add_subcommand(
        "info", "Print what a scene contains, the memory it needs and its stable time step");
    add_scene(*info, values);
    add_json(*info, values);
    add_volume_options(*info, values.run.volume);
    info->callback([&] { describe_scene(values.scene, values.run.volume, values.json, out); });
}

void add_export_options(CLI::App& run, ExportOptions& out) {
    run.add_option("--out", out.out,
                   "Write the final state to this file; its ending sets the format; may be repeated:" +
                       list_formats())
        ->allow_extra_args(false);
    add_number(
        run, "--every", out.every, 1, max_run_steps,
        "Write a series of files, one after each N steps: body_000100.vtu, ..., for ParaView also body.pvd");
    run.add_option_function<std::string>(
        "--frames",
        [&out](const std::string& folder) {
            if (folder.empty()) refuse("--frames", "\"\"", "the path of a folder");
            out.frames = folder;
        },
        "Write a series of pictures to this folder, one after each --every steps (default: at most 50 "
        "pictures)");
    run.add_option("--colour", out.colour,
                   "What the colours of pictures show: displacement, or error against float64");
    run.add_option("--size", out.size, "WIDTHxHEIGHT of pictures in pixels (default: 1280x960)");
    run.add_option(
        "--tool-force", out.tool_force,
        "Write the force on the tool to this .csv file, after each --every steps (default: after each move "
        "of the tool)");
}

void add_run(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* run = app.add_subcommand("run", "Run one simulation on one backend");
    RunOptions& options = values.run;
    add_scene(*run, values);
    run->add_option("--backend", options.backend,
                    "NAME[:key=value,...] (see `voxspring list`), or auto[:formulation=...,precision=...] "
                    "for the fastest")
        ->required();
    CLI::Option* steps =
        add_number(*run, "--steps", options.steps, 1, max_run_steps, "Time steps from the scene's start")
            ->default_str("100");
    add_number(*run, "--time", options.time, min_quantity, max_quantity,
               "Simulated time in the scene's unit, instead of --steps")
        ->excludes(steps);
    add_number(
        *run, "--time-step", options.time_step, min_quantity, max_quantity,
        "Time step (default: the scene's); damping is adapted to it, so that the motion stays the same");
    run->add_option(
        "--resume", options.resume,
        "Continue from this .npz, which --out or `voxspring view` wrote: from its step, with its springs");
    add_export_options(*run, options.out);
    add_devices(*run);
    add_volume_options(*run, options.volume);
    run->callback([&] { values.exit_code = run_scene(values.scene, options, out); });
}

/// Adds --ranks and --devices. `when`, the beginning of their help texts, says when they apply: "For a
/// scaling study: ".
void add_ranks(CLI::App& command, StudyOptions& options, const std::string& when) {
    add_number(command, "--ranks", options.ranks, 1, max_ranks,
               when + "maximum number of parts of the body, each on a thread (default: one per core)");
    command
        .add_option_function<std::string>(
            "--devices", [&options](const std::string& text) { options.devices = devices_of(text); },
            when + "a part of the body on each of the first N CUDA devices, or on those listed: 0,1")
        ->type_name("N or N,N,...");
}

void add_study(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* study = app.add_subcommand("study", "Time and verify scenes on several backends");
    StudyOptions& options = values.of_study;
    study->add_option("STUDY", values.study, "Built-in study or study file")->required();
    CLI::Option* file = study->add_option("--out", options.out, "Write the result to this .json file");
    study->add_option("--backend", options.backends,
                      "Only backends that match one of these globs; !GLOB leaves out those that match it");
    study->add_option(
        "--scene", options.scenes,
        "Only the study's scenes that match one of these globs; another scene's name adds that scene");
    add_repetitions(*study, options, "Number of timed batches of each backend on each scene");
    add_ranks(*study, options, "For a scaling study: ");
    study->add_flag("--resume", options.resume, "Continue the interrupted study whose result --out names")
        ->needs(file);
    add_number(*study, "--timeout", values.timeout, min_timeout, max_timeout,
               "A backend fails if it reports nothing for this many seconds")
        ->default_str("1800");
    add_devices(*study);
    add_volume_options(*study, options.volume);
    study->callback([&] {
        if (values.timeout) options.timeout = std::chrono::duration<double>(*values.timeout);
        values.exit_code = run_and_print_study(values.study, options, out);
    });
}

void add_advise(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* advise =
        app.add_subcommand("advise",
                           "Find the fastest backend, formulation, precision and time step for an "
                           "error, or whether several ranks are faster than one");
    AdviseOptions& options = values.advise;
    add_scene(*advise, values);
    // float64 resolves no error below this range, and an error above this range says nothing.
    add_number(*advise, "--error", options.error, 1e-30, 1e6,
               "Largest accepted total error: relative L2 error of the displacement");
    advise->add_flag("--continuum", options.continuum,
                     "--error is the error of a deflection against the continuum, for several pitches; "
                     "SCENE is a case of the study truth, such as cantilever");
    add_ranks(*advise, options.study, "Instead of an error: ");
    CLI::Option* results = advise->add_option(
        "--results", options.results,
        "Read this result (.json) of a pareto, truth or scaling study, instead of measuring");
    advise->add_option("--backend", options.study.backends, "Only backends that match one of these globs")
        ->excludes(results);
    add_repetitions(*advise, options.study, "Number of timed runs of each candidate")->excludes(results);
    add_devices(*advise);
    CLI::Option* file = advise
                            ->add_option("--out", options.study.out,
                                         "Write the measurements to this .json file, which --results reads")
                            ->excludes(results);
    advise
        ->add_flag("--resume", options.study.resume,
                   "Continue the interrupted measurement whose result --out names")
        ->needs(file);
    add_json(*advise, values);
    add_volume_options(*advise, options.study.volume);
    advise->callback([&] {
        options.json = values.json;
        values.exit_code = print_advice(values.scene, options, out);
    });
}

void add_view(CLI::App& app, Values& values, std::ostream& out, const ViewScene& view) {
    CLI::App* command = app.add_subcommand("view", "Show the live body in a window: pull it, cut it, sew it");
    ViewOptions& options = values.view;
    add_scene(*command, values);
    command
        ->add_option("--backend", options.backend,
                     "Backend, as for `voxspring run`; may be changed in the window")
        ->default_str("auto");
    add_number(*command, "--steps", options.steps, 1, 1'000'000,
               "Steps per frame (default: as many as fit into a frame)");
    command
        ->add_option_function<std::string>(
            "--size", [&options](const std::string& text) { options.size = parse_size(text); },
            "WIDTHxHEIGHT of the window, in pixels of an unscaled display")
        ->type_name("SIZE")
        ->default_str("1280x800");
    add_number(*command, "--seconds", options.seconds, min_timeout, max_timeout,
               "Close the window after this many seconds");
    command->add_option("--save", options.save,
                        "The .npz file to which the key w writes the state (default: SCENE.npz)");
    add_devices(*command);
    add_volume_options(*command, options.volume);
    command->callback([&] { values.exit_code = view(values.scene, options, out); });
}

// --- Completion in shells ------------------------------------------------------------------------------

std::vector<std::string> command_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
        names.push_back(command->get_name());
    return names;
}

std::vector<std::string> option_names(const CLI::App& command) {
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options()) {
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
    return names;
}

/// The words that the option or argument `name` accepts; empty if they cannot be listed.
std::vector<std::string> values_of(const std::string& name) {
    std::vector<std::string> words;
    if (name == "SCENE" || name == "--scene") {
        for (const auto& scene : builtin_scenes()) words.push_back(scene.name);
    } else if (name == "STUDY") {
        for (const auto& study : builtin_studies()) words.push_back(study.name);
    } else if (name == "--backend") {
        words = {"auto"};
        for (const auto& [backend, entry] : registry()) words.push_back(backend);
    } else if (name == "--colour") {
        words = {"displacement", "error"};
    } else if (name == "SHELL") {
        words = {"bash", "zsh"};
    }
    return words;
}

/// The words that the last of `words` may be completed to, besides files. `words` are the words of the
/// command line after the program's name.
std::vector<std::string> completions_of(const CLI::App& app, const std::vector<std::string>& words) {
    std::vector<std::string> names = command_names(app);
    if (words.size() < 2) {
        names.insert(names.end(), {"--help", "--version"});
        return names;
    }
    if (std::find(names.begin(), names.end(), words[0]) == names.end()) return {};
    const CLI::App& command = *app.get_subcommand(words[0]);
    if (words.back().starts_with("-")) return option_names(command);
    const std::string& before = words[words.size() - 2];
    if (const CLI::Option* option = command.get_option_no_throw(before);
        option && option->get_type_size() > 0)
        return values_of(before);
    for (const CLI::Option* option : command.get_options()) {
        if (option->get_positional()) return values_of(option->get_name(true));
    }
    return {};
}

void add_completion(CLI::App& app, Values& values, std::ostream& out) {
    CLI::App* completion = app.add_subcommand(
        "completion",
        "Print a script with which a shell completes commands, options, scenes, studies and backends");
    completion->add_option("SHELL", values.shell, "bash or zsh")->required();
    completion->footer(
        "For this shell: source <(voxspring completion bash). For good: write it to\n"
        "~/.local/share/bash-completion/completions/voxspring, or for zsh to _voxspring in a folder of "
        "$fpath;\n"
        "`cmake --install` does so for all users.");
    completion->callback([&] {
        const auto script = completion_scripts.find("completion." + values.shell);
        if (script == completion_scripts.end()) refuse("completion", values.shell, "bash or zsh");
        out << script->second;
    });
}

// --- Unknown commands and options ----------------------------------------------------------------------

/// Throws BadInput if the first word is neither a command nor an option of the program.
void check_command(const CLI::App& app, int argc, char** argv) {
    if (argc < 2 || argv[1][0] == '-') return;
    const std::vector<std::string> names = command_names(app);
    const std::string word = argv[1];
    if (word == worker_word) refuse("command", word, refusal_of_worker_by_hand);
    if (std::find(names.begin(), names.end(), word) == names.end())
        refuse("command", word, "one of " + joined(names) + did_you_mean(word, names));
}

/// Throws BadInput if the command line has an unknown option. Called after `app` has failed to parse.
void check_options(const CLI::App& app) {
    const std::vector<CLI::App*> parsed = app.get_subcommands();
    const CLI::App& command = parsed.empty() ? app : *parsed.front();
    const std::vector<std::string> names = option_names(command);
    for (const std::string& word : app.remaining(true)) {
        const std::string name = word.substr(0, word.find('='));
        if (name.starts_with("-") && std::find(names.begin(), names.end(), name) == names.end())
            refuse(parsed.empty() ? "" : command.get_name(), name,
                   "one of " + joined(names) + did_you_mean(name, names));
    }
}

}  // namespace

int run_command_line(int argc, char** argv, std::ostream& out, const ViewScene& view) {
    // The commands that are scripts parse their options themselves.
    if (argc > 1 && scripts().contains(argv[1])) return run_script(argv[1], {argv + 2, argv + argc});
    CLI::App app{"Voxspring compares GPU APIs and data layouts for volumetric mass-spring-damper models."};
    app.name("voxspring");
    app.require_subcommand(1);
    app.set_version_flag("--version", version_text());
    app.footer(
        "Exit codes: 0 done; 1 a backend failed or is not available, an error exceeded its tolerance,\n"
        "nothing was measured, advise found no run, or diff found something worse; 2 bad input or usage;\n"
        "130 interrupted. Progress goes to standard error: one line on a terminal, elsewhere one every ten\n"
        "seconds (VOXSPRING_PROGRESS_SECONDS).");
    Values values;
    add_list(app, values, out);
    add_limits(app, values, out);
    add_info(app, values, out);
    add_run(app, values, out);
    add_view(app, values, out, view);
    add_study(app, values, out);
    add_advise(app, values, out);
    for (const auto& [name, script] : scripts()) app.add_subcommand(name, script.description);
    add_completion(app, values, out);
    if (argc > 2 && argv[1] == std::string("completion") && argv[2] == std::string("words")) {
        for (const std::string& word : completions_of(app, {argv + 3, argv + argc})) out << word << "\n";
        return 0;
    }
    check_command(app, argc, argv);
    (void)time_between_lines();  // refuses a wrong value before anything is written
    // Ctrl-C ends the program at once, except while a command catches the signal to finish its work.
    const CaughtInterruptions caught(true);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error, out, std::cerr);
        check_options(app);
        app.exit(error, out, std::cerr);
        return 2;
    }
    return values.exit_code;
}

namespace {

int exit_code_of(int argc, char** argv, const ViewScene& view) {
    try {
        return run_command_line(argc, argv, std::cout, view);
    } catch (const BadInput& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const BadSpecification& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const std::bad_alloc&) {
        std::cerr << "voxspring: out of memory: this command needs more than the machine has; "
                     "`voxspring info SCENE` shows what a scene needs on each backend\n";
        return 1;
    } catch (const std::exception& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 1;
    }
}

}  // namespace

int run_program(int argc, char** argv, const ViewScene& view) {
    // Freed memory is kept for reuse, so that the system need not map memory and clear its pages again: every
    // row of a study allocates and frees states, which are large in a large scene.
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, -1);  // never return memory to the system
    occupy_standard_descriptors();
    // With this signal ignored, write() at the limit on file sizes fails instead of ending the process.
    std::signal(SIGXFSZ, SIG_IGN);
    // The program may have inherited that this signal is ignored. waitpid() and pclose() would then not
    // report how a process ended, and every Python would seem to fail.
    std::signal(SIGCHLD, SIG_DFL);
    // OpenMP overflows the stack if it is asked for very many threads.
    const int threads = omp_get_max_threads();
    if (threads > cpu_parallel::max_threads) omp_set_num_threads(cpu_parallel::max_threads);
    worker_main(argc, argv);
    if (threads > cpu_parallel::max_threads)
        std::cerr << fmt::format("voxspring: OMP_NUM_THREADS is {}; {} threads are used at most\n", threads,
                                 cpu_parallel::max_threads);
    const int code = exit_code_of(argc, argv, view);
    // That a disk is full may show only when buffered output is written.
    if (!std::cout.flush()) {
        std::cerr << "voxspring: not all of the output could be written to standard output\n";
        return code == 0 ? 1 : code;
    }
    return code;
}

}  // namespace voxspring
