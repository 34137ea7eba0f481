"""`voxspring view` in a real window: pixels, and what a pointer and keys do to the body.

VOXSPRING names the program, FAULTY one with tests/faulty_backends.cpp in it; the current directory is the source tree. Exit code 77: there is no Xvfb or no xdotool, by which a
window is shown and its pointer moved.
"""

import itertools
import os
import pathlib
import re
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
import unittest

import numpy
from folder import InTemporaryFolder, nrrd, run

VOXSPRING = os.environ["VOXSPRING"]
FAULTY = os.environ["FAULTY"]
PATIENCE = 60  # seconds that no operation in here takes, however busy the machine is
SIZE = (1280, 800)
BACKGROUND = (41, 43, 48)
PANEL = 345  # width of the panel on the left in pixels, and a few more
# A box of 12^3 that stands on its lower side; only the hand moves it.
SCENE = {"dataset": {"type": "box", "dims": [12, 12, 12]}, "pinned": {"side": "z-"}, "damping": 0.05,
         "time_step": {"fraction_of_stable": 0.5}}


class Display:
    """A virtual screen."""

    def __init__(self, folder):
        self.folder = folder
        read, write = os.pipe()
        self.server = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", f"{SIZE[0]}x{SIZE[1]}x24",
                                        "-fbdir", str(folder), "-nolisten", "tcp"],
                                       pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as number:
            self.name = ":" + number.readline().strip()
        self.environment = dict(os.environ, DISPLAY=self.name)

    def close(self):
        self.server.terminate()
        self.server.wait(PATIENCE)

    def pointer(self, *words):
        """Runs xdotool with arguments such as "mousemove", 10, 20, "click", 1."""
        subprocess.run(["xdotool", *map(str, words)], env=self.environment, check=True, timeout=PATIENCE)

    def pixels(self):
        """The screen's pixels: rows of red, green and blue."""
        data = pathlib.Path(self.folder, "Xvfb_screen0").read_bytes()
        fields = struct.unpack(">25I", data[:100])
        header, width, height, line, colours = fields[0], fields[4], fields[5], fields[12], fields[19]
        begin = header + 12 * colours
        rows = numpy.frombuffer(data, numpy.uint8, count=line * height, offset=begin).reshape(height, line)
        return rows[:, :4 * width].reshape(height, width, 4)[:, :, 2::-1]


class Window:
    """The program, with its window open."""

    def __init__(self, display, program, *arguments, **environment):
        self.display = display
        self.process = subprocess.Popen([program, "view", *map(str, arguments)], text=True, bufsize=1,
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        env=dict(display.environment, **environment))
        self.said = ""

    def hear(self, pattern, again=None):
        """Waits until the program prints that text, in output that was not searched before. Calls `again` after each 15 seconds
        without output."""
        end = time.monotonic() + PATIENCE
        while not (found := re.search(pattern, self.said)):
            left = max(end - time.monotonic(), 0)
            ready, _, _ = select.select([self.process.stdout], [], [], left if again is None else min(left, 15))
            if not ready and again and time.monotonic() < end:
                again()
                continue
            line = os.read(self.process.stdout.fileno(), 4096).decode() if ready else ""
            if not line:
                raise AssertionError(f"no {pattern!r} in {self.said!r}; {self.close(signal.SIGKILL)}")
            self.said += line
        self.said = self.said[found.end():]
        return found

    def close(self, how=signal.SIGINT):
        """The exit code of the program, and its remaining output."""
        self.process.send_signal(how)
        out, errors = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, self.said + out, errors


def is_body(pixels):
    """The pixels that show neither background nor panel."""
    there = numpy.abs(pixels.astype(int) - BACKGROUND).max(axis=2) > 6
    there[:, :PANEL] = False
    return there


def extent(body):
    """Left, right, top and bottom."""
    rows, columns = numpy.nonzero(body)
    return columns.min(), columns.max(), rows.min(), rows.max()


class View(InTemporaryFolder):
    def setUp(self):
        super().setUp()
        self.scene = self.write("cube.json", SCENE)
        (self.folder / "saves").mkdir()
        self.display = Display(self.folder)
        self.addCleanup(self.display.close)

    def open(self, *arguments, program=VOXSPRING, **environment):
        window = Window(self.display, program, self.scene, "--save", self.folder / "saves" / "saved.npz", *arguments, **environment)
        self.addCleanup(lambda: window.process.poll() is not None or window.close(signal.SIGKILL))
        # A window is black, or white, until its first frame.
        self.wait_until(lambda: not is_body(pixels := self.display.pixels())[0, -1] and is_body(pixels).sum() > 10_000,
                        "a body")
        return window

    def wait_until(self, holds, what):
        end = time.monotonic() + PATIENCE
        while not holds():
            self.assertLess(time.monotonic(), end, f"there is never {what}")
            time.sleep(0.05)

    def middle(self):
        left, right, top, bottom = extent(is_body(self.display.pixels()))
        return (left + right) // 2, (top + bottom) // 2

    def drag(self, begin, end, release=True):
        """Moves from one pixel to another with the left button down, in steps like a hand's."""
        self.display.pointer("mousemove", *begin, "sleep", 0.2, "mousedown", 1, "sleep", 0.2)
        for n in range(1, 11):
            self.display.pointer("mousemove", *(int(a + (b - a) * n / 10) for a, b in zip(begin, end)), "sleep", 0.05)
        if release:
            self.display.pointer("sleep", 0.2, "mouseup", 1)

    def saved(self, window):
        self.display.pointer("key", "w")
        window.hear(r"the state after step \d+ is in .*saved.npz")
        with numpy.load(self.folder / "saves" / "saved.npz") as arrays:
            return {name: arrays[name] for name in arrays.files}

    def assert_closes(self, window):
        code, said, errors = window.close()
        self.assertEqual(code, 130, errors)
        self.assertRegex(said, r"cube.json: \d+ steps on .*, \d+ frames in")

    def test_a_hand_pulls_the_body_of_every_kind_of_backend(self):
        for backend in ("cpu_parallel", "gl_compute_implicit", "gl_fragment_explicit", "vulkan_implicit"):
            with self.subTest(backend):
                window = self.open("--backend", backend)
                before = is_body(self.display.pixels())
                x, y = self.middle()
                self.drag((x, y - 60), (x + 200, y - 160), release=False)
                # The held piece comes out of the body's outline, towards the pointer.
                self.wait_until(lambda: (is_body(self.display.pixels()) & ~before).sum() > 500, "a pulled body")
                pulled = self.saved(window)
                self.assertGreater(numpy.linalg.norm(pulled["displacement"], axis=1).max(), 0.5)
                self.display.pointer("mouseup", 1)
                # Once released it comes back.
                self.wait_until(lambda: (is_body(self.display.pixels()) & ~before).sum() < 100, "a body at rest")
                self.assert_closes(window)

    def test_a_blade_opens_the_body_and_a_needle_closes_it(self):
        window = self.open("--backend", "cpu_parallel")
        left, right, top, bottom = extent(is_body(self.display.pixels()))
        x = (left + right) // 2

        def use(tool, begin, end, says):
            """Draws with a tool. On a machine with other work a key or a stroke may get lost on its way to the window."""
            def stroke():
                self.display.pointer("key", tool)
                self.drag(begin, end)
            stroke()
            return int(window.hear(says, again=stroke)[1])
        cut = use("b", (x, top - 20), (x, (top + bottom) // 2), r"cut (\d+) springs")
        self.assertGreater(cut, 100)
        # After pulling apart, the background shows between the two flaps, where the body was.
        self.display.pointer("key", "g")
        before = is_body(self.display.pixels())
        self.drag((x + 40, top + 30), (x + 240, top - 60), release=False)
        self.wait_until(lambda: (before & ~is_body(self.display.pixels())).sum() > 300, "a gap")
        self.display.pointer("mouseup", 1)
        self.wait_until(lambda: (before & ~is_body(self.display.pixels())).sum() < 100, "a body at rest")
        joined = use("s", (x - 25, top + 30), (x + 25, top + 30), r"joined (\d+) springs")
        self.assertTrue(0 < joined < cut)
        self.assert_closes(window)

    def test_the_mesh_that_came_in_moves_with_the_body(self):
        # A cube with a needle that is too thin for a voxel: the voxels' surface has no needle.
        corners, faces = [], []
        for low, high in (((0, 0, 0), (6, 6, 6)), ((2.8, 2.8, 5.9), (3.2, 3.2, 14))):
            first = len(corners) + 1
            corners += [[side[axis] for axis, side in enumerate(sides)] for sides in itertools.product((low, high), repeat=3)]
            faces += [[first + n for n in face] for face in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4),
                                                             (1, 5, 7, 3))]
        self.write("cube.obj", "".join(f"v {x} {y} {z}\n" for x, y, z in corners) +
                   "".join(f"f {' '.join(map(str, face))}\n" for face in faces))
        self.write("cube.json", SCENE | {"dataset": {"type": "mesh", "file": "cube.obj", "pitch": 1}})
        window = self.open("--backend", "cpu_parallel")
        body = is_body(self.display.pixels())
        left, right, top, bottom = extent(body)
        self.assertLess(body.sum() / ((right - left) * (bottom - top)), 0.55, "the cube without its needle")
        y, x = numpy.median(numpy.nonzero(body), axis=1).astype(int)  # on the cube
        self.drag((x, y), (x + 150, y), release=False)
        self.wait_until(lambda: (is_body(self.display.pixels()) & ~body).sum() > 500, "a pulled body")
        self.assert_closes(window)

    def test_keys_pause_step_and_reset(self):
        window = self.open("--backend", "cpu_parallel", "--steps", "1")
        self.display.pointer("key", "space")
        # The key is handled in order, after the action in progress.
        steps = [int(self.saved(window)["step"])]
        steps.append(int(self.saved(window)["step"]))
        self.display.pointer("key", "n", "sleep", 0.3)
        steps.append(int(self.saved(window)["step"]))
        self.assertEqual(steps[1:], [steps[0], steps[0] + 1])
        self.display.pointer("key", "r", "sleep", 0.3)
        window.hear("reset")
        self.assertEqual(int(self.saved(window)["step"]), 0)
        self.assert_closes(window)

    def test_escape_and_q_close_the_window(self):
        for key in ("Escape", "q"):
            with self.subTest(key):
                window = self.open("--backend", "cpu_parallel")
                self.display.pointer("key", key)
                out, errors = window.process.communicate(timeout=PATIENCE)
                self.assertEqual(window.process.returncode, 0, errors)
                self.assertRegex(out, r"cube.json: \d+ steps on .*, \d+ frames in")

    def test_a_state_that_cannot_be_written_leaves_the_window(self):
        window = self.open("--backend", "cpu_parallel", "--steps", "1")
        # Root can write into a read-only folder, but no user can write into a deleted one.
        os.rename(self.folder / "saves", self.folder / "elsewhere")
        self.display.pointer("key", "w")
        window.hear(r"step \d+: the state is not saved: .*saved.npz")
        os.rename(self.folder / "elsewhere", self.folder / "saves")
        self.saved(window)
        self.assert_closes(window)

    def test_a_picture_that_takes_long_leaves_time_for_steps(self):
        window = self.open("--backend", "cpu_parallel", "--seconds", "8")
        out, errors = window.process.communicate(timeout=PATIENCE)
        steps, frames = map(int, re.search(r"(\d+) steps on .*, (\d+) frames in", out).groups())
        # A step of 12^3 takes some 0.1 ms on two cores, a frame 16 at least.
        self.assertGreater(steps, 10 * frames, errors)

    def test_another_backend_goes_on(self):
        window = self.open("--backend", "cpu_parallel")
        self.choose_backend(0)
        label = window.hear(r"step (\d+): (\S+) goes on")
        self.assertGreater(int(label[1]), 0)
        self.assertFalse(label[2].startswith("cpu_parallel"))
        self.assertGreaterEqual(int(self.saved(window)["step"]), int(label[1]))
        self.assert_closes(window)

    def choose_backend(self, line):
        """Opens the list of backends and selects one by its line, from 0."""
        self.display.pointer("mousemove", 90, 45, "sleep", 0.3, "click", 1, "sleep", 0.5, "mousemove", 90, 66 + 17 * line,
                             "sleep", 0.3, "click", 1)

    def test_a_device_that_fails_leaves_the_window_and_a_state(self):
        window = self.open("--backend", "wears_out", "--steps", "1", program=FAULTY)
        window.hear("failed: the card fell off the bus. Choose another backend to go on from the state after step ")
        kept = int(self.saved(window)["step"])
        self.assertLessEqual(kept, 100)
        self.choose_backend(0)
        self.assertEqual(int(window.hear(r"step (\d+): cpu_explicit/\S+ goes on")[1]), kept)
        self.wait_until(lambda: int(self.saved(window)["step"]) > kept, "another step")
        self.assert_closes(window)

    def test_colours_are_those_of_the_body_though_an_island_falls(self):
        active = numpy.zeros((9, 9, 12), numpy.uint8)
        active[:, :, :9] = 1
        active[4, 4, 11] = 1
        self.write("island.nrrd", nrrd("12 9 9", active.tobytes()))
        self.write("cube.json", SCENE | {"dataset": {"type": "volume", "file": "island.nrrd"}, "gravity": [1e-3, 0, 0]})
        window = self.open("--backend", "cpu_parallel", "--steps", "20")

        def is_yellow():
            red, green, blue = (self.display.pixels()[:, PANEL:, c].astype(int) for c in range(3))
            return (numpy.minimum(red, green) > 150) & (blue < 110)

        # Yellow is the largest displacement. That of the island soon is many times that of the body, which would turn violet.
        while int(self.saved(window)["step"]) < 2000:
            time.sleep(0.2)
        time.sleep(1)
        self.assertGreater(is_yellow().sum(), 200)
        self.assert_closes(window)

    def test_without_a_display_it_says_what_to_do(self):
        nowhere = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        ran = run(VOXSPRING, "view", self.scene, env=nowhere)
        self.assertEqual(ran.returncode, 1)
        self.assertIn("no window", ran.stderr)
        self.assertIn("voxspring run", ran.stderr)
        self.assertIn("--frames", ran.stderr)
        volume = self.write("two labels.nrrd", nrrd("4 4 4", [1, 2] * 32))
        ran = run(VOXSPRING, "view", volume, "--labels", 2, env=nowhere)
        self.assertIn(f"voxspring run '{volume}' --labels 2 --backend auto --frames frames ", ran.stderr)

    def test_bad_input_is_refused_before_a_window_opens(self):
        for arguments, words in ((["nowhere.json"], "nowhere.json"), ([self.scene, "--backend", "cuda_nothing"], "cuda_nothing"),
                                 ([self.scene, "--save", "state.vtu"], ".npz"), ([self.scene, "--size", "3x4"], "3x4")):
            ran = run(VOXSPRING, "view", *arguments, env=self.display.environment)
            self.assertEqual(ran.returncode, 2, ran.stderr)
            self.assertIn(words, ran.stderr)


if __name__ == "__main__":
    missing = [tool for tool in ("Xvfb", "xdotool") if shutil.which(tool) is None]
    if missing:
        print("skipped: there is no " + " and no ".join(missing))
        sys.exit(77)
    unittest.main(verbosity=2)
