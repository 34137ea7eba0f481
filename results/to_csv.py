#!/usr/bin/env python3
"""Writes the measured rows of results to standard output as CSV.

Usage: to_csv.py RESULT...          (.json or .json.gz)

A line is a row of any list of a result: a repetition or an aggregate of them, a run of `pareto`, a limit of `stability`, a
measurement of `stress`. The columns are those of all files; a cell is empty where its row has no such field or null. Lists and
objects are written as JSON.

Exit code: 0 done; 2 bad input, or standard output that cannot take all.
"""

import csv
import json
import sys

import result_files


def cell(value):
    return json.dumps(value) if isinstance(value, (list, dict)) else value


def main():
    paths = sys.argv[1:]
    if not paths or any(path.startswith("-") for path in paths):
        print(__doc__.strip(), file=sys.stdout if set(paths) & {"-h", "--help"} else sys.stderr)
        sys.exit(0 if set(paths) & {"-h", "--help"} else 2)
    try:
        rows = result_files.rows(paths)
    except result_files.BadInput as error:
        result_files.refuse(__file__, error)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    try:
        writer = csv.DictWriter(sys.stdout, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: cell(value) for key, value in row.items()} for row in rows)
        sys.stdout.flush()
    except OSError as error:
        result_files.end_output(__file__, error)


if __name__ == "__main__":
    main()
