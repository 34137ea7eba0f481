"""What changed between two results, row by row: the one rule for diff.py and for the page's history.

Rows pair by scene, backend, formulation, precision and tuning. Rows of the kinds of study that have several rows of these (PLACES)
pair by what tells such rows apart as well, such as the time step, the start or the measurement. Rows of the kind truth pair by pitch,
strain and place of the particles; the number of steps that a row of truth takes to rest may differ, as a part of its time. A tuning
parameter that only one file knows does not keep rows apart while it is at its default. A row is judged by each of its times (of a
step, a start, an edit, a late tick) and by its energy. Each of these after the first makes a separate row of the comparison.

Two runs of one program differ more than the repetitions of one run do, on a card ten times as much, because each process gets its
memory elsewhere. So two kinds of noise are measured. Within runs: the standard error of a median of repetitions (Maritz and Jarrett
1978), by Student's t of n1 + n2 - 2 degrees of freedom. Between runs: most rows of two files did not change, so the scatter of
their ratios beyond the noise within runs (Paule and Mandel 1982) is what a change has to stand out from: an empirical null (Efron
2004). Its scale is Qn (Rousseeuw and Croux 1993) over all rows of one kind on one device, which stays right while fewer than half
of the rows change. Its tails are those of a t of 4 degrees of freedom, as those of the ratios of unchanged rows are. A row's margin
is the root of the sum of the squares of both noises. The median ratio of the rows of one API on a device is the shift of the run,
caused by clocks, load, a driver or shared code. The shift is printed, and rows are judged relative to it.

With a threshold t, a row is slower if it stands out from the shift by more than its margin and takes 1 + t times as long or more.
Margins are those of Benjamini and Hochberg (1995) at 5% over all rows of a file: if nothing changed, the chance that any row is
called slower or faster is 5%. A single changed row among m has to pass the level 5%/m; several changed rows pass a less strict one.
A shift excuses at most t/2 of a row's change, so that it neither makes an unchanged row a changed one nor hides a changed one. A
run is slower as a whole if its shift is t or more (30% for times by the host's clock). It is also slower as a whole if a sign test
finds more rows that are slower by t than rows that are faster by t, since no row stands out if half of them change. A run is faster
as a whole if its shift is as large the other way. A row is the same if its 95% interval relative to the shift is within the
threshold, or if a change was found that is below the threshold. All other rows are too noisy to tell.

A change has to exceed 30% to count for a row that its run marked (`noisy`), for a backend that adds in any order, and for a kind of
row with fewer than 4 rows to measure the noise between runs. In such a kind, a time by the host's clock or without repetitions has
to change by a factor of 3. results/README.md says how often these rules are wrong.

A counter (a metric that a result's context describes) that is neither a time nor an energy has no statistics: it is better or worse
if it changed by more than the threshold in the direction that the context names. Errors are of one state and have no statistics. An
error grew if it is more than the error factor times its old value, or times the uncertainty of the float64 reference where that is
larger; smaller changes are summed up in a note. A backend that adds in any order has another error each time, so its old error counts
as at least the error that rounding alone was measured to cause in the scene.
"""

import collections
import dataclasses
import functools
import json
import math
import pathlib
import statistics

import result_files
from result_files import BadInput

HERE = pathlib.Path(__file__).resolve().parent
IDENTITY = ("scene", "backend", "formulation", "precision", "tuning")
# For each list of a result: the keys of a row's place, in which rows of the same IDENTITY differ.
PLACES = {"benchmarks": (), "pareto": ("fraction_of_stable",), "stability": ("damping", "start"),
          "stress": ("part", "measurement", "steps", "detail"), "energy": (),
          "overhead": ("handed_over",), "scaling": ("ranks", "cut", "way"), "haptic": ("hertz", "edited", "drawn"),
          "truth": ("particles_at", "strain", "across")}
# The values of keys of PLACES for rows of older files, which lack the keys.
UNSAID = {"drawn": False}
# For each list: the keys of a row's times. Rows of other lists have only `seconds`, the time of a whole run, or no time. Each
# key after the first makes a separate row of the comparison.
TIMES = {"benchmarks": ("real_time", "ready_seconds", "warm_ready_seconds", "edit_seconds_median"),
         "energy": ("seconds_per_step", "joules_per_step"), "overhead": ("seconds_per_step", "host_seconds_per_step"),
         "scaling": ("seconds_per_step",), "haptic": ("median_seconds", "p99_seconds")}
DEVICE_TIMES = {("benchmarks", "real_time"), ("benchmarks", "sustained_seconds_per_step"), ("pareto", "seconds"),
                ("truth", "seconds")}  # the backend's clock measures these, the host's clock all others
# Keys of errors, each with the key of the uncertainty of its reference, or None.
ERRORS = {"error_relative_l2": "divergence", "error_max": None, "total_error_relative_l2": "total_error_uncertainty",
          "force_error": None, "model_error": "continuum_error"}
STRESS_ERRORS = ("relative", "spacings")  # units of errors; measurements in other units are judged by their gates alone

FALSE_ALARMS = 0.05  # the fraction of files without any change in which some row is still called slower or faster
CONFIDENCE = 0.95
# The shift of a run is a factor that all of its times share. It is estimated from at least SHIFT_ROWS rows, and
# the noise between runs from at least NOISE_ROWS rows.
SHIFT_ROWS, NOISE_ROWS = 8, 4
# TAILS: degrees of freedom of Student's t for the noise between runs. With at most FEW_ROWS rows the scale of the noise is
# uncertain, too, so (rows - 1) / 2 degrees are used: by simulation that keeps false alarms below FALSE_ALARMS.
TAILS, FEW_ROWS = 4, 5
# Margins, as logarithms of a ratio, for noise that was not measured. UNKNOWN_NOISE is for rows that their run marked as noisy
# (harness/device/noise.h; an interquartile range above 10% is enough), for rows of backends that add in any order, and for rows of a
# kind with fewer than NOISE_ROWS rows. In such a kind, SINGLE_NOISE is for rows that have no repetitions or that the host's clock
# timed: in one of four studies within an hour a processor's row took 2.6 times as long. SINGLE_NOISE is also the upper bound of the
# noise between runs.
UNKNOWN_NOISE, SINGLE_NOISE = math.log(1.3), math.log(3)
# Metrics in these units are judged as times are if less is better. If more is better, as in springs per joule, the
# metric is the inverse of another one and is not judged again.
TIMED_UNITS = ("s", "J", "1/J")
# A row whose margin, the logarithm of a ratio, is larger than this counts as undecidable.
UNTELLABLE = 20
# A change counts as having reached a threshold if its logarithm falls short by no more than this rounding error.
ROUNDING = 1e-9
# The least shift of a whole run that the notes mention, as the logarithm of a ratio of times.
SAID_SHIFT = 0.002
# The size of a few roundings of float64. Sums of the same numbers in another order differ by as much.
FLOAT64_NOISE = 1e-15

CLOCKS = ("min_card_mhz", "min_mhz")
# The least differences between two set-ups that count.
NEAR = {"the card's lowest clock in MHz while rows were measured": 20, "load_avg per processor": 0.25}
# Keys of a context that describe the run, not how the machine was set up.
OF_A_RUN = ("date", "executable", "caches", "mhz_per_cpu", "commit", "clean", "counters", "limits", "study", "backends", "unfinished",
            "load_avg", "temperature_celsius", "elapsed_seconds")

WORSE = ("now fails", "error grew", "counter worse", "slower")
VERDICTS = WORSE + ("faster", "counter better", "new", "gone", "still fails", "not comparable", "too noisy to tell", "same")
JUDGED = (*WORSE, "faster", "counter better", "too noisy to tell", "same")
# The values of --fail-on, each with the verdicts for which the exit code is then 1. With `setup` it is 1 if the setups differ,
# with `missing` also if the new file lacks a backend or a kind of time.
FAIL_ON = {"missing": ("gone", "not comparable"), "undecided": ("too noisy to tell",), "setup": ()}


@dataclasses.dataclass
class Rule:
    """What a user may choose."""
    threshold: float = 0.05  # the least change of a time that counts
    error_factor: float = 1.5  # the least growth of an error that counts
    across_devices: bool = False  # compare results of two devices, each time as a multiple of its device's limit
    fail_on: tuple = ()  # keys of FAIL_ON


@dataclasses.dataclass
class Row:
    """A row of a file: a scene and a contender (backend, formulation, precision and tuning) at one place (its values
    of the keys of PLACES). `times` has one element per repetition: seconds or joules, or multiples of the device's
    limit."""
    name: str
    measure: tuple = ()  # particles, springs, steps, error_steps and end_time: two rows are comparable if these agree
    times: list = dataclasses.field(default_factory=list)
    unit: str = "s"
    kind: tuple = ()  # (list, key of the time); rows of one kind on one device have the same noise
    errors: dict = dataclasses.field(default_factory=dict)
    floors: dict = dataclasses.field(default_factory=dict)  # the uncertainty of each error's reference
    by_chance: dict = dataclasses.field(default_factory=dict)  # how large each error could be in another run of the same program
    # {name: values of the repetitions}, only for counters of which more or less is better.
    counters: dict = dataclasses.field(default_factory=dict)
    chaotic: bool = False
    # In a comparison across devices: the file does not say which share of its device's limit the row reaches.
    limitless: bool = False
    noisy: list = dataclasses.field(default_factory=list)  # why its run marked its times as not to be trusted
    failure: str = ""
    unjudged: str = ""  # why some of its times may be those of wrong states; empty if all states were verified
    unverified: int = 0  # number of its repetitions whose states were not verified


def identity_of(row):
    return tuple(row.get(key, "") for key in IDENTITY)


class Result:
    """A result file: `rows` by (identity, place), and `unmeasured`, the reasons of failed and skipped cases by identity."""

    def __init__(self, path, across):
        self.path = path
        self.json = result_files.load(path)
        result_files.check(path, self.json, HERE / "comparison.schema.json")
        result_files.check_agreement(path, self.json)
        self.context = self.json["context"]["voxspring"]
        self.backends = self.context.get("backends", {})
        self.study = self.context.get("study", {}).get("name")
        about = {name: (of.get("unit"), of["better"]) for name, of in result_files.counters(self.json).items()}
        self.less_is_better = {name: better == "less" for name, (unit, better) in about.items()
                               if better != "neither" and unit not in TIMED_UNITS}
        self.timed = {name: unit for name, (unit, better) in about.items() if better == "less" and unit in TIMED_UNITS}
        self.rows = collections.defaultdict(list)
        self.kinds, self.backends_of_rows = set(), set()
        self.verdicts = {result_files.case_of(row): row for row in self.json.get("verification", [])}
        self.unmeasured = {name: {identity_of(row): row.get("reason", "no reason given") for row in self.json.get(name, [])}
                           for name in ("failed", "skipped")}
        for list_name in PLACES:
            for index, row in enumerate(self.json.get(list_name, [])):
                if list_name != "benchmarks" or row.get("run_type", "iteration") == "iteration":
                    self.add(list_name, row, f"{list_name}[{index}].", across)
        for row in sum(self.rows.values(), []):
            if row.kind[0] == "benchmarks" and row.kind[1] != TIMES["benchmarks"][0] and len(set(row.times)) == 1:
                del row.times[1:]  # every repetition reports the same time of the start
        if not self.rows and not any(self.unmeasured.values()):
            self.refuse("the document", sorted(self.json), f"rows in any of {', '.join((*PLACES, *self.unmeasured))}")

    def unjudged(self, row):
        """Returns (why times of the row may be those of wrong states, number of repetitions that were not
        verified): ("", 0) if all were verified, or if the file is older than such fields."""
        verdict, repetitions = result_files.verdict_on(row, self.verdicts), row.get("repetitions", 1)
        if self.verdicts and not verdict:
            return "its states were not verified", repetitions
        judged = verdict.get("repetitions_judged", repetitions)
        return (f"{judged} of {repetitions} repetitions were verified", repetitions - judged) if judged < repetitions else ("", 0)

    def refuse(self, key, value, accepted):
        raise BadInput(f"{self.path}: {key}: {result_files.shown(value)}: expected {accepted}")

    def add(self, list_name, row, at, across):
        identity = identity_of(row)
        place = tuple((key, json.dumps(row.get(key, UNSAID.get(key)), sort_keys=True)) for key in PLACES[list_name])
        name = row.get("name", "/".join(identity[:4])).split("/iterations:")[0]
        entry = Row(name[len(identity[0]) + 1:].replace("/", " "), chaotic=row.get("chaotic", False), noisy=list(row.get("noisy", [])))
        if list_name == "benchmarks":
            entry.unjudged, entry.unverified = self.unjudged(row)
        elif list_name in result_files.JUDGED and "passed" not in row:
            entry.unjudged, entry.unverified = "its state was not verified", 1
        entry.measure = tuple((key, row[key]) for key in ("particles", "springs", "steps", "error_steps", "end_time")
                              if key in row and (list_name, key) != ("truth", "steps"))
        if list_name == "stress":
            if row.get("gate_is") == "at most" and row.get("unit") in STRESS_ERRORS:
                entry.errors["measured"] = row["measured"]
        else:
            entry.errors = {key: row[key] for key in ERRORS if key in row}
            entry.floors = {key: row.get(ERRORS[key]) for key in entry.errors}
            one, spread = entry.errors.get("error_relative_l2"), row.get("spread")
            if one and spread and not self.backends.get(row["backend"], {}).get("deterministic", True):
                # The backend adds in any order, so its error differs from run to run. The relative error could be
                # as large as the scene's spread; error_max is raised by the same factor.
                entry.by_chance = {key: entry.errors[key] * spread / one for key in ("error_relative_l2", "error_max")
                                   if entry.errors.get(key) is not None}
        if list_name == "stability" and result_files.number(row.get("ratio")):
            entry.counters["ratio"] = [row["ratio"]]
            self.less_is_better["ratio"] = False
        for counter in (self.less_is_better | self.timed).keys() & row.keys() - entry.counters.keys():
            value = row[counter]
            if value is not None and not (result_files.number(value) and value >= 0):
                self.refuse(at + counter, value, "a number that is not negative, or null")
            if counter in self.less_is_better:
                entry.counters[counter] = [] if value is None else [value]
        if not row.get("passed", True) or row.get("diverged", False):
            entry.failure = row.get("reason", "beyond its gate")
        first, *more = TIMES.get(list_name, ("seconds",))
        if list_name == "benchmarks" and not across and not row.get(first):
            self.refuse(at + first, row.get(first), "a number of microseconds above zero")
        entry.kind = (list_name, first)
        time = row.get("fraction_of_limit" if across else first)
        # A time as a multiple of its limit is the inverse of the fraction.
        entry.times = [1 / time if across else time * (1e-6 if list_name == "benchmarks" else 1)] if time else []
        entry.limitless = across and not time and "fraction_of_limit" in row
        self.keep(identity, place, entry)
        for key in [] if across else dict.fromkeys([*more, *self.timed]):
            if key != first and row.get(key):
                unit = self.timed.get(key, "J" if "joules" in key else "s")
                self.keep(identity, (*place, ("measured", json.dumps(key))), Row(
                    entry.name, entry.measure, [row[key]], unit, (list_name, key), noisy=list(entry.noisy)))

    def keep(self, identity, place, entry):
        """Adds a row, or adds its times to those of the row of which it is another repetition: of the same steps of the case."""
        self.kinds.add(entry.kind)
        self.backends_of_rows.add(identity[1])
        rows = self.rows[(identity, place)]
        known = next((row for row in rows if entry.kind[0] == "benchmarks" and row.measure == entry.measure), None)
        if known is None:
            rows.append(entry)
            return
        known.times += entry.times
        known.noisy += entry.noisy
        for counter, values in entry.counters.items():
            known.counters.setdefault(counter, []).extend(values)

    def card(self, backend):
        """(identity, name) of the device to which the noise of a backend belongs: the same one whatever an API calls the device."""
        name, card = self.device(backend)
        return (card, self.context.get("gpu") or name) if card else (name, name)

    def device(self, backend):
        """(name, identity of the card or "") of a backend's device. A processor's name includes its number of logical
        processors."""
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
    """Gives rows of `old` the tuning that `new` has for them. Returns the number of contenders renamed."""
    identities = [{identity: rows[0] for (identity, _), rows in result.rows.items()} for result in (old, new)]
    lone = [{i: row for i, row in mine.items() if i not in other} for mine, other in (identities, identities[::-1])]
    names = {identity: same_tuning(identity, row, lone[1]) for identity, row in lone[0].items()}
    once = collections.Counter(names.values())
    names = {identity: to for identity, to in names.items() if to and once[to] == 1}
    old.rows = {(names.get(identity, identity), place): rows for (identity, place), rows in old.rows.items()}
    return len(names)


def quartiles(times):
    return statistics.quantiles(times, n=4, method="inclusive") if len(times) > 1 else 3 * [times[0]]


@functools.cache
def weights(count):
    """The probability of each of `count` repetitions, in ascending order, to be the median of a bootstrap resample."""
    import numpy  # pylint: disable=import-outside-toplevel  # so that --help of diff.py and report.py needs no packages
    import scipy.special  # pylint: disable=import-outside-toplevel
    return numpy.diff(scipy.special.betainc((count + 1) / 2, (count + 1) / 2, numpy.arange(count + 1) / count))


def squared_error(times):
    """The squared standard error of the logarithm of the median of repetitions, after Maritz and Jarrett."""
    import numpy  # pylint: disable=import-outside-toplevel
    logarithms = numpy.log(sorted(times))
    return weights(len(times)) @ (logarithms - weights(len(times)) @ logarithms)**2


def compare_times(old, new):
    """The medians and their ratio, the spread, and the standard error of the ratio's logarithm. The last two are None without
    repetitions. judge_times() fills in the rest."""
    (low, before, high), (new_low, after, new_high) = quartiles(old), quartiles(new)
    several = min(len(old), len(new)) > 1
    return {"old": before, "new": after, "ratio": after / before, "interval": [None, None],
            "spread": max((high - low) / before, (new_high - new_low) / after) if several else None,
            "error": math.sqrt(squared_error(old) + squared_error(new)) if several else None, "shift": None, "least": None}


def scale_of(values):
    """Rousseeuw and Croux's Qn: an estimate of the standard deviation of normal values. Nearly half of them may be outliers."""
    import numpy  # pylint: disable=import-outside-toplevel
    count, half = len(values), len(values) // 2 + 1
    of_few = {4: 0.512, 5: 0.844, 6: 0.611, 7: 0.857, 8: 0.669, 9: 0.872}
    differences = numpy.abs(numpy.subtract.outer(values, values))[numpy.triu_indices(count, 1)]
    wanted = math.comb(half, 2) - 1
    return 2.2219 * numpy.partition(differences, wanted)[wanted] * of_few.get(count, count / (count + (1.4 if count % 2 else 3.8)))


def noise_between(values, errors):
    """The deviation between runs that, with the errors of medians, explains the scatter of `values` (Paule and Mandel)."""
    import numpy  # pylint: disable=import-outside-toplevel
    low, high = 0, scale_of(values)
    for _ in range(12 if errors.any() else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if scale_of(values / numpy.hypot(middle or 1, errors)) > 1 else (low, middle)
    return high


# A row that has times in both files, and what their noise depends on. device: (identity, name). by_host: whether the host's clock
# took the times. unknown: whether its run marked the row, or its backend adds in any order.
Timed = collections.namedtuple("Timed", "row device api kind by_host unknown")


def judge_times(timed, threshold):
    """Adds shift, interval and least change to the times of rows. Returns the verdict of each row, and the shifts of the run."""
    import numpy  # pylint: disable=import-outside-toplevel
    import scipy.special  # pylint: disable=import-outside-toplevel
    times, counts = [one.row["time"] for one in timed], [one.row["repetitions"] for one in timed]
    changes = numpy.log([time["ratio"] for time in times])
    # If neither file has repetitions of a row, only the noise between runs counts. If one file lacks them, its noise is unknown.
    errors = numpy.array([time["error"] if min(of) > 1 else 0 if max(of) == 1 else math.inf for time, of in zip(times, counts)])
    degrees = numpy.array([max(1, sum(of) - 2) for of in counts])
    shifts, scales, tails = (numpy.zeros(len(timed)) for _ in range(3))
    samples, lone = numpy.full(len(timed), math.inf), numpy.zeros(len(timed))
    floors = numpy.array([UNKNOWN_NOISE if one.unknown else ROUNDING for one in timed])
    together = []
    for (device, kind), numbered in result_files.groups(enumerate(timed), lambda of: of[1].device, lambda of: of[1].kind).items():
        apis = {api: [index for index, _ in of] for (api,), of in result_files.groups(numbered, lambda of: of[1].api).items()}
        everyone = sum(apis.values(), [])
        many = {api: of for api, of in apis.items() if len(of) >= SHIFT_ROWS}
        # An API with fewer than SHIFT_ROWS rows takes the shift of all rows of its device.
        for of in [everyone] * (len(everyone) >= SHIFT_ROWS) + list(many.values()):
            shifts[of], samples[of] = numpy.median(changes[of]), len(of)
        told = [index for index in everyone if errors[index] < math.inf]
        if len(told) >= NOISE_ROWS:
            scales[everyone] = noise_between(changes[told] - shifts[told], errors[told])
        else:
            lone[everyone] = [SINGLE_NOISE if max(counts[index]) == 1 or timed[index].by_host else UNKNOWN_NOISE for index in everyone]
        tails[everyone] = TAILS if len(everyone) > FEW_ROWS else max(1, len(everyone) - 1) / 2
        if len(everyone) >= SHIFT_ROWS:
            together += [(device, api, kind, of) for api, of in (many or {" and ".join(sorted(apis)): everyone}).items()]

    def student(chance, freedom):
        values, places = numpy.unique(freedom, return_inverse=True)
        return -scipy.special.stdtrit(values, chance / 2)[places]

    def margins(chance, unmeasured):
        # The shift is a median of `samples` rows, whose own error is added.
        between = student(chance, tails) * scales * numpy.sqrt(1 + math.pi / 2 / samples)
        within = student(chance, degrees) * errors
        return numpy.hypot(numpy.maximum(numpy.minimum(between, SINGLE_NOISE), unmeasured), within)

    least, excused = math.log1p(threshold), math.log1p(threshold / 2)
    rest, effects, tests = changes - shifts, changes - numpy.clip(shifts, -excused, excused), len(timed) + 2 * len(together)
    # How far a row is from unchanged, however the shift is read: as a drift of the run (rest), or as a change
    # of most rows (effects).
    strengths = numpy.where(rest * effects > 0, numpy.minimum(abs(rest), abs(effects)), 0)
    # Benjamini and Hochberg: the largest count of rows that pass the level for that count.
    count, found = len(timed), numpy.zeros(len(timed), bool)
    while count and (found := strengths > numpy.maximum(margins(FALSE_ALARMS * count / tests, lone), floors)).sum() < count:
        count = int(found.sum())
    needed, uncertain = numpy.maximum(margins(FALSE_ALARMS / tests, lone), floors), margins(1 - CONFIDENCE, 0)
    signs = numpy.where(abs(effects) >= least - ROUNDING, numpy.sign(effects), 0)
    verdicts = []
    for index, time in enumerate(times):
        time["shift"] = math.exp(shifts[index]) if samples[index] < math.inf else None
        if needed[index] < UNTELLABLE:
            time["least"] = math.expm1(needed[index])
        if 0 < uncertain[index] < UNTELLABLE:
            time["interval"] = [math.exp(changes[index] - uncertain[index]), math.exp(changes[index] + uncertain[index])]
        if found[index] and signs[index]:
            verdicts.append("slower" if signs[index] > 0 else "faster")
        else:
            verdicts.append("same" if found[index] or abs(rest[index]) + uncertain[index] <= least else "too noisy to tell")
    said = []
    for device, api, kind, of in together:
        shift, on_host = shifts[of[0]], sum(timed[index].by_host or timed[index].unknown for index in of) > len(of) / 2
        error = student(FALSE_ALARMS / tests, tails[of])[0] * scales[of[0]] * math.sqrt(math.pi / 2 / len(of))
        verdict = int(numpy.sign(shift)) if abs(shift) >= max(error, UNKNOWN_NOISE if on_host else least - ROUNDING) else 0
        slow, fast = (int(sum(signs[of] == sign)) for sign in (1, -1))
        if not (verdict or on_host) and slow > fast and scipy.special.bdtrc(slow - 1, slow + fast, 0.5) < FALSE_ALARMS / tests:
            verdict = 1
        said.append({"device": device[1], "api": api, "measured": kind[1], "rows": len(of), "ratio": math.exp(shift),
                     "interval": [math.exp(shift - error), math.exp(shift + error)], "slow": slow, "fast": fast,
                     "verdict": {1: "slower", -1: "faster"}.get(verdict, "same")})
    return verdicts, said


@functools.cache
def is_clearly_slower(times, other, marked):
    """Whether `other` takes longer than `times` (two rows of one run) by more than the threshold and than repetitions vary by."""
    import scipy.special  # pylint: disable=import-outside-toplevel
    if min(len(times), len(other)) < 3:
        return False
    found = compare_times(times, other)
    margin = -scipy.special.stdtrit(len(times) + len(other) - 2, (1 - CONFIDENCE) / 2) * found["error"]
    return math.log(found["ratio"]) > max(math.log1p(Rule.threshold), margin, UNKNOWN_NOISE if marked else 0)


def grown(old, new, factor):
    """Names the errors that grew, with their old and new values."""
    words = []
    for key in [] if old.chaotic or new.chaotic else old.errors.keys() & new.errors.keys():
        before, after = old.errors[key], new.errors[key]
        # The study may not have asked for a total error. Any other error that is missing was not finite.
        if before is None or after is None and key.startswith("total"):
            continue
        floor = max(FLOAT64_NOISE, old.floors.get(key) or 0, new.floors.get(key) or 0, old.by_chance.get(key, 0))
        if after is None or after > factor * max(before, floor):
            words.append(f"{key} {before:.1e} -> {'not finite' if after is None else format(after, '.1e')}")
    return ", ".join(sorted(words))


def moved(counters, less_is_better, threshold):
    """[names of the counters that became worse, names of those that became better], with their old and new values."""
    words = ([], [])
    for name, (before, after) in sorted(counters.items()):
        if max(before, after) > (1 + threshold) * min(before, after):
            words[(after > before) != less_is_better[name]].append(f"{name} {before:.6g} -> {after:.6g}")
    return [", ".join(of) for of in words]


def pair(old, new, options):
    """The compared rows, and by how much the rows of each API on each device moved together: two lists of results/diff.schema.json."""
    compared, timed, reasons = [], [], {}
    for identity, place in dict.fromkeys([*old.rows, *new.rows]):
        before, after = old.rows.get((identity, place), []), new.rows.get((identity, place), [])
        whole = tuple(of for of in place if of[0] != "measured")
        if whole != place and (((identity, whole) in old.rows) != ((identity, whole) in new.rows) or
                               old.kinds.isdisjoint(kinds := {row.kind for row in before + after}) or new.kinds.isdisjoint(kinds)):
            continue  # the row of the case is gone or new as a whole, or one file has no time or energy of this kind at all
        for index in range(max(len(before), len(after))):
            a, b = (rows[index] if index < len(rows) else None for rows in (before, after))
            row = dict(zip(IDENTITY, identity), place={key: json.loads(value) for key, value in place},
                       contender=(b or a).name, verdict="", detail="", unit="times_limit" if options.across_devices else (b or a).unit,
                       repetitions=[len(r.times) if r else 0 for r in (a, b)], time=None, errors=None, counters=None)
            compared.append(row)
            if a and b:
                row["errors"] = {key: [a.errors[key], b.errors[key]] for key in a.errors if key in b.errors}
                differ = [f"{key} {dict(a.measure)[key]} -> {value}" for key, value in b.measure
                          if dict(a.measure).get(key, value) != value]
                if not differ and a.times and b.times:
                    row["time"] = compare_times(a.times, b.times)
                row["verdict"], row["detail"] = judge_state(a, b, row, differ, options)
                row["counters"] = {name: [statistics.median(one.counters[name]) for one in (a, b)] for name in a.counters
                                   if a.counters[name] and b.counters.get(name)}
                worse, better = moved(row["counters"], new.less_is_better | old.less_is_better, options.threshold)
                if row["verdict"] in ("", "same") and (worse or better):
                    row["verdict"], row["detail"] = f"counter {'worse' if worse else 'better'}", "; ".join(filter(None, (worse, better)))
                if row["time"] and row["verdict"] in ("", "error grew", "counter worse", "counter better"):
                    on = new.backends.get(row["backend"], {})
                    any_order = not on.get("deterministic", True)
                    reasons[id(row)] = "; ".join(dict.fromkeys(a.noisy + b.noisy + ["the backend adds in any order"] * any_order))
                    timed.append(Timed(row, new.card(row["backend"]), result_files.limits_of(on) or "any API", b.kind,
                                       on.get("clock") == "steady_clock" or b.kind not in DEVICE_TIMES, bool(reasons[id(row)])))
            elif b:
                failed = identity in old.unmeasured["failed"]
                row["verdict"], row["detail"] = (("now fails", b.failure) if b.failure else
                                                 ("new", "failed before" * failed))
            elif identity in new.unmeasured["failed"]:
                row["verdict"], row["detail"] = "now fails", new.unmeasured["failed"][identity]
            else:
                reason = new.unmeasured["skipped"].get(identity)
                row["verdict"], row["detail"] = "gone", f"skipped: {reason}" if reason else ""
    verdicts, shifts = judge_times(timed, options.threshold) if timed else ([], [])
    for row, verdict in zip((one.row for one in timed), verdicts):
        if not row["verdict"] or verdict == "slower" and row["verdict"] not in WORSE:
            row["verdict"], row["detail"] = verdict, "; ".join(filter(None, (reasons[id(row)] * (verdict != "same"), row["detail"])))
        elif verdict in ("slower", "faster"):
            row["detail"] += f"; {verdict}"
    known = {tuple(row[key] for key in IDENTITY) for row in compared if row["verdict"].endswith("fails")}
    for identity, reason in new.unmeasured["failed"].items():
        if identity not in known:
            verdict = "still fails" if identity in old.unmeasured["failed"] else "now fails"
            compared.append(dict(zip(IDENTITY, identity), place={}, contender=" ".join(identity[1:4]), verdict=verdict,
                                 detail=reason, unit="s", repetitions=[0, 0], time=None, errors=None, counters=None))
    return sorted(compared, key=lambda row: VERDICTS.index(row["verdict"])), shifts


def judge_state(a, b, row, differ, options):
    """(verdict, detail) of two rows by all but their times. An empty verdict leaves the decision to the times."""
    if b.failure:
        return ("still fails" if a.failure else "now fails"), b.failure
    if a.failure:
        return "new", "failed before"
    if differ:
        return "not comparable", ", ".join(differ)
    if b.unverified > a.unverified:
        return "not comparable", b.unjudged
    if words := grown(a, b, options.error_factor):
        return "error grew", words
    if row["time"]:
        return "", ""
    if options.across_devices and (a.limitless or b.limitless):
        return "not comparable", "what limits one of the devices is not known"
    return "same", ""


def check_devices(old, new, options):
    """Refuses files without a common backend, and results of two devices unless options.across_devices asks for them."""
    backends = [result.backends_of_rows for result in (old, new)]
    tried = [of | {identity[1] for identity in result.unmeasured["failed"]} for of, result in zip(backends, (old, new))]
    if not tried[0] & tried[1]:
        raise BadInput(f"{new.path}: rows: {', '.join(sorted(tried[1])) or 'none'}: expected a backend that {old.path} has: "
                       f"{', '.join(sorted(tried[0])) or 'none'}")
    for backend in sorted(backends[0] & backends[1]):
        before, after = old.device(backend)[0], new.device(backend)[0]
        if before != after and not options.across_devices:
            raise BadInput(f"{new.path}: context.voxspring.backends.{backend}.device: {json.dumps(after)}: expected "
                           f"{json.dumps(before)}, as in {old.path}, or --across-devices to compare fractions of their limits")


def setup(old, new):
    """Lines on how the set-up and the load of the machines of two results differ, of the keys that both files have."""
    def flat(value, name=""):
        if not isinstance(value, dict):
            return {name: value}
        return {key: one for own, of in value.items() if own not in OF_A_RUN for key, one in flat(of, own).items()}

    said = []
    for result in (old, new):
        context = {(key, ""): value for key, value in flat(result.json["context"]).items()}
        context |= {(key, name): value for name, on in result.backends.items() for key, value in on.items() if key != "device"}
        if clocks := [row[key] for name in PLACES for row in result.json.get(name, []) for key in CLOCKS if row.get(key)]:
            context["the card's lowest clock in MHz while rows were measured", ""] = statistics.median(clocks)
        if load := result.json["context"].get("load_avg"):
            context["load_avg per processor", ""] = round((load[0] or 0) / (result.json["context"].get("num_cpus") or 1), 2)
        said.append(context)
    found = collections.defaultdict(list)
    for key, name in sorted(said[0].keys() & said[1].keys()):
        before, after = said[0][key, name], said[1][key, name]
        if before != after and not (key in NEAR and abs(before - after) < NEAR[key]):
            found[key, result_files.shown(before, 200), result_files.shown(after, 200)].append(name)
    return [f"{key}{' of ' * any(names)}{', '.join(names[:3])}{' and others' * (len(names) > 3)}: {before} -> {after}"
            for (key, before, after), names in found.items()]


def absent(old, new):
    """The backends and the measurements that only the first of two files has."""
    return sorted(old.backends_of_rows - new.backends_of_rows) + sorted(name for _, name in old.kinds - new.kinds)


def notes_on(old, new, rows, shifts, options):
    """The notes on two results as wholes, printed beside their rows."""
    notes = []
    said = [shift for shift in shifts if abs(math.log(shift["ratio"])) > SAID_SHIFT]
    if said:
        notes.append("the run as a whole moved, by clocks, load, driver or shared code; rows are judged relative to that: " + ", ".join(
            f"{of['api']} on {of['device']} by x {of['ratio']:.3f} (measured by {of['measured']} of {of['rows']} rows)" for of in said))
    told = [row for row in rows if row["time"] and row["time"]["least"] is not None]
    if told:
        changes = [f"from {size:.0%} on in {sum(row['time']['least'] <= size for row in told)}"
                   for size in dict.fromkeys((options.threshold, 0.1))]
        notes.append(f"of {len(told)} rows with times, a change of a single row would be found: {', '.join(changes)}")
    moved_errors = [(after / before, row) for row in rows for before, after in (row["errors"] or {}).values()
                    if before and after and after != before and row["verdict"] != "error grew"]
    if moved_errors:
        ratio, row = max(moved_errors, key=lambda one: abs(math.log(one[0])))
        notes.append(f"{len(moved_errors)} errors changed, so bits differ, but none grew enough to count; the largest change is x {ratio:.3g} "
                     f"({row['scene']} {row['contender']})")
    if gone := absent(old, new):
        notes.append(f"the new file has no row of {result_files.listed(gone)}")
    if not any(row["verdict"] in JUDGED for row in rows):
        notes.append("nothing was judged: no row of one file can be compared with a row of the other")
    if old.study != new.study:
        notes.append(f"the studies differ ({old.study}, {new.study}), so other cases ran before and between those compared")
    cut_short = [result.path.name for result in (old, new) if result.context.get("unfinished")]
    return notes + [f"{name} is unfinished: its study was cut short" for name in cut_short]


def document(old_path, new_path, options):
    """The comparison of two files, as diff.schema.json describes it; `options` is a Rule."""
    old, new = (Result(path, options.across_devices) for path in (old_path, new_path))
    renamed = rename(old, new)
    check_devices(old, new, options)
    rows, shifts = pair(old, new, options)
    differs, notes = setup(old, new), notes_on(old, new, rows, shifts, options)
    if renamed:
        notes.append(f"{renamed} contenders have tuning parameters at their default that the other file lacks")
    counts = collections.Counter(row["verdict"] for row in rows)
    about = [{"file": result.path.name, "date": str(result.json["context"].get("date", "")),
              "commit": str(result.context.get("commit", "unknown")), "clean": result.context.get("clean"),
              "study": result.study} for result in (old, new)]
    fails = [f"{counts[verdict]} {verdict}" for verdict in WORSE if counts[verdict]]
    fails += [f"{of['api']} on {of['device']} is slower as a whole: x {of['ratio']:.3f}, {of['slow']} of {of['rows']} rows"
              for of in shifts if of["verdict"] == "slower"]
    for name in options.fail_on:
        fails += [f"setup: {text}" for text in differs] if name == "setup" else [
            f"{counts[verdict]} {verdict}" for verdict in FAIL_ON[name] if counts[verdict]]
        fails += [f"no {gone}" for gone in absent(old, new)] if name == "missing" else []
    return {"version": 2, "old": about[0], "new": about[1],
            "time": "times_limit" if options.across_devices else "seconds_per_step",
            "rule": {"threshold": options.threshold, "error_factor": options.error_factor, "false_alarms": FALSE_ALARMS,
                     "confidence": CONFIDENCE, "unknown_noise": math.expm1(UNKNOWN_NOISE), "single_noise": math.expm1(SINGLE_NOISE)},
            "setup": differs, "shifts": shifts, "notes": notes,
            "counts": {verdict: counts[verdict] for verdict in VERDICTS if counts[verdict]},
            "worse": bool(fails), "fails": fails, "rows": rows}
