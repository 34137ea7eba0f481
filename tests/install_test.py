"""`cmake --install` and find_package(voxspring), as a program outside of the tree uses them.

CMAKE, BUILD and CXX name CMake, the build folder and the compiler; the current directory is the source tree.
"""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

import jsonschema

CMAKE, BUILD, CXX = (os.environ[name] for name in ("CMAKE", "BUILD", "CXX"))


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        cls.prefix = cls.folder / "prefix"
        cls.project = cls.folder / "project"
        shutil.copytree("tests/example_project", cls.project)
        cls.call(CMAKE, "--install", BUILD, "--prefix", cls.prefix)
        cls.call(CMAKE, "-S", cls.project, "-B", cls.project / "build", "-G", "Ninja", f"-DCMAKE_CXX_COMPILER={CXX}",
                 f"-DCMAKE_PREFIX_PATH={cls.prefix}",
                 # Without CUDA's toolkit; a library with CUDA backends needs only two libraries of it.
                 "-DCMAKE_DISABLE_FIND_PACKAGE_CUDAToolkit=ON")

    @staticmethod
    def call(*command, code=0):
        result = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
        assert result.returncode == code, f"{command}: {result.returncode}\n{result.stdout}\n{result.stderr}"
        return result.stdout

    def run_example(self, code):
        self.call(CMAKE, "--build", self.project / "build")
        out = self.folder / "result.json"
        out.unlink(missing_ok=True)
        environment = {"VOXSPRING_CACHE": str(self.folder / "cache"), "PATH": os.environ["PATH"]}
        result = subprocess.run([self.project / "build/example", out], capture_output=True, text=True, timeout=300,
                                env=environment)
        self.assertEqual(result.returncode, code, result.stdout + result.stderr)
        return json.loads(out.read_text()), result.stdout

    def test_installs_a_program_and_no_test_or_library_of_the_system(self):
        listed = json.loads(self.call(self.prefix / "bin/voxspring", "list", "--json"))
        self.assertIn("cpu_reference", [backend["name"] for backend in listed["backends"]])
        self.assertEqual(sorted(p.name for p in (self.prefix / "bin").iterdir()), ["voxspring", "voxspring-view"])
        self.assertEqual([p for p in self.prefix.rglob("*.so*")], [])
        self.assertEqual([p.name for p in self.prefix.rglob("*_test*")], [])
        share = self.prefix / "share/voxspring"
        self.assertIn("dataset", json.loads((share / "harness/scenes/heart.json").read_text()))
        self.assertIn("properties", json.loads((share / "results/schema.json").read_text()))

    def test_installs_the_scripts_that_the_program_starts_and_what_shells_complete(self):
        # The system's Python has the packages; another one on the PATH may not.
        helped = subprocess.run([self.prefix / "bin/voxspring", "diff", "--help"], capture_output=True, text=True, timeout=60,
                                env={"PATH": "/usr/bin:/bin"})
        self.assertIn("--across-devices", helped.stdout)
        share = self.prefix / "share"
        for script in ("report.py", "diff.py", "versions.py", "requirements.txt", "page/page.js"):
            self.assertTrue((share / "voxspring/results" / script).exists(), script)
        bash = (share / "bash-completion/completions/voxspring").read_text()
        self.assertEqual(bash, self.call(self.prefix / "bin/voxspring", "completion", "bash"))
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

    def test_another_programs_mistake_fails(self):
        source = self.project / "my_backend.cpp"
        right = source.read_text()
        self.addCleanup(source.write_text, right)
        wrong = right.replace("force_[spring.second] -= force;", "force_[spring.second] += force;")
        self.assertNotEqual(wrong, right)
        source.write_text(wrong)
        result, _ = self.run_example(1)
        self.assertEqual({row["backend"] for row in result["failed"]}, {"my_backend"})
        self.assertEqual({row["backend"] for row in result["benchmarks"]}, {"cpu_reference"})

    def test_a_program_that_serves_no_workers_is_told(self):
        source = self.project / "main.cpp"
        right = source.read_text()
        self.addCleanup(source.write_text, right)
        without = right.replace("    worker_main(argc, argv);\n", "")
        self.assertNotEqual(without, right)
        source.write_text(without)
        self.call(CMAKE, "--build", self.project / "build")
        out = self.folder / "none.json"
        ran = subprocess.run([self.project / "build/example", out], capture_output=True, text=True, timeout=60)
        self.assertEqual(ran.returncode, 2)
        self.assertIn("call voxspring::worker_main(argc, argv) first in main()", ran.stderr)
        self.assertFalse(out.exists())

    def test_what_is_measured_is_optimised_without_a_word(self):
        commands = (self.project / "build/build.ninja").read_text()
        self.assertRegex(commands, r"FLAGS = .*-O3")

    def configure_without_build_type(self, *options):
        """What CMake prints for a project that has no build type and sets none."""
        with tempfile.TemporaryDirectory() as folder:
            pathlib.Path(folder, "CMakeLists.txt").write_text(
                "cmake_minimum_required(VERSION 3.25)\nproject(mine LANGUAGES CXX)\nfind_package(voxspring 0.2 REQUIRED)\n")
            done = subprocess.run([CMAKE, "-S", folder, "-B", f"{folder}/build", "-G", "Ninja",
                                   f"-DCMAKE_CXX_COMPILER={CXX}", f"-DCMAKE_PREFIX_PATH={self.prefix}", *options],
                                  capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        return " ".join(done.stderr.split())

    def test_warns_of_a_project_without_optimisation(self):
        warning = "mine is compiled without optimisation"
        self.assertIn(warning, self.configure_without_build_type())
        self.assertNotIn(warning, self.configure_without_build_type("-DCMAKE_BUILD_TYPE=Debug"))
        self.assertNotIn(warning, self.configure_without_build_type("-DCMAKE_CXX_FLAGS=-O2"))

    def test_the_library_is_optimised_without_a_word(self):
        with tempfile.TemporaryDirectory() as folder:
            environment = {key: value for key, value in os.environ.items() if key != "CMAKE_BUILD_TYPE"}
            done = subprocess.run([CMAKE, "-S", ".", "-B", folder, "-G", "Ninja", f"-DCMAKE_CXX_COMPILER={CXX}",
                                   "-DVOXSPRING_TESTS=OFF", "-DVOXSPRING_CUDA=OFF"],
                                  capture_output=True, text=True, timeout=120, env=environment)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("CMAKE_BUILD_TYPE:STRING=Release", pathlib.Path(folder, "CMakeCache.txt").read_text())

    def refusal(self, wanted="voxspring 0.2", **environment):
        """What CMake says to a project that wants such a package."""
        with tempfile.TemporaryDirectory() as folder:
            lists = (self.project / "CMakeLists.txt").read_text()
            self.assertIn("find_package(voxspring 0.2 ", lists)
            pathlib.Path(folder, "CMakeLists.txt").write_text(lists.replace("voxspring 0.2", wanted))
            result = subprocess.run([CMAKE, "-S", folder, "-B", f"{folder}/build", "-G", "Ninja",
                                     f"-DCMAKE_CXX_COMPILER={CXX}", f"-DCMAKE_PREFIX_PATH={self.prefix}"],
                                    capture_output=True, text=True, timeout=60, env=os.environ | environment)
        self.assertNotEqual(result.returncode, 0)
        return " ".join(result.stderr.split())

    def test_another_version_is_not_taken(self):
        self.assertIn("version: 0.2.0", self.refusal("voxspring 9"))

    def test_says_what_it_needs_and_does_not_find(self):
        self.assertIn("voxspring needs epoxy, which is not installed",
                      self.refusal(PKG_CONFIG_LIBDIR=str(self.folder / "nothing")))


if __name__ == "__main__":
    unittest.main()
