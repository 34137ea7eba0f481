#!/usr/bin/env python3
"""Fills the tables of results/README.md from the results beside it.

Usage: paper.py [--check]

A table stands between `<!-- NAME -->` and `<!-- /NAME -->`; its figures come from nvidia-h200/STUDY.json.gz, those of
`fastest` from the fastest.json.gz of every machine that has one, medians over the repetitions. --check changes nothing and exits with 1 if the page is not what the results say.
"""

import collections
import pathlib
import re
import sys

import result_files

HERE = pathlib.Path(__file__).resolve().parent
RESULTS = HERE / "nvidia-h200"
PAGE = HERE / "README.md"


def result(study):
    return result_files.load(result_files.named(RESULTS, study))


def medians(study):
    """The median row of each contender, in the order of the file."""
    return [row for row in result(study)["benchmarks"] if row.get("aggregate_name") == "median"]


def contender(row):
    """`cuda_implicit_cached fetch=l1`: the backend, its precision unless float32, and what tuning is not at its default."""
    _, backend, _, precision, *tuning = row["name"].split("/iterations:")[0].split("/")
    return " ".join([f"`{backend}`"] + [precision] * (precision != "float32") + tuning)


def three_digits(value):
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def microseconds(value):
    return three_digits(value) if value is not None else "-"


def time_of(row):
    """The median of a row, with the mark of one that its run says is not to be trusted."""
    return "~" * bool(row.get("noisy")) + microseconds(row["real_time"])


def percent(value):
    return f"{100 * value:.0f} %" if value is not None else "-"


def table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "| --- |" + " --: |" * (len(header) - 1)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def by_scene(rows, value):
    """{contender: {scene: value(row)}}, contenders in the order of their first row."""
    found = {}
    for row in rows:
        found.setdefault(contender(row), {})[row["scene"]] = value(row)
    return found


def scenes_of(rows):
    return list(dict.fromkeys(row["scene"] for row in rows))


def limits(study):
    context = result(study)["context"]["voxspring"]
    header = ["", "copy", "in cache", "launch", "float32", "float64", "float32 in compute shaders"]
    rows = []
    for api, limit in context["limits"].items():
        def rate(key, unit, scale, limit=limit):
            return f"{three_digits(limit[key] / scale)} {unit}" if limit.get(key) else "-"
        launch = limit["launch_seconds"]
        rows.append([api, rate("copy_bytes_per_second", "GB/s", 1e9), rate("cached_copy_bytes_per_second", "GB/s", 1e9),
                     f"{three_digits(launch * 1e6)} us" if launch else "-",
                     rate("float32_operations_per_second", "Gop/s", 1e9),
                     rate("float64_operations_per_second", "Gop/s", 1e9),
                     rate("compute_shader_float32_operations_per_second", "Gop/s", 1e9)])
    machine = (f"{context['gpu']}, driver {context['driver']}; {context['cpu']}; commit {context['commit']}"
               f"{'' if context['clean'] else ' (not clean)'}; {context['compiler']}, {context['cuda_compiler']}.")
    return machine + "\n\n" + table(header, rows)


def steps(study):
    rows = medians(study)
    scenes = scenes_of(rows)
    cells = by_scene(rows, lambda row: [time_of(row),
                                        three_digits(row["spring_updates_per_second"] * 1e-9),
                                        f"{percent(row['fraction_of_limit'])} ({row['limited_by']})",
                                        f"{row['error_max']:.1e}"])
    header = ["time a step"] + [f"{scene}: {what}" for scene in scenes
                                for what in ("us", "G springs/s", "of limit", "error")]
    order = sorted(cells, key=lambda name: float(cells[name][scenes[0]][0].removeprefix("~")))
    return table(header, [[name] + [cell for scene in scenes for cell in cells[name].get(scene, ["-"] * 4)]
                          for name in order])


def scaling():
    rows = medians("figure8")
    scenes = scenes_of(rows)
    particles = {row["scene"]: row["particles"] for row in rows}
    cells = by_scene(rows, lambda row: f"{time_of(row)} "
                                       f"({three_digits(row['real_time'] * 1e3 / row['particles'])})")
    header = ["us a step (ns a particle)"] + [f"{scene[4:]}^3: {particles[scene]}" for scene in scenes]
    return table(header, [[name] + [cells[name].get(scene, "-") for scene in scenes] for name in cells])


def edits():
    rows = medians("edits")
    scenes = scenes_of(rows)
    def cell(row):
        slow_down = row["real_time"] * 1e-6 / row["seconds_per_step_without_edits"] - 1
        return "~" * bool(row.get("noisy")) + f"{100 * slow_down:+.1f} %"
    slow = by_scene(rows, cell)
    latency = by_scene(rows, lambda row: row)
    counts = [latency[next(iter(latency))][scene]["edits"] for scene in scenes]
    header = ["slow-down of 1000 steps"] + [f"{count} edit" + "s" * (count > 1) for count in counts]
    header += ["an edit (us)", "a step (us)"]
    most = scenes[-1]
    return table(header, [[name] + [slow[name][scene] for scene in scenes] +
                          [microseconds(latency[name][most]["edit_seconds_median"] * 1e6),
                           microseconds(latency[name][most]["seconds_per_step_without_edits"] * 1e6)]
                          for name in slow])


def tuning():
    best = {}
    for row in medians("tuning"):
        key = (row["backend"], row["scene"])
        own = row["name"].split("/iterations:")[0].split("/")[4:]
        entry = best.setdefault(key, {"default": None, "time": float("inf")})
        if not own:
            entry["default"] = row
        if row["real_time"] < entry["time"]:
            entry.update(time=row["real_time"], best=row, tuning=own[0] if own else "the default")
    rows = [[f"`{backend}`", scene, time_of(entry["default"]) if entry["default"] else "-", time_of(entry["best"]),
             entry["tuning"]]
            for (backend, scene), entry in sorted(best.items())]
    return table(["strategy", "scene", "default (us)", "best (us)", "with"], rows)


FORMULATIONS = ["paper", "position", "displacement", "increment", "compensated"]


def tuned(row):
    """Whether anything but the fetch path is not at its default."""
    return any("=" in part and not part.startswith("fetch=") for part in row["name"].split("/iterations:")[0].split("/")[4:])


def formulations():
    """Time of position, and for each formulation its multiple and its rounding error."""
    rows = [row for row in medians("formulations") if not tuned(row)]
    cells = {}
    for row in rows:
        cells.setdefault((row["scene"], contender(row)), {})[row["formulation"]] = row
    lines = []
    for (scene, name), by_formulation in cells.items():
        base = by_formulation["position"]["real_time"]
        lines.append([f"{name}, {scene}", time_of(by_formulation["position"])] +
                     ["~" * bool(by_formulation[f].get("noisy")) +
                      f"{by_formulation[f]['real_time'] / base:.2f} ({by_formulation[f]['error_relative_l2']:.1e})"
                      for f in FORMULATIONS])
    return table(["10000 steps", "position (us a step)"] + FORMULATIONS, lines)


def stress():
    """The largest figure of any backend against the gates about rounding."""
    rows = result("stress")["stress"]
    worst = {}
    for row in rows:
        if row["part"] not in (7, 9) or row["precision"] != "float32":
            continue
        entry = worst.setdefault((row["measurement"], row["scene"], row["steps"]), {})
        measured = float("inf") if row["measured"] is None else row["measured"]
        known = entry.get(row["formulation"], (0, None))
        entry[row["formulation"]] = (max(known[0], measured), row["gate"])
    def cell(figure):
        measured, gate = figure
        return f"{measured:.1e}" + (f" (gate {gate:.1e})" if gate is not None else "")
    return table(["largest error of any strategy"] + FORMULATIONS,
                 [[f"{measurement}, {scene}, {count} steps"] + [cell(entry[f]) for f in FORMULATIONS]
                  for (measurement, scene, count), entry in worst.items() if len(entry) == len(FORMULATIONS)])


def stability():
    """The range of measured over theoretical limits, over all backends and scenes."""
    rows = result("stability")["stability"]
    ranges = {}
    for row in rows:
        start = row["start"]
        kind = f"{start['kind']} {start['amplitude'] or start['stretch']:g}, damping {row['damping']:g}"
        ranges.setdefault(kind, {}).setdefault(row["formulation"], []).append(row["ratio"])
    return table(["measured over theory"] + FORMULATIONS,
                 [[kind] + [f"{min(entry[f]):.4f} to {max(entry[f]):.4f}" for f in FORMULATIONS]
                  for kind, entry in ranges.items()])


def quantity(target, value):
    kind = target["quantity"]
    if kind in ("seconds_per_step", "ready_seconds"):
        return f"{three_digits(value * 1e6)} us" if value < 1e-2 else f"{three_digits(value)} s"
    if kind == "fraction_of_limit":
        return f"{percent(value)} of the limit"
    if kind == "speed_ratio":
        return f"{value:.2f} of the speed of `{target['over']}`"
    return f"{three_digits(value * 1e-9)} G {kind.split('_')[0]}s/s"


def medians_by_name(result):
    return {row["name"].split("/iterations:")[0]: row for row in result["benchmarks"] if row.get("aggregate_name") == "median"}


def machines():
    """Every machine's result of the study fastest."""
    for path in result_files.committed(HERE):
        if result_files.study_of(path) == "fastest":
            yield result_files.load(path)


def titled(result, text):
    context = result["context"]["voxspring"]
    clean = "" if context["clean"] else " (not clean)"
    return f"{context['gpu'] or context['cpu']}; commit {context['commit']}{clean}.\n\n{text}"


def targets():
    """What became of the targets that the study file names, machine by machine."""
    parts = []
    for result in machines():
        rows, known = [], medians_by_name(result)
        for block in result["fastest"]:
            for target in block["targets"]:
                if target["met"] is None:
                    continue
                row = known[target["name"]]
                rows.append([f"{block['scene']} {block['formulation']} {block['precision']}", quantity(target, target["value"]),
                             quantity(target, target["measured"]), contender(row), f"{percent(row['fraction_of_limit'])} "
                             f"({row['limited_by']})", f"{'met' if target['met'] else 'missed'}, {percent(target['reached'])}"])
        if rows:
            parts.append(titled(result, table(["dataset", "target", "measured", "by", "of limit", "of the target"], rows)))
    return "\n\n".join(parts)


def fastest():
    """For each machine the fastest strategy of each dataset."""
    parts = []
    for result in machines():
        rows, known = [], medians_by_name(result)
        for block in result["fastest"]:
            paper, times, row = block["paper"], block["auto"]["times_fastest"], known[block["name"]]
            compiling = row.get("compile_seconds")
            rows.append([f"{block['scene']} {block['formulation']} {block['precision']}", contender(block),
                         "~" * bool(row.get("noisy")) + microseconds(block["seconds_per_step"] * 1e6),
                         three_digits(block["particle_updates_per_second"] * 1e-9),
                         three_digits(block["spring_updates_per_second"] * 1e-9),
                         f"{percent(block['fraction_of_limit'])} ({block['limited_by']})", f"{block['error_max']:.1e}",
                         f"{paper['ratio']:.2f} ({contender(paper)})" if paper else "-",
                         f"{times:.2f}" if times else "not measured",
                         three_digits(block["ready_seconds"] * 1e3) + (f" ({three_digits(compiling * 1e3)})" if compiling else "")])
        header = ["dataset", "fastest", "us a step", "G particles/s", "G springs/s", "of limit", "error", "x the paper's best",
                  "x auto", "ready (compiling) (ms)"]
        parts.append(titled(result, table(header, rows)))
    return "\n\n".join(parts)


def resting():
    """A step of all tiles, one that leaves out those at rest, and what share of them it took in the end."""
    work = {row["name"]: row["work"] for row in result("skips")["verification"] if "work" in row}
    times = {row["name"].split("/iterations:")[0]: row for row in medians("skips")}
    scenes, lines = scenes_of(medians("skips")), {}
    for name, skipping in times.items():
        way = next((way for way in ("skip", "flush") if name.endswith(f"/rest={way}")), None)
        if way is None:
            continue
        plain = name.removesuffix(way) + "step"
        scene, backend, formulation, *_ = name.split("/")
        share = work[name]["tiles_stepped"] / work[name]["tiles"]
        cells = lines.setdefault((backend, formulation, way), {})
        cells[scene] = f"{time_of(times[plain])} / {time_of(skipping)} ({percent(share)})"
    return table(["us a step of all / of what moves (tiles stepped)"] + scenes,
                 [[f"`{backend}` {formulation}" + ", flush" * (way == "flush")] + [cells.get(scene, "-") for scene in scenes]
                  for (backend, formulation, way), cells in sorted(lines.items())])


def files():
    """Of which commit, day and card each file is, and what its runs say of themselves."""
    lines, cards = [], {}
    for path in result_files.within(RESULTS):
        result = result_files.load(path)
        build, rows = result["context"]["voxspring"], result["benchmarks"]
        own = {backend["uuid"] for backend in build["backends"].values() if backend.get("uuid")}
        repetitions = collections.Counter(row["name"] for row in rows if row["run_type"] == "iteration")
        of_rows = [row.get("noisy") for row in rows if row.get("aggregate_name") == "median"]
        strangers = sum(any("other processes" in reason for reason in noisy or []) for noisy in of_rows)
        lines.append([f"`{result_files.study_of(path)}`", build["commit"][:8] + " (not clean)" * (not build["clean"]),
                      result["context"]["date"][:10],
                      ", ".join(chr(ord("A") + cards.setdefault(uuid, len(cards))) for uuid in sorted(own)) or "-",
                      " to ".join(map(str, sorted({min(repetitions.values()), max(repetitions.values())}))) if repetitions
                      else "-",
                      f"{sum(map(bool, of_rows))} of {len(of_rows)} ({strangers})" if of_rows else "-"])
    return table(["file", "commit", "day", "card", "repetitions", "marked `~` (other processes on the card)"], lines)


TABLES = {"fastest": fastest, "targets": targets, "limits": lambda: limits("table1"), "table1": lambda: steps("table1"), "figure7": lambda: steps("figure7"),
          "figure8": scaling, "edits": edits, "tuning": tuning, "formulations": formulations, "stress": stress,
          "stability": stability, "resting": resting, "files": files}


def main():
    page = PAGE.read_text()
    for name, make in TABLES.items():
        block = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        if not block.search(page):
            sys.exit(f"{PAGE.name} has no place for the table {name}")
        page = block.sub(lambda match, text=make(): f"{match[1]}\n{text}\n\n{match[2]}", page)
    if "--check" in sys.argv[1:]:
        if page != PAGE.read_text():
            sys.exit(f"{PAGE.name} is not what the results say: run {pathlib.Path(__file__).name}")
        return
    PAGE.write_text(page)


if __name__ == "__main__":
    main()
