"""Ctrl-C in `voxspring run`, and going on from what it left.

VOXSPRING names the executable; the current directory is the source tree.
"""

import array
import csv
import os
import re
import signal
import subprocess
import time
import unittest
import zipfile

from program import VOXSPRING, InTemporaryFolder, succeeds, voxspring
from terminal import on_terminal

# The program's step batches take a fifth of a second, and then a small state is written, on a machine that also does other work.
SOON_SECONDS = 20


def array_bytes(path, name):
    with zipfile.ZipFile(path) as arrays:
        data = arrays.read(f"{name}.npy")
    return data[10 + int.from_bytes(data[8:10], "little"):]


def state_of(path):
    return {name: array_bytes(path, name) for name in ("step", "displacement", "increment", "springs", "position")}


class Interrupted(InTemporaryFolder):
    def interrupt(self, *arguments, after="step", sent=signal.SIGINT):
        """Ends a program once it has printed what `after` matches; returns its exit code, its output, and how long it took to end."""
        environment = os.environ | {"VOXSPRING_PROGRESS_SECONDS": "0.05"}
        program = subprocess.Popen([VOXSPRING, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=environment)
        self.addCleanup(program.kill)
        for line in program.stderr:
            if re.search(after, line):
                break
        begin = time.monotonic()
        program.send_signal(sent)
        out, errors = program.communicate(timeout=300)
        return program.returncode, out, errors, time.monotonic() - begin

    def test_leaves_the_state_and_goes_on_from_it(self):
        out, whole, resumed = (self.folder / f"{name}.npz" for name in ("my state", "whole", "resumed"))
        table = self.folder / "state.csv"
        for sent in (signal.SIGINT, signal.SIGTERM):
            code, said, errors, seconds = self.interrupt("run", "box@12", "--backend", "cpu_reference", "--steps", 10**9,
                                                         "--out", out, "--out", table, sent=sent)
            self.assertEqual(code, 130, errors)
            self.assertLess(seconds, SOON_SECONDS)
            self.assertIn("stopping after the work in progress", errors)
            reached = int(re.search(rf"^box@12: interrupted after step (\d+) of {10**9}; its state is in {out}, {table}$",
                                    said, re.MULTILINE)[1])
            self.assertIn(f"--resume '{out}' goes on", said)
            self.assertEqual({path.name for path in self.folder.iterdir()}, {"my state.npz", "state.csv"})
        steps = reached + 30
        for arguments in (["--out", whole], ["--out", resumed, "--resume", out]):
            ran = succeeds("run", "box@12", "--backend", "cpu_reference", "--steps", steps, *arguments)
        self.assertIn(f"box@12: 30 steps, {reached + 1} to {steps}, of 1728 particles", ran.stdout)
        self.assertEqual(state_of(resumed), state_of(whole))

    def test_without_a_file_says_so(self):
        code, said, _, _ = self.interrupt("run", "box@12", "--backend", "cpu_reference", "--steps", 10**9)
        self.assertEqual(code, 130)
        self.assertRegex(said, r"^box@12: interrupted after step \d+ of 1000000000; without --out nothing is written\n$")

    def test_a_series_ends_where_it_was_interrupted(self):
        frames = self.folder / "frames"
        code, said, errors, _ = self.interrupt("run", "box@6", "--backend", "cpu_reference", "--steps", 10**8, "--frames", frames,
                                               "--every", 5 * 10**7, "--size", "64x64", after="first pass, to find one colour scale")
        self.assertEqual(code, 130, errors)
        if "nothing is written" not in said:  # stopped before its first step
            reached = int(re.search(r"interrupted after step (\d+) of", said)[1])
            self.assertEqual([path.name for path in frames.iterdir()], [f"frame_{reached:09}.png"])

    def test_a_first_pass_leaves_the_forces_on_the_tool(self):
        self.write("hand.csv", "time,x,y,z\n0,0,0,0\n2,0.1,0,0\n")
        scene = self.write("held.json", {"dataset": {"type": "box", "dims": [6, 6, 6]}, "pinned": {"side": "z-"}, "damping": 0.01,
                                         "tool": {"side": "z+", "stiffness": 0.1, "motion": "hand.csv"}})
        forces = self.folder / "forces.csv"
        code, said, errors, _ = self.interrupt("run", scene, "--backend", "cpu_reference", "--steps", 10**8, "--frames",
                                               self.folder / "frames", "--every", 10, "--size", "64x64", "--tool-force", forces,
                                               after=r"first pass, .*: step \d{3,} of")
        self.assertEqual(code, 130, errors)
        reached = int(re.search(r"interrupted after step (\d+) of", said)[1])
        steps = [int(line.split(",")[0]) for line in forces.read_text().splitlines()[1:]]
        self.assertEqual(steps, sorted({*range(10, reached, 10), reached}))

    def test_a_second_one_while_a_file_is_written_leaves_no_temporary_file(self):
        out = self.folder / "state.npz"
        out.write_text("old")
        program = subprocess.Popen([VOXSPRING, "run", "box@60", "--backend", "cpu_parallel", "--steps", str(10**9), "--out", out],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   env=os.environ | {"VOXSPRING_PROGRESS_SECONDS": "0.05"})
        for line in program.stderr:
            if "step" in line:
                break
        program.send_signal(signal.SIGINT)
        while len(os.listdir(self.folder)) == 1 and program.poll() is None:
            time.sleep(0.001)
        program.send_signal(signal.SIGTERM)
        program.communicate(timeout=300)
        self.assertEqual(program.returncode, 130)
        self.assertEqual(os.listdir(self.folder), ["state.npz"])
        self.assertEqual(out.read_text(), "old")

    def test_a_terminal_has_one_line_that_goes_again(self):
        code, _, shown = on_terminal([VOXSPRING, "run", "box@12", "--backend", "cpu_reference", "--steps", 10**9], 200,
                                     when=b" left", then=lambda program: program.send_signal(signal.SIGINT))
        self.assertEqual(code, 130)
        self.assertRegex(shown, rb"\r\x1b\[Kbox@12 on cpu_reference/\S+: step \d+ of 1000000000, \d+ s, \S+ \S+( \S+ \S+)? left")
        self.assertTrue(shown.endswith(b"\r\x1b[K"), shown)

    def test_a_terminal_is_not_given_half_a_character(self):
        scene = self.write("ü" * 60 + ".json", {"dataset": {"type": "box", "dims": [12, 12, 12]}})
        code, _, shown = on_terminal([VOXSPRING, "run", scene, "--backend", "cpu_reference", "--steps", 10**9], 80,
                                     when="üü".encode(), then=lambda program: program.send_signal(signal.SIGINT))
        self.assertEqual(code, 130)
        self.assertIn("\r\x1b[K" + ("ü" * 60 + ".json on cpu_reference")[:79] + "\r", shown.decode())

    def test_advise_says_what_it_has_so_far(self):
        arguments = ("advise", "heart", "--error", "1e-3", "--backend", "cpu_reference")
        code, said, errors, seconds = self.interrupt(*arguments, after=r"\[1/1\]")
        self.assertEqual((code, said), (130, "heart: interrupted before anything was measured\n"), errors)
        self.assertLess(seconds, SOON_SECONDS)
        # At this point some of the runs have been timed, and others have not.
        code, said, errors, seconds = self.interrupt("advise", "box@8", "--error", "1", "--backend", "cpu_parallel",
                                                     after=r" ([2-9]|[1-4]\d)/60, ")
        self.assertEqual(code, 130, errors)
        self.assertRegex(said, r"^box@8: interrupted; the advice follows from \d+ runs\nbox@8: an error of 1 is reached soonest by\n")
        self.assertIn("\n  voxspring run box@8 --backend cpu_parallel:", said)
        self.assertLess(seconds, SOON_SECONDS)

    def test_advise_on_the_continuum_says_that_it_was_interrupted(self):
        code, said, errors, _ = self.interrupt("advise", "cantilever", "--continuum", "--error", "0.1", "--backend", "cpu_explicit",
                                               after=" across")
        self.assertEqual(code, 130, errors)
        self.assertRegex(said, r"^cantilever: interrupted( before anything was measured\n$|; the advice follows from what was measured\ncan)")


class Resume(InTemporaryFolder):
    def run_in_two(self, scene, backend, steps, first, name="body"):
        whole, half, resumed = (self.folder / f"{name}_{part}.npz" for part in ("whole", "half", "resumed"))
        for count, arguments in ((steps, ["--out", whole]), (first, ["--out", half]),
                                 (steps, ["--out", resumed, "--resume", half])):
            ran = succeeds("run", scene, "--backend", backend, "--steps", count, *arguments)
        self.said = ran.stdout
        return state_of(whole), state_of(resumed)

    # Formulations with no more digits than the file, which holds displacement and increment in float64.
    KEEPS_ITS_BITS = [("increment", "float32"), ("increment", "float64"), ("displacement", "float32"), ("position", "float32"),
                      ("paper", "float32")]
    FORMULATIONS = ("increment", "displacement", "position", "paper", "compensated")

    def test_ends_at_the_bits_of_an_uninterrupted_run_or_says_that_it_does_not(self):
        cpu = [(f"cpu_parallel:precision={precision},formulation={formulation}", (formulation, precision))
               for precision in ("float32", "float64") for formulation in self.FORMULATIONS]
        cpu += [(f"cpu_reference:formulation={formulation}", (formulation, "float64")) for formulation in self.FORMULATIONS]
        for backend, which in [*cpu, ("gl_compute_implicit", ("increment", "float32"))]:
            # After step 150 position loses bits, after step 17 compensated.
            for first in (17, 150):
                whole, resumed = self.run_in_two("heart@15x13x12", backend, 400, first)
                says = "has more digits than the file" in self.said
                self.assertEqual(says, which not in self.KEEPS_ITS_BITS, backend)
                if not says:
                    self.assertEqual(resumed, whole, backend)
                    continue
                for name in ("displacement", "increment"):
                    pairs = zip(*(array.array("d", state[name]) for state in (whole, resumed)))
                    largest = max(map(abs, array.array("d", whole[name])))
                    # One float64 rounding of a position of up to 15, carried on by later steps.
                    self.assertLess(max(abs(a - b) for a, b in pairs), 1e-11 * largest, backend)

    def test_edits_before_the_step_are_applied(self):
        # Cuts after steps 50 and 250, a suture after step 150.
        for first in (40, 50, 51, 160):
            whole, resumed = self.run_in_two("scalpel_10", "cpu_parallel:formulation=increment", 170, first)
            self.assertEqual(resumed, whole, first)

    def scene(self, name, **keys):
        """A box of 5^3 particles on its base, and the path of its file."""
        return self.write(f"{name}.json", {"dataset": {"type": "box", "dims": [5, 5, 5]}, "spring_groups": ["face", "edge"],
                                           "damping": 0.01, "pinned": {"side": "z-", "slices": 1},
                                           "gravity": [0, 0.001, -0.002], "time_step": 0.2} | keys)

    CUT = {"step": 5, "cut": {"plane": {"point": [2.5, 0, 0], "normal": [1, 0, 0]}}}
    SUTURE = {"step": 8, "suture": {"pairs": [[[1, 2, 2], [3, 2, 2]], [[0, 0, 4], [4, 4, 4]]], "stiffness": 0.3}}

    def test_goes_on_with_the_springs_of_the_file(self):
        # The resumed scene has none of the edits, or later ones, as if a hand had made them.
        later = {"step": 30, "cut": {"plane": {"point": [0, 0, 2.5], "normal": [0, 0, 1]}}}
        edited, plain = self.scene("edited", edits=[self.CUT, self.SUTURE]), self.scene("plain")
        both = self.scene("both", edits=[self.CUT, self.SUTURE, later])
        only_later = self.scene("only_later", edits=[later])
        half, whole, resumed = (self.folder / f"{name}.npz" for name in ("half", "whole", "resumed"))
        backend = ("--backend", "cpu_reference")
        self.assertEqual(voxspring("run", edited, *backend, "--steps", 20, "--out", half).returncode, 0)
        for first, then in ((edited, plain), (both, only_later)):
            ran = succeeds("run", first, *backend, "--steps", 50, "--out", whole)
            ran = succeeds("run", then, *backend, "--steps", 50, "--out", resumed, "--resume", half)
            self.assertEqual(state_of(resumed), state_of(whole), then.name)
            self.assertRegex(ran.stdout, rf"half.npz: \d+ springs are not as in scene {then.name} after step 20; the run uses")
        # 25 pairs of particles on either side, their edges along and across y and z; and two sutures.
        self.assertIn(f"half.npz: {25 + 4 * 20 + 2} springs are not as in scene", ran.stdout)
        ran = succeeds("run", edited, *backend, "--steps", 50, "--resume", half)
        self.assertNotIn("springs", ran.stdout)

    def test_says_what_of_the_file_the_scene_has_otherwise(self):
        half = self.folder / "half.npz"
        run = ("--backend", "cpu_reference")
        self.assertEqual(voxspring("run", self.scene("one"), *run, "--steps", 20, "--out", half).returncode, 0)
        other = self.scene("other", stiffness={"face": 1, "edge": 3})
        edges = 3 * 2 * 4 * 4 * 5
        self.assert_refused(voxspring("run", other, *run, "--steps", 30, "--resume", half), "half.npz: springs",
                            f"{edges} of {edges + 3 * 4 * 5 * 5}", "stiffness", "other.json")
        loose = self.scene("loose", pinned={"side": "z+", "slices": 1}, mass=2)
        ran = succeeds("run", loose, *run, "--steps", 30, "--resume", half)
        self.assertIn("half.npz: 125 particles have a different mass in the file, and 50 differ in whether they are pinned; the run "
                      "uses the masses and pins of the scene loose", ran.stdout)

    def test_a_series_keeps_the_files_that_it_lists(self):
        run = ("run", "box@4", "--backend", "cpu_reference", "--every", 10)
        body = ("--out", self.folder / "body.vtu")
        # The first run goes beyond the step at which the second begins.
        succeeds(*run, "--steps", 40, *body, "--out", self.folder / "state.npz")
        succeeds(*run, "--steps", 55, *body, "--resume", self.folder / "state_000020.npz")
        listed = re.findall(r'file="body_(\d+)\.vtu"', (self.folder / "body.pvd").read_text())
        self.assertEqual([int(step) for step in listed], [10, 20, 30, 40, 50, 55])

    def test_a_body_that_was_pulled_far_does_not_count_as_diverged(self):
        half = self.folder / "half.npz"
        run = ("--backend", "cpu_reference")
        pulled = self.scene("pulled", initial={"displacement": {"random": 20, "seed": 1}})
        self.assertEqual(voxspring("run", pulled, *run, "--steps", 1, "--out", half).returncode, 0)
        succeeds("run", self.scene("left"), *run, "--steps", 100, "--resume", half)

    def test_writes_the_force_on_the_tool(self):
        (self.folder / "hand.csv").write_text("time,x,y,z\n0,0,0,0\n2,0.5,0,0.1\n8,-0.2,0.3,0\n")
        scene = self.scene("held", tool={"side": "z+", "slices": 1, "stiffness": 0.3, "motion": "hand.csv", "every": 4})
        run = ("run", scene, "--backend", "cpu_reference", "--steps", 42)
        force = self.folder / "force.csv"

        def lines():
            with open(force, newline="") as file:
                return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        self.assertEqual(voxspring(*run, "--out", self.folder / "body.npz", "--every", 1).returncode, 0)
        succeeds(*run, "--tool-force", force)
        each_move = lines()
        self.assertEqual([line["step"] for line in each_move], [*range(4, 42, 4), 42])
        motion = [(0, (0, 0, 0)), (2, (0.5, 0, 0.1)), (8, (-0.2, 0.3, 0))]
        for line in each_move:
            self.assertAlmostEqual(line["time"], 0.2 * line["step"], delta=1e-12)
            # In the last step the tool is where it moved at the latest multiple of four steps.
            when = int(line["step"] - 1) // 4 * 4 * 0.2
            (begin, a), (end, b) = motion[:2] if when < 2 else motion[1:]
            at = [p + (q - p) * min((when - begin) / (end - begin), 1) for p, q in zip(a, b)]
            before = array.array("d", array_bytes(self.folder / f"body_{int(line['step']) - 1:06}.npz", "displacement"))
            held = range(100, 125)  # the uppermost slice
            for axis, name in enumerate("xyz"):
                self.assertAlmostEqual(line[name], at[axis], delta=1e-12)
                pulled = sum(0.3 * (at[axis] - before[3 * i + axis]) for i in held)
                self.assertAlmostEqual(line[f"force_{name}"], -pulled, delta=1e-11)
        self.assertGreater(max(abs(line["force_x"]) for line in each_move), 0.1)
        # --every sets the steps at which a force is written. A resumed run writes only its own steps.
        self.assertEqual(voxspring(*run, "--tool-force", force, "--every", 10).returncode, 0)
        self.assertEqual([line["step"] for line in lines()], [10, 20, 30, 40, 42])
        self.assertEqual(voxspring(*run, "--tool-force", force, "--resume", self.folder / "body_000022.npz").returncode, 0)
        self.assertEqual(lines(), [line for line in each_move if line["step"] > 22])
        force.unlink()
        self.assert_refused(voxspring("run", "box@4", "--backend", "cpu_reference", "--tool-force", force), "--tool-force", "tool",
                            "box@4")
        self.assert_refused(voxspring(*run, "--tool-force", self.folder / "force.txt"), "--tool-force", ".csv")
        self.assert_refused(voxspring(*run, "--tool-force", force, "--out", f"{self.folder}/./force.csv"), "--tool-force", "--out")
        self.assertFalse(force.exists())
        force.touch()
        link = self.folder / "link.csv"
        link.symlink_to(force)
        self.assert_refused(voxspring(*run, "--tool-force", force, "--out", link), "--tool-force", "--out")
        circle = self.folder / "circle.csv"
        circle.symlink_to(circle)
        for table, out in ((circle, link), (link, circle)):
            self.assert_refused(voxspring(*run, "--tool-force", table, "--out", out), "circle.csv", "links")

    def test_refuses_what_is_no_state_of_the_scene(self):
        state = self.folder / "state.npz"
        run = ("run", "box@4", "--backend", "cpu_reference")
        self.assertEqual(voxspring(*run, "--steps", 10, "--out", state).returncode, 0)
        for steps in (10, 3):
            self.assert_refused(voxspring(*run, "--steps", steps, "--resume", state), "--steps", "more than the 10", "state.npz")
        self.assert_refused(voxspring("run", "box@5", "--backend", "cpu_reference", "--resume", state), "state.npz", "dims", "box@5")
        slow = self.write("slow.json", {"dataset": {"type": "box", "dims": [4, 4, 4]}, "time_step": 0.01})
        self.assert_refused(voxspring("run", slow, "--backend", "cpu_reference", "--resume", state), "state.npz", "time_step",
                            "0.01")
        self.assert_refused(voxspring(*run, "--resume", self.folder / "none.npz"), "none.npz")
        os.mkfifo(self.folder / "pipe.npz")
        self.assert_refused(voxspring(*run, "--resume", self.folder / "pipe.npz"), "pipe.npz", "a pipe", "voxspring run --out")
        self.assert_refused(voxspring(*run, "--resume", self.write("text.npz", "no zip")), "text.npz", "voxspring run --out")
        whole = state.read_bytes()
        place = whole.index(b"increment.npy") + 200
        for name, damaged in (("cut", whole[:len(whole) // 2]), ("changed", whole[:place] + b"\x55" + whole[place + 1:])):
            self.assert_refused(voxspring(*run, "--resume", self.write(f"{name}.npz", damaged)), f"{name}.npz")
        # Without an array, with numbers that are not finite, and with springs that the scene does not have.
        infinite = b"\x00\x00\x00\x00\x00\x00\xf0\x7f"
        for name, array_name, change, said in (
                ("lacking", "increment", None, "increment is missing"), ("infinite", "increment", infinite, "increment"),
                ("old", "lattice_springs", None, "lattice_springs is missing"), ("more", "lattice_springs", infinite, "lattice_springs"),
                ("long", "rest_length", infinite, "springs: 1 of "), ("short", "stiffness", b"", "stiffness: its data"),
                ("alien", "springs", b"\x00\x00\x00\x00\xff\xff\xff\xff", "springs: 1 of ")):
            path = self.folder / f"{name}.npz"
            with zipfile.ZipFile(state) as old, zipfile.ZipFile(path, "w") as new:
                for item in old.namelist():
                    data = old.read(item)
                    if item == f"{array_name}.npy":
                        if change is None:
                            continue
                        data = data[:-8] + change
                    new.writestr(item, data)
            self.assert_refused(voxspring(*run, "--resume", path), f"{name}.npz", said)

    def test_numpy_can_pack_it_anew(self):
        state, packed = self.folder / "state.npz", self.folder / "packed.npz"
        run = ("run", "box@4", "--backend", "cpu_reference")
        self.assertEqual(voxspring(*run, "--steps", 10, "--out", state).returncode, 0)
        with zipfile.ZipFile(state) as old, zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as new:
            for item in old.namelist():
                new.writestr(item, old.read(item))
        self.assertEqual(voxspring(*run, "--steps", 20, "--resume", packed).returncode, 0)


if __name__ == "__main__":
    unittest.main()
