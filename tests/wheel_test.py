"""The wheel of `pip wheel .`, as its user meets it: in an empty virtual environment, with nothing on the PATH.

Usage: wheel_test.py WHEEL [TEST...]

Makes the environment with the interpreter that runs this, installs the wheel with the packages of python/requirements.txt that a user
needs, and runs the tests there.
"""

import gzip
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
import types
import unittest
from unittest import mock

ROOT = pathlib.Path(__file__).resolve().parent.parent
NEEDED = ("numpy", "pandas", "python-dateutil", "tzdata")

if "VOXSPRING_WHEEL" not in os.environ:
    wheel = pathlib.Path(sys.argv[1]).resolve()
    pinned = [line for line in (ROOT / "python/requirements.txt").read_text().splitlines() if line.split("==")[0] in NEEDED]
    with tempfile.TemporaryDirectory() as made:
        subprocess.run([sys.executable, "-m", "venv", made], check=True)
        subprocess.run([f"{made}/bin/pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", str(wheel), *pinned],
                       check=True)
        os.makedirs(f"{made}/nothing")
        inside = {"PATH": f"{made}/nothing", "HOME": made, "VOXSPRING_WHEEL": str(wheel), "VOXSPRING_CACHE": f"{made}/cache"}
        sys.exit(subprocess.run([f"{made}/bin/python", "-W", "error", __file__, *sys.argv[2:]], cwd=made, env=inside,
                                check=False).returncode)

import numpy  # noqa: E402

import voxspring  # noqa: E402
from voxspring import peers  # noqa: E402

TINY = numpy.ones((3, 3, 3), numpy.uint8)


def beam(**settings):
    """A beam that is held at one end and bends under its weight."""
    labels = numpy.ones((9, 4, 4), numpy.uint8)
    held = numpy.zeros(labels.shape, bool)
    held[0] = True
    return voxspring.Body(labels, **{"pinned": held, "gravity": (0, 0, -1e-3), "damping": 1e-3, "name": "beam", **settings})


def springs_kernel(body, keep=None):
    """step(x, v, n) by a list of springs, or by those that `keep` keeps."""
    keep = numpy.ones(len(body.springs), bool) if keep is None else keep
    (i, j), k, rest = body.springs[keep].T, body.stiffness[keep, None], body.rest_length[keep, None]
    free, mass = ~body.pinned[:, None], body.mass[:, None]

    def step(x, v, n):
        for _ in range(n):
            d = x[i] - x[j]
            length = numpy.sqrt((d * d).sum(axis=1, keepdims=True))
            f = (k * (rest - length) / length * d).astype(x.dtype)
            force = body.load.astype(x.dtype)
            numpy.add.at(force, i, f)
            numpy.subtract.at(force, j, f)
            v[:] = free * ((1 - body.damping) * v + body.time_step * (force / mass + body.gravity))
            x += (body.time_step * v).astype(x.dtype)

    return step


def lost_diagonal(body):
    """The springs without those along one diagonal of the twelve."""
    i, j = body.springs.T
    return ~(body.voxel[j] - body.voxel[i] == [0, 1, 1]).all(axis=1)


class Bodies(unittest.TestCase):
    def test_a_body_is_what_its_labels_say(self):
        labels = numpy.zeros((4, 3, 2), int)
        labels[1:3, 1, :] = 1
        labels[2, 1, 1] = 2
        body = voxspring.Body(labels, spacing=(1, 2, 3), mass=(1, 5), stiffness=(1, 3), springs=["face"])
        self.assertEqual(len(body), 4)
        self.assertEqual(body.voxel.tolist(), [[1, 1, 0], [2, 1, 0], [1, 1, 1], [2, 1, 1]])
        numpy.testing.assert_array_equal(numpy.diff(body.rest_position[:2], axis=0), [[1, 0, 0]])
        self.assertEqual(body.mass.tolist(), [1, 1, 1, 5])
        self.assertEqual(body.springs.tolist(), [[0, 1], [0, 2], [1, 3], [2, 3]])
        self.assertEqual(body.rest_length.tolist(), [1, 3, 3, 1])
        self.assertEqual(body.stiffness.tolist(), [1, 1, 1.5, 1.5])
        for (i, j), k in zip(body.springs, body.stiffness):
            (column,) = numpy.flatnonzero(body.neighbours[i] == j)
            self.assertEqual(body.neighbour_stiffness[i, column], k)
            numpy.testing.assert_array_equal(body.voxel[j] - body.voxel[i], body.directions[column])

    def test_a_wrong_value_is_named(self):
        for settings, expected in (({"labels": numpy.zeros((2, 2, 2), int)}, "labels.*at least one active voxel"),
                                   ({"labels": numpy.ones((2, 2))}, "labels.*2 axes.*three axes"),
                                   ({"labels": numpy.full((2, 2, 2), 300)}, "labels.*300.*255"),
                                   ({"labels": numpy.ones((2, 2, 2))}, "labels.*float64"),
                                   ({"springs": ["corners"]}, 'springs.*corners.*"corner"'),
                                   ({"stiffness": (1, 2)}, "stiffness.*2 numbers.*face, edge and corner"),
                                   ({"pinned": numpy.zeros((1, 1, 1), bool)}, "pinned.*shape of labels"),
                                   ({"pinned": numpy.zeros((4, 4), bool)}, r"pinned.*\(4, 4\).*shape of labels"),
                                   ({"load": numpy.zeros((5, 3))}, "load.*5 rows.*27 particles"),
                                   ({"load": numpy.zeros(27)}, r"load.*\(27,\).*three numbers per particle"),
                                   ({"mass": "heavy"}, "mass: heavy.*a number"), ({"spacing": -1.0}, "spacing is not positive"),
                                   ({"damping": 3.0}, "damping is not in")):
            with self.assertRaisesRegex(voxspring.BadInput, expected) as refused:
                voxspring.Body(**{"labels": TINY, **settings})
            self.assertIsInstance(refused.exception, ValueError)
            self.assertNotIn("\n", str(refused.exception))

    def test_scenes_are_those_of_the_program(self):
        self.assertEqual(voxspring.scene("box@4").dims, [4, 4, 4])
        with self.assertRaisesRegex(voxspring.BadInput, "no_such_scene"):
            voxspring.scene("no_such_scene")


class Simulations(unittest.TestCase):
    def test_steps_agree_with_a_kernel_of_numpy(self):
        body = beam()
        x, v = body.start, body.start_velocity
        springs_kernel(body)(x, v, 100)
        simulation = voxspring.Simulation(body, "cpu_reference")
        simulation.step(60)
        simulation.step(40)
        self.assertEqual(simulation.steps, 100)
        self.assertGreater(numpy.abs(simulation.displacement).max(), 0.01)
        numpy.testing.assert_allclose(simulation.position, x, rtol=0, atol=1e-12)
        numpy.testing.assert_allclose(simulation.velocity, v, rtol=0, atol=1e-12)

    def test_a_long_call_gives_the_bits_of_short_ones(self):
        body = voxspring.scene("box@16")  # a call of 2000 steps is divided
        whole, parts = voxspring.Simulation(body, "cpu_parallel"), voxspring.Simulation(body, "cpu_parallel")
        whole.step(2000)
        for _ in range(20):
            parts.step(100)
        numpy.testing.assert_array_equal(whole.displacement, parts.displacement)

    def test_holds_cuts_and_sews(self):
        simulation = voxspring.Simulation(beam(gravity=(0, 0, 0)), "cpu_parallel")
        far = simulation.position[-1]
        with self.assertRaisesRegex(voxspring.Refused, "a stiffness above 0"):
            simulation.take_hold(far, 0.5, -1.0)
        simulation.take_hold(far, 0.5, 1.0)
        with self.assertRaisesRegex(voxspring.BadInput, "three finite numbers"):
            simulation.drag((0, 0, numpy.nan))
        simulation.drag((0, 0, 0.5))
        simulation.step(200)
        self.assertGreater(simulation.displacement[-1, 2], 0.1)
        self.assertNotEqual(simulation.force[2], 0)
        simulation.let_go()
        simulation.reset()
        x = (far[0] + simulation.position[0, 0]) / 2 + 0.25
        cut = simulation.cut([(x, -9, -9), (x, -9, 9), (x, 9, -9), (x, 9, 9)])
        self.assertGreater(cut, 16)
        sewn = simulation.suture((x - 1, 1, 1), (x + 1, 1, 1), 1.2)
        self.assertTrue(0 < sewn < cut)
        with self.assertRaisesRegex(voxspring.Refused, "which needs neighbour lists"):
            simulation.suture((0, 0, 0), far, 0.1)

    def test_a_state_that_is_not_finite_is_not_saved(self):
        simulation = voxspring.Simulation(beam(time_step=10 * beam().time_step), "cpu_reference")
        simulation.step(2000)
        with self.assertRaisesRegex(voxspring.Refused, "no longer finite"):
            simulation.save("diverged.npz")
        self.assertFalse(pathlib.Path("diverged.npz").exists())

    def test_what_is_missing_is_said(self):
        with self.assertRaisesRegex(voxspring.BadInput, "cuda_nothing"):
            voxspring.Simulation(beam(), "cuda_nothing")
        with self.assertRaisesRegex(voxspring.Unavailable, "cpu_parallel.*displacement"):
            _ = voxspring.Simulation(beam(), "cpu_parallel").displacement_on_card
        self.assertTrue(issubclass(voxspring.Unavailable, RuntimeError))
        if not os.path.exists("/dev/nvidiactl"):
            with self.assertRaisesRegex(voxspring.Unavailable, "NVIDIA driver|CUDA"):
                voxspring.Simulation(beam(), "cuda_implicit_cached")

    def test_an_array_on_a_card_answers_as_dlpack_asks(self):
        # PyTorch, CuPy and JAX ask with a version and a stream. The protocol touches no card.
        array = voxspring.CardArray(self, address=4096, count=7, device=1)
        self.assertEqual(array.__dlpack_device__(), (2, 1))
        for options, name in (({}, '"dltensor"'), ({"stream": None}, '"dltensor"'),
                              ({"max_version": (1, 0), "stream": 1}, '"dltensor_versioned"')):
            with self.subTest(options=options):
                self.assertIn(name, str(array.__dlpack__(**options)))
        described = array.__cuda_array_interface__
        self.assertEqual((described["data"][0], described["shape"], described["strides"]), (4096, (7, 3), (16, 4)))

    def test_other_threads_run_while_it_steps(self):
        simulation = voxspring.Simulation(voxspring.scene("box@32"), "cpu_reference")
        stepping = threading.Thread(target=simulation.step, args=(400,))
        begin = time.perf_counter()
        stepping.start()
        pauses, last = [], begin
        while stepping.is_alive():
            pauses.append(time.perf_counter() - last)
            last += pauses[-1]
        self.assertGreater(last - begin, 0.1, "too short a run to tell")
        self.assertLess(max(pauses), (last - begin) / 2)

    def test_ctrl_c_ends_a_long_call(self):
        # A shell that starts this in the background has it ignore the signal.
        program = ("import signal, voxspring; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
                   "s = voxspring.Simulation(voxspring.scene('box@16'), 'cpu_parallel'); print('go', flush=True)\n"
                   "try: s.step(2_000_000_000)\n"
                   "except KeyboardInterrupt: print('interrupted after', s.steps)")
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as process:
            process.stdout.readline()
            time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            try:
                out, _ = process.communicate(timeout=20)
            finally:
                process.kill()
        self.assertRegex(out, r"interrupted after [1-9]")

    def test_a_call_costs_microseconds(self):
        simulation = voxspring.Simulation(voxspring.Body(TINY), "cpu_reference")
        calls = 2000

        def seconds(run):
            begin = time.perf_counter()
            run()
            return time.perf_counter() - begin

        def call_by_call():
            for _ in range(calls):
                simulation.step(1)

        single = min(seconds(call_by_call) for _ in range(20)) / calls
        together = min(seconds(lambda: simulation.step(calls)) for _ in range(20)) / calls
        print(f"a call of one step costs {1e6 * (single - together):.2f} us more than a step of {1e6 * together:.2f} us")
        self.assertLess(single - together, 5e-6)


class Judging(unittest.TestCase):
    def test_refuses_a_kernel_without_a_diagonal_and_passes_it_mended(self):
        body = beam()
        with self.assertRaisesRegex(voxspring.Wrong, "beam/step/position/float32: does not agree with cpu_reference") as refused:
            voxspring.judge(springs_kernel(body, lost_diagonal(body)), body, steps=50, repetitions=2)
        self.assertEqual([row["backend"] for row in refused.exception.result.failed], ["step"])
        self.assertEqual(refused.exception.result.rows, [])
        result = voxspring.judge(springs_kernel(body), body, steps=50, repetitions=4)
        (row,) = result.rows
        self.assertEqual((row["scene"], row["backend"], row["precision"]), ("beam", "step", "float32"))
        self.assertGreater(row["real_time"], 0)
        self.assertEqual(len([one for one in result.json["benchmarks"] if one["run_type"] == "iteration"]), 4)
        self.assertEqual(result.json["context"]["voxspring"]["backends"]["step"]["api"], f"numpy {numpy.__version__}")
        self.assertGreater(row["lines_of_code"], 8)
        self.assertIn("step position float32", str(result))

    def test_judges_every_repetition(self):
        body, calls = beam(), []
        right, wrong = springs_kernel(body), springs_kernel(body, lost_diagonal(body))

        def step(x, v, n):
            calls.append(n)
            (wrong if len(calls) == 3 else right)(x, v, n)

        with self.assertRaises(voxspring.Wrong):
            voxspring.judge(step, body, steps=50, repetitions=4)
        self.assertEqual(calls, [50] * 5)

    def test_a_start_that_strains_no_spring_does_not_pass_a_kernel_without_springs(self):
        body = voxspring.Body(numpy.ones((5, 5, 5), int), gravity=(0, 0, -1e-3), name="falling")
        with self.assertRaisesRegex(voxspring.Wrong, "from a strained start"):
            voxspring.judge(springs_kernel(body, numpy.zeros(len(body.springs), bool)), body, steps=10, repetitions=2)
        result = voxspring.judge(springs_kernel(body), body, steps=10, repetitions=2)
        self.assertIn("strained_start", result.json["verification"][0])

    def test_float64_and_displacements_have_their_own_thresholds(self):
        body = beam()

        def on_displacements(x, v, n):
            x += body.rest_position
            springs_kernel(body)(x, v, n)
            return x - body.rest_position, v

        (row,) = voxspring.judge(on_displacements, body, steps=50, repetitions=2, precision="float64", formulation="displacement").rows
        self.assertLess(row["error_max"], 1e-12)
        with self.assertRaises(voxspring.Wrong):
            voxspring.judge(lambda x, v, n: tuple(a.astype(float) for a in _rounded(body, x, v, n)), body, steps=50, repetitions=2,
                            precision="float64")

    def test_a_wrong_kernel_or_argument_is_named(self):
        body, right = beam(), springs_kernel(beam())
        for step, settings, expected in ((lambda x, v, n: (x[:-1], v), {}, r"x of shape \(143, 3\).*\(144, 3\)"),
                                         (lambda x, v, n: (x.astype(float), v), {}, "x of float64.*float32"),
                                         (lambda x, v, n: (x, v, n), {}, "3 values.*x and v"),
                                         (lambda x, v, n: n, {}, "1 value returned.*x and v"),
                                         (right, {"arrays": "fortran"}, "fortran.*numpy, torch"),
                                         (right, {"arrays": "numpy:cuda"}, "numpy:cuda.*numpy computes on the processor only"),
                                         (right, {"arrays": "cupy:cpu"}, "cupy:cpu.*cupy on a card only"),
                                         (right, {"precision": "float16"}, "float16.*float64"),
                                         (right, {"formulation": "velocity"}, "velocity.*increment"),
                                         (right, {"name": "a name"}, "a name.*without a blank|without a '/'"),
                                         (right, {"steps": 0}, "steps.*1 or more")):
            with self.assertRaisesRegex(voxspring.BadInput, expected):
                voxspring.judge(step, body, **{"steps": 5, "repetitions": 1, **settings})
        with self.assertRaisesRegex(voxspring.Unavailable, "torch:cuda.*No module named 'torch'"):
            voxspring.judge(right, body, steps=5, arrays="torch:cuda")
        def no_card(name):
            raise AssertionError(f"not compiled with {name} enabled")

        with mock.patch.dict(sys.modules, jax=types.SimpleNamespace(devices=no_card)):
            with self.assertRaisesRegex(voxspring.Unavailable, "jax:cuda.*not compiled with cuda enabled"):
                voxspring.judge(right, body, steps=5, arrays="jax:cuda")
        with self.assertRaisesRegex(voxspring.BadInput, "incision.*without edits"):
            voxspring.judge(right, voxspring.scene("incision"), steps=5)


def _rounded(body, x, v, n):
    x, v = x.astype(numpy.float32), v.astype(numpy.float32)
    springs_kernel(body)(x, v, n)
    return x, v


class Studies(unittest.TestCase):
    def test_a_study_of_a_body_is_a_frame(self):
        body = beam()
        own = voxspring.study("default", body, steps=20, backends=["cpu_parallel"], repetitions=2)
        joined = voxspring.Result.joined([own, voxspring.judge(springs_kernel(body), body, steps=20, repetitions=2)], "both")
        frame = joined.frame()
        self.assertEqual(set(frame["backend"]), {"cpu_parallel", "step"})  # in two precisions, and ours
        self.assertEqual(set(frame["scene"]), {"beam"})
        joined.save("joined.json")
        self.assertEqual(voxspring.Result.load("joined.json").json, json.loads(json.dumps(joined.json)))
        packed = gzip.compress(pathlib.Path("joined.json").read_bytes())
        pathlib.Path("joined.json.gz").write_bytes(packed)
        self.assertEqual(voxspring.Result.load("joined.json.gz").json, joined.json)
        # Rows of another kind of study than timing have other columns.
        pareto = voxspring.Result.load(pathlib.Path(__file__).parents[1] / "results/amd-epyc/pareto.json.gz")
        self.assertRegex(str(pareto), r"box@32[^\n]*cpu_parallel")
        for content, reason in ((packed[:-9], "ended before"), (b"{", "Expecting property name"), (b"\x93NUMPY", "decode"),
                                (b"[1]", "key benchmarks")):
            pathlib.Path("broken.json").write_bytes(content)
            with self.assertRaisesRegex(voxspring.BadInput, f"broken.json: .*{reason}"):
                voxspring.Result.load("broken.json")
        with mock.patch("pathlib.Path.replace", side_effect=OSError("disk full")), self.assertRaisesRegex(OSError, "disk full"):
            own.save("joined.json")
        self.assertEqual(voxspring.Result.load("joined.json").json, joined.json)
        self.assertEqual(list(pathlib.Path().glob(".joined*")), [])
        self.addCleanup(os.umask, os.umask(0o077))
        own.save("private.json")
        self.assertEqual(os.stat("private.json").st_mode & 0o777, 0o600)
        with self.assertRaisesRegex(voxspring.BadInput, "none is not accepted"):
            voxspring.Result.joined([], "both")
        self.assertIn("cpu_parallel", str(joined))
        with self.assertRaisesRegex(voxspring.BadInput, "no_such_study"):
            voxspring.study("no_such_study")

    def test_steps_are_those_of_a_body(self):
        for body, steps in ((None, 20), (beam(), 0), (beam(), -1)):
            with self.assertRaisesRegex(voxspring.BadInput, rf"study\(\): steps: {steps} is not accepted; expected 1 or more"):
                voxspring.study("smoke", body, steps=steps, repetitions=1)

    def test_the_command_is_the_program_and_its_peers(self):
        command = pathlib.Path(sys.executable).parent / "voxspring"
        listed = subprocess.run([command, "list"], capture_output=True, text=True, check=True)
        self.assertIn("cpu_parallel", listed.stdout)
        done = subprocess.run([command, "study", "peers", "--peer", "num*", "--scene", "box@32", "--repetitions", "1", "--out", "peers.json"],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        result = voxspring.Result.load("peers.json")
        self.assertEqual({(row["backend"], row["formulation"]) for row in result.rows},
                         {("cpu_parallel", "position"), ("cpu_parallel", "increment"), ("numpy", "position")})
        self.assertEqual([(row["backend"], row["reason"]) for row in result.json["skipped"]],
                         [("numba", "no Python package numba is installed")])
        # Refused at once, not after everything has been measured.
        for out in ("no/peers.json", "peers.txt"):
            done = subprocess.run([command, "study", "peers", "--out", out], capture_output=True, text=True, check=False)
            self.assertEqual((done.returncode, done.stdout), (2, ""), done.stderr)
            self.assertEqual(done.stderr, f"voxspring: command line: --out: {out} is not accepted; expected a path that ends in "
                             ".json, in a folder where a file can be created\n")

    def test_a_peer_that_is_killed_between_repetitions_has_failed(self):
        for ask in (lambda case: case.repeat(), lambda case: case.result()):
            case = peers._Case("numpy", "box@8", 1, 2, "cpu")
            self.addCleanup(case.end)
            self.assertEqual(case.reason, "")
            os.kill(case._process.pid, signal.SIGKILL)
            case._process.join()
            ask(case)
            self.assertEqual(case.reason, "its process was killed by signal 9")

    def test_a_file_of_some_scenes_says_that_it_is_unfinished(self):
        """An interrupted run leaves it, and results/remake.py would take it for whole."""
        def study(*_, **__):
            build = {"study": {}, "gpu": "", "driver": "", "gl_renderer": ""}
            return voxspring.Result({"context": {"voxspring": build}, "fastest": []})

        saved = []
        with mock.patch.object(peers, "study", study), mock.patch.object(
                voxspring.Result, "save", lambda result, file: saved.append("unfinished" in result.json["context"]["voxspring"])):
            peers.run([], {"box@3": 1, "box@4": 1}, 1, "cpu", [], "peers.json")
        self.assertEqual(saved, [True, False])

    def test_every_peer_has_a_pinned_version(self):
        pinned = (pathlib.Path(voxspring.__file__).parent / "peers/requirements.txt").read_text().splitlines()
        names = [line.split("==")[0].split("-")[0] for line in pinned if not line.startswith("#")]
        self.assertEqual(sorted(names), sorted(peers.PEERS))
        self.assertTrue(all("==" in line for line in pinned if not line.startswith("#")))

    def test_a_processor_makes_fewer_steps_and_no_large_scene(self):
        card, processor = peers.scenes_of("cuda"), peers.scenes_of("cpu")
        self.assertEqual(list(card), list(peers.SCENES))
        self.assertLess(set(processor), set(card))
        self.assertTrue(all(0 < steps < card[name] for name, steps in processor.items()))
        self.assertEqual(list(peers.scenes_of("cpu", ["box@96"])), ["box@96"])


class Wheel(unittest.TestCase):
    def test_opens_no_nvrtc_before_a_card_is_asked_for(self):
        program = ("import re, voxspring; voxspring.Simulation(voxspring.scene('box@4'), 'cpu_parallel').step(1)\n"
                   "print(re.findall('libnvrtc[^ ]*', open('/proc/self/maps').read()))")
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        self.assertEqual(done.stdout.strip(), "[]", "importing and stepping on the processor open no NVRTC")

    def test_has_types(self):
        stub = (pathlib.Path(voxspring.__file__).parent / "_core.pyi").read_text()
        self.assertRegex(stub, r"class Simulation:\n")
        self.assertIn("labels: ArrayLike", stub)
        self.assertTrue((pathlib.Path(voxspring.__file__).parent / "py.typed").exists())

    def test_everything_public_says_what_it_does(self):
        for name in voxspring.__all__:
            self.assertTrue(getattr(voxspring, name).__doc__, name)


if __name__ == "__main__":
    unittest.main()
