"""Finds figures in the prose of pages that no template made and no commit stands beside."""

import re

UNIT = (r"(?:us|ms|ns|s|microseconds?|milliseconds?|nanoseconds?|seconds?|minutes?|hours?|[KMGT]i?B/s|[MGT](?:op|flop)?/s|"
        r"[MGT] (?:springs|particles)/s|G (?:springs|particles)|MHz|GHz|J|mJ|W|%|percent|times)")
MEASURED = re.compile(rf"(?<![\w.^@=/-])~?\d[\d.,]*(?:e-?\d+)?(?: to \d[\d.,]*| and \d[\d.,]*)?\s?{UNIT}(?![\w/^])")
COMMIT = re.compile(r"(?i)\bcommits? `?[0-9a-f]{7,}\b")
# What a sentence is made of besides prose: filled-in blocks, template expressions, code.
GENERATED = re.compile(r"<!-- ([\w-]+) -->\n.*?<!-- /\1 -->|\{\{.*?\}\}", re.DOTALL)
FENCED = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
INDENTED = re.compile(r"(?:\A|\n)\n((?:    .*\n|\n)+)")


def sections(text):
    """(Whether the section or one that it is part of says of which commit it is, its paragraphs), section after section."""
    history = []
    for part in re.split(r"(?m)^(?=#+ )", text):
        heading = re.match(r"(#+) .*\n", part)
        depth = len(heading[1]) if heading else 0
        paragraphs = [one for one in re.split(r"\n{2,}", part[heading.end() if heading else 0:].strip("\n")) if one.strip()]
        history = [of for of in history if of[0] < depth]
        history.append((depth, bool(paragraphs and COMMIT.search(paragraphs[0]))))
        yield any(named for _, named in history), paragraphs


def sentences(paragraph):
    return re.split(r"(?<=[.!?])[*_)]*\s+(?=[*_`\[(]*[A-Z])|\n(?=- |\|)", paragraph)


def measured_columns(table):
    """The rows of a table of figures whose unit stands in its header."""
    lines = table.split("\n")
    if re.search(rf"(?<![\w/]){UNIT}(?![\w/^])", lines[0].replace("%", "").replace(" s ", " ")):
        return [line for line in lines[2:] if re.search(r"\|\s*[~*]*\d", line)]
    return []


def unfounded(text):
    """The sentences and rows of a page with a figure of unknown origin."""
    text = INDENTED.sub("\n\n", FENCED.sub("", GENERATED.sub("", text)))
    found = []
    for history, paragraphs in sections(text):
        before = ""
        for paragraph in paragraphs:
            if history or (paragraph.startswith("|") and COMMIT.search(before)):
                before = paragraph
                continue
            plain = re.sub(r"`[^`\n]*`", "`x`", paragraph)
            if plain.startswith("|"):
                found += measured_columns(plain)
            found += [" ".join(one.split()) for one in sentences(plain) if MEASURED.search(one) and not COMMIT.search(one)]
            before = paragraph
    return list(dict.fromkeys(found))
