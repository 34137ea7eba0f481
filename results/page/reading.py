"""Results of studies as rows that figures are drawn from.

A file that is not as reading.schema.json says is refused with its path, the key and the value. Only what the page needs is
looked at, so that files of older versions, which lack newer keys, are read as well.
"""

import importlib.resources
import json
import math
import re

import scipy.optimize

import result_files
from result_files import BadInput, distinct, shown

from . import text_of

REGIONS = ("bounded", "heating", "diverged")
SCHEMA = json.loads(text_of("reading.schema.json"))
# LISTS: the lists that a file may have. MEASURED: those of measured rows, of which figures are made.
LISTS = tuple(name for name in SCHEMA["properties"] if name != "context")
MEASURED = tuple(name for name in LISTS if name not in ("fastest", "failed", "skipped", "verification"))


class Result:
    """One file. `machine` is the name of the GPU, or else of the processor; tell_apart() adds words where names are the same."""

    def __init__(self, path):
        data = result_files.load(path)
        check(path, data)
        self.path, self.lists = path, {name: data.get(name, []) for name in LISTS}
        for index, row in enumerate(self.lists["stability_map"]):
            check_map(path, f"stability_map[{index}]", row)
        result_files.check_agreement(path, data)
        context, about = data["context"], data["context"]["voxspring"]
        self.study, self.commit, self.date = about["study"]["name"], about["commit"], context["date"]
        self.short_commit = self.commit[:7]
        self.machine = self.model = about["gpu"] if isinstance(about.get("gpu"), str) else about["cpu"]
        self.driver = about.get("driver") if isinstance(about.get("driver"), str) else ""
        self.cores, self.host = context.get("num_cpus"), context.get("host_name") or ""
        self.backends = {name: one for name, one in about.get("backends", {}).items() if isinstance(one, dict)}
        # The identities (UUIDs) of cards. Processors have none.
        self.cards = tuple(sorted({one["uuid"] for one in self.backends.values() if one.get("uuid")}))
        # Measured limits of devices, by the name that backends refer to.
        self.limits = {name: one for name, one in about.get("limits", {}).items() if isinstance(one, dict) and one.get("bandwidth")}
        self.counters = result_files.counters(data)

    def family(self, backend):
        """The name of a backend's API, which tells its times apart from those of other APIs."""
        return result_files.family(self.backends.get(backend, {}))

    def origin(self):
        """The machine, its driver, the commit and the date, for the caption of a figure."""
        driver = f", driver {self.driver}" if self.driver else ""
        return f"{self.machine}{driver}, commit {self.commit}, {self.date[:10]}"


def check(path, data, name="", at=""):
    """Refuses data that reading.schema.json, or the part of it called `name`, does not allow."""
    result_files.check(path, data, importlib.resources.files(__package__) / "reading.schema.json", name, at)


def check_map(path, where, row):
    if len(row["region"]) != len(row["damping"]):
        raise BadInput(f"{path}: {where}.region: {len(row['region'])} rows: expected one for each of the "
                       f"{len(row['damping'])} values of damping")
    for line in row["region"]:
        if len(line) != len(row["fraction"]):
            raise BadInput(f"{path}: {where}.region: {shown(line)}: expected {len(row['fraction'])} of {', '.join(REGIONS)}")


# Rates of arithmetic; the highest of a device is its roof.
OPERATIONS = ("float32_operations_per_second", "compute_shader_float32_operations_per_second")


def roofs(limits):
    """The roofs of a device: bytes per second of memory and of the cache, by name, and operations per second."""
    table = limits["bandwidth"]
    beyond = max(entry["footprint_bytes"] for entry in table)
    memory = {entry["written_share"]: entry["bytes_per_second"] for entry in table if entry["footprint_bytes"] == beyond}
    bytes_per_second = {"memory": memory[min(memory)], "memory, half written": memory[max(memory)],
                        "cache": max(entry["bytes_per_second"] for entry in table)}
    return bytes_per_second, max(limits[key] for key in OPERATIONS if key in limits)


# The roofs that have a label, and what it says.
ROOF_LABELS = {"memory, half written": "memory (dashed: half written)", "cache": "cache"}


def rooflines(results, rows):
    """{API: the roofs that it measured}, with one API for each device of the rows: the one that reached the fastest memory
    there."""
    of_devices = {}
    for result in results:
        for name in distinct(rows, "backend"):
            about = result.backends.get(name, {})
            if limits := result.limits.get(result_files.limits_of(about)):
                of_devices.setdefault(about.get("uuid") or about.get("device"), {})[result.family(name)] = roofs(limits)
    return dict(max(own.items(), key=lambda item: item[1][0]["memory"]) for own in of_devices.values())


def tell_apart(results):
    """Gives different names to different machines with the same name. A card is told by its identity. A processor has no identity:
    it is told by its number of cores and its host. If a file does not name the host, its folder takes the host's place."""
    def traits(result):
        at = result.host or (result.path.resolve().parent if not result.cards else "")
        return {"cores": f"{result.cores} cores" if result.cores else "", "card": ", ".join(card[:12] for card in result.cards),
                "at": at if isinstance(at, str) else at.name, "path": str(at), "cards": result.cards}
    for (name,), own in result_files.groups(results, lambda result: result.machine).items():
        entries = [(result, traits(result)) for result in own]
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
        found = result_files.within(path) if path.is_dir() else [path]
        if not found:
            raise BadInput(f"{path}: holds no .json or .json.gz file: expected results of studies")
        files += found
    # A file that is given by name and within its folder counts once.
    unique = {file.resolve(): file for file in files}
    return tell_apart(sorted(map(Result, unique.values()), key=lambda result: result.date))


def significant(value, digits=5):
    """A float rounded to `digits` significant digits, which keeps the page small; None if it is not finite. Other values
    unchanged."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if math.isfinite(value) else None
    return value


def contender(row):
    """The backend, its formulation, its precision unless float32, and the tuning parameters that are not at their defaults."""
    tuning = result_files.name_of(row).removeprefix(row["scene"] + "/").split("/")[3:]
    return " ".join([row["backend"], row["formulation"]] + [row["precision"]] * (row["precision"] != "float32") + tuning)


def short_contender(name):
    """Converts the name of a contender from diff.py's form into that of contender()."""
    words = name.split(" ")
    return " ".join(words[:2] + [word for word in words[2:3] if word != "float32"] + words[3:])


def moved_and_computed(row):
    """The columns on what a step moves and computes; None where the file does not say. A step that moves nothing, since its state
    stays on the chip, has a rate of operations but no number of operations per byte."""
    moved, footprint, operations = (row.get(f"step_{what}") or 0 for what in ("bytes", "footprint_bytes", "operations"))
    on_chip = row.get("step_bytes") == 0 and operations > 0
    if not on_chip and min(moved, footprint, operations) <= 0:
        return {"operations_per_byte": None, "operation_rate": None, "footprint": None}
    return {"operations_per_byte": None if on_chip else operations / moved, "operation_rate": operations / row["real_time"] * 1e-3,
            "footprint": footprint / 2**20 or None}


def rows_of(results, name):
    """The rows of a list with further keys: machine, study, commit and date, the contender, and microseconds per step. `family` is
    the backend's API, and `compared` what the file calls `family`: the scenes that are compared with each other."""
    return [row | {"machine": result.machine, "study": result.study, "commit": result.short_commit, "date": result.date,
                   "compared": row.get("family"), "family": result.family(row["backend"]), "contender": contender(row),
                   "noisy": "; ".join(row.get("noisy", [])), "throttled": "; ".join(row.get("throttled", [])),
                   "microseconds": in_microseconds(row.get("seconds_per_step"))}
            for result in results for row in result.lists[name]]


def in_microseconds(seconds):
    return None if seconds is None else seconds * 1e6


def measured(results):
    """A row for each contender, scene and file: the median over the repetitions, with the shortest and the longest one."""
    return [row | {
        "microseconds": row["real_time"], "least": min(row["times"]), "most": max(row["times"]),
        "repetition_times": tuple(row["times"]), "limited_by": result_files.binder(row),
        "spring_rate": row["springs"] / row["real_time"] * 1e6, "of_limit": row.get("fraction_of_limit"),
        "of_sum": row["limit_sum_seconds"] * 1e6 / row["real_time"] if row.get("limit_sum_seconds") else None,
        "sustained": in_microseconds(row.get("sustained_seconds_per_step") or None),
        "limit_microseconds": in_microseconds(row.get("limit_seconds") or None),
        **moved_and_computed(row), "rounding": row.get("error_relative_l2"), "rounding_max": row.get("error_max"),
        "error_steps": row.get("error_steps", row["steps"]), "without_edits": row.get("seconds_per_step_without_edits"),
        "edits": row.get("edits"), "edit_microseconds": in_microseconds(row.get("edit_seconds_median"))}
        for result in results for row in result_files.medians(rows_of([result], "benchmarks"), result.lists["verification"])]


def latest(rows, *keys):
    """The last row for each combination of values of the keys. The rows are in the order of their dates."""
    return list({tuple(row[key] for key in keys): row for row in rows}.values())


def strategies(rows):
    """One measured row per contender and scene: among the latest rows of all studies the one with the most steps per batch, over
    which the cost of a launch is spread."""
    rows = [row for own in result_files.groups(rows, "machine", "scene", "contender", "study").values()
            for row in own if row["date"] == own[-1]["date"]]
    return latest(sorted(rows, key=lambda row: row["steps"]), "machine", "scene", "contender")


def pareto(results):
    """A row for each run to a scene's end time that has a time and a total error."""
    return [row | {"fraction": row["fraction_of_stable"], "particles": row.get("particles"), "total": row["total_error_relative_l2"],
                   "rounding": row.get("error_relative_l2"), "front": row["on_front"]}
            for row in rows_of(results, "pareto") if row.get("seconds") and row.get("total_error_relative_l2")]


def is_bricks(row):
    return sum(parts > 1 for parts in along_axes(row)) > 1


def scaling(results):
    """A row for each number of ranks and way of exchange that has an efficiency, with the efficiency that the model predicts."""
    return [row | {"cut": row.get("cut", ""), "parts": "bricks" if is_bricks(row) else "slabs",
                   **{name: row[f"{name}_seconds"] * 1e6 for name in ("compute", "exchange", "waiting")},
                   "predicted": row["efficiency"] * row["seconds_per_step"] / row["predicted_seconds"]}
            for row in rows_of(results, "scaling") if row.get("efficiency") and row.get("predicted_seconds")]


# The numbers of ranks whose efficiency forecast() predicts.
FORECAST_RANKS = (8, 64, 1024)


def along_axes(row):
    """The numbers of parts along x, y and z. A row of an older file, without `cut`, has slabs along z."""
    return [int(parts) for parts in row["cut"].split("x")] if row.get("cut") else [1, 1, row["ranks"]]


def forecast(one, most):
    """Extends the model of harness/study/scaling_row.cpp to more ranks than the row `most` has, fitted to that
    row. Returns a list of (ranks, seconds per step, efficiency), and the number of ranks at which the
    efficiency falls to one half, or None if the model gives no such number.

    `one` is the row of one rank. A rank computes its particles and its ghosts, which lie at two sides of a slab
    or at six of a brick, in the time that a particle takes on one rank. Then it exchanges one border per side, at
    the measured latency and bandwidth. If computing and exchanging overlap, only the longer one counts. The sum
    is multiplied by the time of `most` over the model's time for it. With more ranks the sides of slabs stay as
    large as they are, and those of bricks shrink if the body keeps its size. A part that would be thinner than
    a layer of ghosts is left out.
    """
    ranks, weak, cut = most["ranks"], most["scaling"] == "weak", along_axes(most)
    bricks = is_bricks(most)
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
    # The efficiency at particles**exponent ranks, less one half. It falls with the exponent.
    def beyond_half(exponent):
        return predicted(particles ** (1 - exponent))[1] - 0.5

    if weak or beyond_half(0) <= 0:
        return found, None
    half = float(particles) ** (scipy.optimize.brentq(beyond_half, 0, 1, xtol=1e-12) if beyond_half(1) < 0 else 1)
    return found, half if predicted(particles / half)[2] else None


def scaling_forecast(results):
    """A row for each number of ranks beyond those that were measured, for each family of scenes, strategy and way."""
    needed = ("latency_seconds", "seconds_per_byte", "predicted_seconds", "ghosts", "border_bytes", "particles", "seconds_per_step")
    found = []
    for result in results:
        rows = rows_of([result], "scaling")
        ones = {(row["compared"], row["contender"]): row for row in reversed(rows) if row["ranks"] == 1}
        known = [row for row in rows if row["ranks"] > 1 and all(row.get(name) is not None for name in needed)]
        for line, several in result_files.groups(known, "compared", "contender", "way", is_bricks).items():
            most = max(several, key=lambda row: row["ranks"])
            if line[:2] not in ones or not most["predicted_seconds"]:
                continue
            counts, half = forecast(ones[line[:2]], most)
            found += [most | {"parts": "bricks" if line[3] else "slabs", "measured_ranks": most["ranks"], "ranks": ranks,
                              "microseconds": seconds * 1e6, "efficiency": efficiency, "half": half}
                      for ranks, seconds, efficiency in counts]
    return found


def haptic(results):
    """The rows of the study haptic that have a histogram of their ticks, with times in microseconds."""
    return [row | {"edited": "yes" if row["edited"] else "no", "drawn": "yes" if row.get("drawn") else "no",
                   "pictures": row.get("pictures_per_second"), "period": 1e6 / row["hertz"],
                   **{name: in_microseconds(result_files.tick_seconds(row, name)) for name in ("median", "p99", "p999", "worst")}}
            for row in rows_of(results, "haptic") if row.get("histogram")]


def truth(results):
    """A row for each lattice whose error is not exactly zero, which a logarithmic axis cannot show."""
    return [row | {"rounding": row.get("rounding_error"), "order": row.get("order"), "claimed_order": row.get("claimed_order")}
            for row in rows_of(results, "truth") if row["model_error"] > 0]


def natural(text):
    """A key that sorts box@8 before box@16."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", text)]
