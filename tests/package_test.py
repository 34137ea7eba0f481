"""The package that `./run package` makes, as its user meets it: unpacked into an empty folder, with the few tools that its
scripts call and no compiler on the PATH, OpenGL on Mesa.

Usage: package_test.py ARCHIVE.tar.xz
"""

import json
import os
import pathlib
import re
import shutil
import sys
import tarfile
import unittest

from folder import new_folder, run

ARCHIVE = pathlib.Path(sys.argv.pop(1)).resolve()
TOOLS = ("bash", "cat", "date", "dirname", "env", "mkdir", "mktemp", "nproc", "rm", "sleep")
# Libraries of glibc, and those that a graphics driver brings.
SYSTEM_LIBRARIES = re.compile(r"(linux-vdso|ld-linux.*|lib(c|m|dl|pthread|rt)|lib(EGL|GL|OpenGL).*)\.so.*")


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = new_folder(cls.addClassCleanup).resolve()
        cls.tools = cls.folder / "tools"
        cls.tools.mkdir()
        for tool in TOOLS:
            (cls.tools / tool).symlink_to(shutil.which(tool))
        with tarfile.open(ARCHIVE) as archive:
            archive.extractall(cls.folder)
        cls.package, = (path for path in cls.folder.iterdir() if path != cls.tools)

    def call(self, *command, **environment):
        """Runs `command` of the package with arguments, and with no variables but these and the PATH."""
        return run(self.package / command[0], *command[1:], timeout=1500, cwd=self.folder,
                   env={"PATH": str(self.tools), "OMP_WAIT_POLICY": "passive", "VOXSPRING_CACHE": str(self.folder / "cache"),
                        **environment})

    def test_brings_its_libraries(self):
        for program in sorted((self.package / "bin").iterdir()):
            loaded = self.call(program, LD_TRACE_LOADED_OBJECTS="1").stdout
            self.assertIn("libc.so", loaded)
            for line in loaded.splitlines():
                name, where = line.split()[0], line.split()[2:3]
                if not SYSTEM_LIBRARIES.fullmatch(pathlib.Path(name).name):
                    self.assertTrue(where and where[0].startswith(f"{self.package}/"), f"{program.name}: {line}")

    def test_readme_names_what_is_there(self):
        readme = (self.package / "README.md").read_text()
        named = re.findall(r"\]\(([^)]*)\)|(?:^|[\s`])(\./run|bin/\w+)", readme, re.MULTILINE)
        self.assertGreater(len(named), 5)
        for link, file in named:
            self.assertTrue((self.package / (link or file)).exists(), link or file)
        commands = self.call("bin/voxspring", "--help").stdout
        for command in re.findall(r"bin/voxspring ([a-z]+)", readme):
            self.assertRegex(commands, rf"(?m)^ +{command}\b")

    def test_measures_on_the_processor_and_on_mesa(self):
        done = self.call("run", "study", "smoke")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        commit = (self.package / "COMMIT").read_text().strip()
        result, = (self.package / "results/local").glob(f"*-{commit}.json")
        measured = {row["backend"] for row in json.loads(result.read_text())["benchmarks"]}
        for backend in ("cpu_reference", "cpu_parallel", "gl_fragment_implicit", "gl_compute_implicit"):
            self.assertIn(backend, measured)
        if "vulkan" in os.environ.get("VOXSPRING_REQUIRE", ""):
            self.assertIn("vulkan_implicit", measured)

    def test_its_tests_pass(self):
        # All tests have passed in the build tree; these say whether each backend works here.
        done = self.call("run", "test", "--gtest_filter=-*AnEditedProblem*:*EditsBetweenSteps*:*Rewinds*:*TheBox:*float64*:*_block_*:"
                         "*_terms_*:*_interior_*:*compensated*:*displacement*:*paper*",
                         VOXSPRING_REQUIRE=os.environ.get("VOXSPRING_REQUIRE", "gl"))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        tests = {path.name for path in (self.package / "bin").glob("*_test")}
        self.assertIn("resting_test", tests)
        for name in tests:
            self.assertRegex(done.stdout, rf"(?m)^{name}: [1-9]\d* tests, \d+ of them skipped$")

    def test_a_few_of_its_tests_are_run_unless_all_are_asked_for(self):
        done = self.call("run", "test", VOXSPRING_REQUIRE="gl", VOXSPRING_PROGRESS_SECONDS="1")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertRegex(done.stdout, r"(?m)^conformance_test: \d+ done, at Backends/\w+\.\w+/\w+_precision_float32$")
        ended = sum(int(number) for number in re.findall(r"(?m)^\w+: (\d+) tests,", done.stdout))
        self.assertTrue(25 < ended < 200, done.stdout)

    def test_a_broken_mesa_fails_its_tests(self):
        done = self.call("run", "test", "--gtest_filter=*AgreesWithTheReference/gl_fragment_implicit_precision_float32",
                         VOXSPRING_REQUIRE="gl", LIBGL_DRIVERS_PATH="/nowhere")
        self.assertEqual(done.returncode, 1, done.stdout)
        self.assertIn("required and unavailable", done.stdout)

    def test_starts_its_scripts(self):
        for command, files in (("diff", ["nosuch.json", "neither.json"]), ("report", ["nosuch.json"])):
            done = self.call("bin/voxspring", command, *files, PATH=f"{self.tools}:/usr/bin:/bin")
            self.assertEqual(done.returncode, 2, done.stdout + done.stderr)
            # Either the script ran, or it named what it needs.
            self.assertRegex(done.stderr, r"nosuch\.json|expected a Python 3 that can import")

    def test_refuses_what_it_does_not_know(self):
        self.assertEqual(self.call("run", "help").returncode, 0)
        self.assertEqual(self.call("run", "stduy").returncode, 2)
        self.assertEqual(self.call("run", "study", "nosuch").returncode, 2)


if __name__ == "__main__":
    unittest.main()
