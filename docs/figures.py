#!/usr/bin/env python3
"""Fills the tables of README.md and of pages in docs/ (PAGES below) from committed results by tables.jinja, and the picture in
docs/architecture.md from the sources' includes.

Usage: figures.py [--check]

A table or picture stands between `<!-- NAME -->` and `<!-- /NAME -->`. --check changes nothing and exits with 1 if a page is not
what results and sources say.
"""

import functools
import json
import pathlib
import re
import statistics
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT / "results"), str(ROOT / "tests")]

import comparison  # noqa: E402  # pylint: disable=wrong-import-position
import includes_test  # noqa: E402  # pylint: disable=wrong-import-position
import paper  # noqa: E402  # pylint: disable=wrong-import-position
from readme import facts, rows as results  # noqa: E402  # pylint: disable=wrong-import-position
import result_files  # noqa: E402  # pylint: disable=wrong-import-position
from result_files import distinct, groups, listed, threshold_of, tick_seconds  # noqa: E402  # pylint: disable=wrong-import-position

# Names of APIs in the table of what drawing costs. Other APIs keep their names.
DRAWN = {"CUDA": "CUDA, one launch per tick", "CPU": "the processor"}


def plain_rows(machine=results.GPU):
    """The rows of the study fastest in float32 and the formulation position."""
    return [row for row in results.medians("fastest", machine) if (row["formulation"], row["precision"]) == ("position", "float32")]


def on_heart(machine=results.GPU):
    """A list for each backend of its rows on the heart."""
    return list(groups((row for row in plain_rows(machine) if row["scene"] == "heart"), "backend").values())


def best_on_heart():
    """[(best row, number of tunings)] of the backends on the heart, the fastest first."""
    return sorted(((results.fastest_of(own), len(own)) for own in on_heart()), key=lambda best: best[0]["real_time"])


def left_out():
    """A sentence on the backends that the study table1 has on the heart and the study fastest leaves out; empty if there is none."""
    measured = distinct((row for row in results.medians("table1") if row["scene"] == "heart"), "backend")
    shown = {row["backend"] for row, _ in best_on_heart()}
    absent = [f"`{name}`" for name in measured if name not in shown]
    return f"The study leaves out {listed(absent)}, which [Table 1](results/README.md#table-1) has. " if absent else ""


def architecture():
    """The rooms (folders of sources, includes_test.ROOMS) as a Mermaid graph. An arrow is an include; arrows that others imply are
    left out."""
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


# What apis.md compares: a step of implicit addressing in each API, and CUDA's resident kernel.
APIS = {"cuda_implicit_cached": "CUDA", "vulkan_implicit": "Vulkan", "gl_compute_implicit": "OpenGL, compute",
        "gl_fragment_implicit": "OpenGL, fragments", "cuda_resident": "CUDA, resident"}


def seconds_text(seconds):
    return f"{results.three_digits(seconds * 1e6)} us" if seconds >= 1e-7 else f"{results.three_digits(seconds * 1e9)} ns"


def tick_text(row, name):
    """A time of a row of the study haptic, or a dash."""
    seconds = tick_seconds(row, name)
    return "-" if seconds is None else seconds_text(seconds)


def from_due(rows):
    """Whether the times of rows of the study haptic begin when a tick was due. In older files they begin when the tick began."""
    return all(row.get("from_due") for row in rows)


def handed_over(rows, backend):
    """Two rows of a backend: with steps handed over one by one, and with steps handed over at once."""
    return [next(row for row in rows if (row["backend"], row["handed_over"]) == (backend, way)) for way in ("one by one", "at once")]


def fastest_by_size():
    """Yields (scene, particles, CUDA's row, {backend: row}) by size, for scenes on which several backends of APIS were measured."""
    of_apis = [row for row in plain_rows() if row["backend"] in APIS]
    for (scene, particles, _), group in sorted(groups(of_apis, "scene", "particles", "steps").items(), key=lambda item: item[0][1]):
        best = {backend: results.fastest_of(own) for (backend,), own in groups(group, "backend").items()}
        if len(best) > 1 and "cuda_implicit_cached" in best:
            yield scene, particles, best["cuda_implicit_cached"], best


def undrawn_rows(rows):
    """[(row, row of the same case while the body is drawn, share of the steps that drawing costs)] of the cases without edits of
    the study haptic, by scene and rate. The last two are None if they were not measured."""
    plain = groups((row for row in rows if not row["edited"]), "scene", "hertz", "name").values()
    pairs = [{bool(row.get("drawn")): row for row in own} for own in plain]
    found = [(pair[False], pair.get(True)) for pair in pairs if False in pair]
    return [(row, drawn, 1 - drawn["steps_that_fit"] / row["steps_that_fit"] if drawn and row["steps_that_fit"] else None)
            for row, drawn in sorted(found, key=lambda pair: [pair[0][key] for key in ("scene", "hertz", "median_seconds")])]


def pauses(row, least):
    """The number of pauses per second that last at least `least` seconds."""
    return sum(count for begin, count in row["pauses"] if begin > 0.99 * least) / row["waited_seconds"]


# A loss of a few percent of steps shows only if at least this many steps fit into a tick.
FINEST = 60


def drawn_rows():
    """[((who steps, the call that gives displacements), shares of steps lost, pictures per second, rows)], the least loss first."""
    def who(row):
        api = results.about_backend(results.result("haptic"), row)["family"]
        return "CUDA, one launch for all ticks" if "ticks=resident" in row["tuning"] else DRAWN.get(api, api)

    drawn = [row | {"lost": lost, "who": who(row)} for plain, row, lost in undrawn_rows(results.result("haptic")["haptic"])
             if row and plain["steps_that_fit"] >= FINEST]
    found = [(key, sorted(row["lost"] for row in own), statistics.median(row["pictures_per_second"] for row in own), own)
             for key, own in groups(drawn, "who", "displacements_by").items()]
    return sorted(found, key=lambda one: statistics.median(one[1]))


def claimed(machine):
    """Yields (fastest row, number of tunings, [the case's time in another study over the row's]) for each backend on the heart."""
    tried = on_heart(machine)
    names = [{results.name_of(row): row["real_time"] for row in results.medians_of(one)
              if (row["scene"], row["steps"]) == ("heart", tried[0][0]["steps"])}
             for study, one in results.studies(machine).items() if study != "fastest"]
    for own in tried:
        row = min(own, key=lambda one: one["real_time"])
        yield row, len(own), [of[results.name_of(row)] / row["real_time"] for of in names if results.name_of(row) in of]


def durations(machine):
    """Yields (study, number of rows, minutes that it took or None) in the order of measurement. Older files do not say the
    minutes."""
    for study, one in sorted(results.studies(machine).items(), key=lambda one: one[1]["context"]["date"]):
        seconds = one["context"]["voxspring"].get("elapsed_seconds")
        rows = len(one["verification"]) or sum(len(one.get(name, [])) for name in comparison.PLACES)
        yield study, rows, seconds / 60 if seconds else None


def machines_with_cards():
    """The machines with a graphics card whose results are committed, the page's own first."""
    found = {path.parent.name for path in result_files.committed(results.RESULTS) if results.loaded(path)["context"]["voxspring"].get("gpu")}
    return sorted(found, key=lambda name: (name != results.GPU, name))


def names_of_commits(machine):
    """The card of a machine, its driver and the commits of its results, in words. If there are several commits, each is followed by
    its studies."""
    contexts = {study: one["context"]["voxspring"] for study, one in results.studies(machine).items()}
    commits = groups(contexts, lambda study: contexts[study]["commit"][:8])
    parts = [f"commit {commit}" + f" ({', '.join(own)})" * (len(commits) > 1) for (commit,), own in commits.items()]
    about = next(iter(contexts.values()))
    return f"{about['gpu']}, driver {about['driver']}; {'; '.join(parts)}"


def cards_of(one):
    """(ways of exchange, lines) for the table of several cards, from a result of the study scaling. There is a line for each body,
    strategy and cut: (row of one rank, cut, {way: row of the most ranks})."""
    ways = [way for way in distinct(one["scaling"], "way") if way != "none"]
    lines = []
    for own in groups(one["scaling"], "family", "backend", "tuning").values():
        alone = next((row for row in own if row["ranks"] == 1), None)
        most = max(row["ranks"] for row in own)
        lines += [(alone, cut, {row["way"]: row for row in of_cut})
                  for (cut,), of_cut in groups((row for row in own if row["ranks"] == most > 1), "cut").items() if alone]
    return ways, lines


def peers_by_size(one):
    """The table of a result of `voxspring study peers`: {scene: Voxspring's fastest row} by size; [(system, {scene: row})] by time
    on the first scene; {(backend, reason): rows} of backends that were skipped or failed."""
    def system_of(row):
        own = f"Voxspring, `{row['formulation']}`"
        return one["context"]["voxspring"]["backends"][row["backend"]]["api"] if row.get("lines_of_code") else own

    rows = {(row["scene"], system_of(row)): row for row in results.medians_of(one)}
    rows = sorted(rows.values(), key=lambda row: row["particles"])
    own = groups((row for row in rows if not row.get("lines_of_code")), "scene")
    scenes = {scene: min(of_scene, key=lambda row: row["real_time"]) for (scene,), of_scene in own.items()}
    systems = [(system, {row["scene"]: row for row in of_system}) for (system,), of_system in groups(rows, system_of).items()]
    order = distinct(rows, "scene")
    systems.sort(key=lambda line: min((order.index(scene), row["real_time"]) for scene, row in line[1].items()))
    absent = [row for row in one["skipped"] + one["failed"] if row["backend"] not in distinct(rows, "backend")]
    return scenes, systems, groups(absent, "backend", "reason")


def large_result():
    """docs/box1024.json.gz, a result of the study that docs/scaling.md shows."""
    return results.loaded(HERE / "box1024.json.gz")


def truth_result():
    """docs/truth.json.gz, a result of `voxspring study truth`."""
    return results.loaded(HERE / "truth.json.gz")


def truths():
    """Yields (case, where the particles are, strain, rows by pitch) from the rows of cpu_explicit in float64 of truth_result()."""
    rows = [row for row in truth_result()["truth"] if (row["backend"], row["precision"]) == ("cpu_explicit", "float64")]
    for (case, place, strain), own in groups(rows, "scene", "particles_at", "strain").items():
        yield case, place, strain, sorted(own, key=lambda row: row["across"])


def truth_agreement():
    """[(precision, number of other backends, the largest difference of a deflection from cpu_explicit in float64)]."""
    others = [row for row in truth_result()["truth"] if row["backend"] != "cpu_explicit"]
    return [(precision, len(distinct(own, "backend")), max(row["rounding_error"] for row in own))
            for (precision,), own in groups(others, "precision").items()]


def continuum_errors():
    """[(the largest error of the finite elements in words, the cases with that error)] of truth_result(), the least error first."""
    errors = sorted((max(row["continuum_error"] for row in own), case) for (case,), own in groups(truth_result()["truth"], "scene").items())
    return [(text, [case for _, case in own]) for (text,), own in groups(errors, lambda one: f"{100 * one[0]:.1g} %").items()]


@functools.cache
def tables():
    """The macros of docs/tables.jinja, which may call the functions of this file."""
    paper.ENVIRONMENT.filters["api_of"] = APIS.get
    names = vars(results) | facts.NAMES | globals() | {
        "median": lambda values: statistics.median(list(values)), "recorded_gates": json.loads((HERE / "gates.json").read_text())}
    return paper.ENVIRONMENT.get_template("docs/tables.jinja", globals=names).module


def filled(name):
    return architecture() if name == "architecture" else str(getattr(tables(), name)()).strip()


PAGES = {ROOT / "README.md": ["heart"], HERE / "architecture.md": ["architecture"], HERE / "accuracy.md": ["float64", "truth", "gates"],
         HERE / "artifact.md": ["claims", "studies"], HERE / "apis.md": ["launches", "empty_steps", "sizes"],
         HERE / "scaling.md": ["cards", "large"], HERE / "cuda-trials.md": ["slots"],
         HERE / "simulator.md": ["ticks", "late_ticks", "drawing"], HERE / "python.md": ["peers"]}


def main():
    check, stale = results.is_check(__doc__), []
    for path, names in PAGES.items():
        page = path.read_text()
        for name in names:
            block = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
            if not block.search(page):
                sys.exit(f"{path.name} has no line <!-- {name} --> for its table")
            page = block.sub(lambda match, text=filled(name): f"{match[1]}\n{text}\n\n{match[2]}", page)
        if page != path.read_text():
            stale.append(path)
            if not check:
                path.write_text(page)
    if stale and check:
        sys.exit("\n".join(f"{path.relative_to(ROOT)} is not what results and sources say: run docs/figures.py" for path in stale))


if __name__ == "__main__":
    main()
