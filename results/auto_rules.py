#!/usr/bin/env python3
"""Writes the rules by which `--backend auto` chooses, harness/choice/auto_rules.json, from committed results.

Usage: auto_rules.py [--check]

A rule is for one API, formulations by increments or the others, bodies that fill less than half of their lattice or the others, and
a range of particle counts around a body of the studies `fastest` and `figure8`. It lists the API's backends, the fastest on that
body first, each with its fastest tuning; rows that their run marked as not to be trusted do not count. `auto` takes the first one
that the device has and that takes the scene, but none in software and none that reports that another backend is faster. If the scene
has edits, `auto` passes over a backend that `edited` lists unless edits are on average at least as many steps apart as it says there.
--check writes nothing and exits with 1 if the file is not what the results say.
"""

import itertools
import json
import math
import pathlib
import sys

from readme import rows

FILE = pathlib.Path(__file__).resolve().parent.parent / "harness/choice/auto_rules.json"
# Backends that take every scene, for the end of a list. cpu_explicit, which these studies do not measure, is faster than
# cpu_reference.
LAST = {"CPU": ["cpu_explicit", "cpu_reference"]}
# Ranges of the share of its lattice that a body fills.
OCCUPANCIES = ((0, 0.5), (0.5, None))
# Formulations by increments, in which a spring takes about twice as many instructions (by_increments() in C++).
BY_INCREMENTS = ("increment", "compensated")
# The datasets that make rules. Other bodies lack springs of their lattice, and some of the fastest backends refuse them.
DATASETS = ("box", "heart")


def cards():
    """The machines with a card that have a committed study `fastest`."""
    return [machine for machine in rows.having("fastest") if machine != rows.CPU]


def families():
    """[(API, machines)]: the backends of an API are ranked together, over all machines with a card or on the processor's machine.
    An API is named by the key of its limits. The API with the fastest row comes first."""
    least = {}
    for machines in (tuple(cards()), (rows.CPU,)):
        for machine in machines:
            for row in rows.medians("fastest", machine):
                if row["on_card"] == (machine != rows.CPU):
                    family = row["limits_of"], machines
                    least[family] = min(least.get(family, math.inf), row["real_time"] / row["particles"])
    return sorted(least, key=least.get)


def bodies(family, machines, increments, occupancy):
    """[(number of particles, contenders with the fastest first)] of the bodies, by ascending number of particles."""
    import pandas  # pylint: disable=import-outside-toplevel  # tests of other scripts import this one beside another NumPy
    low, high = occupancy
    # The machine without a card has no study figure8.
    files = [(machine, study) for study in ("fastest", "figure8") for machine in machines if machine in rows.having(study)]
    times = pandas.DataFrame([
        {"particles": row["particles"], "machine": machine, "vote": f"{machine} {study} {row['formulation']} {row['steps']}",
         "contender": contender(row),
         "backend": row["backend"], "time": row["real_time"]}
        for machine, study in files for row in rows.medians(study, machine)
        if not row.get("noisy") and row["limits_of"] == family and row["precision"] == "float32"
        and row["scene"].split("@")[0] in DATASETS and (row["formulation"] in BY_INCREMENTS) == increments
        and low <= row["particles"] / row["voxels"] < (high or math.inf)])
    return [(particles, order_of(body)) for particles, body in times.groupby("particles")] if len(times) else []


def contender(row):
    """The row's backend, and its tuning parameters that are not at their defaults: backend:key=value,..."""
    parts = rows.name_of(row).split("/")
    return ":".join([row["backend"], ",".join(parts[4:])]) if parts[4:] else row["backend"]


def order_of(body):
    """The contenders from the fastest on, each backend once with its best tuning.

    Only those tunings of a backend are candidates that the most machines have measured, since a file without a
    tuning cannot judge it. A contender is ranked by its time over that of the fastest: by the worst such ratio
    over machines, studies and formulations. The fastest is taken among the contenders that every machine with
    this body has measured. So a contender that one machine lacks changes no ratio of the others there, and is
    itself judged by the machines that have it. A vote on one contender alone compares nothing, and counts only if
    the contender has no other.
    """
    alone = body.groupby("vote").contender.transform("nunique") == 1
    body = body[~alone | ~body.contender.isin(body.contender[~alone])]
    everywhere = body.groupby("contender").machine.transform("nunique") == body.machine.nunique()
    fastest = body.time.where(everywhere).groupby(body.vote).transform("min").fillna(body.groupby("vote").time.transform("min"))
    known = body.assign(ratio=body.time / fastest).groupby(["backend", "contender"], as_index=False).agg(
        machines=("machine", "nunique"), worst=("ratio", "max"))
    best = known.sort_values(["machines", "worst", "contender"], ascending=[False, True, True]).drop_duplicates("backend")
    return list(best.sort_values(["worst", "contender"]).contender)


def rules():
    listed = []
    for name, machines in families():
        for increments, occupancy in itertools.product((False, True), OCCUPANCIES):
            measured = bodies(name, machines, increments, occupancy)
            # Backends that were not measured on this body, as it is too large or they are too slow, come last, in their order on
            # the body that is nearest in size.
            orders = [list(order) for _, order in measured]
            for here, order in enumerate(orders):
                for _, other in sorted(enumerate(measured), key=lambda one: abs(one[0] - here)):
                    order += [one for one in other[1] if one.split(":")[0] not in {x.split(":")[0] for x in order}]
                order += LAST.get(name, [])
            bounds = [math.sqrt(one[0] * other[0]) for one, other in zip(measured, measured[1:])]
            for low, high, order in zip([0] + bounds, bounds + [None], orders):
                kind = {"of": name, "increments": increments, "occupancy": list(occupancy)}
                if listed and listed[-1]["order"] == order and listed[-1].items() >= kind.items():
                    listed[-1]["particles"][1] = high and round(high)
                else:
                    listed.append(kind | {"particles": [round(low), high and round(high)], "order": order})
    return listed


def min_steps_between_edits():
    """{CUDA backend: the least number of steps between edits from which on it keeps up}. A backend keeps up if it takes at most 10%
    longer than the backend that is the fastest with the most frequent edits. Only backends are listed that do not keep up with the
    most frequent edits, but do with the rarest."""
    import pandas  # pylint: disable=import-outside-toplevel
    times = pandas.DataFrame([{"interval": row["steps"] / row["edits"], "backend": row["backend"], "time": row["real_time"]}
                              for row in rows.medians("edits") if row["family"] == "CUDA"])
    times = times.pivot_table(index="interval", columns="backend", values="time", aggfunc="last")
    keeps_up = times.le(1.1 * times[times.iloc[0].idxmin()], axis="index")
    # `keeps` is true for intervals at which the backend does not keep up. The result is the interval after the last of these.
    return {backend: times.index[keeps.to_numpy().nonzero()[0][-1] + 1]
            for backend, keeps in (~keeps_up).items() if keeps.iloc[0] and not keeps.iloc[-1]}


def main():
    check = rows.is_check(__doc__)
    sources = (*itertools.product(("fastest", "figure8"), cards()), ("edits", rows.GPU), ("fastest", rows.CPU))
    commits = {f"{machine}/{study}": rows.result(study, machine)["context"]["voxspring"]["commit"]
               for study, machine in sources if machine in rows.having(study)}
    blocks = ",\n".join("    " + json.dumps(rule) for rule in rules())
    edited = json.dumps({"min_steps_between_edits": min_steps_between_edits()})
    text = (f'{{\n  "made_by": "results/auto_rules.py",\n  "from": {json.dumps(commits)},\n  "edited": {edited},\n'
            f'  "rules": [\n{blocks}\n  ]\n}}\n')
    if check:
        if not FILE.exists() or FILE.read_text() != text:
            sys.exit(f"{FILE.name} does not agree with the committed results: run results/auto_rules.py")
    else:
        FILE.write_text(text)


if __name__ == "__main__":
    main()
