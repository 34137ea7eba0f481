"""The tables of results/README.md, a function each; figures are medians over the repetitions."""

import collections

import result_files
from readme import addressing
from readme.rows import (
    GPU, PAPER, RESULTS, alike, by_name, contender, fastest_of, held_out, is_papers, loaded, machines, marked, medians, medians_of,
    microseconds, name_of, percent, result, scenes_of, spread_text, table, three_digits, time_of, tuning_of,
)

FORMULATIONS = ["paper", "position", "displacement", "increment", "compensated"]


def papers(row):
    return "paper" if is_papers(row) else "later"


def limit_of(row):
    """What share of its limit a row reaches, and which limit that is."""
    return f"{percent(row['fraction_of_limit'])} ({row['limited_by']})" if row["fraction_of_limit"] else "-"


def by_scene(rows, value):
    """{contender: {scene: value(row)}}, contenders in the order of their first row."""
    found = {}
    for row in rows:
        found.setdefault(contender(row), {})[row["scene"]] = value(row)
    return found


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
                                        limit_of(row),
                                        f"{row['error_max']:.1e}"])
    whose = {contender(row): papers(row) for row in rows}
    times = by_scene(rows, lambda row: row["real_time"])
    header = ["time a step", "strategy of"] + [f"{scene}: {what}" for scene in scenes
                                               for what in ("us", "G springs/s", "of limit", "error")]
    order = sorted(cells, key=lambda name: times[name].get(scenes[0], float("inf")))
    return table(header, [[name, whose[name]] + [cell for scene in scenes for cell in cells[name].get(scene, ["-"] * 4)]
                          for name in order])


def scaling():
    rows = medians("figure8")
    scenes = scenes_of(rows)
    particles = {row["scene"]: row["particles"] for row in rows}
    whose = {contender(row): papers(row) for row in rows}
    cells = by_scene(rows, lambda row: f"{time_of(row)} "
                                       f"({three_digits(row['real_time'] * 1e3 / row['particles'])})")
    header = ["us a step (ns a particle)", "strategy of"] + [f"{scene[4:]}^3: {particles[scene]}" for scene in scenes]
    return table(header, [[name, whose[name]] + [cells[name].get(scene, "-") for scene in scenes] for name in cells])


def slow_down(row):
    return row["real_time"] * 1e-6 / row["seconds_per_step_without_edits"] - 1


def edits():
    rows = medians("edits")
    scenes = scenes_of(rows)
    slow = by_scene(rows, lambda row: marked(row, f"{100 * slow_down(row):+.1f} %") + spread_text(row))
    found = by_scene(rows, lambda row: row)
    counts = [found[next(iter(found))][scene]["edits"] for scene in scenes]
    header = ["slow-down of 1000 steps", "strategy of"] + [f"{count} edit" + "s" * (count > 1) for count in counts]
    header += ["an edit (us)", "a step (us)"]
    lines = []
    for name, cells in slow.items():
        last = found[name].get(scenes[-1])
        lines.append([name, papers(next(iter(found[name].values())))] + [cells.get(scene, "-") for scene in scenes] +
                     ([microseconds(last["edit_seconds_median"] * 1e6),
                       microseconds(last["seconds_per_step_without_edits"] * 1e6)] if last else ["-", "-"]))
    return table(header, lines)


def tuning():
    best = {}
    for row in medians("tuning"):
        best.setdefault((row["backend"], row["scene"]), []).append(row)
    lines = []
    for (backend, scene), rows in sorted(best.items()):
        default = next((row for row in rows if not tuning_of(row)), None)
        if default and len(rows) > 1:
            default = held_out(default)
        row = fastest_of(rows)
        if default and default["real_time"] < row["real_time"] * (1 + result_files.MIN_SPREAD):
            row = default
        lines.append([f"`{backend}`", scene, time_of(default) if default else "-", time_of(row), str(len(rows)),
                      " ".join(tuning_of(row)) or "the default"])
    return table(["strategy", "scene", "default (us)", "best (us)", "of so many", "with"], lines)


def tuned(row):
    """Whether anything but the fetch path is not at its default."""
    return any(not part.startswith("fetch=") for part in tuning_of(row))


def formulations():
    """Time of position, and for each formulation its multiple and its rounding error."""
    rows = [row for row in medians("formulations") if not tuned(row)]
    cells = {}
    for row in rows:
        cells.setdefault((row["scene"], row["steps"], contender(row)), {})[row["formulation"]] = row
    lines = []
    for (scene, count, name), by_formulation in cells.items():
        base = by_formulation.get("position")
        if base is None:
            continue
        def cell(row, base=base["real_time"]):
            return marked(row, f"{row['real_time'] / base:.2f}{spread_text(row)} ({row['error_relative_l2']:.1e})") if row else "-"
        lines.append([f"{name}, {scene}, {count} steps", time_of(base)] + [cell(by_formulation.get(f)) for f in FORMULATIONS])
    return table(["case", "position (us a step)"] + FORMULATIONS, lines)


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


def titled(one, text):
    context = one["context"]["voxspring"]
    clean = "" if context["clean"] else " (not clean)"
    return f"{context['gpu'] or context['cpu']}; commit {context['commit']}{clean}.\n\n{text}"


def targets():
    """What became of the targets that the study file names, machine by machine."""
    parts = []
    for one in machines("fastest"):
        lines, known = [], by_name(one)
        for block in one["fastest"]:
            for target in block["targets"]:
                if target["met"] is None:
                    continue
                row = known[target["name"]]
                lines.append([f"{block['scene']} {block['formulation']} {block['precision']}", quantity(target, target["value"]),
                              marked(row, quantity(target, target["measured"])), contender(row),
                              limit_of(row),
                              f"{'met' if target['met'] else 'missed'}, {percent(target['reached'])}"])
        if lines:
            parts.append(titled(one, table(["dataset", "target", "measured", "by", "of limit", "of the target"], lines)))
    return "\n\n".join(parts)


def milliseconds(row, key):
    return three_digits(row[key] * 1e3) if row.get(key) is not None else "-"


def starts_of(row):
    """Milliseconds from nothing to the first step: with no kernel on disk, what compiling takes of them, and with all kernels there.

    Where a study left them out, a dash.
    """
    compiling = f" ({milliseconds(row, 'compile_seconds')})" if row.get("compile_seconds") else ""
    return [milliseconds(row, "ready_seconds") + compiling, milliseconds(row, "warm_ready_seconds")]


def starts():
    """The cold and the warm start of every strategy."""
    rows = medians("table1")
    scenes = scenes_of(rows)
    cells = by_scene(rows, starts_of)
    header = ["start (ms)"] + [f"{scene}: {what}" for scene in scenes for what in ("cold (compiling)", "warm")]
    return table(header, [[name] + [cell for scene in scenes for cell in cells[name].get(scene, ["-"] * 2)] for name in sorted(cells)])


def fastest():
    """For each machine the fastest strategy of each dataset."""
    parts = []
    for one in machines("fastest"):
        lines, rows = [], medians_of(one)
        known = {name_of(row): row for row in rows}
        for block in one["fastest"]:
            paper, times, row = block["paper"], block["auto"]["times_fastest"], held_out(known[block["name"]])
            tried = alike(rows, row)
            lines.append([f"{block['scene']} {block['formulation']} {block['precision']}", contender(row), str(len(tried)),
                          time_of(row), three_digits(row["particle_updates_per_second"] * 1e-9),
                          three_digits(row["spring_updates_per_second"] * 1e-9),
                          limit_of(row), f"{row['error_max']:.1e}",
                          f"{paper['ratio']:.2f} ({contender(paper)}, of {sum(other['backend'] in PAPER for other in tried)})"
                          if paper else "-", f"{times:.2f}" if times else "not measured", *starts_of(row)])
        header = ["dataset", "fastest", "of so many", "us a step", "G particles/s", "G springs/s", "of limit", "error",
                  "x the paper's best", "x auto", "cold start (compiling) (ms)", "warm start (ms)"]
        parts.append(titled(one, table(header, lines)))
    return "\n\n".join(parts)


def resting():
    """A step of all tiles, one that leaves out those at rest, and what share of them it took in the end."""
    work = {row["name"]: row["work"] for row in result("skips")["verification"] if "work" in row}
    times = by_name(result("skips"))
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


def cross_check(row):
    """How far samples of the power are from the energy counter, where the device gives any."""
    if row.get("sampled_watts") is None:
        return "no"
    return f"yes, {100 * abs(row['sampled_watts'] / row['watts'] - 1):.1f} %"


def energy():
    """What a step takes of the device's energy, and what the device draws meanwhile and idle."""
    found = result("energy")
    lines = [[f"{row['scene']}, {contender(row)}", f"{three_digits(row['joules_per_step'] * 1e3)}",
              three_digits(row["springs_per_joule"] * 1e-9), three_digits(row["watts"]), three_digits(row["idle_watts"]),
              ", ".join(row.get("throttled", [])) or "-", row["meter"], cross_check(row), f"{row['seconds']:.1f}"]
             for row in found["energy"]]
    return titled(found, table(["case", "mJ a step", "G springs/J", "power (W)", "idle (W)", "clocks held down by", "counter",
                                "cross-checked by samples", "measured (s)"], lines))


def results_of(machine=GPU):
    return [loaded(path) for path in result_files.within(RESULTS / machine)]


def cards_of(one):
    """The identities of the cards that a result is of."""
    return sorted({backend["uuid"] for backend in one["context"]["voxspring"]["backends"].values() if backend.get("uuid")})


def files():
    """Of which commit, day and card each file is, and what its runs say of themselves."""
    lines, cards = [], {}
    for path in result_files.within(RESULTS / GPU):
        one = loaded(path)
        build = one["context"]["voxspring"]
        repetitions = collections.Counter(row["name"] for row in one["benchmarks"] if row["run_type"] == "iteration")
        of_rows = [row.get("noisy") for row in medians_of(one)]
        strangers = sum(any("other processes" in reason for reason in noisy or []) for noisy in of_rows)
        lines.append([f"`{result_files.study_of(path)}`", build["commit"][:8] + " (not clean)" * (not build["clean"]),
                      one["context"]["date"][:10],
                      ", ".join(chr(ord("A") + cards.setdefault(uuid, len(cards))) for uuid in cards_of(one)) or "-",
                      " to ".join(map(str, sorted({min(repetitions.values()), max(repetitions.values())}))) if repetitions
                      else "-",
                      f"{sum(map(bool, of_rows))} of {len(of_rows)} ({strangers})" if of_rows else "-"])
    return table(["file", "commit", "day", "card", "repetitions", "marked `~` (other processes on the card)"], lines)



TABLES = {"fastest": fastest, "targets": targets, "limits": lambda: limits("table1"), "table1": lambda: steps("table1"),
          "starts": starts, "figure7": lambda: steps("figure7"), "figure8": scaling, "edits": edits, "tuning": tuning,
          "formulations": formulations, "stress": stress, "stability": stability, "resting": resting, "energy": energy, "files": files,
          "addressing": addressing.table_of_datasets}
