"""Reads result files: JSON as the program writes it, or the same compressed by gzip, as compact.py keeps it here."""

import functools
import gzip
import json
import math
import os
import pathlib
import re
import statistics
import sys
import zlib

RESULT = 1  # the newest version of a result (results/schema.json) that these scripts read
SUFFIXES = (".json", ".json.gz")
GZIP = b"\x1f\x8b"


# Tables write the spread of repetitions beside their median if it is at least this share of the median.
MIN_SPREAD = 0.03


class BadInput(Exception):
    """The user's input cannot be used. The message says where and why."""


def refuse(script, reason):
    """Prints the reason why input cannot be used, and exits with 2."""
    print(f"{pathlib.Path(script).name}: {reason}", file=sys.stderr)
    sys.exit(2)


def end_output(script, error):
    """Ends a script whose standard output failed. A reader that has enough is no failure; a full disk exits with 2."""
    # Python's flush at exit then goes to the null device, and does not fail.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if not isinstance(error, BrokenPipeError):
        refuse(script, f"standard output: {error.strerror or error}; expected room for all of it")


def shown(value, longest=60):
    """A value as JSON for a message, cut to `longest` characters."""
    try:
        text = json.dumps(value)
    except RecursionError:
        return "a value nested too deeply to show"
    return text if len(text) <= longest else text[:longest - 3] + "..."


def finite(kind):
    """Makes a reader of numbers in JSON. A number that float64 cannot hold becomes a string, which no check takes for a number."""
    return lambda text: kind(text) if math.isfinite(float(text)) else text


def load(path):
    """Reads a result from a file of any name. Refuses it unless it is a JSON object of a version that is supported, whose `context`
    and `context.voxspring` are objects if it has them."""
    expected = "expected a result that `voxspring study` wrote"
    try:
        data = path.read_bytes()
        if data.startswith(GZIP):
            data = gzip.decompress(data)
        text = data.decode("utf-8")
        # JSON has no NaN and no Infinity. Here they become strings, which no check takes for numbers.
        result = json.loads(text, parse_constant=str, parse_int=finite(int), parse_float=finite(float))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}; {expected}") from None
    except RecursionError:
        raise BadInput(f"{path}: its JSON is nested too deeply; {expected}") from None
    except (EOFError, zlib.error, ValueError) as error:
        raise BadInput(f"{path}: {error}; {expected}") from None
    try:
        if re.search(r"\\u[dD][89a-fA-F]", text):
            json.dumps(result, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        half = json.dumps(error.object[max(0, error.start - 20):error.start + 1].rpartition('"')[2])
        raise BadInput(f"{path}: {half} ends in half a character (a lone surrogate); expected Unicode text") from None
    if not isinstance(result, dict):
        raise BadInput(f"{path}: the document: {shown(result)}: expected an object, the result of a study")
    version = result.get("schema_version", 1)  # a file without one is of version 1
    if isinstance(version, bool) or version not in range(1, RESULT + 1):
        accepted = RESULT if RESULT == 1 else f"1 to {RESULT}"
        raise BadInput(f"{path}: schema_version: {version!r}; expected {accepted}: a newer Voxspring wrote the file")
    context = result.get("context", {})
    for key, about in (("context", context), ("context.voxspring", isinstance(context, dict) and context.get("voxspring", {}))):
        if not isinstance(about, dict):
            raise BadInput(f"{path}: {key}: {shown(about)}: expected an object")
    return result


# Lists other than `verification` whose rows have a verdict on a state (`passed`, with the keys of BOUNDS), except in older files.
JUDGED = ("scaling", "overhead", "haptic", "energy")
# Keys of the bounds in a verdict, each with the key of the error that it bounds.
BOUNDS = {"tolerance": "error_max", "tolerance_rms": "error_rms", "tolerance_mean": "error_mean", "force_tolerance": "force_error"}
# The largest relative difference at which a field still agrees with its value computed from other fields.
SAME = 1e-6


def number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -math.inf < value < math.inf


def unlike(row, key, value):
    """Whether a row has a number under `key` that differs from `value` by more than the relative difference SAME."""
    return number(row.get(key)) and number(value) and abs(row[key] - value) > SAME * abs(value)


def case_of(row):
    """(name, steps as text) of a row's case. A study may step one scene by several numbers of steps."""
    return str(row.get("name")).split("/iterations:")[0], shown(row.get("steps"))


def verdict_on(row, verdicts):
    """The row of `verification` on the case of a row, {} if there is none. `verdicts`: the rows by case_of(), of which some may not
    say their steps."""
    name, steps = case_of(row)
    return verdicts.get((name, steps), verdicts.get((name, shown(None)), {}))


def contradictions(result):
    """Yields (place, value, expected) for each contradiction within a result, as a faulty program or an edit by hand leaves it."""
    rows = {name: [row for row in content if isinstance(row, dict)] for name, content in result.items() if isinstance(content, list)}
    verdicts = {case_of(row): row for row in rows.get("verification", [])}
    for name, index, row in ((name, *one) for name in ("verification", *JUDGED) for one in enumerate(rows.get(name, []))):
        strained = row.get("strained_start")
        for run, at in ((row, ""), (strained if isinstance(strained, dict) else {}, "strained_start.")):
            place = f"{name}[{index}].{at}"
            for bound, error in BOUNDS.items() if row.get("passed") else ():
                if number(run.get(bound)) and (run.get(error) is None or number(run[error]) and run[error] > run[bound]):
                    yield place + error, run.get(error), f"at most {run[bound]:g}, as {bound} says, or passed to be false"
            if number(run.get("error_max")) and number(run.get("error_rms")) and run["error_rms"] > (1 + SAME) * run["error_max"]:
                yield place + "error_rms", run["error_rms"], f"at most {run['error_max']:g}, which error_max is"
        if row.get("passed") and row.get("finite") is False:
            yield f"{name}[{index}].passed", True, "false, since the state is not finite"
    cases = groups(enumerate(rows.get("benchmarks", [])), lambda one: case_of(one[1]))
    for own in cases.values():
        (name, _), verdict = case_of(own[0][1]), verdict_on(own[0][1], verdicts)
        times = [row["real_time"] for _, row in own if row.get("run_type") == "iteration" and number(row.get("real_time"))]
        place = f"benchmarks[{own[0][0]}]"
        if verdict.get("passed") is False:
            yield place, name, "no time, since its row of verification failed"
        if number(judged := verdict.get("repetitions_judged")) and judged < len(times) and not own[0][1].get("resumed"):
            yield place, name, f"{len(times)} judged repetitions, but its row of verification has {judged}"
        for index, row in own:
            place = f"benchmarks[{index}]"
            for key in ("error_max", "error_relative_l2", "chaotic"):
                if key in row and key in verdict and row[key] != verdict[key]:
                    yield f"{place}.{key}", row[key], f"{shown(verdict[key])}, as its row of verification has"
            if row.get("run_type") == "iteration":
                if row.get("repetitions", len(times)) != len(times):
                    yield f"{place}.repetitions", row["repetitions"], f"{len(times)}, as many as there are"
            elif row.get("aggregate_name") == "median" and times and unlike(row, "real_time", statistics.median(times)):
                yield f"{place}.real_time", row["real_time"], f"{statistics.median(times):g}, the median of its repetitions"
    for index, row in enumerate(rows.get("energy", [])):
        if number(row.get("watts")) and number(row.get("seconds_per_step")) and unlike(
                row, "joules_per_step", joules := row["watts"] * row["seconds_per_step"]):
            yield f"energy[{index}].joules_per_step", row["joules_per_step"], f"{joules:g}, watts times seconds_per_step"
    for index, row in enumerate(rows.get("haptic", [])):
        due = row["missed"] if row.get("from_due") and number(row.get("missed")) else 0
        bins = row["histogram"] if isinstance(row.get("histogram"), list) else []
        bins = [one for one in bins if isinstance(one, list) and len(one) == 2 and all(map(number, one))]
        for place, ((before, _), one) in enumerate(zip(bins, bins[1:]), start=1):
            if one[0] <= before:
                yield f"haptic[{index}].histogram[{place}]", one, "where a bin begins, above the bin before, and a count above 0"
        if bins and unlike(row, "ticks", ticks := sum(count for _, count in bins) - due):
            yield f"haptic[{index}].ticks", row["ticks"], f"{ticks}, as many as the histogram has"
        known = [value for value in (row.get(f"{name}_seconds") for name in ("median", "p99", "p999", "worst")) if number(value)]
        if known != sorted(known):
            yield f"haptic[{index}].median_seconds", known, "percentiles in ascending order"
    for index, row in enumerate(rows.get("stability", [])):
        if number(row.get("theory_time_step")) and row["theory_time_step"] and number(row.get("measured_time_step")) and unlike(
                row, "ratio", ratio := row["measured_time_step"] / row["theory_time_step"]):
            yield f"stability[{index}].ratio", row["ratio"], f"{ratio:g}, the measured time step over that of theory"
    for index, row in enumerate(rows.get("stress", [])):
        if row.get("passed") and row.get("gate_is") == "at most" and number(row.get("measured")) and number(row.get("gate")) \
                and row["measured"] > row["gate"]:
            yield f"stress[{index}].measured", row["measured"], f"at most {row['gate']:g}, as gate says, or passed to be false"
    about = result.get("context", {}).get("voxspring", {})
    on = about.get("backends") if isinstance(about.get("backends"), dict) else {}
    cards = sorted({one["device"] for one in on.values() if isinstance(one, dict) and one.get("uuid") and one.get("device")})
    if cards and isinstance(about.get("gpu"), str) and about["gpu"] not in cards:
        yield "context.voxspring.gpu", about["gpu"], f"{listed(cards)}, which the backends ran on"


def check_agreement(path, result):
    """Refuses a result that contradicts itself."""
    for place, value, expected in contradictions(result):
        raise BadInput(f"{path}: {place}: {shown(value)}: expected {expected}")


@functools.cache
def validator(schema, name):
    """(the compiled check of a schema or of its part `name`, all named parts of the schema)."""
    import fastjsonschema  # pylint: disable=import-outside-toplevel  # remake.py needs no such package
    rules = json.loads(schema.read_text(encoding="utf-8"))
    return fastjsonschema.compile(rules | {"$ref": f"#/$defs/{name}"} if name else rules), rules["$defs"]


def check(path, data, schema, name="", at=""):
    """Refuses data that a schema, or its part called `name`, does not allow. The message has file, key, value and what is
    expected."""
    rules, parts = validator(schema, name)
    try:
        rules(data)
    except ValueError as error:
        place, said, wanted = at + error.name.removeprefix("data").removeprefix("." * (not at)), shown(error.value), error.definition
        if error.rule == "required":
            key = next(key for key in wanted["required"] if key not in error.value)
            place, said = f"{place}.{key}".removeprefix("."), "is missing"
            wanted = (wanted.get("properties", {}) | parts["row"]["properties"]).get(key, wanted)
            wanted = parts[wanted["$ref"].removeprefix("#/$defs/")] if "$ref" in wanted else wanted
        raise BadInput(f"{path}: {place or 'the document'}: {said}: expected {wanted.get('description', 'another value')}") from None


def name_of(row):
    """The name of a row's case: scene/backend/formulation/precision, then the tuning that is not at its default."""
    return row["name"].split("/iterations:")[0]


def aim_verdict(target, row):
    """Whether a measured target of the study fastest is "met" or "missed" by the row that was measured for it (None if the file has
    no such row). It is "not decided" if it lies within the spread of that row's starts. Files of commits before c5dff2b9 say met or
    missed even then, so the spread is compared here as well."""
    if target["quantity"] == "ready_seconds" and row and row.get("ready_spread"):
        if abs(target["value"] - target["measured"]) <= row["ready_spread"] * target["measured"]:
            return "not decided"
    if target["met"] is None:
        return "not decided"
    return "met" if target["met"] else "missed"


def study_of(path):
    """The name of a file's study: fastest for nvidia-h200/fastest.json.gz."""
    return path.name.removesuffix(".gz").removesuffix(".json")


def within(folder):
    """The result files in a folder and its subfolders, by name. A file that is there both plain and compressed counts once."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.name.endswith(SUFFIXES) and path.is_file() and not path.name.endswith("schema.json"):
            found[path.with_name(study_of(path))] = path
    return list(found.values())


def committed(folder):
    """The result files in the machines' folders within `folder`, except `local`, which belongs to the user."""
    return [path for path in within(folder) if path.parent.parent == folder and path.parent.name != "local"]


def named(folder, study):
    """The file of a study in a machine's folder."""
    return next((path for suffix in SUFFIXES[::-1] if (path := folder / (study + suffix)).exists()),
                folder / (study + SUFFIXES[-1]))


def spread_of(times):
    """Half of the interquartile range over the median, or None for fewer than three repetitions."""
    if len(times) < 3:
        return None
    low, middle, high = statistics.quantiles(times, n=4, method="inclusive")
    return (high - low) / 2 / middle if middle else None


# What a result's context says of a backend. Older files lack `title`, `limits_of` and `addressing`: only the three functions below
# derive them.
def family(about):
    """The name of the API, without its version."""
    api = about.get("api")
    return about.get("title") or (str(api).split(" ")[0] if api else "another API")


def limits_of(about):
    """The key in the context's `limits` of the limits that a step of the backend is compared with."""
    return about.get("limits_of") or re.sub(r" \d.*", "", str(about.get("api") or ""))


def addressing(name, about):
    """How neighbours are found: "implicit", by their place in the grid, or "explicit", in lists."""
    return about.get("addressing") or ("explicit" if "_explicit_" in f"{name}_" else "implicit")


# Two runs of one program differ by this share of a time even if the repetitions of each run do not.
LEAST_SPREAD = 0.01


def as_known(value, *spreads, decimals=2):
    """A ratio with the digits that its spreads justify: 92 for 91.79 with a spread of 4%. The unit of the last digit is at most
    twice the root of the sum of the squared spreads. The same rule as ratio_text() in harness/results/print.h."""
    uncertain = 2 * max(math.hypot(*(spread or 0 for spread in spreads)), LEAST_SPREAD) * abs(value)
    place = max(math.floor(math.log10(uncertain)), -decimals) if uncertain else -decimals
    return f"{round(value, -place):.{max(0, -place)}f}"


# A limit is said to bind a row that reaches at least this share of it.
MIN_BINDING = 0.6


def binder(row):
    """The name of the limit that binds a row; None if the row reaches too small a share of it to tell."""
    return row.get("limited_by") if (row.get("fraction_of_limit") or 0) >= MIN_BINDING else None


# The limits of a device that are times, of which less is better. Of all other limits more is better.
LIMITS_OF_TIME = ("launch_seconds", "grid_barrier_seconds", "exchange_seconds")


def best_limits(results):
    """{device as results call it: its limits}, each limit the best of several results of one machine. A limit in which the host's
    processors take part, such as a launch of OpenGL, differs from process to process."""
    best = {}
    for result in results:
        for name, limits in result["context"]["voxspring"].get("limits", {}).items():
            for key, value in limits.items() if isinstance(limits, dict) else ():
                if isinstance(value, (int, float)):
                    known = best.setdefault(name, {}).setdefault(key, value)
                    best[name][key] = (min if key in LIMITS_OF_TIME else max)(known, value)
    return best


def counters(result):
    """{name: its "unit", and whether "less", "more" or "neither" is "better"} of the metrics that rows have as fields of these names."""
    return result["context"]["voxspring"].get("counters", {})


def groups(rows, *keys):
    """{values of the keys: rows that have them}, in the order of their first rows. A key may also be a function of a row."""
    found = {}
    for row in rows:
        found.setdefault(tuple(key(row) if callable(key) else row[key] for key in keys), []).append(row)
    return found


def distinct(rows, key):
    return list(dict.fromkeys(row[key] for row in rows))


def listed(parts):
    """The parts as a list in a sentence: a, b and c."""
    parts = list(parts)
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def medians(benchmarks, verification):
    """The median rows of `benchmarks`, in their order, with four more keys. A case of one repetition has no median row, so its
    repetition is taken. times: those of the repetitions, or the median if there are none. bound: the bound on the row's error.
    partly: how many repetitions were verified; empty if all were. threshold: bound and partly, as tables show them."""
    times = groups((row for row in benchmarks if row.get("run_type") == "iteration"), "run_name", "steps")
    verdicts = {case_of(row): row for row in verification}

    def with_times(row):
        own = [one["real_time"] for one in times.get((row["run_name"], row["steps"]), [row])]
        verdict = verdict_on(row, verdicts)
        judged = verdict.get("repetitions_judged", len(own))
        partly = f"{judged} of {len(own)} repetitions verified" * (judged < len(own))
        bound = threshold_of(verdict)
        return row | {"times": own, "bound": bound, "partly": partly, "threshold": f"{bound} ({partly})" if partly else bound}

    return [with_times(row) for row in benchmarks if row.get("aggregate_name") == "median"
            or row.get("run_type") == "iteration" and row.get("repetitions") == 1]


def tick_seconds(row, name):
    """A time of a row of the study haptic: median, p99, p999 or worst. None for a percentile beyond which lie fewer than ten ticks:
    older files have such percentiles."""
    ticks = sum(count for _, count in row["histogram"]) if row.get("histogram") else row["ticks"]
    beyond = {"p99": 0.01, "p999": 0.001}.get(name, math.inf)
    return row[f"{name}_seconds"] if ticks * beyond >= 9.999 else None


def threshold_of(verdict):
    """The bound on the error of a row of `verification`, as a share of the motion. "chaotic" if no displacement
    is judged, "not verified" if even a backend without springs might pass, "-" if the file does not say or nothing moved. "*"
    marks the bound of a start that strains every spring."""
    strained = verdict.get("strained_start")
    run = strained or verdict
    bounds = [(run.get("tolerance_rms"), run.get("motion_rms")), (run.get("tolerance"), run.get("motion_max"))]
    if not any(motion for _, motion in bounds):
        return "-"
    found = [bound / motion for bound, motion in bounds if bound is not None and motion]
    if not found:
        return "chaotic"
    # Older files have no strained_share. Their rows are taken to strain enough springs, except rows whose
    # largest error has no bound.
    share = verdict.get("strained_share", 0 if verdict.get("tolerance") is None else 1)
    if max(share, (strained or {}).get("strained_share", 0)) < MIN_STRAINED_SHARE:
        return "not verified"
    return f"{found[0]:.1e}" + "*" * bool(strained)


# The least share of springs that a start must strain to verify a backend, as in harness/verification/errors.h.
MIN_STRAINED_SHARE = 0.5


# Lists of a result that hold no measurements, or repeat measurements of other lists.
NOT_MEASURED = ("failed", "skipped", "verification", "fastest", "auto")


def rows(paths):
    """The measured rows of files as dictionaries: first the machine's folder, study, commit and list, then the row's own fields."""
    found = []
    for path in map(pathlib.Path, paths):
        result = load(path)
        commit = result.get("context", {}).get("voxspring", {}).get("commit", "")
        for name, content in result.items():
            if name in NOT_MEASURED or not isinstance(content, list):
                continue
            front = {"machine": path.resolve().parent.name, "study": study_of(path), "commit": commit, "list": name}
            found += [front | row for row in content if isinstance(row, dict)]
    return found


def frame(paths):
    """The rows of files as a pandas DataFrame."""
    import pandas  # pylint: disable=import-outside-toplevel  # needed only here
    return pandas.DataFrame(rows(paths))
