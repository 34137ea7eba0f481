#!/usr/bin/env python3
"""Writes what `--backend auto` chooses by, harness/choice/auto_rules.json, from committed results.

Usage: auto_rules.py [--check]

For each API, for bodies that fill less than half of their lattice and for others, and for ranges of particle counts around the
bodies of `fastest` and `figure8`: its backends in the order of their times there, each with the tuning that was fastest. The
first one that a device has and that takes the scene is chosen; of a scene that is edited the first one whose edits do not cost it
its place: `edited` says how many steps there have to be between two of them. --check writes nothing and exits with 1 if the file is
not what the results say.
"""

import itertools
import json
import math
import pathlib
import sys

import result_files
from readme import rows
from result_files import groups

FILE = pathlib.Path(__file__).resolve().parent.parent / "harness/choice/auto_rules.json"
# Backends that take every scene: the faster one, which these studies do not measure, then the reference.
LAST = {"CPU": ["cpu_explicit", "cpu_reference"]}
# Ranges of the share of its lattice that a body fills.
OCCUPANCIES = ((0, 0.5), (0.5, None))
# Other bodies lack springs of their lattice; some of the fastest backends refuse these.
DATASETS = ("box", "heart")


def cards():
    """The machines with a card that have a committed study `fastest`."""
    return [folder.name for folder in sorted(rows.RESULTS.iterdir())
            if folder.name != rows.CPU and result_files.named(folder, "fastest").exists()]


def families():
    """(name of their limits, machines) of backends that rank among themselves, the fastest first: those of cards, and those of a
    machine without a card."""
    least = {}
    for machines in (tuple(cards()), (rows.CPU,)):
        for machine in machines:
            for row in rows.medians("fastest", machine):
                if row["on_card"] == (machine != rows.CPU):
                    family = row["limits_of"], machines
                    least[family] = min(least.get(family, math.inf), row["real_time"] / row["particles"])
    return sorted(least, key=least.get)


def bodies(family, machines, occupancy):
    """Particles of each body, ascending, and of each contender how many machines have measured it there and its time over the
    fastest's: the worst over machines, studies and formulations. The fastest is one that every machine with that body has measured,
    so that a contender that one of them lacks changes no ratio of the others there; it is judged by the machines that have it."""
    low, high = occupancy
    votes = {}
    for machine, study in itertools.product(machines, ("fastest", "figure8")):
        if not result_files.named(rows.RESULTS / machine, study).exists():  # the processor has no figure8
            continue
        of_bodies = [row for row in rows.medians(study, machine)
                     if row["limits_of"] == family and row["scene"].split("@")[0] in DATASETS and row["precision"] == "float32"
                     and low <= row["particles"] / row["voxels"] < (high or math.inf)]
        for (particles, _), own in groups(of_bodies, "particles", "formulation").items():
            votes.setdefault(particles, {}).setdefault(machine, []).append({contender(row): row["real_time"] for row in own})
    return sorted((particles, judged(of_machines)) for particles, of_machines in votes.items())


def judged(of_machines):
    """(machines, worst ratio) of each contender on a body, from the times of each vote of each machine."""
    measured = [set().union(*votes) for votes in of_machines.values()]
    everywhere = set.intersection(*measured)
    worst = {}
    for times in itertools.chain.from_iterable(of_machines.values()):
        fastest = min([time for one, time in times.items() if one in everywhere] or times.values())
        for one, time in times.items():
            worst[one] = max(worst.get(one, 0), time / fastest)
    return {one: (sum(one in of for of in measured), ratio) for one, ratio in worst.items()}


def contender(row):
    """The row's backend, and its tuning parameters that are not at their defaults: backend:key=value,..."""
    parts = rows.name_of(row).split("/")
    return ":".join([row["backend"], ",".join(parts[4:])]) if parts[4:] else row["backend"]


def order_of(contenders):
    """Each backend once, the fastest first: with its best tuning of those that the most machines have measured, since a file
    without the tuning could not judge the rule."""
    best = {}
    for one, (machines, worst) in contenders.items():
        backend = one.split(":")[0]
        best[backend] = min(best.get(backend, (0, math.inf, "")), (-machines, worst, one))
    return [one for _, _, one in sorted(best.values(), key=lambda found: found[1:])]


def rules():
    listed = []
    for name, machines in families():
        for occupancy in OCCUPANCIES:
            measured = bodies(name, machines, occupancy)
            orders = [order_of(worst) for _, worst in measured]
            # Backends that were not measured on this body (it is too large or they are too slow) come last, in their order on
            # the nearest other body.
            for here, order in enumerate(orders):
                for other in sorted(range(len(orders)), key=lambda other: abs(other - here)):
                    order += [one for one in order_of(measured[other][1]) if one.split(":")[0] not in {x.split(":")[0] for x in order}]
                order += LAST.get(name, [])
            bounds = [math.sqrt(one[0] * other[0]) for one, other in zip(measured, measured[1:])]
            for low, high, order in zip([0] + bounds, bounds + [None], orders):
                if listed and listed[-1]["of"] == name and listed[-1]["order"] == order and listed[-1]["occupancy"] == list(occupancy):
                    listed[-1]["particles"][1] = high and round(high)
                else:
                    listed.append({"of": name, "occupancy": list(occupancy), "particles": [round(low), high and round(high)],
                                   "order": order})
    return listed


def min_steps_between_edits():
    """For each CUDA backend that is slower than another one if edited often, and faster if edited rarely: from how
    many steps between edits on it is at most 10% slower. The other one is the fastest when they are most frequent."""
    times = {}
    for row in rows.medians("edits"):
        if row["family"] == "CUDA":
            times.setdefault(row["steps"] / row["edits"], {})[row["backend"]] = row["real_time"]
    intervals = sorted(times)
    other = min(times[intervals[0]], key=times[intervals[0]].get)
    bounds = {}
    for backend in sorted(times[intervals[0]]):
        keeps_up = [times[interval][backend] <= 1.1 * times[interval][other] for interval in intervals]
        if not keeps_up[0] and keeps_up[-1]:
            bounds[backend] = intervals[len(keeps_up) - keeps_up[::-1].index(False)]
    return bounds


def main():
    sources = (*itertools.product(("fastest", "figure8"), cards()), ("edits", rows.GPU), ("fastest", rows.CPU))
    commits = {f"{machine}/{study}": rows.result(study, machine)["context"]["voxspring"]["commit"]
               for study, machine in sources if result_files.named(rows.RESULTS / machine, study).exists()}
    blocks = ",\n".join("    " + json.dumps(rule) for rule in rules())
    edited = json.dumps({"min_steps_between_edits": min_steps_between_edits()})
    text = (f'{{\n  "made_by": "results/auto_rules.py",\n  "from": {json.dumps(commits)},\n  "edited": {edited},\n'
            f'  "rules": [\n{blocks}\n  ]\n}}\n')
    if "--check" in sys.argv[1:]:
        if not FILE.exists() or FILE.read_text() != text:
            sys.exit(f"{FILE.name} is not what the results say: run results/auto_rules.py")
    else:
        FILE.write_text(text)


if __name__ == "__main__":
    main()
