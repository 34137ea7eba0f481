"""Tests of the script `run` with stand-ins for what it calls: dpkg-query, cmake, git and the program."""

import json
import os
import pathlib
import shutil
import sys
import unittest

from folder import new_folder, run

ROOT = pathlib.Path(__file__).resolve().parent.parent

# Says that every package it is asked for is installed, but those of $MISSING.
DPKG_QUERY = """#!/bin/bash
for package in "${@:3}"; do
    [[ " ${MISSING:-} " = *" $package "* ]] || echo "$package installed"
done
"""

# The output of CTest for a program of GoogleTest and three scripts, and that program's output about its tests.
CTEST_RESULTS = """<testsuite tests="4">
<testcase name="program" status="fail"/><testcase name="script" status="run"/><testcase name="skipped" status="notrun"/>
<testcase name="crash" status="fail"/>
</testsuite>
"""
PROGRAM_RESULTS = """<testsuites><testsuite>
<testcase classname="A" name="passes" status="run" result="completed"/>
<testcase classname="A" name="skips" value_param="&quot;cuda_march:precision=float32&quot;" status="run" result="skipped"/>
<testcase classname="A" name="fails" status="run" result="completed"><failure/></testcase>
<testcase classname="A" name="fails too" status="run" result="completed"><failure/></testcase>
</testsuite></testsuites>
"""


class Study(unittest.TestCase):
    def setUp(self):
        folder = new_folder(self.addCleanup).resolve()
        self.tree = folder / "tree"
        (self.tree / "build/release").mkdir(parents=True)
        self.local = self.tree / "results/local"
        self.local.mkdir(parents=True)
        shutil.copy(ROOT / "run", self.tree)
        # Python packages are there already.
        for of, environment in (("results", "report-venv"), ("tests", "test-venv")):
            (self.tree / "build" / environment).mkdir(parents=True)
            (self.tree / of).mkdir(exist_ok=True)
            for path in (self.tree / of, self.tree / "build" / environment):
                (path / "requirements.txt").write_text("numpy\n")
        shutil.copy(ROOT / "tests/count.py", self.tree / "tests")
        shutil.copy(ROOT / "CMakePresets.json", self.tree)
        # The script runs where these are the only tools.
        self.tools = folder / "tools"
        self.tools.mkdir()
        for tool in ("bash", "cat", "cmp", "cp", "date", "dirname", "env", "grep", "id", "mkdir", "mktemp", "nproc", "rm", "sed",
                     "sleep", "sort", "tail", "touch", "tr", "uniq"):
            (self.tools / tool).symlink_to(shutil.which(tool))
        self.write(self.tools / "dpkg-query", DPKG_QUERY)
        self.stand_in("cmake")
        self.write(self.tree / "build/release/voxspring", '#!/bin/bash\nprintf "%s\\n" "$@"\n')
        (self.tree / "build/release/build.ninja").touch()

    def stand_in(self, *tools):
        """Tools that do nothing and succeed."""
        for tool in tools:
            self.write(self.tools / tool, "#!/bin/bash\n")

    @staticmethod
    def write(path, text):
        path.write_text(text)
        path.chmod(0o755)

    def run_script(self, *arguments, **environment):
        return run(self.tree / "run", *arguments, env={"PATH": str(self.tools), **environment})

    def program_arguments(self, *arguments):
        done = self.run_script(*arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        lines = done.stdout.splitlines()
        self.assertEqual(lines[0], "Building.")
        return lines[1:]

    def test_passes_the_study_and_its_options_on(self):
        *first, result = self.program_arguments("study")
        self.assertEqual(first, ["study", "default", "--out"])
        self.assertRegex(result, f"^{self.local}/[0-9]{{4}}-[0-9]{{2}}-[0-9]{{2}}T[0-9]{{6}}Z-unversioned[.]json$")
        self.assertEqual(self.program_arguments("study", "--repetitions", "3")[:4], ["study", "default", "--repetitions", "3"])
        for out in (["--out", "a b.json"], ["--out=a b.json"]):
            self.assertEqual(self.program_arguments("study", "table1", *out), ["study", "table1", *out])

    def test_a_result_has_the_commit_even_through_a_link(self):
        self.write(self.tools / "git", f"""#!/bin/bash
case "$*" in *--show-toplevel) echo "{self.tree}" ;; *--short*) echo abc1234 ;; esac
""")
        link = self.tree.parent / "link"
        link.symlink_to(self.tree)
        for tree in (self.tree, link):
            done = run(tree / "run", "study", env={"PATH": str(self.tools)})
            self.assertRegex(done.stdout, f"{self.local}/.*Z-abc1234[.]json\n", done.stderr)

    def test_resume_goes_on_with_the_named_result_or_the_one_that_was_cut_short_last(self):
        (self.local / "finished.json").touch()
        done = self.run_script("study", "--resume")
        self.assertEqual(done.returncode, 2)
        self.assertIn(f"there is nothing to resume: no study in {self.local} was cut short", done.stderr)
        for name, age in (("older", 20), ("latest", 10), ("oldest", 30)):
            journal = self.local / f"{name}.json.journal"
            journal.touch()
            os.utime(journal, (1e9 - age, 1e9 - age))
        latest = str(self.local / "latest.json")
        self.assertEqual(self.program_arguments("study", "smoke", "--resume"), ["study", "smoke", "--resume", "--out", latest])
        arguments = ["study", "smoke", "--resume", "--out", "mine.json"]
        self.assertEqual(self.program_arguments(*arguments), arguments)

    def test_names_the_packages_that_are_missing(self):
        done = self.run_script("study", MISSING="cmake libepoxy-dev")
        self.assertEqual(done.returncode, 2)
        self.assertEqual(done.stdout, "Missing packages:\n  cmake\n  libepoxy-dev\n")
        self.assertIn("there is no apt-get here", done.stderr)

    def test_a_build_that_fails_ends_it(self):
        self.write(self.tools / "cmake", "#!/bin/bash\necho broken >&2\nexit 1\n")
        done = self.run_script("study")
        self.assertEqual((done.returncode, done.stdout, done.stderr), (1, "Building.\n", "broken\n"))

    def test_a_build_in_a_pipe_says_how_far_it_is(self):
        self.write(self.tools / "cmake", "#!/bin/bash\necho '[34/171] Building CXX object'\nsleep 2.2\n")
        done = self.run_script("study", VOXSPRING_PROGRESS_SECONDS="1")
        self.assertEqual(done.returncode, 0, done.stderr)
        lines = done.stdout.splitlines()
        self.assertEqual(lines[:3], ["Building."] + 2 * ["Building 34 of 171 ..."])
        self.assertEqual(lines[3], "study")

    def test_what_takes_long_is_heard_in_a_pipe(self):
        self.stand_in("git", "clang-format-14", "shellcheck")
        self.write(self.tools / "ctest", "#!/bin/bash\necho '      Start  1: a'\nsleep 1.2\n"
                   "echo ' 3/47 Test #12: b ...   Passed'\nsleep 1.3\nexit 1\n")
        self.write(self.tools / "cmake", "#!/bin/bash\n[ $1 = --build ] || sleep 1.2\n")
        done = self.run_script("test", "release", VOXSPRING_PROGRESS_SECONDS="1")
        # On a busy machine the first line may come after two seconds.
        for line in (r"Working, [12] s \.\.\.", r"Testing, [12] s \.\.\.", r"Testing 3 of 47 \.\.\."):
            self.assertRegex(done.stdout, rf"(?m)^{line}$")

    def asked_for(self, *arguments):
        """The packages that a command looks for; all are missing, and it gives up."""
        self.write(self.tools / "dpkg-query", "#!/bin/bash\n")
        done = self.run_script(*arguments)
        self.assertEqual(done.returncode, 2)
        self.assertIn("there is no apt-get here", done.stderr)
        return {line.strip() for line in done.stdout.splitlines()[1:]}

    def test_every_command_installs_what_it_needs_and_no_more(self):
        study, view, package, test, every = (self.asked_for(*command) for command in
                                             (["study"], ["view"], ["package"], ["test"], ["test", "all"]))
        window = {"libglfw3-dev", "libimgui-dev"}
        self.assertEqual(view - study, window)
        self.assertEqual(package - study, window | {"libgtest-dev", "libgmock-dev", "xz-utils"})
        self.assertTrue(study < view < package < test < every)
        self.assertNotRegex(" ".join(package), "chromium|selenium|clang|llvm|python|scipy")
        self.assertNotRegex("\n".join(test), r"(?m)chromium|selenium|^clang-1[46]$|clang-tidy|llvm")
        self.assertIn("chromium", every)

    def stage_results(self, *arguments, **environment):
        """The lines that a stand-in for CTest writes of its variables, and the last line of `run test`."""
        self.stand_in("git", "clang-format-14", "shellcheck")
        seen = self.tree / "seen"
        self.write(self.tools / "ctest", "#!/bin/bash\n"
                   f"echo \"$2 ${{VOXSPRING_REQUIRE-unset}}\" >>{seen}\n"
                   f"mkdir {self.tree}/build/release/gtest\n"
                   f"cp {self.tree}/program.xml {self.tree}/build/release/gtest\n"
                   f"while [ $# -gt 0 ]; do [ $1 = --output-junit ] && cp {self.tree}/ctest.xml $2; shift; done\nexit 1\n")
        self.write(self.tree / "program.xml", PROGRAM_RESULTS)
        self.write(self.tree / "ctest.xml", CTEST_RESULTS)
        done = self.run_script("test", *arguments, **environment)
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        self.printed = done.stdout
        return seen.read_text().splitlines(), done.stdout.splitlines()[-1]

    def test_counts_what_the_tests_say_and_requires_mesa(self):
        self.assertEqual(self.stage_results("release"), (["ci gl,vulkan"], "2 passed, 3 failed, 2 skipped"))
        self.assertEqual(self.stage_results("release", VOXSPRING_REQUIRE="")[0][-1], "ci ")
        self.assertEqual(self.stage_results("release", VOXSPRING_REQUIRE="cuda,gl")[0][-1], "ci cuda,gl")

    def test_stages_that_would_begin_too_late_are_skipped_and_named(self):
        for within, skipped in (("0", 3), ("1000", 2)):
            shutil.rmtree(self.tree / "build/release/gtest", ignore_errors=True)
            _, last = self.stage_results("release", "format", VOXSPRING_BEGIN_WITHIN=within)
            self.assertTrue(last.endswith(f", {skipped} skipped"), last)
            self.assertEqual("skipped: the stage format, since" in self.printed, within == "0")
        done = self.run_script("test", "format", VOXSPRING_BEGIN_WITHIN="soon")
        self.assertEqual((done.returncode, done.stderr), (2, "run: VOXSPRING_BEGIN_WITHIN: soon; expected a whole number of seconds\n"))

    def test_the_quick_tests_take_the_program_that_a_study_built(self):
        self.stand_in("ccache")
        said = self.tree / "cmake_said"
        self.write(self.tools / "cmake", "#!/bin/bash\n"
                   f'echo "$* ${{CMAKE_CXX_COMPILER_LAUNCHER-}}${{CCACHE_READONLY+ reads}}" >>{said}\n')

        def calls(*stages):
            said.unlink(missing_ok=True)
            shutil.rmtree(self.tree / "build/release/gtest", ignore_errors=True)
            self.stage_results(*stages)
            return said.read_text().splitlines()
        self.assertEqual(calls("release"), ["--preset ci ccache", "--build --preset ci ccache"])
        self.assertEqual(calls(), ["--preset release ccache reads",
                                   "--build --preset release --target voxspring_quick ccache reads"])
        rules = self.tree / "build/release/CMakeFiles/rules.ninja"
        rules.parent.mkdir()
        rules.write_text("command = /usr/bin/c++ $DEFINES")
        self.assertEqual(calls(), ["--preset release ", "--build --preset release --target voxspring_quick "])

    def count(self, program, ctest=CTEST_RESULTS):
        """What count.py prints of a program's results."""
        self.write(self.tree / "program.xml", program)
        self.write(self.tree / "ctest.xml", ctest)
        return run(sys.executable, ROOT / "tests/count.py", self.tree / "ctest.xml", self.tree, check=True)

    def test_a_program_that_dies_or_tests_nothing_has_failed(self):
        done = self.count("<testsuites/>")
        self.assertEqual(done.stdout, "1 2 1\n")
        self.assertIn("FAILED: program ran no test\nFAILED: crash\n", done.stderr)
        done = self.count('<testsuites><testcase classname="A" name="passes" result="completed"/></testsuites>')
        self.assertEqual(done.stdout, "2 2 1\n")
        self.assertIn("FAILED: program, as a whole\n", done.stderr)
        self.assertIn("1 skipped: cuda_march", self.count(PROGRAM_RESULTS).stderr)

    def test_every_preset_but_those_of_users_takes_warnings_for_errors(self):
        presets = {preset["name"]: preset for preset in json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"]}

        def value(name):
            own = presets[name].get("cacheVariables", {}).get("VOXSPRING_WERROR")
            return own if own is not None else value(presets[name]["inherits"])
        self.assertEqual({name for name in presets if value(name) != "ON"}, {"release", "package"})

    def test_names_the_stages(self):
        done = self.run_script("test", "nosuch")
        self.assertEqual(done.returncode, 2)
        self.assertIn("no stage nosuch; there are release bare format package", done.stderr)

    def test_says_how_it_is_used(self):
        self.assertEqual(self.run_script("help").returncode, 0)
        self.assertEqual(self.run_script("stduy").returncode, 2)
        self.assertIn("./run study", self.run_script("stduy").stderr)
        self.assertIn("run: there is no command stduy\n", self.run_script("stduy").stderr)
        self.assertEqual(self.run_script().returncode, 2)

    def test_what_cannot_be_tried_is_skipped(self):
        self.write(self.tree / "tests/bare.sh", "#!/bin/bash\necho 'there is no debootstrap'\nexit ${CODE-77}\n")
        done = self.run_script("test", "bare")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("there is no debootstrap\nskipped: bare\n", done.stdout)
        self.assertEqual(done.stdout.splitlines()[-1], "0 passed, 0 failed, 1 skipped")
        self.assertEqual(self.run_script("test", "bare", CODE="1").returncode, 1)
        self.assertEqual(self.run_script("test", "bare", CODE="0").stdout.splitlines()[-1], "1 passed, 0 failed, 0 skipped")


if __name__ == "__main__":
    unittest.main()
