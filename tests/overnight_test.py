"""A study that is left alone: backends that crash and hang, kills, full disks, Ctrl-C and what is shown meanwhile.

FAULTY names the program with tests/faulty_backends.cpp in it; the current directory is the source tree.
"""

import collections
import contextlib
import ctypes
import json
import os
import pathlib
import random
import re
import resource
import signal
import subprocess
import time
import unittest

from faulty import FAULTY, PATIENCE, FaultyStudies, processes
from folder import run
from terminal import on_terminal

SANITIZED = os.environ["SANITIZED"] == "1"


class Hash128(ctypes.Structure):
    _fields_ = [("low", ctypes.c_uint64), ("high", ctypes.c_uint64)]


XXHASH = ctypes.CDLL("libxxhash.so.0")
XXHASH.XXH3_128bits.restype = Hash128
XXHASH.XXH3_128bits.argtypes = [ctypes.c_char_p, ctypes.c_size_t]


def check_of(rest):
    """XXH3 of 128 bits, as in harness/process/journal.cpp."""
    text = rest.encode()
    found = XXHASH.XXH3_128bits(text, len(text))
    return f"{found.high:016x}{found.low:016x}"


def lines_of(journal):
    """Finished measurements by name, each as often as it occurs; an unfinished last line does not count."""
    found = collections.defaultdict(list)
    for line in journal.read_bytes().decode().split("\n")[1:-1]:
        rest = line[len('{"check":"') + 33:]
        assert json.loads(line)["check"] == check_of(rest), line
        found[json.loads(line)["name"]].append(line)
    return found


def cpu_ticks_of_session(session):
    """The ticks that all processes of a session have used so far."""
    ticks = 0
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has ended meanwhile
        if int(fields[3]) == session:
            ticks += int(fields[11]) + int(fields[12])
    return ticks


class Overnight(FaultyStudies):
    def command(self, *options):
        return [FAULTY, "study", self.folder / "study.json", "--out", self.out, *map(str, options)]

    def run_study(self, *options, code=0, **how):
        ran = run(*self.command(*options), **how)
        self.assertEqual(ran.returncode, code, ran.stdout + ran.stderr)
        return ran

    def start(self, *options, **how):
        return subprocess.Popen(self.command(*options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **how)

    def kill(self, ran):
        ran.kill()
        ran.communicate()
        self.assert_nothing_runs()


class Faults(Overnight):
    def test_take_their_own_row_and_nothing_else(self):
        # A sanitizer needs the address space that `faulty_takes_all_memory` takes away, and hangs without it.
        self.study(backends=["faulty_[!t]*" if SANITIZED else "faulty_*", "cpu_reference"],
                   scenes=[{"scene": "box@4"}, {"scene": "box@5", "backends": ["faulty_crashes", "cpu_reference"]}])
        # Longer than anything that does not hang takes while other programs also use the processors: measuring the limits took
        # more than 6.
        seconds = 15
        self.run_study("--timeout", seconds, code=1)
        result = self.result()
        late = f"did not answer within {seconds} s while "
        reasons = {"faulty_crashes": "was killed by signal 11 (Segmentation fault) while warming up",
                   "faulty_hangs": late + "warming up",
                   "faulty_is_killed":
                       "was killed by signal 9 (Killed), as the system does when memory runs out while warming up",
                   "faulty_takes_all_memory": "out of memory on the host",
                   "faulty_aborts_when_constructed":
                       "was killed by signal 6 (Aborted) while constructing faulty_aborts_when_constructed",
                   "faulty_hangs_when_constructed": late + "constructing faulty_hangs_when_constructed"}
        if SANITIZED:
            del reasons["faulty_takes_all_memory"]
        found = {(row["scene"], row["backend"]): row["reason"] for row in result["failed"]}
        self.assertEqual(found, {("box@4", backend): reason for backend, reason in reasons.items()} |
                         {("box@5", "faulty_crashes"): reasons["faulty_crashes"]})
        self.assertEqual(len(result["failed"]), len(found))
        self.assertEqual({(row["scene"], row["backend"]) for row in result["benchmarks"]},
                         {("box@4", "cpu_reference"), ("box@5", "cpu_reference")})
        self.assertFalse(self.journal.exists())
        self.assert_nothing_runs()

    def test_take_their_own_row_where_cases_start_at_once(self):
        self.study(backends=["faulty_aborts_when_constructed", "faulty_crashes", "cpu_*"], start_times=False,
                   scenes=[{"scene": "box@4"}])
        self.run_study(code=1)
        result = self.result()
        self.assertEqual({row["backend"]: row["reason"] for row in result["failed"]},
                         {"faulty_crashes": "was killed by signal 11 (Segmentation fault) while warming up",
                          "faulty_aborts_when_constructed":
                              "was killed by signal 6 (Aborted) while constructing faulty_aborts_when_constructed"})
        self.assertEqual({row["backend"] for row in result["benchmarks"]}, {"cpu_reference", "cpu_parallel", "cpu_explicit"})
        self.assertFalse([row for row in result["benchmarks"] if "construct_seconds" in row or "ready_seconds" in row])
        self.assertTrue(all("limit_seconds" in row for row in result["benchmarks"]))
        self.assert_nothing_runs()

    def test_are_taken_by_every_kind_of_study(self):
        backends = ["faulty_crashes", "cpu_parallel"]
        for study in ({"kind": "pareto", "time_steps": [0.5, 0.25], "scenes": [{"scene": "box@4"}]},
                      {"kind": "stability", "scenes": [{"scene": "box@3"}]},
                      {"kind": "stress", "suites": [{"lengths": "shortest"}]},
                      {"kind": "fastest", "scenes": [{"scene": "box@4", "rewind": False}]}):
            self.write("study.json", study | {"backends": backends})
            self.run_study(code=1)
            result = self.result()
            self.assertEqual([row["backend"] for row in result["failed"]], ["faulty_crashes"], study)
            self.assertIn("signal 11", result["failed"][0]["reason"])
            rows = result["benchmarks"] + sum((result.get(kind, []) for kind in ("pareto", "stability", "stress")), [])
            self.assertEqual({row["backend"] for row in rows}, {"cpu_parallel"})


class Kills(Overnight):
    def kill_after(self, more, name):
        """Kills the study once its journal has that many more measurements with `name` in theirs; returns the seconds
        that this took."""
        def measured():
            return sum(name in key for key in lines_of(self.journal)) if self.journal.exists() else 0
        wanted = measured() + more
        begin = time.monotonic()
        ran = self.start("--resume")
        self.wait_for(lambda: measured() >= wanted, "it does not begin")
        seconds = time.monotonic() - begin
        self.kill(ran)
        return seconds

    def kill_and_resume(self, kills, name, further, seed):
        """Kills the study `kills` times, at random from its begin to `further` seconds beyond what it takes to
        come to its next measurement, which has `name` in its own; then lets it end. Returns every line that a
        journal ever had, by name, and the last output."""
        self.kill_after(1, name)  # skips the measurement of the device's limits, which is done only once
        longest = self.kill_after(1, name) + further
        chance = random.Random(seed)
        lines = {}
        for number in range(2, kills):
            ran = self.start("--resume")
            time.sleep(chance.uniform(0, longest))
            self.kill(ran)
            if ran.returncode == 0:
                self.fail(f"it was done before kill {number + 1} of {kills}: the test proves nothing")
            now = lines_of(self.journal)
            for name, found in now.items():
                self.assertEqual(len(found), 1, f"{name} was measured again")
            self.assertLessEqual(lines.items(), {name: found[0] for name, found in now.items()}.items(),
                                 "what was finished is lost or has changed")
            lines = {name: found[0] for name, found in now.items()}
        # A reader may come before the journal is removed, since the process is no longer killed.
        ran = self.run_study("--resume")
        self.assertFalse(self.journal.exists())
        return lines, ran

    def test_timing_loses_no_finished_case_and_repeats_none(self):
        repetitions = 5
        scenes = [f"box@{n}" for n in range(4, 12)]
        self.study(backends=["cpu_reference", "cpu_parallel", "slow"], steps=20, repetitions=repetitions,
                   scenes=[{"scene": scene} for scene in scenes])
        # About one session in four finishes the cases of a scene.
        lines, ran = self.kill_and_resume(12, " repetitions", 0.2, seed=1)
        result = self.result()
        self.assertEqual(ran.stderr.count("cut short"), 0, "a torn line was dropped by an earlier session")
        names = collections.Counter(row["name"] for row in result["benchmarks"] if row["run_type"] == "iteration")
        self.assertEqual(len(names), 3 * len(scenes))
        self.assertEqual(set(names.values()), {repetitions})
        self.assertEqual([row["repetitions_judged"] for row in result["verification"]], 3 * len(scenes) * [repetitions])
        self.assertEqual(result["failed"] + result["skipped"], [])
        self.assertGreater(result["context"]["voxspring"]["study"]["sessions"], 2)
        self.assertNotIn("unfinished", result["context"]["voxspring"])
        # The times are those measured before the kills.
        times = {(1 + scenes.index(row["scene"]), row["name"].split("/iterations:")[0].partition("/")[2],
                  row["repetition_index"]): row["real_time"] for row in result["benchmarks"] if row["run_type"] == "iteration"}
        kept = 0
        for name, line in lines.items():
            if measured := re.fullmatch(r"(\d) (\S+) repetitions", name):
                kept += 1
                for number, one in enumerate(json.loads(line)["value"]):
                    self.assertAlmostEqual(times[int(measured[1]), measured[2], number], one["device_seconds"] / 20 * 1e6, places=9)
        self.assertGreater(kept, 1, "the kills came too early to prove anything")

    def test_rows_of_other_kinds_are_there_once(self):
        for study, word, count in (
                ({"kind": "pareto", "time_steps": [0.5, 0.25, 0.125], "steps": 50,
                  "scenes": [{"scene": "box@6"}], "backends": ["cpu_*:formulation=*"]}, "row of", 45),
                ({"kind": "stability", "scenes": [{"scene": "box@4"}], "backends": ["cpu_parallel:formulation=*"]},
                 "measurement", 35),
                ({"kind": "stress", "suites": [{"lengths": "shortest"}], "backends": ["cpu_parallel:formulation=*"]},
                 "measurement", None)):
            self.write("study.json", study)
            self.out.unlink(missing_ok=True)
            self.kill_and_resume(4, word, 0.05, seed=2)
            result = self.result()
            rows = [(row["name"], row.get("steps"), row.get("damping"), str(row.get("start")), row.get("measurement"),
                     row.get("detail"), row.get("time_step")) for row in result[study["kind"]]]
            self.assertEqual(len(rows), len(set(rows)))
            if count is not None:
                self.assertEqual(len(rows), count)
            else:
                self.assertEqual({row["part"] for row in result["stress"]}, set(range(1, 10)))
            self.assertEqual(result["failed"], [])

    def test_batches_that_go_on_from_each_other_do_so(self):
        """If batches are not rewound, a resumed contender reaches the state that it would have reached without a kill."""
        study = {"kind": "fastest", "backends": ["cpu_reference", "slow"], "repetitions": 20,
                 "scenes": [{"scene": f"beam@3x3x{n}", "rewind": False} for n in range(6, 12)]}
        self.study(**study)
        self.kill_and_resume(4, " repetitions", 0.1, seed=3)
        errors = {row["backend"]: row["error_relative_l2"] for row in self.result()["benchmarks"]}
        # Both are cpu_reference after 4 * (1 + 20) steps.
        self.assertEqual(errors, {"cpu_reference": 0, "slow": 0})


class Interruptions(Overnight):
    def begin(self):
        """A study that makes repetitions of its second scene, in a new session as under a terminal."""
        self.study(backends=["slow_device", "cpu_reference"], repetitions=20,
                   scenes=[{"scene": "box@4", "backends": ["cpu_reference"]}, {"scene": "box@5"}, {"scene": "box@6"}])
        ran = self.start(start_new_session=True, env=os.environ | {"VOXSPRING_PROGRESS_SECONDS": "0.01"})
        self.addCleanup(ran.kill)
        self.assertTrue(any(re.match(r"\[2/3\] box@5 [3-9]/20", line) for line in ran.stderr), "it does not begin")
        return ran

    def test_ctrl_c_keeps_what_is_done_and_resume_goes_on(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            ran = self.begin()
            os.killpg(ran.pid, number)
            stdout, stderr = ran.communicate(timeout=PATIENCE)
            self.assertEqual(ran.returncode, 130, stderr)
            self.assertIn("interrupt again to stop at once", stderr)
            self.assertIn("--resume goes on", stdout)
            self.assert_nothing_runs()
            result = self.result()
            self.assertIs(result["context"]["voxspring"]["unfinished"], True)
            self.assertEqual({row["scene"] for row in result["benchmarks"]}, {"box@4"})
            self.assertEqual(result["failed"], [], "what was not finished has not failed")
            self.run_study("--resume")
            result = self.result()
            self.assertNotIn("unfinished", result["context"]["voxspring"])
            self.assertEqual(result["context"]["voxspring"]["study"]["sessions"], 2)
            self.assertEqual(len([row for row in result["benchmarks"] if row["run_type"] == "iteration"]), 5 * 20)
            self.assertEqual([row["repetitions_judged"] for row in result["verification"]], 5 * [20])
            self.assertFalse(self.journal.exists())

    def test_where_memory_runs_out_a_worker_is_ended_and_not_the_study(self):
        ran = self.begin()
        of_study = int(pathlib.Path(f"/proc/{ran.pid}/oom_score_adj").read_text())
        self.assertLess(of_study, 1000)

        def of_others():
            # A process may end between the two calls, and the launcher of workers has the study's score.
            found = []
            for process in set(processes()) - self.before - {ran.pid}:
                with contextlib.suppress(OSError):
                    found.append(int(pathlib.Path(f"/proc/{process}/oom_score_adj").read_text()))
            return found

        self.wait_for(lambda: sorted(set(of_others())) == [of_study, 1000], "no worker offers itself")
        self.kill(ran)

    def test_a_second_ctrl_c_stops_at_once(self):
        self.study(backends=["faulty_hangs"], scenes=[{"scene": "box@4"}])
        ran = self.start(start_new_session=True)
        self.addCleanup(ran.kill)
        self.wait_for(lambda: self.journal.exists() and "introduction" in self.journal.read_text(), "it does not begin")
        # It hangs once none of its processes has used time for a while.
        def idle():
            before = cpu_ticks_of_session(ran.pid)
            time.sleep(0.5)
            return cpu_ticks_of_session(ran.pid) == before
        self.wait_for(idle, "it does not hang")
        os.killpg(ran.pid, signal.SIGINT)
        time.sleep(0.2)
        self.assertIsNone(ran.poll(), "the first one waits for what is in flight")
        os.killpg(ran.pid, signal.SIGINT)
        ran.communicate(timeout=PATIENCE)
        self.assertEqual(ran.returncode, 130)
        self.assert_nothing_runs()


class Progress(Overnight):
    STUDY = {"backends": ["slow", "cpu_reference"], "repetitions": 4,
             "scenes": [{"scene": "box@4"}, {"scene": "box@5", "backends": ["slow"]}]}

    def test_in_a_pipe_is_a_line_a_scene(self):
        self.study(**self.STUDY)
        # Lines that appear every ten seconds are left out, since a busy machine would print some in between.
        ran = self.run_study(env={**os.environ, "VOXSPRING_PROGRESS_SECONDS": "3600"})
        first, second = ran.stderr.splitlines()
        self.assertRegex(first, r"^\[1/2\] box@4: 2 rows in \S+ s, about \d+ (s|min) left$")
        self.assertRegex(second, r"^\[2/2\] box@5: 1 row in \S+ s$")
        self.assertNotIn("rows in", ran.stdout)

    def test_in_a_pipe_is_a_line_every_ten_seconds_while_a_case_says_nothing(self):
        self.study(backends=["faulty_hangs"], scenes=[{"scene": "box@4"}])
        ran = self.run_study("--timeout", 3, code=1, env={**os.environ, "VOXSPRING_PROGRESS_SECONDS": "0.5"})
        lines = [line for line in ran.stderr.splitlines() if re.match(r"\[1/1\] box@4 0/\d, 0/1 row: faulty_hangs/", line)]
        self.assertGreater(len(lines), 3, ran.stderr)
        self.assertRegex(lines[-1], r"float64, \d s$")

    def test_counts_what_can_run(self):
        """The four backends that can run are half of all; the others are found missing last."""
        nowhere = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json",
                   "VOXSPRING_VULKAN_LOADER": "/nonexistent", "VOXSPRING_PROGRESS_SECONDS": "0.01"}
        for study, rows in (({"kind": "overhead"}, 2), ({"kind": "pareto", "time_steps": [0.5, 0.25]}, 2),
                            ({"kind": "stability"}, 7), ({"kind": "timing"}, 1)):
            self.write("study.json", {"steps": 20, "repetitions": 2, "backends": ["gl_*", "slow", "cpu_*"],
                                      "scenes": [{"scene": "box@4"}]} | study)
            ran = self.run_study(env={**os.environ, **nowhere})
            shown = set(re.findall(r"(?m)^\[1/1\] box@4 \d+/\d+, 0/(\d+) rows", ran.stderr))
            self.assertEqual(shown, {str(4 * rows)}, study)
            self.assertEqual(len(self.result()["skipped"]), 4)
            self.out.unlink()

    def test_on_a_terminal_is_a_line_that_is_overwritten(self):
        self.study(**self.STUDY)
        columns = 100
        code, table, shown = on_terminal(self.command(), columns)
        self.assertEqual(code, 0)
        self.assertNotIn("\x1b", table)
        self.assertNotIn(b"\n", shown)
        lines = [line.removeprefix("\x1b[K") for line in shown.decode().split("\r")]
        self.assertEqual(lines[-1], "", "it is gone in the end")
        self.assertTrue(all(len(line) < columns for line in lines))
        form = re.compile(r"\[(\d)/2\] (box@\d) (\d+)/(\d+), (\d)/3 rows?(?:, about \d+ (?:s|min) left)?: (?:judging |starting )?(\S+?)(?: once more)?(?:, \d+ s)?")
        found = [form.fullmatch(line) for line in lines if line]
        self.assertNotIn(None, found, lines)
        self.assertEqual({match[6] for match in found}, {"slow/increment/float64", "cpu_reference/increment/float64"})
        self.assertEqual([int(match[3]) for match in found if match[2] == "box@4" and match[4] == "4"],
                         2 * [0, *range(4), 4], "two host cases, one after the other: the warm-up, every repetition, and a state")
        self.assertEqual({(match[1], match[5]) for match in found}, {("1", "0"), ("2", "2")})
        self.assertTrue(any(" left: " in line for line in lines))


class JournalFile(Overnight):
    STUDY = {"backends": ["slow", "cpu_reference"], "scenes": [{"scene": "box@4"}, {"scene": "own.json"}],
             "repetitions": 3}
    SCENE = {"dataset": {"type": "box", "dims": [3, 3, 3]}, "gravity": [0, 0, -0.01]}

    def setUp(self):
        super().setUp()
        self.study(**self.STUDY)
        self.write("own.json", self.SCENE)

    def cut_short(self):
        ran = self.start()
        self.wait_for(lambda: self.journal.exists() and " repetitions" in self.journal.read_text(),
                      "it does not begin")
        self.kill(ran)

    def test_is_not_overwritten(self):
        self.cut_short()
        before = self.journal.read_bytes()
        self.assert_refused(self.run_study(code=2), "result.json.journal", "--resume", "delete")
        self.assertEqual(self.journal.read_bytes(), before)
        self.run_study("--resume")
        finished = self.out.read_bytes()
        self.assert_refused(self.run_study("--resume", code=2), "result.json", "finished")
        self.assertEqual(self.out.read_bytes(), finished)

    def test_of_another_study_is_refused(self):
        self.cut_short()
        before = self.journal.read_bytes()
        self.assert_refused(self.run_study("--resume", "--repetitions", 4, code=2), ".journal", "repetitions", "3", "4")
        self.assert_refused(self.run_study("--resume", "--backend", "slow", code=2), ".journal", "--backend", "slow")
        self.study(**self.STUDY | {"backends": ["cpu_reference"]})
        self.assert_refused(self.run_study("--resume", code=2), ".journal", "backends", "slow")
        self.study(**self.STUDY)
        self.write("own.json", self.SCENE | {"gravity": [0, 0, -0.02]})
        self.assert_refused(self.run_study("--resume", code=2), ".journal", "files", "own.json")
        self.write("own.json", self.SCENE)
        self.assertEqual(self.journal.read_bytes(), before)

    def test_says_in_words_what_differs(self):
        self.cut_short()
        self.study(**self.STUDY | {"scenes": [{"scene": "box@5"}, {"scene": "own.json"}]})
        ran = self.run_study("--resume", code=2)
        self.assert_refused(ran, ".journal", "scenes 1 1", "box@4", "box@5")
        for mark in '[]{}"':
            self.assertNotIn(mark, ran.stderr)

    def test_knows_a_resized_scene_file_beside_the_study(self):
        self.study(**self.STUDY | {"scenes": [{"scene": "own.json@4"}]})
        self.cut_short()
        self.write("own.json", self.SCENE | {"gravity": [0, 0, -0.02]})
        self.assert_refused(self.run_study("--resume", code=2), ".journal", "files", "own.json@4")
        self.write("own.json", self.SCENE)
        self.run_study("--resume")
        self.assertEqual({row["particles"] for row in self.result()["verification"]}, {64})

    def test_that_is_not_there_is_begun_which_is_said(self):
        ran = self.run_study("--resume")
        self.assertIn("there is no ", ran.stderr)
        self.assertIn("result.json.journal to resume: the study starts from the beginning", ran.stderr)

    def change(self, pattern, replacement):
        """Changes a line of the journal and its check, as if it had been written so."""
        lines = self.journal.read_text().split("\n")
        changed = 0
        for number, line in enumerate(lines):
            rest = re.sub(pattern, replacement, line[len('{"check":"') + 33:])
            if line and rest != line[len('{"check":"') + 33:]:
                lines[number] = '{"check":"' + check_of(rest) + '"' + rest
                changed += 1
        self.assertGreater(changed, 0)
        self.journal.write_text("\n".join(lines))

    def test_of_another_build_or_device_is_refused(self):
        self.cut_short()
        good = self.journal.read_bytes()
        for pattern, replacement, words in (
                (r'"program":"\w+"', '"program":"0123"', ["program", "0123"]),
                (r'"cpu":"[^"]+"', '"cpu":"Another CPU"', ["cpu", "Another CPU"]),
                (r'"device":"[^"]+"', '"device":"Another card"', ["device of", "Another card"]),
                (r'"journal":2', '"journal":1', ["journal", "version 2"])):
            self.change(pattern, replacement)
            self.assert_refused(self.run_study("--resume", code=2), ".journal", *words)
            self.journal.write_bytes(good)

    def test_that_is_corrupt_is_refused_and_a_torn_end_is_dropped(self):
        self.cut_short()
        good = self.journal.read_bytes()
        lines = good.split(b"\n")
        for number in (0, 2, len(lines) - 2):
            middle = len(lines[number]) // 2
            for bad in (lines[number][:middle] + b"#" + lines[number][middle + 1:], lines[number][:middle], b""):
                self.journal.write_bytes(b"\n".join(lines[:number] + [bad] + lines[number + 1:]))
                self.assert_refused(self.run_study("--resume", code=2), ".journal", f"line {number + 1}", "corrupt")
        self.journal.write_bytes(good[:-20])
        ran = self.run_study("--resume")
        self.assertIn("the last line was cut short and is dropped", ran.stderr)
        self.assertEqual(len([r for r in self.result()["benchmarks"] if r["run_type"] == "iteration"]), 4 * 3)

    def test_that_is_torn_in_its_first_line_is_begun_again(self):
        self.cut_short()
        self.journal.write_bytes(self.journal.read_bytes()[:40])
        self.run_study("--resume")
        self.assertEqual(len([r for r in self.result()["benchmarks"] if r["run_type"] == "iteration"]), 4 * 3)

    def test_has_one_writer(self):
        ran = self.start()
        self.addCleanup(ran.kill)
        self.wait_for(lambda: self.journal.exists() and " warm" in self.journal.read_text(), "it does not begin")
        for options in ([], ["--resume"]):
            refused = self.run_study(*options, code=2)
            self.assert_refused(refused, f"process {ran.pid} writes", "another --out")
            self.assertNotIn("delete", refused.stderr)
        ran.communicate(timeout=PATIENCE)
        self.assertEqual(ran.returncode, 0)
        self.result()

    def test_a_disk_that_is_full_is_said_and_loses_nothing(self):
        """A limit on the size of files simulates a full disk: the same error from the same call."""
        def full(size):
            return {"preexec_fn": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))}
        ran = self.run_study(code=1, **full(5000))
        for word in ("cannot write", "result.json.journal", "the file lacks", "--resume"):
            self.assertIn(word, ran.stderr)
        # If the journal is full the study stops.
        ran = self.run_study("--resume", code=1, **full(self.journal.stat().st_size))
        self.assertIn("cannot write", ran.stderr)
        before = lines_of(self.journal)
        self.assertGreater(len(before), 2)
        # The journal has room, but the result has not.
        size = 24000
        ran = self.run_study("--resume", code=1, **full(size))
        self.assertIn("cannot write", ran.stderr)
        self.assertRegex(ran.stderr, r"result\.json: File too large")
        self.assertLess(self.journal.stat().st_size, size, "this part is about the result")
        self.assertLessEqual(before.items(), lines_of(self.journal).items())
        self.run_study("--resume")
        self.assertEqual(len([r for r in self.result()["benchmarks"] if r["run_type"] == "iteration"]), 4 * 3)
        self.assertEqual(sorted(p.name for p in self.folder.iterdir()), ["own.json", "result.json", "study.json"])

    def test_a_folder_that_takes_no_file_is_refused(self):
        self.out = pathlib.Path("/proc/result.json")
        self.assert_refused(self.run_study(code=2), "/proc/result.json")

    def test_resume_without_a_result_is_refused(self):
        ran = run(FAULTY, "study", self.folder / "study.json", "--resume")
        self.assertEqual(ran.returncode, 2)
        self.assertIn("--out", ran.stderr)


if __name__ == "__main__":
    unittest.main()
