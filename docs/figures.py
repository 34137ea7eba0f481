#!/usr/bin/env python3
"""Fills the tables of README.md, accuracy.md, apis.md and simulator.md from committed results, and the picture in docs/architecture.md from the sources' includes.

Usage: figures.py [--check]

A figure stands between `<!-- NAME -->` and `<!-- /NAME -->`. --check changes nothing and exits with 1 if a page is not what the
result or the sources say.
"""

import json
import pathlib
import re
import statistics
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT / "results"), str(ROOT / "tests")]

import includes_test  # noqa: E402  # pylint: disable=wrong-import-position
from readme import facts, rows as results  # noqa: E402  # pylint: disable=wrong-import-position
from result_files import distinct, groups  # noqa: E402  # pylint: disable=wrong-import-position

# The strategies of the table, one or two of each kind.
SHOWN = ["cuda_resident", "cuda_explicit_delta", "cuda_explicit_cached_grid", "cuda_implicit_cached", "gl_compute_implicit",
         "vulkan_implicit", "gl_fragment_implicit", "cpu_parallel"]

# Who steps while a body is drawn, where that is not the name of its API.
DRAWN = {"CUDA": "CUDA, one launch per tick", "CPU": "the processor"}


def origin(result, before="", after=""):
    """What a table was measured on, below it."""
    context = result["context"]["voxspring"]
    return f"\n\n{before}{context['gpu'] or context['cpu']}{after}; commit {context['commit'][:8]}"


def plain_rows(backends):
    """The rows of the study fastest, in float32 by `position`, of some backends."""
    return [row for row in results.medians("fastest")
            if (row["formulation"], row["precision"]) == ("position", "float32") and row["backend"] in backends]


def heart():
    """The best row of each shown backend on the heart, and the number of tunings that were tried."""
    found = results.result("fastest")
    tried = groups((row for row in plain_rows(SHOWN) if row["scene"] == "heart"), "backend")
    rows = sorted(map(results.fastest_of, tried.values()), key=lambda row: row["real_time"])
    lines = [[f"`{row['backend']}`", results.time_of(row), f"{row['real_time'] / rows[0]['real_time']:.2f}",
              results.giga(row["particle_updates_per_second"]), results.percent(row["fraction_of_limit"]),
              f"{row['error_max']:.1e}", str(len(tried[row["backend"],]))] for row in rows]
    about = (f"{rows[0]['particles']:,} particles, {rows[0]['formulation']} in {rows[0]['precision']}, {rows[0]['error_steps']} steps, on ")
    return (results.table(["backend", "us per step", "x fastest", "G particles/s", "% of roofline", "error", "best of"], lines) +
            origin(found, about, f" and {found['context']['voxspring']['cpu']}") + ".")


def architecture():
    """The rooms as a Mermaid graph. An arrow is an include; one that a path of others implies is left out."""
    arrows = {}
    for source, included in includes_test.includes_of(ROOT):
        here, there = includes_test.room_of(source), includes_test.room_of(included)
        if here and there and here != there:
            arrows.setdefault(here, set()).add(there)

    def reached(room):
        return {room}.union(*(reached(lower) for lower in arrows.get(room, ())))

    lines = ["```mermaid", "flowchart TD"]
    rooms = [room for level in reversed(includes_test.ROOMS) for room in level]
    for top in dict.fromkeys(room.split("/")[0] for room in rooms):
        lines.append(f"    subgraph {top}")
        lines += [f'        {room.replace("/", "_")}_["{room}"]' for room in rooms if room.split("/")[0] == top]
        lines.append("    end")
    for room in rooms:
        for lower in sorted(arrows.get(room, ())):
            if not any(lower in reached(other) for other in arrows[room] - {lower}):
                lines.append(f"    {room.replace('/', '_')}_ --> {lower.replace('/', '_')}_")
    return "\n".join(lines + ["```"])


def gates():
    """What tests/gate_test.cpp recorded of honest runs and of wrong ones."""
    rows = json.loads((HERE / "gates.json").read_text())
    lines = []
    for row in rows:
        name, least = min(row["wrong_in_gates"].items(), key=lambda item: item[1])
        lines.append([row["scene"], f"{row['steps']:,}", f"`{row['formulation']}`", f"{row['spread_share']:.1e}",
                      f"{row['gate_share']:.1e}", f"{row['honest_in_spreads']:.2f}", f"{least:.3g} ({name})"])
    return results.table(["scene", "steps", "formulation", "spread / motion", "threshold / motion", "honest error / spread",
                        "least wrong error / threshold"], lines)


# The backend of each machine whose float64 is compared with its float32.
PRECISE = {results.CPU: "cpu_parallel", results.GPU: "cuda_implicit_cached"}


def float64():
    """What float64 costs on a processor and on a card."""
    lines, origins = [], []
    for machine, backend in PRECISE.items():
        origins.append(origin(results.result("pareto", machine)).strip().replace("; ", ": "))
        for scene, ratios in facts.float64_ratios(machine, backend).items():
            lines.append([f"`{backend}`, {scene}", *(f"{of(ratios):.2f}" for of in (min, statistics.median, max)), str(len(ratios))])
    return results.table(["float64 over float32", "least", "median", "most", "pairs of runs"], lines) + f"\n\n{'; '.join(origins)}."


# What apis.md compares: a step of implicit addressing in each API, and CUDA's resident kernel.
APIS = {"cuda_implicit_cached": "CUDA", "vulkan_implicit": "Vulkan", "gl_compute_implicit": "OpenGL, compute",
        "gl_fragment_implicit": "OpenGL, fragments", "cuda_resident": "CUDA, resident"}


def seconds_text(seconds):
    return f"{results.three_digits(seconds * 1e6)} us" if seconds >= 1e-7 else f"{results.three_digits(seconds * 1e9)} ns"


def launches():
    """Each API's time of a step and of the host's calls, one by one and at once, by size."""
    found = results.result("overhead")
    context = found["context"]["voxspring"]
    rows = {(row["backend"], row["scene"], row["handed_over"]): row for row in found["overhead"]}
    lines = [[api, f"{rows[backend, scene, 'at once']['particles']:,}",
              *(seconds_text(rows[backend, scene, way][key]) for way in ("one by one", "at once")
                for key in ("seconds_per_step", "host_seconds_per_step"))]
             for backend, api in APIS.items() for scene in distinct(found["overhead"], "scene")]
    return (results.table(["API", "particles", "one by one: device", "host", "at once: device", "host"], lines) +
            origin(found, after=f", driver {context['driver']}, {context['cpu']}") + ".")


def empty_steps():
    """DeviceLimits::launch_seconds of each API."""
    limits = results.result("fastest")["context"]["voxspring"]["limits"]
    names = {"CUDA": "CUDA", "Vulkan": "Vulkan", "OpenGL compute": "OpenGL, compute", "OpenGL": "OpenGL, fragments"}
    return results.table(list(names.values()), [[seconds_text(limits[name]["launch_seconds"]) for name in names]])


def sizes():
    """The fastest row of each API's implicit strategies by scene, `position` in float32."""
    others = [backend for backend in APIS if backend not in ("cuda_implicit_cached", "cuda_resident")]
    lines = []
    for (scene, particles), group in sorted(groups(plain_rows(APIS), "scene", "particles").items(), key=lambda item: item[0][1]):
        rows = {backend: results.fastest_of(own) for (backend,), own in groups(group, "backend").items()}
        cuda = rows.get("cuda_implicit_cached")
        if cuda and len(rows) > 1:
            cells = [f"{results.time_of(rows[backend])} ({rows[backend]['real_time'] / cuda['real_time']:.2f})" if backend in rows else "-"
                     for backend in others]
            lines.append([scene, f"{particles:,}", results.time_of(cuda), *cells])
    return (results.table(["scene", "particles", "CUDA", *map(APIS.get, others)], lines) +
            origin(results.result("fastest")) + "; of CUDA and OpenGL the faster of what was tried of each strategy.")


def tick_rows(rows):
    """Lines for the rows of a study haptic without edits, by scene and rate; each says what drawing the body costs, if that was measured."""
    plain = [row for row in rows if not row["edited"]]
    key = ("scene", "hertz", "name")
    drawn = {tuple(row[k] for k in key): row for row in plain if row.get("drawn")}
    lines = []
    for row in sorted((row for row in plain if not row.get("drawn")), key=lambda row: (row["scene"], row["hertz"], row["median_seconds"])):
        beside = drawn.get(tuple(row[k] for k in key))
        costs = f"{100 * (1 - beside['steps_that_fit'] / row['steps_that_fit']):.0f} %" if beside and row["steps_that_fit"] else "-"
        times = [seconds_text(row[f"{name}_seconds"]) for name in ("median", "p99", "p999", "worst")]
        lines.append([row["scene"], results.contender(row), f"{row['hertz'] / 1000:g}", *times, f"{row['missed']:,} of {row['missed'] + row['ticks']:,}",
                      str(row["steps_that_fit"]), costs, f"{row['force_error']:.0e}" if row["force_error"] is not None else "-"])
    return lines


def late_ticks():
    """For motions of many ticks: how many late ones the pauses of the host's thread explain."""
    header = ["scene", "backend", "ticks", "median", "99.9 %", "pauses of 10 us per second (ticks that meet one)", "of 20 us", "missed",
              "pauses of a whole tick, between ticks"]
    def lines_of(found):
        lines = []
        for row in found["haptic"]:
            if row.get("waited_seconds", 0) < 10:
                continue
            period = 1 / row["hertz"]
            often = {least: sum(count for begin, count in row["pauses"] if begin > 0.99 * least) / row["waited_seconds"]
                     for least in (1e-5, 2e-5, period)}
            met = [f"{often[least]:.0f} ({100 * often[least] * row['median_seconds']:.2f} %)" for least in (1e-5, 2e-5)]
            lines.append([row["scene"], results.contender(row), f"{row['missed'] + row['ticks']:,}", seconds_text(row["median_seconds"]),
                          seconds_text(row["p999_seconds"]), *met, f"{row['missed']:,}", f"{often[period] * row['waited_seconds']:.0f}"])
        return lines
    return results.by_machine("haptic", header, lines_of, lambda found, text: text + origin(found) + ".") or "No committed result has it yet."


def drawing():
    """What drawing costs, by where displacements come from, for rows in which enough steps fit to tell a few percent."""
    finest = 60
    found = results.result("haptic")
    plain = {(row["scene"], row["name"], row["hertz"]): row["steps_that_fit"] for row in found["haptic"]
             if not row["drawn"] and not row["edited"]}
    drawn = [row | {"lost": 1 - row["steps_that_fit"] / fit,
                    "who": "CUDA, one launch for all ticks" if "ticks=resident" in row["tuning"] else results.about_backend(found, row)["family"]}
             for row in found["haptic"] if row["drawn"] and not row["edited"]
             and (fit := plain.get((row["scene"], row["name"], row["hertz"]))) and fit >= finest]
    def median(rows, key):
        return statistics.median(row[key] for row in rows)
    lines = []
    for (name, way), rows in sorted(groups(drawn, "who", "displacements_by").items(), key=lambda item: median(item[1], "lost")):
        lost, rate = sorted(row["lost"] for row in rows), median(rows, "pictures_per_second")
        lines.append([DRAWN.get(name, name), f"`{way}()`", str(len(rows)),
                      *(f"{seconds_text(seconds)} ({100 * seconds * rate:.1f} %)"
                        for seconds in (median(rows, "hand_over_seconds"), median(rows, "picture_seconds"))),
                      f"{100 * statistics.median(lost):.1f} %", f"{100 * lost[0]:.1f} to {100 * lost[-1]:.1f} %"])
    header = ["steps by", "displacements by", "rows", "hand-over (of a second)", "picture (of a second)", "fewer steps, median", "from, to"]
    return results.table(header, lines) + origin(found) + f"; rows without edits in which {finest} steps fit."


def ticks():
    """When the force comes back, on every machine that has the study haptic."""
    header = ["scene", "backend", "kHz", "median", "99 %", "99.9 %", "worst", "missed", "steps fit", "of them for drawing", "force error"]
    def titled(found, text):
        real_time = {row["real_time"] for row in found["haptic"]}
        thread = "real-time" if real_time == {True} else "not real-time" if real_time == {False} else "real-time in a part of the rows"
        return text + origin(found, after=f"; the host's thread was {thread}") + "."
    return (results.by_machine("haptic", header, lambda found: tick_rows(found["haptic"]), titled)
            or "No committed result has it yet.")


PAGES = {ROOT / "README.md": {"heart": heart}, HERE / "architecture.md": {"architecture": architecture},
         HERE / "accuracy.md": {"float64": float64, "gates": gates},
         HERE / "apis.md": {"launches": launches, "empty_steps": empty_steps, "sizes": sizes},
         HERE / "simulator.md": {"ticks": ticks, "late_ticks": late_ticks, "drawing": drawing}}


def main():
    stale = []
    for path, figures in PAGES.items():
        page = path.read_text()
        for name, make in figures.items():
            block = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
            if not block.search(page):
                sys.exit(f"{path.name} has no place for {name}")
            page = block.sub(lambda match, text=make(): f"{match[1]}\n{text}\n\n{match[2]}", page)
        if page != path.read_text():
            stale.append(path)
            if "--check" not in sys.argv[1:]:
                path.write_text(page)
    if stale and "--check" in sys.argv[1:]:
        sys.exit("\n".join(f"{path.relative_to(ROOT)} is not what results and sources say: run docs/figures.py" for path in stale))


if __name__ == "__main__":
    main()
