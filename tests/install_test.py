"""Programs outside of the tree: with `cmake --install` and find_package(voxspring), and with Voxspring as a subproject.

CMAKE, BUILD and CXX name CMake, the build folder and the compiler; the current directory is the source tree.
"""

import json
import os
import pathlib
import re
import shutil
import tempfile
import unittest

import jsonschema
from folder import new_folder, run

CMAKE, BUILD, CXX = (os.environ[name] for name in ("CMAKE", "BUILD", "CXX"))


def call(*command, code=0, timeout=300):
    """The output of a command that has to end with this exit code."""
    result = run(*command, timeout=timeout)
    assert result.returncode == code, f"{command}: {result.returncode}\n{result.stdout}\n{result.stderr}"
    return result.stdout


def configure(source, *options, **environment):
    """What CMake prints as errors and warnings for a project, its exit code, and the files build.ninja and CMakeCache.txt."""
    inherited = {name: value for name, value in os.environ.items() if name != "CMAKE_BUILD_TYPE"}
    with tempfile.TemporaryDirectory() as folder:
        done = run(CMAKE, "-S", source, "-B", folder, "-G", "Ninja", f"-DCMAKE_CXX_COMPILER={CXX}", *options,
                   env=inherited | environment)
        files = [pathlib.Path(folder, name) for name in ("build.ninja", "CMakeCache.txt")]
        return " ".join(done.stderr.split()), done.returncode, *(file.read_text() if file.exists() else "" for file in files)


def configure_this_tree(*options):
    return configure(".", "-DVOXSPRING_TESTS=OFF", "-DVOXSPRING_CUDA=OFF", *options)


class Program(unittest.TestCase):
    """A test class with `folder`, and the program of tests/example_project in `build`."""

    @classmethod
    def setUpClass(cls):
        cls.folder = new_folder(cls.addClassCleanup)

    def run_example(self, code):
        call(CMAKE, "--build", self.build, "--target", "example", timeout=1500)
        out = self.folder / "result.json"
        out.unlink(missing_ok=True)
        environment = {"VOXSPRING_CACHE": str(self.folder / "cache"), "PATH": os.environ["PATH"]}
        result = run(self.build / "example", out, env=environment)
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        return json.loads(out.read_text()), result.stdout


class Subproject(Program):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # In this tree, where a compiler cache finds what other builds have compiled.
        cls.build = pathlib.Path("build/subproject").resolve()
        call(CMAKE, "-S", "tests/subproject", "-B", cls.build, "-G", "Ninja", f"-DCMAKE_CXX_COMPILER={CXX}",
             "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON")

    def test_is_built_and_measures_the_backend_of_the_program(self):
        result, _ = self.run_example(0)
        self.assertEqual({row["backend"] for row in result["verification"] if row["passed"]}, {"cpu_reference", "my_backend"})

    def test_adds_no_test_no_installed_file_and_no_option_of_the_compiler(self):
        self.assertIn("Total Tests: 0", call("ctest", "--test-dir", self.build, "--show-only"))
        call(CMAKE, "--install", self.build, "--prefix", self.folder / "prefix")
        self.assertFalse((self.folder / "prefix").exists())
        commands = json.loads((self.build / "compile_commands.json").read_text())
        own, = (entry["command"] for entry in commands if entry["file"].endswith("my_backend.cpp"))
        self.assertNotRegex(own, "-W|-ffp-contract")


class Install(Program):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.prefix = cls.folder / "prefix"
        cls.project = cls.folder / "project"
        shutil.copytree("tests/example_project", cls.project)
        cls.build = cls.project / "build"
        call(CMAKE, "--install", BUILD, "--prefix", cls.prefix)
        cls.here = f"-DCMAKE_PREFIX_PATH={cls.prefix}"
        call(CMAKE, "-S", cls.project, "-B", cls.build, "-G", "Ninja", f"-DCMAKE_CXX_COMPILER={CXX}", cls.here,
             # Without CUDA's toolkit; a library with CUDA backends needs only two libraries of it.
             "-DCMAKE_DISABLE_FIND_PACKAGE_CUDAToolkit=ON")

    def test_installs_a_program_and_no_test_or_library_of_the_system(self):
        listed = json.loads(call(self.prefix / "bin/voxspring", "list", "--json"))
        self.assertIn("cpu_reference", [backend["name"] for backend in listed["backends"]])
        self.assertEqual(sorted(p.name for p in (self.prefix / "bin").iterdir()), ["voxspring", "voxspring-view"])
        self.assertEqual([p for p in self.prefix.rglob("*.so*")], [])
        self.assertEqual([p.name for p in self.prefix.rglob("*_test*")], [])
        share = self.prefix / "share/voxspring"
        self.assertIn("dataset", json.loads((share / "harness/scenes/heart.json").read_text()))
        self.assertIn("properties", json.loads((share / "results/schema.json").read_text()))

    def test_installs_no_header_that_includes_one_that_is_not_installed(self):
        headers = self.prefix / "include/voxspring"
        installed = sorted(headers.rglob("*.h"))
        self.assertGreater(len(installed), 100)
        for header in installed:
            for name in re.findall(r'^#include "([^"]+)"', header.read_text(), re.MULTILINE):
                self.assertTrue((headers / name).exists() or (header.parent / name).exists(), f"{header}: {name}")

    def test_installs_the_scripts_that_the_program_starts_and_what_shells_complete(self):
        # The system's Python has the packages; another one on the PATH may not.
        helped = run(self.prefix / "bin/voxspring", "diff", "--help", env={"PATH": "/usr/bin:/bin"})
        self.assertIn("--across-devices", helped.stdout)
        share = self.prefix / "share"
        for script in ("report.py", "diff.py", "result_files.py", "requirements.txt", "page/page.js"):
            self.assertTrue((share / "voxspring/results" / script).exists(), script)
        bash = share / "bash-completion/completions/voxspring"
        self.assertIn("voxspring", call("bash", "-c", f"PATH={self.prefix}/bin:$PATH; source {bash}; complete -p voxspring"))
        self.assertTrue((share / "zsh/site-functions/_voxspring").read_text().startswith("#compdef voxspring"))

    def test_another_program_measures_its_own_backend_on_its_own_scene(self):
        result, table = self.run_example(0)
        jsonschema.Draft202012Validator(json.loads(pathlib.Path("results/schema.json").read_text())).validate(result)
        rows = {row["backend"]: row for row in result["verification"]}
        self.assertEqual(set(rows), {"cpu_reference", "my_backend"})
        for row in rows.values():
            self.assertTrue(row["passed"])
            self.assertEqual((row["scene"], row["particles"], row["steps"]), ("ball", 2553, 50))
            self.assertLessEqual(row["error_max"], row["tolerance"])
        # float32 rounds, so that an error of 0 would mean a comparison with itself.
        self.assertGreater(rows["my_backend"]["error_max"], 0)
        medians = {row["backend"]: row for row in result["benchmarks"] if row.get("aggregate_name") == "median"}
        self.assertEqual(set(medians), set(rows))
        self.assertGreater(min(row["real_time"] for row in medians.values()), 0)
        self.assertEqual((result["skipped"], result["failed"]), ([], []))
        self.assertIn("my_backend increment float32", table)

    def change(self, file, right, wrong):
        """Changes a file of the program until the end of the test."""
        path = self.project / file
        text = path.read_text()
        self.assertIn(right, text)
        self.addCleanup(path.write_text, text)
        path.write_text(text.replace(right, wrong))

    def test_another_programs_mistake_fails(self):
        self.change("my_backend.cpp", "force_[spring.second] -= force;", "force_[spring.second] += force;")
        result, _ = self.run_example(1)
        self.assertEqual({row["backend"] for row in result["failed"]}, {"my_backend"})
        self.assertEqual({row["backend"] for row in result["benchmarks"]}, {"cpu_reference"})

    def test_a_program_that_serves_no_workers_is_told(self):
        self.change("main.cpp", "    worker_main(argc, argv);\n", "")
        call(CMAKE, "--build", self.build)
        out = self.folder / "none.json"
        ran = run(self.build / "example", out)
        self.assertEqual(ran.returncode, 2)
        self.assertIn("call voxspring::worker_main(argc, argv) first in main()", ran.stderr)
        self.assertFalse(out.exists())

    def test_what_is_measured_is_optimised_without_a_word(self):
        self.assertRegex((self.build / "build.ninja").read_text(), r"FLAGS = .*-O3")
        errors, _, ninja, cache = configure_this_tree()
        self.assertEqual(errors, "")
        self.assertRegex(ninja, r"FLAGS = .*-O3")
        self.assertNotIn("CMAKE_BUILD_TYPE:STRING=Release", cache)

    def test_warnings_are_errors_only_on_request(self):
        for option, are_errors in (("-DVOXSPRING_WERROR=ON", True), ("-DVOXSPRING_MPI=ON", False)):
            errors, code, ninja, _ = configure_this_tree(option)
            self.assertEqual((code, "-Werror" in ninja), (0, are_errors), errors)

    def test_warns_of_a_project_without_optimisation(self):
        warning = "mine is compiled without optimisation"
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "CMakeLists.txt").write_text(
                "cmake_minimum_required(VERSION 3.25)\nproject(mine LANGUAGES CXX)\nfind_package(voxspring 0.2 REQUIRED)\n")
            self.assertIn(warning, configure(folder, self.here)[0])
            for option in ("-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_CXX_FLAGS=-O2"):
                errors, code, *_ = configure(folder, self.here, option)
                self.assertEqual((warning in errors, code), (False, 0), errors)

    def test_names_every_library_that_a_build_misses(self):
        errors, code, *_ = configure_this_tree("-DCMAKE_DISABLE_FIND_PACKAGE_fmt=ON", "-DCMAKE_DISABLE_FIND_PACKAGE_CLI11=ON")
        self.assertEqual(code, 1)
        for named in ("fmt 9 or newer (Debian: libfmt-dev)", "CLI11 2.1 or newer (Debian: libcli11-dev)"):
            self.assertIn(named, errors)

    def test_says_which_library_or_version_is_not_there(self):
        errors, code, *_ = configure(self.project, self.here, PKG_CONFIG_LIBDIR=str(self.folder / "nothing"))
        self.assertEqual(code, 1)
        self.assertIn("voxspring needs epoxy, which is not installed", errors)
        self.change("CMakeLists.txt", "voxspring 0.2", "voxspring 9")
        errors, code, *_ = configure(self.project, self.here)
        self.assertEqual(code, 1)
        self.assertIn("version: 0.2.0", errors)


if __name__ == "__main__":
    unittest.main()
