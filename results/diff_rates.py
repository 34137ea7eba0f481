#!/usr/bin/env python3
"""How often diff.py is wrong: runs one build in pairs and judges each pair, as it is and with the new one changed.

Usage: diff_rates.py [--pairs 20] [--threshold 0.05] [--cpu-clock] FOLDER VOXSPRING study STUDY [OPTION...]

FOLDER takes the results, NN-old.json and NN-new.json; what is there already is not run again. --cpu-clock judges
processor time, which other programs do not stop, instead of time: for one thread (OMP_NUM_THREADS=1).
"""

import argparse
import collections
import pathlib
import subprocess
import sys

import comparison
import diff


def compared(old, new, options, slow_down=1, error_growth=1):
    """The rows of a pair of files, with the times and errors of the new one multiplied."""
    results = [comparison.Result(path, False) for path in (old, new)]
    for rows in results[1].rows.values():
        for row in rows:
            row.times = [slow_down * time for time in row.times]
            row.errors = {key: value and error_growth * value for key, value in row.errors.items()}
    return comparison.pair(*results, options)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--threshold", type=diff.number_above(0), default=0.05)
    parser.add_argument("--cpu-clock", dest="clock", action="store_const", const="cpu_time", default=comparison.CLOCK)
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    comparison.CLOCK, base = options.clock, options.threshold
    options.error_factor, options.across_devices = 1.5, False
    options.folder.mkdir(parents=True, exist_ok=True)
    pairs = [[options.folder / f"{pair:02}-{side}.json" for side in ("old", "new")] for pair in range(options.pairs)]
    for path in sum(pairs, []):
        if not path.exists():
            print(f"running {path.name}", file=sys.stderr)
            subprocess.run([*options.command, "--out", path], check=True, stdout=subprocess.DEVNULL)

    changes = {"as they are": (1, 1), "new 1.1 times as slow": (1.1, 1), "new 1.1 times as fast": (1 / 1.1, 1),
               "new with twice the error": (1, 2)}
    for rule, threshold, factor, highest in (("the rule", options.threshold, comparison.NOISE_FACTOR, comparison.HIGHEST_NOISE),
                                             ("U and interval alone", 1e-9, 0, float("inf"))):
        options.threshold, comparison.NOISE_FACTOR, comparison.HIGHEST_NOISE = threshold, factor, highest
        for change, factors in changes.items():
            judged = [compared(*pair, options, *factors) for pair in pairs]
            failing = sum(any(row["verdict"] in comparison.WORSE for row in rows) for rows in judged)
            print(f"{rule}, {change}: {failing} of {len(pairs)} pairs worse")
            rows = sum(judged, [])
            calm = [row for row in rows if row["time"] and row["time"]["noise"] <= comparison.CALM * base]
            for name, of in (("rows", rows), ("rows of little noise", calm)):
                counts = collections.Counter(row["verdict"] for row in of)
                print(f"    {len(of)} {name}: "
                      + ", ".join(f"{counts[verdict]} {verdict}" for verdict in comparison.VERDICTS if counts[verdict]))


if __name__ == "__main__":
    main()
