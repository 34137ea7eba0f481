#!/usr/bin/env python3
"""Draws a stability study: the map of damping against time step, and measured limits over theory.

Usage: stability.py FILE --out FILE.svg

FILE is the result of `voxspring study stability --out FILE` (schema.json). The same result gives the same bytes.
"""

import argparse
import pathlib

import drawing

import matplotlib.pyplot as plt
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

# Okabe and Ito's palette, which colour-blind readers tell apart; the letters say the same.
REGIONS = {"bounded": "#56b4e9", "heating": "#f0e442", "diverged": "#d55e00"}
MARKERS = ["o", "s", "^", "D", "v", "P", "X", "*"]
COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9", "#000000", "#f0e442"]


def draw_map(axes, row):
    names = list(REGIONS)
    cells = [[names.index(region) for region in line] for line in row["region"]]
    axes.imshow(cells, cmap=ListedColormap(REGIONS.values()), vmin=0, vmax=len(names) - 1, origin="lower",
                aspect="auto", interpolation="nearest")
    for y, line in enumerate(row["region"]):
        for x, region in enumerate(line):
            axes.text(x, y, region[0], ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(row["fraction"])), [f"{f:g}" for f in row["fraction"]])
    axes.set_yticks(range(len(row["damping"])), [f"{d:g}" for d in row["damping"]])
    axes.set_xlabel("time step / limit at that damping")
    axes.set_ylabel("damping")
    axes.set_title(f"{row['name']}: a random start of ±{row['amplitude']:g} spacings after {row['steps']} steps",
                   fontsize=9)
    axes.legend(handles=[Patch(color=colour, label=name) for name, colour in REGIONS.items()],
                loc="upper center", bbox_to_anchor=(0.5, -0.14), ncol=3, frameon=False)


def start_of(row):
    start = row["start"]
    shape = "stretched" if start["kind"] == "stretched" else f"±{start['amplitude']:g}"
    return f"{shape}\nλ={row['damping']:g}"


def draw_ratios(axes, rows):
    starts = list(dict.fromkeys(start_of(row) for row in rows))
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    for s, scene in enumerate(scenes):
        points = [(starts.index(start_of(row)) + 0.12 * (s - (len(scenes) - 1) / 2), row["ratio"])
                  for row in rows if row["scene"] == scene]
        axes.plot(*zip(*points), MARKERS[s % len(MARKERS)], color=COLOURS[s % len(COLOURS)], markersize=4,
                  label=scene, linestyle="none", rasterized=True)
    axes.axhline(1, color="black", linewidth=0.8)
    axes.set_xticks(range(len(starts)), starts)
    axes.set_xlabel("start, in spacings, and damping λ")
    axes.set_ylabel("measured limit / theory")
    axes.set_title("Largest stable time step, a point a backend and formulation", fontsize=9)
    axes.grid(axis="y", linewidth=0.3)
    axes.legend(frameon=False)


def main():
    parser = argparse.ArgumentParser(description="Draws the result of a stability study.")
    parser.add_argument("file", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True, help="an .svg file")
    arguments = parser.parse_args()
    if arguments.out.suffix != ".svg":
        drawing.refuse(f"--out: {arguments.out}: expected a name that ends in .svg")
    lists = drawing.read(arguments.file, "stability").lists
    rows, maps = lists["stability"], lists["stability_map"]
    figure, axes = plt.subplots(1 + len(maps), 1, figsize=(7.5, 4.4 * (1 + len(maps))), squeeze=False,
                                constrained_layout=True)
    draw_ratios(axes[0][0], rows)
    for panel, row in zip(axes[1:], maps):
        draw_map(panel[0], row)
    drawing.save(figure, [arguments.out])


if __name__ == "__main__":
    main()
