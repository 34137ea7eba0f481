"""Makes Vega-Lite of figures.vegalite, in which a few words stand for what follows from the rows of a panel.

"$name" stands for the value that the first row of the panel has under the key `name`, and "{name}" within a text for that value as
text. "$below" and "$end_labels" are layers. A field is written with its type, as "seconds:Q". A scale is "fit" (by scale()) or
"exact" (by exact_scale()), over the field or over the keys that it lists. The order "first" is that of the rows; the ticks "values"
are the field's values in the rows. The encodings "backend", "family", "region" and those in "marks" are by these keys, in shapes or
in the colours of the page's style, so that charts follow its light, dark and printed scheme. The tooltip "row" has the table's
columns.
"""

import hashlib
import json
import math

import numpy
import scipy.optimize

from result_files import distinct, groups

from . import reading, text_of

LANGUAGE = "https://vega.github.io/schema/vega-lite/v6.json"
ABOUT = json.loads(text_of("figures.vegalite"))
MARKS = ABOUT["marks"]
TYPES = {"Q": "quantitative", "N": "nominal", "O": "ordinal"}
# COLOURS: the number of colours for backends in page.css. SHAPES: the marks of families of backends.
COLOURS = 22
SHAPES = ("diamond", "triangle-right", "triangle-up", "circle", "square")
# Chosen so that no two backends, and no two APIs, of this repository hash to the same number.
SALT = 3942899
LABEL_SIZE = ABOUT["end_labels"][1]["mark"]["fontSize"]
CONFIG = {
    "background": "transparent", "font": "system-ui, sans-serif", "view": {"stroke": None},
    "axis": {"labelColor": "var(--soft)", "titleColor": "var(--soft)", "gridColor": "var(--line)", "domainColor": "var(--line)",
             "tickColor": "var(--line)", "gridOpacity": 0.45, "labelFontSize": 11, "titleFontSize": 12, "titleFontWeight": "normal",
             "labelOverlap": "greedy", "labelSeparation": 4},
    "axisYQuantitative": {"minExtent": 38}, "point": {"opacity": 1}}


def places(names, count):
    """{name: a number below `count`}: that of the name's hash, so that it is the same on every page, or the next free number."""
    found = {}
    for name in sorted(names):
        first = int.from_bytes(hashlib.md5(f"{SALT}{name}".encode()).digest(), "big")
        others = found.values() if len(found) < count else ()
        found[name] = next(place for place in ((first + step) % count for step in range(count)) if place not in others)
    return found


def colours(backends):
    return {name: f"var(--backend-{place})" for name, place in places(backends, COLOURS).items()}


def shapes(families):
    return {name: SHAPES[place] for name, place in places(set(families), len(SHAPES)).items()}


def variables(names):
    """The colours of the page's style (CSS variables) with these names."""
    return {name: f"var(--{name})" for name in names}


def scale(values):
    """A logarithmic scale if the values are positive and span more than a decade, otherwise a linear one."""
    positive = [value for value in values if value is not None]
    wide = positive and min(positive) > 0 and max(positive) > 10 * min(positive)
    return {"type": "log", "nice": False} if wide else {"type": "linear", "nice": True}


def exact_scale(values):
    """A scale that ends where the values do."""
    found = scale(values) | {"nice": False, "domain": [min(values), max(values)]}
    return found if found["type"] == "log" else found | {"zero": False}


def told_apart(key, names):
    """An encoding that tells the values of `key` apart. `names` has the colour or shape of each value."""
    return {"field": key, "type": "nominal", "legend": None, "scale": {"domain": list(names), "range": list(names.values())}}


def drawn(points, mark):
    """A layer of points (x, y, text) that are given here, not taken from rows of the figure."""
    points = [dict(zip(("x", "y", "text"), point)) for point in points]
    encoding = {key: {"field": key, "type": "nominal" if key == "text" else "quantitative"} for key in points[0]}
    return {"data": {"values": points}, "mark": {"color": "var(--soft)"} | mark, "encoding": encoding}


def line(points, **style):
    return drawn(points, {"type": "line", "strokeWidth": 1} | style)


def name_at(x, y, text, **style):
    return drawn([(x, y, text)], {"type": "text"} | style)


def columns(keys, named=None):
    """(key, name, digits) of the columns of a table. A word in capitals is a set of keys. `named`: names for this table alone."""
    known = ABOUT["columns"] | (named or {})
    return [(key, *known.get(key, (key, None))) for word in keys.split(" ") for key in ABOUT["sets"].get(word, word).split(" ")]


def near_each_other(ends, x, shown):
    """Groups `ends`, the last rows of lines, whose labels would overlap: within a group each end is near the
    next one along `x`. `shown`: all values along `x`."""
    reach = 0.25  # fraction of the width of a chart: a label takes up to a third, but two labels this far apart seldom meet
    forth = numpy.log if scale(shown)["type"] == "log" else numpy.asarray
    ends = sorted(ends, key=lambda row: row[x])
    apart = numpy.diff(forth([row[x] for row in ends])) > reach * numpy.ptp(forth(shown))
    return numpy.split(numpy.asarray(ends), numpy.flatnonzero(apart) + 1)


def with_end_labels(rows, line, x, y, height):
    """Adds a label (`end_label`) and its place (`label_at`) to the last row of each line, such that labels do not overlap in a chart of
    this height, and to all rows the keys along its axes (`end_x`, `end_y`)."""
    values = [row[y] for row in rows]
    log = scale(values)["type"] == "log"
    forth, back = (math.log, math.exp) if log else (float, float)
    low, high = forth(min(values)), forth(max(values))
    gap = (LABEL_SIZE + 1) * ((high - low) / height or 1)
    ends = [max(group, key=lambda row: row[x]) for group in groups(rows, line).values()]
    at = {}
    for beside in near_each_other(ends, x, [row[x] for row in rows]):
        beside = sorted(beside, key=lambda row: row[y])
        # Places for labels: ascending, at least `gap` apart, as near to the ends of the lines as possible.
        steps = gap * numpy.arange(len(beside))
        apart = scipy.optimize.isotonic_regression(numpy.asarray([forth(row[y]) for row in beside]) - steps).x + steps
        at |= {id(row): back(place) for row, place in zip(beside, apart)}
    return [{**row, "end_x": x, "end_y": y, "end_label": row[line] if id(row) in at else None, "label_at": at.get(id(row))}
            for row in rows]


class Chart:
    """Makes the Vega-Lite of a panel's chart, from its description in figures.vegalite and the panel's rows."""

    def __init__(self, families, told, rows, below):
        self.told, self.rows, self.layers = told, rows, {"$below": below, "$end_labels": ABOUT["end_labels"]}
        self.values = rows[0] | {"backends": list(families)}
        self.by_key = {
            "backend": told_apart("backend", colours(families)),
            "family": told_apart("family", shapes(families.values())), "region": told_apart("region", variables(reading.REGIONS))}

    def encoding(self, channel, key):
        """The encoding that a word of figures.vegalite stands for."""
        if channel == "tooltip":
            told = self.told if key == "row" else columns(key)
            return [{"field": key, "title": title} |
                    ({"type": "nominal"} if digits is None else {"type": "quantitative", "format": f".{digits}~g"})
                    for key, title, digits in told]
        if key in self.by_key:
            return self.by_key[key]
        return told_apart(key, variables(MARKS[key]) if channel == "color" else MARKS[key])

    def completed(self, value):
        """A part of a chart, with its words replaced by what they stand for."""
        if isinstance(value, str):
            return self.values[value[1:]] if value.startswith("$") else value.format_map(self.values) if "{" in value else value
        if isinstance(value, list):
            return [self.completed(one) for part in value for one in (self.layers[part] if part in list(self.layers) else [part])]
        if not isinstance(value, dict):
            return value
        found = {key: self.completed(one) for key, one in value.items()}
        if "encoding" in value:
            found["encoding"] = {channel: self.encoding(channel, one) if isinstance(one, str) else self.completed(one)
                                 for channel, one in value["encoding"].items()}
        field, _, kind = str(found.get("field", "")).partition(":")
        return self.with_axis(found | {"field": field, "type": TYPES[kind]}) if kind else found

    def with_axis(self, found):
        """An encoding with its title, scale, order and ticks."""
        if "scale" in found:
            if found["field"] in ABOUT["columns"]:
                found.setdefault("title", ABOUT["columns"][found["field"]][0])
            how = {found["scale"]: [found["field"]]} if isinstance(found["scale"], str) else found["scale"]
            for name, make in (("fit", scale), ("exact", exact_scale)):
                if name in how:
                    found["scale"] = make([row[key] for key in how[name] for row in self.rows])
        if found.get("sort") == "first":
            found["sort"] = distinct(self.rows, found["field"])
        if found.get("axis", {}).get("values") == "values":
            found["axis"] = found["axis"] | {"values": sorted(distinct(self.rows, found["field"]))}
        return found


def complete(about, families, told, rows, below, alternative):
    """The chart of a panel. It is as wide as the panel, and shows only the rows that pass the filters of the page."""
    chosen = {"filter": "indexof(shown, datum.backend) >= 0 && (scene == '' || datum.scene == scene)"}
    return {"$schema": LANGUAGE, "data": {"name": "rows"}, "transform": [chosen], "width": "container",
            "height": about.get("height") or about["step"][1], "autosize": {"type": "fit-x", "contains": "padding"},
            "description": alternative,
            "params": [{"name": "shown", "value": list(families)}, {"name": "scene", "value": ""}],
            **Chart(families, told, rows, below).completed(about["chart"])}
