"""Writes the page: the answer first, then the figures, then the files that they were made from. page.html has its words and
tags."""

import base64
import collections
import functools
import json
import math
import re

import jinja2
import vl_convert

import result_files

from . import charts, figures, reading, text_of

# The largest rounding error that is called small. On these datasets the error of the time step is larger.
SMALL_ERROR = 1e-5


def names(rows):
    """The names of the rows' backends; if there are many, the first names and the number of the others."""
    found = [row["backend"] for row in rows]
    few = figures.FEW
    return figures.listed(found if len(found) <= few else found[:few - 1] + [f"{len(found) - few + 1} others"])


def exact_enough(group):
    return figures.fastest(row for row in group if row["rounding"] is not None and row["rounding"] <= SMALL_ERROR)


def amount(quantity, value):
    """The value of a target's quantity, in the units of the page."""
    if quantity.endswith(("seconds", "seconds_per_step")):
        return figures.time_text(value * 1e6)
    if quantity.endswith("_per_second"):
        return figures.engineering(value, quantity.removesuffix("_per_second").replace("_updates", "s") + "/s")
    return figures.percent(value) if quantity.startswith("fraction_of") else f"{value:.3g}"


def by_size(entries):
    """(headline, sentence) on which backends are the fastest on which sizes of a dataset; None if ladder() returns None."""
    found = figures.ladder(entries)
    if not found:
        return None
    family, steps = found
    last, headline_words, words = len(steps) - 1, [], []
    for index, (backends, on_chip, (fewest, most)) in enumerate(steps):
        is_last = index == last
        size, start = figures.engineering(most, "particles"), figures.engineering(fewest, "particles")
        size_range = f"from {start}" if is_last else f"to {size.removesuffix(' particles')}"
        headline_words.append(f"{'on chip' if on_chip else figures.listed(backends)} {size_range}")
        verb = "" if index else " are the fastest" if len(backends) > 1 else " is the fastest"
        sizes = f"from {start.removesuffix(' particles')} to {size}" if is_last else f"up to {size}"
        words.append(f"{figures.listed(backends)}{verb} {sizes}{', with the state on the chip,' * on_chip}")
    return f"{family}: {', '.join(headline_words)}", f"Of the sizes of {family}, {figures.listed(words)}".removesuffix(",")


def headline(found, runs, drawn):
    """(machine, the answer in a line, further sentences). The answer is about times; without times it is about errors; without both
    it is the finding of the first figure."""
    if found:
        machine, entries = next(iter(found.items()))
        told = [entry.best for entry in entries if entry.won]
        sizes = by_size(entries)
        lead = ""
        if len(entries) <= figures.FEW:
            wins = figures.groups(told, "backend").items()
            parts = [f"{name} is the fastest on {figures.listed(row['scene'] for row in rows)}" for (name,), rows in wins]
            parts += [f"{names([entry.best] + entry.equals)} cannot be told apart on {entry.best['scene']}"
                      for entry in entries if entry.equals]
            parts += [f"the main contenders are not measured on {entry.best['scene']}"
                      for entry in entries if entry.absent and not entry.equals]
            title = figures.listed(parts)
        elif sizes:
            title, lead = sizes[0], sizes[1] + ". "
        else:
            wins = collections.Counter(best["backend"] for best in told).most_common(1)
            title = (f"{wins[0][0]} is the fastest on {wins[0][1]} of {len(entries)} datasets" if wins else
                     f"the fastest cannot be told on any of {len(entries)} datasets")
        best = entries[-1].best
        size = figures.engineering(best["particles"], "particles")
        lead += (f"On {'the largest, ' * (len(entries) > 1)}{best['scene']} with {size}, a step takes "
                 f"{figures.time_text(best['microseconds'])} with {best['contender']}")
        if best["rounding"] is not None:
            lead += f", and rounding costs {figures.error_text(best['rounding'])} after {best['error_steps']} steps"
        ratios = [exact["microseconds"] / entry.best["microseconds"] for entry in entries if (exact := exact_enough(entry.group))]
        if ratios:
            lead += (f". A rounding error of at most {figures.error_text(SMALL_ERROR)} takes "
                     f"{figures.between(ratios, lambda ratio: f'{ratio:.2f}')} times as long as the fastest, where it was "
                     "measured")
        return machine, figures.sentence(title), lead + "."
    for (machine, scene), rows in figures.groups(runs, "machine", "scene").items():
        if best := figures.fastest_within(rows, 1e-4):
            return machine, figures.sentence(f"{best['contender']} is the fastest way to an error of 1e-4 on {scene}"), ""
    if drawn:
        return drawn[0].findings[0][0], drawn[0].title, drawn[0].detail
    return "", "These results hold nothing to show", ""


def captions(results):
    return [f"{origin} ({', '.join(result.path.name for result in own)})"
            for (origin,), own in result_files.groups(results, reading.Result.origin).items()]


def compact(figure):
    """A figure as page.js takes it. Its rows keep only the keys that its table or its charts name."""
    used = {column[0] for column in figure.columns}
    used |= {key for panel in figure.panels for key in [*panel.match, *(panel.step or ())[:1]]}
    drawn = json.dumps([panel.spec for panel in figure.panels])
    used |= set(re.findall(r'(?:"field": "|datum\.)(\w+)', drawn)) & figure.rows[0].keys()
    names = sorted(used)
    rows = [[reading.significant(row.get(name)) for name in names] for row in figure.rows]
    return {"name": figure.name, "columns": figure.columns, "keys": names, "rows": rows,
            "panels": [{"match": panel.match, "spec": panel.spec, "step": panel.step} for panel in figure.panels]}


@functools.cache
def template():
    """page.html without its line breaks: those beside tags and expressions are removed, all others become blanks."""
    def source(name):
        return re.sub(r"\s*\n\s*", " ", re.sub(r"(?<=[>}])\s*\n\s*|\s*\n\s*(?=[<{])", "", text_of(name).strip()))
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, loader=jinja2.FunctionLoader(source))
    environment.globals |= vars(result_files) | vars(figures) | globals() | {
        "base64": lambda data: base64.b64encode(data).decode(), "log": math.log, "marks": charts.MARKS,
        "regions": reading.REGIONS, "small_error": SMALL_ERROR, "min_share": figures.MIN_SHARE,
        "min_spread": result_files.MIN_SPREAD,
        "error_columns": {error: f"Error of {figures.error_text(error)}" for error in figures.TARGETS}}
    return environment.get_template("page.html")


def answer(own, entries, runs):
    """What the page says of a machine before any figure."""
    latest = next((result for result in reversed(own) if result.lists["fastest"]), None)
    targets = [(block, target) for block in latest.lists["fastest"] for target in block["targets"]] if latest else []
    rows = {}
    for row in latest.lists["benchmarks"] if latest else ():
        rows[result_files.case_of(row)] = row
        rows[result_files.case_of(row | {"steps": None})] = row  # blocks of older files do not say their steps
    measured = [(block, target, result_files.aim_verdict(target, rows.get(result_files.case_of({**block, "name": target["name"]}))))
                for block, target in targets if target.get("measured") is not None]
    return {"entries": entries, "runs": runs, "targets": (measured, len(targets) - len(measured))}


def page(results, pictures, left_out):
    """The whole page as text. pictures: {dataset: its pictures}. left_out: [(datasets without a picture, reason)]."""
    # The order of models of machines, and of the machines of a model: the one with the most datasets comes first and, among those
    # with equally many, the one with the fastest memory.
    of_names = {}
    for result in results:
        for name in {result.model, result.machine}:
            of_names.setdefault(name, []).append(result)
    weight = {name: (-len({row["scene"] for result in own for row in result.lists["benchmarks"]}),
                     -max((reading.roofs(limits)[0]["memory"] for result in own for limits in result.limits.values()), default=0))
              for name, own in of_names.items()}
    results = sorted(results, key=lambda result: (weight[result.model], weight[result.machine]))
    shown, drawn = figures.all_figures(results)
    runs, found = figures.latest_runs(shown), shown.outcomes
    machine, title, lead = headline(found, runs, drawn)
    answers = {name: answer([result for result in results if result.machine == name], found.get(name),
                            [row for row in runs if row["machine"] == name])
               for name in dict.fromkeys(list(found) + figures.distinct(runs, "machine"))}
    papers = {(result.machine, block["scene"], reading.contender(block)): block["paper"]["ratio"]
              for result in results for block in result.lists["fastest"]
              if block.get("paper") and block["paper"]["name"] != block["name"]}
    # Escapes </ and <!--, since a </script in the data would end the script element that holds the data.
    data = json.dumps({"config": charts.CONFIG, "figures": [compact(figure) for figure in drawn]}, ensure_ascii=False,
                      separators=(",", ":")).replace("</", "<\\/").replace("<!--", "<\\!--")
    errors = [pair[1].about for pair in pictures.values()]
    return template().render(
        families=shown.families, colours=charts.colours(shown.families), shapes=charts.shapes(shown.families.values()), results=results,
        machine=machine, title=title, lead=lead, answers=answers, papers=papers, drawn=drawn,
        pictures=pictures, left_out=left_out, worst=max(errors, key=lambda about: about["largest"], default=None),
        renderers=figures.listed(dict.fromkeys(picture.about["renderer"] for pair in pictures.values() for picture in pair)),
        scenes=sorted({row["scene"] for result in results for name in reading.MEASURED for row in result.lists[name]}, key=reading.natural),
        failures=[(row, result.path.name) for result in results for row in result.lists["failed"]],
        data=data, bundle=script_safe_bundle(), style=text_of("page.css"), script=text_of("page.js"))


@functools.cache
def script_safe_bundle():
    """The source of the chart library. It is cached, because putting it together takes two seconds."""
    bundle = vl_convert.javascript_bundle()
    if "</script" in bundle or "<!--" in bundle:
        raise RuntimeError("the chart library cannot be inlined: it contains the end of a script")
    return bundle
