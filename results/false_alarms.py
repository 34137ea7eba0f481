#!/usr/bin/env python3
"""Compares every pair of results of one program on one card: nothing has changed between them, so that each row which
diff.py calls faster, slower, or worse in its error is a false alarm.

Usage: false_alarms.py RESULT RESULT [RESULT...]

RESULT is a .json or .json.gz file of the same study. Seven runs are twenty-one pairs:

    for i in 1 2 3 4 5 6 7; do voxspring study table1 --out table1-$i.json; done
    python3 results/false_alarms.py table1-*.json

Exit code: 0 there is none; 1 there are some; 2 bad input.
"""

import argparse
import collections
import itertools
import pathlib
import sys

import result_files
from diff import comparison, refuse

JUDGED = ("same", "faster", "slower", "error grew", "now fails")


def origin(path):
    """What two results have to have in common."""
    context = result_files.load(path)["context"]["voxspring"]
    cards = sorted({backend.get("uuid") or backend["device"] for backend in context["backends"].values()})
    return {"study": context["study"]["name"], "commit": context["commit"], "devices": ", ".join(cards)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", nargs="+", type=pathlib.Path, metavar="RESULT")
    paths = parser.parse_args().results
    counts, alarms = collections.Counter(), []
    try:
        if len(paths) < 2:
            raise result_files.BadInput(f"command line: RESULT: {paths[0]} alone is not accepted; expected two or more")
        first = origin(paths[0])
        for path in paths[1:]:
            for key, value in origin(path).items():
                if value != first[key]:
                    raise result_files.BadInput(f"{path}: {key}: {value} is not accepted; expected {first[key]}, as {paths[0]} has")
        pairs = list(itertools.combinations(paths, 2))
        for old, new in pairs:
            for row in comparison.document(old, new, comparison.Rule())["rows"]:
                counts[row["verdict"]] += 1
                if row["verdict"] in JUDGED[1:]:
                    alarms.append((row, f"{old.name} -> {new.name}"))
    except result_files.BadInput as error:
        refuse(error)
    for row, where in alarms:
        ratio = f", x {row['time']['ratio']:.3f}" if row["time"] else ""
        print(f"{row['verdict']}: {row['scene']} {row['contender']}{ratio} ({where})")
    judged = sum(counts[verdict] for verdict in JUDGED)
    rest = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if verdict not in JUDGED)
    print(f"{len(pairs)} pairs of {first['study']} (commit {first['commit']}): {len(alarms)} false alarms in {judged} rows that "
          f"can be judged" + (f"; {rest}" if rest else ""))
    return 1 if alarms else 0


if __name__ == "__main__":
    sys.exit(main())
