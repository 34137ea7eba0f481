#!/usr/bin/env python3
"""Compares two results row by row: what became faster or slower, whose error grew, what fails now.

Usage: diff.py OLD NEW [--format FORM] [--all] [--fail-on WHAT]... [--threshold 0.05] [--error-factor 1.5] [--across-devices]

OLD and NEW are results, RESULT.json or RESULT.json.gz. --format bmf and github-action-benchmark write the times of NEW, a series
per case, as Bencher (`bencher run --adapter json`) and github-action-benchmark (`tool: customSmallerIsBetter`) read them.

Exit code: 0 if nothing is worse; 1 if a row is slower, has a larger error or a worse counter, or fails now, if the run is slower as
a whole, or if a condition of --fail-on holds; 2 for bad input, or if standard output cannot take all.

How rows are judged, here and on the page of results:
"""

import argparse
import collections
import json
import math
import os
import pathlib
import shutil
import signal
import sys
import textwrap

import comparison
import result_files

# Codes of a terminal's colours: bold red, red, green, dim.
COLOURS = {"now fails": "1;31", "error grew": "1;31", "slower": "31", "faster": "32", "same": "2"}
# The width of lines in a pipe, and the least width of lines on a terminal.
WIDTH, LEAST_WIDTH = 80, 60
LIMIT = " x limit"
EXPORTS = ("bmf", "github-action-benchmark")
FORMS = ("terminal", "markdown", "json", *EXPORTS)


def time_text(value, unit):
    if unit == "times_limit":
        return f"{value:.3g}{LIMIT}"
    scale, prefix = next((pair for pair in ((1, ""), (1e-3, "m")) if value >= pair[0]), (1e-6, "u"))
    return f"{value / scale:.{3 if value < 1e-3 else 4}g} {prefix}{unit}"


def cells(row):
    time, unit = row["time"], row["unit"]
    texts = [row["verdict"], row["scene"], row["contender"]] + ["-"] * 5
    if time:
        low, high = time["interval"]
        interval = "" if low is None else f" ({low:.3f} to {high:.3f})"
        texts[3:] = [time_text(time["old"], unit), time_text(time["new"], unit), f"{time['ratio']:.3f}{interval}",
                     ", ".join(str(count or "-") for count in dict.fromkeys(row["repetitions"])),
                     "-" if time["spread"] is None else f"{100 * time['spread']:.1f} %"]
    return texts + ["; ".join(filter(None, [place_of(row), row["detail"]]))]


HEADER = ["verdict", "scene", "contender", "old", "new", "ratio (95% interval)", "repetitions", "spread", ""]


def summary(found):
    return ", ".join(f"{count} {verdict}" for verdict, count in found["counts"].items()) or "no rows"


def heading(found):
    def about(side):
        dirty = ", not clean" if side["clean"] is False else ""
        return f"{side['file']} ({side['study']}, commit {side['commit']}{dirty})"
    return f"{about(found['old'])} -> {about(found['new'])}"


def remarks(found):
    return found["notes"] + [f"setup: {change}" for change in found["setup"]] + [f"fails: {why}" for why in found["fails"]]


def markdown(found, shown):
    def line(texts):
        return "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in texts) + " |"
    lines = [f"**{summary(found)}**", "", heading(found), ""]
    if shown:
        lines += [line(HEADER), "| --- | --- | --- | --: | --: | --: | --: | --: | --- |"]
        lines += [line([f"**{row['verdict']}**" if row["verdict"] in comparison.WORSE else row["verdict"],
                        *cells(row)[1:]]) for row in shown] + [""]
    print("\n".join(lines + [f"- {note}" for note in remarks(found)]).rstrip())


def place_of(row):
    """Words for the place of a row: what tells it apart from other rows of its name."""
    def words(key, value):
        if isinstance(value, bool):
            return key if value else f"not {key}"
        if isinstance(value, dict):
            value = " ".join(map(str, value.values()))
        return f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
    return ", ".join(words(key, value) for key, value in row["place"].items() if value != "")


def times_line(row):
    """The line with the times of a row and their statistics, in columns of the same width for all rows."""
    time, unit = row["time"], row["unit"]
    low, high = time["interval"]
    interval = "" if low is None else f"(95%: {low:.3f} to {high:.3f})"
    counts = f"n = {', '.join(map(str, dict.fromkeys(row['repetitions'])))}" if max(row["repetitions"]) > 1 else ""
    spread = "" if time["spread"] is None else f", spread {100 * time['spread']:.1f} %"
    old, new = (time_text(time[side], unit) for side in ("old", "new"))
    return f"{old.removesuffix(LIMIT):>8} -> {new:<8} x {time['ratio']:.3f} {interval:<22} {counts}{spread}".rstrip()


def terminal(found, shown):
    """Prints the rows. Each has its name, its times and its notes on separate lines, so that none of them is cut."""
    on_terminal = sys.stdout.isatty()
    width = max(shutil.get_terminal_size((WIDTH, 0)).columns, LEAST_WIDTH) if on_terminal else WIDTH
    coloured = on_terminal and "NO_COLOR" not in os.environ

    def show(text, indent, colour=""):
        lines = textwrap.wrap(text, width, initial_indent=" " * indent, subsequent_indent=" " * (indent + 2), break_on_hyphens=False)
        text = "\n".join(lines)
        print(f"\033[{colour}m{text}\033[0m" if coloured and colour and text else text)

    show(heading(found), 0)
    for verdict, count in found["counts"].items():
        rows = [row for row in shown if row["verdict"] == verdict]
        if rows:
            print(f"\n{verdict}: {count}")
        for row in rows:
            show(", ".join(filter(None, (f"{row['scene']} {row['contender']}", place_of(row)))), 2, COLOURS.get(verdict, ""))
            if row["time"]:
                print(" " * 4 + times_line(row))
            for line in filter(None, row["detail"].split("\n")):
                show(line, 4)
    print()
    for note in remarks(found):
        show(note if note.startswith(("setup", "fails")) else f"note: {note}", 0)
    show(summary(found), 0)


def series(path):
    """Yields (name, unit, number of times, their quartiles) for each case of a result. Services take times in nanoseconds."""
    names = collections.Counter()
    for (identity, place), rows in comparison.Result(path, False).rows.items():
        where = place_of({"place": {key: json.loads(value) for key, value in place}})
        for row in rows:
            name = ", ".join(filter(None, (f"{identity[0]} {row.name}", where)))
            names[name] += 1
            if row.times:
                unit, scale = ("ns", 1e9) if row.unit == "s" else (row.unit, 1)
                yield (name + f" ({names[name]})" * (names[name] > 1), unit, len(row.times),
                       *(scale * quartile for quartile in comparison.quartiles(row.times)))


def exported(form, path, about):
    """A result as Bencher takes it, with nanoseconds as `latency`, or as github-action-benchmark's customSmallerIsBetter."""
    if form == "bmf":
        return {name: {"latency" if unit == "ns" else "energy": {"value": middle} | (
            {"lower_value": low, "upper_value": high} if count > 1 else {})} for name, unit, count, low, middle, high in series(path)}
    return [{"name": name, "unit": unit, "value": middle, "extra": f"commit {about['commit']}, n = {count}"} | (
        {"range": f"± {(high - low) / 2:.3g}"} if count > 1 else {}) for name, unit, count, low, middle, high in series(path)]


def number_above(least):
    def parse(text):
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least < value < math.inf:
            raise argparse.ArgumentTypeError(f"{text}: expected a number above {least}")
        return value
    return parse


def main():
    parser = argparse.ArgumentParser(description=__doc__ + "\n" + comparison.__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=pathlib.Path, metavar="OLD.json")
    parser.add_argument("new", type=pathlib.Path, metavar="NEW.json")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--format", choices=FORMS, default=FORMS[0], help="bmf and github-action-benchmark write the times of NEW")
    form.add_argument("--markdown", action="store_const", dest="format", const="markdown", help="a table for a pull request")
    form.add_argument("--json", action="store_const", dest="format", const="json", help="every row, as diff.schema.json says")
    parser.add_argument("--fail-on", action="append", choices=comparison.FAIL_ON, default=[],
                        help="also fail; missing: if a row is gone or no longer comparable; undecided: if a row is too noisy to "
                             "tell; setup: if the machine was set up differently")
    parser.add_argument("--all", action="store_true", help="also list the rows that are the same")
    parser.add_argument("--threshold", type=number_above(0), default=comparison.Rule.threshold, metavar="FRACTION",
                        help="the smallest relative change of a time that counts (%(default)s)")
    parser.add_argument("--error-factor", type=number_above(1), default=comparison.Rule.error_factor, metavar="FACTOR",
                        help="the least growth of an error that counts (%(default)s)")
    parser.add_argument("--across-devices", action="store_true",
                        help="compare results of two devices, each time as a multiple of its device's limit")
    options = parser.parse_args()
    try:
        found = comparison.document(options.old, options.new, comparison.Rule(
            options.threshold, options.error_factor, options.across_devices, tuple(dict.fromkeys(options.fail_on))))
    except result_files.BadInput as error:
        result_files.refuse(__file__, error)
    except ImportError as absent:
        result_files.refuse(__file__, f"{absent}: install Debian's python3-scipy and python3-fastjsonschema, or with pip scipy and "
                            "fastjsonschema")
    shown = [row for row in found["rows"] if options.all or row["verdict"] != "same"]
    try:
        if options.format in EXPORTS:
            print(json.dumps(exported(options.format, options.new, found["new"]), indent=2, ensure_ascii=False))
        elif options.format == "json":
            print(json.dumps(found, indent=2))
        elif options.format == "markdown":
            markdown(found, shown)
        else:
            terminal(found, shown)
        sys.stdout.flush()
    except OSError as error:
        result_files.end_output(__file__, error)
    return 1 if found["worse"] else 0


if __name__ == "__main__":
    # If the reader of a pipe ends first, as in `diff.py OLD NEW | head`, this program ends without a traceback.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    sys.exit(main())
