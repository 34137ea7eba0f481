"""Results of studies as rows that figures are drawn from.

A file that is not what schema.json says is refused with its path, the key and the value. Only what the page needs is
looked at, so that files of older versions, which lack newer keys, are read as well.
"""

import math
import pathlib
import re
from dataclasses import dataclass, field

import result_files
from result_files import BadInput, shown


class Positive(float):
    """In the tables below: a number above zero."""


REGIONS = ("bounded", "heating", "diverged")
# The lists that a file may have, and which keys of a row the page cannot do without.
REQUIRED = {
    "benchmarks": {"name": str, "run_name": str, "scene": str, "backend": str, "formulation": str, "precision": str,
                   "real_time": Positive, "steps": int, "particles": int, "springs": int},
    "pareto": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "device": str,
               "fraction_of_stable": Positive, "end_time": float, "steps": int, "on_front": bool},
    "fastest": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str,
                "seconds_per_step": Positive, "targets": list},
    "stability": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "damping": float,
                  "start": dict, "ratio": Positive, "passed": bool},
    "stability_map": {"name": str, "scene": str, "backend": str, "damping": list, "fraction": list, "region": list,
                      "amplitude": float, "steps": int},
    "stress": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "measurement": str,
               "steps": int, "gate_is": str, "passed": bool},
    "scaling": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "family": str, "scaling": str,
                "ranks": int, "way": str, "particles": int, "seconds_per_step": Positive, "compute_seconds": float,
                "exchange_seconds": float, "waiting_seconds": float},
    "haptic": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "hertz": Positive, "edited": bool,
               "ticks": int, "median_seconds": Positive, "p99_seconds": Positive, "p999_seconds": Positive,
               "worst_seconds": Positive, "missed": int, "steps_that_fit": int},
    "overhead": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "particles": int, "handed_over": str,
                 "steps": int, "seconds_per_step": Positive, "host_seconds_per_step": float},
    "energy": {"name": str, "scene": str, "backend": str, "formulation": str, "precision": str, "particles": int, "meter": str,
               "seconds_per_step": Positive, "joules_per_step": Positive, "springs_per_joule": Positive, "watts": Positive,
               "idle_watts": float},
    "failed": {"name": str, "scene": str, "backend": str, "reason": str},
    "skipped": {"name": str, "scene": str, "backend": str, "reason": str},
}
# Those of which a figure is made.
MEASURED = tuple(name for name in REQUIRED if name not in ("fastest", "failed", "skipped"))
# What older files lack, or is null where it is not known.
OPTIONAL = {
    **dict.fromkeys(("limit_seconds", "fraction_of_limit", "error_relative_l2", "error_max", "error_steps", "edits",
                     "edit_seconds_median", "seconds_per_step_without_edits", "total_error_relative_l2", "seconds", "gate",
                     "measured", "particles", "step_bytes", "efficiency", "predicted_seconds", "step_footprint_bytes", "step_operations",
                     "pictures_per_second"), float),
    **dict.fromkeys(("aggregate_name", "run_type", "tuning", "limited_by", "unit", "detail", "cut"), str), "drawn": bool, "histogram": list,
}
WHAT = {str: "text", float: "a number", Positive: "a number above 0", int: "a whole number",
        bool: "true or false", list: "a list", dict: "an object"}


@dataclass
class Result:
    """One file. machine is what its times are of: the GPU, or the processor where there is none, and what tells it apart from others
    on the page that are called alike."""

    path: pathlib.Path
    study: str
    machine: str
    driver: str
    commit: str
    date: str
    lists: dict = field(repr=False)
    limits: dict = field(repr=False)  # what was measured of the device of each backend
    cores: int = None
    host: str = ""
    cards: tuple = ()  # their identities

    @property
    def short_commit(self):
        return self.commit[:7]

    def origin(self):
        """Where and when, for the caption of a figure."""
        driver = f", driver {self.driver}" if self.driver else ""
        return f"{self.machine}{driver}, commit {self.commit}, {self.date[:10]}"


def is_a(value, kind):
    if kind in (float, Positive):
        return result_files.is_finite(value) and (kind is float or value > 0)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, kind)


def is_texts(value):
    return isinstance(value, list) and all(isinstance(item, str) for item in value)


def need(path, where, holder, key, kind):
    """holder[key], or a refusal that names the file, the key and the value."""
    place = f"{where}.{key}" if where else key
    if key not in holder:
        raise BadInput(f"{path}: {place}: is missing; expected {WHAT[kind]}")
    if not is_a(holder[key], kind):
        raise BadInput(f"{path}: {place}: {shown(holder[key])}; expected {WHAT[kind]}")
    return holder[key]


def check_map(path, where, row):
    for key in ("damping", "fraction"):
        if not row[key] or not all(is_a(value, float) for value in row[key]):
            raise BadInput(f"{path}: {where}.{key}: {shown(row[key])}; expected numbers")
    if len(row["region"]) != len(row["damping"]):
        raise BadInput(f"{path}: {where}.region: {len(row['region'])} rows; expected one for each of the "
                       f"{len(row['damping'])} values of damping")
    for line in row["region"]:
        if not isinstance(line, list) or len(line) != len(row["fraction"]) or any(r not in REGIONS for r in line):
            raise BadInput(f"{path}: {where}.region: {shown(line)}; expected {len(row['fraction'])} of "
                           f"{', '.join(REGIONS)}")


def check_fastest(path, where, row):
    for index, target in enumerate(row["targets"]):
        place = f"{where}.targets[{index}]"
        if not isinstance(target, dict):
            raise BadInput(f"{path}: {place}: {shown(target)}; expected an object")
        need(path, place, target, "quantity", str)
        need(path, place, target, "value", Positive)
        if target.get("measured") is not None:
            need(path, place, target, "measured", float)
    if row.get("paper") is not None:
        paper = need(path, where, row, "paper", dict)
        need(path, f"{where}.paper", paper, "name", str)
        need(path, f"{where}.paper", paper, "ratio", Positive)


def check_histogram(path, where, row):
    last = 0
    for index, entry in enumerate(row.get("histogram") or []):
        good = isinstance(entry, list) and len(entry) == 2 and is_a(entry[0], Positive) and is_a(entry[1], int)
        if not good or entry[1] < 1 or not last < entry[0] <= 1:
            raise BadInput(f"{path}: {where}.histogram[{index}]: {shown(entry)}; expected where a bin begins, beyond the one before, "
                           "and a count above 0")
        last = entry[0]


# Rates of arithmetic: of a device the highest counts.
OPERATIONS = ("float32_operations_per_second", "compute_shader_float32_operations_per_second")


def limits_of(path, about):
    """The measured limits of the device of each backend; nothing for a device that gave none."""
    apis = need(path, "context.voxspring", about, "backends", dict) if "backends" in about else {}
    by_api = {}
    for name, limits in (need(path, "context.voxspring", about, "limits", dict) if "limits" in about else {}).items():
        where = f"context.voxspring.limits.{name}"
        if not isinstance(limits, dict) or not limits.get("bandwidth"):
            continue
        for index, entry in enumerate(need(path, where, limits, "bandwidth", list)):
            for key in ("footprint_bytes", "written_share", "bytes_per_second"):
                need(path, f"{where}.bandwidth[{index}]", entry, key, float if key == "written_share" else Positive)
        for key in OPERATIONS:
            if key == OPERATIONS[0] or key in limits:
                need(path, where, limits, key, Positive)
        by_api[need(path, where, limits, "api", str)] = limits
    return {backend: by_api[one["api"]] for backend, one in apis.items()
            if isinstance(one, dict) and isinstance(one.get("api"), str) and one["api"] in by_api}


def roofs(limits):
    """Of a device: bytes per second through memory and through the cache, by what they are, and operations per second."""
    table = limits["bandwidth"]
    beyond = max(entry["footprint_bytes"] for entry in table)
    memory = {entry["written_share"]: entry["bytes_per_second"] for entry in table if entry["footprint_bytes"] == beyond}
    bytes_per_second = {"memory": memory[min(memory)], "memory, half written": memory[max(memory)],
                        "cache": max(entry["bytes_per_second"] for entry in table)}
    return bytes_per_second, max(limits[key] for key in OPERATIONS if key in limits)


# Below which of them a line of text says what they are.
ROOF_LABELS = {"memory, half written": "memory (dashed: half written)", "cache": "cache"}


def rooflines(limits, rows):
    """The roofs above rows: those of a card from CUDA where that is among them, as OpenGL and Vulkan are on the same card."""
    families = {row["family"] for row in rows}
    shown = families - ({"OpenGL", "Vulkan"} if "CUDA" in families else set())
    found = {}
    for row in rows:
        if row["family"] in shown and row["backend"] in limits:
            found.setdefault(row["family"], roofs(limits[row["backend"]]))
    return found


def read(path):
    """The result in a file."""
    data = result_files.load(path)
    context = need(path, "", data, "context", dict)
    about = need(path, "context", context, "voxspring", dict)
    where = "context.voxspring"
    study = need(path, where, need(path, where, about, "study", dict), "name", str)
    machine = about["gpu"] if isinstance(about.get("gpu"), str) else need(path, where, about, "cpu", str)
    lists = {}
    for name, keys in REQUIRED.items():
        rows = need(path, "", data, name, list) if name in data else []
        for index, row in enumerate(rows):
            place = f"{name}[{index}]"
            if not isinstance(row, dict):
                raise BadInput(f"{path}: {place}: {shown(row)}; expected an object")
            for key, kind in keys.items():
                need(path, place, row, key, kind)
            for key, kind in OPTIONAL.items():
                if row.get(key) is not None:
                    need(path, place, row, key, kind)
            for key in ("noisy", "throttled"):
                if not is_texts(row.get(key, [])):
                    raise BadInput(f"{path}: {place}.{key}: {shown(row[key])}; expected a list of text")
            if row.get("time_unit", "us") != "us":
                raise BadInput(f"{path}: {place}.time_unit: {shown(row['time_unit'])}; expected \"us\"")
            if name == "stability":
                need(path, f"{place}.start", row["start"], "kind", str)
                need(path, f"{place}.start", row["start"], "amplitude", float)
            if name == "stability_map":
                check_map(path, place, row)
            if name == "fastest":
                check_fastest(path, place, row)
            if name == "haptic":
                check_histogram(path, place, row)
        lists[name] = rows
    driver = about.get("driver") if isinstance(about.get("driver"), str) else ""
    cores = need(path, "context", context, "num_cpus", int) if context.get("num_cpus") is not None else None
    host = need(path, "context", context, "host_name", str) if context.get("host_name") is not None else ""
    return Result(path, study, machine, driver, need(path, where, about, "commit", str),
                  need(path, "context", context, "date", str), lists, limits_of(path, about), cores, host, cards_of(path, about))


def cards_of(path, about):
    """The identities of the cards that a file is of; none of a processor or of a device that has none."""
    backends = need(path, "context.voxspring", about, "backends", dict) if "backends" in about else {}
    found = [need(path, f"context.voxspring.backends.{name}", one, "uuid", str) for name, one in backends.items()
             if isinstance(one, dict) and one.get("uuid")]
    return tuple(sorted(set(found)))


def tell_apart(results):
    """Gives machines that are not one and are called alike names of their own. A card is known by its identity. What has none, a
    processor, is the same one where cores and host are; files do not always name the host, and then it is that of their folder."""
    def traits(result):
        at = result.host or (result.path.resolve().parent if not result.cards else "")
        return {"cores": f"{result.cores} cores" if result.cores else "", "card": ", ".join(card[:12] for card in result.cards),
                "at": at if isinstance(at, str) else at.name, "path": str(at), "cards": result.cards}
    alike = {}
    for result in results:
        alike.setdefault(result.machine, []).append((result, traits(result)))
    for name, entries in alike.items():
        if len({tuple(found.values()) for _, found in entries}) == 1:
            continue
        words = [key for key in ("cores", "card", "at") if len({found[key] for _, found in entries}) > 1]
        if len({tuple(found[key] for key in words) for _, found in entries}) < len({tuple(found.values()) for _, found in entries}):
            words = [key for key in words if key != "at"] + ["path"]
        for result, found in entries:
            result.machine = f"{name} ({', '.join(filter(None, (found[key] for key in words))) or 'unnamed'})"
    return results


def read_all(paths):
    """The results in files and, recursively, folders, by date."""
    files = []
    for path in paths:
        if path.is_dir():
            found = result_files.within(path)
            if not found:
                raise BadInput(f"{path}: holds no .json or .json.gz file; expected results of studies")
            files += found
        else:
            files.append(path)
    # A file that is named beside its folder counts once.
    unique = {file.resolve(): file for file in files}
    return tell_apart(sorted((read(file) for file in unique.values()), key=lambda result: result.date))


def significant(value, digits=5):
    """A number rounded as far as anybody reads it, which keeps the page small; all else as it is."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if math.isfinite(value) else None
    return value


def contender(row):
    """The backend, its formulation, its precision unless float32, and what tuning is not at its default."""
    parts = row["name"].removeprefix(row["scene"] + "/").split("/iterations:")[0].split("/")[3:]
    words = [row["backend"], row["formulation"]] + [row["precision"]] * (row["precision"] != "float32") + parts
    return " ".join(words)


def short_contender(name):
    """A name of diff.py's as contender() has it."""
    words = name.split(" ")
    return " ".join(words[:2] + [word for word in words[2:3] if word != "float32"] + words[3:])


def family(backend):
    """What a backend's times are to be told apart by: the API in its name."""
    return {"cuda": "CUDA", "vulkan": "Vulkan", "gl": "OpenGL", "cpu": "CPU"}.get(backend.split("_")[0], "another API")


def moved_and_computed(row):
    """What a step moves and computes; nothing where the file does not say. A step that moves nothing, whose state stays on the
    chip, has a rate of operations and no operations per byte."""
    moved, footprint, operations = (row.get(f"step_{what}") or 0 for what in ("bytes", "footprint_bytes", "operations"))
    on_chip = row.get("step_bytes") == 0 and operations > 0
    if not on_chip and min(moved, footprint, operations) <= 0:
        return {"operations_a_byte": None, "operation_rate": None, "footprint": None}
    return {"operations_a_byte": None if on_chip else operations / moved, "operation_rate": operations / row["real_time"] * 1e-3,
            "footprint": footprint / 2**20 or None}


def measured(results):
    """A row for each contender, scene and file: the median over the repetitions, with the least and the most of them."""
    rows = []
    for result in results:
        spread = {}
        for row in result.lists["benchmarks"]:
            if row.get("run_type") == "iteration":
                spread.setdefault((row["run_name"], row["steps"]), []).append(row["real_time"])
        for row in result.lists["benchmarks"]:
            if row.get("aggregate_name") != "median":
                continue
            times = spread.get((row["run_name"], row["steps"]), [row["real_time"]])
            limit = row.get("limit_seconds")
            edit = row.get("edit_seconds_median")
            rows.append({
                "machine": result.machine, "study": result.study, "commit": result.short_commit, "date": result.date,
                "scene": row["scene"], "backend": row["backend"], "family": family(row["backend"]),
                "contender": contender(row), "formulation": row["formulation"], "precision": row["precision"],
                "tuning": row.get("tuning", ""), "steps": row["steps"], "particles": row["particles"],
                "microseconds": row["real_time"], "least": min(times), "most": max(times),
                "repetition_times": tuple(times),
                "particle_rate": row["particles"] / row["real_time"] * 1e6,
                "spring_rate": row["springs"] / row["real_time"] * 1e6,
                "limit_microseconds": limit * 1e6 if limit else None, "limited_by": row.get("limited_by"),
                "of_limit": row.get("fraction_of_limit"),
                **moved_and_computed(row), "rounding": row.get("error_relative_l2"),
                "rounding_max": row.get("error_max"), "total": row.get("total_error_relative_l2"),
                "error_steps": row.get("error_steps", row["steps"]), "edits": row.get("edits"),
                "edit_microseconds": edit * 1e6 if edit is not None else None,
                "without_edits": row.get("seconds_per_step_without_edits"),
                "noisy": "; ".join(row.get("noisy", [])),
            })
    return rows


def latest(rows, *keys):
    """Of rows in the order of their dates, the last one for each combination of the keys."""
    return list({tuple(row[key] for key in keys): row for row in rows}.values())


def strategies(rows):
    """Of measured rows one a contender and scene: the latest of each study, and of these the one of most steps, among whose steps
    what a launch costs is spread the most."""
    rows = latest(rows, "machine", "scene", "contender", "study")
    return latest(sorted(rows, key=lambda row: row["steps"]), "machine", "scene", "contender")


def pareto(results):
    """A row for each run to a scene's end time that has a time and a total error."""
    return [{"machine": result.machine, "device": row["device"], "scene": row["scene"], "backend": row["backend"],
             "family": family(row["backend"]), "contender": contender(row), "formulation": row["formulation"],
             "precision": row["precision"], "fraction": row["fraction_of_stable"], "steps": row["steps"],
             "particles": row.get("particles"),
             "end_time": row["end_time"], "seconds": row["seconds"], "total": row["total_error_relative_l2"],
             "rounding": row.get("error_relative_l2"), "front": row["on_front"]}
            for result in results for row in result.lists["pareto"]
            if row.get("seconds") and row.get("total_error_relative_l2")]


def scaling(results):
    """A row for each number of ranks and way that has an efficiency; what the model predicts is an efficiency as well."""
    return [{"machine": result.machine, "scene": row["scene"], "backend": row["backend"], "family": family(row["backend"]),
             "contender": contender(row), "compared": row["family"], "scaling": row["scaling"], "ranks": row["ranks"],
             "cut": row.get("cut", ""), "parts": "bricks" if sum(parts > 1 for parts in along_axes(row)) > 1 else "slabs",
             "way": row["way"], "particles": row["particles"], "microseconds": row["seconds_per_step"] * 1e6,
             **{name: row[f"{name}_seconds"] * 1e6 for name in ("compute", "exchange", "waiting")},
             "efficiency": row["efficiency"],
             "predicted": row["efficiency"] * row["seconds_per_step"] / row["predicted_seconds"],
             "noisy": "; ".join(row.get("noisy", []))}
            for result in results for row in result.lists["scaling"] if row.get("efficiency") and row.get("predicted_seconds")]


# Ranks that nobody here has measured.
FORECAST_RANKS = (8, 64, 1024)


def along_axes(row):
    """How many parts lie beside each other along x, y and z. Older files have slabs alone."""
    return [int(parts) for parts in row["cut"].split("x")] if row.get("cut") else [1, 1, row["ranks"]]


def forecast(one, most):
    """What the model of harness/study/scaling_row.cpp says of more ranks than the row `most` has, fitted to that row: a list of
    (ranks, seconds per step, efficiency), and the number of ranks at half of the efficiency of one; None where that never comes.

    `one` is the row of one rank. A rank among others has ghosts at two sides of a slab or at six of a brick, at the time that a
    particle takes on one rank; then come a latency, and as many borders at the bandwidth that was measured. Where both overlap the
    longer of them counts alone. All of it is stretched by what `most` took longer than the model says. The sides of slabs are as
    large as they were, those of bricks in a body of one size shrink with them. A part is no thinner than a layer.
    """
    ranks, weak, cut = most["ranks"], most["scaling"] == "weak", along_axes(most)
    bricks = sum(parts > 1 for parts in cut) > 1
    sides = 6 if bricks else 2
    particle, particles = one["seconds_per_step"] / one["particles"], most["particles"]
    layer = most["ghosts"] / sum(2 * (parts - 1) * ranks / parts for parts in cut)
    border = most["border_bytes"] / sum(min(parts - 1, 2) for parts in cut)
    stretch = most["seconds_per_step"] / most["predicted_seconds"]

    def predicted(own):
        area = (own * ranks / particles) ** (2 / 3) if bricks and not weak else 1
        compute = particle * (own + sides * layer * area)
        exchange = most["latency_seconds"] + most["seconds_per_byte"] * sides * border * area
        seconds = stretch * (max(compute, exchange) if most["way"].endswith("_overlap") else compute + exchange)
        return seconds, particle * own / seconds, own >= layer * area

    counts = [(count, *predicted(particles / (ranks if weak else count))) for count in FORECAST_RANKS if count > ranks]
    found = [(count, seconds, efficiency) for count, seconds, efficiency, thick in counts if thick]
    # The more ranks the less efficient.
    few, many = 1.0, float(particles)
    if weak or predicted(particles / few)[1] <= 0.5:
        return found, None
    for _ in range(100):
        middle = (few * many) ** 0.5
        few, many = (middle, many) if predicted(particles / middle)[1] > 0.5 else (few, middle)
    return found, many if predicted(particles / many)[2] else None


def scaling_forecast(results):
    """A row for each number of ranks beyond those that were measured, for each family of scenes, strategy and way."""
    found = []
    for result in results:
        rows = result.lists["scaling"]
        needed = ("latency_seconds", "seconds_per_byte", "predicted_seconds", "ghosts", "border_bytes", "particles", "seconds_per_step")
        several = [row for row in rows if row["ranks"] > 1 and all(row.get(name) is not None for name in needed)]

        def line_of(row):
            return row["family"], contender(row), row["way"], sum(parts > 1 for parts in along_axes(row)) > 1

        for line in dict.fromkeys(map(line_of, several)):
            most = max((row for row in several if line_of(row) == line), key=lambda row: row["ranks"])
            ones = [row for row in rows if row["ranks"] == 1 and line_of(row)[:2] == line[:2]]
            if not ones or not most["predicted_seconds"]:
                continue
            counts, half = forecast(ones[0], most)
            found += [{"machine": result.machine, "compared": most["family"], "scaling": most["scaling"], "backend": most["backend"],
                       "family": family(most["backend"]), "contender": contender(most), "way": most["way"],
                       "parts": "bricks" if line[3] else "slabs", "measured_ranks": most["ranks"], "ranks": ranks, "microseconds": seconds * 1e6, "efficiency": efficiency,
                       "half": half} for ranks, seconds, efficiency in counts]
    return found


# As in harness/base/histogram.h.
HISTOGRAM_BEGIN, BINS_A_DECADE = 1e-7, 20


def bins_of(row):
    """The histogram of a row: the number of a bin, and the share of the ticks that it has."""
    counted = sum(count for _, count in row["histogram"])
    return {round(BINS_A_DECADE * math.log10(begin / HISTOGRAM_BEGIN)): count / counted for begin, count in row["histogram"]}


def bin_begin(number):
    """In microseconds."""
    return 1e6 * HISTOGRAM_BEGIN * 10 ** (number / BINS_A_DECADE)


def haptic(results):
    """A row for each rate and way of playing, of those that keep a histogram; times in microseconds."""
    return [{"machine": result.machine, "scene": row["scene"], "backend": row["backend"], "family": family(row["backend"]),
             "contender": contender(row), "formulation": row["formulation"], "hertz": row["hertz"], "edited": "yes" if row["edited"] else "no",
             "drawn": "yes" if row.get("drawn") else "no", "pictures": row.get("pictures_per_second"), "ticks": row["ticks"],
             **{name: row[f"{name}_seconds"] * 1e6 for name in ("median", "p99", "p999", "worst")},
             "missed": row["missed"], "steps_that_fit": row["steps_that_fit"], "period": 1e6 / row["hertz"], "bins": bins_of(row)}
            for result in results for row in result.lists["haptic"] if row.get("histogram")]


def overhead(results):
    """A row for each way of handing over steps; times in microseconds."""
    return [{"machine": result.machine, "scene": row["scene"], "backend": row["backend"], "family": family(row["backend"]),
             "contender": contender(row), "formulation": row["formulation"], "particles": row["particles"],
             "handed_over": row["handed_over"], "steps": row["steps"], "microseconds": row["seconds_per_step"] * 1e6,
             "host": row["host_seconds_per_step"] * 1e6} for result in results for row in result.lists["overhead"]]


def energy(results):
    """A row for each strategy and scene."""
    return [{"machine": result.machine, "scene": row["scene"], "backend": row["backend"], "family": family(row["backend"]),
             "contender": contender(row), "formulation": row["formulation"], "particles": row["particles"],
             "millijoules": row["joules_per_step"] * 1e3, "microseconds": row["seconds_per_step"] * 1e6,
             "throttled": "; ".join(row.get("throttled", [])), **{key: row[key] for key in ("springs_per_joule", "watts", "idle_watts", "meter")}}
            for result in results for row in result.lists["energy"]]


def natural(text):
    """Sorts box@8 before box@16."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", text)]
