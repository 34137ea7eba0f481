#!/usr/bin/env python3
"""Checks numbers on the pages, drawn at random: computes each again from the committed results.

Usage: audit.py [--seed N] [--claims N] [--all]

A claim is a number in a table of README.md, results/README.md or a page of docs/ with figures (PAGES), or in one of some sentences
of results/README.md (SENTENCES). This script reads the JSON of the results itself, and shares no code with the pages' templates. It
prints each claim with the value that it computed, then the tables that it does not check and the sentences that it does not find.

Exit code: 0 all claims drawn are right; 1 at least one is wrong; 2 bad input.
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
    """A case of a study with all its repetitions. Every other repetition, from the first on, takes part in choosing the fastest
    case: `chosen_by` is the median of these, and `held_out` that of the remaining ones. All of fewer than four do both."""

    def __init__(self, rows):
        self.times = [row["real_time"] for row in rows if row["run_type"] == "iteration"]
        self.row, self.us = rows[0], statistics.median(self.times)
        self.chosen_by, self.held_out = (statistics.median(self.times[first::2] if len(self.times) > 3 else self.times) for first in (0, 1))
        self.name = rows[0]["name"].split("/iterations:")[0]
        self.scene, self.backend, self.formulation, self.precision, *self.tuning = self.name.split("/")

    def __getitem__(self, key):
        return self.row[key]

    def of_limit(self, us=None):
        return 100 * self.row["limit_seconds"] * 1e6 / (us or self.us) if self.row["limit_seconds"] else None

    def spread(self):
        low, _, high = statistics.quantiles(self.times, n=4, method="inclusive")
        return 100 * max((high - low) / 2 / self.us, self.row.get("process_spread") or 0)


@functools.lru_cache(None)
def cases(study, machine=CARD):
    """The cases of a study by their names, each of which has one number of steps."""
    found = collections.defaultdict(list)
    for row in raw(study, machine)["benchmarks"]:
        found[row["name"].split("/iterations:")[0]].append(row)
    several = [name for name, rows in found.items() if len({row["steps"] for row in rows}) > 1]
    assert not several, f"{machine}/{study}: {several[0]} has several numbers of steps"
    return {name: Case(rows) for name, rows in found.items()}


def alike(study, machine=CARD, **which):
    return [case for case in cases(study, machine).values() if all(getattr(case, key) == value for key, value in which.items())]


def plain(scene, machine=CARD, **which):
    return alike("fastest", machine, scene=scene, formulation="position", precision="float32", **which)


def best(several):
    """(the fastest case, its time). A single case needs no choice, so its time is the median of all its repetitions."""
    chosen = min(several, key=lambda case: case.chosen_by)
    return chosen, chosen.us if len(several) == 1 else chosen.held_out


def name_of(scene, label, formulation="position"):
    """The name of the rows that a table calls "`cuda_implicit_cached` fetch=l1"."""
    backend, *words = label.replace("`", "").split(" ")
    precision = words.pop(0) if words and words[0].startswith("float") else "float32"
    return "/".join([scene, backend, formulation, precision, *words])


def named(study, scene, label, formulation="position", machine=CARD):
    return cases(study, machine)[name_of(scene, label, formulation)]


def machine_of(words):
    return PROCESSOR if "AMD EPYC" in words else OTHER_CARD if "H100" in words else CARD


def tables(page):
    """Yields for each table of a page: (its marker or else its heading, names of columns, [(line number, cells)], machine)."""
    def cells_of(one):
        return [cell.strip() for cell in one.strip().strip("|").split("|")]

    heading, marker, lines = "", "", (ROOT / page).read_text(encoding="utf-8").split("\n")
    for index, line in enumerate(lines):
        heading = line.lstrip("# ") if line.startswith("#") else heading
        if found := re.match(r"<!-- (/?)(\w+) -->", line):
            marker = "" if found[1] else found[2]
        if line.startswith("|") and not lines[index - 1].startswith("|"):
            # The column "steps" identifies a row and is no result. Only gates() needs it, to find its row.
            header = {at: name for at, name in enumerate(cells_of(line)) if name != "steps" or marker == "gates"}
            end = next(at for at in range(index, len(lines)) if not lines[at].startswith("|"))
            rows = [(at + 1, [cell for place, cell in enumerate(cells_of(lines[at])) if place in header]) for at in range(index + 2, end)]
            origin = next((one for one in (lines[end:end + 3] if marker else lines[index - 1::-1]) if one.strip()), "")
            yield marker or heading, [re.sub(r", (batches of )?\d+ steps", "", name) for name in header.values()], rows, machine_of(origin)


# --- Tables. An audit takes the cells of a row, the header and the machine. It returns {name or number of a column: value}. If a
# cell has several figures, its value is a list of (words that follow the column's name in the claim, part of the cell, value).

def each(value_of, first=2):
    """Makes an audit that calls value_of(first cell of the row, column, cell) for each cell from column `first` on, except
    dashes."""
    return lambda cells, header, _: {at: value_of(cells[0], header[at], cells[at]) for at in range(first, len(header)) if cells[at] != "-"}


def with_second(cell, value, words, second):
    """The two figures of a cell. The second one is in parentheses; `words` names it."""
    return [("", cell, value), (words, cell[cell.rindex("("):], second)]


def of_steps(study):
    def value_of(label, column, _):
        scene, what = column.split(": ")
        case = named(study, scene, label)
        return {"us": case.us, "G springs/s": case["springs"] / case.us * 1e-3, "of limit": case.of_limit(),
                "error": case["error_max"]}.get(what)
    return each(value_of)


def start(label, column, _):
    scene, what = column.split(": ")
    return 1e3 * named("table1", scene, label)["warm_ready_seconds" if what == "warm" else "ready_seconds"]


def figure8(label, column, cell):
    case = named("figure8", f"box@{column.partition('^')[0]}", label)
    return with_second(cell, case.us, " per particle", case.us * 1e3 / case["particles"])


def edits(label, column, _):
    scenes = {case["edits"]: case for case in cases("edits").values() if case.name.endswith(name_of("", label, "increment"))}
    if "edit" in column and column[0].isdigit():
        case = scenes[int(column.split(" ")[0])]
        return 100 * (case.us * 1e-6 / case["seconds_per_step_without_edits"] - 1)
    key = {"an edit": "edit_seconds_median", "a step": "seconds_per_step_without_edits"}.get(column.split(" (")[0])
    return key and scenes[max(scenes)][key] * 1e6


def tuning(cells, header, _):
    own = alike("tuning", scene=cells[1], backend=cells[0].strip("`"))
    chosen, us = best(own)
    default = next((case for case in own if not case.tuning), None)
    usual = default and (default.held_out if len(own) > 1 else default.us)
    if usual and usual < 1.03 * us:
        chosen, us = default, usual
    return {4: len(own), 2: None if cells[2] == "-" else usual, 3: us, 5: " ".join(chosen.tuning) or "the default"}


def rates(case, us):
    return {"us per step": us, "G particles/s": case["particles"] / us * 1e-3, "G springs/s": case["springs"] / us * 1e-3,
            "of limit": case.of_limit(us), "% of roofline": case.of_limit(us), "error": case["error_max"]}


def fastest(cells, header, machine):
    scene, formulation, precision = cells[0].split(" ")
    own = alike("fastest", machine, scene=scene, formulation=formulation, precision=precision)
    case, papers = best(own)[0], [one for one in own if one.backend in PAPER]
    us = case.held_out
    return {"fastest": " ".join([f"`{case.backend}`"] + [precision] * (precision != "float32") + case.tuning), "of so many": len(own),
            **rates(case, us), "x the paper's best": best(papers)[0].held_out / us if papers else None}


def across_cards(cells, header, _):
    """Audits the row of a dataset: its fastest strategy and the time of that on each card."""
    scene, formulation, *precision = cells[0].split(" ")
    values, times = {}, []
    for at, column in enumerate(header):
        if column.endswith(": fastest") and cells[at] != "-":
            own = alike("fastest", machine_of(column), scene=scene, formulation=formulation, precision=(precision or ["float32"])[0])
            case = best(own)[0]
            times.append(case.held_out)
            values |= {at: " ".join([f"`{case.backend}`"] + precision + case.tuning), at + 1: times[-1]}
    return values | {len(header) - 1: None if cells[-1] == "-" else times[-1] / times[0]}


def targets(cells, header, machine):
    scene, formulation, _ = cells[0].split(" ")
    return {3: named("fastest", scene, cells[4], formulation, machine).held_out if cells[2].endswith(" us") else None}


def formulations(cells, header, _):
    label, scene, steps = cells[0].rsplit(", ", 2)
    known = {case.formulation: case for case in alike("formulations", scene=scene) if
             case["steps"] == int(steps.split(" ")[0]) and " ".join([f"`{case.backend}`"] + case.tuning) == label}
    return {1: known["position"].us} | {
        at: with_second(cells[at], known[name].us / known["position"].us, " error", known[name]["error_relative_l2"])
        for at, name in enumerate(header) if at > 1 and cells[at] != "-"}


def stress(label, formulation, _):
    name, scene, steps = re.fullmatch(r"(.*?), (.*), (\d+) steps", label).groups()
    rows = [row for row in raw("stress")["stress"] if row["part"] in (7, 9) and (row["measurement"], row["scene"], row["steps"],
            row["formulation"], row["precision"]) == (name, scene, int(steps), formulation, "float32")]
    return max(math.inf if row["measured"] is None else row["measured"] for row in rows)


def stability(label, formulation, cell):
    kind, amount, damping = re.fullmatch(r"(\w+) ([\d.]+), damping ([\d.]+)", label).groups()
    ratios = [row["measured_time_step"] / row["theory_time_step"] for row in raw("stability")["stability"] if row["formulation"] ==
              formulation and row["start"]["kind"] == kind and (row["start"]["amplitude"] or row["start"]["stretch"]) == float(amount)
              and row["damping"] == float(damping)]
    least, most = cell.split(" to ")
    return [(" least", least, min(ratios)), (" most", most, max(ratios))]


def resting(label, scene, cell):
    backend, _, words = label.partition(" ")
    name = "/".join([scene, backend.strip("`"), words.split(",")[0], "float32"])
    skipping = f"{name}/rest={'flush' if words.endswith('flush') else 'skip'}"
    every, moving = cell.split(" / ")
    work = next(row["work"] for row in raw("skips")["verification"] if row["name"] == skipping)
    return [(" all", every, cases("skips")[name + "/rest=step"].us), (" moving", moving, cases("skips")[skipping].us),
            (" tiles", moving[moving.rindex("("):], 100 * work["tiles_stepped"] / work["tiles"])]


def energy(cells, header, _):
    scene, label = cells[0].split(", ")
    row = energy_of(scene, label)
    return {"mJ per step": row["watts"] * row["seconds_per_step"] * 1e3,
            "G springs/J": row["springs"] / row["watts"] / row["seconds_per_step"] * 1e-9, "power (W)": row["watts"],
            "idle (W)": row["idle_watts"], "cross-checked by samples": 100 * abs(row["sampled_watts"] / row["watts"] - 1),
            "measured (s)": row["seconds"]}


def explicit(cells, header, _):
    own = plain(cells[0])
    (_, implicit), (_, lists) = (best([one for one in own if one.backend in PAPER and f"cuda_{side}_" in one.backend])
                                 for side in ("implicit", "explicit"))
    values = own[0]["particles"], 100 * own[0]["particles"] / own[0]["voxels"], own[0]["steps"], implicit, lists, lists / implicit
    return dict(enumerate(values, 2))


LIMITS = {"copy": ("copy_bytes_per_second", 1e-9), "in cache": ("cached_copy_bytes_per_second", 1e-9), "launch": ("launch_seconds", 1e6),
          "float32": ("float32_operations_per_second", 1e-9), "float64": ("float64_operations_per_second", 1e-9)}


def limits_of(study):
    return raw(study)["context"]["voxspring"].get("limits", {})


def limit(api, key):
    """The best value of a limit over all studies of the card."""
    every = [limits_of(path.name.removesuffix(".json.gz")).get(api, {}).get(key) for path in (ROOT / "results" / CARD).glob("*.json.gz")]
    return (min if key == "launch_seconds" else max)(value for value in every if value)


def limits(api, column, _):
    key, scale = LIMITS.get(column, (None, None))
    return key and limit(api, key) * scale


def files(cells, header, _):
    result = raw(cells[0].strip("`"))
    medians = [row for row in result["benchmarks"] if row.get("aggregate_name") == "median"]
    return {1: result["context"]["voxspring"]["commit"][:8], 2: result["context"]["date"][:10],
            5: sum(bool(row.get("noisy")) for row in medians) if result["benchmarks"] else None}


def heart(cells, header, machine):
    tried = plain("heart", machine, backend=cells[0].strip("`"))
    case, us = best(tried)
    least = min(best(plain("heart", machine, backend=other.backend))[1] for other in plain("heart", machine))
    return {"us per step": us, "x fastest": us / least} | rates(case, us) | {"best of": len(tried)}


def claimed(cells, header, machine):
    case = named("fastest", "heart", cells[0], machine=machine)
    return {"us per step": case.us, "repetitions": case.spread()} | rates(case, case.us)


def pairs(backend, scene):
    """Ratios of float64's times to float32's in the study pareto: one for each formulation and time step."""
    rows = raw("pareto", PROCESSOR if backend == "cpu_parallel" else CARD)["pareto"]
    runs = {(row["formulation"], row["precision"], row["fraction_of_stable"]): row["seconds"] for row in rows
            if row["backend"] == backend and row["scene"] == scene}
    return [time / runs[one, "float32", step] for (one, precision, step), time in runs.items()
            if precision == "float64" and (one, "float32", step) in runs]


def float64(cells, header, _):
    backend, scene = cells[0].split(", ")
    ratios = pairs(backend.strip("`"), scene)
    return dict(enumerate((min(ratios), statistics.median(ratios), max(ratios), len(ratios)), 1))


APIS = {"CUDA": "cuda_implicit_cached", "Vulkan": "vulkan_implicit", "OpenGL, compute": "gl_compute_implicit",
        "OpenGL, fragments": "gl_fragment_implicit", "CUDA, resident": "cuda_resident"}


def scaled(cell, seconds):
    return seconds * (1e9 if cell.endswith("ns") else 1e6)


def launches(cells, header, _):
    rows = {row["handed_over"]: row for row in raw("overhead")["overhead"] if row["backend"] == APIS[cells[0]] and
            row["particles"] == int(cells[1].replace(",", ""))}
    times = [rows[way][key] for way in ("one by one", "at once") for key in ("seconds_per_step", "host_seconds_per_step")]
    return {at: scaled(cells[at], time) for at, time in enumerate(times, 2)}


def sizes(scene, api, cell):
    us, cuda = (best(plain(scene, backend=APIS[one]))[1] for one in (api, "CUDA"))
    return with_second(cell, us, " over CUDA", us / cuda) if "(" in cell else us


def ticks(cells, header, machine):
    row = next(row for row in raw("haptic", machine)["haptic"] if not row["edited"] and not row.get("drawn") and
               row["hertz"] == 1000 * float(cells[2]) and row["name"] == name_of(*cells[:2], "increment"))
    times = {"median": "median_seconds", "99 %": "p99_seconds", "99.9 %": "p999_seconds", "worst": "worst_seconds"}
    told = dict(zip(header, cells))
    return {column: scaled(told[column], row[key]) for column, key in times.items() if told[column] != "-"} | {
        "missed": row["missed"], "steps fit": row["steps_that_fit"]}


def empty_steps(_, column, __):
    names = {"OpenGL, compute": "OpenGL compute", "OpenGL, fragments": "OpenGL"}
    return 1e6 * limit(names.get(column, column), "launch_seconds")


def gates(cells, header, _):
    row = next(row for row in json.loads((ROOT / "docs/gates.json").read_text(encoding="utf-8")) if (
        row["scene"], row["steps"], row["formulation"]) == (cells[0], int(cells[1].replace(",", "")), cells[2].strip("`")))
    values = (row["spread_share"], row["gate_share"], row["honest_in_spreads"], min(row["wrong_in_gates"].values()))
    return dict(enumerate(values, 3))


# The audits of tables, by the table's marker, by the name of its last column, or by (heading, name of its first column).
AUDITED = {"heart": heart, "claims": claimed, "float64": float64, "gates": gates, "launches": launches, "sizes": each(sizes),
           "ticks": ticks, "empty_steps": each(empty_steps, 0), "last over first": across_cards, "of the target": targets,
           ("Table 1", "time per step"): of_steps("table1"), ("Figure 7", "time per step"): of_steps("figure7"),
           ("Table 1", "start (ms)"): each(start, 1), ("Figure 8", "us per step (ns per particle)"): each(figure8),
           ("Cuts and sutures", "slow-down of 1000 steps"): each(edits), ("Tuning", "strategy"): tuning,
           ("As fast as the card allows", "dataset"): fastest, ("Formulations", "case"): formulations,
           ("Errors and extremes", "largest error of any strategy"): each(stress, 1),
           ("Stability", "measured over theory"): each(stability, 1), ("Energy", "case"): energy,
           ("Tiles at rest", "us per step of all / of what moves (tiles stepped)"): each(resting, 1),
           ("What holds and what does not", "dataset"): explicit, ("The paper's conclusions on an NVIDIA H200", ""): each(limits, 1),
           ("The paper's conclusions on an NVIDIA H200", "file"): files}


def over(study, scene, case, other):
    return named(study, scene, case).us / named(study, scene, other).us


def energy_of(scene, label):
    return next(row for row in raw("energy")["energy"] if row["name"] == name_of(scene, label))


def joules(scene, label):
    row = energy_of(scene, label)
    return row["watts"] * row["seconds_per_step"]


def edit(backend):
    return max((case for case in alike("edits", backend=backend) if not case.tuning),
               key=lambda case: case["edits"])["edit_seconds_median"] * 1e6


# Patterns of the words around a figure, each with a function that computes the figure. A blank stands for any white space.
SENTENCES = {
    r"reaches ([\d.]+) times the arithmetic of a fragment shader": lambda: (lambda of: of["compute_shader_float32_operations_per_second"] /
        of["float32_operations_per_second"])(limits_of("table1")["OpenGL"]),
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
    r"`cuda_march` takes ([\d.]+) of the energy of": lambda: joules("box@256", "cuda_march") / joules("box@256", "cuda_implicit_cached fetch=l1"),
    r"`cuda_resident` ([\d.]+) on the box of 32\^3\.": lambda: joules("box@32", "cuda_resident") / joules("box@32", "cuda_implicit_cached fetch=l1"),
    r"with L1-cached loads takes ([\d.]+) us with `position`": lambda: named("fastest", "box@256", "cuda_implicit_cached fetch=l1").us,
    r"`cuda_march` ([\d.]+) and [\d.]+\. On the heart": lambda: named("fastest", "box@256", "cuda_march").us,
    r"`cuda_bricks` steps the whole body on the chip, and takes ([\d.]+) us": lambda: named("skips", "poke", "cuda_bricks").us,
    r"Small starts meet theory within ([\d.]+)% everywhere": lambda: 100 * max(
        abs(row["ratio"] - 1) for row in raw("stability")["stability"] if (row["start"]["amplitude"] or row["start"]["stretch"]) <= 0.001),
    r"all ([\d,]+) measurements of [\d]+ strategies are within their thresholds": lambda: sum(row["passed"] for row in raw("stress")["stress"]),
    r"measurements of (\d+) strategies are within": lambda: len({row["backend"] for row in raw("stress")["stress"]}),
    r"where float64 takes ([\d.]+) times as long": lambda: statistics.median(ratio for scene in ("box@32", "heart", "beam") for ratio in pairs("cpu_parallel", scene)),
}


def figures(values, header, cells):
    """Yields (column, cell, value) for what an audit computed for a row, except of columns that the table lacks."""
    for key, value in values.items():
        if isinstance(key, int) or key in header:
            at = key if isinstance(key, int) else header.index(key)
            for words, cell, one in value if isinstance(value, list) else [("", cells[at], value)]:
                yield header[at] + words, cell, one


def claims():
    """Returns all claims with their computed values, and a line for each table without an audit and each pattern without a
    match."""
    found, without = [], []
    for page in PAGES:
        for where, header, rows, machine in tables(page):
            audit = next((AUDITED[key] for key in (header[-1], where, (where, header[0])) if key in AUDITED), None)
            if audit is None:
                without.append(f"{page}, {where}: the table of {header[0] or header[1]}")
            for line, cells in rows if audit else []:
                try:
                    found += [Claim(page, line, f"{where}, {cells[0]}, {column}", cell, value) for column, cell, value in
                              figures(audit(cells, header, machine), header, cells) if value is not None]
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
    """Whether a claim is right: its text is the value, or its first number is the value rounded to as many decimals as the number
    has or to three significant digits."""
    if isinstance(claim.value, str):
        return claim.said == claim.value
    # Removes names such as `cuda_march`, box@32 and fetch=l1, and exponents such as 32^3: their digits are no figures.
    said = NUMBER.search(re.sub(r"`[^`]*`|\S*(?:=|_|@)\S*|10 \^|\^\d", " ", claim.said))
    if not said:
        return False
    text = said[0].replace(",", "")
    mantissa, _, exponent = text.partition("e")
    digits = len(mantissa.partition(".")[2])
    forms = {f"{claim.value:.{digits}e}" if exponent else f"{claim.value:.{digits}f}", f"{claim.value:.3g}"}
    if not digits:  # A number that ends in zeros may be rounded to tens or hundreds.
        forms.add(str(round(claim.value, len(text.rstrip("0")) - len(text))))
    return any(math.isclose(float(text), float(form), rel_tol=1e-9, abs_tol=1e-12) for form in forms)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--claims", type=int, default=120)
    parser.add_argument("--all", action="store_true", help="audit every claim, and print only the wrong ones")
    options = parser.parse_args()
    known, without = claims()
    if not 0 < options.claims <= len(known):
        parser.error(f"--claims: {options.claims} is not accepted; expected a number of claims from 1 to {len(known)}")
    drawn = known if options.all else random.Random(options.seed).sample(known, options.claims)
    wrong = [claim for claim in drawn if not is_right(claim)]
    for claim in wrong if options.all else drawn:
        value = claim.value if isinstance(claim.value, str) else f"{claim.value:.5g}"
        print(f"{'WRONG' if claim in wrong else 'right'}  {claim.page}:{claim.line or ''} {claim.what}: {claim.said} ({value})")
    for one in without:
        print(f"not checked: {one}")
    print(f"{len(drawn) - len(wrong)} of {len(drawn)} right, of {len(known)} claims, seed {options.seed}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
