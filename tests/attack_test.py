"""Attacks on result files: each writes a file with one fault, and something has to say so.

Usage: attack_test.py [RESULT...]     # the committed files, unless told otherwise, and one that VOXSPRING makes

Prints what caught each attack on each file, what cannot be tried since the file is older than a field, and where the rows are too noisy to
tell. Exit code 1 if an attack got through, or was caught on no file. The current directory is the source tree.
"""

import collections
import copy
import gzip
import json
import math
import os
import pathlib
import random
import subprocess
import sys
import tempfile
import textwrap

sys.path.insert(0, "results")
import comparison  # noqa: E402
import false_alarms  # noqa: E402
import result_files  # noqa: E402

GATE = comparison.Rule(fail_on=("missing",))  # what docs/results.md says that a gate takes
SLOWER = 1.1
TRIALS = 25
FOUND = 0.89  # the share of rows for which the least slow-down that is found is stated
SEEN = 1e-12  # a smaller error may be rounding of float64, of which twice as much is no growth
# How far the share that is found may lie below the share that could be: two standard deviations of that many trials.
LEEWAY = 2 * math.sqrt(0.25 / TRIALS)

# The times of rows, and the fields that are per time.
TIMES = {"benchmarks": ("real_time",), "pareto": ("seconds",), "energy": ("seconds_per_step", "joules_per_step"),
         "overhead": ("seconds_per_step", "host_seconds_per_step"), "scaling": ("seconds_per_step",),
         "haptic": ("median_seconds", "p99_seconds", "p999_seconds", "worst_seconds")}
RATES = ("particle_updates_per_second", "spring_updates_per_second", "fraction_of_limit", "particles_per_joule", "springs_per_joule")
ERRORS = ("error_max", "error_relative_l2", "error_rms", "total_error_relative_l2", "force_error", "measured", "measured_time_step", "ratio")


class GotThrough(Exception):
    """Nothing said anything about the fault."""


class Untried(Exception):
    """The file has nothing that the attack could change."""


class TooNoisy(Exception):
    """In most trials the file's noise hides the fault. The comparison says so to its readers."""


def case_of(row):
    return row["name"].split("/iterations:")[0]


def slow(result, factor, chosen=lambda name, row: True):
    """Multiplies the times of chosen rows, and what follows from them."""
    for name, keys in TIMES.items():
        for row in result.get(name, []):
            if chosen(name, row):
                for key in keys + RATES:
                    if row.get(key):
                        row[key] *= factor if key in keys else 1 / factor
    return result


class Target:
    """A result file, and what the gate says of a changed copy of it."""

    def __init__(self, path, folder):
        self.path, self.folder, self.json = path, folder, result_files.load(path)
        self.title = f"{path.parent.name}/{result_files.study_of(path)}"
        self.measured = [(name, row) for name in TIMES for row in self.json.get(name, []) if row.get("run_type", "iteration") == "iteration"]
        self.verdicts = self.json["verification"]
        # The rows of energy and overhead hold their verdicts themselves.
        self.judged = [(name, row) for name in ("verification", "energy", "overhead") for row in self.json.get(name, [])
                       if name == "verification" or row.get("passed") is not None]

    def gate(self, change):
        """What the comparison says of a copy that `change` edits, or how it is refused."""
        changed = copy.deepcopy(self.json)
        change(changed)
        return self.gate_of(json.dumps(changed).encode())

    def gate_of(self, content):
        path = self.folder / "changed.json"
        path.write_bytes(content)
        try:
            return comparison.document(self.path, path, GATE)
        except result_files.BadInput as refused:
            return str(refused).replace(str(path), "it")

    def require(self, said, wanted):
        """What caught the fault: a refusal, or a failure or note with these words."""
        if isinstance(said, str):
            return "refused: " + said.removeprefix("it: ").split("; expected a result")[0]
        for text in [f"{row['verdict']}: {row['contender']} {row['detail']}" for row in said["rows"]] + said["fails"] + said["notes"] + [
                f"setup: {one}" for one in said["setup"]]:
            if wanted in text:
                return text
        raise GotThrough(f"no {wanted!r} in {said['fails'] + said['notes']}")

    def failed(self, said, wanted):
        """The same, of a fault that has to fail the gate."""
        if not isinstance(said, str) and not said["worse"]:
            raise GotThrough(f"exit code 0: {said['counts']} {said['notes']}")
        return self.require(said, wanted)

    def rows_of(self, name):
        return [row for content in self.json.values() if isinstance(content, list) for row in content if row.get("name") and
                case_of(row) == name]


ATTACKS = {}


def attack(fault, of=None, untried="it has no verification"):
    """Registers an attack, on files that have something in the field `of` of their Target."""
    def register(function):
        def on(target):
            if of and not getattr(target, of):
                raise Untried(untried)
            return function(target)
        ATTACKS[fault] = on
        return on
    return register


@attack("one row slower by 10%", "measured", "no row has a time")
def one_row(target):
    """Between files of rows with repetitions, each another run of the same rows as far as noise is known; else in a copy."""
    if target.json["benchmarks"]:
        return one_row_of_a_run(target)
    name, slowed = target.measured[len(target.measured) // 2]
    said = target.gate(lambda result: slow(result, SLOWER, lambda of, row: of == name and row == slowed))
    return target.failed(said, "slower") + "; in a copy: how a second run differs is not known"


def one_row_of_a_run(target):
    result = comparison.Result(target.path, False)
    generator = random.Random(1)
    known = [comparison.Result(path, False) for path in result_files.within(target.path.parent) if result_files.load(path)["benchmarks"]]
    away = AWAY.setdefault(target.path.parent, false_alarms.differences([one for one in known if false_alarms.origin(one, True) ==
                                                                         false_alarms.origin(result, True)]))
    places, found, could, least = list(false_alarms.resampled(result, generator).rows), 0, 0, []
    for _ in range(TRIALS):
        old, new = (false_alarms.resampled(result, generator, *more) for more in ((), (away, 0.006)))
        chosen = generator.choice(places)
        new.rows[chosen][0].times = [SLOWER * time for time in new.rows[chosen][0].times]
        rows = comparison.pair(old, new, GATE)[0]
        least += [row["time"]["least"] or math.inf for row in rows if "measured" not in row["place"]]
        slowed = next(row for row in rows if tuple(row[key] for key in comparison.IDENTITY) == chosen[0] and
                      tuple((key, json.dumps(value)) for key, value in row["place"].items()) == chosen[1])
        found += slowed["verdict"] == "slower"
        could += (slowed["time"]["least"] or math.inf) <= SLOWER - 1
    needed = sorted(least)[math.ceil(FOUND * len(least)) - 1]
    said = (f"found in {found} of {TRIALS} trials, which the noise of {could} lets be found; {FOUND:.0%} of the rows are found from "
            f"{needed:.0%} on" + "; how a second run differs is not known" * (not away))
    if found < could - LEEWAY * TRIALS:
        raise GotThrough(said)
    if could < TRIALS / 2:
        raise TooNoisy(said)
    return said


AWAY = {}


@attack("one row ten times slower", "measured", "no row has a time")
def ten_times(target):
    name, slowed = target.measured[0]
    said = target.gate(lambda result: slow(result, 10, lambda of, row: of == name and case_of(row) == case_of(slowed)
                                           and all(row.get(key) == slowed.get(key) for key in comparison.PLACES[of])))
    return target.failed(said, "slower")


@attack("the clocks down: a tenth longer, all of it", "measured", "no row has a time")
def clocks(target):
    def down(result):
        slow(result, SLOWER)
        for row in [row for name in TIMES for row in result.get(name, [])]:
            for key in comparison.CLOCKS:
                if row.get(key):
                    row[key] /= SLOWER
        for on in result["context"]["voxspring"]["backends"].values():
            on["driver"] = on.get("driver", "") + " at less"
    said = target.gate(down)
    target.require(said, "setup: driver")
    if any(row.get(key) for _, row in target.measured for key in comparison.CLOCKS):
        target.require(said, "setup: the card's lowest clock")
    if not said["shifts"]:
        return target.failed(said, "slower") + "; as rows, for fewer than eight of a kind tell no shift"
    if counted := sum(row["verdict"] == "slower" for row in said["rows"] if row["time"] and row["time"]["shift"]):
        raise GotThrough(f"the drift counts against {counted} rows")
    shifts = [one for one in said["shifts"] if one["measured"] in sum(TIMES.values(), ())]
    if any(abs(one["ratio"] - SLOWER) > 0.01 for one in shifts):
        raise GotThrough(f"shifts of {[one['ratio'] for one in shifts]}")
    if any(one["verdict"] == "slower" for one in shifts):
        return target.failed(said, "slower as a whole")
    return target.require(said, "the run as a whole moved") + "; by the host's clock 30% fail"


@attack("a backend is missing")
def backend(target):
    names = sorted({row["backend"] for content in target.json.values() if isinstance(content, list) for row in content
                    if row.get("name") and content not in (target.json["skipped"], target.json["failed"])})
    if len(names) < 2:
        raise Untried("it has one")

    def without(result):
        for name, content in result.items():
            if isinstance(content, list):
                result[name] = [row for row in content if row.get("backend") != names[0]]
    return target.failed(target.gate(without), f"no {names[0]}")


@attack("half of the rows are missing")
def half(target):
    def without(result):
        for name in comparison.PLACES:
            kept = sorted({case_of(row) for row in result.get(name, [])})[::2]
            if name in result:
                result[name] = [row for row in result[name] if case_of(row) in kept]
    return target.failed(target.gate(without), "gone")


@attack("half of the repetitions wrong, and not judged")
def repetitions(target):
    if not any("repetitions_judged" in row for row in target.verdicts):
        raise Untried("it was written before repetitions_judged" if target.verdicts else "it has no repetitions")

    def unjudged(result, resumed=False):
        result["verification"][0]["repetitions_judged"] //= 2
        for row in result["benchmarks"] if resumed else []:
            row["resumed"] = True
    target.failed(target.gate(lambda result: unjudged(result, True)), "repetitions were verified")
    return target.failed(target.gate(unjudged), "refused")


@attack("half of the repetitions wrong, with their own errors", "verdicts", "it has no repetitions")
def own_errors(target):
    def wrong(result):
        for row in [row for row in result["benchmarks"] if case_of(row) == target.verdicts[0]["name"]][::2]:
            row["error_max"] = 1
    return target.failed(target.gate(wrong), "refused")


@attack("times of a state that failed", "verdicts")
def failed_state(target):
    return target.failed(target.gate(lambda result: result["verification"][0].update(passed=False)), "refused")


@attack("times without verification")
def unverified(target):
    if len(target.verdicts) < 2:
        raise Untried("it has no verification")
    return target.failed(target.gate(lambda result: result["verification"].pop()), "its states were not verified")


@attack("no springs: every particle off by its motion", "judged")
def springless(target):
    """A row passes with such an error only where tables print that it is not verified."""
    unjudged, through = collections.Counter(), []
    for name, verdict in target.judged:
        wrong = copy.deepcopy(verdict)
        for run in (wrong, wrong.get("strained_start", {})):
            for error, motion in (("error_max", "motion_max"), ("error_rms", "motion_rms")):
                if motion in run:
                    run[error] = run[motion]
        if not next(result_files.contradictions({name: [wrong]}), None):
            unjudged[shown := result_files.threshold_of(verdict)] += 1
            through += [verdict["name"]] * (shown not in ("chaotic", "not verified"))
    if through:
        raise GotThrough(f"{len(through)} rows as {through[0]}")
    said = "; ".join(f"{count} printed as {name}" for name, count in unjudged.items()) or "none unjudged"
    return f"error beyond its bound, refused in {len(target.judged) - sum(unjudged.values())} of {len(target.judged)} rows, {said}"


@attack("no springs: rows whose springs nothing strains")
def unstrained(target):
    study = result_files.study_of(target.path)
    if study in ("fastest", "figure8"):
        # tests/gate_test.cpp has springless programs fail on the scenes and the steps of these studies.
        about = json.loads(pathlib.Path(f"harness/studies/{study}.json").read_text(encoding="utf-8"))
        tried = {(scene["scene"], scene.get("steps", about["steps"])) for scene in about["scenes"]}
        if strange := {(row["scene"], row["steps"]) for row in target.verdicts} - tried:
            raise GotThrough(f"the gates are not tried on {sorted(strange)}")
    rows = [row for row in target.verdicts if "strained_share" in row]
    if not rows:
        raise Untried("it was written before strained_share" if target.verdicts else "it has no verification")
    for row in rows:
        told = result_files.threshold_of(row)
        enough = max(row["strained_share"], row.get("strained_start", {}).get("strained_share", 0)) >= result_files.MIN_STRAINED_SHARE
        if not enough and told not in ("chaotic", "not verified"):
            raise GotThrough(f"{row['name']} is shown with {told}")
        loose = {key: value for key, value in row.items() if key != "strained_start"} | {"strained_share": 0.1}
        if row["tolerance_rms"] and result_files.threshold_of(loose) != "not verified":
            raise GotThrough(f"{row['name']} without a strained start is shown with {result_files.threshold_of(loose)}")
    return f"tables print `not verified`; so are {sum(result_files.threshold_of(row) == 'not verified' for row in rows)} of {len(rows)} rows"


def changed_errors(target, factor, lists=None):
    """A copy in which the errors of one case are multiplied, everywhere or in these lists alone."""
    lone = next((row for name in lists or comparison.PLACES for row in target.json.get(name, []) if name != "stress" or
                 row["gate_is"] == "at most" and row["unit"] in comparison.STRESS_ERRORS if any((row.get(key) or 0) > SEEN for key in ERRORS)), None)
    if lone is None:
        raise Untried("no row has an error")

    def change(result):
        for name, content in result.items():
            for row in content if isinstance(content, list) and (name in lists if lists else True) else []:
                if row.get("name") and case_of(row) == case_of(lone):
                    for key in ERRORS:
                        if isinstance(row.get(key), float):
                            row[key] *= 1 / factor if key in ("measured_time_step", "ratio") else factor
    return target.gate(change)


@attack("an error twice as large")
def error_grew(target):
    said = changed_errors(target, 2)
    if isinstance(said, dict) and any(row.get("chaotic") for row in target.verdicts[:1]):
        return target.require(said, "errors")
    return target.failed(said, "error grew" if "stability" not in target.json else "counter worse")


@attack("an error written smaller in the rows than in their verdicts", "verdicts", "its rows have their errors once")
def error_shrunk(target):
    return target.failed(changed_errors(target, 0.1, ["benchmarks"]), "refused")


@attack("changed bits: an error's ninth digit")
def bits(target):
    if "stability" in target.json:
        raise Untried("no row has an error")
    return target.require(changed_errors(target, 1 - 1e-9), "errors changed, so bits differ, but none grew")


@attack("another card's name")
def card(target):
    def swap(result):
        about = result["context"]["voxspring"]
        about["gpu"] = "Another card"
        for on in about["backends"].values():
            on["device"] = "Another card"
    said = target.failed(target.gate(swap), "refused")
    if any(on.get("uuid") for on in target.json["context"]["voxspring"]["backends"].values()):
        target.failed(target.gate(lambda result: result["context"]["voxspring"].update(gpu="Another card")), "refused")
    return said


@attack("a truncated file")
def truncated(target):
    content = gzip.compress(json.dumps(target.json).encode())
    for cut in (content[:len(content) // 2], content[:-1], gzip.decompress(content)[:-1]):
        said = target.failed(target.gate_of(cut), "refused")
    return said


def made_here(folder):
    """A small study of this machine, whose file has every field of today."""
    (folder / "made").mkdir()
    study, path = folder / "small.json", folder / "made/small.json"
    study.write_text(json.dumps({
        "description": "a result to attack", "repetitions": 9, "steps": 20, "start_times": False, "total_error": False,
        "backends": [f"cpu_{way}:formulation={one}" for way in ("parallel", "explicit") for one in ("position", "increment")],
        "scenes": [{"scene": "box@12", "steps": 400}, {"scene": "box@16", "steps": 200}, {"scene": "box@24", "steps": 50},
                   {"scene": "box@48", "steps": 4}]}), encoding="utf-8")
    done = subprocess.run([os.environ["VOXSPRING"], "study", study, "--out", path], capture_output=True, text=True, check=False,
                          env=os.environ | {"OMP_NUM_THREADS": "1"})
    if done.returncode:
        sys.exit(done.stderr)
    return path


def main():
    committed = [pathlib.Path(one) for one in sys.argv[1:]] or result_files.committed(pathlib.Path("results"))
    through, noisy, said, tried = 0, 0, collections.defaultdict(list), set()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        targets = [Target(path, folder) for path in [*committed, made_here(folder)]]
        for fault, function in ATTACKS.items():
            print(f"\n{fault}")
            for target in targets:
                try:
                    tried.add((fault, target))
                    outcome = function(target)
                    said[fault].append(target)
                except TooNoisy as reason:
                    outcome, noisy = f"- too noisy to tell: {reason}", noisy + 1
                except Untried as reason:
                    tried.remove((fault, target))
                    outcome = f"- not tried: {reason}"
                except GotThrough as reason:
                    outcome, through = f"GOT THROUGH: {reason}", through + 1
                print(textwrap.shorten(f"  {target.title:24} {outcome}", 200, placeholder=" ..."), flush=True)
        untried = [fault for fault in ATTACKS if (fault, targets[-1]) not in tried]
        never = [fault for fault in ATTACKS if not said[fault]]
    print(f"\n{sum(map(len, said.values()))} attacks caught, {through} got through, {noisy} too noisy to tell" +
          f"; not tried on a new file: {untried}" * bool(untried) + f"; caught on no file: {never}" * bool(never))
    return 1 if through or untried or never else 0


if __name__ == "__main__":
    sys.exit(main())
