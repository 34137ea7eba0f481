"""The figures of the page: for each its finding in words, its rows and the Vega-Lite charts that show them.

A figure has a panel for each machine, or for each machine and scene. A panel's chart takes the rows of its figure that match the panel
(the page hands them over under the name `rows`), less those that the reader's filters hide: the parameters `shown`, a
list of backends, and `scene`, one name or empty. Charts take their colours from the page's style, so that they follow
its light, dark and printed scheme.
"""

import collections
import functools
import math
import statistics
import zlib
from dataclasses import dataclass

import altair as alt
import numpy
import scipy.optimize

import comparison
from result_files import distinct, groups, listed

from . import reading

# A colour for each backend, the same on every page: page.css has them by these places. A name that is not here, of a backend of
# somebody's own or of a newer program, takes one of the three beyond by its own sum, whatever else is on the page.
PLACES = {name: place for place, name in enumerate((
    "cuda_explicit_cached", "cuda_explicit_cached_grid", "cuda_explicit_delta", "cuda_explicit_device",
    "cuda_implicit_cached", "cuda_implicit_device", "cuda_implicit_shared", "cuda_march", "cuda_resident", "cuda_scatter",
    "gl_compute_explicit", "gl_compute_implicit", "gl_fragment_explicit", "gl_fragment_implicit",
    "cpu_parallel", "cpu_reference", "cuda_bricks", "vulkan_explicit", "vulkan_implicit"))}
SPARE_COLOURS = 3
# Shapes tell families apart where colours would not.
SHAPES = {"CUDA": "circle", "Vulkan": "triangle-right", "OpenGL": "square", "CPU": "triangle-up", "another API": "diamond"}
FORMULATIONS = {"paper": "cross", "position": "triangle-down", "displacement": "square", "increment": "circle",
                "compensated": "diamond"}
# Binds a figure to its unit.
SPACE = "\N{NO-BREAK SPACE}"
TARGETS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


CONFIG = {
    "background": "transparent", "font": "system-ui, sans-serif", "view": {"stroke": None},
    "axis": {"labelColor": "var(--soft)", "titleColor": "var(--soft)", "gridColor": "var(--line)", "domainColor": "var(--line)",
             "tickColor": "var(--line)", "gridOpacity": 0.45, "labelFontSize": 11, "titleFontSize": 12, "titleFontWeight": "normal",
             "labelOverlap": "greedy", "labelSeparation": 4},
    "axisYQuantitative": {"minExtent": 38}, "point": {"opacity": 1}}


@dataclass
class Panel:
    heading: str
    match: dict  # what the rows of this panel have in common
    spec: dict
    step: tuple = None  # (key, pixels): the chart is that high for each value of key among the rows shown


def engineering(value, unit):
    """1234567 and "springs/s" as 1.23 M springs/s."""
    for factor, prefix in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= factor:
            return f"{value / factor:.3g}{SPACE}{prefix} {unit}"
    return f"{value:.3g} {unit}"


def time_text(microseconds):
    for factor, unit in ((1e6, "s"), (1e3, "ms"), (1, "µs")):
        if microseconds >= factor:
            return f"{microseconds / factor:.3g}{SPACE}{unit}"
    return f"{microseconds * 1e3:.3g}{SPACE}ns"


def error_text(error):
    """2.4e-6, and 1e-5 rather than 1.0e-05."""
    mantissa, exponent = f"{error:.1e}".split("e")
    return f"{mantissa.removesuffix('.0')}e{int(exponent)}" if error else "0"


def percent(fraction):
    return f"{100 * fraction:{'.2g' if abs(fraction) < 0.995 else '.0f'}}{SPACE}%"


def between(values, text):
    """The least and the most of some values, once if they read the same."""
    ends = list(dict.fromkeys(text(value) for value in (min(values), max(values))))
    return " to ".join(ends)


def sentence(text):
    """With a capital, unless it begins with the name of a backend."""
    return text if "_" in text.split(" ")[0] else text[:1].upper() + text[1:]


def by_machine(findings):
    """(machine, what was found there) in one sentence, machines with the same finding together."""
    told = groups(findings, lambda finding: finding[1]).items()
    return sentence("; ".join(f"on {listed(dict.fromkeys(machine for machine, _ in own))} {text}" for (text,), own in told))


def colour_of(backend):
    return f"var(--backend-{PLACES.get(backend, len(PLACES) + zlib.crc32(backend.encode()) % SPARE_COLOURS)})"


def backend_order(backends):
    return sorted(backends, key=lambda name: (list(SHAPES).index(reading.family(name)), name))


def fastest(rows):
    return min(rows, key=lambda row: row["microseconds"], default=None)


@functools.cache
def is_clearly_slower(times, other, marked):
    return comparison.is_clearly_slower(times, other, marked)


def as_fast(best, group):
    """Of the other backends, each at its best, those that repetitions do not tell from the fastest, fastest first."""
    others = [fastest(own) for (backend,), own in groups(group, "backend").items() if backend != best["backend"]]
    return sorted((row for row in others if not is_clearly_slower(
        best["repetition_times"], row["repetition_times"], bool(best["noisy"] or row["noisy"]))),
        key=lambda row: row["microseconds"])


@dataclass
class Outcome:
    """What was measured on a dataset of a machine."""

    best: dict
    group: list  # every strategy that was measured there
    equals: list  # backends that repetitions do not tell from the fastest, each at its best
    absent: list  # backends that win smaller and larger datasets, and neither were measured here nor refuse this one

    @property
    def won(self):
        return not self.equals and not self.absent


def outcomes(results, rows):
    """By machine the outcome of each dataset, small ones first; the machine with most datasets first."""
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
            entry.absent = [name for name in backend_order(set.intersection(*winners))
                            if (machine, entry.best["scene"], name) not in tried]
    return dict(sorted(found.items(), key=lambda item: -len(item[1])))


# What a headline names no more of.
FEW = 3


def ladder(entries):
    """Up to which size which backend wins the sizes of one dataset, (dataset, [(backends, on chip, particles)]): of that with
    most of them, if each backend wins sizes that lie beside each other. Backends whose state stays on the chip count as one."""
    families = groups([entry.best | {"family_name": entry.best["scene"].split("@")[0]} for entry in entries if entry.won], "family_name")
    (family,), rows = max(families.items(), key=lambda item: len(item[1]), default=((None,), []))
    steps = []
    for row in rows:
        on_chip = row["operation_rate"] is not None and row["operations_a_byte"] is None
        if steps and (row["backend"] in steps[-1][0] or on_chip and steps[-1][1]):
            steps[-1] = (list(dict.fromkeys([*steps[-1][0], row["backend"]])), on_chip, row["particles"])
        else:
            steps.append(([row["backend"]], on_chip, row["particles"]))
    names = [name for backends, _, _ in steps for name in backends]
    return (family, steps) if len(rows) > FEW and 1 < len(steps) <= FEW and len(set(names)) == len(names) else None


# Whole names, however long.
LABEL_AXIS = alt.Axis(labelLimit=320, grid=True)


def label_axis(key):
    """A strategy for each line, that with the least of a key first."""
    return alt.Y("label:N", title=None, sort=alt.EncodingSortField(key, op="min"), axis=LABEL_AXIS)


def labelled(rows):
    """With what tells the rows of a figure apart, beyond what they all share."""
    common = len({row["formulation"] for row in rows}) == 1
    words = [row["contender"].split(" ") for row in rows]
    return [{**row, "label": " ".join(own[:1] + own[2:] if common else own)} for row, own in zip(rows, words)]


def spread_out(places, gap):
    """The places, ascending, that lie nearest to these and at least `gap` apart."""
    steps = gap * numpy.arange(len(places))
    return list(scipy.optimize.isotonic_regression(numpy.asarray(places) - steps).x + steps)


LABEL_SIZE = 10


def with_end_labels(rows, line, x, y, height):
    """The rows, of which the last of each line says as well what the line is (`end_label`) and where that can be read beside the
    others (`label_at`), in a chart of this height."""
    values = [row[y] for row in rows]
    log = scale(values).type == "log"
    def forth(value):
        return math.log(value) if log else value
    low, high = forth(min(values)), forth(max(values))
    unit = (high - low) / height or 1
    ends = [max(group, key=lambda row: row[x]) for group in groups(rows, line).values()]
    places = {}
    for _, beside in groups(ends, x).items():
        beside = sorted(beside, key=lambda row: row[y])
        for row, place in zip(beside, spread_out([forth(row[y]) for row in beside], (LABEL_SIZE + 1) * unit)):
            places[id(row)] = math.exp(place) if log else place
    return [{**row, "end_label": row[line] if id(row) in places else None, "label_at": places.get(id(row))} for row in rows]


def exact_scale(values):
    """That of with_end_labels(), which ends where the values do."""
    kind = scale(values).type
    return alt.Scale(type=kind, domain=[min(values), max(values)], nice=False, zero=alt.Undefined if kind == "log" else False)


def end_labels(x, y):
    """Layers that write `end_label` to the right of a line's end."""
    ends = source().transform_filter("isValid(datum.label_at)")
    leader = ends.mark_rule(strokeWidth=0.7, color="var(--soft)", xOffset=5, x2Offset=14).encode(
        x=f"{x}:Q", x2=f"{x}:Q", y=f"{y}:Q", y2="label_at:Q")
    text = ends.mark_text(align="left", dx=16, fontSize=LABEL_SIZE, color="var(--ink)").encode(
        x=f"{x}:Q", y="label_at:Q", text="end_label:N")
    return [leader, text]


def scale(values, **options):
    """A logarithmic scale where the values span more than a decade."""
    positive = [value for value in values if value is not None]
    wide = positive and min(positive) > 0 and max(positive) > 10 * min(positive)
    return alt.Scale(type="log" if wide else "linear", nice=False if wide else True, **options)


class Figure:
    """A figure as it is drawn: the rows of its table, its panels, and what was found; a backend has one colour in all of them."""

    def __init__(self, name, told, rows, results, having, legend, backends):
        self.name, self.columns, self.rows, self.legend, self.backends = name, told, rows, legend, backends
        self.all_results = results
        self.results = [result for result in results if (result.lists[having] if having in result.lists else result.study == having)]
        self.panels, self.findings = [], []  # findings of (machine, a line, more of it or nothing)

    @property
    def title(self):
        """One line: what was found on the machine that comes first."""
        return sentence(self.findings[0][1])

    @property
    def detail(self):
        """All of it, machine by machine."""
        told = [(machine, more or line) for machine, line, more in self.findings]
        return by_machine(told) + "." if len(told) > 1 or self.findings[0][2] else ""

    def tell(self, machine, line, more=""):
        self.findings.append((machine, line, more))

    def colour(self):
        return alt.Color("backend:N", legend=None, scale=alt.Scale(domain=self.backends, range=list(map(colour_of, self.backends))))

    @staticmethod
    def shape(key, shapes):
        return alt.Shape(f"{key}:N", legend=None, scale=alt.Scale(domain=list(shapes), range=list(shapes.values())))

    def tooltip(self, told=None):
        return [alt.Tooltip(f"{key}:{'N' if digits is None else 'Q'}", title=text,
                            format=alt.Undefined if digits is None else f".{digits}~g") for key, text, digits in told or self.columns]

    def points(self, base=None, shape=None, **mark):
        """A mark for each row, in the colour of its backend and the shape of its family unless another is given."""
        return (base or source()).mark_point(filled=True, **mark).encode(
            color=self.colour(), shape=shape or self.shape("family", SHAPES), tooltip=self.tooltip())

    def panel(self, match, chart, alternative, height=None, step=None, heading=None):
        """A chart as Vega-Lite, as wide as its panel and filtered; its height is fixed or follows its rows."""
        heading = heading or ", ".join(reversed(match.values()))
        chart = chart.add_params(alt.param(name="shown", value=self.backends), alt.param(name="scene", value=""))
        chart = filtered(chart, "indexof(shown, datum.backend) >= 0 && (scene == '' || datum.scene == scene)")
        chart = chart.properties(width="container", height=height or step[1], description=alternative,
                                 autosize=alt.AutoSizeParams(type="fit-x", contains="padding"))
        self.panels.append(Panel(heading, match, chart.to_dict(), step))


def source():
    return alt.Chart(alt.NamedData("rows"))


def inline(*values):
    """A chart of a few points that no row of the figure has."""
    return alt.Chart(alt.InlineData(values=list(values)))


def filtered(chart, condition):
    """A chart of those rows that fulfil a condition. What lies over lines of other data has its rows by itself: a filter of
    the whole would not reach them."""
    if not isinstance(chart, alt.LayerChart) or chart.data is not alt.Undefined:
        return chart.transform_filter(condition)
    chart = chart.copy()
    chart.layer = [layer.transform_filter(condition) if isinstance(layer.data, alt.NamedData) else layer for layer in chart.layer]
    return chart


# What a column of a table is called, and its digits: none for text. What is not here is a text that is called as its key.
COLUMNS = {
    "microseconds": ("time per step (µs)", 4), "least": ("least (µs)", 4), "most": ("most (µs)", 4), "scene": ("dataset", None),
    "contender": ("strategy", None), "spring_rate": ("springs/s", 4), "of_limit": ("of limit", 3),
    "limited_by": ("limited by", None), "rounding": ("rounding error", 3), "rounding_max": ("worst particle", 3),
    "error_steps": ("after steps", 6), "fraction": ("of stable step", 4), "steps": ("steps", 6), "seconds": ("run time (s)", 4),
    "total": ("total error", 3), "front": ("on the front", None), "middle": ("total error, median", 3),
    "count": ("backends", 3), "damping": ("damping", 4), "region": ("outcome", None), "ratio": ("measured / theory", 6),
    "operations_a_byte": ("operations per byte", 4), "operation_rate": ("Gop/s", 4), "footprint": ("footprint (MiB)", 4),
    "edits": ("edits", 4), "slower": ("slower by (%)", 3), "edit_microseconds": ("an edit (µs)", 4),
    "base": ("a step without (µs)", 4), "handed_over": ("steps handed over", None),
    "host": ("the host's calls (µs per step)", 4), "millijoules": ("energy per step (mJ)", 4),
    "springs_per_joule": ("springs/J", 4), "watts": ("power (W)", 4), "idle_watts": ("idle (W)", 4),
    "throttled": ("clocks held down by", None), "meter": ("counter", None), "compared": ("dataset", None),
    "ranks": ("ranks", 4), "cut": ("cut into", None), "compute": ("compute (µs)", 4), "exchange": ("exchange (µs)", 4),
    "waiting": ("waiting (µs)", 4), "efficiency": ("efficiency", 3), "predicted": ("efficiency predicted", 3),
    "noisy": ("not to be trusted", None), "measured_ranks": ("ranks measured", 4),
    "half": ("half of the efficiency at ranks", 2), "hertz": ("ticks per second", 6), "edited": ("edits", None),
    "pictures": ("pictures per second", 3), "median": ("median (µs)", 4), "p99": ("p99 (µs)", 4), "p999": ("p99.9 (µs)", 4),
    "worst": ("worst (µs)", 4), "missed": ("missed", 6), "ticks": ("played", 6), "steps_that_fit": ("steps that fit", 6),
    "day": ("date", None), "verdict": ("first to last run", None), "interval": ("95% interval", None),
    "measured": ("measured", 3), "gate_is": ("gate is", None), "gate": ("gate", 3)}


def columns(keys, **others):
    """(key, name, digits) of the columns of a table; others have a name of this table."""
    return [(key, *others.get(key, COLUMNS.get(key, (key, None)))) for key in keys.split(" ")]


SUBJECT = "machine scene backend contender"
REST = "microseconds least most spring_rate of_limit limited_by rounding rounding_max error_steps study commit"
STEP = f"{SUBJECT} {REST}"
# What draws the figures, in the order of the page.
DRAWN = []


def figure_of(name, told, rows, having="benchmarks", legend="backend"):
    """Registers what draws a figure: a function of the Figure and of its rows. They are what `rows` makes of the results and of the
    measured rows, and without any there is no figure; `told` are columns, and captions name the results with a list, or of a study, `having`."""
    def register(draw):
        DRAWN.append((draw, name, columns(told) if isinstance(told, str) else told, rows, having, legend))
        return draw
    return register


def latest_of(rows_of, *keys):
    """The latest of the rows that a function makes of the results, of those that differ in a key, as figures label them."""
    return lambda results, _: labelled(reading.latest(rows_of(results), "machine", *keys))


def in_units(list_name, **factors):
    """Makes rows of a list of the results, with keys that are others times a factor: name=(key, factor)."""
    return lambda results: [row | {name: row[key] * factor for name, (key, factor) in factors.items()}
                            for row in reading.rows_of(results, list_name)]


def of_study(name):
    return lambda _, rows: labelled(reading.latest([row for row in rows if row["study"] == name], "machine", "scene", "contender"))


def latest_runs(results, _=None):
    return reading.latest(reading.pareto(results), "machine", "scene", "contender", "fraction")


@figure_of("datasets", STEP, lambda _, rows: [row for row in rows if not row["edits"]])
def datasets(figure, rows):
    """Every backend at its best on every dataset."""
    figure.rows = best = [fastest(group) for group in groups(reading.strategies(rows), "machine", "scene", "backend").values()]
    for machine, entries in outcomes(figure.all_results, rows).items():
        winners = collections.Counter(entry.best["backend"] for entry in entries if entry.won)
        ordered = sorted(winners, key=lambda name: (-winners[name], name))
        shares = [f"{name} wins {winners[name]}" for name in ordered]
        line = listed(shares[:FEW]) or "no backend wins any"
        more = listed(shares) or "no backend wins any"
        of = f" of {len(entries)} datasets"
        if untold := sum(bool(entry.equals) for entry in entries):
            more += f"; on {untold} the fastest cannot be told"
        if absent := [entry.best["scene"] for entry in entries if entry.absent and not entry.equals]:
            more += f"; nobody wins {listed(absent)}, where what wins smaller and larger ones was not measured"
        figure.tell(machine, line + of, f"of {len(entries)} datasets {more}")
    for (machine,), of_machine in groups(best, "machine").items():
        sizes = {row["scene"]: row["particles"] for row in of_machine}
        order = sorted(sizes, key=lambda scene: (sizes[scene], reading.natural(scene)))
        x = alt.X("microseconds:Q", title="time per step (µs)", scale=scale([row["microseconds"] for row in of_machine]))
        points = figure.points(size=75).encode(x=x, y=alt.Y("scene:N", sort=order, title=None, axis=alt.Axis(grid=True)))
        alternative = (f"Dot plot for {machine}: time per step in microseconds of the best row of each of "
                       f"{len(distinct(of_machine, 'backend'))} backends on {len(order)} datasets.")
        figure.panel({"machine": machine}, points, alternative, step=("scene", 30))


@figure_of("figure7", STEP, of_study("figure7"), "figure7")
def figure7(figure, rows):
    leaders, told = {}, {}
    for (machine, scene), group in groups(rows, "machine", "scene").items():
        group = sorted(group, key=lambda row: row["microseconds"])
        first, last = group[0], group[-1]
        leaders.setdefault(machine, {}).setdefault(first["backend"], []).append(scene)
        told.setdefault(machine, []).append(
            f"{first['label']} leads on {scene} with {time_text(first['microseconds'])} per step, "
            f"{last['microseconds'] / first['microseconds']:.1f} times as fast as {last['label']}")
        y = alt.Y("label:N", sort=alt.EncodingSortField("microseconds", op="min"), title=None,
                  axis=alt.Axis(labels=False, ticks=False, domain=False, grid=False))
        x = alt.X("microseconds:Q", title="time per step (µs)", scale=alt.Scale(zero=True))
        base = source().encode(y=y, tooltip=figure.tooltip())
        bars = base.mark_bar(height=11, yOffset=7).encode(x=x, color=figure.colour())
        spread = base.mark_rule(yOffset=7, strokeWidth=1.5, color="var(--ink)").encode(x="least:Q", x2="most:Q")
        names = base.mark_text(align="left", baseline="bottom", dy=-1, fontSize=12, color="var(--ink)").encode(
            x=alt.datum(0), text="label:N")
        alternative = (f"Bars for {scene} on {machine}: time per step of {len(group)} strategies, from "
                       f"{first['label']} with {time_text(first['microseconds'])} to {last['label']} with "
                       f"{time_text(last['microseconds'])}.")
        figure.panel({"machine": machine, "scene": scene}, alt.layer(bars, spread, names), alternative, step=("label", 36))
    for machine, of_machine in leaders.items():
        figure.tell(machine, listed(f"{name} leads on {listed(scenes)}" for name, scenes in of_machine.items()), "; ".join(told[machine]))


FIGURE8_HEIGHT = 480


@figure_of("figure8", STEP, of_study("figure8"), "figure8")
def figure8(figure, rows):
    figure.rows = []
    for (machine,), group in groups(rows, "machine").items():
        sizes = sorted({row["particles"] for row in group})
        small, large = (fastest(row for row in group if row["particles"] == size) for size in (sizes[0], sizes[-1]))
        text = (f"{large['label']} leads at {engineering(sizes[-1], 'particles')} with "
                f"{time_text(large['microseconds'])} per step")
        figure.tell(machine, text, f"{text}; {sizes[-1] / sizes[0]:,.0f} times fewer take "
                    f"{large['microseconds'] / small['microseconds']:.0f} times less, "
                    f"{time_text(small['microseconds'])} with {small['label']}")
        figure.rows += with_end_labels(group, "label", "particles", "microseconds", FIGURE8_HEIGHT)
        times = [row["microseconds"] for row in group]
        lines = source().encode(
            x=alt.X("particles:Q", title="particles", scale=scale(sizes), axis=alt.Axis(format="~s")),
            y=alt.Y("microseconds:Q", title="time per step (µs)", scale=exact_scale(times)),
            color=figure.colour(), detail="label:N")
        chart = alt.layer(lines.mark_line(strokeWidth=1.6), figure.points(lines, size=45), *end_labels("particles", "microseconds"))
        alternative = (f"Lines for {machine}: time per step of {len(distinct(group, 'label'))} strategies over "
                       f"{len(sizes)} box sizes from {sizes[0]} to {sizes[-1]} particles, both logarithmic.")
        figure.panel({"machine": machine}, chart, alternative, FIGURE8_HEIGHT)


def fastest_within(rows, target):
    """The row that reaches an error soonest, or None."""
    return min((row for row in rows if row["total"] <= target), key=lambda row: row["seconds"], default=None)


RUN = f"{SUBJECT} fraction steps seconds total rounding device front"


@figure_of("front", RUN, latest_runs, "pareto", "backend formulation")
def front(figure, runs):
    costs, on_front = [], []
    for (machine, scene), group in groups(runs, "machine", "scene").items():
        coarse, fine = fastest_within(group, 1e-4), fastest_within(group, 1e-6)
        if coarse and fine:
            costs.append(fine["seconds"] / coarse["seconds"])
        on_front += [row["formulation"] for row in group if row["front"]]
        points = figure.points(shape=figure.shape("formulation", FORMULATIONS), size=55).encode(
            x=alt.X("seconds:Q", title=f"run time to t = {group[0]['end_time']:.3g} (s)",
                    scale=scale([row["seconds"] for row in group])),
            y=alt.Y("total:Q", title="total error (relative L2)", axis=alt.Axis(format="~e"),
                    scale=scale([row["total"] for row in group])),
            opacity=alt.condition("datum.front", alt.value(1), alt.value(0.3)))
        steps = source().transform_filter("datum.front").mark_line(
            interpolate="step-after", color="var(--ink)", strokeWidth=1.1).encode(
                x="seconds:Q", y="total:Q",
                strokeDash=alt.StrokeDash("device:N", legend=None, sort=distinct(group, "device")))
        alternative = (f"Scatter plot for {scene} on {machine}: {len(group)} runs, run time against total error, both "
                       f"logarithmic, with the Pareto front of each device as a line.")
        figure.panel({"machine": machine, "scene": scene}, alt.layer(steps, points), alternative, 340)
    most = statistics.mode(on_front) if on_front else ""
    title = (f"{most} is most often on a Pareto front, in {percent(on_front.count(most) / len(on_front))} of its runs" if most else
             "no run is on a Pareto front")
    cost = f"an error of 1e-6 takes {between(costs, lambda c: f'{c:.2g}')} times as long as one of 1e-4" if costs else ""
    figure.tell(listed(distinct(runs, "machine")), cost or title, f"{cost}; {title}" if cost else "")


@figure_of("curves", RUN, latest_runs, "pareto", "formulation precision")
def curves(figure, runs):
    turns = {}
    for (_, _, formulation, precision), group in groups(runs, "machine", "scene", "formulation", "precision").items():
        if precision == "float32":
            middle = {fraction: statistics.median(row["total"] for row in rows)
                      for (fraction,), rows in groups(group, "fraction").items()}
            turns.setdefault(formulation, []).append(min(middle, key=middle.get))
    finest = min(row["fraction"] for row in runs)
    def step(fraction):
        return f"1/{1 / fraction:.3g}"
    pays, grows = [], []
    for formulation in (name for name in FORMULATIONS if name in turns):
        fractions = turns[formulation]
        if max(fractions) == finest:
            pays.append(formulation)
        else:
            ends = dict.fromkeys(step(fraction) for fraction in (max(fractions), min(fractions)))
            grows.append(f"{formulation} at {' to '.join(ends)}")
    title = f"in float32 errors are least with {listed(grows)} of the stable step" if grows else ""
    if pays:
        title += ("; " if title else "in float32 ") + f"{listed(pays)} gain{'s' * (len(pays) == 1)} down to {step(finest)}"
    line = (f"finer steps pay off in float32 for {listed(pays)} alone, down to {step(finest)}" if pays and grows else
            f"finer steps pay off in float32 down to {step(finest)}" if pays else "finer steps do not always pay off in float32")
    figure.tell(listed(distinct(runs, "machine")), line, title)
    for (machine, scene), group in groups(runs, "machine", "scene").items():
        fractions = sorted({row["fraction"] for row in group})
        base = source().transform_aggregate(
            middle="median(total)", count="distinct(backend)", groupby=["scene", "formulation", "precision", "fraction"]
        ).encode(
            x=alt.X("fraction:Q", title="time step, as a fraction of the stable one",
                    scale=alt.Scale(type="log", nice=False),
                    axis=alt.Axis(values=fractions, labelExpr="'1/' + format(1 / datum.value, '~r')")),
            y=alt.Y("middle:Q", title="total error (relative L2)", axis=alt.Axis(format="~e"),
                    scale=scale([row["total"] for row in group])),
            color=alt.Color("formulation:N", legend=None, scale=alt.Scale(
                domain=list(FORMULATIONS), range=[f"var(--{name})" for name in FORMULATIONS])))
        lines = base.mark_line(strokeWidth=1.6).encode(strokeDash=alt.StrokeDash(
            "precision:N", legend=None, scale=alt.Scale(domain=["float32", "float64"], range=[[1, 0], [2, 3]])))
        points = base.mark_point(filled=True, size=45).encode(shape=figure.shape("formulation", FORMULATIONS), tooltip=figure.tooltip(
            columns("scene formulation precision fraction middle count")))
        alternative = (f"Lines for {scene} on {machine}: total error against the time step from {step(max(fractions))} to "
                       f"{step(min(fractions))} of the stable one, a line for each formulation and precision.")
        figure.panel({"machine": machine, "scene": scene}, alt.layer(lines, points), alternative, 320)


@figure_of("roofline", STEP, lambda _, rows: [row for row in reading.strategies(rows) if row["limit_microseconds"] and row["of_limit"]])
def roofline(figure, rows):
    for (machine,), group in groups(rows, "machine").items():
        within = [row for row in group if row["of_limit"] <= 1]
        best = max(within or group, key=lambda row: row["of_limit"])
        middle = statistics.median(row["of_limit"] for row in group)
        bound = statistics.mode(row["limited_by"] for row in group)
        share = sum(row["limited_by"] == bound for row in group) / len(group)
        text = f"{best['backend']} comes closest to its limit, {percent(best['of_limit'])} on {best['scene']}"
        figure.tell(machine, text, f"{text}; the median row reaches {percent(middle)}, and {bound} binds {percent(share)} of "
                    "them")
        ends = {key: (min(row[key] for row in group), max(row[key] for row in group))
                for key in ("limit_microseconds", "microseconds")}
        points = figure.points(size=50, opacity=0.85).encode(
            x=alt.X("limit_microseconds:Q", title="least time per step by the device's limits (µs)",
                    scale=scale(ends["limit_microseconds"], domain=ends["limit_microseconds"])),
            y=alt.Y("microseconds:Q", title="measured time per step (µs)",
                    scale=scale(ends["microseconds"], domain=ends["microseconds"])))
        lines = []
        for factor, text in ((1, "the limit"), (10, "ten times as long")):
            low, high = ends["limit_microseconds"]
            lines.append(inline(*({"x": end, "y": end * factor} for end in (low, high))).mark_line(
                color="var(--soft)", strokeWidth=1, strokeDash=[1, 0] if factor == 1 else [4, 4], clip=True).encode(x="x:Q", y="y:Q"))
            # Named where the line leaves the chart, below it, where no point is.
            top = min(high, ends["microseconds"][1] / factor)
            lines.append(roof_name({"x": top, "y": top * factor}, text, align="right", dx=-6, dy=5, baseline="top"))
        alternative = (f"Scatter plot for {machine}: least time per step by the device's measured limits against the "
                       f"measured time, {len(group)} rows, both logarithmic, with lines at the limit and ten times it.")
        figure.panel({"machine": machine}, alt.layer(*lines, points), alternative, 420)


# The datasets of a panel each: one that lies in a card's cache, and one far beyond it. Without them the smallest and the largest.
INTENSITY_SCENES = ("box@32", "box@256")
ROOF_DASHES = {"memory": [1, 0], "memory, half written": [4, 4], "cache": [1, 3]}
# How far right of the last roof's bend the strategies stand that move no bytes.
ON_CHIP = 1.9


def roof_name(at, text, **style):
    return inline({**at, "text": text}).mark_text(color="var(--soft)", **style).encode(
        x="x:Q", y="y:Q", text="text:N")


def on_chip_strip(edge):
    """Beyond the roofs, where no number of operations per byte stands."""
    ends = {"x": edge * ON_CHIP**0.5, "x2": edge * ON_CHIP**1.5}
    strip = inline(ends).mark_rect(color="var(--raised)").encode(x="x:Q", x2="x2:Q")
    name = inline({"x": edge * ON_CHIP, "text": "on chip"}).mark_text(
        color="var(--soft)", baseline="bottom", dy=-4).encode(x="x:Q", y=alt.value("height"), text="text:N")
    return [strip, name]


@figure_of("intensity", f"{SUBJECT} operations_a_byte operation_rate footprint {REST}", lambda _, rows: sorted(
    (row for row in reading.strategies(rows) if row["precision"] == "float32" and row["operation_rate"]), key=lambda row: row["particles"]))
def intensity(figure, rows):
    scenes = set(INTENSITY_SCENES) & set(distinct(rows, "scene")) or {rows[0]["scene"], rows[-1]["scene"]}
    rows = [row for row in rows if row["scene"] in scenes]
    limits = {result.machine: result.limits for result in figure.all_results if result.limits}
    found, figure.rows = {}, []
    for (machine, scene), group in groups(sorted(rows, key=lambda row: reading.natural(row["scene"])), "machine",
                                          "scene").items():
        best = max(group, key=lambda row: row["operation_rate"])
        where = (f"at {best['operations_a_byte']:.2g} operations per byte" if best["operations_a_byte"] else "on the chip")
        found.setdefault(machine, []).append((best, where))
        known = [row["operations_a_byte"] for row in group if row["operations_a_byte"]] or [1.0]
        roofs = reading.rooflines(limits.get(machine, {}), group)
        # From the left of all rows and of where the roofs meet to the right of both.
        bends = [operations / rate for bandwidths, operations in roofs.values() for rate in bandwidths.values()]
        start, edge = min([*known, *bends]) / 2, 2 * max([*known, *bends])
        figure.rows += [{**row, "place": row["operations_a_byte"] or edge * ON_CHIP} for row in group]
        still = any(not row["operations_a_byte"] for row in group)
        x = alt.X("place:Q", title="operations per byte", axis=alt.Axis(labelExpr=f"datum.value > {edge} ? '' : datum.label"),
                  scale=alt.Scale(type="log", nice=False, domain=[start, edge * ON_CHIP**1.5 if still else edge]))
        points = figure.points(size=50, opacity=0.85).encode(
            x=x, y=alt.Y("operation_rate:Q", title="operations per second (Gop/s)", scale=alt.Scale(type="log", nice=False)))
        lines = on_chip_strip(edge) if still else []
        for family, (bandwidths, operations) in roofs.items():
            at = sorted({start, *(operations / rate for rate in bandwidths.values()), edge})
            for name, rate in bandwidths.items():
                values = [{"x": x, "y": 1e-9 * min(operations, rate * x)} for x in at]
                lines.append(inline(*values).mark_line(
                    color="var(--soft)", strokeWidth=1, strokeDash=ROOF_DASHES[name]).encode(x="x:Q", y="y:Q"))
                if name in reading.ROOF_LABELS:
                    lines.append(roof_name(values[0], f"{family}: {reading.ROOF_LABELS[name]}", align="left", dx=6, dy=4,
                                           baseline="top"))
            lines.append(roof_name({"x": at[-1], "y": 1e-9 * operations}, f"{family}: float32 arithmetic", align="right",
                                   dy=-3, baseline="bottom"))
        alternative = (f"Roofline of {machine} on {scene}: operations per byte against operations per second, both logarithmic, "
                       f"{len(group)} rows below the roofs of memory, cache and arithmetic.")
        figure.panel({"machine": machine, "scene": scene}, alt.layer(*lines, points), alternative, 420,
                     heading=f"{machine}, {scene}")
    for machine, bests in found.items():
        told = [f"{best['backend']} computes most on {best['scene']}, {engineering(best['operation_rate'] * 1e9, 'op/s')}" for best, _ in bests]
        figure.tell(machine, told[-1], listed(f"{text} {where}" for text, (_, where) in zip(told, bests)))


@figure_of("map", columns("machine scene backend damping fraction region", fraction=("of the limit", 4)), lambda results, _: [
    (result, row) for result in results for row in result.lists["stability_map"]], "stability_map", "region")
def stability_map(figure, rows):
    # The last map of a machine and scene stands.
    figure.rows, last = [], {(result.machine, row["scene"]): row for result, row in rows}
    for result, row in rows:
        cells = [{"machine": result.machine, "scene": row["scene"], "backend": row["backend"], "damping": damping,
                  "fraction": fraction, "region": region, "letter": region[0], "file": result.path.name,
                  "date": result.date}
                 for damping, line in zip(row["damping"], row["region"])
                 for fraction, region in zip(row["fraction"], line)]
        # How far each damping stays bounded, without a gap below.
        reach = {}
        for damping, line in zip(row["damping"], row["region"]):
            below = [fraction for fraction, region in zip(row["fraction"], line) if region != "bounded"]
            reach[damping] = max((fraction for fraction in row["fraction"] if not below or fraction < min(below)),
                                 default=0)
        least, most = min(reach), max(reach.values())
        enough = min(damping for damping in reach if reach[damping] == most)
        figure.tell(result.machine, f"damping {enough:g} keeps a random start bounded up to {most:g} of the limit",
                    f"a random start of ±{row['amplitude']:g} spacings stays bounded up to "
                    f"{reach[least]:g} of the limit at damping {least:g}, and up to {most:g} at {enough:g}")
        base = source().encode(
            x=alt.X("fraction:O", title="time step / limit at that damping",
                    axis=alt.Axis(labelAngle=0, labelOverlap="greedy")),
            y=alt.Y("damping:O", title="damping", sort="descending"), tooltip=figure.tooltip())
        colours = alt.Scale(domain=list(reading.REGIONS), range=[f"var(--{name})" for name in reading.REGIONS])
        cells_of = base.mark_rect(stroke="var(--page)").encode(
            color=alt.Color("region:N", legend=None, scale=colours))
        letters = base.mark_text(fontSize=11, color="#111").encode(text="letter:N")
        alternative = (f"Map for {row['scene']} on {result.machine}: outcome after {row['steps']} steps for "
                       f"{len(row['damping'])} dampings and {len(row['fraction'])} time steps.")
        if row is last[result.machine, row["scene"]]:
            figure.rows += cells
            figure.panel({"machine": result.machine, "scene": row["scene"]}, alt.layer(cells_of, letters), alternative,
                         step=("damping", 24))


def starts(results, _):
    rows = [row | {"start": f"±{row['start']['amplitude']:g}" if row["start"]["kind"] != "stretched" else "stretched",
                   "held": row.get("tolerance") is not None, "passed": "yes" if row["passed"] else "no"}
            for row in reading.rows_of(results, "stability")]
    rows = [row | {"kind": f"{row['start']}, λ = {row['damping']:g}"} for row in rows]
    return reading.latest(rows, "machine", "scene", "contender", "kind")


@figure_of("stability", f"{SUBJECT} start damping ratio passed", starts, "stability")
def stability(figure, rows):
    small = [abs(row["ratio"] - 1) for row in rows if row["held"]]
    lowest = min(rows, key=lambda row: row["ratio"])
    ends = f"a start of {lowest['start']} spacings ends at {lowest['ratio']:.2f} of it"
    line = f"where theory holds, measured limits differ from it by at most {100 * max(small):.2g}{SPACE}%" if small else ""
    figure.tell(listed(distinct(rows, "machine")), line or ends.replace(" of it", " of the limit of theory"), f"{line}; {ends}" if line else "")
    for (machine,), group in groups(rows, "machine").items():
        chart = figure.points(size=40, opacity=0.75).encode(
            x=alt.X("ratio:Q", title="measured limit / theory", scale=alt.Scale(zero=False),
                    axis=alt.Axis(tickCount=6)),
            y=alt.Y("kind:N", title="start in spacings, damping λ", sort=distinct(group, "kind")),
            yOffset=alt.YOffset("backend:N", sort=figure.backends))
        alternative = (f"Dot plot for {machine}: measured over theoretical limit of the time step, {len(group)} rows by "
                       f"{len(distinct(group, 'kind'))} starts.")
        figure.panel({"machine": machine}, chart, alternative, step=("kind", 44))


EDITS_HEIGHT = 300


def edit_panels(figure, machine, formulation, steps, group):
    """Draws each quantity: over the count of edits where there are several, otherwise a row for each strategy."""
    group, counts = labelled(group), sorted({row["edits"] for row in group})
    for key, heading, title in (("slower", "slow-down", "slower by (%)"),
                                ("edit_microseconds", "latency of an edit", "an edit by itself (µs)")):
        # Each quantity has its lines, and labels them.
        rows = [{**row, "quantity": key} for row in group if row[key] is not None]
        if not rows:
            continue
        values = [row[key] for row in rows]
        match = {"machine": machine, "formulation": formulation, "steps": steps, "quantity": key}
        among = f", {counts[0]} in {steps} steps" * (len(counts) == 1)
        name = f"{sentence(heading)}{among}, {formulation}, {machine}"
        if len(counts) == 1:
            chart = figure.points(size=45).encode(x=alt.X(f"{key}:Q", title=title, scale=scale(values)), y=label_axis(key))
            form = {"step": ("label", 18)}
        else:
            rows = with_end_labels(rows, "label", "edits", key, EDITS_HEIGHT)
            lines = source().encode(
                x=alt.X("edits:Q", title=f"edits in {steps} steps", scale=scale(counts), axis=alt.Axis(values=counts)),
                y=alt.Y(f"{key}:Q", title=title, scale=exact_scale(values)), color=figure.colour(), detail="label:N")
            chart = alt.layer(lines.mark_line(strokeWidth=1.4), figure.points(lines, size=45), *end_labels("edits", key))
            form = {"height": EDITS_HEIGHT}
        alternative = (f"{sentence(heading)} for {machine}, {formulation}, over {listed(map(str, counts))} edits in {steps} steps for "
                       f"{len(distinct(group, 'backend'))} backends.")
        figure.rows += rows
        figure.panel(match, chart, alternative, heading=name, **form)


@figure_of("edits", columns(f"{SUBJECT} edits steps slower edit_microseconds microseconds base study commit",
                            microseconds=("a step with edits (µs)", 4)),
           lambda _, rows: [row for row in reading.strategies(rows) if row["edits"] and row["without_edits"]])
def edits(figure, rows):
    rows = [{**row, "base": row["without_edits"] * 1e6, "end_label": None, "label_at": None,
             "slower": 100 * (row["microseconds"] / (row["without_edits"] * 1e6) - 1)} for row in rows]
    figure.rows, figure.results = [], [result for result in figure.results if any(row.get("edits") for row in result.lists["benchmarks"])]
    for (machine,), of_machine in groups(rows, "machine").items():
        told = []
        # Edits are dear or cheap beside the steps between them: each number of steps by itself, that with most rows first.
        for (steps,), group in sorted(groups(of_machine, "steps").items(), key=lambda item: -len(item[1])):
            middles = [(count, f"{statistics.median(row['slower'] for row in of_count):.2g}{SPACE}%")
                       for (count,), of_count in sorted(groups(group, "edits").items())]
            several = f"{middles[-1][0]} edit{'s' * (middles[-1][0] != 1)} slow {steps} steps down by {middles[-1][1]}"
            told.append((f"{several} in the median of {len(distinct(group, 'contender'))} strategies",
                         f"{steps} steps by " + ", ".join(f"{text} ({count} edit{'s' * (count != 1)})" for count, text in middles)))
            for formulation in distinct(group, "formulation"):
                of_formulation = [row for row in group if row["formulation"] == formulation]
                edit_panels(figure, machine, formulation, steps, of_formulation)
        figure.tell(machine, told[0][0], "edits slow, in the median of all strategies, " + listed(text for _, text in told))


HANDED_OVER = {"at once": "circle", "one by one": "diamond"}


@figure_of("overhead", f"{SUBJECT} handed_over steps microseconds host", latest_of(
    in_units("overhead", microseconds=("seconds_per_step", 1e6), host=("host_seconds_per_step", 1e6)), "scene", "contender", "handed_over"),
           "overhead", "backend handed_over")
def overhead(figure, rows):
    for (machine,), group in groups(rows, "machine").items():
        least = min(row["particles"] for row in group)
        small = [fastest(row for row in group if row["particles"] == least and row["handed_over"] == how) for how in HANDED_OVER]
        told = [(time_text(row["microseconds"]), row["handed_over"], row["label"]) for row in small if row]
        line = f"a step of {least} particles takes at least "
        figure.tell(machine, line + listed(f"{time} {how}" for time, how, _ in told),
                    line + listed(f"{time} with {label} where steps are handed over {how}" for time, how, label in told))
    for (machine, scene), group in groups(rows, "machine", "scene").items():
        times = [row["microseconds"] for row in group]
        points = figure.points(shape=figure.shape("handed_over", HANDED_OVER), size=55).encode(
            x=alt.X("microseconds:Q", title="time per step (µs)", scale=scale(times)), y=label_axis("microseconds"))
        alternative = (f"Dot plot for {scene} on {machine}: time per step of {len(distinct(group, 'label'))} strategies, handed over one by "
                       "one and at once.")
        figure.panel({"machine": machine, "scene": scene}, points, alternative, step=("label", 18),
                     heading=f"{scene}, {engineering(group[0]['particles'], 'particles')}, {machine}")


@figure_of("energy", f"{SUBJECT} millijoules springs_per_joule watts idle_watts microseconds throttled meter",
           latest_of(in_units("energy", millijoules=("joules_per_step", 1e3), microseconds=("seconds_per_step", 1e6)), "scene", "contender"),
           "energy")
def energy(figure, rows):
    for (machine,), group in groups(rows, "machine").items():
        told = []
        for (scene,), of_scene in sorted(groups(group, "scene").items(), key=lambda item: item[1][0]["particles"]):
            least = min(of_scene, key=lambda row: row["millijoules"])
            told.append(f"a step of {scene} takes {least['millijoules']:.3g}{SPACE}mJ with {least['label']}"
                        + f", the least of {len(of_scene)} strategies" * (len(of_scene) > 1))
        figure.tell(machine, told[-1], "; ".join(told) if len(told) > 1 else "")
    for (machine, scene), group in groups(rows, "machine", "scene").items():
        bars = source().mark_bar(height=11).encode(
            x=alt.X("millijoules:Q", title="energy per step (mJ)", scale=alt.Scale(zero=True)), y=label_axis("millijoules"),
            color=figure.colour(), tooltip=figure.tooltip())
        alternative = f"Bars for {scene} on {machine}: energy per step of {len(group)} strategies, in millijoules."
        figure.panel({"machine": machine, "scene": scene}, bars, alternative, step=("label", 24))


WAYS = {"none": "circle", "memory": "triangle-up", "mpi": "square", "peer": "diamond", "peer_overlap": "triangle-left",
        "stores": "cross", "stores_overlap": "triangle-right", "nccl": "triangle-down", "nccl_overlap": "wedge"}
BRICKS_ARE_LARGER = alt.condition("datum.parts === 'bricks'", alt.value(120), alt.value(45))


def over_ranks(figure, ranks, ranks_title, title):
    """What lines and points of efficiency over numbers of ranks share."""
    return source().encode(x=alt.X("ranks:Q", title=ranks_title, scale=scale(ranks), axis=alt.Axis(values=ranks, format="d")),
                           y=alt.Y("efficiency:Q", title=title, axis=alt.Axis(format="%"), scale=alt.Scale(domainMin=0)),
                           color=figure.colour(), detail=["contender:N", "way:N", "parts:N"])


@figure_of("scaling", columns("machine compared scaling scene contender ranks cut parts way microseconds compute exchange waiting "
                              "efficiency predicted noisy", scene=("scene", None)),
           latest_of(reading.scaling, "compared", "contender", "ranks", "cut", "way"), "scaling")
def scaling(figure, rows):
    several = [row for row in rows if row["ranks"] > 1]
    if not several:
        figure.rows = []
    for (machine,), group in groups(several, "machine").items():
        told = [row for row in group if not row["noisy"]] or group
        most = max(row["ranks"] for row in told)
        reached = [row["efficiency"] for row in told if row["ranks"] == most]
        figure.tell(machine, f"{most} ranks have {between(reached, percent)} of the efficiency of one", "")
    for (machine, compared), group in groups(rows, "machine", "compared").items():
        ranks = sorted(distinct(group, "ranks"))
        lines = over_ranks(figure, ranks, "ranks", "efficiency")
        predicted = lines.transform_filter("datum.ranks > 1").mark_line(strokeWidth=1.1, strokeDash=[2, 3]).encode(y="predicted:Q")
        chart = alt.layer(predicted, lines.mark_line(strokeWidth=1.4), figure.points(
            lines, figure.shape("way", WAYS)).encode(size=BRICKS_ARE_LARGER))
        alternative = (f"Lines for {compared} on {machine}: efficiency against one rank over {len(ranks)} numbers of ranks, and "
                       "dotted what the model predicts.")
        figure.panel({"machine": machine, "compared": compared}, chart, alternative, 300,
                     heading=f"{compared}, {group[0]['scaling']} scaling, {machine}")


@figure_of("forecast", columns("machine compared scaling contender parts way measured_ranks ranks microseconds efficiency half",
                               microseconds=("time per step, predicted (µs)", 3), efficiency=("efficiency, predicted", 3)),
           latest_of(reading.scaling_forecast, "compared", "contender", "parts", "way", "ranks"), "scaling")
def scaling_forecast(figure, rows):
    for (machine,), group in groups(rows, "machine").items():
        halves = [row["half"] for row in group if row["half"]]
        most = max(row["ranks"] for row in group)
        reached = [row["efficiency"] for row in group if row["ranks"] == most]
        finding = f"a model predicts {between(reached, percent)} of the efficiency of one for {most} ranks"
        half = f"{finding}, and half of it at {between(halves, lambda value: f'{value:.0f}')}" if halves else ""
        figure.tell(machine, finding, half)
    for (machine, compared), group in groups(rows, "machine", "compared").items():
        ranks = sorted(distinct(group, "ranks"))
        lines = over_ranks(figure, ranks, "ranks, none of them measured", "efficiency, predicted")
        chart = alt.layer(lines.mark_line(strokeWidth=1.1, strokeDash=[2, 3]), lines.mark_point(filled=False).encode(
            size=BRICKS_ARE_LARGER, shape=figure.shape("way", WAYS), tooltip=figure.tooltip()))
        alternative = (f"Dotted lines for {compared} on {machine}: the efficiency that a model predicts for {listed(map(str, ranks))} ranks. "
                       "Nothing of it was measured.")
        figure.panel({"machine": machine, "compared": compared}, chart, alternative, 300,
                     heading=f"Prediction: {compared}, {group[0]['scaling']} scaling, {machine}")


def rate_text(hertz):
    return f"{hertz / 1e3:.3g}{SPACE}kHz" if hertz >= 1e3 else f"{hertz:.3g}{SPACE}Hz"


def drawing_costs(rows):
    """By how much drawing lowers the steps that fit, of pairs of rows that differ in nothing else."""
    pairs = groups(rows, "scene", "contender", "hertz", "edited").values()
    fitting = [{row["drawn"]: row["steps_that_fit"] for row in pair} for pair in pairs]
    return [1 - pair["yes"] / pair["no"] for pair in fitting if pair.get("no") and "yes" in pair]


@figure_of("latency", f"{SUBJECT} hertz edited drawn pictures median p99 p999 worst missed ticks steps_that_fit",
           latest_of(reading.haptic, "scene", "contender", "hertz", "edited", "drawn"), "haptic")
def latencies(figure, rows):
    figure.rows = []
    for (machine,), group in groups(rows, "machine").items():
        highest = max(row["hertz"] for row in group)
        plain = [row for row in group if row["hertz"] == highest and (row["edited"], row["drawn"]) == ("no", "no")]
        line, more = f"{len(group)} rows are of edits or drawing alone", []
        if plain:
            first = min(plain, key=lambda row: row["p999"])
            within = sum(row["p999"] <= row["period"] for row in plain)
            line = (f"99.9{SPACE}% of the forces at {rate_text(highest)} are there within {time_text(first['p999'])} with {first['backend']}")
            more.append(f"the force of 99.9{SPACE}% of the ticks at {rate_text(highest)} is there in time in {within} of {len(plain)} "
                        f"rows, soonest with {first['contender']} on {first['scene']}: within {time_text(first['p999'])}")
        if costs := drawing_costs(group):
            more.append(f"drawing costs {percent(max(0, statistics.median(costs)))} of the steps that fit into a tick at the median")
        figure.tell(machine, line, "; ".join(more))
    for (machine, scene, hertz, edited), group in groups(rows, "machine", "scene", "hertz", "edited").items():
        for row in group:
            edges = [(reading.bin_begin(number), reading.bin_begin(number + 1), share) for number, share in sorted(row["bins"].items())]
            begins, ends, shares = ([reading.significant(value, 4) for value in values] for values in zip(*edges))
            figure.rows.append({**{key: row[key] for key in row if key != "bins"}, "begin": begins, "end": ends, "share": shares,
                               "label": row["label"] + ", drawn" * (row["drawn"] == "yes")})
        shown = figure.rows[-len(group):]
        period = group[0]["period"]
        domain = [min(period, *(row["begin"][0] for row in shown)) / 1.2, max(period, *(row["end"][-1] for row in shown)) * 1.2]
        x = alt.X("begin:Q", title="time to the force (µs)", axis=alt.Axis(format="~g"),
                  scale=alt.Scale(type="log", nice=False, domain=domain))
        # In the order of medians, what is drawn below the same that is not.
        by_median = groups(sorted(shown, key=lambda row: row["median"]), "contender")
        order = [row["label"] for rows_of in by_median.values() for row in sorted(rows_of, key=lambda row: row["drawn"])]
        y = alt.Y("label:N", title=None, sort=order, axis=LABEL_AXIS)
        floor = min(min(row["share"]) for row in shown)
        bins = source().transform_flatten(["begin", "end", "share"]).mark_rect(height=11).encode(
            x=x, x2="end:Q", y=y, color=figure.colour(), opacity=alt.Opacity("share:Q", legend=None, scale=alt.Scale(
                type="log", domain=[floor, 1], range=[0.15, 1])))
        marks = source().mark_point(filled=True, size=42, color="var(--ink)").encode(
            x="p999:Q", y=y, shape=figure.shape("family", SHAPES), tooltip=figure.tooltip())
        at_period = inline({"x": period, "text": "period"})
        rule = at_period.mark_rule(color="var(--ink)", strokeDash=[4, 4]).encode(x="x:Q")
        name = at_period.mark_text(dy=-3, baseline="bottom", color="var(--soft)").encode(x="x:Q", y=alt.value(0), text="text:N")
        alternative = (f"Histograms for {scene} at {rate_text(hertz)} on {machine}: a strip for each of {len(order)} rows, the darker "
                       "the more ticks took that time, with a line at the period of a tick.")
        with_edits = ", with edits" if edited == "yes" else ""
        figure.panel({"machine": machine, "scene": scene, "hertz": hertz, "edited": edited},
                     alt.layer(bins, rule, name, marks), alternative, step=("label", 16),
                     heading=f"{scene}, {rate_text(hertz)}{with_edits}, {machine}")


# What diff.py takes unless it is told otherwise.
RULE = comparison.Rule()


def judged(first, last):
    """By (dataset, strategy) the row that diff.py has for two files; empty, and why, where it refuses them."""
    try:
        found = comparison.document(first.path, last.path, RULE)
    except reading.BadInput as error:
        return {}, str(error)
    rows = [{**row, "contender": reading.short_contender(row["contender"])} for row in found["rows"] if row["time"]]
    return {(row["scene"], row["contender"]): row for row in rows}, ""


def changes(rows, first, last):
    """What became of the times between two files, in a line and in more words: the largest change that is one, and how many cannot
    be told."""
    commits = f"from commit {first.short_commit} to {last.short_commit}"
    counts = collections.Counter(row["verdict"] for row in rows)
    verdicts = listed(f"{counts[verdict]} {verdict}" for verdict in comparison.VERDICTS if counts[verdict])
    moved = [row for row in rows if row["verdict"] in ("slower", "faster")]
    if not moved:
        line = f"no change of a time in {first.study} can be told"
        return line, f"{line} {commits} ({verdicts})"
    row = max(moved, key=lambda row: abs(math.log(row["time"]["ratio"])))
    time = row["time"]
    line = f"{row['contender']} on {row['scene']} takes {time['ratio']:.2f} times its time, {first.study} at {last.short_commit}"
    return line, (f"the largest change {commits} is that of {row['contender']} on {row['scene']} ({first.study}), from "
            f"{time_text(time['old'] * 1e6)} to {time_text(time['new'] * 1e6)}, {time['ratio']:.2f} times "
            f"({time['interval'][0]:.2f} to {time['interval'][1]:.2f}); of {len(rows)} times {verdicts}")


@figure_of("history", columns("machine study scene backend contender commit day microseconds least most rounding verdict ratio interval",
                              ratio=("ratio of times", 4)), lambda _, rows: rows)
def history(figure, rows):
    """Studies of which one machine has several files; strategies that more than one of them has."""
    figure.rows, verdicts = [], {}
    for (machine, study), files in by_study(figure.all_results).items():
        verdicts[machine, study], refused = judged(files[0], files[-1])
        found = list(verdicts[machine, study].values())
        nothing = f"nothing can be told of {study}"
        figure.tell(machine, *(changes(found, files[0], files[-1]) if found else
                               (nothing, f"{nothing}: " + (refused or "its runs share no time"))))
    for (machine, study, scene), group in groups(rows, "machine", "study", "scene").items():
        runs = sorted({(row["date"], row["commit"]) for row in group})
        of_contender = [sorted(found, key=lambda row: row["date"]) for found in groups(group, "contender").values()]
        of_contender = [found for found in of_contender if len({row["date"] for row in found}) > 1]
        if not of_contender:
            continue
        ticks = {date: f"{commit} {date[5:16].replace('T', ' ')}" for date, commit in runs}
        for row in sum(of_contender, []):
            found = verdicts.get((machine, study), {}).get((scene, row["contender"]))
            low, high = found["time"]["interval"] if found else (None, None)
            figure.rows.append({**row, "run": ticks[row["date"]], "day": row["date"][:16].replace("T", " "),
                                "verdict": found["verdict"] if found else "not compared", "ratio": found["time"]["ratio"] if found else None,
                                "interval": "" if low is None else f"{low:.3f} to {high:.3f}"})
        ends = (min(row["least"] for found in of_contender for row in found),
                max(row["most"] for found in of_contender for row in found))
        lines = source().encode(
            x=alt.X("run:N", title="commit and date", sort=list(ticks.values()), axis=alt.Axis(
                labelAngle=0, labelOverlap="greedy", labelExpr="[slice(datum.value, 0, 7), slice(datum.value, 8)]")),
            y=alt.Y("microseconds:Q", title="time per step (µs)", scale=scale(ends, domain=ends)),
            color=figure.colour(), detail="contender:N")
        chart = alt.layer(lines.mark_line(strokeWidth=1.4), lines.mark_rule(strokeWidth=1.2).encode(
            y="least:Q", y2="most:Q"), figure.points(lines, size=45))
        alternative = (f"Lines for {scene}, study {study} on {machine}: time per step of {len(of_contender)} strategies in "
                       f"{len(runs)} runs.")
        figure.panel({"machine": machine, "study": study, "scene": scene}, chart, alternative, 300,
                     heading=f"{scene}, study {study}, {machine}")
    runs = {(row["machine"], row["study"], row["date"]) for row in figure.rows}
    figure.results = [result for result in figure.results if (result.machine, result.study, result.date) in runs]


MIN_SHARE = 1e-6


def by_study(results):
    """Files with times of one study on one machine, by date, where there are several."""
    found = groups((result for result in results if result.lists["benchmarks"]), lambda one: one.machine, lambda one: one.study)
    return {key: sorted(files, key=lambda file: file.date) for key, files in found.items() if len(files) > 1}


def gates(results, _):
    rows = []
    for row in reading.rows_of(latest_suites(results), "stress"):
        value, gate = row.get("measured"), row.get("gate")
        numbers = (value, gate) if row["gate_is"] == "at most" else (gate, value)
        # Zero has no place on a logarithmic axis.
        share = max(numbers[0] / numbers[1], MIN_SHARE) if all(numbers) else None
        if gate is not None:
            rows.append(row | {"measured": value, "unit": row.get("unit", ""), "detail": row.get("detail", ""), "share": share,
                               "passed": "yes" if row["passed"] else "no"})
    return rows


def latest_suites(results):
    """A machine's latest suite stands for it, whole."""
    return list({result.machine: result for result in results if result.lists["stress"]}.values())


@figure_of("stress", f"{SUBJECT} measurement steps measured gate_is gate unit detail passed", gates, "stress")
def stress(figure, rows):
    figure.results = latest_suites(figure.results)
    missed = [row for row in rows if row["passed"] == "no"]
    title = f"{len(rows) - len(missed)} of {len(rows)} gates of the stress suite hold"
    others = f"{title}; the others are of {listed(backend_order(set(distinct(missed, 'backend'))))}" if missed else ""
    figure.tell(listed(distinct(rows, "machine")), title, others)
    for (machine,), group in groups(rows, "machine").items():
        drawn = [row for row in group if row["share"]]
        if not drawn:
            continue
        chart = figure.points(source().transform_filter("isValid(datum.share)"), size=40, opacity=0.8).encode(
            x=alt.X("share:Q", title="measured, as a share of the gate", axis=alt.Axis(format="~e"),
                    scale=scale([row["share"] for row in drawn] + [1])),
            y=alt.Y("measurement:N", title=None, sort=distinct(group, "measurement"), axis=alt.Axis(labelLimit=130)))
        gate = inline({"share": 1}).mark_rule(color="var(--ink)").encode(x="share:Q")
        alternative = (f"Dot plot for {machine}: {len(drawn)} measurements over their gates, with a line where a gate is "
                       "reached.")
        figure.panel({"machine": machine}, alt.layer(gate, chart), alternative,
                     step=("measurement", 24))


def all_figures(results):
    """The backends of the page, and the figures that these results have something for in its order."""
    measured = reading.measured(results)
    backends = backend_order({row["backend"] for result in results for name in (*reading.MEASURED, "failed") for row in result.lists[name]})
    found = []
    for draw, name, told, make_rows, having, legend in DRAWN:
        if rows := make_rows(results, measured):
            figure = Figure(name, told, rows, results, having, legend, backends)
            draw(figure, rows)
            found += [figure] if figure.rows else []
    return backends, found
