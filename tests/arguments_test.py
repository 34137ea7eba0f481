"""What the command line accepts, what it refuses and how it says so; what comes of a full disk behind standard output.

VOXSPRING names the executable; the current directory is the source tree.
"""

import json
import os
import pathlib
import re
import resource
import shutil
import signal
import subprocess
import threading
import unittest

from program import VOXSPRING, InTemporaryFolder, json_of, nrrd, run, succeeds, voxspring

RUN = ("run", "box@4", "--backend", "cpu_reference")


class Words(InTemporaryFolder):
    def test_names_its_version(self):
        said = voxspring("--version")
        self.assertEqual((said.returncode, said.stderr), (0, ""))
        version = re.search(r"project\(voxspring VERSION (\S+)", pathlib.Path("CMakeLists.txt").read_text())[1]
        self.assertRegex(said.stdout, rf"^voxspring {re.escape(version)} \(commit ([0-9a-f]{{12}}|unknown)(, changed since)?\)\n$")

    def test_help_names_every_command_and_the_exit_codes(self):
        said = voxspring("--help").stdout
        for word in ("list", "limits", "info", "run", "study", "advise", "report", "diff", "completion", "130",
                     "VOXSPRING_PROGRESS_SECONDS"):
            self.assertIn(word, said)
        self.assertIn("fpath", voxspring("completion", "--help").stdout)

    def test_asks_what_was_meant(self):
        for arguments, meant in (
                (["stuyd", "smoke"], "study"), (["nosuch"], None), (["infp"], "info"),
                (["info", "haert"], "heart"), (["info", "nothing_like_it"], None), (["info", "haert@4"], "heart"),
                (["study", "defualt"], "default"),
                (["study", "smoke", "--backend", "cpu_paralel"], "cpu_parallel"),
                (["run", "box@4", "--backend", "cpu_paralel"], "cpu_parallel"),
                (["run", "box@4", "--backend", "cpu_parallel:precison=float64"], "precision"),
                ([*RUN, "--stpes", "3"], "--steps"), (["run", "box@4", "--backnd", "cpu_reference"], "--backend"),
                ([*RUN, "--stpes=3"], "--steps"), (["--vesrion"], "--version"), ([*RUN, "--zzz"], None)):
            refused = voxspring(*arguments)
            self.assert_refused(refused)
            if meant:
                self.assertTrue(refused.stderr.endswith(f"; did you mean {meant}?\n"), refused.stderr)
            else:
                self.assertNotIn("did you mean", refused.stderr)
        self.assertIn("expected one of list, limits, info, run, view, study, advise, diff, report, completion", voxspring("nosuch").stderr)

    def test_a_worker_is_not_started_by_hand(self):
        for arguments in (["worker"], ["worker", "--of-a-study"], ["worker", "--of-a-study", "more"]):
            refused = voxspring(*arguments)
            self.assert_refused(refused)
            self.assertIn("worker is not accepted; expected another command: only a study starts workers", refused.stderr)
        for text in (voxspring("--help").stdout, voxspring("completion", "bash").stdout):
            self.assertNotIn("worker", text)

    def test_refuses_numbers_with_their_range(self):
        whole = "a whole number from 1 to 1000000000"
        for option, values, accepted in (
                ("--steps", ("0", "-1", "abc", "1e3", "1000000000000", "3.5", "", "1 "), whole),
                ("--every", ("0", "-1", "abc", "1e3", "1e12"), whole),
                ("--time", ("0", "-1", "nan", "inf", "abc"), "a number from 1e-12 to 1e+12")):
            for value in values:
                self.assert_refused(voxspring(*RUN, f"{option}={value}" if value else option, *([] if value else [""])),
                                    option, value, accepted)
        for option, values, accepted in (
                ("--repetitions", ("0", "-1", "abc", "10001"), "a whole number from 1 to 10000"),
                ("--timeout", ("0", "-1", "nan", "inf", "1e10", "soon"), "a number from 0.001 to 1e+06")):
            for value in values:
                self.assert_refused(voxspring("study", "smoke", f"{option}={value}"), option, value, accepted)
        for value in ("0", "-1", "nan", "inf", "small"):
            self.assert_refused(voxspring("advise", "box@4", f"--error={value}"), "--error", value, "a number from 1e-30 to 1e+06")
        self.assert_refused(voxspring(*RUN, "--time", "1e12"), "--time: 1e+12 ", "the time of at most 1000000000 time steps")
        study = self.write("study.json", {"kind": "pareto", "backends": ["cpu_reference"], "time_steps": [0.5, 1.25e-6],
                                          "scenes": [{"scene": "box@4", "steps": 10**6}]})
        self.assert_refused(voxspring("study", study), "time_steps: 1.25e-06 ", "at most 1000000000 steps")
        self.assert_refused(voxspring(*RUN, "--frames", ""), "--frames", "the path of a folder")
        self.assert_refused(voxspring("info", "box@99999999"), "@99999999", "sides from 1 to 1048576")

    def test_time_in_the_place_of_steps(self):
        time_step = json_of("info", "box@4", "--json")["time_step"]
        exact = succeeds(*RUN, "--time", 10 * time_step)
        self.assertRegex(exact.stdout, r"^box@4: 10 steps of ")
        near = voxspring(*RUN, "--time", 10.3 * time_step)
        said, ran = near.stdout.splitlines()
        self.assertRegex(said, r"^time \S+ is not a multiple of the time step \S+: the run takes 10 steps, to time \S+$")
        self.assertRegex(ran, r"^box@4: 10 steps of ")
        self.assertRegex(voxspring(*RUN, "--time", 1e-6).stdout.splitlines()[-1], r"^box@4: 1 step of ")
        self.assertEqual(voxspring(*RUN, "--time", 1, "--steps", 3).returncode, 2)


class Volume(InTemporaryFolder):
    """Options that replace a scene file."""

    def setUp(self):
        super().setUp()
        # 6 x 5 x 4 voxels: label 2 in the lower two slices, 7 in the third, nothing in the fourth.
        self.data = [2] * 60 + [7] * 30 + [0] * 30
        self.file = self.write("body.nrrd", nrrd("6 5 4", self.data, "spacings: 2 2 3\n"))

    def info(self, *options):
        said = succeeds("info", self.file, "--json", *options)
        return json.loads(said.stdout)

    def test_labels_threshold_spacing_and_gravity(self):
        self.assertEqual((self.info()["active_particles"], self.info()["spacing"]), (90, [2, 2, 3]))
        self.assertEqual(self.info("--threshold", 2)["active_particles"], 30)
        self.assertEqual(self.info("--threshold=-1")["active_particles"], 120)
        self.assertEqual(self.info("--labels", 2)["active_particles"], 60)
        self.assertEqual(self.info("--labels", "2,7")["active_particles"], 90)
        self.assertEqual(self.info("--spacing", 1.5)["spacing"], [1.5, 1.5, 1.5])
        self.assertEqual(self.info("--spacing", "1,2,4")["spacing"], [1, 2, 4])

    def test_a_frame_of_a_4d_file(self):
        self.write("body.nrrd", nrrd("6 5 4 2", self.data + [1] * 120, "spacings: 2 2 3 1\n"))
        self.assert_refused(voxspring("info", self.file), "body.nrrd", "--frame", "from 0 to 1")
        self.assert_refused(voxspring("info", self.file, "--frame", 2), "body.nrrd", "frame", "0 to 1")
        self.assert_refused(voxspring("info", self.file, "--frame=-1"), "--frame", "-1")
        self.assertEqual(self.info("--frame", 0)["active_particles"], 90)
        self.assertEqual(self.info("--frame", 1)["active_particles"], 120)
        self.assertRegex(voxspring("info", self.file, "--frame", 1).stdout, r"(?m)^frame +1 of 2, counted from 0$")

    def test_what_is_guessed_is_said_once(self):
        self.write("body.nrrd", nrrd("6 5 4", self.data))
        note = "the file gives no distance between voxels: 1 is taken"
        self.assertIn(note, self.info()["notes"])
        said = voxspring("info", self.file)
        self.assertRegex(said.stdout, rf"(?m)^note +{note}$")
        self.assertNotIn(note, said.stderr)
        study = ("study", "smoke", "--scene", self.file, "--backend", "cpu_parallel", "--repetitions", 1)
        for command in (("run", self.file, "--backend", "cpu_reference", "--steps", 2), study):
            ran = succeeds(*command)
            self.assertEqual(ran.stderr.count(f"voxspring: body.nrrd: {note}\n"), 1, ran.stderr)

    def test_segments_by_name(self):
        self.file.write_bytes(self.file.read_bytes().replace(
            b"\n\n", b"\nSegment0_ID:=a\nSegment0_Name:=the wall\nSegment0_LabelValue:=2\nSegment0_Layer:=0\n"
            b"Segment1_ID:=b\nSegment1_Name:=valve\nSegment1_LabelValue:=7\nSegment1_Layer:=0\n\n", 1))
        counts = [{"name": "the wall", "voxels": 60}, {"name": "valve", "voxels": 30}]
        self.assertEqual(self.info()["volume"]["labels"], counts)
        self.assertEqual(self.info("--labels", "the wall")["active_particles"], 60)
        self.assertEqual(self.info("--labels", "the wall, 7")["active_particles"], 90)
        self.assertRegex(voxspring("info", self.file).stdout, r"(?m)^label +the wall: 60 voxels$")
        self.assert_refused(voxspring("info", self.file, "--labels", "floor"), "body.nrrd", "floor", "the wall, valve")
        self.assert_refused(voxspring("info", self.file, "--parts", "bigest"), "--parts", "bigest", "largest")
        self.file.write_bytes(self.file.read_bytes().replace(b"valve", b"valv\xe9"))
        self.assertEqual(self.info()["volume"]["labels"][1]["name"], "valv\ufffd")

    def test_a_run_is_that_of_the_scene_file_that_says_the_same(self):
        with open("harness/scenes/heart.json") as file:
            scene = json.load(file)
        del scene["$schema"]
        scene |= {"dataset": {"type": "volume", "file": "body.nrrd", "labels": [2]}, "spacing": [1, 2, 4], "gravity": [0, 0.5, -1e-3]}
        self.write("scene.json", scene)
        run = ("--backend", "cpu_reference", "--steps", 20, "--out")
        for scene, out, options in ((self.file, "a.csv", ("--labels", "2", "--spacing", "1,2,4", "--gravity=0,0.5,-1e-3")),
                                    (self.folder / "scene.json", "b.csv", ())):
            succeeds("run", scene, *run, self.folder / out, *options)
        self.assertEqual((self.folder / "a.csv").read_text(), (self.folder / "b.csv").read_text())

    def test_a_study_takes_them_too(self):
        out = self.folder / "result.json"
        succeeds("study", "smoke", "--scene", self.file, "--labels", 7, "--backend", "cpu_*", "--repetitions", 1, "--out", out)
        self.assertEqual({row["particles"] for row in json.loads(out.read_text())["verification"]}, {30})

    def test_refuses_what_makes_no_volume(self):
        for options, words in ((["--labels", "3"], ("body.nrrd", "3")), (["--labels", "2,2"], ("--labels", "2,2", "once")),
                               (["--labels", ""], ("--labels", "whole number")), (["--labels", "2;7"], ("2;7",)),
                               (["--spacing", "0"], ("--spacing", "0", "1e-12")), (["--spacing", "1,2"], ("--spacing", "1,2", "X,Y,Z")),
                               (["--spacing", "nan"], ("--spacing", "nan")), (["--gravity", "1"], ("--gravity", "X,Y,Z")),
                               (["--gravity", "0,0,inf"], ("--gravity", "inf")), (["--threshold", "7"], ("body.nrrd",)),
                               (["--threshold", "nan"], ("--threshold", "nan"))):
            self.assert_refused(voxspring("info", self.file, *options), *words)
        for scene in ("heart", "box@4"):
            self.assert_refused(voxspring("run", scene, "--backend", "cpu_reference", "--spacing", 2), scene, "a volume file")
        self.assert_refused(voxspring("study", "smoke", "--spacing", 2), "--spacing", "volume file")
        self.assertEqual(voxspring("info", self.file, "--labels", 2, "--threshold", 1).returncode, 2)


class Output(InTemporaryFolder):
    def test_a_full_standard_output_is_an_error(self):
        study = ("study", "smoke", "--scene", "box@4", "--backend", "cpu_reference", "--repetitions", "1")
        for arguments in (("info", "box@8", "--json"), ("list",), ("list", "--json"), RUN, study, ("--help",),
                          ("completion", "bash")):
            with open("/dev/full", "w") as full:
                ran = subprocess.run([VOXSPRING, *arguments], stdout=full, stderr=subprocess.PIPE, text=True, timeout=300)
            self.assertEqual(ran.returncode, 1, arguments)
            self.assertIn("not all of the output could be written to standard output", ran.stderr)

    def test_messages_for_a_closed_standard_error_get_into_no_file(self):
        """The journal has a second name, since the study deletes the first one."""
        out, kept = self.folder / "result.json", self.folder / "kept"
        os.link(self.write("result.json.journal", ""), kept)
        ran = subprocess.run([VOXSPRING, "study", "smoke", "--scene", "box@4", "--backend", "cpu_reference", "--repetitions", "1",
                              "--out", out], preexec_fn=lambda: os.close(2), stdout=subprocess.DEVNULL, timeout=300)
        self.assertEqual(ran.returncode, 0)
        lines = kept.read_text().splitlines()
        self.assertGreater(len(lines), 1)
        for line in lines:
            self.assertTrue(line.startswith('{"check":"'), line)

    def test_follows_a_link_and_writes_to_a_pipe(self):
        target, link = self.folder / "target.csv", self.folder / "link.csv"
        link.symlink_to(target.name)
        for _ in range(2):  # to a file that does not exist, and to one that does
            self.assertEqual(voxspring(*RUN, "--steps", 3, "--out", link).returncode, 0)
            self.assertTrue(link.is_symlink())
            self.assertFalse(target.is_symlink())
            self.assertEqual(len(target.read_text().splitlines()), 65)
        pipe = self.folder / "pipe.csv"
        os.mkfifo(pipe)
        read = []
        reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
        reader.start()
        self.assertEqual(voxspring(*RUN, "--steps", 3, "--out", pipe).returncode, 0)
        reader.join()
        self.assertTrue(pipe.is_fifo())
        self.assertEqual(read[0], target.read_text())

    def test_a_full_disk_leaves_what_was_there(self):
        """A limit on the size of files simulates a full disk: the same error from the same call."""
        # LLVM's OpenMP has a file of 1024 bytes in shared memory.
        full = {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1100, 1100))}
        for ending in ("csv", "npz", "vtu"):
            out = self.folder / f"state.{ending}"
            for before in (None, b"of a run before"):
                if before:
                    out.write_bytes(before)
                ran = voxspring("run", "box@16", "--backend", "cpu_reference", "--steps", 2, "--out", out, **full)
                self.assertEqual(ran.returncode, 1, ran.stderr)
                self.assertRegex(ran.stderr, rf"cannot write .*state\.{ending}: File too large")
                self.assertEqual(out.read_bytes() if out.exists() else None, before)
                self.assertEqual([p.name for p in self.folder.iterdir()], [out.name] if before else [], "a temporary file")
            out.unlink()

    def test_a_folder_is_no_file(self):
        folder = self.folder / "d.csv"
        folder.mkdir()
        self.assert_refused(voxspring(*RUN, "--steps", 1000000000, "--out", folder), "d.csv", "folder")
        result = self.folder / "d.json"
        result.mkdir()
        self.assert_refused(voxspring("study", "smoke", "--out", result), "d.json", "folder")

    def test_results_of_another_kind_are_refused(self):
        for text in ('{"context": 1}', '{"context": {}, "pareto": 3}', '{"pareto": [{}]}', "[]", '"\\ud800"'):
            other = self.folder / "other.json"
            other.write_text(text)
            self.assert_refused(voxspring("advise", "box@4", "--error", 1, "--results", other), "other.json")
            # As after a study that was not finished, and whose journal is lost.
            ran = voxspring("study", "smoke", "--scene", "box@4", "--backend", "cpu_reference", "--repetitions", 1, "--resume",
                            "--out", other)
            self.assertIn(ran.returncode, (0, 2), ran.stderr)
            self.assertNotIn("json.exception", ran.stderr)

    def test_advice_takes_only_whole_results_of_its_kind(self):
        def context(kind, **more):
            return {"context": {"voxspring": {"study": {"kind": kind}, **more}}}

        for kind, scene, options, figures in (("truth", "cantilever", ["--continuum", "--error", 1], ["model_error", "seconds"]),
                                              ("scaling", "box@4", ["--ranks", 2], ["ranks", "seconds_per_step"])):
            row = {"name": f"{scene}/cpu_explicit/increment/float64", "scene": scene, "particles": 8, "steps": 1}
            row |= dict.fromkeys(figures, 1)
            whole = context(kind) | {kind: [row]}
            for result, words in (
                    (context("timing") | {"benchmarks": []}, [f"{kind} is missing", f"result of a study of kind {kind}"]),
                    ({kind: [row]}, ["context is missing"]),
                    (whole | {"context": 1}, ["context: 1", "an object"]),
                    (whole | context("pareto"), ['context.voxspring.study.kind: "pareto"', f"expected {kind}"]),
                    (whole | {kind: 3}, [f"{kind}: 3", "an array"]),
                    (whole | {kind: []}, [f"{kind}: {scene}", "it has none"]),
                    (whole | {kind: [row | {"name": "box"}]}, [f'{kind}[0].name: "box"', f"{scene}/BACKEND"]),
                    (whole | {kind: [{"name": row["name"], "scene": scene}]}, [f"{kind}[0].particles is missing"]),
                    *((whole | {kind: [row, row | {figure: value}]}, [f"{kind}[1].{figure}: {said}", "a number from 0"])
                      for figure in figures for value, said in ((None, "null"), (-1, "-1"))),
                    (whole | {kind: [row, row | {"steps": "many"}]}, [f"{kind}[1]: ", "results/schema.json"]),
                    (context(kind, counters={"steps": {"unit": "eV", "better": "less"}}) | {kind: [row]}, [f"{kind}[0]: ", "eV"])):
                other = self.write("other.json", result)
                self.assert_refused(voxspring("advise", scene, *options, "--results", other), "other.json", *words)

    def test_progress_in_a_pipe(self):
        environment = os.environ | {"VOXSPRING_PROGRESS_SECONDS": "0.02"}
        ran = succeeds("run", "box@20", "--backend", "cpu_reference", "--steps", 400, env=environment)
        self.assertRegex(ran.stderr, r"(?m)^voxspring: box@20 on cpu_reference/\S+: step \d+ of 400, \d+ s, \d+ s left$")
        told = voxspring("info", "box@24", env=environment)
        self.assertRegex(told.stderr, r"(?m)^voxspring: computing the limit of the time step by Lanczos' iteration, \d+ s")
        study = voxspring("study", "smoke", "--scene", "box@12", "--backend", "cpu_reference", env=environment)
        self.assertRegex(study.stderr, r"(?m)^\[1/1\] box@12 \d+/\d+, 0/1 rows?.*: cpu_reference/")
        self.assertEqual(voxspring("run", "box@20", "--backend", "cpu_reference", "--steps", 400).stderr, "")
        for value in ("soon", "5 min", "0", "-1", "nan", "1e7"):
            refused = voxspring(*RUN, env=os.environ | {"VOXSPRING_PROGRESS_SECONDS": value})
            self.assert_refused(refused, "VOXSPRING_PROGRESS_SECONDS", value, "from 0.01 to 1e+06")


class Shells(InTemporaryFolder):
    def test_bash_completes_commands_options_and_names(self):
        (self.folder / "my_heart.json").touch()
        for words, expected in ((["st"], "study"), (["run", "--st"], "--steps"), (["run", "hea"], "heart"), (["run", "my"], "my_heart.json"),
                                (["run", "box", "--backend", "cpu_r"], "cpu_reference"), (["study", "smo"], "smoke"),
                                (["run", "box", "--colour", "e"], "error"), (["study", "smoke", "--out", "my"], "my_heart.json"),
                                (["diff", "my"], "my_heart.json"), (["nosuch", "my"], "my_heart.json"), (["completion", "b"], "bash")):
            script = f"""source <({VOXSPRING} completion bash)
                COMP_WORDS=({" ".join(f"'{word}'" for word in (VOXSPRING, *words))}) COMP_CWORD={len(words)}
                _voxspring; printf '%s\\n' "${{COMPREPLY[@]}}" """
            done = run("bash", "-c", script, cwd=self.folder)
            self.assertEqual((done.returncode, done.stderr, done.stdout), (0, "", f"{expected}\n"), words)

    def test_the_scripts_are_those_of_the_tree(self):
        for shell, check in (("bash", "shellcheck"), ("zsh", "zsh")):
            script = f"harness/cli/completion.{shell}"
            self.assertEqual(voxspring("completion", shell).stdout, pathlib.Path(script).read_text())
            if shutil.which(check):
                checked = run(check, *(["-n"] if check == "zsh" else ["-s", "bash"]), script)
                self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)
        self.assert_refused(voxspring("completion", "fish"), "fish", "bash or zsh")


class Scripts(InTemporaryFolder):
    def place(self, program, scripts):
        (self.folder / program).parent.mkdir(parents=True)
        shutil.copy(VOXSPRING, self.folder / program)
        if scripts:
            shutil.copytree("results", self.folder / scripts, ignore=shutil.ignore_patterns("nvidia*", "amd*", "local", "*.png"))
        return self.folder / program

    def test_are_found_in_a_tree_a_prefix_and_a_package(self):
        for program, scripts in (("tree/build/release/voxspring", "tree/results"),
                                 ("prefix/bin/voxspring", "prefix/share/voxspring/results"),
                                 ("package/bin/voxspring", "package/results")):
            # The system's Python has the packages; another one on the PATH may not.
            called = run(self.place(program, scripts), "diff", "--help", env={"PATH": "/usr/bin:/bin"})
            self.assertEqual(called.returncode, 0, called.stderr)
            self.assertIn("--across-devices", called.stdout)

    def test_say_where_they_are_not(self):
        program = self.place("alone/bin/voxspring", None)
        for command in ("diff", "report"):
            called = run(program, command)
            self.assert_refused(called, f"{command}.py", str(program.parent))

    def python(self, folder, *options):
        """A Python that runs with other options than the system's, in `folder`."""
        path = self.folder / folder
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'#!/bin/sh\necho "$0" >> {self.folder}/started\nexec /usr/bin/python3 {" ".join(options)} "$@"\n')
        path.chmod(0o755)
        return path

    def test_find_a_python_that_works(self):
        """The Python of `./run report`, the system's, or the PATH's: the first that has the packages, whatever the PATH begins with."""
        program = self.place("tree/build/release/voxspring", "tree/results")
        bare = self.python("path/python3", "-I", "-S")
        called = run(program, "diff", "none.json", "none.json", env={"PATH": f"{bare.parent}:/usr/bin:/bin"})
        self.assert_refused(called, "diff.py: none.json")
        own = self.python("tree/build/report-venv/bin/python", "-I", "-S")
        called = run(program, "diff", "none.json", "none.json", env={"PATH": "/usr/bin:/bin"})
        self.assert_refused(called, "diff.py: none.json")
        started = (self.folder / "started").read_text().splitlines()
        self.assertEqual(started, [str(own)], "it was asked, and has no scipy")
        self.python("tree/build/report-venv/bin/python")
        self.assert_refused(run(program, "diff", "none.json", "none.json"), "diff.py: none.json")
        self.assertEqual((self.folder / "started").read_text().splitlines()[1:], 2 * [str(own)], "asked, and taken")

    def test_say_what_each_python_lacks(self):
        program = self.place("tree/build/release/voxspring", "tree/results")
        own, bare = self.python("tree/build/report-venv/bin/python"), self.python("path/python3")
        modules = self.folder / "modules"
        modules.mkdir()
        for name in ("scipy", "vl_convert"):
            (modules / f"{name}.py").write_text("raise ImportError('no compiler for it')")
        environment = {"PATH": str(bare.parent), "PYTHONPATH": str(modules)}
        self.python("path/python3", "-I", "-S")
        called = run(program, "diff", "a.json", "b.json", env=environment)
        self.assert_refused(called, f"{own}: ImportError: no compiler for it", "/usr/bin/python3: ImportError: no compiler for it",
                            "python3 of the PATH: ModuleNotFoundError: No module named 'scipy'", "install Debian's python3-scipy",
                            "requirements.txt")
        called = run(program, "report", "--out", "a.html", env=environment)
        self.assert_refused(called, "fastjsonschema, jinja2, PIL, scipy.stats, vl_convert", f"{own}: ImportError", "requirements.txt")
        for command in ("diff", "report"):
            called = run(program, command, "--help", env=environment)
            self.assertEqual((called.returncode, called.stderr), (0, ""))
            self.assertIn(f"Usage: {command}.py", called.stdout)

    def test_give_the_scripts_exit_code(self):
        program = self.place("prefix/bin/voxspring", "prefix/share/voxspring/results")
        self.assertEqual(run(program, "diff", "none.json", "none.json").returncode, 2)
        # As under a parent that does not wait for its children.
        ignored = {"preexec_fn": lambda: signal.signal(signal.SIGCHLD, signal.SIG_IGN)}
        self.assertEqual(run(program, "diff", "--help", **ignored).returncode, 0)


if __name__ == "__main__":
    unittest.main()
