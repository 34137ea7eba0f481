"""The page that results/report.py makes, as its readers meet it: in a browser, on a phone and on a desk, light and dark.

The current directory is the source tree. Needs chromium and its driver, and the packages of results/requirements.txt in
build/report-venv, which `./run test` installs; where either is missing all of this is skipped: exit code 77.
"""

import collections
import copy
import functools
import html
import itertools
import json
import math
import os
import pathlib
import random
import re
import resource
import shutil
import statistics
import sys
import time
import unittest
import unittest.mock

ROOT = pathlib.Path.cwd()
PYTHON = ROOT / "build/report-venv/bin/python"
REPORT = ROOT / "results/report.py"
H200 = ROOT / "results/nvidia-h200"
# Packages of the page's environment go before Debian's older ones.
sys.path[1:1] = map(str, (ROOT / "build/report-venv/lib").glob("python3*/site-packages"))
sys.path.insert(0, str(ROOT / "results"))
import numpy  # noqa: E402
import result_files  # noqa: E402
from folder import InTemporaryFolder, called, new_folder, run  # noqa: E402
from results_test import with_work  # noqa: E402
SKIPPED = 77
# Kinds of figures for which the committed results have data.
FIGURES = ["datasets", "figure7", "figure8", "front", "curves", "roofline", "intensity", "map", "stability", "edits", "overhead", "energy",
           "scaling", "forecast", "latency", "stress"]
WIDTHS = (390, 1440)
SCHEMES = ("light", "dark")


def missing():
    """Why these tests cannot run here, or nothing."""
    for program in ("chromium", "chromedriver"):
        if not shutil.which(program):
            return f"there is no {program}"
    try:
        import selenium  # noqa: F401
    except ImportError:
        return "there is no python3-selenium"
    return "" if PYTHON.exists() else f"there is no {PYTHON}: run ./run report"


def start_report(*arguments, python=(PYTHON,), largest_file=resource.RLIM_INFINITY):
    """Starts report.py as `./run report` does."""
    return run(*python, "-W", "error", REPORT, *arguments,
               preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file)))


def report(*arguments):
    """Runs report.py in this process, which saves the three seconds that loading its packages takes."""
    import report as script
    return called(lambda: script.main(list(map(str, arguments))))


def figures_of(path):
    """The figures of a page by name, with rows as dictionaries."""
    data = re.search(r'id="report">(.*?)</script>', path.read_text(), re.DOTALL)[1]
    found = json.loads(data.replace("<\\/", "</"))["figures"]
    return {figure["name"]: figure | {"rows": [dict(zip(figure["keys"], row)) for row in figure["rows"]]} for figure in found}


def finding(path, name):
    """(headline, the rest of what was found) of a figure of a page; None without it."""
    found = re.search(rf'<section data-figure="{name}"><h2>(.*?)</h2>(?:<p class="finding">(.*?)</p>)?', path.read_text())
    return found and tuple(html.unescape(text or "").replace("\N{NO-BREAK SPACE}", " ") for text in found.groups())


def h200(study):
    return result_files.load(result_files.named(H200, study))


def made_up(**lists):
    """A result of these lists, with the context of a committed one."""
    return {key: value for key, value in h200("table1").items() if key in ("context", "skipped")} | lists


def medians(study):
    rows = h200(study)["benchmarks"]
    return [row for row in rows if row.get("aggregate_name") == "median"]


# A picture without a body, which says what it is told to say.
DRAW = '''
import io, json, sys
import PIL.Image, PIL.PngImagePlugin

def png(about):
    text, file = PIL.PngImagePlugin.PngInfo(), io.BytesIO()
    text.add_text("voxspring", json.dumps(about))
    PIL.Image.linear_gradient("L").resize((56, 42)).save(file, "PNG", pnginfo=text)
    return file.getvalue()
'''
# Replaces voxspring: draws, and adds its arguments to a list beside it.
PROGRAM = f"#!{sys.executable}\n{DRAW}\n" + '''
with open(sys.argv[0] + ".calls", "a") as calls:
    calls.write(json.dumps(sys.argv[1:]) + "\\n")
options = dict(zip(sys.argv[3::2], sys.argv[4::2]))
scene, error = sys.argv[2], options["--colour"] == "error"
if scene.startswith("scalpel"):
    sys.exit("voxspring: no blade")
rules = dict(word.split("=") for word in options["--backend"].split(":")[1].split(","))
with open(options["--out"], "wb") as file:
    particles = json.load(open(sys.argv[0] + ".particles"))[scene]
    file.write(png({"scene": scene, "particles": particles, "steps": int(options["--steps"]), "renderer": "a test",
                    "backend": f"cpu_parallel/{rules['formulation']}/{rules['precision']}",
                    "coloured_by": options["--colour"], "largest": 3.4e-05 if error else 6.742}))
'''
exec(DRAW)  # png(), for this file as well
ABOUT = {"scene": "box@32", "particles": 32768, "steps": 900, "coloured_by": "error", "largest": 0,
         "backend": "cpu_parallel/position/float32", "renderer": "a test"}


@functools.cache
def particles():
    """Counts for each dataset of the committed results, as the program would make them, and for one more."""
    counts = {"mine@8x8x9": 8}
    for path in result_files.committed(H200.parent):
        result = result_files.load(path)
        counts |= {row["scene"]: row["particles"] for key in ("benchmarks", "pareto") for row in result.get(key, [])
                   if "particles" in row}
    return counts


def write_program(folder):
    path = folder / "voxspring"
    (folder / "voxspring.particles").write_text(json.dumps(particles()))
    path.write_text(PROGRAM)
    path.chmod(0o755)
    return path


class Reports(InTemporaryFolder):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "report.html"

    def make(self, *arguments):
        """Makes the page; its figures."""
        made = report(*arguments, "--out", self.out)
        self.assertEqual((made.returncode, made.stdout), (0, f"{self.out}\n"), made.stderr)
        return figures_of(self.out)

    def page_of(self, result):
        """Makes the page of a result; its figures."""
        return self.make(self.write("a.json", result))


class Input(Reports):
    """Input that cannot be used is refused by name, and the existing page stays."""

    def test_broken_files(self):
        good, region = h200("figure7"), h200("stability")
        region["stability_map"][0]["region"][1][2] = "melted"
        def changed(change):
            result = copy.deepcopy(good)
            change(result)
            return result
        self.out.write_text("the old page")
        for content, *words in (
                (json.dumps(good)[:1000],), ([1], "[1]", "result of a study"), ({"benchmarks": []}, "context", "is missing"),
                (changed(lambda r: r["context"]["voxspring"].update(commit=7)), "context.voxspring.commit", "7", "expected text"),
                (changed(lambda r: r["benchmarks"][3].update(real_time="fast")), "benchmarks[3].real_time", '"fast"', "expected a number"),
                (changed(lambda r: r["benchmarks"][2].pop("scene")), "benchmarks[2].scene", "is missing"),
                (changed(lambda r: r["verification"][0].update(repetitions_judged="x")), "verification[0].repetitions_judged", "x"),
                (changed(lambda r: r.update(benchmarks={})), "benchmarks", "{}", "expected a list"),
                (region, "region", "melted", "bounded")):
            with self.subTest(words):
                self.assert_refused(report(self.write("broken.json", content), "--out", self.out), "broken.json", *words)
        empty, drawn = self.folder / "empty", (H200 / "table1.json.gz", "--pictures")
        empty.mkdir()
        for arguments, *words in (([self.folder / "none.json"], "none.json", "No such file"), ([empty], empty, "no .json"),
                                  ([*drawn, self.folder, "--program", self.folder / "none"], "--program", "none", "No such file"),
                                  ([*drawn, self.write("file", ""), "--program", "none"], "--pictures", "File exists")):
            self.assert_refused(report(*arguments, "--out", self.out), *words)
        self.assertEqual(self.out.read_text(), "the old page")
        self.assertEqual(list(self.folder.glob(".*")), [], "something half-written")

    def test_where_nothing_can_be_written(self):
        results = H200 / "table1.json.gz"
        self.assert_refused(report(results, "--out", self.folder / "no/report.html"), "--out", "No such file")
        folder = self.folder / "folder.html"
        folder.mkdir()
        self.assert_refused(report(results, "--out", folder), "--out", "Is a directory")
        # As on a disk that is full: after 100 kB no file can grow.
        self.out.write_text("the old page")
        self.assert_refused(start_report(results, "--out", self.out, largest_file=100_000), "--out", "File too large")
        self.assertEqual(self.out.read_text(), "the old page")
        self.assertEqual(list(self.folder.glob(".*")), [], "something half-written")

    def test_a_missing_package_is_named(self):
        # -S leaves out the folders in which packages are installed.
        result = start_report(H200 / "table1.json.gz", "--out", self.out, python=(PYTHON, "-S"))
        self.assert_refused(result, "is missing", "./run report")
        self.assertFalse(self.out.exists())

    def test_the_same_results_give_the_same_page(self):
        pages = []
        for make in (report, start_report):  # in the second, sets have another order
            made = make(H200 / "table1.json.gz", "--out", self.out)
            self.assertEqual((made.returncode, made.stdout), (0, f"{self.out}\n"), made.stderr)
            pages.append(self.out.read_bytes())
        self.assertEqual(*pages)

    def test_the_roofline_by_operations_a_byte_needs_what_steps_move(self):
        result = with_work(h200("fastest"))
        figure = self.page_of(result)["intensity"]
        self.assertEqual([panel["match"]["scene"] for panel in figure["panels"]], ["box@32", "box@256"])
        text = json.dumps(figure["panels"])
        for roof in ("CUDA: memory (dashed: half written)", "CUDA: cache", "CUDA: float32 arithmetic", "CPU: cache"):
            self.assertIn(roof, text)
        self.assertNotIn("OpenGL: cache", text, "the same card")
        self.assertNotIn("on chip", text, "every step moves something")
        self.assertGreater(len(figure["rows"]), 20)
        for row in figure["rows"]:
            self.assertAlmostEqual(row["operations_per_byte"], 300 / 48, places=3)
            self.assertEqual(row["place"], row["operations_per_byte"])
        for row in result["benchmarks"]:
            row["step_bytes"] = None
        self.assertNotIn("intensity", self.page_of(result))

    def test_strategies_on_chip_stand_beside_the_roofs(self):
        committed = h200("fastest")
        still = {row["backend"] for row in committed["benchmarks"] if row["scene"] == "box@32" and row["step_bytes"] == 0}
        self.assertEqual(still, {"cuda_resident", "cuda_bricks"})
        for keep in ({row["backend"] for row in committed["benchmarks"]}, still):
            result = committed | {"benchmarks": [row for row in committed["benchmarks"] if row["backend"] in keep]}
            figure = self.page_of(result)["intensity"]
            of_small = [row for row in figure["rows"] if row["scene"] == "box@32"]
            self.assertEqual({row["backend"] for row in of_small if row["operations_per_byte"] is None}, still)
            places = {row["place"] for row in of_small if row["operations_per_byte"] is None}
            self.assertEqual(len(places), 1)
            self.assertGreater(min(places), max((row["place"] for row in of_small if row["operations_per_byte"]), default=0))
            self.assertEqual(json.dumps(figure["panels"][0]).count('"on chip"'), 1)

    def scaling(self, *rows):
        """The figures of a page of a scaling study, of rows (ranks, fields)."""
        common = {"backend": "cpu_parallel", "formulation": "position", "precision": "float32", "tuning": "", "scaling": "strong",
                  "particles": 64**3,
                  "compute_seconds": 1e-3, "exchange_seconds": 1e-5, "waiting_seconds": 0.0, "efficiency": 1.0, "predicted_seconds": 1.0}
        found = [{"scene": "box@64", **common, "ranks": ranks, **more} for ranks, more in rows]
        for row in found:
            row |= {"family": row["scene"], "name": f"{row['scene']}/cpu_parallel/position/float32"}
        return self.page_of(made_up(scaling=found))

    def test_a_scaling_study_has_its_figure(self):
        rows = [("box@16", 1, "none", 1.0, "1x1x1"), ("box@16", 2, "memory", 0.9, "1x1x1"), ("box@16", 2, "mpi", 0.625, "1x1x1"),
                ("heart", 1, "none", 1.0, "1x1x1"), ("heart", 4, "mpi", None, "1x1x1"), ("heart", 2, "memory", 0.7, "1x1x2"),
                ("heart", 4, "memory", 0.8, "1x1x4"), ("heart", 4, "memory", 0.75, "1x2x2")]
        figure = self.scaling(*((ranks, {"scene": scene, "way": way, "cut": cut, "efficiency": efficiency,
                                         "predicted_seconds": 1e-5 / ranks,
                                         "seconds_per_step": 1e-5 / ranks / (efficiency or 1)})
                                for scene, ranks, way, efficiency, cut in rows))["scaling"]
        self.assertEqual([panel["match"]["compared"] for panel in figure["panels"]], ["box@16", "heart"])
        self.assertEqual([row["predicted"] for row in figure["rows"]], 7 * [1])
        self.assertEqual([(row["cut"], row["parts"]) for row in figure["rows"] if row["ranks"] == 4],
                         [("1x1x4", "slabs"), ("1x2x2", "bricks")])
        self.assertEqual(finding(self.out, "scaling")[0], "4 ranks have 75 % to 80 % of the efficiency of one")

    def forecast(self, ranks, seconds, **more):
        """What the page predicts from a rank that takes a microsecond per particle, and from several that take as long as predicted."""
        rows = self.scaling((1, {"seconds_per_step": 64**3 * 1e-6, "way": "none"}),
                            (ranks, {"seconds_per_step": seconds, "predicted_seconds": seconds, "seconds_per_byte": 1e-9,
                                     "way": "memory", **more}))
        return rows["forecast"]["rows"]

    def test_more_ranks_than_were_measured_are_a_prediction(self):
        # A layer of 64^2, a latency of 1 ms, a border of 64 KiB at 1 GB/s.
        slabs = {"ghosts": 2 * 64**2, "border_bytes": 65536, "latency_seconds": 1e-3}
        rows = self.forecast(2, 1e-6 * (64**3 / 2 + 64**2) + 1e-3 + 65536e-9, **slabs)
        # 1024 ranks would have less than a layer each.
        self.assertEqual([row["ranks"] for row in rows], [8, 64])
        beside = 1e-6 * 2 * 64**2 + 1e-3 + 2 * 65536e-9
        for row in rows:
            own = 64**3 / row["ranks"] * 1e-6
            self.assertAlmostEqual(row["microseconds"], 1e6 * (own + beside), delta=1)
            self.assertAlmostEqual(row["efficiency"], own / (own + beside), places=3)
            # There a rank computes its particles for as long as it does everything else.
            self.assertAlmostEqual(row["half"], 64**3 * 1e-6 / beside, delta=0.1)
        for words in ("Prediction: box@64", "not a measurement"):
            self.assertIn(words, self.out.read_text())

        # If borders travel meanwhile only the longer part counts: for 64 ranks the exchange.
        rows = self.forecast(2, 1e-6 * (64**3 / 2 + 64**2), **slabs | {"way": "stores_overlap", "latency_seconds": 20e-3})
        exchange = 20e-3 + 2 * 65536e-9
        self.assertEqual([row["ranks"] for row in rows], [8, 64])
        for row, microseconds in zip(rows, (64**3 / 8 + 2 * 64**2, 1e6 * exchange)):
            self.assertAlmostEqual(row["microseconds"], microseconds, delta=1)
        # Half of the efficiency is left when an exchange takes twice as long as a rank's particles, which happens before ghosts
        # take as long.
        self.assertAlmostEqual(rows[0]["half"], 2 * 64**3 * 1e-6 / exchange, delta=0.1)

    def test_bricks_that_nobody_measured_shrink_with_their_number(self):
        # Eight bricks of 32^3, each with three sides of 32^2 beside others, of 12 bytes per place.
        side = 32**2
        rows = self.forecast(8, 1e-6 * (32**3 + 3 * side) + 1e-4 + 3 * 12 * side * 1e-9, ghosts=8 * 3 * side, border_bytes=3 * 12 * side,
                             latency_seconds=1e-4, cut="2x2x2")
        self.assertEqual([(row["ranks"], row["parts"]) for row in rows], [(64, "bricks"), (1024, "bricks")])
        for row in rows:
            own = 64**3 / row["ranks"]
            sides = 6 * own ** (2 / 3)
            self.assertAlmostEqual(row["microseconds"], 1e6 * (1e-6 * (own + sides) + 1e-4 + 12e-9 * sides), delta=1)
            own = 64**3 / row["half"]
            self.assertAlmostEqual(own, 6 * own ** (2 / 3) * 1.012 + 100, delta=0.01 * own)

    def test_a_forecast_is_made_of_numbers(self):
        result = result_files.load(ROOT / "results/nvidia-h100-x2/scaling.json.gz")
        for index, key, value in ((0, "particles", 0), (1, "ghosts", "x"), (1, "border_bytes", []), (1, "latency_seconds", {}),
                                  (1, "seconds_per_byte", {}), (1, "cut", "x"), (1, "cut", "1x0x2")):
            broken = copy.deepcopy(result)
            broken["scaling"][index][key] = value
            self.assert_refused(report(self.write("broken.json", broken), "--out", self.out),
                                f"scaling[{index}].{key}: {json.dumps(value)}", "expected")

    def test_a_haptic_study_has_its_histograms(self):
        figure = self.page_of(haptic_result())["latency"]
        self.assertEqual(report(self.folder / "a.json", "--figures", self.folder / "figures").stdout.count("latency-"), 4)
        self.assertEqual([(panel["match"]["scene"], panel["match"]["hertz"], panel["match"]["edited"]) for panel in figure["panels"]],
                         [("grasp", 1000, "no"), ("grasp", 1000, "yes"), ("grasp", 5000, "no"), ("grasp@30x26x23", 1000, "no")])
        self.assertEqual(len(figure["rows"]), len(haptic_result()["haptic"]))
        first = figure["rows"][0]
        # Two bins beside each other and one by itself, of which the last holds p99.9.
        self.assertEqual((first["begin"], first["end"]), ([10, 11.22, 100], [11.22, 12.59, 112.2]))
        self.assertEqual(first["share"], [0.9, 0.0985, 0.0015])
        self.assertEqual((first["p999"], 1e6 / first["hertz"], first["label"]), (105, 1000, "cuda_implicit_cached"))
        self.assertEqual(figure["rows"][1]["label"], "cuda_implicit_cached, drawn")
        title, more = finding(self.out, "latency")
        self.assertEqual(title, "99.9 % of the forces at 5 kHz are there within 105 µs with cuda_implicit_cached")
        self.assertEqual(more, "On NVIDIA H200 the force of 99.9 % of the ticks at 5 kHz is there in time in 1 of 1 rows, soonest with "
                               "cuda_implicit_cached increment on grasp: within 105 µs; drawing costs 4 % of the steps that fit into a "
                               "tick at the median.")
        # Rows from before histograms existed are read, and have none.
        old = haptic_result()
        for row in old["haptic"]:
            for key in ("histogram", "drawn", "pictures_per_second"):
                del row[key]
        self.assertEqual(self.page_of(old), {})
        for bad in ([[1e-5]], [[1e-5, 0]], [[0, 1]], [[1e-5, 1], [1e-5, 1]], [[2, 1]], ["x"]):
            broken = haptic_result()
            broken["haptic"][1]["histogram"] = bad
            self.assert_refused(report(self.write("broken.json", broken), "--out", self.out), "broken.json",
                                "haptic[1].histogram[", "where a bin begins")

    def test_the_period_is_in_the_figure_whichever_side_the_ticks_are_on(self):
        for slower in (1e-3, 1, 1e3):
            result = haptic_result(slower)
            result["haptic"] = result["haptic"][:1]
            figure = self.page_of(result)["latency"]
            low, high = figure["panels"][0]["spec"]["layer"][0]["encoding"]["x"]["scale"]["domain"]
            row, = figure["rows"]
            self.assertLess(low, min(1e6 / row["hertz"], *row["begin"]))
            self.assertGreater(high, max(1e6 / row["hertz"], *row["end"]))

    def test_a_counter_that_no_script_names_is_a_column(self):
        result = h200("table1")
        result["context"]["voxspring"]["counters"] = {"cache_misses_of_x": {"unit": "B", "better": "less"},
                                                      "of_nobody": {"unit": "", "better": "more"}}
        for number, row in enumerate(result["benchmarks"]):
            row["cache_misses_of_x"] = number
        figure = self.page_of(result)["datasets"]
        self.assertEqual(figure["columns"][-1], ["cache_misses_of_x", "cache misses of x (B)", 4])
        self.assertTrue(all(isinstance(row["cache_misses_of_x"], int) for row in figure["rows"]))

    def test_bursts_and_sustained_times_stand_side_by_side(self):
        result = h200("table1")
        for row in result["benchmarks"]:
            row.pop("limit_sum_seconds", None)
        result["context"]["voxspring"].pop("counters", None)
        figure = self.page_of(result)["datasets"]
        self.assertTrue(all(row["sustained"] is None and row["of_sum"] is None and row["steps"] == 1000 for row in figure["rows"]))
        self.assertEqual(self.out.read_text().count("These files are older than sustained times"), 1)
        # No binder below 60% of the limit.
        self.assertEqual({bool(row["limited_by"]) for row in figure["rows"] if (row["of_limit"] or 0) < 0.6}, {False})
        for row in result["benchmarks"]:
            row |= {"sustained_seconds_per_step": row["real_time"] * 1.25e-6, "limit_sum_seconds": row["real_time"] * 0.5e-6,
                    "fraction_of_limit": 0.7}
        result["context"]["voxspring"]["counters"] = {"sustained_seconds_per_step": {"unit": "s", "better": "less"},
                                                      "limit_sum_seconds": {"unit": "s", "better": "neither"}}
        figure = self.page_of(result)["datasets"]
        for row in figure["rows"]:
            self.assertAlmostEqual(row["sustained"] / row["microseconds"], 1.25, 3)
            self.assertAlmostEqual(row["of_sum"], 0.5, 3)
            self.assertIn(row["limited_by"], ("launch", "exchange", "bandwidth", "arithmetic"))
        # A counter that has a column in other units has no second one.
        self.assertNotIn("sustained_seconds_per_step", [column[0] for column in figure["columns"]])
        self.assertNotIn("These files are older than sustained times", self.out.read_text())

    def test_every_list_of_a_result_is_known(self):
        """Everything that a study can write is read: each list with measurements becomes a figure."""
        schema = json.loads((ROOT / "results/schema.json").read_text())
        lists = {name for name, about in schema["properties"].items() if about.get("type") == "array" or "items" in about}
        self.assertLessEqual({"benchmarks", "overhead", "energy", "stability_map"}, lists)
        # One repeats the rules of --backend auto.
        self.assertEqual(lists - {"auto"}, set(reading.LISTS))

    def test_truth_has_a_line_for_each_case_and_the_order_that_it_claims(self):
        result = truth_result()
        figure = self.page_of(result)["truth"]
        self.assertEqual({(row["scene"], row["across"], row["particles_at"]) for row in figure["rows"]},
                         {(row["scene"], row["across"], row["particles_at"]) for row in result["truth"]})
        panels = {tuple(panel["match"].values()): panel["spec"]["layer"] for panel in figure["panels"]}
        self.assertEqual(len(panels), 2)
        for layers, claims in zip(panels.values(), ([2, 1.25], [1])):
            lines = [layer["data"]["values"] for layer in layers if layer.get("mark", {}).get("strokeDash") == [4, 4]]
            slopes = [-math.log(last["y"] / first["y"]) / math.log(last["x"] / first["x"]) for first, last in lines]
            for slope, claim in zip(slopes, claims, strict=True):
                self.assertAlmostEqual(slope, claim, 3)
            encoding = next(layer["encoding"] for layer in layers if "detail" in layer.get("encoding", {}))
            self.assertEqual((encoding["x"]["scale"]["type"], encoding["y"]["scale"]["type"]), ("log", "log"))
        self.assertEqual({row["end_label"] for row in figure["rows"] if row["end_label"]}, {"tension", "cube", "torsion"})
        self.assertIn("The error falls to 0.25", self.out.read_text())

    def test_nothing_in_the_page_can_end_its_data_early(self):
        result = h200("table1")
        for row in result["benchmarks"]:
            row["scene"] = row["scene"].replace("heart", "</script><h1 id=evil>")
            row["name"] = row["name"].replace("heart", "</script><h1 id=evil>")
        self.page_of(result)
        self.assertNotIn("</script><h1 id=evil>", self.out.read_text())


def haptic_result(times=1):
    """Made up: two scenes and two rates, with edits and drawn; `times` scales every tick."""
    def row(scene, backend, hertz, edited=False, drawn=False, slower=1):
        slower *= times
        bins = [[1e-5 * slower, 18000], [1e-5 * slower * 10**0.05, 1970], [1e-4 * slower, 30]]
        return {"name": f"{scene}/{backend}/increment/float32", "scene": scene, "backend": backend, "formulation": "increment",
                "precision": "float32", "tuning": "", "hertz": hertz, "edited": edited, "drawn": drawn, "ticks": 20000,
                "median_seconds": 1.1e-5 * slower, "p99_seconds": 1.2e-5 * slower, "p999_seconds": 1.05e-4 * slower,
                "worst_seconds": 1.1e-4 * slower, "missed": 0, "steps_that_fit": 48 if drawn else 50, "force_error": 1e-6,
                "real_time": True, "histogram": bins, "pictures_per_second": 60.0 if drawn else None}

    return made_up(haptic=[
        row("grasp", "cuda_implicit_cached", 1000), row("grasp", "cuda_implicit_cached", 1000, drawn=True, slower=1.3),
        row("grasp", "cpu_parallel", 1000, slower=10), row("grasp", "cuda_implicit_cached", 1000, edited=True),
        row("grasp", "cuda_implicit_cached", 5000), row("grasp@30x26x23", "gl_compute_implicit", 1000, slower=2)])


def truth_result():
    """Made up: three cases, of which torsion claims no order."""
    def row(scene, place, across, error, claimed):
        return {"name": f"{scene}/cpu_explicit/increment/float64", "scene": scene, "backend": "cpu_explicit", "formulation": "increment",
                "precision": "float64", "tuning": "threads=auto", "particles_at": place, "strain": "small", "across": across,
                "model_error": error, "continuum_error": 1e-4, "order": None if across == 4 else claimed, "claimed_order": claimed,
                "rounding_error": 0.0, "seconds": 0.1, "steps": 80, "particles": across**3}

    return made_up(truth=[
        row("tension", "corners", 4, 1e-2, 2), row("tension", "corners", 8, 2.5e-3, 2), row("cube", "corners", 4, 2e-2, 1.25),
        row("cube", "corners", 8, 9e-3, 1.25), row("cube", "centres", 4, 1e-1, 1), row("cube", "centres", 8, 5e-2, 1),
        row("torsion", "centres", 4, 5e-2, None), row("torsion", "centres", 8, 1e-3, None)])


# Values that have confused readers before, for any key.
ODD = [None, True, 0, -1, 1.5, "", "x", [], {}, [1], {"a": 1}, [[1]], 1e308, 10**400, math.nan, "\0", "</script>", ["x"], [None]]
MUTATIONS = 30


def places(value):
    """Every (holder, key) in a document."""
    found = []
    for key, child in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        found += [(value, key), *places(child)]
    return found


def small_result():
    """A few rows of every list."""
    result = h200("fastest")
    result["benchmarks"] = [row for row in result["benchmarks"] if row["scene"] == "heart" and row["backend"] in
                            ("cuda_resident", "gl_compute_implicit")][:39]
    result["benchmarks"] += [row for row in h200("fastest")["benchmarks"]
                             if row["scene"] == "box@32" and row["backend"] == "cuda_march"][:13]
    result["benchmarks"] += [row for row in h200("edits")["benchmarks"] if row["backend"] == "cuda_scatter"][:13]
    result["fastest"] = [block for block in result["fastest"] if block["scene"] == "heart"][:1]
    for study, count in (("pareto", 6), ("stability", 4), ("stress", 4), ("overhead", 4), ("energy", 2)):
        result[study] = h200(study)[study][:count]
    result["stability_map"] = h200("stability")["stability_map"][:1]
    result["haptic"] = haptic_result()["haptic"]
    result["truth"] = truth_result()["truth"]
    result["failed"] = result["skipped"] = [{"name": "n", "scene": "heart", "backend": "b", "reason": "r"}]
    return with_work(result)


class Mutated(Reports):
    def test_a_result_with_any_value_is_read_or_refused(self):
        """Read by the page and by diff.py; a traceback of either fails this."""
        import comparison
        from page import document
        good = small_result()
        whole, generator, read = self.write("good.json", good), random.Random(1), 0
        for _ in range(MUTATIONS):
            result = copy.deepcopy(good)
            by_key = {}
            for holder, key in places(result):
                by_key.setdefault(key if isinstance(key, str) else "", []).append((holder, key))
            holder, key = generator.choice(by_key[generator.choice(sorted(by_key))])
            value = generator.choice(ODD)
            holder[key] = copy.deepcopy(value)
            path = self.write("bad.json", result)
            for reader in (lambda: document.page([reading.Result(path)], {}, []),
                           lambda: comparison.document(whole, path, comparison.Rule())):
                with self.subTest(key=key, value=value):
                    try:
                        reader()
                        read += 1
                    except reading.BadInput as error:
                        self.assertIn("bad.json: ", str(error))
        self.assertTrue(MUTATIONS // 2 < read < 2 * MUTATIONS, read)


class Browser:
    """Headless chromium, one for all tests."""

    def __init__(self):
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service
        options = webdriver.ChromeOptions()
        for option in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)
        self.driver.set_script_timeout(60)
        self.untouched = None

    def emulate(self, width, scheme, media=""):
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500})
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
            "media": media, "features": [{"name": "prefers-color-scheme", "value": scheme}]})

    def look_at(self, path, width=1440, scheme="light"):
        """Shows a page to a test that does not change it, since loading and drawing take seconds."""
        if self.untouched != path:
            self.open(path, width, scheme)
            self.untouched = path
        self.emulate(width, scheme)
        self.driver.get_log("browser")
        self.driver.get_log("performance")

    def open(self, path, width=1440, scheme="light"):
        from selenium.webdriver.support.ui import WebDriverWait
        self.untouched = None
        self.emulate(width, scheme)
        self.driver.get(path.as_uri())
        WebDriverWait(self.driver, 60).until(
            lambda driver: driver.execute_script("return document.documentElement.dataset.drawn") == "yes")

    def script(self, text, *arguments):
        return self.driver.execute_script(text, *arguments)

    def settle(self):
        """Waits until every chart has drawn what was last requested."""
        self.driver.execute_async_script(
            "Promise.all(views.map(({view}) => view.runAsync())).then(() => arguments[0]())")


def linear_rgb(colour):
    channels = numpy.array([int(colour[i:i + 2], 16) / 255 for i in (1, 3, 5)])
    return numpy.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


# How eyes without one kind of cone see linear RGB: Machado, Oliveira and Fernandes (2009), Table 1, severity 1.
VISIONS = {
    "all cones": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
# From linear RGB to cones and from their cube roots to Oklab (Ottosson 2020), where equal distances look equally far.
CONES = numpy.array([[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
                     [0.0883024619, 0.2817188376, 0.6299787005]])
OKLAB = numpy.array([[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
                     [0.0259040371, 0.7827717662, -0.8086757660]])


def seen(colour, vision):
    return OKLAB @ numpy.cbrt(CONES @ numpy.clip(VISIONS[vision] @ linear_rgb(colour), 0, 1))


def contrast(one, other):
    dark, light = sorted((0.2126, 0.7152, 0.0722) @ linear_rgb(colour) for colour in (one, other))  # their luminance
    return (light + 0.05) / (dark + 0.05)


class Page(unittest.TestCase):
    """The page of the committed results."""

    @classmethod
    def setUpClass(cls):
        cls.path = new_folder(cls.addClassCleanup) / "report.html"
        # Not results/local, which is the developer's own.
        made = report(*result_files.committed(H200.parent), "--out", cls.path,
                      "--pictures", cls.path.parent / "pictures", "--program", write_program(cls.path.parent))
        if made.returncode != 0:
            raise AssertionError(made.stderr)
        cls.browser = Browser()
        cls.addClassCleanup(cls.browser.driver.quit)
        cls.script = cls.browser.script

    def assert_quiet(self):
        """Neither errors nor warnings in the console, and no request except for the page itself."""
        self.assertEqual(self.browser.driver.get_log("browser"), [])
        messages = [json.loads(entry["message"])["message"] for entry in self.browser.driver.get_log("performance")]
        requested = {message["params"]["request"]["url"] for message in messages
                     if message["method"] == "Network.requestWillBeSent"}
        outside = {url for url in requested if not url.startswith(("data:", "blob:", "chrome:", "about:"))}
        self.assertLessEqual(outside, {self.path.as_uri()})

    def test_every_width_and_scheme(self):
        axe = next((ROOT / "build/report-venv").rglob("axe.min.js")).read_text()
        for width in WIDTHS:
            self.browser.open(self.path, width, SCHEMES[0])
            self.assert_quiet()
            for scheme in SCHEMES:
                with self.subTest(width=width, scheme=scheme):
                    self.browser.emulate(width, scheme)
                    self.assertEqual(self.script("return innerWidth"), width)
                    self.assertLessEqual(*self.script(
                        "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"))
                    # A chart fits into its place and is not cut off.
                    self.assertEqual(self.script(
                        "return [...document.querySelectorAll('.chart')].filter((chart) => chart.querySelector('svg')"
                        ".getBoundingClientRect().width > chart.clientWidth + 1).map((chart) => chart.id)"), [])
                    # The name of an axis is not cut off either.
                    self.assertEqual(self.script(
                        "return [...document.querySelectorAll('.chart .role-axis-title text')].filter((title) => {"
                        "const text = title.getBoundingClientRect(), chart = title.closest('.chart').getBoundingClientRect();"
                        "return text.left < chart.left - 1 || text.right > chart.right + 1 || text.bottom > chart.bottom + 1})"
                        ".map((title) => [title.closest('.chart').id, title.textContent])"), [])
                    self.assert_legend_is_whole(width)
            self.script("document.querySelector('details[data-figure=figure7]').open = true")
            self.script(axe)
            # Charts are left out: they have thousands of marks without text, and the colours of their text are checked below.
            self.script("document.querySelectorAll('.chart svg').forEach((chart) => chart.replaceChildren())")
            for scheme in SCHEMES:
                with self.subTest(width=width, scheme=scheme):
                    self.browser.emulate(width, scheme)
                    # Contrast is the only rule that depends on the scheme.
                    rules = "" if scheme == SCHEMES[0] else ", runOnly: ['color-contrast']"
                    found = self.browser.driver.execute_async_script(
                        f"axe.run(document, {{resultTypes: ['violations']{rules}}}).then((result) => arguments[0](result.violations"
                        ".map((found) => [found.id, found.nodes.slice(0, 3).map((node) => node.html.slice(0, 120))])))")
                    self.assertEqual(found, [])

    def assert_legend_is_whole(self, width):
        """Each backend of the page has its swatch and its name on the screen while any figure is on it."""
        self.script("document.querySelector('#figure7-0').scrollIntoView()")
        labels = self.script(
            "const form = document.getElementById('filters').getBoundingClientRect();"
            "return [...document.querySelectorAll('#filters fieldset label')].map((label) => {"
            "const range = document.createRange(); range.selectNodeContents(label.lastChild);"
            "const text = range.getBoundingClientRect(), swatch = label.querySelector('svg').getBoundingClientRect();"
            "return [label.innerText, swatch.width, Math.min(swatch.left, text.left), text.right, form.top, text.top, "
            "text.bottom, Math.min(form.bottom, innerHeight)]})")
        self.assertEqual(len(labels), len(self.script("return boxes")))
        for name, swatch, left, right, top, text_top, text_bottom, bottom in labels:
            with self.subTest(name):
                self.assertGreaterEqual(swatch, 10)
                self.assertGreaterEqual(left, 0)
                self.assertLessEqual(right, width)
                self.assertTrue(top <= text_top < text_bottom <= bottom, (top, text_top, text_bottom, bottom))
        # No name overlaps another, and the figure takes most of the screen.
        self.assertEqual(len({(left, text_top) for _, _, left, _, _, text_top, *_ in labels}), len(labels))
        self.assertLess(labels[0][-1], 0.45 * self.script("return innerHeight"))

    def test_every_figure_has_its_marks(self):
        self.browser.look_at(self.path)
        names = self.script("return [...document.querySelectorAll('section[data-figure]')].map((s) => s.dataset.figure)")
        self.assertEqual(names, FIGURES)
        for name in names:
            with self.subTest(name):
                counts = self.script(
                    "return views.filter(({figure}) => figure.name === arguments[0]).map(({figure, panel, element}) => ["
                    "figure.rows.filter((row) => matches(row, panel.match) && row.p999 !== null).length,"
                    "element.querySelectorAll('.mark-symbol > path').length || (figure.name === 'latency' ? 0 :"
                    "element.querySelectorAll('.mark-rect > path').length),"
                    "element.querySelectorAll('.mark-rect > path').length,"
                    "figure.rows.filter((row) => matches(row, panel.match)).reduce((sum, row) => sum + (row.begin ?? []).length, 0),"
                    "element.parentNode.querySelector('[role=graphics-document]').getAttribute('aria-label')])", name)
                self.assertGreater(len(counts), 0)
                for rows, marks, strips, bins, alternative in counts:
                    self.assertTrue(strips == bins or name != "latency", "histograms are drawn")
                    self.assertGreater(len(alternative or ""), 40)
                    self.assertNotIn("undefined", alternative)
                    # A curve's points are medians over backends; gates and measurements of zero cannot be shown. A row of too
                    # few ticks has no percentile to mark.
                    if name in ("curves", "stress"):
                        self.assertGreater(marks, 20)
                    else:
                        self.assertEqual(marks, rows)
                title, lines = self.script(
                    "const title = document.querySelector(`section[data-figure=${arguments[0]}] h2`);"
                    "return [title.innerText, Math.round(title.clientHeight / parseFloat(getComputedStyle(title).lineHeight))]", name)
                self.assertRegex(title, r"\d", "a title states its finding")
                self.assertEqual(lines, 1, title)
                caption = self.script("return document.querySelector(`section[data-figure=${arguments[0]}] .caption`)"
                                      ".innerText", name)
                card = r"NVIDIA H200(?: \([^)]*GPU-[0-9a-f]+\))?"  # results of two cards have their identities
                machine = (f"AMD EPYC|{card}" if name == "latency" else r"NVIDIA H100 80GB HBM3(?: \([^)]*GPU-[0-9a-f]+\))?"
                           if name in ("scaling", "forecast") else card)
                self.assertRegex(caption, rf"({machine}), driver \S+.*, commit [0-9a-f]{{7,}}, \d{{4}}-\d\d-\d\d")

    def test_the_answer_is_what_the_files_say(self):
        self.browser.look_at(self.path)
        # If several files have a row, the one with most steps is shown.
        told = {}
        files = [result_files.load(path) for path in result_files.within(H200)]
        for result in sorted(files, key=lambda result: result["context"]["date"]):
            for row in result["benchmarks"]:
                name = row["name"].split("/iterations:")[0]
                if row.get("aggregate_name") == "median" and (name not in told or told[name]["steps"] <= row["steps"]):
                    told[name] = row
        best = min((row for row in told.values() if row["scene"] == "box@256"), key=lambda row: row["real_time"])
        text = self.script("return document.querySelector('.answer tr[data-scene=\"box@256\"]').innerText")
        self.assertIn(best["backend"], text)
        self.assertIn(f"{best['real_time']:.3g}", text)
        title, lines, lead = self.script(
            "const title = document.querySelector('h1');"
            "return [title.innerText, Math.round(title.clientHeight / parseFloat(getComputedStyle(title).lineHeight)), "
            "document.querySelector('.lead').innerText]")
        self.assertEqual(title.replace("\N{NO-BREAK SPACE}", " "), "Box: on chip to 262 k, cuda_march from 7.08 M particles")
        self.assertEqual(lines, 1)
        self.assertIn("Of the sizes of box, cuda_resident and cuda_bricks are the fastest up to 262 k particles, with "
                      "the state on the chip, and cuda_march from 7.08 M to 134 M particles.", lead.replace("\N{NO-BREAK SPACE}", " "))
        self.assertIn(max(told.values(), key=lambda row: row["particles"])["scene"], lead)
        # The title of Figure 7 names the fastest of both scenes.
        title = self.script("return document.querySelector('section[data-figure=figure7] .finding').innerText")
        for scene in ("box@32", "heart"):
            row = min((row for row in medians("figure7") if row["scene"] == scene), key=lambda row: row["real_time"])
            self.assertIn(f"{row['backend']} leads on {scene} with ", title)
            unit, scale = ("µs", 1) if row["real_time"] >= 1 else ("ns", 1000)
            self.assertIn(f"{scale * row['real_time']:.3g}\N{NO-BREAK SPACE}{unit}", title)

    def test_every_line_says_what_it_is(self):
        """Charts with too many lines for a colour each: Figure 8, and the figure of what edits cost."""
        self.browser.look_at(self.path)
        for name in ("figure8", "edits"):
            panels = self.script(
                "return views.filter(({figure}) => figure.name === arguments[0]).map(({figure, panel, element}) => ["
                "[...new Set(figure.rows.filter((row) => matches(row, panel.match)).map((row) => row.label))],"
                "[...element.querySelectorAll('.mark-text.role-mark text, .role-axis-label text')].map((text) => {"
                "const at = text.getBoundingClientRect();"
                "return [text.textContent, at.left, at.top, at.right, element.getBoundingClientRect().right]})])", name)
            self.assertGreater(len(panels), 0)
            for labels, texts in panels:
                texts = [text for text in texts if text[0] in labels]
                self.assertEqual(sorted(labels), sorted(text for text, *_ in texts))
                for (_, left, top, right, end), (_, next_left, next_top, *_) in itertools.combinations(texts, 2):
                    self.assertLessEqual(right, end)
                    self.assertTrue(abs(top - next_top) > 9 or abs(left - next_left) > 60, (name, top, next_top, texts))

    def marks(self, figure, backend):
        return self.script(
            "const colour = getComputedStyle(document.querySelector(`#filters input[value=${arguments[1]}] + svg`)).fill;"
            "return [...document.querySelectorAll(`section[data-figure=${arguments[0]}] figure:not([hidden]) .mark-symbol > "
            "path`)].filter((mark) => getComputedStyle(mark).fill === colour).length", figure, backend)

    def test_filters(self):
        self.browser.open(self.path)
        measured = [row for path in sorted(H200.parent.glob("*/figure8.json.gz")) for row in result_files.load(path)["benchmarks"]
                    if row.get("aggregate_name") == "median"]
        rows = {row["backend"] for row in measured}
        self.assertIn("cuda_scatter", rows)
        count = sum(row["backend"] == "cuda_scatter" for row in measured)
        self.script("document.querySelector('details[data-figure=figure8]').open = true")
        self.assertEqual(self.marks("figure8", "cuda_scatter"), count)
        # The roofline's points lie above lines that belong to no backend.
        self.assertGreater(self.marks("roofline", "cuda_scatter"), 0)
        self.driver_click("#filters input[value=cuda_scatter]")
        for figure in ("figure8", "roofline"):
            self.assertEqual(self.marks(figure, "cuda_scatter"), 0)
        self.assertGreater(self.marks("figure8", "cuda_implicit_cached"), 0)
        self.assertEqual(self.table("figure8", "backend"), rows - {"cuda_scatter"})
        self.driver_click("#filters input[value=cuda_scatter]")
        self.assertEqual(self.marks("figure8", "cuda_scatter"), count)

        self.script("scene.value = 'heart'; scene.dispatchEvent(new Event('change', {bubbles: true}))")
        self.browser.settle()
        self.assertEqual(self.script("return [...document.querySelectorAll('section[data-figure=figure7] figure:not([hidden]) "
                                     "h3')].map((heading) => heading.innerText.split(' (')[0])"),
                         ["heart, NVIDIA H200", "heart, NVIDIA H100 80GB HBM3"])
        self.assertFalse(self.script("return document.querySelector('section[data-figure=figure8] .empty').hidden"))
        self.script("document.querySelector('details[data-figure=datasets]').open = true")
        self.browser.settle()
        self.assertEqual(self.table("datasets", "dataset"), {"heart"})
        self.script("scene.value = ''; scene.dispatchEvent(new Event('change', {bubbles: true}))")

        self.driver_click("#all")
        empty = self.script("return document.querySelectorAll('section[data-figure] .empty:not([hidden])').length")
        self.assertEqual(empty, len(FIGURES))
        self.driver_click("#all")
        self.assertEqual(self.marks("figure8", "cuda_scatter"), count)
        self.assert_quiet()

    def test_pictures(self):
        self.browser.open(self.path)
        shown = self.script("return [...document.querySelectorAll('#pictures .pair')].map((pair) => [pair.dataset.scene, "
                            "[...pair.querySelectorAll('img')].map((image) => [image.alt, image.naturalWidth])])")
        # Only one size of each dataset is shown, and the heart comes first.
        self.assertEqual([scene for scene, _ in shown], ["heart@80x68x61", "beam", "box@32", "poke", "porous@48"])
        for scene, images in shown:
            alternatives, widths = zip(*images)
            self.assertEqual(widths, (56, 56))
            self.assertRegex(alternatives[0], rf"^{scene} after \d+ steps of cpu_parallel \w+ float32, coloured by displacement: "
                                              "at most 6.74$")
            self.assertRegex(alternatives[1], "coloured by the error against float64: at most 3.4e-5$")
        text = self.script("return document.querySelector('#pictures').innerText")
        for words in ("drawn by a test",
                      "Without a picture: box@8, box@16, box@48, box@64, box@96, box@128, heart, heart@120x102x92, heart@240x204x184, "
                      "porous@64, porous@96 and porous@128 (as those shown",
                      "(more than 4 million particles)",
                      "scalpel_1, scalpel_10 and scalpel_100 (no blade)"):
            self.assertIn(words, text)
        self.assertEqual(text.count("Without a picture"), 1)
        # The heart opens the page: beside the headline, on a phone below it.
        for width in WIDTHS:
            self.browser.emulate(width, "light")
            title, image = self.script("return ['.lead', '.opening img'].map((name) => document.querySelector(name)"
                                       ".getBoundingClientRect().toJSON())")
            self.assertLess(image["top"], 900, "on the first screen")
            if width > 1000:
                self.assertGreaterEqual(image["left"], title["right"])
                self.assertLess(image["top"], title["bottom"])
            else:
                self.assertGreaterEqual(image["top"], title["bottom"])
                self.assertEqual(image["left"], title["left"])
        self.browser.emulate(1440, "light")
        self.script("scene.value = 'poke'; scene.dispatchEvent(new Event('change', {bubbles: true}))")
        self.browser.settle()
        self.assertEqual(self.script("return [...document.querySelectorAll('#pictures .pair')].filter((pair) => pair"
                                     ".checkVisibility()).map((pair) => pair.dataset.scene)"), ["poke"])
        self.assert_quiet()

    def driver_click(self, selector):
        from selenium.webdriver.common.by import By
        self.browser.driver.find_element(By.CSS_SELECTOR, selector).click()
        self.browser.settle()

    def table(self, figure, column):
        """The values in a column of a figure's table."""
        return set(self.script(
            "const table = document.querySelector(`details[data-figure=${arguments[0]}] table`);"
            "const place = [...table.tHead.rows[0].cells].findIndex((cell) => cell.textContent === arguments[1]);"
            "return [...table.tBodies[0].rows].map((row) => row.cells[place].textContent)", figure, column))

    def test_a_hover_shows_the_row(self):
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.by import By
        self.browser.look_at(self.path)
        mark = self.browser.driver.find_element(By.CSS_SELECTOR, "#figure7-0 .mark-rect > path")
        self.script("arguments[0].scrollIntoView({block: 'center'})", mark)
        ActionChains(self.browser.driver).move_to_element(mark).perform()
        shown = self.script("const tip = document.getElementById('vg-tooltip-element');"
                            "return tip && tip.classList.contains('visible') ? tip.innerText : ''")
        for word in ("strategy", "time per step", "rounding error", "box@32"):
            self.assertIn(word, shown)

    def test_nothing_can_be_fetched(self):
        self.browser.look_at(self.path)
        blocked = self.browser.driver.execute_async_script(
            "document.addEventListener('securitypolicyviolation', (event) => arguments[0](event.effectiveDirective));"
            "fetch('https://example.invalid/').catch(() => {})")
        self.assertEqual(blocked, "connect-src")
        self.browser.driver.get_log("browser")
        # The source of the chart library is full of such words.
        text = re.sub("<script.*?</script>", "", self.path.read_text(), flags=re.DOTALL)
        self.assertIsNone(re.search(r"<(script|link|img|iframe)[^>]*(src|href)=[\"'](?!data:)", text))

    def test_print_is_light(self):
        self.browser.look_at(self.path, 1440, "dark")
        dark = self.script("return getComputedStyle(document.body).backgroundColor")
        self.browser.emulate(1440, "dark", "print")
        self.assertEqual(self.script("return getComputedStyle(document.body).backgroundColor"), "rgb(255, 255, 255)")
        self.assertNotEqual(dark, "rgb(255, 255, 255)")
        self.assertEqual(self.script("return getComputedStyle(document.querySelector('#figure7-0 .mark-text.role-mark text'))"
                                     ".fill"), self.script("return getComputedStyle(document.body).color"))

    def test_colours_stand_out_from_the_page(self):
        for scheme in SCHEMES:
            self.browser.look_at(self.path, 1440, scheme)
            names = set(re.findall(r"(--[a-z0-9-]+):", (ROOT / "results/page/page.css").read_text()))
            colours = dict(self.script(
                "return arguments[0].map((name) => [name, getComputedStyle(document.documentElement).getPropertyValue(name)"
                ".trim()])", sorted(names)))
            for name, colour in colours.items():
                if name in ("--page", "--raised", "--ground", "--line", "--bounded", "--heating", "--diverged"):
                    continue
                # WCAG 2.2: 4.5 for text, 3 for the parts without which a figure is not understood.
                least = 4.5 if name in ("--ink", "--soft", "--link") else 3
                with self.subTest(scheme=scheme, name=name):
                    self.assertGreaterEqual(contrast(colour, colours["--page"]), least)
            # A picture's legend is grey (harness/drawing/legend.cpp) on that background.
            self.assertGreaterEqual(contrast("#6e6e6e", colours["--ground"]), 4.5)
            # The letters on the map of stability are always dark.
            for region in ("--bounded", "--heating", "--diverged"):
                self.assertGreaterEqual(contrast("#111111", colours[region]), 4.5)
            backends = [colour for name, colour in colours.items() if name.startswith("--backend-")]
            self.assertEqual(len(backends), charts.COLOURS)
            # Differences of about 0.02 can be seen side by side; marks are small and apart.
            for vision in VISIONS:
                for one, other in itertools.combinations(backends, 2):
                    with self.subTest(scheme=scheme, vision=vision, colours=(one, other)):
                        self.assertGreater(math.dist(seen(one, vision), seen(other, vision)), 0.06)


class Parts(Reports):
    """Content that the committed results do not have: several commits, the study fastest, pictures."""

    def test_a_backend_has_one_colour_on_every_page(self):
        """One backend beside others, all backends, and one with an unknown name."""
        def colours(result):
            self.page_of(result)
            return dict(re.findall(r'value="(\w+)"><svg class="swatch" viewBox="0 0 10 10" aria-hidden="true" '
                                   r'fill="var\((--backend-\d+)\)">', self.out.read_text()))
        result = h200("table1")
        every = colours(result)
        self.assertGreater(len(every), 10)
        self.assertEqual(len(set(every.values())), len(every))
        alone = result | {"benchmarks": [row for row in result["benchmarks"] if row["backend"] in ("cuda_march", "gl_compute_implicit")]}
        self.assertEqual(colours(alone), {name: every[name] for name in ("cuda_march", "gl_compute_implicit")})
        for row in result["benchmarks"]:
            for old, new in (("cuda_scatter", "mine_of_today"), ("cpu_parallel", "yours_of_today")):
                if row["backend"] == old:
                    row.update({key: row[key].replace(old, new) for key in ("backend", "name", "run_name")})
        # An API that no script names has its name from the result.
        result["context"]["voxspring"]["backends"]["mine_of_today"] = {"title": "An API of today", "limits_of": "An API of today"}
        changed = colours(result)
        families = {row["backend"]: row["family"] for row in figures_of(self.out)["datasets"]["rows"]}
        self.assertEqual((families["mine_of_today"], families["yours_of_today"]), ("An API of today", "another API"))
        self.assertEqual(len(set(changed.values())), len(changed))
        self.assertEqual(len(every | changed), len(every) + 2)

    def history(self, *results):
        """The finding of the page's history, of results made here."""
        files = [self.write(f"{index}.json", result) for index, result in enumerate(results)]
        self.make(*files)
        found = finding(self.out, "history")
        return found and found[1]

    def later(self, result, **factors):
        """A result from another day and commit; `factors` multiply the times of the strategies that they name."""
        result = copy.deepcopy(result)
        result["context"]["date"] = "2027-01-02T03:04:05+00:00"
        result["context"]["voxspring"]["commit"] = "0123456789ab"
        for row in result["benchmarks"]:
            if row["scene"] == "heart":
                row["real_time"] *= factors.get(row["backend"], 1)
        return result

    def test_a_longer_run_stands_for_a_strategy_and_a_newer_one_of_the_same_study(self):
        def row(study, steps, microseconds, contender="a", date="2027"):
            return {"machine": "m", "scene": "s", "contender": contender, "study": study, "steps": steps, "microseconds": microseconds,
                    "date": date}

        rows = [row("long", 2000, 1.0, date="2026"), row("long", 1000, 1.1), row("short", 20, 4.5), row("short", 20, 9.0, "b"),
                row("even", 1000, 1.2)]
        self.assertCountEqual(reading.strategies(rows), [rows[3], rows[4]])
        self.assertEqual(reading.strategies(rows[:3]), [rows[1]])
        # One file may have several numbers of steps of a scene.
        rows = [row("one", 400, 1.0), row("one", 100, 1.1)]
        self.assertEqual(reading.strategies(rows), [rows[0]])

    def test_history_across_commits(self):
        result = h200("figure7")
        title = self.history(result, self.later(result, cuda_scatter=1.75, cuda_march=1.02))
        before, = (row["real_time"] for row in medians("figure7")
                   if row["backend"] == "cuda_scatter" and row["scene"] == "heart")
        self.assertRegex(title, r"^On NVIDIA H200 the largest change from commit [0-9a-f]{7} to 0123456 is that of cuda_scatter "
                         rf"position on heart \(figure7\), from {before:.3g} µs to .* µs, 1\.75 times \(1\.\d\d to 1\.\d\d\); "
                         rf"of {len(medians('figure7'))} times 1 slower")
        self.assertEqual(finding(self.out, "history")[0], "cuda_scatter position on heart takes 1.75 times its time, figure7 at 0123456")
        self.assertIn("0123456 01-02 03:04", self.out.read_text())
        # A run that is slower as a whole is told, though no row stands out from it.
        slower = self.later(result)
        for row in slower["benchmarks"]:
            row["real_time"] *= 1.3
        count = len(medians("figure7"))
        self.assertRegex(self.history(result, slower), rf"CUDA takes 1\.30 times its time as a whole from commit .* of {count} times "
                         rf"(?:[1-5] too noisy to tell and )?(?:{'|'.join(str(count - n) for n in range(6))}) same")
        # One file has no history.
        self.assertIsNone(self.history(result))

    def test_the_page_decides_no_more_than_diff(self):
        """Two runs, the older one without repetitions, so that nothing can be told; page and diff.py agree on the verdict."""
        result = h200("figure7")
        later = self.later(result, cuda_scatter=2.19)
        # A study of one repetition writes no median.
        result["benchmarks"] = [row | {"repetitions": 1} for row in result["benchmarks"] if row.get("repetition_index") == 0]
        title = self.history(result, later)
        # Rows that were resumed have fewer judged repetitions than the older run, which has one each.
        partly = sum(verdict.get("repetitions_judged", 9) < 9 for verdict in result["verification"])
        count = len(medians("figure7")) - partly
        self.assertRegex(title, r"no change of a time in figure7 can be told .*\("
                         rf"{f'{partly} not comparable and ' * bool(partly)}{count} too noisy to tell\)\.$")
        self.assertNotIn("2.19 times", title)
        said = run(PYTHON, ROOT / "results/diff.py", "--json", *sorted(self.folder.glob("?.json")))
        expected = {"too noisy to tell": count} | ({"not comparable": partly} if partly else {})
        self.assertEqual((said.returncode, json.loads(said.stdout)["counts"]), (0, expected))
        # A change of two rows without repetitions has no interval.
        result["benchmarks"] = [row for row in result["benchmarks"] if row["scene"] == "heart"][:2]
        slower = self.later(result, **{row["backend"]: 4 for row in result["benchmarks"]})
        self.assertRegex(self.history(result, slower), r"to .*, 4\.00 times; of 2 times 2 slower")
        # Results of two cards are no history of one card.
        other = self.later(result)
        for name, backend in other["context"]["voxspring"]["backends"].items():
            backend["device"] = "Another" if name != "vulkan_implicit" else backend["device"]
        self.assertRegex(self.history(result, other), r"nothing can be told of figure7: .*: expected \"NVIDIA H200")

    def test_the_fastest_is_one_that_repetitions_tell_from_the_others(self):
        # OpenGL's rows are left out: a first repetition of five times the others would make few repetitions tell nothing.
        times = {row["backend"]: row["real_time"] for row in medians("table1")
                 if row["scene"] == "box@32" and not row["backend"].startswith("gl_")}
        def equals(factor, repetitions=9, **fields):
            """From which rows the page cannot tell box@32's fastest, with another row at a multiple of its time."""
            result, count = h200("table1"), collections.Counter()
            kept = []
            for row in result["benchmarks"]:
                if row["backend"].startswith("gl_"):
                    continue
                count[row["run_name"]] += row["run_type"] == "iteration"
                if row["run_type"] == "iteration" and count[row["run_name"]] > repetitions:
                    continue
                kept.append(row)
                if row["scene"] == "box@32" and row["backend"] == "cuda_implicit_cached":
                    row["real_time"] *= factor * times["cuda_resident"] / times["cuda_implicit_cached"]
                    row.update(fields)
            result["benchmarks"] = kept
            for row in kept:
                own = [one["real_time"] for one in kept if one["run_name"] == row["run_name"] and one["run_type"] == "iteration"]
                row["repetitions"] = len(own)
                if row.get("aggregate_name") == "median":
                    row["real_time"] = statistics.median(own)
            self.page_of(result)
            text = self.out.read_text()
            row = text[text.index('<tr data-scene="box@32">'):]
            self.assertIn("cuda_<wbr>resident", row[:400])
            found = re.search("not to be told from ([^<]*)<", row[:row.index("</tr>")])
            return (found and found[1]), re.search("<h1>(.*?)</h1>", text)[1]
        self.assertEqual(equals(1.03), ("cuda_implicit_cached", "cuda_resident is the fastest on heart and "
                                        "cuda_resident and cuda_implicit_cached cannot be told apart on box@32"))
        fastest = "cuda_resident is the fastest on heart and box@32"
        self.assertEqual(equals(1.4), (None, fastest))
        self.assertEqual(equals(1.25, noisy=["its clock moved"])[0], "cuda_implicit_cached")
        self.assertEqual(equals(1.5, noisy=["its clock moved"]), (None, fastest))
        self.assertEqual(equals(3, repetitions=3), (None, fastest))
        self.assertRegex(equals(3, repetitions=2)[0], rf"^cuda_\w+, cuda_\w+ and {len(times) - 3} others$")

    def boxes(self, times, skipped=()):
        """A result with boxes of these sizes: the times of backends by size."""
        result = h200("table1")
        pattern = [row for row in result["benchmarks"] if row["scene"] == "box@32" and row["backend"] == "cuda_implicit_cached"]
        result |= {"benchmarks": [], "verification": []}
        for size, backends in times.items():
            for backend, time in backends.items():
                for row in pattern:
                    one = {**row, "backend": backend, "scene": f"box@{size}", "particles": size**3, "real_time": time * row["real_time"]}
                    if backend in ("cuda_resident", "cuda_bricks"):
                        one |= {"step_bytes": 0, "step_operations": 1e6}
                    for key in ("name", "run_name"):
                        one[key] = row[key].replace("box@32", f"box@{size}").replace("cuda_implicit_cached", backend)
                    result["benchmarks"].append(one)
        result["skipped"] = [{"name": f"{scene}/{backend}", "scene": scene, "backend": backend, "reason": "no"}
                             for scene, backend in skipped]
        return result

    def test_nobody_wins_a_dataset_without_the_main_contenders(self):
        times = {8: {"cuda_march": 1, "cpu_parallel": 2}, 16: {"gl_compute_implicit": 1, "cpu_parallel": 2},
                 32: {"cuda_march": 1, "cpu_parallel": 2, "gl_compute_implicit": 3}, 48: {"cpu_parallel": 1, "gl_compute_implicit": 2}}
        def told(skipped=()):
            self.page_of(self.boxes(times, skipped))
            text = html.unescape(self.out.read_text().replace("<wbr>", ""))
            return finding(self.out, "datasets"), re.findall('without the main contenders: ([^<]*)<', text)
        found, absent = told()
        self.assertEqual(absent, ["cuda_march was not measured here"])
        self.assertEqual(found[0], "cuda_march wins 2 and cpu_parallel wins 1 of 4 datasets")
        self.assertIn("nobody wins box@16, where what wins smaller and larger ones was not measured", found[1])
        # The backend that is fastest beyond the others was measured only here; backends that refuse a dataset were seen to do so.
        found, absent = told([("box@16", "cuda_march")])
        self.assertEqual((found[0], absent), ("cuda_march wins 2, cpu_parallel wins 1 and gl_compute_implicit wins 1 of 4 datasets", []))

    def test_a_ladder_of_sizes_is_the_headline(self):
        def headline(*winners):
            times = {size: dict.fromkeys(("cuda_resident", "cuda_bricks", "cuda_march", "cpu_parallel"), 3) | {winner: 1}
                     for size, winner in zip((8, 16, 32, 48, 64), winners)}
            self.page_of(self.boxes(times))
            return re.search("<h1>(.*?)</h1>", self.out.read_text())[1].replace("\N{NO-BREAK SPACE}", " ")
        on_chip = ("cuda_resident", "cuda_resident", "cuda_bricks", "cuda_march", "cuda_march")
        self.assertEqual(headline(*on_chip), "Box: on chip to 32.8 k, cuda_march from 111 k particles")
        self.assertEqual(headline("cpu_parallel", *on_chip[2:], "cuda_march"),
                         "Box: cpu_parallel to 512, on chip to 4.1 k, cuda_march from 32.8 k particles")
        # Without an order, and for one backend, wins are counted.
        self.assertEqual(headline("cuda_march", "cpu_parallel", "cuda_march", "cpu_parallel", "cuda_march"),
                         "cuda_march is the fastest on 3 of 5 datasets")
        self.assertEqual(headline(*["cpu_parallel"] * 5), "cpu_parallel is the fastest on 5 of 5 datasets")

    def test_machines_that_are_called_alike_are_kept_apart(self):
        """By cores, card and host; files without a host and without a known card by their folder."""
        cpu = result_files.load(H200.parent / "amd-epyc/fastest.json.gz")
        gpu = h200("table1")
        one, other = "GPU-12345678", "GPU-abcdef01"
        (self.folder / "c").mkdir()
        here = self.folder.resolve()
        for files, names in (
                ([("a/1.json", cpu, 2, "", ""), ("a/2.json", cpu, 2, "", "")], 2 * ["AMD EPYC"]),
                ([("a/1.json", cpu, 2, "", ""), ("b/2.json", cpu, 2, "", "")], ["AMD EPYC (a)", "AMD EPYC (b)"]),
                ([("a/1.json", cpu, 2, "", ""), ("a/2.json", cpu, 64, "", "")], ["AMD EPYC (2 cores)", "AMD EPYC (64 cores)"]),
                ([("a/1.json", cpu, 2, "one", ""), ("b/2.json", cpu, 2, "one", "")], 2 * ["AMD EPYC"]),
                ([("a/1.json", cpu, 2, "one", ""), ("a/2.json", cpu, 2, "two", "")], ["AMD EPYC (one)", "AMD EPYC (two)"]),
                ([("a/1.json", gpu, 16, "", one), ("b/2.json", gpu, 16, "", one)], 2 * ["NVIDIA H200"]),
                ([("a/1.json", gpu, 16, "", one), ("a/2.json", gpu, 16, "", other)], [f"NVIDIA H200 ({card})" for card in (one, other)]),
                ([("a/1.json", cpu, 2, "", ""), ("c/a/2.json", cpu, 2, "", "")],
                 [f"AMD EPYC ({here / 'a'})", f"AMD EPYC ({here / 'c/a'})"])):
            paths = []
            for place, result, cores, host, card in files:
                result = copy.deepcopy(result)
                result["context"] |= {"num_cpus": cores} | ({"host_name": host} if host else {})
                for backend in result["context"]["voxspring"]["backends"].values():
                    backend["uuid"] = card
                (self.folder / place).parent.mkdir(exist_ok=True)
                paths.append(self.write(place, result))
            self.assertEqual([result.machine for result in reading.read_all(paths)], names)
        # A user's results do not add to the committed ones.
        own = copy.deepcopy(cpu)
        own["context"]["date"] = "2027-01-02T03:04:05+00:00"
        committed = self.folder / "amd-epyc"
        committed.mkdir()
        (committed / "fastest.json.gz").write_bytes((H200.parent / "amd-epyc/fastest.json.gz").read_bytes())
        figures = self.make(committed, self.write("fastest.json", own))
        found = {row["machine"] for row in figures["datasets"]["rows"]}
        self.assertEqual(found, {"AMD EPYC (amd-epyc)", f"AMD EPYC ({self.folder.name})"})
        self.assertNotIn("history", figures)

    def test_edits_among_many_steps_and_among_few_are_kept_apart(self):
        """incision@256 has ten edits in 20 steps, all others have them in 1000."""
        paths = [result_files.named(H200, study) for study in ("edits", "fastest")]
        steps = {(row["edits"], row["steps"]) for path in paths for row in result_files.load(path)["benchmarks"] if row.get("edits")}
        self.assertEqual(steps, {(1, 1000), (10, 1000), (100, 1000), (10, 20)})
        figure = self.make(*paths)["edits"]
        self.assertEqual({panel["match"]["steps"] for panel in figure["panels"]}, {20, 1000})
        for panel in figure["panels"]:
            self.assertIn(f"in {panel['match']['steps']} steps", json.dumps(panel["spec"]))
        def middle(count, steps):
            of = [row for row in reading.measured(reading.read_all(paths)) if (row["edits"], row["steps"]) == (count, steps)]
            return statistics.median(100 * (row["microseconds"] / (row["without_edits"] * 1e6) - 1) for row in of)
        title, more = finding(self.out, "edits")
        self.assertRegex(title, rf"^100 edits slow 1000 steps down by {middle(100, 1000):.2g} % in the median of \d+ strategies$")
        self.assertIn(f"1000 steps by {middle(1, 1000):.2g} % (1 edit), {middle(10, 1000):.2g} % (10 edits), {middle(100, 1000):.2g} % "
                      f"(100 edits) and 20 steps by {middle(10, 20):.2g} % (10 edits)", more)

    def test_the_study_fastest_says_what_was_aimed_at(self):
        result = h200("table1")
        rows = [row for row in result["benchmarks"] if row.get("aggregate_name") == "median" and row["scene"] == "box@32"]
        best, other = sorted(rows, key=lambda row: row["real_time"])[:2]
        def winner(row):
            return {"name": row["name"].split("/iterations:")[0], "seconds_per_step": row["real_time"] * 1e-6}
        target = {"quantity": "seconds_per_step", "value": 7.5e-07, "backends": "cuda_*", "name": None,
                  "measured": best["real_time"] * 1e-6, "reached": 0.1, "met": False}
        ratio = {"quantity": "speed_ratio", "value": 0.95, "backends": "gl_compute_implicit", "over": "cuda_implicit_*", "name": None,
                 "measured": 0.9846, "reached": 1.03, "met": True}
        rate = {"quantity": "spring_updates_per_second", "value": 1e12, "backends": "cuda_*", "name": None, "measured": 928.2e9,
                "reached": 0.9, "met": False}
        start = {"quantity": "ready_seconds", "value": 0.5, "backends": "cuda_*", "name": best["name"].split("/iterations:")[0],
                 "measured": 0.4, "reached": 1.25, "met": True}
        undecided = {**start, "value": 2, "reached": 5, "met": None}
        unmeasured = {**target, "measured": None, "reached": None, "met": None}
        identity = {key: best[key] for key in ("scene", "backend", "formulation", "precision", "steps")}
        result["fastest"] = [{**winner(best), **identity,
                              "paper": {**winner(other), "ratio": 12.34}, "targets": [target, ratio, rate, start, undecided, unmeasured]}]
        for row in result["benchmarks"]:
            if row["run_name"] == best["run_name"]:
                row["ready_spread"] = 0.3
        best["noisy"] = ["its clock moved (by 12%)"]
        times = [row for row in result["benchmarks"] if row["run_type"] == "iteration" and row["run_name"] == best["run_name"]]
        self.assertEqual(len(times), 9)
        for row, share in zip(times, (0.8, 0.9, 0.9, 1, 1, 1, 1.1, 1.1, 1.2)):
            row["real_time"] = best["real_time"] * share
        self.page_of(result)
        text = self.out.read_text()
        self.assertEqual(text.count("time not to be trusted: its clock moved (by 12%)"), 1)
        self.assertEqual(len(re.findall(r"repetitions ± 10\W*%", text)), 1)
        self.assertIn(">12 times as fast as the best of the paper", text)  # repetitions differ by a tenth
        table = html.unescape(re.sub("<wbr>", "", text[text.index("<h3>Targets</h3>"):text.index("1 more target")]))
        rows = [[re.sub("<[^>]+>", "|", cell).strip("|").replace("\N{NO-BREAK SPACE}", " ")
                 for cell in re.findall("<t[hd][^>]*>(.*?)</t[hd]>", row)]
                for row in table.split("<tr data-scene")[1:]]
        measured = best["real_time"] * 1e3
        self.assertEqual(rows[0], ["box@32|position, float32", "cuda_*", "time per step", "750 ns", f"{measured:.3g} ns", "missed"])
        self.assertEqual(rows[1], ["box@32|position, float32", "gl_compute_implicit", "speed|as a multiple of cuda_implicit_*", "0.95",
                                   "0.985", "met"])
        self.assertEqual(rows[2][2:5], ["springs per second", "1 T springs/s", "928 G springs/s"])
        self.assertEqual(rows[3][3:], ["500 ms", "400 ms", "not decided"])  # 400 ms and 30% more are above the aim
        self.assertEqual(rows[4][3:], ["2 s", "400 ms", "not decided"])  # the file says so
        self.assertIn("1 more target was not measured here.", text)

    def alternatives(self):
        return [html.unescape(text) for text in re.findall('<img [^>]*alt="([^"]*)"', self.out.read_text())]

    def test_pictures_are_drawn_once_and_anew_by_a_newer_program(self):
        program, folder = write_program(self.folder), self.folder / "a/b"
        calls = pathlib.Path(f"{program}.calls")
        results = reading.read_all([H200 / "table1.json.gz"])
        def gather(*where):
            calls.write_text("")
            found, left_out = pictures.gather(results, *where)
            return found, left_out, [json.loads(line) for line in calls.read_text().splitlines()]
        first, left_out, drawn = gather(folder, program)
        self.assertEqual(left_out, [])
        self.assertEqual({(call[1], call[call.index("--colour") + 1]) for call in drawn},
                         set(itertools.product(("box@32", "heart"), pictures.COLOURED_BY)))
        for call in drawn:
            # The fastest of table1, and as many steps as keep float64 to a few seconds.
            self.assertEqual(call[call.index("--backend") + 1], "auto:formulation=position,precision=float32")
            self.assertEqual(call[call.index("--steps") + 1], {"box@32": "900", "heart": "1000"}[call[1]])
        self.assertEqual(gather(folder, program), (first, [], []))
        self.assertEqual(gather(folder, None), (first, [], []), "without a program: what is there")
        os.utime(program, (time.time() + 60, time.time() + 60))
        self.assertEqual(len(gather(folder, program)[2]), 4)
        found, left_out, drawn = gather(self.folder / "none", None)
        self.assertEqual((found, drawn), ({}, []))
        self.assertEqual(left_out, [(["heart", "box@32"], "no program was there to draw it")])
        # A program that ends without output, and one that does not end.
        program.write_text("#!/bin/sh\nexit 3\n")
        os.utime(program, (time.time() + 90, time.time() + 90))
        self.assertEqual(gather(folder, program)[:2], ({}, [(["heart", "box@32"], "exit code 3")]))
        program.write_text("#!/bin/sh\nexec sleep 60\n")
        with unittest.mock.patch.object(pictures, "SECONDS", 0.1):
            self.assertEqual(gather(folder, program)[:2], ({}, [(["heart", "box@32"], "not drawn within 0.1 seconds")]))

    def test_only_names_of_scenes_get_to_the_program(self):
        program = write_program(self.folder)
        evil = ["--out=x", "-h", "../box", "heart.json", "/etc/passwd", "box@8 --steps", "rope of mine", ""]
        result = h200("table1")
        rows = [row for row in result["benchmarks"] if row.get("aggregate_name") == "median"]
        result["benchmarks"] = [{**rows[0], "scene": scene, "particles": 8} for scene in evil + ["mine@8x8x9"]]
        results = reading.read_all([self.write("evil.json", result)])
        found, left_out = pictures.gather(results, self.folder / "pictures", program)
        self.assertEqual(list(found), ["mine@8x8x9"])
        self.assertEqual(left_out, [(evil, "no built-in scene has such a name")])
        calls = pathlib.Path(f"{program}.calls").read_text().splitlines()
        self.assertEqual({json.loads(line)[1] for line in calls}, {"mine@8x8x9"})

    def test_a_volume_named_like_a_built_in_scene_is_not_shown_as_that(self):
        result = h200("table1")
        rows = [row for row in result["benchmarks"] if row.get("aggregate_name") == "median" and row["scene"] == "heart"]
        result["benchmarks"] = [{**row, "particles": row["particles"] - 1} for row in rows]
        results = reading.read_all([self.write("mine.json", result)])
        found, left_out = pictures.gather(results, self.folder / "pictures", write_program(self.folder))
        self.assertEqual(found, {})
        self.assertEqual(left_out, [(["heart"], "the built-in scene of that name is another body")])

    def test_charts_are_written_as_files(self):
        """With a legend of only what they show, in colours that need no style, and equal every time."""
        folder, texts = self.folder / "a/figures", []
        for make in (report, start_report):
            made = make(H200 / "pareto.json.gz", H200 / "stability.json.gz", "--figures", folder)
            self.assertEqual(made.returncode, 0, made.stderr)
            paths = [pathlib.Path(line) for line in made.stdout.splitlines()]
            self.assertEqual(sorted(paths), sorted(folder.iterdir()))
            # Files of one machine may be of two cards, and names then say of which.
            texts.append({re.sub("-GPU-[0-9a-f]+", "", path.name): path.read_text() for path in paths})
            self.assertEqual(len(texts[-1]), len(paths))
        self.assertEqual(*texts)
        names = [f"{name}-{scene}-NVIDIA-H200.svg" for name in ("front", "curves") for scene in ("beam", "box@32", "heart")]
        self.assertEqual(sorted(texts[0]), sorted([*names, "map-box@8-NVIDIA-H200.svg", "stability-NVIDIA-H200.svg"]))
        front = texts[0]["front-heart-NVIDIA-H200.svg"]
        for text in ("total error (relative L2)", "cuda_resident", "increment"):
            self.assertIn(f">{text}<", front)
        self.assertRegex(front, r">heart, NVIDIA H200( \(GPU-[0-9a-f]+\))?<")
        self.assertNotIn(">cpu_parallel<", front, "it has no run there")
        # A number is whole in text, and short in attributes.
        self.assertIn(">0.0003<", texts[0]["map-box@8-NVIDIA-H200.svg"])
        for name, text in texts[0].items():
            self.assertNotIn("var(", text, name)
            self.assertIsNone(re.search(r'="[^"]*\d\.\d{3}', text), name)
        self.assertEqual(start_report(H200 / "pareto.json.gz").returncode, 2, "neither a page nor charts")
        refused = report(H200 / "pareto.json.gz", "--figures", self.write("file", ""))
        self.assertEqual((refused.returncode, refused.stdout, refused.stderr),
                         (2, "", f"report.py: --figures {self.folder / 'file'}: File exists\n"))

    def test_pictures_that_are_none_are_refused(self):
        good = png(ABOUT)
        self.assertEqual(pictures.read(self.write("good.png", good)).about, ABOUT)
        for bad, *words in ((b"GIF89a", "GIF89a", "PNG"), (good[:60], "cut off"), (good[:-1], "cut off"),
                            (good.replace(b"32768", b"32769"), "cut off"), (png([1]), "[1]", "an object"),
                            (png({"scene": "box@32"}), "voxspring.particles", "is missing"),
                            (png({**ABOUT, "coloured_by": "heat"}), "voxspring.coloured_by", "heat", "displacement, error"),
                            (png({**ABOUT, "largest": "much"}), "voxspring.largest", "much", "a number"),
                            (good.replace(b"tEXtvoxspring", b"tEXtvexspring"), "cut off or has no text")):
            with self.subTest(words), self.assertRaises(reading.BadInput) as refused:
                pictures.read(self.write("bad.png", bad))
            for word in ("bad.png", *words):
                self.assertIn(word, str(refused.exception))

    def test_without_pictures_there_is_a_line_or_nothing(self):
        self.make(H200 / "table1.json.gz", "--pictures", self.folder)
        self.assertEqual(self.alternatives(), [])
        self.assertEqual(re.findall("Without a picture: ([^<]*)<", self.out.read_text()),
                         ["heart and box@32 (no program was there to draw it)."])
        self.assertNotIn('class="picture', self.out.read_text())

    def test_pictures_of_the_program_itself(self):
        if "VOXSPRING" not in os.environ:
            self.skipTest("VOXSPRING does not name the program")
        result = h200("table1")
        small = {"heart": "heart@20x17x15", "box@32": "box@6"}
        program = os.environ["VOXSPRING"]
        count = {scene: json.loads(run(program, "info", scene, "--json").stdout)["active_particles"] for scene in small.values()}
        for row in result["benchmarks"]:
            row["name"] = row["name"].replace(row["scene"], small[row["scene"]])
            row.update(scene=small[row["scene"]], particles=count[small[row["scene"]]])
        folder = self.folder / "pictures"
        self.make(self.write("small.json", result), "--pictures", folder, "--program", program)
        if "no OpenGL" in self.out.read_text():
            self.skipTest("no OpenGL")
        alternatives = self.alternatives()
        self.assertEqual(len(alternatives), 5, "two each, and the one that opens the page")
        for scene in small.values():
            said = run(program, "run", scene, "--backend", "cpu_parallel:formulation=position", "--steps", 2000).stdout
            largest = float(re.search(r"largest displacement (\S+)", said)[1])
            self.assertIn(f"{scene} after 2000 steps of cpu_parallel position float32, coloured by displacement: at most "
                          f"{largest:.3g}", alternatives)
            self.assertRegex("\n".join(alternatives), rf"(?m)^{scene} .* error against float64: at most \d\.\de-\d")
        self.assertLess(max(path.stat().st_size for path in folder.iterdir()), 120_000)


if __name__ == "__main__":
    if reason := missing():
        print(f"skipped: {reason}")
        sys.exit(SKIPPED)
    from page import charts, pictures, reading
    unittest.main()
