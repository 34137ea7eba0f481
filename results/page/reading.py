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
    "failed": {"name": str, "scene": str, "backend": str, "reason": str},
    "skipped": {"name": str, "scene": str, "backend": str, "reason": str},
}
# What older files lack, or is null where it is not known.
OPTIONAL = {
    **dict.fromkeys(("limit_seconds", "fraction_of_limit", "error_relative_l2", "error_max", "error_steps", "edits",
                     "edit_seconds_median", "seconds_per_step_without_edits", "total_error_relative_l2", "seconds", "gate",
                     "measured", "particles"), float),
    **dict.fromkeys(("aggregate_name", "run_type", "tuning", "limited_by", "unit", "detail"), str),
}
WHAT = {str: "text", float: "a number", Positive: "a number above 0", int: "a whole number",
        bool: "true or false", list: "a list", dict: "an object"}


@dataclass
class Result:
    """One file. machine is what its times are of: the GPU, or the processor where there is none."""

    path: pathlib.Path
    study: str
    machine: str
    driver: str
    commit: str
    date: str
    lists: dict = field(repr=False)

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
            if not is_texts(row.get("noisy", [])):
                raise BadInput(f"{path}: {place}.noisy: {shown(row['noisy'])}; expected a list of text")
            if row.get("time_unit", "us") != "us":
                raise BadInput(f"{path}: {place}.time_unit: {shown(row['time_unit'])}; expected \"us\"")
            if name == "stability":
                need(path, f"{place}.start", row["start"], "kind", str)
                need(path, f"{place}.start", row["start"], "amplitude", float)
            if name == "stability_map":
                check_map(path, place, row)
            if name == "fastest":
                check_fastest(path, place, row)
        lists[name] = rows
    driver = about.get("driver") if isinstance(about.get("driver"), str) else ""
    return Result(path, study, machine, driver, need(path, where, about, "commit", str),
                  need(path, "context", context, "date", str), lists)


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
    return sorted((read(file) for file in unique.values()), key=lambda result: result.date)


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
    return {"cuda": "CUDA", "gl": "OpenGL", "cpu": "CPU"}.get(backend.split("_")[0], "another API")


def measured(results):
    """A row a contender, scene and file: the median over the repetitions, with the least and the most of them."""
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
                "of_limit": row.get("fraction_of_limit"), "rounding": row.get("error_relative_l2"),
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


def pareto(results):
    """A row a run to a scene's end time that has a time and a total error."""
    return [{"machine": result.machine, "device": row["device"], "scene": row["scene"], "backend": row["backend"],
             "family": family(row["backend"]), "contender": contender(row), "formulation": row["formulation"],
             "precision": row["precision"], "fraction": row["fraction_of_stable"], "steps": row["steps"],
             "particles": row.get("particles"),
             "end_time": row["end_time"], "seconds": row["seconds"], "total": row["total_error_relative_l2"],
             "rounding": row.get("error_relative_l2"), "front": row["on_front"]}
            for result in results for row in result.lists["pareto"]
            if row.get("seconds") and row.get("total_error_relative_l2")]


def natural(text):
    """Sorts box@8 before box@16."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", text)]
