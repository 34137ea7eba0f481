#!/usr/bin/env python3
"""Makes results/README.md from README.in.md and the results beside it.

Usage: paper.py [--check]

The template is Jinja2. `{{ expression }}` stands for a figure or a verdict, which functions of readme/facts.py compute, and
`{{ tables.NAME() }}` for a table, a macro of readme/tables.jinja. Both read MACHINE/STUDY.json.gz. A float is written with two
decimals or three significant digits, and a paragraph with an expression is broken into lines anew. `{{ holds(condition) }}` writes
nothing. If its condition is false, its sentence claims what the results no longer say: the script then prints every such sentence
with its line, and changes nothing.
--check changes nothing and exits with 1 if the page is not what the results say.
"""

import pathlib
import re
import sys
import textwrap
import traceback

import jinja2

from readme import facts, rows

HERE = pathlib.Path(__file__).resolve().parent
TEMPLATE, PAGE = HERE / "README.in.md", HERE / "README.md"
WIDTH = 130


class Stale(Exception):
    """Raised if sentences of a template contradict the results, or need figures that the results lack. The message lists them."""


class Untrue(Exception):
    """Raised if what a sentence claims does not hold, or if an expression is no figure."""


def holds(condition):
    if not condition:
        raise Untrue("what it claims no longer holds")
    return ""


def written(value):
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or value is None:
        raise Untrue(f"{value} is no figure")
    return f"{value:,}" if isinstance(value, int) else rows.figure(value)


def broken_anew(paragraph):
    """The paragraph in lines of the page's width if it is prose; a table, a list or code unchanged."""
    if re.match(r"[|#\-<>]|```|    |\d+\. ", paragraph) or "\n|" in paragraph:
        return paragraph
    return "\n".join(textwrap.wrap(paragraph, WIDTH, break_long_words=False, break_on_hyphens=False))


def sentence_of(paragraph, line):
    """The sentence in which the first expression ({{...}}) of line `line` of a paragraph stands; lines count from 1."""
    place = paragraph.find("{{", sum(len(one) + 1 for one in paragraph.split("\n")[:line - 1]))
    found = [one for one in re.finditer(r".*?(?:[.:](?=\s|$)\s*|$)", paragraph, re.DOTALL) if one.start() <= place < one.end()]
    return " ".join((found[0][0] if found else paragraph).split())


ENVIRONMENT = jinja2.Environment(loader=jinja2.FileSystemLoader([HERE / "readme", HERE.parent]), finalize=written,
                                 undefined=jinja2.StrictUndefined, keep_trailing_newline=True, trim_blocks=True, lstrip_blocks=True)


class Tables:
    """The tables of the page by name: macros of tables.jinja."""

    def __getattr__(self, name):
        macros = ENVIRONMENT.get_template("tables.jinja", globals=vars(rows) | facts.NAMES).module
        return lambda *arguments: str(getattr(macros, name)(*arguments)).strip()


def render(text, names, page):
    """The page that a template makes. Raises Stale, which names the line and the sentence of every wrong expression."""
    wrong, made, line = [], [], 1
    # A blank line ends a paragraph; no expression contains one.
    for paragraph in re.split(r"(\n{2,})", text):
        filled = paragraph
        if "{{" in paragraph:
            try:
                filled = broken_anew(ENVIRONMENT.from_string(paragraph, names | {"holds": holds}).render())
            except Exception as error:  # pylint: disable=broad-except
                at = next((frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == "<template>"), 1)
                reason = error if isinstance(error, (Untrue, rows.Missing)) else f"{type(error).__name__}: {error}"
                wrong.append(f"{page}:{line + at - 1}: {reason}: \"{sentence_of(paragraph, at)}\"")
        made.append(filled)
        line += paragraph.count("\n")
    if wrong:
        raise Stale("\n".join(wrong))
    return "".join(made)


def main():
    check = rows.is_check(__doc__)
    try:
        page = render(TEMPLATE.read_text(), facts.NAMES | {"tables": Tables()}, TEMPLATE.name)
    except Stale as stale:
        sys.exit(str(stale))
    if check:
        if not PAGE.exists() or page != PAGE.read_text():
            sys.exit(f"{PAGE.name} is not what the results say: run {pathlib.Path(__file__).name}")
        return
    PAGE.write_text(page)


if __name__ == "__main__":
    main()
