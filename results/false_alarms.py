#!/usr/bin/env python3
"""How often diff.py is wrong: compares pairs of results of one program on one card, between which nothing has changed, so that each row
that it calls faster, slower, or worse in its error is a false alarm.

Usage: false_alarms.py [--in-pairs] [--multiplied] [--threshold 0.05] [--cpu-clock] RESULT RESULT [RESULT...]

RESULT is a .json or .json.gz file of the same study; every two of them are a pair, or with --in-pairs each and the next. Seven runs are
twenty-one pairs:

    for i in 1 2 3 4 5 6 7; do voxspring study table1 --out table1-$i.json; done
    python3 results/false_alarms.py table1-*.json

--multiplied says as well what becomes of pairs whose second result has other times or errors, by the rule and by U and the interval alone.
--cpu-clock judges processor time, which other programs do not stop, instead of time: for one thread (OMP_NUM_THREADS=1).

Exit code: 0 there is none; 1 there are some; 2 bad input.
"""

import argparse
import collections
import itertools
import pathlib
import sys

import comparison
import diff
import result_files

ALARMS = ("faster", "slower", "error grew", "counter better", "counter worse", "now fails")
JUDGED = ("same", *ALARMS)
CHANGES = {"as they are": (1, 1), "second 1.1 times as slow": (1.1, 1), "second 1.1 times as fast": (1 / 1.1, 1),
           "second with twice the error": (1, 2)}
# How either rule decides: threshold, times of the noise, highest noise.
ALONE = (1e-9, 0, float("inf"))


def origin(path):
    """What two results have to have in common."""
    context = result_files.load(path)["context"]["voxspring"]
    cards = sorted({backend.get("uuid") or backend["device"] for backend in context["backends"].values()})
    return {"study": context["study"]["name"], "commit": context["commit"], "devices": ", ".join(cards)}


def compared(pair, rule, slow_down=1, error_growth=1):
    """The rows of two files, with the times and errors of the second multiplied."""
    old, new = (comparison.Result(path, False) for path in pair)
    comparison.rename(old, new)
    for row in sum(new.rows.values(), []):
        row.times = [slow_down * time for time in row.times]
        row.errors = {key: value and error_growth * value for key, value in row.errors.items()}
    return comparison.pair(old, new, rule)


def multiplied(pairs, threshold):
    """Prints what either rule says of each change."""
    own = (threshold, comparison.NOISE_FACTOR, comparison.HIGHEST_NOISE)
    for name, how in (("the rule", own), ("U and interval alone", ALONE)):
        least, comparison.NOISE_FACTOR, comparison.HIGHEST_NOISE = how
        for change, factors in CHANGES.items():
            judged = [compared(pair, comparison.Rule(least), *factors) for pair in pairs]
            failing = sum(any(row["verdict"] in comparison.WORSE for row in rows) for rows in judged)
            print(f"{name}, {change}: {failing} of {len(pairs)} pairs worse")
            rows = sum(judged, [])
            calm = [row for row in rows if row["time"] and row["time"]["noise"] <= comparison.CALM * threshold]
            for what, of in (("rows", rows), ("rows of little noise", calm)):
                counts = collections.Counter(row["verdict"] for row in of)
                print(f"    {len(of)} {what}: " + ", ".join(f"{counts[one]} {one}" for one in comparison.VERDICTS if counts[one]))
    _, comparison.NOISE_FACTOR, comparison.HIGHEST_NOISE = own


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--in-pairs", action="store_true")
    parser.add_argument("--multiplied", action="store_true")
    parser.add_argument("--threshold", type=diff.number_above(0), default=comparison.Rule.threshold)
    parser.add_argument("--cpu-clock", dest="clock", action="store_const", const="cpu_time", default=comparison.CLOCK)
    parser.add_argument("results", nargs="+", type=pathlib.Path, metavar="RESULT")
    options = parser.parse_args()
    comparison.CLOCK, paths = options.clock, options.results
    alarms, counts = [], collections.Counter()
    try:
        if len(paths) < 2:
            raise result_files.BadInput(f"command line: RESULT: {paths[0]} alone is not accepted; expected two or more")
        first = origin(paths[0])
        for path in paths[1:]:
            for key, value in origin(path).items():
                if value != first[key]:
                    raise result_files.BadInput(f"{path}: {key}: {value} is not accepted; expected {first[key]}, as {paths[0]} has")
        pairs = list(zip(paths[::2], paths[1::2])) if options.in_pairs else list(itertools.combinations(paths, 2))
        for pair in pairs:
            rows = compared(pair, comparison.Rule(options.threshold))
            counts.update(row["verdict"] for row in rows)
            alarms += [(row, " -> ".join(path.name for path in pair)) for row in rows if row["verdict"] in ALARMS]
        if options.multiplied:
            multiplied(pairs, options.threshold)
    except result_files.BadInput as error:
        diff.refuse(error)
    for row, where in alarms:
        ratio = f", x {row['time']['ratio']:.3f}" if row["time"] else ""
        print(f"{row['verdict']}: {row['scene']} {row['contender']}{ratio} ({where})")
    rest = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if verdict not in JUDGED)
    print(f"{len(pairs)} pairs of {first['study']} (commit {first['commit']}): {len(alarms)} false alarms in "
          f"{sum(counts[verdict] for verdict in JUDGED)} rows that can be judged" + f"; {rest}" * bool(rest))
    return 1 if alarms else 0


if __name__ == "__main__":
    sys.exit(main())
