#!/usr/bin/env python3
"""Makes results/README.md from README.in.md and the results beside it.

Usage: paper.py [--check]

In the template `{{ expression }}` stands for a figure, a verdict or, as `{{ tables.NAME() }}`, a table: functions of
readme/facts.py and readme/tables.py over MACHINE/STUDY.json.gz. --check changes nothing and exits with 1 if the page is not
what the results say. A sentence that no longer holds is named, with its line, and nothing is written.
"""

import pathlib
import sys

from readme import facts, template

HERE = pathlib.Path(__file__).resolve().parent
TEMPLATE, PAGE = HERE / "README.in.md", HERE / "README.md"


def main():
    try:
        page = template.render(TEMPLATE.read_text(), facts.NAMES, TEMPLATE.name)
    except template.Stale as stale:
        sys.exit(str(stale))
    if "--check" in sys.argv[1:]:
        if not PAGE.exists() or page != PAGE.read_text():
            sys.exit(f"{PAGE.name} is not what the results say: run {pathlib.Path(__file__).name}")
        return
    PAGE.write_text(page)


if __name__ == "__main__":
    main()
