// The command line. Exit codes: 0 done, 1 a backend failed or an error exceeded its tolerance, 2 bad input
// or usage, 130 interrupted.
#include <malloc.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <string>

#include "backends/registry.h"
#include "harness/base/bad_input.h"
#include "harness/cli/commands.h"
#include "harness/export/export.h"

int main(int argc, char** argv) {
    using namespace voxspring;
    // Memory that was given back is used again instead of being mapped, and cleared page by page, anew: the
    // states of a large scene come and go with every row of a study.
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, -1);  // never
    CLI::App app{
        "Voxspring: which GPU API and which data layout should run a mass-spring-damper model on this "
        "machine, how fast, with what error, and up to which time step."};
    app.name("voxspring");
    app.require_subcommand(1);
    int exit_code = 0;

    bool json = false;
    CLI::App* list =
        app.add_subcommand("list", "Backends (available, or why not), built-in scenes and studies");
    list->add_flag("--json", json, "Print JSON");
    list->callback([&] { list_everything(json, std::cout); });

    CLI::App* limits = app.add_subcommand("limits", "What each device can do at best, measured now");
    limits->add_flag("--json", json, "Print JSON");
    limits->callback([&] { list_limits(json, std::cout); });

    std::string scene;
    const char* scene_help =
        "Built-in scene (box, or resized: box@64, heart@120x102x92), scene file or volume file";
    CLI::App* info = app.add_subcommand("info", "What a scene holds, what it needs and how stable it is");
    info->add_option("SCENE", scene, scene_help)->required();
    info->add_flag("--json", json, "Print JSON");
    info->callback([&] { describe_scene(scene, json, std::cout); });

    RunOptions run_options;
    CLI::App* run = app.add_subcommand("run", "One simulation on one backend");
    run->add_option("SCENE", scene, scene_help)->required();
    run->add_option("--backend", run_options.backend,
                    "NAME[:key=value,...], see `voxspring list`; auto[:formulation=...,precision=...]: "
                    "the fastest for the scene on this machine")
        ->required();
    run->add_option("--steps", run_options.steps, "Time steps")
        ->check(CLI::PositiveNumber)
        ->capture_default_str();
    run->add_option(
           "--out", run_options.out.out,
           "File for the final state; its ending is its format. May be given several times:" + list_formats())
        ->allow_extra_args(false);
    run->add_option("--every", run_options.out.every,
                    "Steps between the files of a series: --out body.vtu writes body_000100.vtu, ... and, "
                    "for ParaView, body.pvd with the times of all")
        ->check(CLI::PositiveNumber);
    run->add_option("--frames", run_options.out.frames,
                    "Folder for a series of pictures, frame_000100.png, ...: one after each --every steps, " +
                        std::to_string(most_frames) + " without it");
    run->add_option(
        "--colour", run_options.out.colour,
        "What pictures are coloured by: displacement, or error, the distance from float64 after the "
        "same steps");
    run->add_option("--size", run_options.out.size, "WIDTHxHEIGHT of pictures in pixels: 1280x960");
    run->callback([&] { exit_code = run_scene(scene, run_options, std::cout); });

    std::string study;
    StudyOptions study_options;
    CLI::App* study_command = app.add_subcommand("study", "Time and verify scenes on several backends");
    study_command->add_option("STUDY", study, "Built-in study or study file")->required();
    CLI::Option* out = study_command->add_option("--out", study_options.out, "Result as a .json file");
    study_command->add_option("--backend", study_options.backends,
                              "Only backends that match this glob; may be given several times");
    study_command->add_option("--scene", study_options.scenes,
                              "Only scenes that match this glob, or this scene; may be given several times");
    study_command
        ->add_option("--repetitions", study_options.repetitions, "Timed batches of each backend and scene")
        ->check(CLI::Range(1, 10000));
    study_command
        ->add_flag("--resume", study_options.resume, "Go on with the study of --out that was cut short")
        ->needs(out);
    study_command
        ->add_option_function<double>(
            "--timeout",
            [&](double seconds) { study_options.timeout = std::chrono::duration<double>(seconds); },
            "Seconds for which a backend may say nothing before its row fails")
        ->check(CLI::PositiveNumber)
        ->default_str("1800");
    study_command->callback([&] { exit_code = run_and_print_study(study, study_options, std::cout); });

    AdviseOptions advise_options;
    CLI::App* advise = app.add_subcommand(
        "advise", "Which backend, formulation, precision and time step reach an error in the least time");
    advise->add_option("SCENE", scene, scene_help)->required();
    advise
        ->add_option("--error", advise_options.error, "Total error that will do, relative L2 of displacement")
        ->required()
        ->check(CLI::PositiveNumber);
    CLI::Option* results = advise->add_option(
        "--results", advise_options.results, "Result of a pareto study (.json) to read instead of measuring");
    advise
        ->add_option("--backend", advise_options.study.backends,
                     "Measure only backends that match this glob; may be given several times")
        ->excludes(results);
    advise->add_option("--repetitions", advise_options.study.repetitions, "Timed runs of each, measuring")
        ->check(CLI::Range(1, 10000))
        ->excludes(results);
    advise->callback([&] { exit_code = print_advice(scene, advise_options, std::cout); });

    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    } catch (const BadInput& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const BadSpecification& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 2;
    } catch (const std::exception& error) {
        std::cerr << "voxspring: " << error.what() << "\n";
        return 1;
    }
    return exit_code;
}
