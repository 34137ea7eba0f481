"""Fills a page from its template: each `{{ expression }}` of `NAME.in.md` becomes what the results say.

A float is written with three digits, a text as it is. A paragraph that had an expression is broken into lines anew.
`{{ holds(condition) }}` becomes nothing, and refuses the page where the condition is false: what its sentence claims is then no
longer what the results say.
"""

import re
import textwrap

from readme import rows

EXPRESSION = re.compile(r"\{\{(.*?)\}\}", re.DOTALL)

WIDTH = 130


class Stale(Exception):
    """A sentence of a template that the results no longer bear out, or a figure that they no longer have."""


class Untrue(Exception):
    """What a sentence claims does not hold."""


def holds(condition):
    if not condition:
        raise Untrue("what it claims no longer holds")
    return ""


def sentence_around(text, place):
    """The sentence in which a place of a text stands, on one line, with the line's number."""
    paragraph = text.rfind("\n\n", 0, place) + 2 if "\n\n" in text[:place] else 0
    begin = max([paragraph] + [match.end() for match in re.finditer(r"[.:](?=\s)\s+", text[:place]) if match.end() > paragraph])
    found = re.compile(r"[.:](?=\s|$)|\n\n").search(text, place)
    return " ".join(text[begin:found.end() if found else len(text)].split()), text.count("\n", 0, place) + 1


def written(value):
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or value is None:
        raise Untrue(f"{value} is no figure")
    return f"{value:,}" if isinstance(value, int) else rows.figure(value)


def broken_anew(paragraph):
    """Prose in lines of the pages' width; a table, a list or code as it is."""
    if re.match(r"[|#\-<>]|```|    |\d+\. ", paragraph) or "\n|" in paragraph:
        return paragraph
    return "\n".join(textwrap.wrap(paragraph, WIDTH, break_long_words=False, break_on_hyphens=False))


def render(text, names, page):
    """The page that a template makes; Stale names the line and the sentence of everything that is wrong with it."""
    wrong = []

    def value(match, start):
        try:
            # The templates are ours, as this file is.
            expression = " ".join(match[1].split())
            return written(eval(expression, {"__builtins__": {}, **names, "holds": holds}))  # pylint: disable=eval-used
        except Exception as error:  # pylint: disable=broad-except
            sentence, line = sentence_around(text, start + match.start())
            reason = error if isinstance(error, (Untrue, rows.Missing)) else f"{type(error).__name__}: {error}"
            wrong.append(f"{page}:{line}: {reason}: \"{sentence}\"")
            return match[0]

    made, place = [], 0
    # A blank line ends a paragraph; none stands in an expression.
    for paragraph in re.split(r"(\n{2,})", text):
        made.append(EXPRESSION.sub(lambda match, start=place: value(match, start), paragraph))
        if made[-1] != paragraph:
            made[-1] = broken_anew(made[-1])
        place += len(paragraph)
    if wrong:
        raise Stale("\n".join(wrong))
    return "".join(made)
