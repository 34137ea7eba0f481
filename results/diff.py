#!/usr/bin/env python3
"""Compares two results row by row: what became faster or slower, whose error grew, what fails now.

Usage: diff.py OLD NEW [--markdown | --json] [--all] [--threshold 0.05] [--error-factor 1.5] [--across-devices]

OLD and NEW are results, RESULT.json or RESULT.json.gz. Exit code: 0 nothing is worse, 1 something is (slower, error grew,
now fails), 2 bad input.

The rule, which the page of results follows as well:
"""

import argparse
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

# Codes of a terminal: bold red, red, green, dim.
COLOURS = {"now fails": "1;31", "error grew": "1;31", "slower": "31", "faster": "32", "same": "2"}
# The width of lines in a pipe, and the least width that a row's columns need.
WIDTH, LEAST_WIDTH = 80, 60
LIMIT = " x limit"


def refuse(message):
    print(f"diff.py: {message}", file=sys.stderr)
    sys.exit(2)


def time_text(value, unit):
    if unit == "times_limit":
        return f"{value:.3g}{LIMIT}"
    scale, unit = next((pair for pair in ((1, "s"), (1e-3, "ms")) if value >= pair[0]), (1e-6, "us"))
    return f"{value / scale:.{3 if value < 1e-3 else 4}g} {unit}"


def cells(row, unit):
    time = row["time"]
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


def markdown(found, shown):
    def line(texts):
        return "| " + " | ".join(text.replace("|", "\\|").replace("\n", " ") for text in texts) + " |"
    lines = [f"**{summary(found)}**", "", heading(found), ""]
    if shown:
        lines += [line(HEADER), "| --- | --- | --- | --: | --: | --: | --: | --: | --- |"]
        lines += [line([f"**{row['verdict']}**" if row["verdict"] in comparison.WORSE else row["verdict"],
                        *cells(row, found["time"])[1:]]) for row in shown] + [""]
    print("\n".join(lines + [f"- {note}" for note in found["notes"]]).rstrip())


def place_of(row):
    """What tells a row apart beside its name."""
    def words(key, value):
        if isinstance(value, bool):
            return key if value else f"not {key}"
        if isinstance(value, dict):
            value = " ".join(map(str, value.values()))
        return f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
    return ", ".join(words(key, value) for key, value in row["place"].items() if value != "")


def times_line(row, unit):
    """Times and what they say, in columns that all rows share."""
    time = row["time"]
    low, high = time["interval"]
    interval = "" if low is None else f"(95%: {low:.3f} to {high:.3f})"
    counts = f"n = {', '.join(map(str, dict.fromkeys(row['repetitions'])))}" if any(row["repetitions"]) else ""
    spread = "" if time["spread"] is None else f", spread {100 * time['spread']:.1f} %"
    old, new = (time_text(time[side], unit) for side in ("old", "new"))
    return f"{old.removesuffix(LIMIT):>8} -> {new:<8} x {time['ratio']:.3f} {interval:<22} {counts}{spread}".rstrip()


def terminal(found, shown):
    """A row is its name, its times and its notes, each on separate lines, so that none of them is cut."""
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
                print(" " * 4 + times_line(row, found["time"]))
            for line in filter(None, row["detail"].split("\n")):
                show(line, 4)
    print()
    for note in found["notes"]:
        show(f"note: {note}", 0)
    show(summary(found), 0)


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
    form.add_argument("--markdown", action="store_true", help="a table for a pull request")
    form.add_argument("--json", action="store_true", help="every row, as diff.schema.json says")
    parser.add_argument("--all", action="store_true", help="in a table, rows that are the same as well")
    parser.add_argument("--threshold", type=number_above(0), default=comparison.Rule.threshold, metavar="FRACTION",
                        help="the least change of the time that counts (%(default)s)")
    parser.add_argument("--error-factor", type=number_above(1), default=comparison.Rule.error_factor, metavar="FACTOR",
                        help="the least growth of an error that counts (%(default)s)")
    parser.add_argument("--across-devices", action="store_true",
                        help="compare results of two devices, each time as a multiple of its device's limit")
    options = parser.parse_args()
    try:
        found = comparison.document(options.old, options.new, comparison.Rule(
            options.threshold, options.error_factor, options.across_devices))
    except result_files.BadInput as error:
        refuse(error)
    except ImportError as absent:
        refuse(f"{absent}: install Debian's python3-scipy and python3-fastjsonschema, or with pip scipy and fastjsonschema")
    shown = [row for row in found["rows"] if options.all or row["verdict"] != "same"]
    if options.json:
        print(json.dumps(found, indent=2))
    elif options.markdown:
        markdown(found, shown)
    else:
        terminal(found, shown)
    return 1 if found["worse"] else 0


if __name__ == "__main__":
    # Do not fail if the reader of a pipe ends first, as in `diff | head`.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    sys.exit(main())
