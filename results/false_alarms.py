#!/usr/bin/env python3
"""Measures how often diff.py is wrong. Compares pairs of results of one unchanged program on one card: every row that diff.py calls
faster, slower, failing, worse in its error, or better or worse in a counter is a false alarm, and so is every run that it calls
faster or slower as a whole.

Usage: false_alarms.py [--in-pairs] [--threshold 0.05] RESULT RESULT [RESULT...]
       false_alarms.py --resample PAIRS [--drift 0.006] [--threshold 0.05] RESULT [RESULT...]

RESULT is a .json or .json.gz file of one study. Every two files are compared; with --in-pairs only the first with the second, the
third with the fourth, and so on. Seven runs are twenty-one pairs:

    for i in 1 2 3 4 5 6 7; do voxspring study table1 --out table1-$i.json; done
    python3 results/false_alarms.py table1-*.json

--resample simulates pairs from single results, whose studies share rows and were measured by one commit on one card. On both sides
of a pair the repetitions of a row are drawn from those in the file, with replacement. On the second side two factors change a row's
time: a ratio that a row of its backend (of its API, if the backend has few shared rows) really had between two of the files, and a
random factor for the row's whole API, whose logarithm has the standard deviation --drift. So the pairs are simulated from measured
noise.

Exit code: 0 if there is no false alarm, or if pairs were resampled; 1 if there are false alarms; 2 for bad input.
"""

import argparse
import collections
import copy
import dataclasses
import itertools
import math
import pathlib
import random
import statistics
import sys

import comparison
import diff
import result_files

ALARMS = ("faster", "slower", "error grew", "counter better", "counter worse", "now fails")
JUDGED = ("same", "too noisy to tell", *ALARMS)
ENOUGH = 8  # a backend with fewer ratios of unchanged rows than this draws from those of its API
SEED = 1


def origin(result, resample):
    """The commit and, unless pairs are resampled, the study and devices: results with other values cannot be compared."""
    cards = sorted({backend.get("uuid") or backend["device"] for backend in result.backends.values()})
    return {"commit": result.context["commit"]} | ({} if resample else {"study": result.study, "devices": ", ".join(cards)})


def alarms_of(old, new, rule):
    """(compared rows of two results, false alarms). A false alarm is a row, or the shift that the rows of one API have in
    common."""
    rows, shifts = comparison.pair(old, new, rule)
    return rows, [one for one in rows + shifts if one["verdict"] in ALARMS]


def slowed(result, chosen):
    """The result with one row, (identity, place), 10% slower."""
    other = copy.copy(result)
    other.rows = {**result.rows, chosen: [dataclasses.replace(row, times=[1.1 * time for time in row.times]) for row in result.rows[chosen]]}
    return other


def finds_slowed(old, new, chosen, rule):
    """Whether the comparison of two results finds a row of the second that is made 10% slower."""
    return any(one["verdict"] == "slower" and tuple(one.get(key) for key in comparison.IDENTITY) == chosen[0]
               for one in alarms_of(old, slowed(new, chosen), rule)[1])


def of_pairs(results, in_pairs, rule):
    """Compares pairs of results, prints their false alarms and how often one row that is made 10% slower is found, and returns the
    number of false alarms."""
    pairs = list(zip(results[::2], results[1::2])) if in_pairs else list(itertools.combinations(results, 2))
    counts, number, failing, found, tried = collections.Counter(), 0, 0, 0, 0
    for old, new in pairs:
        rows, alarms = alarms_of(old, new, rule)
        places = [place for place, (row, *_) in new.rows.items() if len(row.times) > 1]
        tried += len(places)
        found += sum(finds_slowed(old, new, place, rule) for place in places)
        counts.update(row["verdict"] for row in rows)
        number += len(alarms)
        failing += bool(alarms)
        for one in alarms:
            name = f"{one['scene']} {one['contender']}" if "scene" in one else f"all of {one['api']}"
            ratio = one["ratio"] if "ratio" in one else one["time"] and one["time"]["ratio"]
            print(f"{one['verdict']}: {name}{f', x {ratio:.3f}' if ratio else ''} ({old.path.name} -> {new.path.name})")
    rest = "".join(f"; {count} {verdict}" for verdict, count in counts.items() if verdict not in JUDGED)
    print(f"{len(pairs)} pairs of {results[0].study} (commit {results[0].context['commit']}): {failing} with a false alarm, {number} "
          f"false alarms in {sum(counts[verdict] for verdict in JUDGED)} rows, {counts['too noisy to tell']} of them too noisy to tell{rest}; "
          f"one row made 10% slower: found {found} of {tried} times")
    return number


def api_of(result, backend):
    return result_files.limits_of(result.backends.get(backend, {}))


def differences(results):
    """{("backend" or "API", name): distances of unchanged rows of two studies from the shift of their API, as logarithms}."""
    found = collections.defaultdict(list)
    for old, new in itertools.combinations(results, 2):
        for row in comparison.pair(old, new, comparison.Rule())[0]:
            if row["time"] and not row["place"]:
                away = math.log(row["time"]["ratio"] / (row["time"]["shift"] or 1))
                found["backend", row["backend"]].append(away)
                found["API", api_of(new, row["backend"])].append(away)
    return found


def resampled(result, generator, away=None, drift=0):
    """Simulates a further run: the times of each row with repetitions are drawn from these. With `away`, from differences(), the
    times of rows and of whole APIs are also multiplied by random factors, as they differ between real runs."""
    drifts = collections.defaultdict(lambda: generator.gauss(0, drift))
    other = copy.copy(result)
    other.rows = {}
    for (identity, place), (row, *_) in result.rows.items():
        if len(row.times) > 1:
            api, factor = api_of(result, identity[1]), 1
            if away is not None:
                known = away["backend", identity[1]]
                known = known if len(known) >= ENOUGH else away["API", api] or [0]
                factor = math.exp(drifts[api] + generator.choice(known) * generator.choice((-1, 1)))
            times = [factor * time for time in generator.choices(row.times, k=len(row.times))]
            other.rows[identity, place] = [dataclasses.replace(row, times=times)]
    return other


def of_resampled(results, count, drift, rule):
    """Simulates pairs of runs of each result, and prints how often there is a false alarm, and how often a change of 10% is
    found."""
    away = differences(results)
    print("; ".join(f"{api}: {len(of)} ratios of unchanged rows; from the shift of their API half of them are at most "
                    f"{statistics.median(map(abs, of)):.2%} away, all at most {max(map(abs, of)):.2%}" for (kind, api), of in away.items() if kind == "API"))
    for result in results:
        generator, whose, failing, found, can = random.Random(SEED), collections.Counter(), 0, 0, 0
        places = list(resampled(result, generator).rows)
        for _ in range(count if places else 0):
            old, new = resampled(result, generator), resampled(result, generator, away, drift)
            rows, alarms = alarms_of(old, new, rule)
            whose.update(one.get("backend", "a whole API") for one in alarms)
            failing += bool(alarms)
            can += sum(row["time"]["least"] is not None and row["time"]["least"] <= 0.1 for row in rows) / len(rows)
            found += finds_slowed(old, new, generator.choice(places), rule)
        if places:
            print(f"{result.path.parent.name}/{result.study}: {len(places)} rows, {count} pairs: {failing} with a false alarm "
                  f"({failing / count:.1%}){''.join(f', {of} of {name}' for name, of in whose.items())}; one row 10% slower: found in "
                  f"{found / count:.1%} of the pairs, and {can / count:.1%} of the rows are exact enough for that")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--in-pairs", action="store_true")
    parser.add_argument("--resample", type=int, default=0, metavar="PAIRS")
    parser.add_argument("--drift", type=diff.number_above(0), default=0.006)
    parser.add_argument("--threshold", type=diff.number_above(0), default=comparison.Rule.threshold)
    parser.add_argument("results", nargs="+", type=pathlib.Path, metavar="RESULT")
    options = parser.parse_args()
    rule = comparison.Rule(options.threshold)
    try:
        if len(options.results) < 2 and not options.resample:
            raise result_files.BadInput(f"command line: RESULT: {options.results[0]} alone is not accepted; expected two or more")
        if options.in_pairs and len(options.results) % 2:
            raise result_files.BadInput(f"command line: RESULT: {len(options.results)} files are not accepted; expected an even "
                                        "number, as --in-pairs says")
        if options.resample < 0:
            raise result_files.BadInput(f"command line: --resample: {options.resample} is not accepted; expected 0 or more")
        results = [comparison.Result(path, False) for path in options.results]
        first = origin(results[0], options.resample)
        for result in results:
            for key, value in origin(result, options.resample).items():
                if value != first[key]:
                    raise result_files.BadInput(f"{result.path}: {key}: {value} is not accepted; expected {first[key]}, as "
                                                f"{results[0].path} has")
    except result_files.BadInput as error:
        result_files.refuse(__file__, error)
    if not options.resample:
        return 1 if of_pairs(results, options.in_pairs, rule) else 0
    return of_resampled(results, options.resample, options.drift, rule)


if __name__ == "__main__":
    sys.exit(main())
