"""The figures of the page as files, for documents that show only pictures: an SVG per panel, in the light colours, with legends."""

import json
import re

import vl_convert

from . import charts, figures, text_of

WIDTH = 480
# Vega writes attributes to a millionth of a pixel. These patterns find the digits beyond a hundredth, to cut them off.
ATTRIBUTE, DIGITS = re.compile(r'="[^"]*"'), re.compile(r"(\d\.\d\d)\d+")


def with_legends(spec, rows):
    """The chart with legends for its colours, shapes and dashes. They list only the values that occur in its rows."""
    if isinstance(spec, list):
        return [with_legends(one, rows) for one in spec]
    if not isinstance(spec, dict):
        return spec
    spec = {key: with_legends(value, rows) for key, value in spec.items() if not (key == "legend" and value is None)}
    scale = spec.get("scale") or {}
    domain = scale.get("domain")
    if "range" in scale and isinstance(domain, list) and all(isinstance(name, str) for name in domain):
        values = {row.get(spec.get("field")) for row in rows}
        kept = [(name, shown) for name, shown in zip(domain, scale["range"]) if name in values]
        spec["scale"] = scale | {"domain": [name for name, _ in kept], "range": [shown for _, shown in kept]}
    return spec


def svg(figure, panel):
    rows = [row for row in figure.rows if all(row[key] == value for key, value in panel.match.items())]
    spec = with_legends(panel.spec, rows) | {"width": WIDTH, "autosize": "pad", "title": {"text": panel.heading, "anchor": "start"}}
    spec["datasets"] = spec.get("datasets", {}) | {"rows": rows}
    spec["config"] = charts.CONFIG | {"background": "white", "aria": False, "font": "DejaVu Sans, sans-serif"}
    if panel.step:
        spec["height"] = panel.step[1] * len({row[panel.step[0]] for row in rows})
    # The colours of the light scheme, which stand before the first @media in page.css.
    colours = dict(re.findall(r"(--[\w-]+): (#\w+);", text_of("page.css").partition("@media")[0]))
    spec = re.sub(r"var\((--[\w-]+)\)", lambda name: colours[name[1]], json.dumps(spec))
    return ATTRIBUTE.sub(lambda found: DIGITS.sub(r"\1", found[0]), vl_convert.vegalite_to_svg(spec))


def files(results):
    """(file name, text) of every panel of every figure."""
    for figure in figures.all_figures(results)[1]:
        for panel in figure.panels:
            yield re.sub(r"[^\w@.]+", "-", f"{figure.name}-{panel.heading}").strip("-") + ".svg", svg(figure, panel)
