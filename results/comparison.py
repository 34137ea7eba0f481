"""What changed between two results, row by row: the one rule for diff.py and for the page's history.

Rows pair by scene, backend, formulation, precision and tuning; those of studies of kind pareto, stability and stress
by time step, start or measurement as well. A tuning parameter that only one file knows does not keep rows apart while
it is at its default.

Every pair of times has its ratio of medians, and, of two repetitions on, the 95% bootstrap interval of it. With a
threshold t a row is slower if Mann-Whitney's U tells the two files apart, at a false discovery rate of 1% over all
rows, the ratio is beyond 1 + t, and its interval is beyond 1. Where the noise n exceeds 0.8 t, the interval has to be
beyond 1 + 3n; where n exceeds 20%, no row is slower. The noise of a row is its spread, the larger relative
interquartile range of the two files, or the upper quartile of the spreads on its device if that is more: load comes
and goes, and spares some rows. Of rows that their run marked the device's spread is not: what disturbed those is known,
and did not disturb the others. Faster likewise. A row that is neither, but whose interval reaches beyond the
threshold, is too noisy to tell; the rest is the same.

Of a row that its run marked (`noisy`), and of one with fewer than 9 repetitions, the noise counts as 10% at least:
only a change beyond 30% is one. With 5 repetitions U can tell at 1% only if nearly all rows changed alike, and with
fewer not even then; what is not slower or faster has too few repetitions. results/README.md says how often the rule is
wrong.

A counter, which a result's context describes, has no statistics: it is better or worse if it changed by more than the threshold in
the direction that its result says. Errors are of one state and have no statistics: one grew if it is more than the error factor times
what it was, or than what float64 is uncertain by if that is more. Of a backend that adds in any order an error is another one each time: it
counts as no smaller than what rounding was measured to carry the scene.
"""

import collections
import dataclasses
import json
import math
import pathlib
import statistics

import result_files
from result_files import BadInput

HERE = pathlib.Path(__file__).resolve().parent
IDENTITY = ("scene", "backend", "formulation", "precision", "tuning")
# By list, the keys that tell rows of one identity apart.
PLACES = {"benchmarks": (), "pareto": ("fraction_of_stable",), "stability": ("damping", "start"),
          "stress": ("part", "measurement", "steps", "detail"), "energy": (),
          "overhead": ("handed_over",), "scaling": ("ranks", "cut", "way"), "haptic": ("hertz", "edited", "drawn")}
# The values of such keys in files that lack them.
UNSAID = {"drawn": False}
# The key of a row's time, by list; elsewhere it is `seconds`, the time to an end time.
CLOCKS = {"energy": "seconds_per_step", "overhead": "seconds_per_step", "scaling": "seconds_per_step",
          "haptic": "median_seconds"}
# Errors, each with the field that has the uncertainty of its float64 reference.
ERRORS = {"error_relative_l2": "divergence", "error_max": None, "total_error_relative_l2": "total_error_uncertainty"}
STRESS_ERRORS = ("relative", "spacings")  # units of errors; growth, energies and counts only have gates

CLOCK = "real_time"
# U of 9 and 9 can reach p = 4e-5, which is below 1% after the correction for up to 243 rows.
MINIMUM_REPETITIONS = 9
FALSE_DISCOVERIES = 0.01
CONFIDENCE = 0.95
RESAMPLES = 2000
SEED = 1
# Two runs differ by more than repetitions within one do. If the noise exceeds CALM times the threshold, a change has to exceed
# NOISE_FACTOR times the noise (results/README.md has the figures). Above HIGHEST_NOISE no change counts.
NOISE_FACTOR = 3
CALM = 0.8
HIGHEST_NOISE = 0.2
# The least noise of rows that their run marked (harness/device/noise.h marks what moved by more than this), or that have fewer than 9
# repetitions.
UNKNOWN_NOISE = 0.1
# The size of a few roundings of float64, by which the same sums in another order differ.
FLOAT64_NOISE = 1e-15

WORSE = ("now fails", "error grew", "counter worse", "slower")
VERDICTS = WORSE + ("faster", "counter better", "new", "gone", "still fails", "not comparable", "too noisy to tell",
                    "too few repetitions", "same")


@dataclasses.dataclass
class Rule:
    """What a user may choose."""
    threshold: float = 0.05  # the least change of a time that counts
    error_factor: float = 1.5  # the least growth of an error that counts
    across_devices: bool = False  # compare results of two devices, each time as a multiple of its device's limit


@dataclasses.dataclass
class Row:
    """What a file says about a contender in one place; times are of the repetitions, in seconds or limits a step."""
    name: str
    measure: tuple = ()  # particles, springs and steps: two rows are comparable if these agree
    times: list = dataclasses.field(default_factory=list)
    time: float = None  # used in place of `times` if the file has no repetitions
    errors: dict = dataclasses.field(default_factory=dict)
    floors: dict = dataclasses.field(default_factory=dict)
    by_chance: dict = dataclasses.field(default_factory=dict)  # how large an error could be by chance in another run of the same program
    counters: dict = dataclasses.field(default_factory=dict)  # name: values of the repetitions, where more or less of it is better
    chaotic: bool = False
    limitless: bool = False  # whether the file lacks the limit that a comparison across devices needs
    noisy: list = dataclasses.field(default_factory=list)  # reasons for which its run marked its times as not to be trusted
    failure: str = ""


def identity_of(row):
    return tuple(row.get(key, "") for key in IDENTITY)


class Result:
    """A result file: rows by (identity, place), failed and skipped with their reasons by identity."""

    def __init__(self, path, across):
        self.path = path
        self.json = result_files.load(path)
        result_files.check(path, self.json, HERE / "comparison.schema.json")
        self.context = self.json["context"]["voxspring"]
        self.backends = self.context.get("backends", {})
        self.study = self.context.get("study", {}).get("name")
        self.less_is_better = {name: about["better"] == "less" for name, about in result_files.counters(self.json).items()
                               if about["better"] != "neither"}
        self.rows = collections.defaultdict(list)
        self.unmeasured = {name: {identity_of(row): row.get("reason", "no reason given") for row in self.json.get(name, [])}
                           for name in ("failed", "skipped")}
        for list_name in PLACES:
            for index, row in enumerate(self.json.get(list_name, [])):
                if list_name != "benchmarks" or row.get("run_type", "iteration") == "iteration":
                    self.add(list_name, row, f"{list_name}[{index}].", across)
        if not self.rows and not any(self.unmeasured.values()):
            self.refuse("the document", sorted(self.json), f"rows in any of {', '.join((*PLACES, *self.unmeasured))}")

    def add_errors_by_chance(self, entry, row):
        """Raises the errors against float64 of a backend whose runs differ, both alike, to where one of them is its spread."""
        one, spread = entry.errors.get("error_relative_l2"), row.get("spread")
        if one and spread and not self.backends.get(row["backend"], {}).get("deterministic", True):
            for key in ("error_relative_l2", "error_max"):
                if entry.errors.get(key) is not None:
                    entry.by_chance[key] = entry.errors[key] * spread / one

    def refuse(self, key, value, accepted):
        raise BadInput(f"{self.path}: {key}: {result_files.shown(value)}: expected {accepted}")

    def add(self, list_name, row, at, across):
        identity = identity_of(row)
        place = tuple((key, json.dumps(row.get(key, UNSAID.get(key)), sort_keys=True)) for key in PLACES[list_name])
        name = row.get("name", "/".join(identity[:4])).split("/iterations:")[0]
        entry = Row(name[len(identity[0]) + 1:].replace("/", " "), chaotic=row.get("chaotic", False), noisy=list(row.get("noisy", [])))
        entry.measure = tuple((key, row[key]) for key in ("particles", "springs", "steps", "error_steps", "end_time")
                              if key in row)
        if list_name == "stress":
            if row.get("gate_is") == "at most" and row.get("unit") in STRESS_ERRORS:
                entry.errors["measured"] = row["measured"]
        else:
            entry.errors = {key: row[key] for key in ERRORS if key in row}
            entry.floors = {key: row.get(ERRORS[key]) for key in entry.errors}
            self.add_errors_by_chance(entry, row)
        for counter in self.less_is_better.keys() & row.keys():
            value = row[counter]
            if value is not None and (isinstance(value, (bool, str, list, dict)) or not 0 <= value < math.inf):
                self.refuse(at + counter, value, "a number that is not negative, or null")
            entry.counters[counter] = [] if value is None else [value]
        if not row.get("passed", True) or row.get("diverged", False):
            entry.failure = row.get("reason", "beyond its gate")
        key = "fraction_of_limit" if across else CLOCK if list_name == "benchmarks" else CLOCKS.get(list_name, "seconds")
        time = row.get(key)
        if list_name == "benchmarks":
            if not across and not time:
                self.refuse(at + key, time, "a number of microseconds above zero")
            # A time as a multiple of its limit is the inverse of the fraction.
            entry.times = [1 / time if across else time * 1e-6] if time else []
            known = self.rows[(identity, place)]
            if known:
                known[0].times += entry.times
                known[0].noisy += entry.noisy
                for counter, values in entry.counters.items():
                    known[0].counters.setdefault(counter, []).extend(values)
                return
        else:
            entry.time = (1 / time if across else time) if time else None
        entry.limitless = across and not time and key in row
        self.rows[(identity, place)].append(entry)

    def device(self, backend):
        """(name, card) of what a backend ran on; a processor is another one with another number of cores."""
        on = self.backends.get(backend, {})
        cores = self.json["context"].get("num_cpus")
        name = on.get("device") or self.context.get("gpu") or self.context.get("cpu") or "unknown"
        return (name, on.get("uuid", "")) if on.get("uuid") or not cores else (f"{name}, {cores} logical processors", "")


def same_tuning(identity, row, others):
    """The one identity among `others` that differs only in parameters one side lacks and the other has at default."""
    def values(tuning):
        return dict(part.partition("=")[::2] for part in tuning.split(",") if part)
    def alike(other, other_row):
        ours, theirs = values(identity[4]), values(other[4])
        return (identity[:4] == other[:4] and all(theirs[key] == ours[key] for key in ours.keys() & theirs.keys())
                and not any(f"{key}=" in row.name for key in ours.keys() - theirs.keys())
                and not any(f"{key}=" in other_row.name for key in theirs.keys() - ours.keys()))
    found = [other for other, other_row in others.items() if alike(other, other_row)]
    return found[0] if len(found) == 1 else None


def rename(old, new):
    """Gives rows of `old` the tuning that `new` has for them."""
    identities = [{identity: rows[0] for (identity, _), rows in result.rows.items()} for result in (old, new)]
    lone = [{i: row for i, row in mine.items() if i not in other} for mine, other in (identities, identities[::-1])]
    names = {identity: same_tuning(identity, row, lone[1]) for identity, row in lone[0].items()}
    once = collections.Counter(names.values())
    names = {identity: to for identity, to in names.items() if to and once[to] == 1}
    old.rows = {(names.get(identity, identity), place): rows for (identity, place), rows in old.rows.items()}
    return len(names)


def compare_times(old, new):
    """Medians and their ratio; as far as there are repetitions for them its interval, the spread, and U's p."""
    # Imported here, so that --help of diff.py and report.py needs no packages.
    import numpy  # pylint: disable=import-outside-toplevel
    import scipy.stats  # pylint: disable=import-outside-toplevel
    samples = [numpy.asarray(old), numpy.asarray(new)]
    medians = [float(numpy.median(sample)) for sample in samples]
    found = {"old": medians[0], "new": medians[1], "ratio": medians[1] / medians[0], "interval": [None, None],
             "spread": None, "noise": None, "p": None, "q": None}
    if min(len(old), len(new)) < 2:
        return found
    interval = scipy.stats.bootstrap(
        samples, lambda a, b, axis: numpy.median(b, axis=axis) / numpy.median(a, axis=axis), method="percentile",
        n_resamples=RESAMPLES, confidence_level=CONFIDENCE, random_state=numpy.random.default_rng(SEED))
    found["interval"] = [float(end) for end in interval.confidence_interval]
    found["spread"] = max(float(scipy.stats.iqr(sample)) / median for sample, median in zip(samples, medians))
    if can_tell(len(old), len(new)):
        tied = len(set(old) | set(new)) < len(old) + len(new)
        small = max(len(old), len(new)) <= 50
        found["p"] = float(scipy.stats.mannwhitneyu(*samples, method="exact" if small and not tied else "asymptotic").pvalue)
    return found


def min_p(old, new):
    """The least p that Mann-Whitney's U can have, two-sided, of so many repetitions."""
    return 2 / math.comb(old + new, old)


def can_tell(old, new):
    return min_p(old, new) < FALSE_DISCOVERIES


def complete_times(rows, device, marked):
    """What takes all rows: the noise of the device that `device` says each ran on, and Benjamini and Hochberg's q."""
    spreads = collections.defaultdict(list)
    rows = [row for row in rows if row["time"] and row["time"]["spread"] is not None]
    if not rows:
        return
    import numpy  # pylint: disable=import-outside-toplevel
    for row in rows:
        if not marked(row):
            spreads[device(row)].append(row["time"]["spread"])
    for row in rows:
        of_device = float(numpy.quantile(spreads[device(row)] or [0], 0.75))
        unknown = marked(row) or min(row["repetitions"]) < MINIMUM_REPETITIONS
        row["time"]["noise"] = max(row["time"]["spread"], of_device, UNKNOWN_NOISE if unknown else 0)
    times = [row["time"] for row in rows if row["time"]["p"] is not None]
    least = 1.0
    ordered = sorted(times, key=lambda time: time["p"], reverse=True)
    for rank, time in zip(range(len(ordered), 0, -1), ordered):
        least = time["q"] = min(least, time["p"] * len(ordered) / rank)


def judge_time(time, threshold):
    """The verdict on a time that has a q."""
    low, high = time["interval"]
    def beyond(ratio, near_end):
        return (time["q"] < FALSE_DISCOVERIES and ratio > 1 + threshold and time["noise"] <= HIGHEST_NOISE
                and near_end > (1 + NOISE_FACTOR * time["noise"] if time["noise"] > CALM * threshold else 1))
    if beyond(time["ratio"], low):
        return "slower"
    if beyond(1 / time["ratio"], 1 / high):
        return "faster"
    return "too noisy to tell" if max(high, 1 / low) > 1 + threshold or time["noise"] > HIGHEST_NOISE else "same"


def grown(old, new, factor):
    """What errors grew, as words."""
    words = []
    for key in [] if old.chaotic or new.chaotic else old.errors.keys() & new.errors.keys():
        before, after = old.errors[key], new.errors[key]
        # A missing total error is not an infinite one: a study may not have asked for it.
        if before is None or (after is None and key != "measured"):
            continue
        floor = max(FLOAT64_NOISE, old.floors.get(key) or 0, new.floors.get(key) or 0, old.by_chance.get(key, 0))
        if after is None or after > factor * max(before, floor):
            words.append(f"{key} {before:.1e} -> {'not finite' if after is None else format(after, '.1e')}")
    return ", ".join(sorted(words))


def moved(counters, less_is_better, threshold):
    """What counters became worse and what became better, as words."""
    words = ([], [])
    for name, (before, after) in sorted(counters.items()):
        if max(before, after) > (1 + threshold) * min(before, after):
            words[(after > before) != less_is_better[name]].append(f"{name} {before:.6g} -> {after:.6g}")
    return [", ".join(of) for of in words]


def pair(old, new, options):
    """A list of compared rows, as results/diff.schema.json has them."""
    compared, marked = [], {}
    for identity, place in dict.fromkeys([*old.rows, *new.rows]):
        before, after = old.rows.get((identity, place), []), new.rows.get((identity, place), [])
        for index in range(max(len(before), len(after))):
            a, b = (rows[index] if index < len(rows) else None for rows in (before, after))
            row = dict(zip(IDENTITY, identity), place={key: json.loads(value) for key, value in place},
                       contender=(b or a).name, verdict="", detail="",
                       repetitions=[len(r.times) if r else 0 for r in (a, b)], time=None, errors=None, counters=None)
            compared.append(row)
            if a and b:
                row["errors"] = {key: [a.errors[key], b.errors[key]] for key in a.errors if key in b.errors}
                differ = [f"{key} {dict(a.measure)[key]} -> {value}" for key, value in b.measure
                          if dict(a.measure).get(key, value) != value]
                if not differ:
                    times = [r.times or ([r.time] if r.time else []) for r in (a, b)]
                    row["time"] = compare_times(*times) if all(times) else None
                    marked[id(row)] = "; ".join(dict.fromkeys(a.noisy + b.noisy))
                row["verdict"], row["detail"] = judge_state(a, b, row, differ, options)
                row["counters"] = {name: [statistics.median(one.counters[name]) for one in (a, b)] for name in a.counters
                                   if a.counters[name] and b.counters.get(name)}
                worse, better = moved(row["counters"], new.less_is_better | old.less_is_better, options.threshold)
                if row["verdict"] in ("", "same") and (worse or better):
                    row["verdict"], row["detail"] = f"counter {'worse' if worse else 'better'}", "; ".join(filter(None, (worse, better)))
            elif b:
                failed = identity in old.unmeasured["failed"]
                row["verdict"], row["detail"] = (("now fails", b.failure) if b.failure else
                                                 ("new", "failed before" * failed))
            elif identity in new.unmeasured["failed"]:
                row["verdict"], row["detail"] = "now fails", new.unmeasured["failed"][identity]
            else:
                reason = new.unmeasured["skipped"].get(identity)
                row["verdict"], row["detail"] = "gone", f"skipped: {reason}" if reason else ""
    complete_times(compared, lambda row: new.device(row["backend"]), lambda row: marked[id(row)])
    for row in compared:
        if row["time"] and row["verdict"] in ("", "error grew", "counter worse", "counter better"):
            verdict, detail = judge_repetitions(row, options.threshold)
            if marked[id(row)] and verdict != "same":
                detail = "; ".join(filter(None, (detail, marked[id(row)])))
            if not row["verdict"]:
                row["verdict"], row["detail"] = verdict, detail
            elif verdict == "slower" and row["verdict"] not in WORSE:
                row["verdict"], row["detail"] = verdict, "; ".join(filter(None, (detail, row["detail"])))
            elif verdict in ("slower", "faster"):
                row["detail"] += f"; {verdict}"
    known = {tuple(row[key] for key in IDENTITY) for row in compared if row["verdict"].endswith("fails")}
    for identity, reason in new.unmeasured["failed"].items():
        if identity not in known:
            verdict = "still fails" if identity in old.unmeasured["failed"] else "now fails"
            compared.append(dict(zip(IDENTITY, identity), place={}, contender=" ".join(identity[1:4]), verdict=verdict,
                                 detail=reason, repetitions=[0, 0], time=None, errors=None, counters=None))
    return sorted(compared, key=lambda row: VERDICTS.index(row["verdict"]))


def judge_repetitions(row, threshold):
    """The verdict on a time and its detail, in words."""
    old, new = row["repetitions"]
    verdict = judge_time(row["time"], threshold) if row["time"]["q"] is not None else ""
    if verdict in ("slower", "faster") or min(old, new) >= MINIMUM_REPETITIONS:
        return verdict, ""
    if not old or not new:
        return "too few repetitions", f"the file has one time of each, {MINIMUM_REPETITIONS} are needed"
    return "too few repetitions", (f"{old} and {new}, of which p is {min_p(old, new):.2g} at best; {MINIMUM_REPETITIONS} "
                                   "are needed")


def is_clearly_slower(times, other, marked, threshold=Rule.threshold):
    """Whether `other` takes longer than `times`, of one machine and of different runs: as the rule has it of two results,
    but for U, which answers whether a row changed and asks for more repetitions than a choice among rows does."""
    if min(len(times), len(other)) < 3:
        return False
    found = compare_times(times, other)
    noise = max(found["spread"], UNKNOWN_NOISE if marked else 0)
    return found["interval"][0] > 1 + max(threshold, NOISE_FACTOR * noise if noise > CALM * threshold else 0)


def judge_state(a, b, row, differ, options):
    """The verdict and detail of two rows as far as they need no time; no verdict: that is left to the times."""
    if b.failure:
        return ("still fails" if a.failure else "now fails"), b.failure
    if a.failure:
        return "new", "failed before"
    if differ:
        return "not comparable", ", ".join(differ)
    if words := grown(a, b, options.error_factor):
        return "error grew", words
    if row["time"]:
        return "", ""
    if options.across_devices and (a.limitless or b.limitless):
        return "not comparable", "what limits one of the devices is not known"
    return "same", ""


def devices(old, new, options):
    """Notes on what the two files ran on; refuses two devices unless that is asked for."""
    backends = [{identity[1] for identity, _ in result.rows} for result in (old, new)]
    tried = [of | {identity[1] for identity in result.unmeasured["failed"]} for of, result in zip(backends, (old, new))]
    if not tried[0] & tried[1]:
        raise BadInput(f"{new.path}: rows: {', '.join(sorted(tried[1])) or 'none'}: expected a backend that {old.path} has: "
                       f"{', '.join(sorted(tried[0])) or 'none'}")
    cards = False
    for backend in sorted(backends[0] & backends[1]):
        (before, card), (after, other_card) = old.device(backend), new.device(backend)
        if before != after and not options.across_devices:
            raise BadInput(f"{new.path}: context.voxspring.backends.{backend}.device: {json.dumps(after)}: expected "
                           f"{json.dumps(before)}, as in {old.path}, or --across-devices to compare fractions of their limits")
        cards |= before == after and card != other_card
    notes = ["the card is another one of the same model"] if cards else []
    for key in ("gpu", "driver", "gl_renderer", "cpu", "compiler", "flags", "study_flags", "cuda_compiler", "cuda_flags"):
        before, after = old.context.get(key), new.context.get(key)
        if before != after and key in old.context and key in new.context:
            notes.append(f"{key}: {before} -> {after}")
    studies = [old.study, new.study]
    if studies[0] != studies[1]:
        notes.append(f"the studies differ ({studies[0]}, {studies[1]}), and with them what ran in between")
    return notes


def common_shift(rows, result, threshold):
    """Notes on devices whose rows all moved the same way, which one kernel does not explain."""
    ratios = collections.defaultdict(list)
    for row in rows:
        if row["time"]:
            ratios[result.device(row["backend"])[0]].append(row["time"]["ratio"])
    return [f"all {len(of)} rows on {device} moved together, x {statistics.median(of):.3f} ({min(of):.3f} to {max(of):.3f}):"
            " clocks, load, driver or shared code rather than one kernel"
            for device, of in ratios.items() if len(of) >= 4 and (min(of) > 1 or max(of) < 1)
            and abs(math.log(statistics.median(of))) > math.log1p(threshold) / 2]


def document(old_path, new_path, options):
    """What diff.schema.json describes, of two files; options is a Rule."""
    old, new = (Result(path, options.across_devices) for path in (old_path, new_path))
    renamed = rename(old, new)
    rows = pair(old, new, options)
    notes = devices(old, new, options) + common_shift(rows, new, options.threshold)
    if renamed:
        notes.append(f"{renamed} contenders have tuning parameters at their default that the other file lacks")
    counts = collections.Counter(row["verdict"] for row in rows)
    about = [{"file": result.path.name, "date": str(result.json["context"].get("date", "")),
              "commit": str(result.context.get("commit", "unknown")), "clean": result.context.get("clean"),
              "study": result.study} for result in (old, new)]
    return {"version": 1, "old": about[0], "new": about[1],
            "time": "times_limit" if options.across_devices else "seconds_per_step",
            "rule": {"threshold": options.threshold, "noise_factor": NOISE_FACTOR, "calm": CALM,
                     "highest_noise": HIGHEST_NOISE, "unknown_noise": UNKNOWN_NOISE, "error_factor": options.error_factor,
                     "minimum_repetitions": MINIMUM_REPETITIONS, "false_discoveries": FALSE_DISCOVERIES,
                     "confidence": CONFIDENCE, "resamples": RESAMPLES, "seed": SEED},
            "notes": notes, "counts": {verdict: counts[verdict] for verdict in VERDICTS if counts[verdict]},
            "worse": any(counts[verdict] for verdict in WORSE), "rows": rows}
