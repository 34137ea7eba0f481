"""The voxspring executable as its users meet it: output, files and exit codes.

VOXSPRING names the executable; the current directory is the source tree.
"""

import array
import csv
import json
import math
import os
import pathlib
import re
import resource
import shlex
import subprocess
import sys
import unittest
import zipfile

import jsonschema
from program import VOXSPRING, InTemporaryFolder, json_of, new_folder, nrrd, run, succeeds, voxspring

NO_OPENGL = os.environ | {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json"}
COMPARE = "/usr/share/benchmark/compare.py"
SCHEMA, STUDY_SCHEMA = (jsonschema.Draft202012Validator(json.loads(pathlib.Path(f"results/{name}.json").read_text()))
                        for name in ("schema", "study.schema"))


class List(unittest.TestCase):
    def test_names_every_backend_with_what_it_runs_on_or_why_not(self):
        listed = json_of("list", "--json")
        backends = {b["name"]: b for b in listed["backends"]}
        for name in ("cpu_reference", "cpu_parallel", "gl_fragment_implicit", "gl_fragment_explicit",
                     "gl_compute_implicit", "gl_compute_explicit"):
            self.assertIn(name, backends)
        for backend in backends.values():
            self.assertTrue(backend["device"] if backend["available"] else backend["reason"])
        self.assertTrue(backends["cpu_reference"]["available"])
        self.assertEqual({name: backends[name]["beyond_lattice"] for name in ("cpu_reference", "cpu_explicit", "cpu_parallel")},
                         {"cpu_reference": True, "cpu_explicit": True, "cpu_parallel": False})
        self.assertIn("box", [s["name"] for s in listed["scenes"]])
        self.assertIn("default", [s["name"] for s in listed["studies"]])
        text = voxspring("list").stdout
        for name in backends:
            self.assertIn(name, text)
        for reason in {backend["reason"] for backend in backends.values() if not backend["available"]}:
            self.assertEqual(text.count(reason), 1, "one line per reason, however many backends have it")

    def test_names_the_devices_that_vulkan_may_take(self):
        devices = json_of("list", "--json").get("vulkan_devices")
        if not devices:
            self.skipTest("no Vulkan")
        text = voxspring("list", "--vulkan-device", 0).stdout
        for device in devices:
            self.assertIn(f"{device['number']} {device['name']}, {device['kind']}", text)
        # The 1 in "llvmpipe (LLVM 15.0.6, 256 bits)" does not make it device 1.
        for wanted in ("no such card", str(len(devices))):
            refused = voxspring("run", "box@6", "--backend", "vulkan_implicit", "--vulkan-device", wanted)
            self.assertEqual(refused.returncode, 2, wanted)
            for word in ("--vulkan-device", wanted, f"0 {devices[0]['name']}"):
                self.assertIn(word, refused.stderr)


class References(InTemporaryFolder):
    def test_another_program_takes_none_of_this_one(self):
        other = self.folder / "voxspring"
        # Bytes behind the end of an ELF file change the file, but not what it does.
        other.write_bytes(pathlib.Path(VOXSPRING).read_bytes() + b"another")
        other.chmod(0o755)
        cache = self.folder / "cache"

        def references(program):
            ran = run(program, "study", "smoke", "--scene", "box@6", "--backend", "cpu_parallel", "--repetitions", 1,
                      env=os.environ | {"VOXSPRING_CACHE": str(cache)})
            self.assertEqual(ran.returncode, 0, ran.stderr)
            # Limits are kept by build and device, which both programs share.
            return {file for file in cache.rglob("*") if file.is_file() and not file.name.startswith("limits-")}

        own = references(VOXSPRING)
        self.assertTrue(own)
        self.assertEqual(references(VOXSPRING), own)
        both = references(other)
        self.assertEqual(len(both), 2 * len(own))


class Limits(unittest.TestCase):
    def test_measures_every_device_found(self):
        backends = json_of("list", "--json")["backends"]
        result = succeeds("limits", "--json")
        limits = json.loads(result.stdout)
        validator = jsonschema.Draft202012Validator({"$defs": SCHEMA.schema["$defs"], "$ref": "#/$defs/limits"})
        for device in limits.values():
            validator.validate(device)
        self.assertEqual({(family, device["device"]) for family, device in limits.items()},
                         {(re.split(r" \d", b["api"])[0], b["device"]) for b in backends if b["available"]})
        text = voxspring("limits").stdout
        for family, device in limits.items():
            self.assertIn(f"limits of {family}: ", text)
            self.assertIn(device["device"], text)


class Info(InTemporaryFolder):
    def test_heart_phantom_has_the_published_counts(self):
        info = json_of("info", "heart", "--json")
        self.assertEqual(info["voxels"], 140760)
        self.assertEqual(info["active_particles"], 29449)
        self.assertEqual(info["springs"]["total"], 220507)
        self.assertGreater(info["pinned_particles"], 0)
        self.assertLess(info["time_step"], info["stable_time_step"])
        self.assertGreater(info["bytes"]["cpu_reference"], 220507 * 24)
        text = voxspring("info", "heart").stdout
        for figure in ("140760", "29449", "220507", "60 x 51 x 46"):
            self.assertIn(figure, text)

    def test_says_what_limits_the_time_step(self):
        info = json_of("info", "beam", "--json")
        self.assertAlmostEqual(info["stable_time_step"], 2 / math.sqrt(12), places=12)
        self.assertEqual(info["stable_time_step_undamped"], info["stable_time_step"])
        self.assertAlmostEqual(info["stable_over_limit"], 0.98716, places=5)
        self.assertAlmostEqual(info["time_step_limit"] * info["stable_over_limit"], info["stable_time_step"])
        self.assertIsNone(info["time_step_limit_unknown"])
        large = json_of("info", "box@80", "--json")
        self.assertIsNone(large["time_step_limit"])
        self.assertIn("300000", large["time_step_limit_unknown"])
        self.assertIn("98.72%", voxspring("info", "beam").stdout)

    def test_says_that_nothing_limits_the_time_step(self):
        scene = self.write("held.json", {"dataset": {"type": "box", "dims": [2, 2, 2]}, "pinned": {"side": "x-", "slices": 2},
                                         "time_step": 0.5})
        said = voxspring("info", scene).stdout
        self.assertRegex(said, r"(?m)^time step +0\.5; every time step is stable\n +limit +none: nothing oscillates$")
        self.assertNotIn("nan", said)
        info = json_of("info", scene, "--json")
        self.assertIsNone(info["time_step_limit"])
        self.assertEqual(info["time_step_limit_unknown"], "nothing oscillates")

    def test_damping_per_second_leaves_the_stable_time_step(self):
        volume = self.write("solid.nrrd", nrrd("4 4 4", [1] * 64))
        steps = []
        for damping in (0, 0.5):
            info = json_of("info", volume, "--damping", damping, "--json")
            self.assertEqual(info["stable_time_step_undamped"], info["stable_time_step"])
            steps.append(info["stable_time_step"])
        self.assertEqual(*steps)
        self.assertIn(" per step, 0.5 per second\n", voxspring("info", volume, "--damping", 0.5).stdout)

    def test_percentages_are_numbers_that_people_read(self):
        for time_step, said in ((6.0, "1039%"), (0.5, "87%"), (0.05, "8.7%")):
            scene = self.write("coarse.json", {"dataset": {"type": "box", "dims": [5, 5, 5]}, "time_step": time_step})
            self.assertIn(f"({said} of the stable ", voxspring("info", scene).stdout)

    def test_without_memory_a_sentence_says_so(self):
        program = pathlib.Path(VOXSPRING).read_bytes()
        if b"__asan_init" in program or b"__tsan_init" in program:
            self.skipTest("a sanitizer needs the memory that is taken away")
        limit = 250 << 20
        ran = voxspring("info", "box@200", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (limit, limit)))
        self.assertEqual(ran.returncode, 1, ran.stderr)
        self.assertIn("voxspring: out of memory", ran.stderr)
        self.assertNotIn("bad_alloc", ran.stderr)


class Run(InTemporaryFolder):
    def test_writes_the_final_state(self):
        out = self.folder / "state.csv"
        succeeds("run", "box@6", "--backend", "cpu_parallel", "--steps", 20, "--out", out)
        with open(out) as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(len(rows), 216)
        self.assertTrue(all(math.isfinite(float(v)) for row in rows for v in row.values()))
        top = rows[-1]
        self.assertEqual([top["voxel_x"], top["voxel_y"], top["voxel_z"]], ["5", "5", "5"])
        self.assertLess(float(top["displacement_z"]), 0, "gravity pulls down")
        self.assertEqual([p.name for p in self.folder.iterdir()], ["state.csv"], "no temporary file is left")

    def test_refuses_bad_usage(self):
        for scene, backend, out, words in (("box@6", "cpu_parallel", "missing/state.csv", ["missing"]),
                                           ("box@6", "cpu_parallel", "state.txt", ["state.txt", ".csv"]),
                                           ("box@6", "cpu_magic", "state.csv", ["cpu_magic", "cpu_parallel"]),
                                           ("box@6", "cpu_parallel:precision=half", "state.csv", ["half", "float64"]),
                                           ("box@6", "auto:mask=none", "state.csv", ["auto", "mask", "formulation"]),
                                           ("box@6", "auto:precision=half", "state.csv", ["half", "float64"]),
                                           ("no_such_scene", "cpu_parallel", "state.csv", ["no_such_scene", "box"])):
            self.assert_refused(voxspring("run", scene, "--backend", backend, "--out", self.folder / out), *words)
        self.assertEqual(voxspring("run").returncode, 2)
        self.assertEqual(voxspring("--help").returncode, 0)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_refuses_more_threads_than_openmp_may_start(self):
        """They would share fewer threads without a word, and a result would name the wanted number."""
        for backend in ("cpu_explicit", "cpu_parallel"):
            ran = voxspring("run", "box@6", "--backend", f"{backend}:threads=2", env=os.environ | {"OMP_THREAD_LIMIT": "1"})
            self.assert_refused(ran, f"{backend}: threads=2 is more than the maximum, 1, which OMP_THREAD_LIMIT sets")

    def test_takes_no_more_threads_than_openmp_survives(self):
        """With a million threads OpenMP overflowed the stack, in the program and in its workers."""
        for arguments in (("run", "box@6", "--backend", "cpu_parallel", "--steps", 1), ("list",)):
            ran = voxspring(*arguments, env=os.environ | {"OMP_NUM_THREADS": "1000000"})
            self.assertEqual((ran.returncode, ran.stderr.count("OMP_NUM_THREADS is 1000000; 1024 threads are used at most")), (0, 1))

    def test_auto_says_what_it_takes_and_why(self):
        result = succeeds("run", "box@6", "--backend", "auto:formulation=position", "--steps", 3)
        said, ran = result.stdout.splitlines()
        self.assertRegex(said, r"^auto: \w+.*, a full lattice of 216 voxels: ")
        self.assertIn(" on " + said.split(": ")[1].split(",")[0].split(":")[0] + "/position/float32", ran)
        self.assert_refused(voxspring("study", "smoke", "--backend", "auto:mask=none"), "auto", "mask", "formulation")

    def test_divergence_is_a_failure(self):
        scene = self.write("unstable.json", {"dataset": {"type": "box", "dims": [5, 5, 5]}, "time_step": 1.5,
                                             "initial": {"displacement": {"random": 0.1, "seed": 1}}})
        out = self.folder / "state.csv"
        result = voxspring("run", scene, "--backend", "cpu_reference", "--steps", 5000, "--out", out)
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertRegex(result.stderr, r"diverged at step \d+: .* moved by more than")
        self.assertFalse(out.exists())

    def test_divergence_with_a_short_time_step_names_it(self):
        scene = self.write("stiff.json", {"dataset": {"type": "box", "dims": [5, 5, 5]}, "time_step": 1.5e-6, "stiffness": 1e12,
                                          "initial": {"displacement": {"random": 0.1, "seed": 1}}})
        result = voxspring("run", scene, "--backend", "cpu_reference", "--steps", 5000)
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertRegex(result.stderr, r"diverged at step \d+: .*; time step 1\.5e-06, stable [1-9]\S*e-07\n$")


def read_png(path):
    """A picture's size, its pixels as rows of (red, green, blue, opacity) from 0 to 1, and the text stored in it."""
    import matplotlib.image
    pixels = matplotlib.image.imread(path)
    data = path.read_bytes()
    place = data.index(b"tEXtvoxspring\0")
    length = int.from_bytes(data[place - 4:place], "big")
    return pixels, json.loads(data[place + len("tEXtvoxspring") + 1:place + 4 + length])


class Pictures(InTemporaryFolder):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "body.png"

    def draw(self, scene, *options):
        return succeeds("run", scene, "--backend", "cpu_parallel", *options)

    def test_shows_the_deformed_body(self):
        result = self.draw("heart", "--steps", 50, "--out", self.out, "--size", "320x240")
        pixels, about = read_png(self.out)
        self.assertEqual(pixels.shape, (240, 320, 4))
        body = pixels[:200, :, 3]
        self.assertEqual([body[0, 0], body[0, -1], body[-1, 0], body[-1, -1]], [0, 0, 0, 0])
        # It is as wide or as high as the picture allows. The heart was seen to cover 0.52 of the part above the legend.
        self.assertTrue(0.45 < (body == 1).mean() < 0.6, (body == 1).mean())
        largest = float(re.search(r"largest displacement (\S+)", result.stdout)[1])
        self.assertAlmostEqual(about.pop("largest") / largest, 1, places=5)  # printed to six digits
        self.assertTrue(about.pop("renderer"))
        self.assertEqual(about, {"scene": "heart", "particles": 29449, "steps": 50, "coloured_by": "displacement",
                                 "backend": "cpu_parallel/increment/float32"})
        again = self.folder / "again.png"
        self.draw("heart", "--steps", 50, "--out", again, "--size", "320x240")
        self.assertEqual(again.read_bytes(), self.out.read_bytes())
        self.assertEqual({path.name for path in self.folder.iterdir()}, {"body.png", "again.png"})

    def test_shows_the_error_against_float64(self):
        state, reference = self.folder / "state.csv", self.folder / "reference.csv"
        result = self.draw("box@8", "--steps", 40, "--out", self.out, "--out", state, "--colour", "error")
        pixels, about = read_png(self.out)
        self.assertEqual(pixels.shape, (960, 1280, 4))
        voxspring("run", "box@8", "--backend", "cpu_reference", "--steps", 40, "--out", reference)
        rows = [list(csv.DictReader(path.read_text().splitlines())) for path in (state, reference)]
        errors = [math.dist(*([float(row[f"displacement_{axis}"]) for axis in "xyz"] for row in pair))
                  for pair in zip(*rows)]
        self.assertGreater(max(errors), 0)
        self.assertAlmostEqual(about["largest"] / max(errors), 1, places=12)
        self.assertIn(f"largest displacement error in the last picture, against float64: {max(errors):.6g}\n", result.stdout)
        # float64 compared with itself gives a picture as well.
        result = succeeds("run", "box@8", "--backend", "cpu_reference", "--steps", 40, "--out", self.out, "--colour", "error")
        self.assertEqual(read_png(self.out)[1]["largest"], 0)

    def test_frames_have_one_camera_and_one_scale(self):
        frames = self.folder / "frames"
        self.draw("box@6", "--steps", 50, "--frames", frames, "--every", 20, "--size", "160x120")
        names = [f"frame_{step:06}.png" for step in (20, 40, 50)]
        self.assertEqual(sorted(path.name for path in frames.iterdir()), names)
        pictures = [read_png(frames / name) for name in names]
        self.assertEqual([about["steps"] for _, about in pictures], [20, 40, 50])
        # The bar at the bottom, with its ticks, is equal in all pictures, though the bodies differ. Above it, in the right half,
        # stands the largest value of each picture, which differs.
        for pixels, about in pictures[1:]:
            self.assertTrue((pixels[107:] == pictures[0][0][107:]).all())
            self.assertTrue((pixels[102:107, :80] == pictures[0][0][102:107, :80]).all())
            self.assertFalse((pixels[102:107, 80:] == pictures[0][0][102:107, 80:]).all())
            self.assertFalse((pixels[:102] == pictures[0][0][:102]).all())
        # --out with --every makes an equal series. Without --every there are at most 50 frames.
        self.draw("box@6", "--steps", 50, "--out", self.out, "--every", 20, "--size", "160x120")
        self.assertEqual((self.folder / "body_000040.png").read_bytes(), (frames / names[1]).read_bytes())
        self.assertFalse(self.out.exists())
        many, state = self.folder / "many", self.folder / "state.csv"
        self.draw("box@6", "--steps", 101, "--frames", many, "--out", state, "--size", "64x64")
        self.assertEqual(len(list(many.iterdir())), 34)
        self.assertTrue(state.exists(), "one file after the last step, not a series")

    def test_beside_a_backend_that_has_a_context_of_its_own(self):
        frames = self.folder / "frames"
        succeeds("run", "box@6", "--backend", "gl_fragment_implicit:precision=float32", "--steps", 60, "--frames",
                           frames, "--every", 30, "--colour", "error", "--size", "160x120")
        errors = [read_png(path)[1]["largest"] for path in sorted(frames.iterdir())]
        # float32 keeps seven digits of displacements that are below one.
        self.assertTrue(all(0 < error < 1e-6 for error in errors), errors)

    def test_a_cut_is_seen(self):
        def draw(edits):
            scene = self.write("cut.json", {
                "dataset": {"type": "box", "dims": [9, 9, 9]}, "pinned": {"side": "z-"}, "gravity": [0, 0, 2e-2],
                "time_step": {"fraction_of_stable": 0.5}, "edits": edits})
            self.draw(scene, "--steps", 150, "--out", self.out, "--size", "160x120")
            return read_png(self.out)[0][:98, :, 3]  # above the legend
        # The upper half flies away: the gap between the halves is transparent.
        whole = draw([])
        apart = draw([{"step": 1, "cut": {"plane": {"point": [4, 4, 4.5], "normal": [0, 0, 1]}}}])
        rows = [body.any(axis=1) for body in (whole, apart)]
        inner = [row[row.argmax():len(row) - row[::-1].argmax()] for row in rows]
        self.assertTrue(inner[0].all())
        self.assertFalse(inner[1].all())

    def test_refuses_bad_usage(self):
        file = self.write("file", "")
        sizes = ("640", "640x", "63x640", "640x4097", "640x480x3", "-640x480", "640x480 ", "99999999999x480")
        for options, words in ((["--colour", "error"], ["--colour", "error", ".png", "--frames"]),
                               (["--out", self.folder / "a.csv", "--size", "90x90"], ["--size", "90x90", ".png"]),
                               (["--out", self.out, "--colour", "red"], ["red", "displacement or error"]),
                               (["--frames", file], ["--frames", str(file)]),
                               *((["--out", self.out, f"--size={size}"], ["--size", size, "64 to 4096"]) for size in sizes)):
            self.assert_refused(voxspring("run", "box@6", "--backend", "cpu_parallel", *options), *words)
        self.assertEqual(list(self.folder.iterdir()), [file])

    def test_says_where_there_is_no_opengl(self):
        result = voxspring("run", "box@6", "--backend", "cpu_parallel", "--out", self.out, env=NO_OPENGL)
        self.assertEqual((result.returncode, result.stdout), (1, ""))
        self.assertIn("no OpenGL: ", result.stderr)
        self.assertFalse(self.out.exists())
        # Commands that need none still work.
        self.assertEqual(voxspring("run", "box@6", "--backend", "cpu_parallel", env=NO_OPENGL).returncode, 0)


class Names(InTemporaryFolder):
    def test_one_that_is_not_utf8_loses_nothing(self):
        """A file's name may be any bytes; JSON takes U+FFFD for those that are not UTF-8."""
        scene = os.fsencode(self.folder) + b"/b\xf6x.json"
        with open(scene, "w") as file:
            json.dump({"dataset": {"type": "box", "dims": [4, 4, 4]}, "time_step": {"fraction_of_stable": 0.5}}, file)
        options = ["--backend", "cpu_reference", "--repetitions", "1", "--out", self.folder / "r.json"]
        for command in (["info", scene, "--json"], ["study", "smoke", "--scene", scene, *options]):
            ran = subprocess.run([VOXSPRING, *command], capture_output=True, timeout=300, check=False)
            self.assertEqual(ran.returncode, 0, ran.stderr)
            if command[0] == "info":
                self.assertEqual(json.loads(ran.stdout)["scene"], "b\ufffdx.json")
        rows = json.loads((self.folder / "r.json").read_text())["benchmarks"]
        self.assertEqual({row["scene"] for row in rows}, {"b\ufffdx.json"})


class OwnStudy(InTemporaryFolder):
    def run_study(self, study, **options):
        """Output and result of a study of the user, which follow the schema as those of built-in studies do."""
        out = self.folder / "result.json"
        STUDY_SCHEMA.validate(study)
        ran = succeeds("study", self.write("study.json", study), "--out", out, **options)
        result = json.loads(out.read_text())
        SCHEMA.validate(result)
        return ran.stdout, result


class Study(OwnStudy):
    def test_the_schema_of_studies_refuses_what_is_none(self):
        pareto = {"kind": "pareto", "backends": ["*"], "scenes": [{"scene": "box"}], "time_steps": [0.5, 0.25]}
        target = {"scene": "box", "formulation": "position"}
        fastest = {"kind": "fastest", "backends": ["auto"], "scenes": [{"scene": "box", "rewind": False}]}

        def of(**change):
            return fastest | {"targets": [target | change]}
        for study in (pareto, of(seconds_per_step=1e-6), of(speed_ratio=0.95, over="cuda_*")):
            self.assertTrue(STUDY_SCHEMA.is_valid(study), study)
        for study in ({"backends": ["*"], "scenes": []}, pareto | {"kind": "timing"},
                      {key: value for key, value in pareto.items() if key != "time_steps"},
                      {"backends": ["*"], "scenes": [{"scene": "box", "step": 3}]}, of(seconds_per_step=1e-6) | {"kind": "timing"},
                      of(), of(speed_ratio=0.95), of(seconds_per_step=1e-6, fraction_of_limit=0.5),
                      of(seconds_per_step=1e-6, over="gl_*"), of(seconds_per_step=0), of(seconds_per_step=1e-6, formulation="verlet")):
            self.assertFalse(STUDY_SCHEMA.is_valid(study), study)

    def run_smoke(self, *arguments):
        out = self.folder / "smoke.json"
        # Lines that appear every ten seconds are left out, since a slow machine would print some in between.
        result = succeeds("study", "smoke", "--out", out, *arguments, env={**os.environ, "VOXSPRING_PROGRESS_SECONDS": "3600"})
        for line in result.stderr.splitlines():
            self.assertRegex(line, r"^\[\d/\d\] \S+: \d+ rows? in \S+ s(, about \d+ \w+ left)?$", "in a pipe one line per scene")
        with open(out) as file:
            return result.stdout, json.load(file)

    def test_says_that_nothing_is_kept_without_a_file(self):
        arguments = ["study", "smoke", "--scene", "box@4", "--backend", "cpu_parallel", "--repetitions", "1"]
        self.assertIn("this result is not saved; --out FILE.json saves each part", voxspring(*arguments).stderr)
        out = self.folder / "kept.json"
        kept = voxspring(*arguments, "--out", out)
        self.assertNotIn("not saved", kept.stderr)
        self.assertIn(f"written: {out}", kept.stdout)

    def test_result_follows_its_schema_and_leaves_nothing_out(self):
        table, result = self.run_smoke()
        SCHEMA.validate(result)
        self.assertEqual(result["schema_version"], 1)
        # Nothing that names the machine, but the compiler of CUDA code if there is any.
        for key, value in (("host_name", "a-machine"), ("executable", "/home/somebody/voxspring")):
            self.assertFalse(SCHEMA.is_valid(result | {"context": result["context"] | {key: value}}))
        build = result["context"]["voxspring"]
        has_cuda = any(name.startswith("cuda_") for name in
                       {row["backend"] for row in result["benchmarks"] + result["skipped"]})
        self.assertEqual(build["cuda_compiler"] is not None, has_cuda)
        measured = {(r["scene"], r["backend"]) for r in result["benchmarks"]}
        skipped = {(r["scene"], r["backend"]) for r in result["skipped"]}
        listed = [b["name"] for b in json_of("list", "--json")["backends"]
                  if "summary" in b]
        for scene in ("box@8", "heart@30x26x23"):
            for backend in listed:
                self.assertIn((scene, backend), measured | skipped)
                if (scene, backend) in measured:
                    self.assertIn(backend, table)
        reasons = {row["reason"] for row in result["skipped"]}
        lines = [line for line in table.splitlines() if line.startswith("skipped: ")]
        self.assertEqual(len(lines), len(reasons), "one line per reason")
        for reason in reasons:
            self.assertTrue(any(line.endswith(": " + reason) for line in lines), reason)
        self.assertEqual(result["failed"], [])
        self.assertIn("% of roofline", table)
        self.assertIn(build["order_seed"], range(1 << 32))
        self.assertGreater(build["elapsed_seconds"], 0)
        self.assertTrue(build["study_flags"].startswith(build["flags"]))
        self.assertEqual(build["study_flags"].endswith(" -O1"), "-O3" in build["flags"])
        self.assertEqual(result["context"]["library_build_type"], "release" if "-DNDEBUG" in build["flags"] else "debug")
        for family in {b["api"].split()[0] for b in result["context"]["voxspring"]["backends"].values()}:
            self.assertIn(f"limits of {family}: ", table)
        for row in result["benchmarks"]:
            self.assertTrue(row["name"].startswith(f"{row['scene']}/{row['backend']}/"), row["name"])
            self.assertIsNone(row["total_error_reason"])
            self.assertIs(row["chaotic"], False)
        commit = run("git", "rev-parse", "--short=12", "HEAD").stdout
        self.assertIn(result["context"]["voxspring"]["commit"], (commit.strip(), "unknown"))

    def test_a_result_names_the_units_of_its_scenes(self):
        box = {"dataset": {"type": "box", "dims": [4, 4, 4]}, "spacing": 2, "unit": "mm", "young": "5 kPa", "density": 1050}
        self.write("tissue.json", box)
        study = {"backends": ["cpu_parallel"], "steps": 4, "repetitions": 1,
                 "scenes": [{"scene": str(self.folder / "tissue.json")}, {"scene": "box@4"}]}
        table, result = self.run_study(study)
        self.assertEqual(result["context"]["voxspring"]["units"], {"tissue.json": {"length": "mm", "time": "s", "force": "mN"}})
        self.assertIn("tissue.json: lengths in mm, times of the motion in s, forces in mN\n", table)
        self.assertEqual(table.count("lengths in"), 1)

    def test_edits_are_made_verified_and_timed(self):
        plane = {"point": [2.5, 0, 0], "normal": [1, 0, 0]}
        scene = {"dataset": {"type": "box", "dims": [6, 6, 6]}, "gravity": [0, 0, -0.01],
                 "edits": [{"step": 3, "cut": {"plane": plane}},
                           {"step": 8, "suture": {"plane": plane, "within": 1.5}},
                           {"step": 9, "suture": {"pairs": [[[0, 0, 0], [5, 5, 5]]]}}]}
        self.write("cut.json", scene)
        study = {"backends": ["cpu_*", "gl_*"], "steps": 9, "repetitions": 2,
                 "scenes": [{"scene": "cut.json"}, {"scene": "cut.json", "steps": 10}]}
        table, result = self.run_study(study)
        # The third edit leaves the lattice. It is refused whether or not a run is long enough to reach it.
        self.assertIn("cpu_parallel", {row["backend"] for row in result["skipped"]})
        self.assertIn("edit after step 9", str(result["skipped"]))
        edits = {row["steps"]: row["edits"] for row in result["benchmarks"]}
        self.assertEqual(edits, {9: 2, 10: 3})
        for row in result["benchmarks"]:
            self.assertIsNone(row["total_error_relative_l2"])
            self.assertIn("springs change", row["total_error_reason"])
            self.assertGreater(row["seconds_per_step_without_edits"], 0)
            self.assertGreaterEqual(row["edit_seconds_max"], row["edit_seconds_median"])
        self.assertIn("slow-down", table)
        self.assertEqual(json_of("info", self.folder / "cut.json", "--json")["edits"], 3)
        run = voxspring("run", self.folder / "cut.json", "--backend", "cpu_parallel", "--steps", 20)
        self.assertEqual(run.returncode, 1)
        self.assertIn("needs neighbour lists", run.stderr)

    def test_stability_is_measured(self):
        table, result = self.run_study({"kind": "stability", "backends": ["cpu_parallel:formulation=*"],
                                        "scenes": [{"scene": "box@4", "map": True}]})
        self.assertEqual(len(result["stability"]), 5 * 7)
        self.assertEqual(len(result["stability_map"]), 1)
        self.assertIn("bounded", table)

    def test_the_fastest_is_held_against_the_papers_and_targets(self):
        target = {"scene": "box@8", "formulation": "increment"}
        table, result = self.run_study({
            "kind": "fastest", "backends": ["cpu_*", "gl_*"], "steps": 5, "repetitions": 2,
            "scenes": [{"scene": "box@8", "backends": ["cpu_*", "gl_*", "auto"]},
                       {"scene": "heart@20x17x15", "rewind": False, "start_times": False}],
            "targets": [target | {"seconds_per_step": 100}, target | {"backends": "cpu_*", "fraction_of_limit": 1e9},
                        target | {"backends": "opencl_*", "ready_seconds": 1}]})
        blocks = {(block["scene"], block["formulation"], block["precision"]): block for block in result["fastest"]}
        medians = [row for row in result["benchmarks"] if row.get("aggregate_name") == "median"]
        self.assertEqual(set(blocks), {(row["scene"], row["formulation"], row["precision"]) for row in medians})
        for (scene, _, _), block in blocks.items():
            self.assertEqual("ready_seconds" in block, scene == "box@8")
        for row in medians:
            self.assertEqual("ready_seconds" in row, row["scene"] == "box@8")
        self.assertEqual([target["met"] for target in blocks["box@8", "increment", "float32"]["targets"]],
                         [True, False, None])
        self.assertEqual([choice["scene"] for choice in result["auto"]], ["box@8"])
        for word in ("x paper's", "auto takes", "met: ", "missed: ", "not measured"):
            self.assertIn(word, table)

    def test_stress_is_measured_and_gated(self):
        table, result = self.run_study({"kind": "stress", "backends": ["cpu_*"],
                                        "suites": [{"lengths": "shortest", "backends": ["cpu_parallel"]}]})
        self.assertEqual({row["part"] for row in result["stress"]}, set(range(1, 10)))
        self.assertTrue(all(row["passed"] for row in result["stress"]))
        self.assertEqual(result["failed"], [])
        self.assertIn("damped heart", table)

    def test_google_benchmarks_own_tool_reads_it(self):
        self.run_smoke("--backend", "cpu_reference", "--backend", "cpu_parallel:precision=float64")
        out = str(self.folder / "smoke.json")
        result = run(sys.executable, COMPARE, "filters", out, "/cpu_reference/", "/cpu_parallel/")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("box@8[/cpu_reference/ vs. /cpu_parallel/]increment/float64", result.stdout)
        self.assertIn("OVERALL_GEOMEAN", result.stdout)

    def test_refuses_before_anything_runs(self):
        out = self.folder / "result.json"
        for options, words in ((["no_such_study"], ["no_such_study", "default"]), (["smoke", "--backend", "opencl*"], ["opencl*"]),
                               (["smoke", "--scene", "nowhere"], ["nowhere"]),
                               *((["scaling", f"--devices={devices}"], ["--devices", "a whole number from"])
                                 for devices in ("0", "two", "0,", "0,-1", "0,1024"))):
            self.assert_refused(voxspring("study", *options, "--out", out), *words)
        self.assert_refused(voxspring("study", "smoke", "--out", self.folder / "result.xml"), "result.xml", ".json")
        self.assert_refused(voxspring("study", "smoke", "--out", "/proc/smoke.json"), "/proc/smoke.json")
        self.assertEqual(list(self.folder.iterdir()), [])
        out.write_text("{}")
        self.assert_refused(voxspring("study", "smoke", "--scene", "nowhere", "--out", out), "nowhere")
        self.assertEqual(out.read_text(), "{}", "a finished result is not lost to a refusal")

    def test_skips_what_this_machine_has_no_memory_for(self):
        table, result = self.run_study({"backends": ["cpu_parallel"], "steps": 2, "repetitions": 1,
                                        "scenes": [{"scene": "box@4"}, {"scene": "box@100000x1000x1000"}]})
        self.assertEqual({row["scene"] for row in result["benchmarks"]}, {"box@4"})
        self.assertEqual({row["scene"] for row in result["skipped"]}, {"box@100000x1000x1000"})
        self.assertIn("on this machine", table)
        self.assert_refused(voxspring("study", self.folder / "study.json", "--scene", "box@100000x1000x1000"), "on this machine")


class Haptic(OwnStudy):
    SCENE = {"dataset": {"type": "box", "dims": [4, 4, 4]}, "pinned": {"side": "x-"},
             "tool": {"side": "x+", "stiffness": 0.5, "motion": "hand.csv"}}
    STUDY = {"kind": "haptic", "rates": [500], "motion_seconds": 0.1, "steps": 20, "backends": ["cpu_parallel"],
             "scenes": [{"scene": "held.json"}]}

    def setUp(self):
        super().setUp()
        (self.folder / "hand.csv").write_text("time,x,y,z\n0,0,0,0\n1,0.2,0,0\n")
        self.write("held.json", self.SCENE)

    @staticmethod
    def compare(*results):
        return json.loads(run(sys.executable, "results/diff.py", *results, "--json", "--all", check=True).stdout)

    def test_result_follows_its_schema_and_is_compared(self):
        table, result = self.run_study(self.STUDY)
        self.assertIn("SCHED_FIFO", table)
        undrawn, drawn = ([row for row in result["haptic"] if row["drawn"] == drawn] for drawn in (False, True))
        self.assertEqual([row["edited"] for row in undrawn], [False, True])
        # If there are no drawn rows the result says why.
        if drawn:
            self.assertEqual([row["edited"] for row in drawn], [False, True])
            self.assertGreater(drawn[0]["picture_seconds"], 0)
            self.assertGreater(drawn[0]["hand_over_seconds"], 0)
            self.assertIn("A picture takes", table)
        else:
            self.assertIn("while it is drawn: ", result["skipped"][0]["reason"])
        row = result["haptic"][0]
        for change in ({"hertz": 0}, {"ticks": 0}, {"missed": -1}, {"real_time": None}, {"histogram": []},
                       {"histogram": [[1e-6, 0]]}, {"histogram": [[0, 1]]}, {"displacements_by": "hand"}):
            self.assertFalse(SCHEMA.is_valid(result | {"haptic": [row | change]}), change)
        SCHEMA.validate(result | {"haptic": [row | {"histogram": [[1e-6, 1]]}]})
        without = {key: value for key, value in row.items() if key != "histogram"}
        self.assertFalse(SCHEMA.is_valid(result | {"haptic": [without]}))
        before = {key: without[key] for key in without if key not in ("drawn", "pictures_per_second", "displacements_by",
                                                                      "renderer")}
        SCHEMA.validate(result | {"haptic": [before]})
        out = self.folder / "result.json"
        self.assertEqual([row["place"] for row in self.compare(out, out)["rows"] if "measured" not in row["place"]],
                         [{"hertz": 500.0, "edited": row["edited"], "drawn": row["drawn"]} for row in undrawn + drawn])
        # Rows from before drawing existed equal today's undrawn rows.
        old = self.write("old.json", result | {"haptic": [before]})
        self.assertEqual(self.compare(old, out)["counts"]["new"], len(result["haptic"]) - 1)

    def test_a_scene_may_have_rates_and_times_of_its_own(self):
        item = {"scene": "held.json", "rates": [100, 200], "motion_seconds": 0.2, "longest_seconds": 0.3}
        _, result = self.run_study(self.STUDY | {"scenes": [item]})
        # Ticks that a busy machine missed do not count as ticks.
        ticks = {(row["hertz"], row["edited"]): row["ticks"] + row["missed"] for row in result["haptic"] if not row["drawn"]}
        self.assertEqual(ticks, {(100, False): 20, (100, True): 20, (200, False): 60, (200, True): 40})
        study = self.write("study.json", self.STUDY | {"scenes": [item | {"longest_seconds": 0}]})
        self.assert_refused(voxspring("study", study), "longest_seconds", "0", "from 0.1 to 3600")

    def test_without_opengl_nothing_is_drawn_and_the_result_says_why(self):
        table, result = self.run_study(self.STUDY, env=NO_OPENGL)
        self.assertEqual([(row["edited"], row["drawn"]) for row in result["haptic"]], [(False, False), (True, False)])
        self.assertEqual(result["failed"], [])
        for said in (result["skipped"][0]["reason"], table):
            self.assertIn("while it is drawn: no OpenGL", said)

    def test_what_cannot_be_played_is_refused(self):
        self.assert_refused(voxspring("study", "haptic", "--scene", "box@4"), "tool of scene box@4 is missing")
        study = self.write("study.json", self.STUDY)
        (self.folder / "hand.csv").write_text("time,x,y,z\n0,0,0,0\n1,nan,0,0\n")
        self.assert_refused(voxspring("study", study), "hand.csv", "line 3, x: nan")


class Pareto(InTemporaryFolder):
    SCENES = ("box@6", "beam@3x3x7")

    @classmethod
    def setUpClass(cls):
        cls.out = new_folder(cls.addClassCleanup) / "pareto.json"
        scenes = [argument for scene in cls.SCENES for argument in ("--scene", scene)]
        cls.ran = voxspring("study", "pareto", *scenes, "--backend", "cpu_parallel:formulation=*,precision=*",
                            "--repetitions", 1, "--out", cls.out)
        cls.result = json.loads(cls.out.read_text())

    def test_result_follows_its_schema(self):
        self.assertEqual(self.ran.returncode, 0, self.ran.stdout + self.ran.stderr)
        SCHEMA.validate(self.result)
        row = self.result["pareto"][0]
        for change in ({"seconds": None}, {"diverged": True}, {"device": ""}, {"on_front": None}):
            self.assertFalse(SCHEMA.is_valid(self.result | {"pareto": [row | change]}), change)
        backend = next(b for b in json_of("list", "--json")["backends"]
                       if b["name"] == "cpu_parallel")
        with open("harness/studies/pareto.json") as file:
            time_steps = json.load(file)["time_steps"]
        contenders = len(backend["formulations"]) * len(backend["precisions"])
        self.assertEqual(len(self.result["pareto"]), len(self.SCENES) * len(time_steps) * contenders)

    def test_total_error_of_float64_is_of_second_order_and_that_of_float32_turns_up(self):
        for scene in self.SCENES:
            errors = {(row["formulation"], row["precision"], row["steps"]): row["total_error_relative_l2"]
                      for row in self.result["pareto"] if row["scene"] == scene}
            for steps in (200, 400, 800, 1600):
                ratio = errors["increment", "float64", steps] / errors["increment", "float64", 2 * steps]
                self.assertAlmostEqual(ratio, 4, delta=0.2, msg=f"{scene} {steps}")
            self.assertGreater(errors["paper", "float32", 3200], errors["paper", "float32", 100])

    def test_front_is_what_nothing_beats(self):
        for scene in self.SCENES:
            rows = [row for row in self.result["pareto"] if row["scene"] == scene]
            for row in rows:
                faster = [other["total_error_relative_l2"] for other in rows if other["seconds"] < row["seconds"]]
                # A point is on the front if it is at least 1% better than all faster rows.
                if row["on_front"]:
                    self.assertLess(row["total_error_relative_l2"], 0.99 * min(faster, default=math.inf), row["name"])
                else:
                    self.assertGreaterEqual(row["total_error_relative_l2"], 0.99 * min(faster), row["name"])
            self.assertIn(f"{scene} on {rows[0]['device']}, to time", self.ran.stdout)

    def test_advises_the_fastest_that_reaches_the_error(self):
        least = min(row["total_error_relative_l2"] for row in self.result["pareto"] if row["scene"] == "box@6")
        for error in (1e-2, 2 * least):
            ran = succeeds("advise", "box@6", "--error", error, "--results", self.out)
            best = min((row for row in self.result["pareto"]
                        if row["scene"] == "box@6" and row["total_error_relative_l2"] <= error),
                       key=lambda row: row["seconds"])
            said = ran.stdout.splitlines()
            self.assertEqual(said[0], f"box@6: an error of {error:g} is reached soonest by")
            self.assertIn(f"  {best['backend']}", said[1])
            self.assertIn(f"{best['formulation']} in {best['precision']}, on ", said[1])
            self.assertIn(f"for {best['steps']} steps of ", said[2])
            self.assertIn("runners-up", said)
            self.assertNotIn("root=exact", ran.stdout, "what is at its default")
            advice = json_of("advise", "box@6", "--error", error, "--results", self.out, "--json")
            self.assertEqual(said[-1], "  " + advice["best"]["command"])
            for key in ("backend", "formulation", "precision", "time_step", "steps", "seconds", "total_error_relative_l2"):
                self.assertEqual(advice["best"][key], best[key], key)
            self.assertEqual(advice["most_accurate"]["total_error_relative_l2"], least)
            self.assertFalse(advice["unfinished"])

    def test_the_command_that_it_ends_with_makes_the_same_body(self):
        same = ["--labels", "left lung,5", "--frame", "2", "--parts", "largest", "--pitch", "1.5", "--fill", "0.25", "--unit", "mm",
                "--spacing", "1,2,3", "--gravity", "0,0,-1", "--young", "5000", "--density", "1000", "--damping", "0.5", "--corners"]
        advice = json_of("advise", "box@6", "--error", 1, "--results", self.out, "--json", *same)
        said = shlex.split(advice["best"]["command"])
        self.assertEqual(said[:3], ["voxspring", "run", "box@6"])
        self.assertEqual(sorted(said[3:said.index("--backend")]), sorted(same))
        parts = json_of("advise", "box@6", "--error", 1, "--results", self.out, "--json", "--parts", 30)
        self.assertIn(" --parts 30 ", parts["best"]["command"])

    def test_the_command_that_it_ends_with_takes_the_same_device(self):
        if not json_of("list", "--json").get("vulkan_devices"):
            self.skipTest("no Vulkan")
        row = next(row for row in self.result["pareto"] if row["scene"] == "box@6" and row["precision"] == "float32")
        on_card = row | {"backend": "vulkan_implicit", "tuning": "", "device": "a card", "seconds": 0.5 * row["seconds"]}
        result = self.write("two.json", self.result | {"pareto": [row, on_card]})
        advice = json_of("advise", "box@6", "--error", 1, "--results", result, "--json", "--vulkan-device", 0)
        self.assertIn(" --backend vulkan_implicit:", advice["best"]["command"])
        self.assertIn(" --vulkan-device 0 ", advice["best"]["command"])
        self.assertNotIn("--vulkan-device", advice["runners_up"][0]["command"])

    def displacement_after(self, *arguments):
        out = self.folder / "displacement.npz"
        succeeds(*arguments, "--out", out)
        with zipfile.ZipFile(out) as arrays:
            data = arrays.read("displacement.npy")
        return array.array("d", data[10 + int.from_bytes(data[8:10], "little"):])

    def test_the_command_that_it_ends_with_reaches_the_error(self):
        for scene in self.SCENES:
            advice = json_of("advise", scene, "--error", 1e-3, "--results", self.out, "--json")
            # float64 up to the third order, whose error is a sixteenth of that of the finest time step tried.
            best = advice["best"]
            fine = 64
            exact = self.displacement_after("run", scene, "--backend", "cpu_reference", "--time-step", best["time_step"] / fine,
                                            "--steps", best["steps"] * fine)
            for candidate in (best, advice["most_accurate"], *advice["runners_up"]):
                program, *words = shlex.split(candidate["command"])
                self.assertEqual((program, words[-2:]), ("voxspring", ["--out", "state.npz"]))
                reached = self.displacement_after(*words[:-2])
                error = math.sqrt(sum((a - b)**2 for a, b in zip(reached, exact)) / sum(b * b for b in exact))
                claimed = candidate["total_error_relative_l2"]
                # The fine run is off by 1 / 64^2 of the best one's error.
                self.assertAlmostEqual(error, claimed, delta=0.02 * claimed + best["total_error_relative_l2"] / 1000)

    def test_time_steps_leave_the_motion_what_it_is(self):
        # At the same time the end differs by the error of the time step, which is a quarter at half the step.
        time_step = json_of("info", "heart@15x13x12", "--json")["time_step"]
        ends = [self.displacement_after("run", "heart@15x13x12", "--backend", "cpu_reference", "--steps", 50 * finer,
                                        *(["--time-step", time_step / finer] if finer > 1 else [])) for finer in (1, 2, 4, 8)]
        apart = [math.dist(a, b) for a, b in zip(ends, ends[1:])]
        for coarse, fine in zip(apart, apart[1:]):
            self.assertAlmostEqual(coarse / fine, 4, delta=0.4)
        ran = voxspring("run", "heart@15x13x12", "--backend", "cpu_reference", "--time-step", time_step / 2, "--time", 10 * time_step)
        self.assertIn("damping 0.000575165 per step instead of 0.00115", ran.stdout)
        self.assertIn("heart@15x13x12: 20 steps", ran.stdout)
        for scene, why in (("scalpel_10", "edits"), ("grasp", "tool")):
            self.assert_refused(voxspring("run", scene, "--backend", "cpu_reference", "--time-step", 0.01), "--time-step", scene, why)

    def test_advises_on_ranks(self):
        out = self.folder / "scaling.json"
        ran = succeeds("study", "scaling", "--scene", "box@8", "--ranks", 2, "--backend", "cpu_reference", "--out", out)
        rows = json.loads(out.read_text())["scaling"]
        best = min(rows, key=lambda row: row["seconds_per_step"])
        for ran in (voxspring("advise", "box@8", "--ranks", 2, "--results", out),
                    voxspring("advise", "box@8", "--ranks", 2, "--backend", "cpu_reference")):
            self.assertEqual(ran.returncode, 0, ran.stderr)
            self.assertIn("box@8 cpu_reference increment float64: several ranks ", ran.stdout)
            self.assertIn("best: cpu_reference increment float64 by ", ran.stdout)
        said = voxspring("advise", "box@8", "--ranks", 2, "--results", out).stdout
        self.assertIn(f"by {best['ranks']} rank", said.splitlines()[-1])
        result = json.loads(out.read_text())
        for row in result["scaling"]:
            row["seconds_per_step"] = 1 / row["ranks"]
        measured = self.write("measured.json", result)
        for ranks in (1, 2):
            advice = json_of("advise", "box@8", "--ranks", ranks, "--results", measured, "--json")
            self.assertEqual(advice["best"]["ranks"], ranks)
        self.assert_refused(voxspring("advise", "box@6", "--ranks", 2, "--results", out), "box@6", "box@8")
        self.assert_refused(voxspring("advise", "box@6", "--ranks", 2, "--results", self.out), "scaling")
        self.assert_refused(voxspring("advise", "box@6", "--ranks", 2, "--error", 1), "--error", "--devices")
        self.assert_refused(voxspring("advise", "box@6", "--ranks", 2, "--continuum"), "--continuum", "--ranks")

    def test_advice_that_cannot_be_given(self):
        ran = voxspring("advise", "box@6", "--error", 1e-30, "--results", self.out)
        self.assertEqual(ran.returncode, 1)
        self.assertIn("nothing reaches an error of 1e-30; the most accurate is\n", ran.stdout)
        self.assertIn("\nto run it\n  voxspring run box@6 --backend ", ran.stdout)
        none, other = self.folder / "none.json", self.write("other.json", {"benchmarks": []})
        for options, words in ((["heart", "--error", 1, "--results", self.out], ["heart", *self.SCENES]),
                               (["box@6", "--error", 1, "--results", none], ["none.json"]),
                               (["box@6", "--error", 1, "--results", other], ["other.json", "pareto"]),
                               (["nowhere", "--error", 1], ["nowhere"]),
                               (["box@6", "--error", 1, "--backend", "opencl*"], ["opencl*"]),
                               (["box@6"], ["--error is missing", "--ranks"])):
            self.assert_refused(voxspring("advise", *options), *words)

    def test_measures_where_no_result_is_given(self):
        ran = succeeds("advise", "box@4", "--error", 1e-3, "--backend", "cpu_parallel", "--repetitions", 1)
        self.assertIn("is reached soonest by\n  cpu_parallel", ran.stdout)

    def test_measures_a_volume_with_the_options_that_run_has(self):
        out = self.folder / "advice.json"
        volume = self.write("two labels.nrrd", nrrd("4 4 4", [1, 2, 3, 2] * 16))
        options = ["--labels", "2,3", "--spacing", "0.5", "--gravity", "0,0,-0.001"]
        ran = succeeds("advise", volume, "--error", 1e-2, "--backend", "cpu_parallel", "--repetitions", 1, "--out", out, *options)
        self.assertEqual(json.loads(out.read_text())["pareto"][0]["particles"], 48)
        words = shlex.split(ran.stdout.splitlines()[-1])
        self.assertEqual(words[:9], ["voxspring", "run", str(volume), "--labels", "2,3", "--spacing", "0.5,0.5,0.5", "--gravity",
                                     "0,0,-0.001"])
        again = succeeds(*words[1:-2])
        self.assertIn("of 48 particles", again.stdout)

    def test_advises_on_a_scene_file_in_another_folder(self):
        body = self.folder / "bodies/body.json"
        body.parent.mkdir()
        for row, kind, options in ((self.result["pareto"][0], "pareto", ["--error", 1]),
                                   ({"name": "body.json/cpu_reference/increment/float64", "particles": 8, "steps": 1, "ranks": 1,
                                     "cut": "1x1x1", "way": "none", "seconds_per_step": 0.5}, "scaling", ["--ranks", 2])):
            result = self.write(f"{kind}.json", {"context": {"voxspring": {"study": {"kind": kind}}},
                                                 kind: [row | {"scene": "body.json"}]})
            said = succeeds("advise", body, *options, "--results", result).stdout
            if kind == "pareto":
                self.assertIn(f"\n  voxspring run {body} --backend ", said)

    def test_refuses_scenes_without_such_a_study(self):
        self.assert_refused(voxspring("study", "pareto", "--scene", "scalpel_1", "--backend", "cpu_parallel"),
                            "scalpel_1", "edits")
        loose = self.write("loose.json", {"dataset": {"type": "box", "dims": [1, 1, 1]}, "time_step": 0.1})
        self.assert_refused(voxspring("study", "pareto", "--scene", loose, "--backend", "cpu_parallel"), "loose")


if __name__ == "__main__":
    unittest.main()
