#include "harness/cli/arguments.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <numeric>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "backends/api.h"
#include "backends/registry.h"
#include "backends/suggestion.h"
#include "harness/base/bad_input.h"
#include "harness/base/interruption.h"
#include "harness/base/text.h"
#include "harness/cli/commands.h"
#include "harness/cli/completion.h"
#include "harness/cli/scripts.h"
#include "harness/export/export.h"
#include "harness/process/worker_main.h"
#include "harness/scene/scene.h"
#include "harness/study/study.h"

namespace voxspring {
namespace {

/// The values of the options, and the exit code of the command that ran.
struct Asked {
    bool json = false;
    std::string scene, study, shell;
    RunOptions run;
    StudyOptions of_study;
    AdviseOptions advise;
    ViewOptions view;
    int exit_code = 0;
};

constexpr std::int64_t max_steps = max_run_steps;
constexpr std::int64_t last_frame = 1'000'000'000;
constexpr std::int64_t max_repetitions = 10'000;
constexpr std::int64_t max_steps_a_frame = 1'000'000;
/// Bounds of --error: float64 resolves no smaller errors, and larger ones say nothing.
constexpr double min_error = 1e-30, max_error = 1e6;
/// A millisecond to eleven days.
constexpr double min_timeout = 1e-3, max_timeout = 1e6;

const char* const scene_help =
    "Built-in scene (box, or resized: box@64, heart@120x102x92), scene file or volume file";

// --- Values --------------------------------------------------------------------------------------------

template <class Number>
std::string range_text(Number low, Number high) {
    if constexpr (std::is_integral_v<Number>) return fmt::format("{} to {}", low, high);
    return fmt::format("{:g} to {:g}", double(low), double(high));
}

/// The number that `text` is as a whole. Refuses other text and numbers out of range, and names the range.
template <class Number>
Number number_of(const std::string& option, const std::string& text, Number low, Number high) {
    Number number{};
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, number);
    if (error != std::errc() || stop != end || !(number >= low && number <= high)) {
        const char* kind = std::is_integral_v<Number> ? "a whole number from " : "a number from ";
        throw BadInput("command line", option, text, kind + range_text(low, high));
    }
    return number;
}

template <class Number>
CLI::Option* add_number(CLI::App& command, const std::string& option, Number low, Number high,
                        const std::function<void(Number)>& take, const std::string& description) {
    return command
        .add_option_function<std::string>(
            option, [=](const std::string& text) { take(number_of<Number>(option, text, low, high)); },
            description)
        ->type_name(std::is_integral_v<Number> ? "N" : "NUMBER");
}

std::vector<std::string> split(const std::string& text, char between) {
    std::vector<std::string> parts(1);
    for (const char c : text) {
        if (c == between) {
            parts.emplace_back();
        } else {
            parts.back() += c;
        }
    }
    return parts;
}

/// The vector "0,0,-0.002". With `one`, "1.5" is accepted as well: three components of that value.
glm::dvec3 vector_of(const std::string& option, const std::string& text, double low, double high, bool one) {
    const std::vector<std::string> parts = split(text, ',');
    const bool same = one && parts.size() == 1;
    glm::dvec3 vector{0};
    bool good = same || parts.size() == 3;
    for (int axis = 0; good && axis < 3; ++axis) {
        const std::string& part = parts[same ? 0 : std::size_t(axis)];
        const auto [stop, error] = std::from_chars(part.data(), part.data() + part.size(), vector[axis]);
        good = error == std::errc() && stop == part.data() + part.size() && vector[axis] >= low &&
               vector[axis] <= high;
    }
    if (!good) {
        throw BadInput(
            "command line", option, text,
            std::string(one ? "one number, or three as X,Y,Z, each" : "three numbers as X,Y,Z, each") +
                " from " + range_text(low, high));
    }
    return vector;
}

/// Splits at commas into numbers or names of segments. Only the volume's file can check the names.
std::vector<std::string> labels_of(const std::string& text) {
    std::vector<std::string> labels;
    for (const std::string& label : split(text, ',')) {
        if (label.empty())
            throw BadInput("command line", "--labels", text, "whole numbers or names of segments: 1,2,5");
        if (std::find(labels.begin(), labels.end(), label) != labels.end())
            throw BadInput("command line", "--labels", text, "each label once");
        labels.push_back(label);
    }
    return labels;
}

/// "4" means the first four devices; "0,2" means these two, where a number may be repeated.
std::vector<int> devices_of(const std::string& text) {
    const auto number = [&](const std::string& part, std::int64_t low, std::int64_t high) {
        std::int64_t value = 0;
        const auto [stop, error] = std::from_chars(part.data(), part.data() + part.size(), value);
        if (error != std::errc() || stop != part.data() + part.size() || value < low || value > high)
            throw BadInput("command line", "--devices", text,
                           "how many devices, from 1 on, or the numbers of two or more, from 0 on: 4 or 0,1");
        return int(value);
    };
    const std::vector<std::string> parts = split(text, ',');
    std::vector<int> devices;
    if (parts.size() == 1) {
        devices.resize(std::size_t(number(text, 1, max_ranks)));
        std::iota(devices.begin(), devices.end(), 0);
    } else {
        for (const std::string& part : parts) devices.push_back(number(part, 0, max_ranks - 1));
    }
    return devices;
}

// --- Options that commands share -----------------------------------------------------------------------

void add_scene(CLI::App& command, Asked& asked) {
    command.add_option("SCENE", asked.scene, scene_help)->required();
}

void add_json(CLI::App& command, Asked& asked) { command.add_flag("--json", asked.json, "Print JSON"); }

void add_repetitions(CLI::App& command, StudyOptions& study, const char* description) {
    add_number<std::int64_t>(
        command, "--repetitions", 1, max_repetitions,
        [&study](std::int64_t count) { study.repetitions = int(count); }, description);
}

/// Takes effect before the command runs, and is inherited by the processes that it starts.
void add_device(CLI::App& command, const Api& api) {
    const std::string option = "--" + api.name + "-device";
    command
        .add_option_function<std::string>(
            option,
            [&api, option](const std::string& asked) {
                const std::vector<ListedDevice> devices = api.devices();
                if (devices_to_try(devices, asked).empty())
                    throw BadInput("command line", option, asked,
                                   "the number or a part of the name of one of the devices: " +
                                       (devices.empty() ? "there are none" : names_of(devices)));
                setenv(device_variable(api.name).c_str(), asked.c_str(), 1);
            },
            "The device of " + api.title +
                "'s backends, by number or part of its name (`voxspring list`); without it the card that "
                "CUDA measures, or the first that will do")
        ->type_name("DEVICE");
}
void add_devices(CLI::App& command) {
    for (const auto& [name, api] : apis()) {
        if (api.devices) add_device(command, api);
    }
}

/// Options for a volume that has no scene file.
void add_volume_options(CLI::App& command, VolumeOptions& volume) {
    const char* group = "Of a volume without a scene file";
    CLI::Option* threshold = add_number<double>(
        command, "--threshold", -max_quantity, max_quantity,
        [&volume](double value) { volume.threshold = value; }, "Voxels above it are active; 0");
    CLI::Option* labels = command.add_option_function<std::string>(
        "--labels", [&volume](const std::string& text) { volume.labels = labels_of(text); },
        "Voxels with one of these values are active, 1,2,5, or in one of these segments, by name");
    labels->type_name("LABEL,...")->excludes(threshold);
    CLI::Option* frame = add_number<std::int64_t>(
        command, "--frame", 0, last_frame, [&volume](std::int64_t number) { volume.frame = number; },
        "Which of several values per voxel: a time of a 4D file, from 0 on");
    CLI::Option* spacing = command.add_option_function<std::string>(
        "--spacing",
        [&volume](const std::string& text) {
            volume.spacing = vector_of("--spacing", text, min_quantity, max_quantity, true);
        },
        "Distance of voxels, one or three as X,Y,Z; the file's");
    spacing->type_name("LENGTH");
    CLI::Option* gravity = command.add_option_function<std::string>(
        "--gravity",
        [&volume](const std::string& text) {
            volume.gravity = vector_of("--gravity", text, -max_quantity, max_quantity, false);
        },
        "Acceleration as X,Y,Z; that of the scene heart, times the spacing");
    gravity->type_name("X,Y,Z");
    CLI::Option* parts = command.add_option_function<std::string>(
        "--parts",
        [&volume](const std::string& text) {
            volume.parts = PartsToKeep{};
            if (text != "largest")
                volume.parts->least =
                    std::size_t(number_of<std::int64_t>("--parts", text, 2, max_part_particles));
        },
        "Parts that hang together by springs: the largest alone, or those of N particles or more; all");
    parts->type_name("largest|N");
    for (CLI::Option* option : {threshold, labels, frame, spacing, gravity, parts}) option->group(group);
}

// --- Commands ------------------------------------------------------------------------------------------

void add_list(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* list =
        app.add_subcommand("list", "Backends (available, or why not), built-in scenes and studies");
    add_json(*list, asked);
    add_devices(*list);
    list->callback([&] { list_everything(asked.json, out); });
}

void add_limits(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* limits = app.add_subcommand("limits", "What each device can do at best, measured now");
    add_json(*limits, asked);
    add_devices(*limits);
    limits->callback([&] { list_limits(asked.json, out); });
}

void add_info(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* info = app.add_subcommand("info", "What a scene holds, what it needs and how stable it is");
    add_scene(*info, asked);
    add_json(*info, asked);
    add_volume_options(*info, asked.run.volume);
    info->callback([&] { describe_scene(asked.scene, asked.run.volume, asked.json, out); });
}

void add_export_options(CLI::App& run, ExportOptions& out) {
    run.add_option(
           "--out", out.out,
           "File for the final state; its ending is its format. May be given several times:" + list_formats())
        ->allow_extra_args(false);
    add_number<std::int64_t>(
        run, "--every", 1, max_steps, [&out](std::int64_t steps) { out.every = int(steps); },
        "Steps between the files of a series: --out body.vtu writes body_000100.vtu, ... and, "
        "for ParaView, body.pvd with the times of all");
    run.add_option_function<std::string>(
        "--frames",
        [&out](const std::string& folder) {
            if (folder.empty()) throw BadInput("command line", "--frames", "\"\"", "the path of a folder");
            out.frames = folder;
        },
        "Folder for a series of pictures, frame_000100.png, ...: one after each --every steps, 50 without "
        "it");
    run.add_option(
        "--colour", out.colour,
        "What pictures are coloured by: displacement, or error, the distance from float64 after the "
        "same steps");
    run.add_option("--size", out.size, "WIDTHxHEIGHT of pictures in pixels: 1280x960");
    run.add_option("--tool-force", out.tool_force,
                   "A .csv of the force on the scene's tool: a line each --every steps, without it each time "
                   "the tool moves");
}

void add_run(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* run = app.add_subcommand("run", "One simulation on one backend");
    RunOptions& options = asked.run;
    add_scene(*run, asked);
    run->add_option("--backend", options.backend,
                    "NAME[:key=value,...], see `voxspring list`; auto[:formulation=...,precision=...]: "
                    "the fastest for the scene on this machine")
        ->required();
    CLI::Option* steps = add_number<std::int64_t>(
        *run, "--steps", 1, max_steps, [&options](std::int64_t count) { options.steps = int(count); },
        "Time steps from the scene's start");
    steps->default_str("100");
    add_number<double>(
        *run, "--time", min_quantity, max_quantity, [&options](double time) { options.time = time; },
        "Simulated time in the scene's unit, instead of --steps: the steps that come nearest to it, one at "
        "least")
        ->excludes(steps);
    add_number<double>(
        *run, "--time-step", min_quantity, max_quantity,
        [&options](double time_step) { options.time_step = time_step; },
        "The same motion in steps of this size, as `voxspring advise` measures it; the scene's");
    run->add_option(
        "--resume", options.resume,
        "A .npz that --out or `voxspring view` wrote of this scene: go on from its step, with its "
        "springs, up to --steps or --time");
    add_export_options(*run, options.out);
    add_devices(*run);
    add_volume_options(*run, options.volume);
    run->callback([&] { asked.exit_code = run_scene(asked.scene, options, out); });
}

/// `when` says what the ranks are for, at the beginning of the help text.
void add_ranks(CLI::App& command, StudyOptions& options, const std::string& when) {
    add_number<std::int64_t>(
        command, "--ranks", 1, max_ranks, [&options](std::int64_t count) { options.ranks = int(count); },
        when + "maximum number of parts of a scene, each stepped by its own thread (default: one per core)");
    command
        .add_option_function<std::string>(
            "--devices", [&options](const std::string& text) { options.devices = devices_of(text); },
            when + "a rank on each of the first so many devices of CUDA, 4, or on these, 0,1")
        ->type_name("N or N,N,...");
}

void add_study(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* study = app.add_subcommand("study", "Time and verify scenes on several backends");
    StudyOptions& options = asked.of_study;
    study->add_option("STUDY", asked.study, "Built-in study or study file")->required();
    CLI::Option* file = study->add_option("--out", options.out, "Result as a .json file");
    study->add_option(
        "--backend", options.backends,
        "Only backends that match this glob, or with ! before it those that do not; may be given "
        "several times");
    study->add_option("--scene", options.scenes,
                      "Only scenes that match this glob, or this scene; may be given several times");
    add_repetitions(*study, options, "Timed batches of each backend and scene");
    add_ranks(*study, options, "Of a scaling study: ");
    study->add_flag("--resume", options.resume, "Go on with the study of --out that was cut short")
        ->needs(file);
    add_number<double>(
        *study, "--timeout", min_timeout, max_timeout,
        [&options](double seconds) { options.timeout = std::chrono::duration<double>(seconds); },
        "Seconds for which a backend may say nothing before its row fails")
        ->default_str("1800");
    add_devices(*study);
    add_volume_options(*study, options.volume);
    study->callback([&] { asked.exit_code = run_and_print_study(asked.study, options, out); });
}

void add_advise(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* advise = app.add_subcommand("advise",
                                          "Which backend, formulation, precision and time step reach an "
                                          "error in the least time; with --ranks or "
                                          "--devices whether more than one of them pays");
    AdviseOptions& options = asked.advise;
    add_scene(*advise, asked);
    add_number<double>(
        *advise, "--error", min_error, max_error, [&options](double error) { options.error = error; },
        "Total error that will do, relative L2 of displacement");
    add_ranks(*advise, options.study, "Instead of an error: ");
    CLI::Option* results = advise->add_option("--results", options.results,
                                              "Result of a pareto study, or with --ranks or --devices of a "
                                              "scaling study (.json), to read instead of "
                                              "measuring");
    advise
        ->add_option("--backend", options.study.backends,
                     "Measure only backends that match this glob; may be given several times")
        ->excludes(results);
    add_repetitions(*advise, options.study, "Timed runs of each, measuring");
    add_devices(*advise);
    advise->get_option("--repetitions")->excludes(results);
    CLI::Option* file = advise
                            ->add_option("--out", options.study.out,
                                         "What was measured as a .json file, which --results reads")
                            ->excludes(results);
    advise
        ->add_flag("--resume", options.study.resume, "Go on with the measurement of --out that was cut short")
        ->needs(file);
    add_json(*advise, asked);
    add_volume_options(*advise, options.study.volume);
    advise->callback([&] {
        options.json = asked.json;
        asked.exit_code = print_advice(asked.scene, options, out);
    });
}

void add_view(CLI::App& app, Asked& asked, std::ostream& out, const ViewScene& view) {
    CLI::App* command = app.add_subcommand("view", "The live body in a window: pull it, cut it, sew it");
    ViewOptions& options = asked.view;
    add_scene(*command, asked);
    command
        ->add_option(
            "--backend", options.backend,
            "As of `voxspring run`; may be changed in the window. auto: the fastest that a hand can take "
            "hold of")
        ->default_str("auto");
    add_number<std::int64_t>(
        *command, "--steps", 1, max_steps_a_frame,
        [&options](std::int64_t count) { options.steps = int(count); }, "Steps a frame; as many as fit");
    command
        ->add_option_function<std::string>(
            "--size", [&options](const std::string& text) { options.size = parse_size(text); },
            "WIDTHxHEIGHT of the window in pixels")
        ->type_name("SIZE")
        ->default_str("1280x800");
    add_number<double>(
        *command, "--seconds", min_timeout, max_timeout,
        [&options](double seconds) { options.seconds = seconds; }, "Close the window after so long");
    command->add_option(
        "--record", options.record,
        "A film of the window: film.mp4, or where there is no ffmpeg the folder film of pictures");
    command->add_option("--save", options.save,
                        "Where the key w saves the state, for `run --resume`: a .npz; SCENE.npz");
    add_devices(*command);
    add_volume_options(*command, options.volume);
    command->callback([&] { asked.exit_code = view(asked.scene, options, out); });
}

// --- Help for shells -----------------------------------------------------------------------------------

/// What kind of value this option or argument takes.
ValueKind kind_of(const std::string& name) {
    if (name == "SCENE" || name == "--scene") return ValueKind::scene;
    if (name == "STUDY") return ValueKind::study;
    if (name == "--backend") return ValueKind::backend;
    if (name == "--colour") return ValueKind::colour;
    if (name == "--frames") return ValueKind::folder;
    if (name == "SHELL") return ValueKind::shell;
    if (name == "--out" || name == "--resume" || name == "--results" || name == "--record" ||
        name == "--save" || name == "--tool-force")
        return ValueKind::file;
    return ValueKind::other;
}

/// The first line of a description.
std::string first_line(const std::string& text) { return text.substr(0, text.find('\n')); }

std::vector<CommandWords> words_of(const CLI::App& app) {
    std::vector<CommandWords> commands;
    for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
        CommandWords words{command->get_name(), first_line(command->get_description()), {}, {}};
        for (const CLI::Option* option : command->get_options()) {
            if (option->get_positional()) {
                words.arguments.push_back(kind_of(option->get_name(true)));
                continue;
            }
            const std::string name = "--" + option->get_lnames().front();
            const bool takes_value = option->get_type_size() > 0;
            // Not by name alone: `--resume` of a study is a flag.
            words.options.push_back(
                {name, first_line(option->get_description()), takes_value ? kind_of(name) : ValueKind::none});
        }
        if (is_script(words.name)) words.arguments.push_back(ValueKind::file);
        commands.push_back(std::move(words));
    }
    return commands;
}

void add_completion(CLI::App& app, Asked& asked, std::ostream& out) {
    CLI::App* completion = app.add_subcommand(
        "completion", "A script by which a shell completes commands, options, scenes, studies and backends");
    completion->add_option("SHELL", asked.shell, "bash or zsh")->required();
    completion->footer(
        "For this shell: source <(voxspring completion bash). For good: write it to\n"
        "~/.local/share/bash-completion/completions/voxspring, or for zsh to _voxspring in a folder of "
        "$fpath;\n"
        "`cmake --install` does so for all users.");
    completion->callback([&] { out << completion_script(asked.shell, words_of(app)); });
}

// --- What cannot be understood -------------------------------------------------------------------------

std::vector<std::string> command_names(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
        names.push_back(command->get_name());
    return names;
}

/// Refuses a first word that is neither a command nor an option of the program.
void check_command(const CLI::App& app, int argc, char** argv) {
    if (argc < 2 || argv[1][0] == '-') return;
    const std::vector<std::string> names = command_names(app);
    const std::string word = argv[1];
    if (word == worker_word)
        throw BadInput("command line", "command", word,
                       std::string("one for people: ") + refusal_of_worker_by_hand);
    if (std::find(names.begin(), names.end(), word) == names.end())
        throw BadInput("command line", "command", word,
                       "one of " + joined(names) + did_you_mean(word, names));
}

/// Refuses an unknown option. Called after `app` has failed to parse.
void check_options(const CLI::App& app) {
    const std::vector<CLI::App*> parsed = app.get_subcommands();
    const CLI::App& command = parsed.empty() ? app : *parsed.front();
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options()) {
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
    for (const std::string& word : app.remaining(true)) {
        if (!word.starts_with("-")) continue;
        const std::string name = word.substr(0, word.find('='));
        if (std::find(names.begin(), names.end(), name) != names.end()) continue;
        throw BadInput("command line", parsed.empty() ? "" : command.get_name(), name,
                       "one of " + joined(names) + did_you_mean(name, names));
    }
}

}  // namespace

int run_command_line(int argc, char** argv, std::ostream& out, const ViewScene& view) {
    // Scripts parse their options themselves.
    if (argc > 1 && is_script(argv[1])) return run_script(argv[1], {argv + 2, argv + argc});
    CLI::App app{
        "Voxspring: which GPU API and which data layout should run a mass-spring-damper model on this "
        "machine, how fast, with what error, and up to which time step."};
    app.name("voxspring");
    app.require_subcommand(1);
    app.set_version_flag("--version", version_text());
    app.footer(
        "Exit codes: 0 done; 1 a backend failed, an error exceeded its tolerance, or nothing could be "
        "measured;\n"
        "2 bad input or usage; 130 interrupted. Progress goes to standard error: a line on a terminal, "
        "elsewhere\n"
        "one every ten seconds (VOXSPRING_PROGRESS_SECONDS: so many).");
    Asked asked;
    add_list(app, asked, out);
    add_limits(app, asked, out);
    add_info(app, asked, out);
    add_run(app, asked, out);
    add_view(app, asked, out, view);
    add_study(app, asked, out);
    add_advise(app, asked, out);
    for (const auto& [name, description] : scripts()) app.add_subcommand(name, description);
    add_completion(app, asked, out);
    check_command(app, argc, argv);
    // Ctrl-C ends the program at once, unless a command catches it to finish its work.
    const CaughtInterruptions caught(true);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error, out, std::cerr);
        check_options(app);
        app.exit(error, out, std::cerr);
        return 2;
    }
    return asked.exit_code;
}

}  // namespace voxspring
