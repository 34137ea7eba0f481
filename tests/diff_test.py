"""results/diff.py: verdicts, exit codes and output, on results made here and on the committed ones.

The current directory is the source tree.
"""

import collections
import contextlib
import copy
import io
import json
import os
import pathlib
import pty
import random
import subprocess
import sys
import tempfile
import termios
import unittest
from unittest import mock

import jsonschema

sys.path.insert(0, "results")
import comparison  # noqa: E402
import diff  # noqa: E402
import result_files  # noqa: E402

SCHEMA = json.loads(pathlib.Path("results/diff.schema.json").read_text())
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
COMMITTED = result_files.committed(pathlib.Path("results"))


def identity(backend, scene="box@8", tuning="block=128"):
    return {"name": f"{scene}/{backend}/increment/float32", "scene": scene, "backend": backend,
            "formulation": "increment", "precision": "float32", "tuning": tuning}


def result(rows=(), seed=1, device="Card", **lists):
    """A result with rows (backend, microseconds, further fields), 9 repetitions with 1% noise unless these say so."""
    generator = random.Random(seed)
    benchmarks = []
    for backend, time, fields in rows:
        fields = {"error_relative_l2": 1e-6, "error_max": 1e-7, "divergence": 1e-15, "steps": 100} | fields
        noise, count = fields.pop("noise", 0.01), fields.pop("count", 9)
        for _ in range(count):
            step = time * (1 + generator.gauss(0, noise))
            benchmarks.append(identity(backend) | {"run_type": "iteration", "real_time": step, "time_unit": "us",
                                                   "fraction_of_limit": 0.1 / step} | fields)
        benchmarks.append(identity(backend) | {"run_type": "aggregate", "real_time": 1e6 * seed})
    backends = {row[0]: {"device": device, "uuid": "GPU-1"} for row in rows}
    return {"context": {"date": "2026", "num_cpus": 2, "voxspring": {"commit": "1", "clean": True, "backends": backends,
                                                                      "study": {"name": "s"}}},
            "benchmarks": benchmarks, "verification": [], "failed": [], "skipped": []} | lists


PLAIN = [(name, 10, {}) for name in "abcdef"]


def changed(**fields):
    """PLAIN in another run, with the first row's time or fields changed."""
    return result([("a", fields.pop("time", 10), fields)] + PLAIN[1:], seed=2)


class Diff(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_diff(self, old, new, *options):
        """(exit code, standard output, standard error); old and new are results, texts or paths."""
        paths = []
        for name, content in (("old.json", old), ("new.json", new)):
            paths.append(content if isinstance(content, pathlib.Path) else self.folder / name)
            if paths[-1] is not content:
                paths[-1].write_bytes((content if isinstance(content, str) else json.dumps(content)).encode("latin-1"))
        out, err = io.StringIO(), io.StringIO()
        with mock.patch.object(sys, "argv", ["diff.py", *map(str, paths), *options]), \
                contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = diff.main()
            except SystemExit as exit_:
                code = exit_.code
        return code, out.getvalue(), err.getvalue()

    def judge(self, old, new, *options):
        """(exit code, the document, the verdict of each backend)"""
        code, out, err = self.run_diff(old, new, "--json", *options)
        self.assertIn(code, (0, 1), err)
        found = json.loads(out)
        VALIDATOR.validate(found)
        self.assertEqual(code, int(found["worse"]))
        self.assertEqual(sum(found["counts"].values()), len(found["rows"]))
        return code, found, {row["backend"]: row["verdict"] for row in found["rows"]}

    def assert_first(self, verdict, old, new, *options):
        """The verdict on a; the other rows are unchanged, so that the exit code follows from this verdict."""
        code, found, verdicts = self.judge(old, new, *options)
        self.assertEqual(verdicts.pop("a"), verdict)
        self.assertEqual(set(verdicts.values()), {"same"})
        self.assertEqual(code, int(verdict in comparison.WORSE))
        return next(row for row in found["rows"] if row["backend"] == "a")

    def assert_refused(self, words, old, new, *options):
        code, out, err = self.run_diff(old, new, *options)
        self.assertEqual((code, out), (2, ""), err)
        for word in words:
            self.assertIn(word, err)
        self.assertNotIn("Traceback", err)

    def test_time(self):
        for time, verdict, *options in ((10, "same"), (11, "slower"), (9, "faster"), (10.2, "same"), (11, "slower", "--threshold", "0.03"),
                                        (11, "same", "--threshold", "0.2")):
            row = self.assert_first(verdict, result(PLAIN), changed(time=time), *options)
            self.assertAlmostEqual(row["time"]["old"], 10e-6, delta=2e-7)
            low, high = row["time"]["interval"]
            self.assertTrue(low < row["time"]["ratio"] < high and low < time / 10 < high, row["time"])

    def test_few_repetitions_are_shown_and_decide_what_they_can(self):
        for count, p in ((3, 0.1), (4, 0.029)):
            row = self.assert_first("too few repetitions", result([("a", 10, {"count": count})] + PLAIN[1:]),
                                    changed(time=20, count=count))
            self.assertEqual(row["repetitions"], [count, count])
            self.assertAlmostEqual(row["time"]["ratio"], 2, delta=0.1)
            self.assertLess(row["time"]["interval"][0], row["time"]["ratio"])
            self.assertEqual((row["time"]["p"], row["time"]["q"]), (None, None))
            self.assertEqual(row["detail"], f"{count} and {count}, of which p is {p:.2g} at best; 9 are needed")
        # A single repetition has no interval.
        row = self.assert_first("too few repetitions", result(PLAIN), changed(time=20, count=1))
        self.assertEqual((row["time"]["interval"], row["time"]["spread"]), ([None, None], None))
        self.assertAlmostEqual(row["time"]["ratio"], 2, delta=0.1)
        code, text, _ = self.run_diff(result(PLAIN), changed(time=20, count=1))
        self.assertEqual(code, 0)
        self.assertRegex(text, r" x [12]\.\d+ +n = 9, 1\n    9 and 1, of which p is 0\.2 at best")
        # Eight repetitions can detect a change beyond three times the unknown noise, and five can if all rows agree.
        self.assert_first("slower", result(PLAIN), changed(time=20, count=8))
        self.assert_first("too few repetitions", result(PLAIN), changed(time=11, count=8))
        of_five = [result([(name, time, {"count": 5}) for name in "abcdef"], seed=time) for time in (10, 20)]
        self.assertEqual(self.judge(*of_five)[1]["counts"], {"slower": 6})
        of_five[1]["benchmarks"] = of_five[1]["benchmarks"][:6] + of_five[0]["benchmarks"][6:]
        self.assertEqual(self.judge(*of_five)[1]["counts"], {"too few repetitions": 6})

    def test_little_is_said_of_noisy_repetitions(self):
        for noise in (0.1, 0.3):
            self.assert_first("too noisy to tell", result(PLAIN), changed(time=11, noise=noise))
        # A run that calls itself noisy is believed, within limits; an error that grew still counts.
        noisy = {"noisy": ["the card's clock moved (between 1200 and 1980 MHz)"]}
        row = self.assert_first("too noisy to tell", result(PLAIN), changed(time=11, **noisy))
        self.assertIn("the card's clock moved", row["detail"])
        self.assertAlmostEqual(row["time"]["ratio"], 1.1, delta=0.03)
        row = self.assert_first("slower", result(PLAIN), changed(time=15, **noisy))
        self.assertIn("the card's clock moved", row["detail"])
        self.assert_first("same", result(PLAIN), changed(**noisy))
        self.assert_first("error grew", result(PLAIN), changed(time=11, error_max=1e-3, **noisy))
        self.assert_first("slower", result(PLAIN), changed(time=40, noise=0.1))

    def test_marked_rows_of_the_card_are_told_apart(self):
        """Half as slow again, nine of ten rows are called slower, marked ones among them. Of all files together, as a single one
        may have more marked rows than a tenth."""
        counts = collections.Counter()
        of_marked = collections.Counter()
        for path in COMMITTED:
            slower = result_files.load(path)
            rows = [row for row in slower.get("benchmarks", []) if row.get("run_type") == "iteration"]
            if "nvidia-h200" not in str(path) or not rows:
                continue
            marked = {row["name"].split("/iterations:")[0] for row in rows if row.get("noisy")}
            for row in slower["benchmarks"]:
                row["real_time"] *= 1.5
            found = self.judge(path, slower)[1]
            counts.update(found["counts"])
            of_marked.update(row["verdict"] for row in found["rows"]
                             if f"{row['scene']}/{row['contender'].replace(' ', '/')}" in marked)
        self.assertGreaterEqual(counts["slower"], 0.9 * sum(counts.values()))
        self.assertLessEqual(set(counts), {"slower", "too noisy to tell"})
        self.assertGreater(of_marked["slower"], 0)

    def test_the_rule(self):
        for verdict, ratio, low, high, noise, q in (
                ("slower", 1.1, 1.08, 1.12, 0.04, 0.009), ("too noisy to tell", 1.1, 1.08, 1.12, 0.041, 0.009),
                ("too noisy to tell", 1.1, 1.08, 1.12, 0.04, 0.011),
                ("too noisy to tell", 1.1, 0.99, 1.12, 0.04, 0.009),
                ("too noisy to tell", 1.049, 1.03, 1.06, 0.04, 0.009), ("same", 1.04, 1.03, 1.049, 0.04, 0.009),
                ("slower", 1.7, 1.61, 1.8, 0.2, 0.009), ("too noisy to tell", 1.7, 1.59, 1.8, 0.2, 0.009),
                ("too noisy to tell", 9, 8, 10, 0.21, 0.009)):
            for word, ends in ((verdict, (ratio, low, high)),
                               (verdict.replace("slower", "faster"), (1 / ratio, 1 / high, 1 / low))):
                time = {"ratio": ends[0], "interval": ends[1:], "noise": noise, "q": q}
                self.assertEqual(comparison.judge_time(time, 0.05), word, time)

    def test_load_that_spares_a_row_is_noise_of_its_device(self):
        loaded = result([("a", 12, {})] + [(name, 10, {"noise": 0.2}) for name in "bcdef"], seed=2)
        self.assertEqual(set(self.judge(result(PLAIN), loaded)[2].values()), {"too noisy to tell"})

    def test_false_discoveries_are_controlled(self):
        names = [f"b{index}" for index in range(300)]
        old, new = (result([(name, 10, {"noise": 0.04}) for name in names], seed=seed) for seed in (3, 4))
        found = self.judge(old, new, "--threshold", "1e-9")[1]
        self.assertTrue(any(row["time"]["p"] < comparison.FALSE_DISCOVERIES for row in found["rows"]))
        self.assertFalse(any(row["time"]["q"] < comparison.FALSE_DISCOVERIES for row in found["rows"]))

    def test_a_shift_of_all_rows_is_pointed_out(self):
        found = self.judge(result(PLAIN), result([(name, 11, {}) for name in "abcdef"], seed=2))[1]
        self.assertEqual(found["counts"], {"slower": 6})
        self.assertTrue(any("all 6 rows on Card moved together" in note for note in found["notes"]), found["notes"])

    def test_errors(self):
        total = [("a", 10, {"total_error_relative_l2": 1e-4, "total_error_uncertainty": 1e-9})] + PLAIN[1:]
        for verdict, fields, *more in (
                ("error grew", {"error_relative_l2": 2.2e-6}), ("error grew", {"error_max": 2.2e-6}),
                ("same", {"error_relative_l2": 1.2e-6}),
                ("error grew", {"error_max": 1e-6, "time": 11}), ("same", {"error_relative_l2": 2e-6}, PLAIN, "--error-factor", "3"),
                ("same", {"error_relative_l2": 2e-6, "divergence": 1.5e-6}), ("same", {"error_relative_l2": 2, "chaotic": True}),
                ("error grew", {"total_error_relative_l2": 2e-4}, total), ("same", {"total_error_relative_l2": None}, total),
                ("same", {}, total),
                ("too few repetitions", {"count": 3}), ("error grew", {"count": 3, "error_max": 1e-6})):
            with self.subTest(verdict=verdict, **fields):
                row = self.assert_first(verdict, result(more[0] if more else PLAIN), changed(**fields), *more[1:])
                if verdict == "error grew":
                    self.assertIn(list(fields)[-1] if "time" not in fields else "slower", row["detail"])

    def test_a_counter_that_no_script_names(self):
        """What a result's context describes is compared, is a column of the frame, and cannot hide a slower row."""
        def with_counter(result_, value, better="less"):
            result_["context"]["voxspring"]["counters"] = {"cache_misses_of_x": {"unit": "B", "better": better}}
            for row in result_["benchmarks"]:
                row["cache_misses_of_x"] = value if row["backend"] == "a" else 5
            return result_

        old = with_counter(result(PLAIN), 1000)
        for verdict, value, time, better in (("counter worse", 1100, 10, "less"), ("same", 1040, 10, "less"),
                                             ("counter better", 900, 10, "less"),
                                             ("counter worse", 900, 10, "more"), ("counter better", 1100, 10, "more"),
                                             ("same", 9, 10, "neither"),
                                             ("slower", 900, 11, "less"), ("counter worse", 1100, 11, "less"), ("same", None, 10, "less")):
            with self.subTest(value=value, time=time, better=better):
                old["context"]["voxspring"]["counters"]["cache_misses_of_x"]["better"] = better
                row = self.assert_first(verdict, old, with_counter(changed(time=time), value, better))
                self.assertEqual(verdict == "same", "cache_misses_of_x" not in row["detail"])
                self.assertEqual(row["counters"], {} if None in (value,) or better == "neither" else {"cache_misses_of_x": [1000, value]})
        self.assert_refused(["new.json: benchmarks[0].cache_misses_of_x: \"x\": expected a number"], old, with_counter(result(PLAIN), "x"))
        path = self.folder / "frame.json"
        path.write_text(json.dumps(old))
        self.assertEqual(set(result_files.frame([path]).cache_misses_of_x), {5, 1000})

    def test_errors_of_backends_whose_runs_differ(self):
        first = [("a", 10, {"spread": 3e-6})] + PLAIN[1:]

        def judged(deterministic, **fields):
            old, new = result(first), changed(spread=3e-6, **fields)
            for one in (old, new):
                one["context"]["voxspring"]["backends"]["a"]["deterministic"] = deterministic
            return next(row for row in self.judge(old, new)[1]["rows"] if row["backend"] == "a")["verdict"]

        for fields in ({"error_relative_l2": 4e-6, "error_max": 4e-7}, {"error_max": 4e-7}):
            self.assertEqual(judged(True, **fields), "error grew")
            self.assertEqual(judged(False, **fields), "same")
        self.assertEqual(judged(False, error_relative_l2=5e-6), "error grew")
        self.assertEqual(judged(False, error_max=5e-6), "error grew")

    def test_rows_of_one_file(self):
        failed, skipped = ([identity("a") | {"reason": reason}] for reason in ("diverged", "no driver"))
        whole, rest = result(PLAIN), PLAIN[1:]
        without = result(rest, failed=failed)
        for verdict, old, new, detail in (
                ("now fails", whole, without, "diverged"), ("gone", whole, result(rest, skipped=skipped), "no driver"),
                ("gone", whole, result(rest), ""),
                ("new", result(rest), whole, ""), ("new", without, whole, "failed before"),
                ("now fails", result(rest), without, "diverged"),
                ("still fails", without, without, "diverged"), ("not comparable", whole, changed(steps=50), "steps 100 -> 50")):
            self.assertIn(detail, self.assert_first(verdict, old, new)["detail"])

    def test_a_tuning_parameter_that_one_file_lacks(self):
        old, new = result(PLAIN), changed(tuning="block=128,root=hardware")
        self.assert_first("same", old, new)
        self.assert_first("same", new, old)
        for row in new["benchmarks"]:
            if row["tuning"] != "block=128":
                row["name"] += "/root=hardware"
        self.assertEqual(self.judge(old, new)[1]["counts"], {"new": 1, "gone": 1, "same": 5})
        self.assertEqual(self.judge(old, changed(tuning="block=64"))[1]["counts"], {"new": 1, "gone": 1, "same": 5})

    def test_other_kinds_of_studies(self):
        lists = {"pareto": {"fraction_of_stable": 0.5, "seconds": 1.0, "error_relative_l2": 1e-6, "diverged": False},
                 "stability": {"damping": 0.1, "start": {"kind": "random"}, "ratio": 1.0, "passed": True},
                 "stress": {"part": 1, "measurement": "rope", "steps": 5, "detail": "", "unit": "relative",
                            "gate_is": "at most", "measured": 1e-6, "passed": True}}
        for name, row in lists.items():
            row |= identity("a")
            for key, verdict in {"error_relative_l2": "error grew", "measured": "error grew", "passed": "now fails",
                                 "diverged": "now fails"}.items():
                if key in row:
                    new = row | {key: not row[key] if isinstance(row[key], bool) else 2 * row[key]}
                    self.assertEqual(self.judge(result(**{name: [row]}), result(**{name: [new]}))[2], {"a": verdict})
            other = {"pareto": "fraction_of_stable", "stability": "damping", "stress": "steps"}[name]
            apart = self.judge(result(**{name: [row]}), result(**{name: [row, row | {other: 7}]}))[1]["counts"]
            self.assertEqual(apart, {"new": 1, "too few repetitions" if name == "pareto" else "same": 1})

    def test_two_devices(self):
        old, new = result(PLAIN), result(PLAIN, seed=2, device="Other card")
        self.assert_refused(["new.json: context.voxspring.backends.a.device: \"Other card\": expected \"Card\"",
                             "--across-devices"], old, new)
        card = changed()
        self.assertEqual(self.judge(old, card)[1]["notes"], [])
        card["context"]["voxspring"]["backends"]["b"]["uuid"] = "GPU-2"
        self.assertEqual(self.judge(old, card)[1]["notes"], ["the card is another one of the same model"])
        other = result([("z", 10, {})])
        for option in ([], ["--across-devices"]):
            self.assert_refused(["new.json: rows: z: expected a backend that", "a, b, c"], old, other, *option)
        twice = copy.deepcopy(new)  # as much faster as its device's limits
        for row in twice["benchmarks"]:
            row["real_time"] /= 2
        found = self.judge(old, twice, "--across-devices")[1]
        self.assertEqual((found["counts"], found["time"]), ({"same": 6}, "times_limit"))
        for row in new["benchmarks"]:
            row["fraction_of_limit"] = row.get("fraction_of_limit", 0) / (1.1 if row["backend"] == "a" else 1)
        self.assert_first("slower", old, new, "--across-devices")
        for row in new["benchmarks"]:
            row["fraction_of_limit"] = None
        self.assertEqual(self.judge(old, new, "--across-devices")[1]["counts"], {"not comparable": 6})
        cores = [result(PLAIN), result(PLAIN)]
        for count, of in enumerate(cores):
            of["context"]["num_cpus"] = 2 + count
            for backend in of["context"]["voxspring"]["backends"].values():
                backend["uuid"] = ""
        self.assert_refused(["2 logical processors", "3 logical processors"], *cores)

    def test_bad_input(self):
        good = result(PLAIN)

        def with_row(key, value):
            new = copy.deepcopy(good)
            new["benchmarks"][3][key] = value
            return new

        about = good["context"]["voxspring"]
        cases = [(["missing.json", "No such file"], self.folder / "missing.json"), (["Expecting value"], "?"),
                 (["expected rows in any of"], result()),
                 (["the document", "[1]", "an object"], [1]), (["benchmarks", "{}", "an array"], good | {"benchmarks": {}}),
                 (["context", "null", "an object"], good | {"context": None}), (["failed[0]", "3", "an object"], good | {"failed": [3]}),
                 (["skipped[0].scene", "is missing", "a string"], good | {"skipped": [{"backend": "a"}]}),
                 (["benchmarks[3].noisy[0]: 1: expected a string"], with_row("noisy", [1])),
                 (["benchmarks[3].real_time: \"NaN\": expected"], json.dumps(with_row("real_time", "NaN")).replace('"NaN"', "NaN")),
                 (["context.voxspring: is missing: expected an object"], {"context": {}}),
                 (["context: 1: expected an object"], {"context": 1}),
                 (["is nested too deeply"], "[" * 100_000), (["Compressed file ended"], "\x1f\x8b"),
                 (["half a character", '"\\ud800"'], json.dumps(good).replace('"scene": "box@8"', '"scene": "\\ud800"'))]
        cases += [([f"benchmarks[3].{key}: {json.dumps(value)}: expected"], with_row(key, value)) for key, value in (
            ("real_time", 0), ("real_time", -1), ("real_time", "1"), ("real_time", True), ("backend", 3), ("real_time", "NaN"),
            ("error_max", -1),
            ("chaotic", 1), ("divergence", []), ("noisy", None), ("time_unit", "ns"))]
        cases += [([f"context.voxspring.{key}"], good | {"context": good["context"] | {"voxspring": about | {key: value}}})
                  for key, value in (
            ("backends", 3), ("backends", {"a": 3}), ("backends", {"a": {"uuid": 3}}), ("study", 3), ("study", {"name": 3}),
            ("counters", {"a": {}}))]
        for words, new in cases:
            self.assert_refused(["missing.json" if isinstance(new, pathlib.Path) else "new.json", *words], good, new)
        for option in ("--threshold=-1", "--threshold=x", "--threshold=nan", "--error-factor=1"):
            self.assert_refused([*option.split("="), "expected a number above"], good, good, option)
        self.assertEqual(self.run_diff(good, good, "--markdown", "--json")[0], 2)

    def test_tables(self):
        new = changed(time=11)
        code, text, _ = self.run_diff(result(PLAIN), new)
        self.assertEqual(code, 1)
        for word in ("slower", "10 us", "11", "old.json (s, commit 1)", "1 slower, 5 same"):
            self.assertIn(word, text)
        self.assertEqual(text.count("increment float32"), 1)
        self.assertEqual(self.run_diff(result(PLAIN), new, "--all")[1].count("increment float32"), 6)
        for row in new["benchmarks"]:
            row["scene"] = row["scene"] + "|[red]"
        new["failed"] = [identity("z") | {"reason": "two\nlines"}]
        self.assertIn("box@8|[red]", self.run_diff(result(PLAIN), new)[1])
        text = self.run_diff(result(PLAIN), new, "--markdown")[1]
        table = [line for line in text.splitlines() if line.startswith("|")]
        self.assertEqual(len(table), 2 + 6 + 6 + 1)
        self.assertEqual({line.replace("\\|", "").count("|") for line in table}, {10})

    def test_says_the_same_again(self):
        first, second = (self.run_diff(result(PLAIN), changed(time=10.4), "--json") for _ in range(2))
        self.assertEqual(first, second)

    def test_committed_results(self):
        self.assertGreater(len(COMMITTED), 10)
        for path in COMMITTED:
            with self.subTest(path):
                found = self.judge(path, path)[1]
                self.assertLessEqual(set(found["counts"]),
                                     {"same", "too few repetitions", "still fails", "too noisy to tell"})
        older, newer = (pathlib.Path(f"results/nvidia-h200/{name}.json.gz") for name in ("table1", "formulations"))
        steps = [{(row["scene"], row["backend"], row["formulation"], row["tuning"]): row["steps"]
                  for row in result_files.load(path)["benchmarks"]} for path in (older, newer)]
        otherwise = sum(steps[0][one] != steps[1][one] for one in steps[0].keys() & steps[1].keys())
        self.assertGreater(otherwise, 0)
        found = self.judge(older, newer)[1]
        self.assertEqual(found["counts"]["not comparable"], otherwise)

    def test_a_tenth_is_found_in_committed_results(self):
        """In nine of ten quiet rows at least: not marked by their run, and calmer than what the rule asks more of."""
        tried = 0
        for path in COMMITTED:
            content = result_files.load(path)
            rows = [row for row in content.get("benchmarks", []) if row.get("run_type") == "iteration"]
            if not rows or min(row["repetitions"] for row in rows) < comparison.MINIMUM_REPETITIONS:
                continue
            marked = {row["name"].split("/iterations:")[0] for row in rows if row.get("noisy")}
            slower = copy.deepcopy(content)
            for row in slower["benchmarks"]:
                row["real_time"] *= 1.1
            found = self.judge(path, slower)[1]
            quiet = [row["verdict"] for row in found["rows"]
                     if row["time"]["spread"] <= comparison.CALM * comparison.Rule.threshold
                     and f"{row['scene']}/{row['contender'].replace(' ', '/')}" not in marked]
            with self.subTest(path):
                self.assertGreaterEqual(quiet.count("slower"), 0.9 * len(quiet))
                self.assertNotIn("same", quiet)
                tried += len(quiet)
        print(f"{tried} quiet rows of committed results with a tenth added")

    def test_rows_are_whole_on_80_columns(self):
        """However long names are, two that differ only at their ends look different, and no word stands alone in a column."""
        tunings = [f"block=16x4x4,dependent_launch=on,fetch=l1,interior=mask,rest={rest}" for rest in ("skip", "flush")]
        old, new = result(PLAIN), result(PLAIN, seed=2)
        for one, factor in ((old, 1), (new, 1.3)):
            rows = [row for row in one["benchmarks"] if row["backend"] in "ab"]
            for row in rows:
                tuning = tunings["ab".index(row["backend"])]
                scene = "heart@480x408x368"
                row.update(scene=scene, tuning=tuning, name=f"{scene}/cuda_implicit_cached/compensated/float64/{tuning.replace(',', '/')}",
                           noisy=["the card's clock moved (between 1200 and 1980 MHz, of which the highest is 1980 MHz)"])
                row["real_time"] *= factor
        text = self.run_diff(old, new)[1]
        lines = text.split("\n")
        self.assertLessEqual(max(map(len, lines)), 80)
        self.assertEqual(text.count("\033"), 0, "a pipe has no colours")
        flat = " ".join(text.split())
        for tuning in tunings:
            self.assertIn("heart@480x408x368 cuda_implicit_cached compensated float64 " + tuning.replace(",", " "), flat)
        self.assertEqual(flat.count("the card's clock moved (between 1200 and 1980 MHz, of which the highest is 1980 MHz)"), 2)
        # The times of all rows begin in one column, and a row takes at most six lines.
        self.assertEqual(len({line.index("->") for line in lines if " us -> " in line}), 1)
        self.assertLessEqual(len(lines), 4 + 2 * 6 + 4)

    def test_a_terminal_has_colours_and_its_own_width(self):
        paths = []
        for name, one in (("old.json", result(PLAIN)), ("new.json", changed(time=11))):
            paths.append(self.folder / name)
            paths[-1].write_text(json.dumps(one))

        def shown(columns, **more):
            own, other = pty.openpty()
            termios.tcsetwinsize(own, (24, columns))
            environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "NO_COLOR")} | more
            with subprocess.Popen([sys.executable, "results/diff.py", *paths], stdout=other, env=environment) as process:
                os.close(other)
                said = b""
                with contextlib.suppress(OSError):  # this error marks the end of a terminal
                    while part := os.read(own, 4096):
                        said += part
                self.assertEqual(process.wait(), 1)
            os.close(own)
            return said.decode().replace("\r\n", "\n")
        self.assertIn("\033[31m  box@8 a increment float32\033[0m", shown(80))
        self.assertNotIn("\033", shown(80, NO_COLOR="1"))
        self.assertIn("old.json (s, commit 1) -> new.json (s, commit 1)", shown(80))
        self.assertIn("old.json (s, commit 1) -> new.json (s,", shown(40).replace("\n  ", " "))

    def test_missing_packages(self):
        (self.folder / "scipy.py").write_text("raise ImportError('No module named scipy')")
        command = [sys.executable, "results/diff.py", COMMITTED[0], COMMITTED[0]]
        environment = os.environ | {"PYTHONPATH": str(self.folder)}
        said = subprocess.run(command, env=environment, capture_output=True, text=True)
        self.assertEqual(said.returncode, 2, said.stderr)
        self.assertIn("install Debian's python3-scipy and python3-fastjsonschema, or with pip scipy and fastjsonschema", said.stderr)

    def test_help_needs_no_package(self):
        for script in ("diff", "report"):
            # Without the folders in which packages are installed.
            said = subprocess.run([sys.executable, "-E", "-S", f"results/{script}.py", "--help"], capture_output=True, text=True)
            self.assertEqual((said.returncode, said.stderr), (0, ""))
            self.assertIn(f"Usage: {script}.py", said.stdout)


class FalseAlarms(unittest.TestCase):
    """results/false_alarms.py."""

    def compare(self, *results, options=()):
        with tempfile.TemporaryDirectory() as folder:
            paths = [pathlib.Path(folder, f"{number}.json") for number in range(len(results))]
            for path, one in zip(paths, results):
                path.write_text(json.dumps(one))
            return subprocess.run([sys.executable, "results/false_alarms.py", *options, *paths], capture_output=True, text=True,
                                  check=False)

    def test_runs_of_one_program_differ_by_noise_alone(self):
        found = self.compare(*(result(PLAIN, seed=seed) for seed in range(1, 8)))
        self.assertEqual((found.returncode, found.stderr), (0, ""))
        self.assertIn("21 pairs of s (commit 1): 0 false alarms in 126 rows", found.stdout)

    def test_a_row_that_differs_is_one_in_each_of_its_pairs(self):
        found = self.compare(result(PLAIN, seed=3), result(PLAIN, seed=4), changed(time=11))
        self.assertEqual(found.returncode, 1)
        self.assertEqual(found.stdout.count("slower: box@8 a"), 2)
        self.assertIn("2 false alarms in 18 rows", found.stdout)

    def test_rates(self):
        rows = [[(name, time, {}) for name in "abcdef"] for time in (10, 10, 10, 20)]
        said = self.compare(*(result(own, seed=seed) for seed, own in enumerate(rows, 1)), options=("--in-pairs", "--multiplied"))
        self.assertEqual((said.returncode, said.stderr), (1, ""))
        for change, worse, verdicts in (("as they are", 1, "6 slower, 6 same"), ("second 1.1 times as slow", 2, "12 slower"),
                                        ("second with twice the error", 2, "12 error grew")):
            self.assertIn(f"the rule, {change}: {worse} of 2 pairs worse\n    12 rows: {verdicts}\n", said.stdout)

    def test_refuses_what_is_not_of_one_program_and_card(self):
        other = result(PLAIN)
        other["context"]["voxspring"]["commit"] = "2"
        found = self.compare(result(PLAIN), other)
        self.assertEqual(found.returncode, 2)
        self.assertIn("commit: 2 is not accepted; expected 1", found.stderr)
        self.assertEqual(self.compare(result(PLAIN)).returncode, 2)


if __name__ == "__main__":
    unittest.main()
