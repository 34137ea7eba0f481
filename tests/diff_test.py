"""results/diff.py: verdicts, exit codes and output, on results made here and on the committed ones.

The current directory is the source tree.
"""

import collections
import copy
import dataclasses
import json
import os
import pathlib
import random
import re
import sys
import unittest
from unittest import mock

import jsonschema
import numpy

import attack_test
from folder import InTemporaryFolder, called, run
from terminal import on_terminal

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


class Diff(InTemporaryFolder):
    def run_diff(self, old, new, *options):
        """(exit code, standard output, standard error); old and new are results, texts or paths."""
        paths = [content if isinstance(content, pathlib.Path) else
                 self.write(name, content.encode("latin-1") if isinstance(content, str) else content)
                 for name, content in (("old.json", old), ("new.json", new))]
        with mock.patch.object(sys, "argv", ["diff.py", *map(str, paths), *options]):
            ran = called(diff.main)
        return ran.returncode, ran.stdout, ran.stderr

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
        for time, verdict, *options in ((10, "same"), (11, "slower"), (9, "faster"), (10.2, "same"), (11, "slower", "--threshold", "0.08"),
                                        (11, "same", "--threshold", "0.2")):
            row = self.assert_first(verdict, result(PLAIN), changed(time=time), *options)
            self.assertAlmostEqual(row["time"]["old"], 10e-6, delta=2e-7)
            low, high = row["time"]["interval"]
            self.assertTrue(low < row["time"]["ratio"] < high and low < time / 10 < high, row["time"])

    def test_few_repetitions_decide_what_they_can(self):
        noisy = "too noisy to tell"
        for count, time, verdict in ((3, 20, "slower"), (3, 10.6, noisy), (2, 10.6, noisy), (1, 20, noisy)):
            row = self.assert_first(verdict, result([("a", 10, {"count": count})] + PLAIN[1:]), changed(time=time, count=max(2, count)))
            self.assertEqual(row["repetitions"], [count, max(2, count)])
            self.assertAlmostEqual(row["time"]["ratio"], time / 10, delta=0.1)
        # What is known of a row that has no repetitions in one file is its ratio.
        self.assertEqual((row["time"]["interval"], row["time"]["spread"], row["time"]["least"]), ([None, None], None, None))
        code, text, _ = self.run_diff(result(PLAIN), changed(time=20, count=1))
        self.assertEqual(code, 0)
        self.assertRegex(text, r" x [12]\.\d+ +n = 9, 1\n")

    def test_lone_rows_are_granted_what_nobody_measured(self):
        """Too few rows tell nothing of how runs differ; ten times as long is not missed, however few they are."""
        for clock, time, verdict in (("CUDA event", 12.5, "too noisy to tell"), ("CUDA event", 14, "slower"),
                                     ("steady_clock", 26, "too noisy to tell"), ("steady_clock", 100, "slower")):
            old, new = result(PLAIN[:2]), result([("a", time, {}), PLAIN[1]], seed=2)
            for one in (old, new):
                for backend in one["context"]["voxspring"]["backends"].values():
                    backend["clock"] = clock
            self.assertEqual(self.judge(old, new)[2], {"a": verdict, "b": "same"})

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
        """Half as slow again, rows that their run marked can be called slower, and no other row is."""
        counts = collections.Counter()
        for path in COMMITTED:
            slower = result_files.load(path)
            rows = [row for row in slower.get("benchmarks", []) if row.get("run_type") == "iteration"]
            names = {row["run_name"] for row in rows if row.get("noisy")}
            if "nvidia-h200" not in str(path) or not names:
                continue
            attack_test.slow(slower, 1.5, lambda _, row, own=names: row["run_name"] in own)
            found = self.judge(path, slower)[1]["rows"]
            names = {name.split("/iterations")[0] for name in names}
            counts.update((row["verdict"], f"{row['scene']}/{row['contender'].replace(' ', '/')}" in names) for row in found)
        self.assertGreater(counts["slower", True], 0)
        self.assertEqual({verdict for verdict, one in counts if not one}, {"same", "too noisy to tell"})

    def test_the_noise(self):
        """Standard errors are those of a bootstrap; Qn estimates the deviation of normal values, and of half of them if others change."""
        generator = numpy.random.default_rng(1)
        for count in (3, 9, 25):
            sample = numpy.exp(generator.normal(0, 0.1, count))
            resampled = numpy.median(numpy.log(generator.choice(sample, (20000, count))), axis=1)
            self.assertAlmostEqual(comparison.squared_error(sample)**0.5 / numpy.std(resampled), 1, delta=0.02)
        for count in (4, 5, 6, 9, 12, 33, 300):
            samples = generator.normal(3, 0.01, (4000 // count, count))
            self.assertAlmostEqual(numpy.mean([comparison.scale_of(sample) for sample in samples]), 0.01, delta=0.0005)
        changed_half = samples + 0.3 * (numpy.arange(300) < 130)
        self.assertLess(numpy.mean([comparison.scale_of(sample) for sample in changed_half]), 0.03)
        # Differences that the errors of the medians explain are not counted as noise between runs.
        errors = generator.uniform(0.001, 0.03, 300)
        for between in (0, 0.01):
            values = generator.normal(0, 1, 300) * numpy.hypot(between, errors)
            self.assertAlmostEqual(comparison.noise_between(values, errors), between, delta=0.003)

    @staticmethod
    def judge_made(generator, within, between, factors, threshold=0.05):
        """The verdicts on rows whose times were multiplied, and the shift of the run, with noise of either kind."""
        files = numpy.exp(generator.normal(0, within, (2, len(factors), 9)))
        files[1] *= numpy.exp(between * generator.standard_t(4, (len(factors), 1))) * numpy.reshape(factors, (-1, 1))
        rows = [{"time": comparison.compare_times(*times), "repetitions": [9, 9]} for times in files.swapaxes(0, 1)]
        timed = [comparison.Timed(row, ("", ""), "", ("", ""), False, False) for row in rows]
        verdicts, shifts = comparison.judge_times(timed, threshold)
        return verdicts, shifts[0] if shifts else None

    def test_many_rows_that_changed_hide_none(self):
        generator = numpy.random.default_rng(1)
        for _ in range(10):
            changed_ = numpy.arange(100) < 45
            # No row stands out where nearly half changed, but all that changed did so in one direction.
            verdicts, shift = self.judge_made(generator, 0.003, 0.01, 1 + 0.1 * changed_)
            self.assertEqual((shift["verdict"], shift["slow"] > 35, shift["ratio"] < 1.05), ("slower", True, True))
            # Where most are faster, the others are not slower.
            verdicts, shift = self.judge_made(generator, 0.003, 0.005, 1 - 0.1 * ~changed_)
            self.assertEqual((verdicts.count("slower"), shift["verdict"]), (0, "faster"))

    def test_false_alarms_per_file(self):
        """Of files in which nothing changed, at most 5% have an alarm without a threshold: by noise of either kind and drift."""
        generator = numpy.random.default_rng(1)
        for count, within, between in ((5, 0.01, 0.01), (8, 0.01, 0), (60, 0.003, 0.01), (60, 0.02, 0.003)):
            alarms = 0
            for _ in range(400):
                alarms += set(self.judge_made(generator, within, between, [1.006] * count, 1e-12)[0]) & {"slower", "faster"} != set()
            self.assertLessEqual(alarms, 0.05 * 400 + 3 * (0.05 * 0.95 * 400)**0.5, (count, within, between))
            self.assertGreater(alarms, 0, "no alarm at all: nothing was tried")

    def test_one_row_of_many(self):
        names = [f"b{index}" for index in range(331)]
        generator = random.Random(5)

        def run(seed, drift=1, **others):
            return result([(name, 10 * drift * others.get(name, 1) * (1 + generator.gauss(0, 0.003)), {"noise": 0.003}) for name in names],
                          seed=seed)

        old = run(3)
        for drift, factor, verdict in ((1, 1.1, "slower"), (1.006, 10, "slower"), (1.04, 1.1, "slower"), (0.97, 1 / 1.1, "faster")):
            code, found, verdicts = self.judge(old, run(4, drift, b7=factor))
            self.assertEqual((verdicts.pop("b7"), set(verdicts.values()), code), (verdict, {"same"}, int(verdict == "slower")))
            self.assertAlmostEqual(found["shifts"][0]["ratio"], drift, delta=0.001)
            self.assertEqual(drift != 1, any("the run as a whole moved" in note for note in found["notes"]), found["notes"])
        # A whole run is slower by itself, and so is half of one, of which no row can stand out.
        for share, fails, verdicts in ((1, 1, {"same"}), (0.5, 1, {"same", "slower", "too noisy to tell"}), (0, 0, {"same"})):
            slow = {name: 1.1 for name in names if generator.random() < share}
            code, found, judged = self.judge(old, run(6, **slow))
            self.assertEqual((code, found["shifts"][0]["verdict"]), (fails, "slower" if fails else "same"))
            self.assertLessEqual(set(judged.values()), verdicts)
            self.assertEqual(bool(found["fails"]), bool(fails))
        # Most rows are faster: those that are as they were are not slower.
        fast = {name: 0.9 for name in names if generator.random() < 0.6}
        self.assertEqual(self.judge(old, run(7, **fast))[0], 0)

    def test_what_is_at_the_threshold_is_not_noise(self):
        calm = [(name, 10, {"noise": 1e-4}) for name in "abcdef"]
        for time, verdict in ((10 * 1.05, "slower"), (10 * 1.0499, "same"), (10 / 1.05, "faster")):
            new = copy.deepcopy(result(calm))
            for row in new["benchmarks"]:
                row["real_time"] *= time / 10 if row["backend"] == "a" else 1
            self.assert_first(verdict, result(calm), new)

    def test_load_that_spares_a_row_is_noise_of_its_device(self):
        loaded = result([("a", 12, {})] + [(name, 10, {"noise": 0.2}) for name in "bcdef"], seed=2)
        self.assertEqual(set(self.judge(result(PLAIN), loaded)[2].values()), {"too noisy to tell"})

    def test_a_shift_of_few_rows_is_theirs(self):
        found = self.judge(result(PLAIN), result([(name, 11, {}) for name in "abcdef"], seed=2))[1]
        self.assertEqual((found["counts"], found["shifts"]), ({"slower": 6}, []))

    def test_errors(self):
        total = [("a", 10, {"total_error_relative_l2": 1e-4, "total_error_uncertainty": 1e-9})] + PLAIN[1:]
        for verdict, fields, *more in (
                ("error grew", {"error_relative_l2": 2.2e-6}), ("error grew", {"error_max": 2.2e-6}),
                ("same", {"error_relative_l2": 1.2e-6}),
                ("error grew", {"error_max": 1e-6, "time": 11}), ("same", {"error_relative_l2": 2e-6}, PLAIN, "--error-factor", "3"),
                ("same", {"error_relative_l2": 2e-6, "divergence": 1.5e-6}), ("same", {"error_relative_l2": 2, "chaotic": True}),
                ("error grew", {"total_error_relative_l2": 2e-4}, total), ("same", {"total_error_relative_l2": None}, total),
                ("same", {}, total),
                ("error grew", {"error_max": None}), ("error grew", {"count": 3, "error_max": 1e-6})):
            with self.subTest(verdict=verdict, **fields):
                row = self.assert_first(verdict, result(more[0] if more else PLAIN), changed(**fields), *more[1:])
                if verdict == "error grew":
                    self.assertIn(list(fields)[-1] if "time" not in fields else "slower", row["detail"])

    def test_errors_that_changed_by_less_are_told(self):
        for error, ratio in ((1.4e-7, "1.4"), (0.5e-7, "0.5"), (1e-7 * (1 + 1e-12), "1")):
            notes = self.judge(result(PLAIN), changed(error_max=error))[1]["notes"]
            self.assertTrue(any(f"1 errors changed, so bits differ, but none grew enough to count; the largest change is x {ratio} (box@8 a" in note
                                for note in notes), notes)
        self.assertEqual(self.judge(result(PLAIN), changed())[1]["notes"][1:], [], "errors that did not change")

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
        self.assertEqual(set(result_files.frame([self.write("frame.json", old)]).cache_misses_of_x), {5, 1000})

    def test_a_counter_of_seconds_or_joules_is_a_time(self):
        def with_counter(value, unit):
            result_ = result(PLAIN)
            result_["context"]["voxspring"]["counters"] = {"waiting": {"unit": unit, "better": "less"}}
            result_["benchmarks"] = [row | {"waiting": value} for row in result_["benchmarks"]]
            return result_

        for unit, service in (("s", "latency"), ("J", "energy")):
            found = self.judge(with_counter(1, unit), with_counter(4, unit))[1]
            self.assertEqual({(row["unit"], row["verdict"]) for row in found["rows"] if row["place"]}, {(unit, "slower")})
            exported = json.loads(self.run_diff(with_counter(1, unit), with_counter(4, unit), "--format", "bmf")[1])
            self.assertEqual({key for name, one in exported.items() if "waiting" in name for key in one}, {service})
            for value in ("x", -1, [1], True):
                self.assert_refused([f"new.json: benchmarks[0].waiting: {json.dumps(value)}: expected a number that is not"],
                                    with_counter(1, unit), with_counter(value, unit))

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

    def test_a_scene_that_is_stepped_twice_has_two_rows(self):
        """A study file may name a scene twice, with other numbers of steps. Each has its own verdict and its own repetitions."""
        def twice(slower):
            long = [(name, time * slower, fields | {"steps": 200, "error_max": 2e-7}) for name, time, fields in PLAIN]
            rows = [row for row in result(PLAIN + long)["benchmarks"] if row["run_type"] == "iteration"]
            verdicts = [identity(name) | {"steps": steps, "error_max": error, "repetitions_judged": 9}
                        for name, *_ in PLAIN for steps, error in ((100, 1e-7), (200, 2e-7))]
            rows = [row | {"repetitions": 9, "run_name": row["name"]} for row in rows]
            return result(PLAIN) | {"benchmarks": rows, "verification": verdicts}

        found = self.judge(twice(1), twice(2))[1]
        self.assertEqual([(row["repetitions"], row["verdict"]) for row in found["rows"]],
                         6 * [([9, 9], "slower")] + 6 * [([9, 9], "same")])
        judged = result_files.medians([row | {"aggregate_name": "median"} for row in twice(1)["benchmarks"][::9]], [
            verdict | {"tolerance_rms": verdict["steps"], "motion_rms": 1, "tolerance": 1} for verdict in twice(1)["verification"]])
        self.assertEqual([row["bound"] for row in judged], 6 * ["1.0e+02"] + 6 * ["2.0e+02"])

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
                            "gate_is": "at most", "measured": 1e-6, "passed": True},
                 "haptic": {"hertz": 1000, "edited": False, "median_seconds": 1e-5, "force_error": 1e-7},
                 "truth": {"particles_at": "corners", "strain": "small", "across": 4, "seconds": 1.0, "steps": 80, "model_error": 0.01,
                           "continuum_error": 1e-4}}
        for name, row in lists.items():
            row |= identity("a")
            for key, verdict in {"error_relative_l2": "error grew", "measured": "error grew", "passed": "now fails",
                                 "diverged": "now fails", "force_error": "error grew", "model_error": "error grew"}.items():
                if key in row:
                    new = row | {key: not row[key] if isinstance(row[key], bool) else 2 * row[key]}
                    self.assertEqual(self.judge(result(**{name: [row]}), result(**{name: [new]}))[2], {"a": verdict})
            other = {"pareto": "fraction_of_stable", "stability": "damping", "stress": "steps", "haptic": "hertz", "truth": "across"}[name]
            apart = self.judge(result(**{name: [row]}), result(**{name: [row, row | {other: 7}]}))[1]["counts"]
            self.assertEqual(apart, {"new": 1, "same": 1})

    def test_rows_of_truth_pair_by_case(self):
        def row(**fields):
            return identity("a") | {"particles_at": "corners", "strain": "small", "across": 4, "seconds": 1.0, "steps": 80, "model_error": 0.01,
                                    "continuum_error": 1e-4} | fields

        old = result(truth=[row(), row(strain="large"), row(particles_at="centres")])
        self.assertEqual(self.judge(old, old)[1]["counts"], {"same": 3})
        found = self.judge(old, result(truth=[row(model_error=0.02), row(strain="large", steps=120), row(particles_at="centres")]))[1]
        self.assertEqual([(of["verdict"], of["place"]["strain"]) for of in found["rows"]][0], ("error grew", "small"))
        self.assertEqual(found["counts"], {"error grew": 1, "same": 2})
        # An error below what the finite elements tell is no growth.
        self.assertEqual(self.judge(result(truth=[row(model_error=1e-5)]), result(truth=[row(model_error=1e-4)]))[1]["counts"], {"same": 1})

    def test_times_and_energies_of_every_kind(self):
        """A row of twelve that takes a tenth longer is found by what runs differ by, though a kind has no repetitions."""
        def study(name, place, fields, slow="", seed=1):
            generator = random.Random(seed)
            rows = [identity(f"b{index}") | place | {
                key: value * (1 + generator.gauss(0, 0.002)) * (1.1 if key == slow and index == 3 else 1) for key, value in fields.items()}
                for index in range(12)]
            return result(**{name: [row | {"run_type": "iteration"} for row in rows for _ in range(2 if name == "benchmarks" else 1)]})

        for name, place, fields in (
                ("pareto", {"fraction_of_stable": 0.5}, {"seconds": 1.0}),
                ("energy", {}, {"seconds_per_step": 1e-6, "joules_per_step": 1e-4}),
                ("overhead", {"handed_over": "one by one"}, {"seconds_per_step": 2e-6, "host_seconds_per_step": 1e-6}),
                ("scaling", {"ranks": 2, "cut": "z", "way": "nccl"}, {"seconds_per_step": 1e-5}),
                ("truth", {"particles_at": "corners", "strain": "small", "across": 4}, {"seconds": 1.0}),
                ("haptic", {"hertz": 1000, "edited": False}, {"median_seconds": 1e-5, "p99_seconds": 3e-5}),
                ("benchmarks", {}, {"real_time": 10, "ready_seconds": 2.0, "warm_ready_seconds": 0.2, "edit_seconds_median": 1e-5})):
            old = study(name, place, fields)
            for first, key in enumerate(fields):
                with self.subTest(name=name, key=key):
                    found = self.judge(old, study(name, place, fields, key, 2))[1]
                    slower = [(row["backend"], row["place"].get("measured"), row["unit"]) for row in found["rows"]
                              if row["verdict"] == "slower"]
                    self.assertEqual(slower, [("b3", key if first else None, "J" if "joules" in key else "s")])
            if name in ("overhead", "scaling", "haptic"):
                verified = study(name, place, fields)
                for row in verified[name]:
                    row["passed"] = True
                for one, other, verdict in ((verified, old, "not comparable"), (old, verified, "same")):
                    rows = [row for row in self.judge(one, other)[1]["rows"] if "measured" not in row["place"]]
                    self.assertEqual({row["verdict"] for row in rows}, {verdict}, "its state is verified or not")
            code, found, _ = self.judge(old, study(name, place, fields, seed=3))
            self.assertEqual(code, 0)
            # A start that every repetition of its row repeats was measured once.
            self.assertLessEqual({tuple(row["repetitions"]) for row in found["rows"] if "measured" in row["place"]}, {(1, 1)})
        # What a result's context calls a counter in seconds is a time as well.
        old, new = (study("overhead", {}, {"seconds_per_step": 1e-6, "wait": 1.0}, *slow) for slow in ((), ("wait", 2)))
        for one in (old, new):
            one["context"]["voxspring"]["counters"] = {"wait": {"unit": "s", "better": "less"}}
        self.assertEqual(self.judge(old, new)[1]["fails"], ["1 slower"])

    def test_sustained_times_are_judged_as_those_of_the_device(self):
        def one(seed, factor=1, of="a"):
            noise = random.Random(seed)
            made = result([(name, 10, {"sustained_seconds_per_step": 11e-6 * (1 + noise.gauss(0, 0.003)) * (factor if name in of else 1),
                                       "sustained_watts": 600 * factor, "limit_sum_seconds": 1e-6 * factor})
                           for name in "abcdefgh"], seed)
            made["context"]["voxspring"]["counters"] = {
                "sustained_seconds_per_step": {"unit": "s", "better": "less"}, "sustained_watts": {"unit": "W", "better": "neither"},
                "limit_sum_seconds": {"unit": "s", "better": "neither"}}
            return made

        found = self.judge(one(1), one(2, 1.25))[1]
        slower = [(row["backend"], row["place"]) for row in found["rows"] if row["verdict"] not in ("same", "too noisy to tell")]
        self.assertEqual(slower, [("a", {"measured": "sustained_seconds_per_step"})])
        code, found, _ = self.judge(one(1), one(2))
        self.assertEqual((code, found["fails"]), (0, []))
        # A device's clock tells a shift of all rows that a host's would not.
        fails = self.judge(one(1), one(2, 1.1, "abcdefgh"))[1]["fails"]
        self.assertEqual(len(fails), 1)
        self.assertIn("slower as a whole: x 1.1", fails[0])
        # Files without such times are compared as they were.
        self.assertEqual(self.judge(result(PLAIN), changed())[1]["counts"], {"same": 6})
        self.assertEqual(self.judge(result(PLAIN), one(2))[0], 0)

    def test_the_setup_is_compared(self):
        def one(**context):
            made = result([(*row[:2], {"min_card_mhz": context.get("mhz", 1980)}) for row in PLAIN])
            made["context"] |= {"num_cpus": 2, "load_avg": context.get("load_avg", [0.1, 0, 0])}
            for key, value in {"kernel_compiler": "NVRTC 13", "highest_mhz": {"sm": 1980}}.items():
                for backend in made["context"]["voxspring"]["backends"].values():
                    backend[key] = context.get(key, value)
            made["context"]["voxspring"] |= {"driver": context.get("driver", "580"), "os": context.get("os", "Linux"), "card": {
                key: context.get(key, value) for key, value in
                {"ecc": True, "mig": False, "power_limit_watts": 700, "temperature_celsius": 36}.items()}}
            return made

        self.assertEqual(self.judge(one(), one(temperature_celsius=40, load_avg=[0.4]))[1]["setup"], [])
        for key, value in {"driver": "590", "os": "BSD", "ecc": False, "mig": True, "power_limit_watts": 690, "kernel_compiler": "NVRTC 14",
                           "highest_mhz": {"sm": 1755}, "mhz": 1500, "load_avg": [2]}.items():
            with self.subTest(key):
                code, found, _ = self.judge(one(), one(**{key: value}))
                self.assertEqual((code, len(found["setup"])), (0, 1), found["setup"])
                self.assertIn({"mhz": "MHz"}.get(key, key), found["setup"][0])
                self.assertIn(" -> ", found["setup"][0])
                code, found, _ = self.judge(one(), one(**{key: value}), "--fail-on", "setup")
                self.assertEqual((code, len(found["fails"])), (1, 1))
                self.assertIn("setup: ", self.run_diff(one(), one(**{key: value}))[1])
        self.assertEqual(self.judge(one(), one(), "--fail-on", "setup")[0], 0)

    def test_fail_on(self):
        whole = result(PLAIN)
        for what, new in (("missing", result(PLAIN[1:])), ("missing", changed(steps=50)), ("undecided", changed(time=10.6, noise=0.1))):
            with self.subTest(what):
                self.assertEqual(self.judge(whole, new)[0], 0)
                code, found, _ = self.judge(whole, new, "--fail-on", "setup", "--fail-on", what)
                self.assertEqual(code, 1)
                self.assertIn("fails: ", self.run_diff(whole, new, "--fail-on", what)[1])
        self.assertEqual(self.judge(whole, changed(), "--fail-on", "missing", "--fail-on", "undecided")[0], 0)
        with_starts = result([(*row[:2], {"ready_seconds": 1.0}) for row in PLAIN])
        self.assertEqual(self.judge(with_starts, whole, "--fail-on", "missing")[1]["fails"], ["no ready_seconds"])
        self.assertEqual(self.judge(whole, with_starts, "--fail-on", "missing")[0], 0)
        notes = self.judge(whole, result(PLAIN[1:]))[1]["notes"]
        self.assertIn("the new file has no row of a", notes)
        new = result([(*row[:2], {"steps": 7}) for row in PLAIN])
        self.assertTrue(any("nothing was judged" in note for note in self.judge(whole, new)[1]["notes"]))
        self.assertEqual(self.run_diff(whole, whole, "--fail-on", "x")[0], 2)

    def test_exports(self):
        """What a service reads, by a schema after its documentation: bencher.dev/docs/reference/bencher-metric-format and the README of
        github-action-benchmark."""
        number = {"type": "number"}
        metric = {"type": "object", "required": ["value"], "additionalProperties": False,
                  "properties": {"value": number, "lower_value": number, "upper_value": number}}
        bmf = {"type": "object", "minProperties": 1, "propertyNames": {"minLength": 1, "maxLength": 1024}, "additionalProperties": {
            "type": "object", "minProperties": 1, "propertyNames": {"pattern": "^[a-z0-9-]{1,64}$"}, "additionalProperties": metric}}
        text = {"type": "string", "minLength": 1}
        smaller = {"type": "array", "minItems": 1, "items": {
            "type": "object", "required": ["name", "unit", "value"], "additionalProperties": False,
            "properties": {"name": text, "unit": text, "value": number, "range": text, "extra": text}}}
        kinds = {result_files.load(path)["context"]["voxspring"]["study"]["kind"]: path for path in COMMITTED}
        twice = result(pareto=2 * [identity("a") | {"fraction_of_stable": 0.5, "seconds": 1.0}])
        for path in [*kinds.values(), twice, changed(time=11)]:
            rows = self.judge(path, path)[1]["rows"]
            cases = sum(row["time"] is not None for row in rows)
            if not cases:
                continue
            found = {}
            for form, schema in (("bmf", bmf), ("github-action-benchmark", smaller)):
                code, said, err = self.run_diff(path, path, "--format", form)
                self.assertEqual((code, err), (0, ""))
                found[form] = json.loads(said)
                jsonschema.validate(found[form], schema)
            series = {one["name"]: one for one in found["github-action-benchmark"]}
            self.assertEqual(len(series), len(found["github-action-benchmark"]), "one series a case")
            self.assertEqual(series.keys(), found["bmf"].keys())
            self.assertEqual(len(series), cases)
            for name, measures in found["bmf"].items():
                (slug, one), = measures.items()
                self.assertEqual((slug, one["value"]), ({"ns": "latency", "J": "energy"}[series[name]["unit"]], series[name]["value"]))
                self.assertTrue(one.get("lower_value", 0) <= one["value"] <= one.get("upper_value", one["value"]))
        self.assertAlmostEqual(found["bmf"]["box@8 a increment float32"]["latency"]["value"], 11e3, delta=2e2)
        # The new file is exported, rows that the old one lacks included; the exit code is the gate's.
        code, said, _ = self.run_diff(result(PLAIN[1:]), changed(time=11), "--format", "bmf")
        self.assertEqual((code, len(json.loads(said))), (0, 6))
        self.assertEqual(self.run_diff(result(PLAIN), changed(time=11), "--format", "bmf")[0], 1)

    def test_two_devices(self):
        old, new = result(PLAIN), result(PLAIN, seed=2, device="Other card")
        self.assert_refused(["new.json: context.voxspring.backends.a.device: \"Other card\": expected \"Card\"",
                             "--across-devices"], old, new)
        card = changed()
        self.assertEqual(self.judge(old, card)[1]["setup"], [])
        card["context"]["voxspring"]["backends"]["b"]["uuid"] = "GPU-2"
        self.assertEqual(self.judge(old, card)[1]["setup"], ['uuid of b: "GPU-1" -> "GPU-2"'])
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
            ("backends", 3), ("backends", {"a": 3}), ("backends", {"a": {"uuid": 3}}), ("gpu", []), ("cpu", 3), ("study", 3),
            ("study", {"name": 3}),
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
                                     {"same", "still fails", "too noisy to tell"})
        older, newer = (pathlib.Path(f"results/nvidia-h200/{name}.json.gz") for name in ("table1", "formulations"))
        steps = [{(row["scene"], row["backend"], row["formulation"], row["tuning"]): row["steps"]
                  for row in result_files.load(path)["benchmarks"]} for path in (older, newer)]
        otherwise = sum(steps[0][one] != steps[1][one] for one in steps[0].keys() & steps[1].keys())
        self.assertGreater(otherwise, 0)
        found = self.judge(older, newer)[1]
        self.assertEqual(found["counts"]["not comparable"], otherwise)

    def test_a_tenth_is_found_in_committed_results(self):
        """In every row of which the comparison says so; and these are nine of ten that no run marked, of any study on a card."""
        told = collections.Counter()
        for path in COMMITTED:
            content = result_files.load(path)
            rows = [row for row in content.get("benchmarks", []) if row.get("run_type") == "iteration"]
            if not rows:
                continue
            rule, old = comparison.Rule(), comparison.Result(path, False)
            marked = {(identity_, place) for (identity_, place), rows in old.rows.items() if rows[0].noisy}
            places = [(row, (tuple(row[key] for key in comparison.IDENTITY), ())) for row in comparison.pair(old, old, rule)[0]
                      if row["time"] and row["place"] == {}]
            of_card = [row for row, place in places if place not in marked and "cpu" not in row["backend"]]
            told.update({"cards": len(of_card), "told": sum(row["time"]["least"] <= 0.1 for row in of_card)})
            tellable = [one for one in places if one[0]["time"]["least"] <= 0.095]
            for row, place in random.Random(1).sample(tellable, min(3, len(tellable))):
                new, slow = copy.copy(old), old.rows[place][0]
                new.rows = old.rows | {place: [dataclasses.replace(slow, times=[1.1 * time for time in slow.times])]}
                slower = [row for row in comparison.pair(old, new, rule)[0] if row["verdict"] == "slower"]
                self.assertEqual([one["contender"] for one in slower], [row["contender"]], path)
        self.assertGreater(told["told"], 0.9 * told["cards"])

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
        paths = [self.write("old.json", result(PLAIN)), self.write("new.json", changed(time=11))]

        def shown(columns, **more):
            environment = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "NO_COLOR")} | more
            code, _, said = on_terminal([sys.executable, "results/diff.py", *paths], columns, stream="stdout", env=environment)
            self.assertEqual(code, 1)
            return said.decode().replace("\r\n", "\n")
        self.assertIn("\033[31m  box@8 a increment float32\033[0m", shown(80))
        self.assertNotIn("\033", shown(80, NO_COLOR="1"))
        self.assertIn("old.json (s, commit 1) -> new.json (s, commit 1)", shown(80))
        self.assertIn("old.json (s, commit 1) -> new.json (s,", shown(40).replace("\n  ", " "))

    def test_missing_packages(self):
        (self.folder / "scipy.py").write_text("raise ImportError('No module named scipy')")
        said = run(sys.executable, "results/diff.py", COMMITTED[0], COMMITTED[0], env=os.environ | {"PYTHONPATH": str(self.folder)})
        self.assertEqual(said.returncode, 2, said.stderr)
        self.assertIn("install Debian's python3-scipy and python3-fastjsonschema, or with pip scipy and fastjsonschema", said.stderr)

    def test_help_needs_no_package(self):
        for script in ("diff", "report"):
            # Without the folders in which packages are installed.
            said = run(sys.executable, "-E", "-S", f"results/{script}.py", "--help")
            self.assertEqual((said.returncode, said.stderr), (0, ""))
            self.assertIn(f"Usage: {script}.py", said.stdout)


class FalseAlarms(InTemporaryFolder):
    """results/false_alarms.py."""

    def compare(self, *results, options=()):
        paths = [self.write(f"{number}.json", one) for number, one in enumerate(results)]
        return run(sys.executable, "results/false_alarms.py", *options, *paths)

    def test_runs_of_one_program_differ_by_noise_alone(self):
        found = self.compare(*(result(PLAIN, seed=seed) for seed in range(1, 8)))
        self.assertEqual((found.returncode, found.stderr), (0, ""))
        self.assertIn("21 pairs of s (commit 1): 0 with a false alarm, 0 false alarms in 126 rows", found.stdout)
        self.assertIn("one row made 10% slower: found 126 of 126 times", found.stdout)

    def test_a_row_that_differs_is_one_in_each_of_its_pairs(self):
        found = self.compare(result(PLAIN, seed=3), result(PLAIN, seed=4), changed(time=11))
        self.assertEqual(found.returncode, 1)
        self.assertEqual(found.stdout.count("slower: box@8 a"), 2)
        self.assertIn("2 false alarms in 18 rows", found.stdout)

    def test_in_pairs(self):
        rows = [[(name, time, {}) for name in "abcdef"] for time in (10, 10, 10, 20)]
        said = self.compare(*(result(own, seed=seed) for seed, own in enumerate(rows, 1)), options=("--in-pairs",))
        self.assertEqual((said.returncode, said.stderr), (1, ""))
        self.assertIn("2 pairs of s (commit 1): 1 with a false alarm, 6 false alarms in 12 rows", said.stdout)

    def test_pairs_of_resampled_runs(self):
        """Ratios of rows that two studies share are what runs differ by; the drift of a run is no false alarm, and a slow row is found."""
        rows = [(f"b{index}", 10, {}) for index in range(20)]
        generator = random.Random(1)
        for drift, apart in ((0.02, 0.004), (0.02, 0.2)):
            other = result([(name, 10 * (1 + generator.choice((-1, 1)) * apart * generator.random()), {}) for name, *_ in rows], seed=2)
            said = self.compare(result(rows), other, options=("--resample", "20", "--drift", str(drift)))
            self.assertEqual((said.returncode, said.stderr), (0, ""))
            found = re.findall(r"/s: 20 rows, 20 pairs: (\d+) with a false alarm .*one row 10% slower: found in ([\d.]+)%", said.stdout)
            self.assertEqual(len(found), 2, said.stdout)
            if apart < 0.1:
                self.assertLess(sum(int(count) for count, _ in found), 3)
                self.assertGreater(min(float(share) for _, share in found), 90)
            else:
                self.assertLess(max(float(share) for _, share in found), 60)

    def test_refuses_what_is_not_of_one_program_and_card(self):
        other = result(PLAIN)
        other["context"]["voxspring"]["commit"] = "2"
        found = self.compare(result(PLAIN), other)
        self.assertEqual(found.returncode, 2)
        self.assertIn("commit: 2 is not accepted; expected 1", found.stderr)
        self.assertEqual(self.compare(result(PLAIN)).returncode, 2)

    def test_refuses_pairs_that_it_cannot_make(self):
        """The last of three files is in no pair."""
        for options, words in (("--in-pairs", "RESULT: 3 files are not accepted; expected an even number"),
                               ("--resample=-1", "--resample: -1 is not accepted; expected 0 or more")):
            self.assert_refused(self.compare(*[result(PLAIN)] * 3, options=[options]), words)


if __name__ == "__main__":
    unittest.main()
