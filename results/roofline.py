#!/usr/bin/env python3
"""Draws the roofline of a device from the result of a study that timed steps on it.

Usage: roofline.py RESULT.json --out FIGURE.svg [--out FIGURE.png] [--scene SCENE ...]

A panel a scene: every float32 row as a point, the operations of a step for each byte that it has to move against operations a
second, colour by backend, below the roofs that were measured in the same run: memory, only read or half written, cache, and
arithmetic. A strategy whose state stays on the chip moves no bytes: its points stand at the right edge, in a strip of their own. Of
a result that does not say what its steps move, as older ones, nothing is drawn.
"""

import argparse
import pathlib

import drawing

from page import reading

import matplotlib.pyplot as plt

plt.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e4e4e4",
                     "grid.linewidth": 0.6, "axes.axisbelow": True})

MARKERS = {"CUDA": "o", "Vulkan": ">", "OpenGL": "s", "CPU": "^", "another API": "D"}
DASHES = {"memory": "-", "memory, half written": "--", "cache": ":"}
SCENES = ("box@32", "box@256")
# How far right of the last roof's bend the strategies stand that move no bytes.
ON_CHIP = 1.9


def read_rows(result, scenes):
    """The float32 rows on the scenes that have their work."""
    return [row for row in reading.measured([result])
            if row["scene"] in scenes and row["precision"] == "float32" and row["operation_rate"]]


def ends_of(rows):
    """The axis of operations a byte: from half the least to twice the most."""
    known = [row["operations_a_byte"] for row in rows if row["operations_a_byte"]]
    return (min(known) / 2, 2 * max(known)) if known else (1, 100)


def draw_roofs(axes, rooflines, left, right):
    for family, (bandwidths, operations) in rooflines.items():
        bends = [operations / rate for rate in bandwidths.values()]
        ends = sorted({left, *bends, max(right, *bends)})
        for name, rate in bandwidths.items():
            heights = [min(operations, rate * x) * 1e-9 for x in ends]
            axes.plot(ends, heights, color="#444444", linewidth=1.1, linestyle=DASHES[name], zorder=2)
            if name in reading.ROOF_LABELS:
                axes.annotate(f"{family}: {reading.ROOF_LABELS[name]}", (left, heights[0]), xytext=(4, -3), va="top",
                              textcoords="offset points", fontsize=6)
        axes.annotate(f"{family}: float32 arithmetic", (ends[-1], operations * 1e-9), xytext=(-2, 2), fontsize=6,
                      textcoords="offset points", ha="right")


def draw_scene(axes, rows, limits, colours):
    left, right = ends_of(rows)
    roofs = reading.rooflines(limits, rows)
    draw_roofs(axes, roofs, left, right)
    bends = [operations / rate for bandwidths, operations in roofs.values() for rate in bandwidths.values()]
    # Beyond the roofs' end, where no number of operations a byte stands.
    edge = max(right, *bends, left)
    on_chip = edge * ON_CHIP
    if any(not row["operations_a_byte"] for row in rows):
        axes.axvspan(edge * ON_CHIP**0.5, edge * ON_CHIP**1.5, color="#f1f1f1", zorder=0)
        axes.annotate("on chip", (on_chip, 0), xycoords=("data", "axes fraction"), xytext=(0, 3), textcoords="offset points",
                      fontsize=6, ha="center")
        axes.set_xlim(left / 1.2, edge * ON_CHIP**1.5)
    for backend, colour in colours.items():
        points = [(row["operations_a_byte"] or on_chip, row["operation_rate"]) for row in rows if row["backend"] == backend]
        if points:
            axes.plot(*zip(*points), marker=MARKERS[reading.family(backend)], color=colour, markersize=4.5,
                      markeredgewidth=0, alpha=0.9, linestyle="none", zorder=3, label=backend)
    axes.set(xscale="log", yscale="log", xlabel="operations a byte")
    axes.set_title(rows[0]["scene"], loc="left", fontweight="bold")


def draw(rows, limits):
    scenes = sorted({row["scene"] for row in rows}, key=reading.natural)
    backends = sorted({row["backend"] for row in rows})
    palette = plt.get_cmap("tab20")
    colours = {backend: palette(index % 20) for index, backend in enumerate(backends)}
    figure, panels = plt.subplots(1, len(scenes), figsize=(4.8 * len(scenes) + 0.4, 4.8), sharey=True, squeeze=False,
                                  layout="constrained")
    for axes, scene in zip(panels[0], scenes):
        draw_scene(axes, [row for row in rows if row["scene"] == scene], limits, colours)
    panels[0][0].set_ylabel("operations a second (Gop/s)")
    handles = {label: handle for axes in panels[0] for handle, label in zip(*axes.get_legend_handles_labels())}
    columns = 2 * len(scenes)
    lines = -(-len(handles) // columns)
    figure.get_layout_engine().set(rect=(0, 0.035 * (1 + lines), 1, 1 - 0.035 * (1 + lines)))
    figure.legend(handles=list(handles.values()), labels=list(handles), loc="lower center", ncols=columns, frameon=False,
                  fontsize=7)
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=pathlib.Path, metavar="RESULT.json")
    parser.add_argument("--out", type=pathlib.Path, required=True, action="append", metavar="FIGURE.svg|.png")
    parser.add_argument("--scene", action="append", help="of the result; box@32 and box@256 unless said otherwise")
    options = parser.parse_args()
    for out in options.out:
        if out.suffix not in (".svg", ".png"):
            drawing.refuse(f"--out: {out}: expected a name that ends in .svg or .png")
    result = drawing.read(options.result, "benchmarks")
    scenes = options.scene or SCENES
    for scene in options.scene or ():
        if all(row["scene"] != scene for row in result.lists["benchmarks"]):
            drawing.refuse(f"--scene: {scene}: not in {options.result}; expected one of "
                           + ", ".join(sorted({row["scene"] for row in result.lists["benchmarks"]}, key=reading.natural)))
    rows = read_rows(result, scenes)
    if not rows:
        print(f"roofline.py: {options.result}: no figure: no float32 row on {' or '.join(scenes)} says what its step moves "
              "(step_bytes)")
        return
    drawing.save(draw(rows, result.limits), options.out)


if __name__ == "__main__":
    main()
