#!/usr/bin/env python3
"""Draws figures of the pages at random, and computes each again from the committed results.

Usage: audit.py [--seed N] [--claims N] [--all]

A claim is a figure in a table or in a sentence of README.md, docs/ or results/README.md. This script reads the JSON of the results itself,
and shares no code with the pages' templates. It prints each claim with what it found, and the tables of which it computes nothing.

Exit code: 0 all that were drawn are right; 1 one is wrong; 2 bad input.
"""

import argparse
import collections
import functools
import gzip
import json
import math
import pathlib
import random
import re
import statistics
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
CARD, OTHER_CARD, PROCESSOR = "nvidia-h200", "nvidia-h100", "amd-epyc"
PAGES = ("README.md", "results/README.md", "docs/accuracy.md", "docs/apis.md", "docs/artifact.md", "docs/simulator.md")
PAPER = ("gl_fragment_implicit", "gl_fragment_explicit", "cuda_implicit_device", "cuda_implicit_shared", "cuda_implicit_cached",
         "cuda_explicit_device", "cuda_explicit_cached", "cuda_explicit_cached_grid")
NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
Claim = collections.namedtuple("Claim", "page line what said value")


@functools.lru_cache(None)
def raw(study, machine=CARD):
    return json.loads(gzip.decompress((ROOT / "results" / machine / f"{study}.json.gz").read_bytes()))


class Case:
    """The repetitions of a scene, backend and tuning in a study."""

    def __init__(self, rows):
        self.times = [row["real_time"] for row in rows if row["run_type"] == "iteration"]
        self.row, self.us = rows[0], statistics.median(self.times)
        self.name = rows[0]["name"].split("/iterations:")[0]
        self.scene, self.backend, self.formulation, self.precision, *self.tuning = self.name.split("/")

    def __getitem__(self, key):
        return self.row[key]

    def held_out(self):
        """The median of the repetitions by which it was not chosen."""
        return statistics.median(self.times[1::2]) if len(self.times) > 3 else self.us

    def of_limit(self, us=None):
        return 100 * self.row["limit_seconds"] * 1e6 / (us or self.us)

    def spread(self):
        low, _, high = statistics.quantiles(self.times, n=4, method="inclusive")
        return 100 * (high - low) / 2 / self.us


@functools.lru_cache(None)
def cases(study, machine=CARD):
    found = collections.defaultdict(list)
    for row in raw(study, machine)["benchmarks"]:
        found[row["name"].split("/iterations:")[0]].append(row)
    return {name: Case(rows) for name, rows in found.items()}


def alike(study, machine=CARD, **which):
    return [case for case in cases(study, machine).values() if all(getattr(case, key) == value for key, value in which.items())]


def best(several):
    """(case, its time) of the fastest: every other repetition chooses, the others are its time."""
    if len(several) == 1:
        return several[0], several[0].us
    chosen = min(several, key=lambda case: statistics.median(case.times[0::2]) if len(case.times) > 3 else case.us)
    return chosen, chosen.held_out()


def named(study, scene, label, formulation="position", machine=CARD):
    """The case that a table calls "`cuda_implicit_cached` fetch=l1"."""
    backend, *words = label.replace("`", "").split(" ")
    precision = words.pop(0) if words and words[0].startswith("float") else "float32"
    return cases(study, machine)["/".join([scene, backend, formulation, precision, *words])]


def agrees(said, value):
    """Whether a figure is the value, as rounded to the figure's own digits or to three significant ones."""
    if isinstance(value, str):
        return said == value
    text = said.replace(",", "")
    mantissa, _, exponent = text.partition("e")
    digits = len(mantissa.partition(".")[2])
    forms = {f"{value:.{digits}e}" if exponent else f"{value:.{digits}f}", f"{value:.3g}"}
    if not digits:  # A share that is not known to a percent ends with zeros.
        forms.add(str(round(value, len(text.rstrip("0")) - len(text))))
    return any(math.isclose(float(text), float(form), rel_tol=1e-9, abs_tol=1e-12) for form in forms)


def numbers(cell):
    """The figures of a cell, without marks, names and words."""
    return NUMBER.findall(re.sub(r"`[^`]*`|\S*(?:=|_|@)\S*|10 \^|\^\d", " ", cell))


def machine_of(words):
    return PROCESSOR if "AMD EPYC" in words else OTHER_CARD if "H100" in words else CARD


def tables(page):
    """(heading or marker, line, header, rows) of each table of a page."""
    heading, marker, lines = "", "", (ROOT / page).read_text(encoding="utf-8").split("\n")
    for index, line in enumerate(lines):
        heading = line.lstrip("# ") if line.startswith("#") else heading
        if found := re.match(r"<!-- (/?)(\w+) -->", line):
            marker = "" if found[1] else found[2]
        if line.startswith("|") and not lines[index - 1].startswith("|"):
            def split(one):
                cells = [cell.strip() for cell in one.strip().strip("|").split("|")]
                return [cell for index, cell in enumerate(cells) if index not in left_out]
            # The steps of a batch are part of a name.
            left_out = []
            left_out = [index for index, name in enumerate(split(line)) if name == "steps" and marker != "gates"]
            rows, end = [], index + 2
            while lines[end].startswith("|"):
                rows.append((end + 1, split(lines[end])))
                end += 1
            origin = next((one for one in lines[end:end + 3] if one.strip()), "")
            above = next((one for one in lines[index - 1::-1] if one.strip()), "")
            yield marker or heading, [re.sub(r", (batches of )?\d+ steps", "", name) for name in split(line)], rows, machine_of((origin, above)[not marker])


# --- Tables: for each the figures of a row, column by column. A column that is not here has no recomputation.

def of_steps(study):
    def row(cells, header, _):
        for column, cell in zip(header[2:], cells[2:]):
            scene, what = column.split(": ")
            if cell == "-":
                continue
            case = named(study, scene, cells[0])
            yield column, cell, {"us": case.us, "G springs/s": case["springs"] / case.us * 1e-3, "of limit": case.of_limit() if
                                 case["limit_seconds"] else None, "error": case["error_max"]}.get(what)
    return row


def starts(cells, header, _):
    for column, cell in zip(header[1:], cells[1:]):
        scene, what = column.split(": ")
        if cell != "-":
            case = named("table1", scene, cells[0])
            yield column, cell, 1e3 * case["warm_ready_seconds" if what == "warm" else "ready_seconds"]


def figure8(cells, header, _):
    for column, cell in zip(header[2:], cells[2:]):
        if cell != "-":
            case = named("figure8", f"box@{column.partition('^')[0]}", cells[0])
            yield column, cell, case.us
            yield column + " per particle", cell[cell.rindex("("):], case.us * 1e3 / case["particles"]


def edits(cells, header, _):
    for column, cell in zip(header[2:], cells[2:]):
        scenes = {case.row["edits"]: case for case in cases("edits").values() if case.name.endswith(
            "/".join(["", cells[0].split(" ")[0].strip("`"), "increment", "float32", *cells[0].split(" ")[1:]]))}
        most = scenes[max(scenes)]
        if "edit" in column and column[0].isdigit():
            case = scenes[int(column.split(" ")[0])]
            yield column, cell, 100 * (case.us * 1e-6 / case["seconds_per_step_without_edits"] - 1)
        elif column.startswith("an edit"):
            yield column, cell, most["edit_seconds_median"] * 1e6
        elif column.startswith("a step"):
            yield column, cell, most["seconds_per_step_without_edits"] * 1e6


def tuning(cells, header, _):
    own = alike("tuning", scene=cells[1], backend=cells[0].strip("`"))
    yield header[4], cells[4], len(own)
    default = [case for case in own if not case.tuning]
    if default and cells[2] != "-":
        yield header[2], cells[2], default[0].held_out() if len(own) > 1 else default[0].us
    chosen, us = best(own)
    if default and default[0].held_out() < 1.03 * us:
        chosen, us = default[0], default[0].held_out() if len(own) > 1 else default[0].us
    yield header[3], cells[3], us
    yield header[5], cells[5], " ".join(chosen.tuning) or "the default"


def fastest(cells, header, machine):
    scene, formulation, precision = cells[0].split(" ")
    own = alike("fastest", machine, scene=scene, formulation=formulation, precision=precision)
    case = best(own)[0]
    us, papers = case.held_out(), [one for one in own if one.backend in PAPER]
    values = {"fastest": " ".join([f"`{case.backend}`"] + [precision] * (precision != "float32") + case.tuning), "of so many": len(own),
              "us per step": us, "G particles/s": case["particles"] / us * 1e-3, "G springs/s": case["springs"] / us * 1e-3,
              "of limit": case.of_limit(us) if case["limit_seconds"] else None, "error": case["error_max"],
              "x the paper's best": best(papers)[1] / us if papers else None}
    for column, cell in zip(header, cells):
        if column in values and cell != "-":
            yield column, cell, values[column]


def across_cards(cells, header, _):
    """A dataset, and the fastest strategy and its time on each card."""
    scene, formulation, *precision = cells[0].split(" ")
    times = []
    for at, column in enumerate(header):
        if not column.endswith(": fastest") or cells[at] == "-":
            continue
        own = alike("fastest", machine_of(column), scene=scene, formulation=formulation, precision=(precision or ["float32"])[0])
        case = best(own)[0]
        times.append(case.held_out())
        yield column, cells[at], " ".join([f"`{case.backend}`"] + precision + case.tuning)
        yield header[at + 1], cells[at + 1], times[-1]
    if cells[-1] != "-":
        yield header[-1], cells[-1], times[-1] / times[0]


def targets(cells, header, machine):
    scene, formulation, precision = cells[0].split(" ")
    label = cells[3].replace("`", "").split(" ")
    case = cases("fastest", machine)["/".join([scene, label[0], formulation, precision, *label[1 + (precision != "float32"):]])]
    if cells[1].endswith(" us"):
        yield header[2], cells[2], case.held_out()


def formulations(cells, header, _):
    label, scene, steps = cells[0].rsplit(", ", 2)
    known = {case.formulation: case for case in cases("formulations").values() if case.scene == scene and
             case["steps"] == int(steps.split(" ")[0]) and " ".join([f"`{case.backend}`"] + case.tuning) == label}
    yield header[1], cells[1], known["position"].us
    for formulation, cell in zip(header[2:], cells[2:]):
        if cell != "-":
            yield formulation, cell, known[formulation].us / known["position"].us
            yield formulation + " error", cell[cell.rindex("("):], known[formulation]["error_relative_l2"]


def stress(cells, header, _):
    name, scene, steps = re.fullmatch(r"(.*?), (.*), (\d+) steps", cells[0]).groups()
    for formulation, cell in zip(header[1:], cells[1:]):
        rows = [row for row in raw("stress")["stress"] if row["part"] in (7, 9) and (row["measurement"], row["scene"], row["steps"],
                row["formulation"], row["precision"]) == (name, scene, int(steps), formulation, "float32")]
        yield formulation, cell, max(math.inf if row["measured"] is None else row["measured"] for row in rows)


def stability(cells, header, _):
    kind, amount, damping = re.fullmatch(r"(\w+) ([\d.]+), damping ([\d.]+)", cells[0]).groups()
    for formulation, cell in zip(header[1:], cells[1:]):
        ratios = [row["measured_time_step"] / row["theory_time_step"] for row in raw("stability")["stability"] if row["formulation"] ==
                  formulation and row["start"]["kind"] == kind and (row["start"]["amplitude"] or row["start"]["stretch"]) == float(amount)
                  and row["damping"] == float(damping)]
        yield formulation + " least", cell.split(" to ")[0], min(ratios)
        yield formulation + " most", cell.split(" to ")[1], max(ratios)


def resting(cells, header, _):
    backend, _, words = cells[0].partition(" ")
    way = "flush" if words.endswith("flush") else "skip"
    for scene, cell in zip(header[1:], cells[1:]):
        if cell != "-":
            name = "/".join([scene, backend.strip("`"), words.split(",")[0], "float32"])
            every, moving = cell.split(" / ")
            yield scene + " all", every, cases("skips")[name + "/rest=step"].us
            yield scene + " moving", moving, cases("skips")[f"{name}/rest={way}"].us
            work = next(row["work"] for row in raw("skips")["verification"] if row["name"] == f"{name}/rest={way}")
            yield scene + " tiles", moving[moving.rindex("("):], 100 * work["tiles_stepped"] / work["tiles"]


def energy(cells, header, _):
    scene, label = cells[0].split(", ")
    row = next(row for row in raw("energy")["energy"] if row["name"] == "/".join(
        [scene, label.split(" ")[0].strip("`"), "position", "float32", *label.split(" ")[1:]]))
    values = {"mJ per step": row["watts"] * row["seconds_per_step"] * 1e3, "power (W)": row["watts"], "idle (W)": row["idle_watts"],
              "G springs/J": row["springs"] / row["watts"] / row["seconds_per_step"] * 1e-9, "measured (s)": row["seconds"],
              "cross-checked by samples": 100 * abs(row["sampled_watts"] / row["watts"] - 1)}
    for column, cell in zip(header[1:], cells[1:]):
        if column in values:
            yield column, cell, values[column]


def explicit(cells, header, _):
    own = alike("fastest", scene=cells[0], formulation="position", precision="float32")
    sides = [[one for one in own if one.backend in PAPER and f"cuda_{side}_" in one.backend] for side in ("implicit", "explicit")]
    (_, implicit), (_, lists) = map(best, sides)
    yield header[2], cells[2], own[0]["particles"]
    yield header[3], cells[3], 100 * own[0]["particles"] / own[0]["voxels"]
    yield header[4], cells[4], implicit
    yield header[5], cells[5], lists
    yield header[6], cells[6], lists / implicit


LIMITS = {"copy": ("copy_bytes_per_second", 1e-9), "in cache": ("cached_copy_bytes_per_second", 1e-9), "launch": ("launch_seconds", 1e6),
          "float32": ("float32_operations_per_second", 1e-9), "float64": ("float64_operations_per_second", 1e-9)}


def limit(api, key, page, study):
    """A limit of a study, or the best of all studies of the card if the page says that."""
    if not re.search("(Each limit is|,) the best of", (ROOT / page).read_text(encoding="utf-8")):
        return raw(study)["context"]["voxspring"]["limits"][api][key]
    every = [raw(path.name.removesuffix(".json.gz"))["context"]["voxspring"].get("limits", {}).get(api, {}).get(key)
             for path in (ROOT / "results" / CARD).glob("*.json.gz")]
    return (min if key == "launch_seconds" else max)(value for value in every if value)


def limits(cells, header, _):
    for column, cell in zip(header[1:], cells[1:]):
        if column in LIMITS and cell != "-":
            key, scale = LIMITS[column]
            yield column, cell, limit(cells[0], key, "results/README.md", "table1") * scale


def files(cells, header, _):
    result = raw(cells[0].strip("`"))
    yield header[1], cells[1], result["context"]["voxspring"]["commit"][:8]
    yield header[2], cells[2], result["context"]["date"][:10]
    if result["benchmarks"]:
        medians = [row for row in result["benchmarks"] if row.get("aggregate_name") == "median"]
        yield header[5], cells[5], sum(bool(row.get("noisy")) for row in medians)


def heart(cells, header, machine):
    own = [best(alike("fastest", machine, scene="heart", formulation="position", precision="float32", backend=backend))
           for backend in {case.backend for case in cases("fastest", machine).values()} if alike(
               "fastest", machine, scene="heart", formulation="position", precision="float32", backend=backend)]
    backend = cells[0].strip("`")
    case, us = next(one for one in own if one[0].backend == backend)
    tried = alike("fastest", machine, scene="heart", formulation="position", precision="float32", backend=backend)
    values = {"us per step": us, "x fastest": us / min(one[1] for one in own), "G particles/s": case["particles"] / us * 1e-3, "% of roofline": case.of_limit(us),
              "error": case["error_max"], "best of": len(tried)}
    for column, cell in zip(header, cells):
        if column in values:
            yield column, cell, values[column]


def claimed(cells, header, machine):
    label = cells[0]
    case = named("fastest", "heart", label, machine=machine)
    values = {"us per step": case.us, "repetitions": case.spread(), "G particles/s": case["particles"] / case.us * 1e-3,
              "% of roofline": case.of_limit(), "error": case["error_max"]}
    for column, cell in zip(header, cells):
        if column in values:
            yield column, cell, values[column]


def float64(cells, header, machine):
    backend, scene = cells[0].split(", ")
    machine = PROCESSOR if backend == "`cpu_parallel`" else CARD
    runs = {(row["formulation"], row["precision"], row["fraction_of_stable"]): row["seconds"] for row in raw("pareto", machine)["pareto"]
            if f"`{row['backend']}`" == backend and row["scene"] == scene}
    ratios = [seconds / runs[formulation, "float32", step] for (formulation, precision, step), seconds in runs.items()
              if precision == "float64" and (formulation, "float32", step) in runs]
    for column, cell, value in zip(header[1:], cells[1:], (min(ratios), statistics.median(ratios), max(ratios), len(ratios))):
        yield column, cell, value


APIS = {"CUDA": "cuda_implicit_cached", "Vulkan": "vulkan_implicit", "OpenGL, compute": "gl_compute_implicit",
        "OpenGL, fragments": "gl_fragment_implicit", "CUDA, resident": "cuda_resident"}


def launches(cells, header, _):
    rows = {row["handed_over"]: row for row in raw("overhead")["overhead"] if row["backend"] == APIS[cells[0]] and
            row["particles"] == int(cells[1].replace(",", ""))}
    for column, cell, way, key in zip(header[2:], cells[2:], ("one by one", "one by one", "at once", "at once"), ("", "host_", "", "host_")):
        yield column, cell, rows[way][f"{key}seconds_per_step"] * (1e9 if cell.endswith("ns") else 1e6)


def sizes(cells, header, _):
    def of(api):
        return best(alike("fastest", scene=cells[0], formulation="position", precision="float32", backend=APIS[api]))[1]
    for column, cell in zip(header[2:], cells[2:]):
        if cell != "-":
            yield column, cell, of(column)
            if "(" in cell:
                yield column + " over CUDA", cell[cell.rindex("("):], of(column) / of("CUDA")


def ticks(cells, header, machine):
    backend, *words = cells[1].replace("`", "").split(" ")
    label = [backend, "increment", words.pop(0) if words and words[0].startswith("float") else "float32", *words]
    rows = [row for row in raw("haptic", machine)["haptic"] if row["scene"] == cells[0] and not row["edited"] and not row.get("drawn") and
            row["hertz"] == 1000 * float(cells[2]) and row["name"] == "/".join([cells[0], *label])]
    values = {"median": "median_seconds", "99 %": "p99_seconds", "99.9 %": "p999_seconds", "worst": "worst_seconds"}
    for column, cell in zip(header, cells):
        if column in values and cell != "-":
            yield column, cell, rows[0][values[column]] * (1e9 if cell.endswith("ns") else 1e6)
        elif column == "missed":
            yield column, cell, rows[0]["missed"]
        elif column == "steps fit":
            yield column, cell, rows[0]["steps_that_fit"]


def empty_steps(cells, header, _):
    names = {"OpenGL, compute": "OpenGL compute", "OpenGL, fragments": "OpenGL"}
    for column, cell in zip(header, cells):
        yield column, cell, 1e6 * limit(names.get(column, column), "launch_seconds", "docs/apis.md", "fastest")


def gates(cells, header, _):
    row = next(row for row in json.loads((ROOT / "docs/gates.json").read_text(encoding="utf-8")) if (
        row["scene"], row["steps"], row["formulation"]) == (cells[0], int(cells[1].replace(",", "")), cells[2].strip("`")))
    for column, cell, value in zip(header[3:], cells[3:], (row["spread_share"], row["gate_share"], row["honest_in_spreads"],
                                                           min(row["wrong_in_gates"].values()))):
        yield column, cell, value


# By marker, or by the heading and the first column's name.
AUDITED = {"heart": heart, "claims": claimed, "float64": float64, "gates": gates, "launches": launches, "sizes": sizes, "ticks": ticks, "empty_steps": empty_steps,
           ("Table 1", "time per step"): of_steps("table1"), ("Figure 7", "time per step"): of_steps("figure7"),
           ("Table 1", "start (ms)"): starts, ("Figure 8", "us per step (ns per particle)"): figure8,
           ("Cuts and sutures", "slow-down of 1000 steps"): edits, ("Tuning", "strategy"): tuning, "fastest": fastest,
           ("As fast as the card allows", "dataset"): fastest, ("Formulations", "case"): formulations,
           ("Errors and extremes", "largest error of any strategy"): stress, ("Stability", "measured over theory"): stability,
           ("Tiles at rest", "us per step of all / of what moves (tiles stepped)"): resting, ("Energy", "case"): energy,
           ("What holds and what does not", "dataset"): explicit, ("The paper's conclusions on an NVIDIA H200", ""): limits,
           ("The paper's conclusions on an NVIDIA H200", "file"): files}


def over(study, scene, case, other, **which):
    return named(study, scene, case, **which).us / named(study, scene, other, **which).us


# Sentences: what is around a figure, and what it is. Blanks stand for any space.
SENTENCES = {
    r"reaches ([\d.]+) times the arithmetic of a fragment shader": lambda: (lambda of: of["compute_shader_float32_operations_per_second"] /
        of["float32_operations_per_second"])(raw("table1")["context"]["voxspring"]["limits"]["OpenGL"]),
    r"`cuda_explicit_cached_grid` takes ([\d.]+) of the time of `cuda_explicit_cached` on the paper's box": lambda: over(
        "table1", "box@32", "cuda_explicit_cached_grid", "cuda_explicit_cached"),
    r"concatenated lists take ([\d.]+) times as long past L1": lambda: over(
        "tuning", "box@160", "cuda_explicit_device layout=concatenated", "cuda_explicit_device"),
    r"paper's box and ([\d.]+) times with lists": lambda: over("table1", "box@32", "gl_fragment_explicit", "cuda_explicit_cached_grid"),
    r"take ([\d.]+) times as long as CUDA\. Among": lambda: over("table1", "box@32", "gl_compute_implicit", "cuda_implicit_cached"),
    r"faster: by a factor of ([\d.]+) on the box": lambda: over("table1", "box@32", "gl_fragment_explicit", "gl_fragment_implicit"),
    r"on the box and ([\d.]+) on the heart, as it was": lambda: over("table1", "heart", "gl_fragment_explicit", "gl_fragment_implicit"),
    r"microseconds: L1-cached loads \(([\d.]+)\)": lambda: named("figure7", "box@32", "cuda_implicit_cached fetch=l1").us,
    r"on the box of 256\^3: L1-cached loads \(([\d.]+)\)": lambda: named("figure8", "box@256", "cuda_implicit_cached fetch=l1").us,
    r"That takes ([\d.]+) microseconds per edit": lambda: edit("cuda_march"),
    r"edits it there in ([\d.]+) microseconds": lambda: edit("cuda_resident"),
    r"`cuda_march` takes ([\d.]+) of the energy of": lambda: joules("box@256/cuda_march") / joules("box@256/cuda_implicit_cached", "/fetch=l1"),
    r"`cuda_resident` ([\d.]+) on the box of 32\^3\.": lambda: joules("box@32/cuda_resident") / joules("box@32/cuda_implicit_cached", "/fetch=l1"),
    r"with L1-cached loads takes ([\d.]+) us with `position`": lambda: named("fastest", "box@256", "cuda_implicit_cached fetch=l1").us,
    r"`cuda_march` ([\d.]+) and [\d.]+\. On the heart": lambda: named("fastest", "box@256", "cuda_march").us,
    r"`cuda_bricks` steps the whole body on the chip, and takes ([\d.]+) us": lambda: named("skips", "poke", "cuda_bricks").us,
    r"Small starts meet theory within ([\d.]+)% everywhere": lambda: 100 * max(
        abs(row["ratio"] - 1) for row in raw("stability")["stability"] if (row["start"]["amplitude"] or row["start"]["stretch"]) <= 0.001),
    r"all ([\d,]+) measurements of [\d]+ strategies are within their thresholds": lambda: sum(row["passed"] for row in raw("stress")["stress"]),
    r"measurements of (\d+) strategies are within": lambda: len({row["backend"] for row in raw("stress")["stress"]}),
    r"where float64 takes ([\d.]+) times as long": lambda: statistics.median(ratio for scene in ("box@32", "heart", "beam") for ratio in pairs(scene)),
}


def edit(backend):
    return max((case for case in cases("edits").values() if case.backend == backend and not case.tuning),
               key=lambda case: case["edits"])["edit_seconds_median"] * 1e6


def joules(name, tuning_of=""):
    row = next(row for row in raw("energy")["energy"] if row["name"] == f"{name}/position/float32{tuning_of}")
    return row["watts"] * row["seconds_per_step"]


def pairs(scene):
    runs = {(row["formulation"], row["precision"], row["fraction_of_stable"]): row["seconds"] for row in raw("pareto", PROCESSOR)["pareto"]
            if row["backend"] == "cpu_parallel" and row["scene"] == scene}
    return [time / runs[one, "float32", step] for (one, precision, step), time in runs.items()
            if precision == "float64" and (one, "float32", step) in runs]


def claims():
    """Every claim that is computed again, and the tables and sentences that are not there or of which nothing is computed."""
    found, without = [], []
    for page in PAGES:
        for where, header, rows, machine in tables(page):
            audit = AUDITED.get(where) or AUDITED.get((where, header[0]))
            if where == "As fast as the card allows" and "target" in header:
                audit = targets
            if header[-1] == "last over first":
                audit = across_cards
            if audit is None:
                without.append(f"{page}, {where}: the table of {header[0] or header[1]}")
            for line, cells in rows if audit else []:
                try:
                    found += [Claim(page, line, f"{where}, {cells[0]}, {column}", cell, value) for column, cell, value in
                              audit(cells, header, machine) if value is not None]
                except (KeyError, StopIteration, ValueError, IndexError) as error:
                    found.append(Claim(page, line, f"{where}, {cells[0]}", " | ".join(cells[:3]), f"nothing: {error!r}"))
    text = " ".join((ROOT / "results/README.md").read_text(encoding="utf-8").split())
    for pattern, value in SENTENCES.items():
        matches = list(re.finditer(pattern, text))
        if matches:
            found.append(Claim("results/README.md", 0, matches[0][0], matches[0][1], value()))
        else:
            without.append(f"results/README.md: no sentence {pattern}")
    return found, without


def is_right(claim):
    if isinstance(claim.value, str):
        return claim.said == claim.value
    said = numbers(claim.said)
    return bool(said) and agrees(said[0], claim.value)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--claims", type=int, default=120)
    parser.add_argument("--all", action="store_true", help="every claim; prints those that are wrong alone")
    options = parser.parse_args()
    known, without = claims()
    if not 0 < options.claims <= len(known):
        parser.error(f"--claims: {options.claims}: expected 1 to {len(known)}")
    drawn = known if options.all else random.Random(options.seed).sample(known, options.claims)
    wrong = [claim for claim in drawn if not is_right(claim)]
    for claim in wrong if options.all else drawn:
        value = claim.value if isinstance(claim.value, str) else f"{claim.value:.5g}"
        print(f"{'WRONG' if claim in wrong else 'right'}  {claim.page}:{claim.line or ''} {claim.what}: {claim.said} ({value})")
    for one in without:
        print(f"not computed again: {one}")
    print(f"{len(drawn) - len(wrong)} of {len(drawn)} right, of {len(known)} claims, seed {options.seed}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
