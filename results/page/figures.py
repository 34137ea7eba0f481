"""Makes the rows of each figure of the page, and its findings in words. figures.vegalite describes the table and the charts of
each.

A figure has a panel for each machine, or for each combination of machine, scene and other keys. A panel's chart takes those rows of
its figure that match the panel, as the data set `rows`. The filters of the page hide some of them by two parameters of the chart:
`shown`, a list of backends, and `scene`, a name or empty.
"""

import collections
import functools
import math
import statistics
from dataclasses import dataclass

import comparison
import result_files
from result_files import distinct, groups, listed

from . import charts, reading
from .charts import ABOUT

# Keeps a number and its unit on one line.
SPACE = "\N{NO-BREAK SPACE}"
# Metrics of a result that need no further column, since figures.vegalite has columns for them in other units.
IN_COLUMNS = {"sustained_seconds_per_step", "limit_sum_seconds"}
TARGETS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
# The largest number of names in a headline.
FEW = 3


# --- Words -------------------------------------------------------------------------------------------------

def engineering(value, unit):
    """A value with its unit and its prefix: "1.23 M springs/s" for 1234567 and "springs/s"."""
    for factor, prefix in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:.3g}{SPACE}{prefix} {unit}"
    return f"{value:.3g} {unit}"


def time_text(microseconds):
    factor, unit = next((one for one in ((1e6, "s"), (1e3, "ms"), (1, "µs")) if microseconds >= one[0]), (1e-3, "ns"))
    return f"{microseconds / factor:.3g}{SPACE}{unit}"


def rate_text(hertz):
    return f"{hertz / 1e3:.3g}{SPACE}kHz" if hertz >= 1e3 else f"{hertz:.3g}{SPACE}Hz"


def error_text(error):
    """An error as text: "2.4e-6", and "1e-5" rather than "1.0e-05"."""
    mantissa, exponent = f"{error:.1e}".split("e")
    return f"{mantissa.removesuffix('.0')}e{int(exponent)}" if error else "0"


def percent(fraction):
    return f"{100 * fraction:{'.2g' if abs(fraction) < 0.995 else '.0f'}}{SPACE}%"


def counted(count, noun):
    return f"{count} {noun}{'s' * (count != 1)}"


def between(values, text):
    """The range of some values as text, or one value if both ends read the same."""
    return " to ".join(dict.fromkeys(text(value) for value in (min(values), max(values))))


def sentence(text):
    """The text with a capital letter first, unless it begins with the name of a backend."""
    return text if "_" in text.split(" ")[0] else text[:1].upper() + text[1:]


# --- Who is the fastest ------------------------------------------------------------------------------------

def fastest(rows):
    return min(rows, key=lambda row: row["microseconds"], default=None)


def each_at_its_best(rows, *keys):
    return [fastest(own) for own in groups(rows, *keys, "backend").values()]


def as_fast(best, group):
    """The best rows of those backends that repetitions cannot tell from the fastest one, `best`; sorted by time."""
    others = [row for row in each_at_its_best(group) if row["backend"] != best["backend"]]
    return sorted((row for row in others if not comparison.is_clearly_slower(
        best["repetition_times"], row["repetition_times"], bool(best["noisy"] or row["noisy"]))),
        key=lambda row: row["microseconds"])


@dataclass
class Outcome:
    """What was measured on a dataset of a machine."""

    best: dict
    group: list  # every strategy that was measured there
    equals: list  # the best rows of those backends that repetitions do not tell from the fastest one
    absent: list  # backends that are the fastest on a smaller and on a larger dataset, but were not tried on this one

    @property
    def won(self):
        return not self.equals and not self.absent


def outcomes(results, rows):
    """The outcomes of each machine's datasets, small datasets first; the machine with most datasets comes first."""
    tried = {(result.machine, row["scene"], row["backend"]) for result in results
             for name in ("skipped", "failed") for row in result.lists[name]}
    found = {}
    rows = reading.strategies([row for row in rows if not row["edits"]])
    tried |= {(row["machine"], row["scene"], row["backend"]) for row in rows}
    for (machine, _), group in groups(rows, "machine", "scene").items():
        best = fastest(group)
        found.setdefault(machine, []).append(Outcome(best, group, as_fast(best, group), []))
    for machine, entries in found.items():
        entries.sort(key=lambda entry: (entry.best["particles"], reading.natural(entry.best["scene"])))
        for place, entry in enumerate(entries):
            winners = [{other.best["backend"] for other in side if not other.equals} for side in (entries[:place], entries[place + 1:])]
            entry.absent = [name for name in sorted(set.intersection(*winners)) if (machine, entry.best["scene"], name) not in tried]
    return dict(sorted(found.items(), key=lambda item: -len(item[1])))


def ladder(entries):
    """Which backend is the fastest in which range of sizes: (dataset, [(backends, whether the state stays on the
    chip, (fewest, most particles))]), for the dataset with the most sizes. Neighbouring ranges of backends that
    keep the state on the chip are one range. Sizes at which no backend is clearly the fastest are left out. None
    if a backend has several ranges, or if there are at most FEW sizes, more than FEW ranges or only one range."""
    families = groups((entry.best for entry in entries if entry.won), lambda row: row["scene"].split("@")[0])
    (family,), rows = max(families.items(), key=lambda item: len(item[1]), default=((None,), []))
    steps = []
    for row in rows:
        on_chip = row["operation_rate"] is not None and row["operations_per_byte"] is None
        if steps and (row["backend"] in steps[-1][0] or on_chip and steps[-1][1]):
            steps[-1] = (list(dict.fromkeys([*steps[-1][0], row["backend"]])), on_chip, (steps[-1][2][0], row["particles"]))
        else:
            steps.append(([row["backend"]], on_chip, 2 * (row["particles"],)))
    names = [name for backends, _, _ in steps for name in backends]
    return (family, steps) if len(rows) > FEW and 1 < len(steps) <= FEW and len(set(names)) == len(names) else None


# --- A figure ----------------------------------------------------------------------------------------------

class Page:
    """The results that a page shows, and what several of its figures compute from them."""

    def __init__(self, results):
        self.results, self.measured = results, reading.measured(results)
        families = {row["backend"]: result.family(row["backend"])
                    for result in results for name in (*reading.MEASURED, "failed") for row in result.lists[name]}
        self.families = dict(sorted(families.items(), key=lambda item: item[::-1]))

    def counters(self, rows, known):
        """Columns for the metrics that a result describes and that these rows have, except the names in `known`."""
        found = {name: about["unit"] for result in self.results for name, about in result.counters.items() if name not in known}
        return [(name, name.replace("_", " ") + f" ({unit})" * bool(unit), 4) for name, unit in found.items()
                if any(isinstance(row.get(name), (int, float)) for row in rows)]

    @functools.cached_property
    def outcomes(self):
        return outcomes(self.results, self.measured)

    @functools.cached_property
    def histories(self):
        """{(machine, study): (results by date, *judged(the first, the last))} for each study that several files of a machine
        have."""
        found = groups((result for result in self.results if result.lists["benchmarks"]), lambda one: one.machine, lambda one: one.study)
        found = {key: sorted(files, key=lambda file: file.date) for key, files in found.items() if len(files) > 1}
        return {key: (files, *judged(files[0], files[-1])) for key, files in found.items()}


@dataclass
class Panel:
    heading: str
    match: dict  # what the rows of this panel have in common
    spec: dict
    step: tuple = None  # (key, pixels): the chart's height is `pixels` per value of `key` among the rows shown


class Figure:
    """The rows of a figure's table, its panels and its findings. A backend has one colour in all figures."""

    def __init__(self, name, rows, page, tell, by, below):
        self.name, self.rows, self.page, self.below, self.about = name, rows, page, below, ABOUT["figures"][name]
        self.columns, self.legend = charts.columns(self.about["columns"], self.about.get("named")), self.about.get("legend", "backend")
        self.columns += page.counters(rows, {key for key, *_ in self.columns} | IN_COLUMNS)
        # The results that the caption names: those with a list called `having` or, if no list is called so, of that study.
        having = self.about.get("having", "benchmarks")
        self.results = [one for one in page.results if (one.lists[having] if having in one.lists else one.study == having)]
        groups_told = groups(rows, *by.split(" ")) if by else {(listed(distinct(rows, "machine")),): rows}
        # A finding is (machine, a line, the finding in full or ""), for each group of rows.
        self.findings = [(machine, *tell(self, own)) for (machine, *_), own in groups_told.items()]
        keys = self.about["by"].split(" ")
        self.panels = [self.panel(dict(zip(keys, values)), group) for values, group in groups(rows, *keys).items()]

    @property
    def title(self):
        """One line: what was found on the machine that comes first."""
        return sentence(self.findings[0][1])

    @property
    def detail(self):
        """The findings in full, machine by machine; empty if the title says it all."""
        if len(self.findings) == 1 and not self.findings[0][2]:
            return ""
        # Machines with the same finding are named together.
        told = groups(self.findings, lambda finding: finding[2] or finding[1]).items()
        return sentence("; ".join(f"on {listed(dict.fromkeys(machine for machine, *_ in own))} {text}" for (text,), own in told)) + "."

    def panel(self, match, rows):
        about = self.about | self.about.get(rows[0].get("form"), {})
        heading = about.get("heading", ", ".join(f"{{{key}}}" for key in reversed(match))).format_map(rows[0])
        alternative = f"{heading}: {about['about']}, in {counted(len(rows), 'mark')}."
        below = self.below(rows) if self.below else []
        spec = charts.complete(about, self.page.families, self.columns, rows, below, alternative)
        return Panel(heading, match, spec, about.get("step"))


# For each figure: (function that makes its rows from the Page; function that returns the finding of a group of
# rows; keys by which rows are grouped for that; function that makes layers below the marks, or None). A figure
# without rows is left out.
MADE_BY = {}


def figure_of(name, rows, below=None, by="machine"):
    """Registers how a figure of figures.vegalite is made. The decorated function is called with the rows of each machine, or of
    each combination of the keys `by`; with all rows if `by` is empty. It returns (a line, the finding in full or an empty text)."""
    def register(tell):
        MADE_BY[name] = (rows, tell, by, below)
        return tell
    return register


def labelled(rows):
    """Adds a label to each row: its contender, without the formulation if all rows have the same one."""
    common = len({row["formulation"] for row in rows}) == 1
    words = [row["contender"].split(" ") for row in rows]
    return [{**row, "label": " ".join(own[:1] + own[2:] if common else own)} for row, own in zip(rows, words)]


def latest_of(rows_of, *keys):
    """Returns a function of the Page that makes rows: the latest of rows_of(results) for each combination of the keys, labelled."""
    return lambda page: labelled(reading.latest(rows_of(page.results), "machine", *keys))


def of_study(name):
    return lambda page: labelled(reading.strategies([row for row in page.measured if row["study"] == name]))


def latest_runs(page):
    return reading.latest(reading.pareto(page.results), "machine", "scene", "contender", "fraction")


def as_lines(name, rows_of, line, x, y, *keys):
    """Returns a function of the Page that makes the rows of line charts, with a label at the end of each line. Each combination of
    values of the keys is a chart."""
    return lambda page: [row for own in groups(rows_of(page), "machine", *keys).values()
                         for row in charts.with_end_labels(own, line, x, y, ABOUT["figures"][name]["height"])]


@figure_of("datasets", lambda page: each_at_its_best(reading.strategies([row for row in page.measured if not row["edits"]]),
                                                     "machine", "scene"))
def datasets(figure, rows):
    entries = figure.page.outcomes[rows[0]["machine"]]
    winners = collections.Counter(entry.best["backend"] for entry in entries if entry.won)
    shares = [f"{name} wins {winners[name]}" for name in sorted(winners, key=lambda name: (-winners[name], name))]
    more = listed(shares) or "no backend wins any"
    if untold := sum(bool(entry.equals) for entry in entries):
        more += f"; on {untold} the fastest cannot be told"
    if absent := [entry.best["scene"] for entry in entries if entry.absent and not entry.equals]:
        more += f"; nobody wins {listed(absent)}, where what wins smaller and larger ones was not measured"
    return f"{listed(shares[:FEW]) or 'no backend wins any'} of {len(entries)} datasets", f"of {len(entries)} datasets {more}"


@figure_of("figure7", of_study("figure7"))
def figure7(_, rows):
    leaders, told = {}, []
    for (scene,), group in groups(rows, "scene").items():
        first, last = fastest(group), max(group, key=lambda row: row["microseconds"])
        leaders.setdefault(first["backend"], []).append(scene)
        told.append(f"{first['label']} leads on {scene} with {time_text(first['microseconds'])} per step, "
                    f"{last['microseconds'] / first['microseconds']:.1f} times as fast as {last['label']}")
    return listed(f"{name} leads on {listed(scenes)}" for name, scenes in leaders.items()), "; ".join(told)


@figure_of("figure8", as_lines("figure8", of_study("figure8"), "label", "particles", "microseconds"))
def figure8(_, group):
    sizes = sorted({row["particles"] for row in group})
    small, large = (fastest(row for row in group if row["particles"] == size) for size in (sizes[0], sizes[-1]))
    text = f"{large['label']} leads at {engineering(sizes[-1], 'particles')} with {time_text(large['microseconds'])} per step"
    return (text, f"{text}; the smallest body has 1/{sizes[-1] / sizes[0]:,.0f} of the particles and takes "
            f"1/{large['microseconds'] / small['microseconds']:.0f} of the time, "
            f"{time_text(small['microseconds'])} with {small['label']}")


def fastest_within(rows, target):
    """The row with the least time among those with an error of at most `target`; None if no row has such an error."""
    return min((row for row in rows if row["total"] <= target), key=lambda row: row["seconds"], default=None)


@figure_of("front", latest_runs, by="")
def front(_, runs):
    pairs = [[fastest_within(group, error) for error in (1e-4, 1e-6)] for group in groups(runs, "machine", "scene").values()]
    costs = [fine["seconds"] / coarse["seconds"] for coarse, fine in pairs if coarse and fine]
    on_front = [row["formulation"] for row in runs if row["front"]]
    most = statistics.mode(on_front) if on_front else ""
    title = (f"{most} is most often on a Pareto front, in {percent(on_front.count(most) / len(on_front))} of its runs" if most else
             "no run is on a Pareto front")
    cost = f"an error of 1e-6 takes {between(costs, lambda c: f'{c:.2g}')} times as long as one of 1e-4" if costs else ""
    return cost or title, f"{cost}; {title}" if cost else ""


def step_text(fraction):
    return f"1/{1 / fraction:.3g}"


@figure_of("curves", latest_runs, by="")
def curves(_, runs):
    turns = {}
    in_float32 = [row for row in runs if row["precision"] == "float32"]
    for (_, _, formulation), group in groups(in_float32, "machine", "scene", "formulation").items():
        middle = {fraction: statistics.median(row["total"] for row in rows) for (fraction,), rows in groups(group, "fraction").items()}
        turns.setdefault(formulation, []).append(min(middle, key=middle.get))
    finest = min(row["fraction"] for row in runs)
    known = [name for name in charts.MARKS["formulation"] if name in turns]
    pays = [name for name in known if max(turns[name]) == finest]
    grows = [f"{name} at {' to '.join(dict.fromkeys(step_text(end) for end in (max(turns[name]), min(turns[name]))))}"
             for name in known if name not in pays]
    title = f"in float32 errors are least with {listed(grows)} of the stable step" if grows else ""
    if pays:
        title += ("; " if title else "in float32 ") + f"{listed(pays)} gain{'s' * (len(pays) == 1)} down to {step_text(finest)}"
    line = "finer steps pay off in float32" if pays else "finer steps do not always pay off in float32"
    alone = f" for {listed(pays)} alone," if pays and grows else ""
    return line + alone + (f" down to {step_text(finest)}" if pays else ""), title


def limits_below(rows):
    """Lines at the limit and at ten times the limit. Their names stand below their ends, where no points are."""
    low, high = (end(row["limit_microseconds"] for row in rows) for end in (min, max))
    slowest = max(row["microseconds"] for row in rows)
    layers = []
    for factor, text, dash in ((1, "the limit", [1, 0]), (10, "ten times as long", [4, 4])):
        top = min(high, slowest / factor)
        layers += [charts.line([(end, end * factor) for end in (low, high)], strokeDash=dash, clip=True),
                   charts.name_at(top, top * factor, text, align="right", dx=-6, dy=5, baseline="top")]
    return layers


@figure_of("roofline", lambda page: [row for row in reading.strategies(page.measured) if row["limit_microseconds"] and row["of_limit"]],
           below=limits_below)
def roofline(_, group):
    best = max([row for row in group if row["of_limit"] <= 1] or group, key=lambda row: row["of_limit"])
    middle = statistics.median(row["of_limit"] for row in group)
    bound = [row["limited_by"] for row in group if row["limited_by"]]
    most = statistics.mode(bound) if bound else ""
    binds = f", and {most} binds {bound.count(most)} of the {len(bound)} that reach {percent(result_files.MIN_BINDING)}" if bound else ""
    text = f"{best['backend']} comes closest to its limit, {percent(best['of_limit'])} on {best['scene']}"
    return text, f"{text}; the median row reaches {percent(middle)} of its limit{binds}"


# The datasets with a panel: one that fits into a card's cache, and one far beyond it. If neither was measured,
# the smallest and the largest dataset have one.
INTENSITY_SCENES = ("box@32", "box@256")
ROOF_DASHES = {"memory": [1, 0], "memory, half written": [4, 4], "cache": [1, 3]}
# Strategies that move no bytes have no number of operations per byte. Their marks stand right of the roofs, at this multiple of the
# roofs' right end.
ON_CHIP = 1.9


def intensities(page):
    """The rows in float32 that have a rate of operations, with the roofs of their chart, the roofs' right end (`edge`) and the
    range of the axis (`domain`)."""
    rows = [row for row in reading.strategies(page.measured) if row["precision"] == "float32" and row["operation_rate"]]
    rows.sort(key=lambda row: row["particles"])
    scenes = set(INTENSITY_SCENES) & set(distinct(rows, "scene")) or {row["scene"] for row in rows[:1] + rows[-1:]}
    rows = sorted((row for row in rows if row["scene"] in scenes), key=lambda row: reading.natural(row["scene"]))
    found = []
    for (machine, _), group in groups(rows, "machine", "scene").items():
        roofs = reading.rooflines([result for result in page.results if result.machine == machine], group)
        known = [row["operations_per_byte"] for row in group if row["operations_per_byte"]] or [1.0]
        # The axis spans all rows and all bends of the roofs.
        known += [operations / rate for bandwidths, operations in roofs.values() for rate in bandwidths.values()]
        edge = 2 * max(known)
        end = edge if all(row["operations_per_byte"] for row in group) else edge * ON_CHIP**1.5
        found += [row | {"place": row["operations_per_byte"] or edge * ON_CHIP, "roofs": roofs, "edge": edge, "domain": [min(known) / 2, end]}
                  for row in group]
    return found


def roofs_below(rows):
    """The roofs with their names and, right of them, a strip for strategies whose state stays on the chip. The axis has no meaning
    there."""
    edge, (start, end) = rows[0]["edge"], rows[0]["domain"]
    layers = []
    if end > edge:
        strip = {"data": {"values": [{"x": edge * ON_CHIP**0.5, "x2": end}]}, "mark": {"type": "rect", "color": "var(--raised)"},
                 "encoding": {"x": {"field": "x", "type": "quantitative"}, "x2": {"field": "x2"}}}
        on_chip = charts.name_at(edge * ON_CHIP, 0, "on chip", baseline="bottom", dy=-4)
        on_chip["encoding"]["y"] = {"value": "height"}
        layers = [strip, on_chip]
    for family, (bandwidths, operations) in rows[0]["roofs"].items():
        at = sorted({start, *(operations / rate for rate in bandwidths.values()), edge})
        for name, rate in bandwidths.items():
            roof = [(x, 1e-9 * min(operations, rate * x)) for x in at]
            layers.append(charts.line(roof, strokeDash=ROOF_DASHES[name]))
            if name in reading.ROOF_LABELS:
                layers.append(charts.name_at(*roof[0], f"{family}: {reading.ROOF_LABELS[name]}", align="left", dx=6, dy=4, baseline="top"))
        layers.append(charts.name_at(at[-1], 1e-9 * operations, f"{family}: float32 arithmetic", align="right", dy=-3, baseline="bottom"))
    return layers


@figure_of("intensity", intensities, below=roofs_below)
def intensity(_, rows):
    told = []
    for (scene,), group in groups(rows, "scene").items():
        best = max(group, key=lambda row: row["operation_rate"])
        where = f"at {best['operations_per_byte']:.2g} operations per byte" if best["operations_per_byte"] else "on the chip"
        told.append((f"{best['backend']} computes most on {scene}, {engineering(best['operation_rate'] * 1e9, 'op/s')}", where))
    return told[-1][0], listed(f"{text} {where}" for text, where in told)


def map_cells(page):
    """A row for each cell (damping and time step) of the latest map of stability of each machine and scene."""
    last = {(result.machine, row["scene"]): (result, row) for result in page.results for row in result.lists["stability_map"]}
    return [{"machine": machine, "scene": scene, "backend": row["backend"], "damping": damping, "fraction": fraction, "region": region,
             "letter": region[0], "file": result.path.name, "date": result.date, "amplitude": row["amplitude"]}
            for (machine, scene), (result, row) in last.items() for damping, line in zip(row["damping"], row["region"])
            for fraction, region in zip(row["fraction"], line)]


@figure_of("map", map_cells, by="machine scene")
def stability_map(_, cells):
    # For each damping: the largest fraction of the limit up to which all cells are bounded.
    reach = {}
    for (damping,), line in groups(cells, "damping").items():
        first = min((cell["fraction"] for cell in line if cell["region"] != "bounded"), default=math.inf)
        reach[damping] = max((cell["fraction"] for cell in line if cell["fraction"] < first), default=0)
    least, most = min(reach), max(reach.values())
    enough = min(damping for damping in reach if reach[damping] == most)
    return (f"damping {enough:g} keeps a random start bounded up to {most:g} of the limit",
            f"a random start of ±{cells[0]['amplitude']:g} spacings stays bounded up to "
            f"{reach[least]:g} of the limit at damping {least:g}, and up to {most:g} at {enough:g}")


def starts(page):
    rows = [row | {"start": f"±{row['start']['amplitude']:g}" if row["start"]["kind"] != "stretched" else "stretched",
                   "held": row.get("tolerance") is not None, "passed": "yes" if row["passed"] else "no"}
            for row in reading.rows_of(page.results, "stability")]
    rows = [row | {"kind": f"{row['start']}, λ = {row['damping']:g}"} for row in rows]
    return reading.latest(rows, "machine", "scene", "contender", "kind")


@figure_of("stability", starts, by="")
def stability(_, rows):
    small = [abs(row["ratio"] - 1) for row in rows if row["held"]]
    lowest = min(rows, key=lambda row: row["ratio"])
    ends = f"a start of {lowest['start']} spacings ends at {lowest['ratio']:.2f} of it"
    line = f"where theory holds, measured limits differ from it by at most {100 * max(small):.2g}{SPACE}%" if small else ""
    return line or ends.replace(" of it", " of the limit of theory"), f"{line}; {ends}" if line else ""


QUANTITIES = {"slower": ("Slow-down", "slower by (%)"), "edit_microseconds": ("Latency of an edit", "an edit by itself (µs)")}


def by_edited_steps(rows):
    """{number of steps of a batch: rows}, the number with the most rows first."""
    return dict(sorted(groups(rows, "steps").items(), key=lambda item: -len(item[1])))


def edited(page):
    """A row for each strategy with edits and each of QUANTITIES. The rows are drawn as lines if there are several counts of
    edits."""
    rows = [{**row, "base": row["without_edits"] * 1e6, "slower": 100 * (row["microseconds"] / (row["without_edits"] * 1e6) - 1)}
            for row in reading.strategies(page.measured) if row["edits"] and row["without_edits"]]
    found = []
    of_steps = [own for of_machine in groups(rows, "machine").values() for own in by_edited_steps(of_machine).values()]
    for group in (group for own in of_steps for group in groups(own, "formulation").values()):
        form = "lines" if len(distinct(group, "edits")) > 1 else "dots"
        for key, (name, title) in QUANTITIES.items():
            own = [{**row, "quantity": key, "quantity_name": name, "quantity_title": title, "form": form, "end_label": None,
                    "label_at": None}
                   for row in labelled(group) if row[key] is not None]
            height = ABOUT["figures"]["edits"]["lines"]["height"]
            found += charts.with_end_labels(own, "label", "edits", key, height) if own and form == "lines" else own
    return found


@figure_of("edits", edited)
def edits(figure, rows):
    figure.results = [result for result in figure.results if any(row.get("edits") for row in result.lists["benchmarks"])]
    told = []
    for (steps,), group in by_edited_steps([row for row in rows if row["quantity"] == "slower"]).items():
        middles = [(count, f"{statistics.median(row['slower'] for row in of_count):.2g}{SPACE}%")
                   for (count,), of_count in sorted(groups(group, "edits").items())]
        several = f"{counted(middles[-1][0], 'edit')} slow {steps} steps down by {middles[-1][1]}"
        told.append((f"{several} in the median of {len(distinct(group, 'contender'))} strategies",
                     f"{steps} steps by " + ", ".join(f"{text} ({counted(count, 'edit')})" for count, text in middles)))
    return told[0][0], "edits slow, in the median of all strategies, " + listed(text for _, text in told)


@figure_of("overhead", latest_of(lambda results: [
    row | {"host": row["host_seconds_per_step"] * 1e6, "size": engineering(row["particles"], "particles")}
    for row in reading.rows_of(results, "overhead")], "scene", "contender", "handed_over"))
def overhead(_, group):
    least = min(row["particles"] for row in group)
    small = [fastest(row for row in group if row["particles"] == least and row["handed_over"] == how)
             for how in charts.MARKS["handed_over"]]
    told = [(time_text(row["microseconds"]), row["handed_over"], row["label"]) for row in small if row]
    line = f"a step of {least} particles takes at least "
    return (line + listed(f"{time} {how}" for time, how, _ in told),
            line + listed(f"{time} with {label} where steps are handed over {how}" for time, how, label in told))


@figure_of("energy", latest_of(lambda results: [row | {"millijoules": row["joules_per_step"] * 1e3}
                                               for row in reading.rows_of(results, "energy")], "scene", "contender"))
def energy(_, group):
    told = []
    for (scene,), of_scene in sorted(groups(group, "scene").items(), key=lambda item: item[1][0]["particles"]):
        least = min(of_scene, key=lambda row: row["millijoules"])
        told.append(f"a step of {scene} takes {least['millijoules']:.3g}{SPACE}mJ with {least['label']}"
                    + f", the least of {len(of_scene)} strategies" * (len(of_scene) > 1))
    return told[-1], "; ".join(told) if len(told) > 1 else ""


def ranks_measured(page):
    rows = latest_of(reading.scaling, "compared", "contender", "ranks", "cut", "way")(page)
    return rows if any(row["ranks"] > 1 for row in rows) else []


@figure_of("scaling", ranks_measured)
def scaling(_, group):
    several = [row for row in group if row["ranks"] > 1]
    told = [row for row in several if not row["noisy"]] or several or group
    most = max(row["ranks"] for row in told)
    reached = [row["efficiency"] for row in told if row["ranks"] == most]
    return f"{most} ranks have {between(reached, percent)} of the efficiency of one", ""


@figure_of("forecast", latest_of(reading.scaling_forecast, "compared", "contender", "parts", "way", "ranks"))
def scaling_forecast(_, group):
    halves = [row["half"] for row in group if row["half"]]
    most = max(row["ranks"] for row in group)
    reached = [row["efficiency"] for row in group if row["ranks"] == most]
    finding = f"a model predicts {between(reached, percent)} of the efficiency of one for {most} ranks"
    half = f"{finding}, and half of the efficiency of one for {between(halves, lambda value: f'{value:.0f}')} ranks" if halves else ""
    return finding, half


# The ratio of the ends of a histogram's bin, as in harness/base/statistics.h.
BIN = 10 ** (1 / 20)


def histograms(page):
    """The rows with the begins, ends and shares of their histogram's bins. Contenders are sorted by their medians; the row without
    drawing comes before that with drawing."""
    found = []
    for row in latest_of(reading.haptic, "scene", "contender", "hertz", "edited", "drawn")(page):
        ticks = sum(count for _, count in row["histogram"])
        bins = [(1e6 * begin, 1e6 * begin * BIN, count / ticks) for begin, count in row["histogram"]]
        begins, ends, shares = ([reading.significant(value, 4) for value in values] for values in zip(*bins))
        found.append({**row, "begin": begins, "end": ends, "share": shares, "label": row["label"] + ", drawn" * (row["drawn"] == "yes"),
                      "rate": rate_text(row["hertz"]) + ", with edits" * (row["edited"] == "yes")})
    shown = []
    for group in groups(found, "machine", "scene", "hertz", "edited").values():
        period = group[0]["period"]
        # The axis includes the period.
        domain = [min(period, *(row["begin"][0] for row in group)) / 1.2, max(period, *(row["end"][-1] for row in group)) * 1.2]
        least = min(min(row["share"]) for row in group)
        by_median = groups(sorted(group, key=lambda row: row["median"]), "contender").values()
        shown += [row | {"domain": domain, "shares": [least, 1]} for own in by_median for row in sorted(own, key=lambda row: row["drawn"])]
    return shown


@figure_of("latency", histograms)
def latencies(_, group):
    highest = max(row["hertz"] for row in group)
    plain = [row for row in group if row["hertz"] == highest and (row["edited"], row["drawn"]) == ("no", "no") and row["p999"] is not None]
    line, more = f"{len(group)} rows are of edits or drawing, or of too few ticks for a percentile of 99.9{SPACE}%", []
    if plain:
        first = min(plain, key=lambda row: row["p999"])
        within = sum(row["p999"] <= row["period"] for row in plain)
        line = f"99.9{SPACE}% of the forces at {rate_text(highest)} are there within {time_text(first['p999'])} with {first['backend']}"
        more.append(f"the force of 99.9{SPACE}% of the ticks at {rate_text(highest)} is there in time in {within} of {len(plain)} "
                    f"rows, soonest with {first['contender']} on {first['scene']}: within {time_text(first['p999'])}")
    pairs = groups(group, "scene", "contender", "hertz", "edited").values()
    fitting = [{row["drawn"]: row["steps_that_fit"] for row in pair} for pair in pairs]
    if costs := [1 - pair["yes"] / pair["no"] for pair in fitting if pair.get("no") and "yes" in pair]:
        more.append(f"drawing costs {percent(max(0, statistics.median(costs)))} of the steps that fit into a tick at the median")
    return line, "; ".join(more)


def claims_below(rows):
    """A dashed line for each case with a claimed order of convergence. It begins at the error on the case's coarsest lattice."""
    layers = []
    for own in groups((row for row in rows if row["claimed_order"]), "scene").values():
        first, last = (end(own, key=lambda row: row["across"]) for end in (min, max))
        fallen = first["model_error"] * (first["across"] / last["across"])**first["claimed_order"]
        layers.append(charts.line([(first["across"], first["model_error"]), (last["across"], fallen)], strokeDash=[4, 4]))
    return layers


@figure_of("truth", as_lines("truth", latest_of(reading.truth, "scene", "contender", "particles_at", "strain", "across"), "scene",
                             "across", "model_error", "particles_at", "strain"), below=claims_below)
def truth(_, rows):
    # The finding is about cases with a claimed order only, since the errors of others may be small by chance.
    claimed = [row for row in rows if row["claimed_order"]]
    if not claimed:
        return "no order of convergence is claimed", ""
    least = min(claimed, key=lambda row: row["model_error"])
    line = (f"the error falls to {percent(least['model_error'])} of the continuum's deflection: {least['scene']}, "
            f"{least['across']} voxels across")
    finest = groups((row for row in claimed if row["order"] is not None), "scene", "particles_at", "strain")
    orders = [max(own, key=lambda row: row["across"]) for own in finest.values()]
    told = listed(f"{row['scene']} {row['order']:.2f} ({row['claimed_order']:g} claimed; {row['particles_at']}, {row['strain']} strain)"
                  for row in orders)
    return line, f"{line}; orders of convergence: {told}" if told else ""


# The defaults of diff.py.
RULE = comparison.Rule()


def judged(first, last):
    """Compares two files as diff.py does. Returns ({(dataset, strategy): row}, the shifts of runs that are slower or faster as a
    whole, the reason why diff.py refuses the files or "")."""
    try:
        found = comparison.document(first.path, last.path, RULE)
    except reading.BadInput as error:
        return {}, [], str(error)
    rows = [{**row, "contender": reading.short_contender(row["contender"])} for row in found["rows"]
            if row["time"] and "measured" not in row["place"]]
    whole = [shift for shift in found["shifts"] if shift["verdict"] != "same" and shift["measured"] == "real_time"]
    return {(row["scene"], row["contender"]): row for row in rows}, whole, ""


def changes(rows, whole, first, last):
    """How times changed between two files, as (a line, more words): the shift of the whole run or else the largest change, and the
    number of rows per verdict."""
    commits = f"from commit {first.short_commit} to {last.short_commit}"
    counts = collections.Counter(row["verdict"] for row in rows)
    verdicts = listed(f"{counts[verdict]} {verdict}" for verdict in comparison.VERDICTS if counts[verdict])
    moved = [row for row in rows if row["verdict"] in ("slower", "faster")]
    if whole:
        line = "; ".join(f"{shift['api']} takes {shift['ratio']:.2f} times its time as a whole" for shift in whole)
        return f"{line}, {first.study} at {last.short_commit}", (
            f"{line} {commits} ({first.study}): rows are judged relative to that, of {len(rows)} times {verdicts}")
    if not moved:
        line = f"no change of a time in {first.study} can be told"
        return line, f"{line} {commits} ({verdicts})"
    row = max(moved, key=lambda row: abs(math.log(row["time"]["ratio"])))
    time = row["time"]
    low, high = time["interval"]
    # Times without repetitions have no interval.
    interval = "" if low is None else f" ({low:.2f} to {high:.2f})"
    line = f"{row['contender']} on {row['scene']} takes {time['ratio']:.2f} times its time, {first.study} at {last.short_commit}"
    return line, (f"the largest change {commits} is that of {row['contender']} on {row['scene']} ({first.study}), from "
            f"{time_text(time['old'] * 1e6)} to {time_text(time['new'] * 1e6)}, {time['ratio']:.2f} times"
            f"{interval}; of {len(rows)} times {verdicts}")


def repeated(page):
    """The rows of strategies that several files of one study of one machine have, with the verdict on the first and the last
    file."""
    found = []
    for (machine, study), (_, verdicts, *_) in page.histories.items():
        rows = [row for row in page.measured if (row["machine"], row["study"]) == (machine, study)]
        for (scene, contender), own in groups(rows, "scene", "contender").items():
            verdict = verdicts.get((scene, contender), {"verdict": "not compared", "time": {"ratio": None, "interval": [None, None]}})
            low, high = verdict["time"]["interval"]
            if len(distinct(own, "date")) > 1:
                found += [{**row, "run": f"{row['commit']} {row['date'][5:16].replace('T', ' ')}",
                           "day": row["date"][:16].replace("T", " "),
                           "verdict": verdict["verdict"], "ratio": verdict["time"]["ratio"],
                           "interval": "" if low is None else f"{low:.3f} to {high:.3f}"} for row in own]
    return found


@figure_of("history", repeated, by="machine study")
def history(figure, rows):
    runs = {(row["machine"], row["study"], row["date"]) for row in figure.rows}
    figure.results = [result for result in figure.results if (result.machine, result.study, result.date) in runs]
    files, verdicts, whole, refused = figure.page.histories[rows[0]["machine"], rows[0]["study"]]
    nothing = f"nothing can be told of {files[0].study}"
    if verdicts:
        return changes(list(verdicts.values()), whole, files[0], files[-1])
    return nothing, f"{nothing}: {refused or 'its runs share no time'}"


MIN_SHARE = 1e-6


def latest_suites(results):
    """The latest result with rows of the stress suite, of each machine. Rows of older results are left out."""
    return list({result.machine: result for result in results if result.lists["stress"]}.values())


def gates(page):
    def share(row):
        """The share of its gate that a measurement reaches: at most 1 if it passes. At least MIN_SHARE, since the axis is
        logarithmic."""
        numbers = [row.get(key) for key in (("measured", "gate") if row["gate_is"] == "at most" else ("gate", "measured"))]
        return max(numbers[0] / numbers[1], MIN_SHARE) if all(numbers) else None

    return [row | {"measured": row.get("measured"), "unit": row.get("unit", ""), "detail": row.get("detail", ""),
                   "share": share(row), "gate_share": 1, "passed": "yes" if row["passed"] else "no"}
            for row in reading.rows_of(latest_suites(page.results), "stress") if row.get("gate") is not None]


@figure_of("stress", gates, by="")
def stress(figure, rows):
    figure.results = latest_suites(figure.results)
    missed = [row for row in rows if row["passed"] == "no"]
    title = f"{len(rows) - len(missed)} of {len(rows)} gates of the stress suite hold"
    others = f"{title}; the others are of {listed(sorted(set(distinct(missed, 'backend'))))}" if missed else ""
    return title, others


def all_figures(results):
    """(the Page of these results, its figures that have rows, in the order of figures.vegalite)."""
    page = Page(results)
    made = [(name, *MADE_BY[name]) for name in ABOUT["figures"]]
    return page, [Figure(name, rows, page, *how) for name, rows_of, *how in made if (rows := rows_of(page))]
