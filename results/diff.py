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
import pathlib
import sys

import result_files


def refuse(message):
    print(f"diff.py: {message}", file=sys.stderr)
    sys.exit(2)


try:
    import comparison
except ImportError as absent:
    refuse(f"{absent}: install Debian's python3-scipy, or with pip scipy")

COLOURS = {"now fails": "bold red", "error grew": "bold red", "slower": "red", "faster": "green", "same": "dim"}


def time_text(value, unit):
    if unit == "times_limit":
        return f"{value:.3g} x limit"
    scale, unit = next((pair for pair in ((1, "s"), (1e-3, "ms")) if value >= pair[0]), (1e-6, "us"))
    return f"{value / scale:.{3 if value < 1e-3 else 4}g} {unit}"


def cells(row, unit):
    time = row["time"]
    where = ", ".join(f"{key} {value if not isinstance(value, dict) else ' '.join(map(str, value.values()))}"
                      for key, value in row["place"].items() if value != "")
    texts = [row["verdict"], row["scene"], row["contender"]] + ["-"] * 5
    if time:
        low, high = time["interval"]
        interval = "" if low is None else f" ({low:.3f} to {high:.3f})"
        texts[3:] = [time_text(time["old"], unit), time_text(time["new"], unit), f"{time['ratio']:.3f}{interval}",
                     ", ".join(str(count or "-") for count in dict.fromkeys(row["repetitions"])),
                     "-" if time["spread"] is None else f"{100 * time['spread']:.1f} %"]
    return texts + ["; ".join(filter(None, [where, row["detail"]]))]


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


def terminal(found, shown):
    try:
        import rich.box
        import rich.console
        import rich.table
        import rich.text
    except ImportError as missing:
        refuse(f"{missing}: install Debian's python3-rich, or with pip rich; --markdown and --json do without it")
    # In a pipe a line is as long as it needs to be.
    console = rich.console.Console(markup=False, highlight=False, width=None if sys.stdout.isatty() else 400)
    console.print(heading(found))
    if shown:
        table = rich.table.Table(*HEADER, box=rich.box.SIMPLE)
        for column in table.columns[3:8]:
            column.justify = "right"
        for row in shown:
            table.add_row(*map(rich.text.Text, cells(row, found["time"])), style=COLOURS.get(row["verdict"]))
        console.print(table)
    for note in found["notes"]:
        console.print(f"note: {note}")
    console.print(summary(found))


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
    shown = [row for row in found["rows"] if options.all or row["verdict"] != "same"]
    if options.json:
        print(json.dumps(found, indent=2))
    elif options.markdown:
        markdown(found, shown)
    else:
        terminal(found, shown)
    return 1 if found["worse"] else 0


if __name__ == "__main__":
    sys.exit(main())
