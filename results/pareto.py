#!/usr/bin/env python3
"""Draws run time against error, and error against time step, from the result of a study of kind pareto.

Usage: pareto.py RESULT.json --out FIGURE.svg [--out FIGURE.png]

Above, one panel a scene: every run as a point, run time to the scene's end time against its total error, colour by
formulation and shape by precision, and the Pareto front of each device as a line. Below, the same scene's total error
against the time step, one line a formulation and precision (over backends the median: they round alike), which turns up
where rounding overtakes discretisation, with the float64 line of second order for comparison.
"""

import argparse
import pathlib
import statistics

import drawing

import matplotlib.pyplot as plt
from matplotlib.lines import Line2D

plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e4e4e4",
                     "grid.linewidth": 0.6, "axes.axisbelow": True})

# Okabe and Ito's palette, which colour-blind readers tell apart too.
COLOURS = {"paper": "#D55E00", "position": "#E69F00", "displacement": "#56B4E9", "increment": "#0072B2",
           "compensated": "#009E73"}
MARKERS = {"float32": "o", "float64": "s"}
DASHES = {"float32": "-", "float64": ":"}
FRONTS = ["-", "--", "-.", ":"]


def read_rows(path):
    """Rows with a time and a total error, in the order of the file."""
    rows = [row for row in drawing.read(path, "pareto").lists["pareto"]
            if row.get("seconds") and row.get("total_error_relative_l2")]
    if not rows:
        drawing.refuse(f"{path}: pareto: no row has a time and a total error")
    for row in rows:
        for key, known in (("formulation", COLOURS), ("precision", MARKERS)):
            if row[key] not in known:
                drawing.refuse(f"{path}: pareto: {key}: {row[key]!r}: expected one of {', '.join(known)}")
    return rows


def short(device):
    """A device's name without what its maker adds."""
    return device.split(" (")[0].split("/")[0].strip()


def draw_fronts(axes, rows):
    alike = {}
    for row in rows:
        alike.setdefault((row["formulation"], row["precision"], row["on_front"]), []).append(
            (row["seconds"], row["total_error_relative_l2"]))
    for (formulation, precision, on_front), points in alike.items():
        axes.plot(*zip(*points), marker=MARKERS[precision], color=COLOURS[formulation], markersize=5 if on_front else 3.2,
                  alpha=1 if on_front else 0.4, markeredgewidth=0, linestyle="none", zorder=3, rasterized=True)
    devices = list(dict.fromkeys(row["device"] for row in rows))
    for device, style in zip(devices, FRONTS * len(devices)):
        front = sorted((row["seconds"], row["total_error_relative_l2"]) for row in rows
                       if row["on_front"] and row["device"] == device)
        axes.step(*zip(*front), where="post", color="#444444", linewidth=1.1, linestyle=style, zorder=2,
                  label=f"front on {short(device)}")
    axes.set(xscale="log", yscale="log", xlabel=f"run time to t = {rows[0]['end_time']:.3g} (s)")


def draw_curves(axes, rows):
    for precision, dashes in DASHES.items():
        for formulation, colour in COLOURS.items():
            errors = {}
            for row in rows:
                if (row["formulation"], row["precision"]) == (formulation, precision):
                    errors.setdefault(row["fraction_of_stable"], []).append(row["total_error_relative_l2"])
            if errors:
                curve = sorted((fraction, statistics.median(values)) for fraction, values in errors.items())
                axes.plot(*zip(*curve), color=colour, linestyle=dashes, marker=MARKERS[precision], markersize=3,
                          linewidth=1.2)
    fractions = sorted({row["fraction_of_stable"] for row in rows})
    axes.set(xscale="log", yscale="log", xlabel="time step, as a fraction of the stable one")
    axes.set_xticks(fractions, [f"1/{1 / fraction:.3g}" for fraction in fractions])
    axes.minorticks_off()


def draw(rows):
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    figure, panels = plt.subplots(2, len(scenes), figsize=(4.2 * len(scenes) + 0.4, 7.2), sharey="col", squeeze=False,
                                  layout="constrained")
    for column, scene in enumerate(scenes):
        of_scene = [row for row in rows if row["scene"] == scene]
        draw_fronts(panels[0][column], of_scene)
        draw_curves(panels[1][column], of_scene)
        panels[0][column].set_title(scene, loc="left", fontweight="bold")
    for row in panels:
        row[0].set_ylabel("total error (relative L2)")
    used = {(row["formulation"], row["precision"]) for row in rows}
    handles = [Line2D([], [], color=colour, linewidth=2, label=name)
               for name, colour in COLOURS.items() if any(name == formulation for formulation, _ in used)]
    handles += [Line2D([], [], color="#444444", marker=MARKERS[name], markersize=4, linestyle=DASHES[name], label=name)
                for name in DASHES if any(name == precision for _, precision in used)]
    fronts = [panel.get_legend_handles_labels() for panel in panels[0]]
    handles += list({label: line for lines, labels in fronts for line, label in zip(lines, labels)}.values())
    figure.get_layout_engine().set(rect=(0, 0.05, 1, 0.95))
    figure.legend(handles=handles, loc="lower center", ncols=-(-len(handles) // (1 if len(scenes) > 1 else 2)),
                  frameon=False)
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=pathlib.Path, metavar="RESULT.json")
    parser.add_argument("--out", type=pathlib.Path, required=True, action="append", metavar="FIGURE.svg|.png")
    options = parser.parse_args()
    for out in options.out:
        if out.suffix not in (".svg", ".png"):
            drawing.refuse(f"--out: {out}: expected a name that ends in .svg or .png")
    drawing.save(draw(read_rows(options.result)), options.out)


if __name__ == "__main__":
    main()
