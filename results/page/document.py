"""The page around the figures: the answer first, then the figures, then what they were made from."""

import base64
import collections
import functools
import importlib.resources
import json
import math
from html import escape

import vl_convert

import result_files

from . import figures, reading

# No request leaves the page: only what is written in it may run, style it or be shown.
POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
          "form-action 'none'")
OUTLINES = {"circle": '<circle cx="5" cy="5" r="4.5"/>', "square": '<rect x="1" y="1" width="8" height="8"/>',
            "triangle-up": '<path d="M5 .5 9.7 9H.3z"/>', "triangle-right": '<path d="M9.5 5 1 9.7V.3z"/>',
            "triangle-down": '<path d="M5 9.5 9.7 1H.3z"/>',
            "diamond": '<path d="M5 0 9 5 5 10 1 5z"/>',
            "cross": '<path d="M3.5 0h3v3.5H10v3H6.5V10h-3V6.5H0v-3h3.5z"/>'}
# What a rounding error is small beside: the time step's own error on the datasets here is above it.
SMALL_ERROR = 1e-5


def swatch(shape, colour):
    return f'<svg class="swatch" viewBox="0 0 10 10" aria-hidden="true" fill="{colour}">{OUTLINES[shape]}</svg>'


def cell(content, name):
    return f'<td data-label="{escape(name)}"><span>{content}</span></td>'


def cards(header, rows):
    """A table whose rows are (dataset, heading, cells); on a narrow screen each becomes a card."""
    lines = ['<table class="cards"><thead><tr>'] + [f'<th scope="col">{escape(name)}</th>' for name in header]
    lines.append("</tr></thead><tbody>")
    for scene, heading, cells in rows:
        lines.append(f'<tr data-scene="{escape(scene)}"><th scope="row">{heading}</th>'
                     + "".join(cell(content, name) for content, name in zip(cells, header[1:])) + "</tr>")
    return "".join(lines) + "</tbody></table>"


def strategy(text):
    """A name in fixed width that may break after an underscore."""
    return f'<span class="strategy">{escape(text).replace("_", "_<wbr>")}</span>'


def strip(charts, rows, ends):
    """Marks of the best time of each backend on a logarithmic line that all datasets of a machine share."""
    span = math.log(ends[1] / ends[0]) or 1
    marks, words = [], []
    for row in sorted(rows, key=lambda row: -row["microseconds"]):
        place = 96 * math.log(row["microseconds"] / ends[0]) / span
        name = f"{row['backend']} {figures.time_text(row['microseconds'])}"
        words.append(name)
        outline = OUTLINES[figures.SHAPES[row["family"]]]
        marks.append(f'<svg x="{place:.1f}%" y="3" width="10" height="10" viewBox="0 0 10 10" '
                     f'fill="{charts.colours[row["backend"]]}"><title>{escape(name)}</title>{outline}</svg>')
    return (f'<svg class="strip" role="img" aria-label="{escape(", ".join(reversed(words)))}">'
            f'<line x1="0" x2="100%" y1="8" y2="8"/>{"".join(marks)}</svg>')


def small(text):
    return f"<small>{escape(text)}</small>"


def remark(text):
    """Small print that may break."""
    return f'<small class="remark">{escape(text)}</small>'


def spread(row):
    """Half the middle half of a row's repetitions, where it is more than a few per cent."""
    share = result_files.spread_of(row["repetition_times"]) or 0
    return remark(f"repetitions ± {figures.percent(share)}") if share > result_files.MIN_SPREAD else ""


def names(rows):
    """Backends by name, or the first of them and how many more."""
    found = [row["backend"] for row in rows]
    few = figures.FEW
    return figures.listed(found if len(found) <= few else found[:few - 1] + [f"{len(found) - few + 1} others"])


def exact_enough(group):
    return figures.fastest(row for row in group if row["rounding"] is not None and row["rounding"] <= SMALL_ERROR)


def fastest_table(charts, entries, papers):
    rows = []
    times = [row["microseconds"] for entry in entries for row in entry.group]
    for entry in entries:
        best, group = entry.best, entry.group
        each = [figures.fastest(own) for own in figures.groups(group, "backend").values()]
        exact = exact_enough(group)
        if exact is None:
            other = "not measured"
        elif exact is best:
            other = "the same"
        else:
            ratio = exact["microseconds"] / best["microseconds"]
            other = strategy(exact["contender"]) + remark(
                f"{ratio:.2f} times as long; {figures.error_text(exact['rounding'])} after "
                f"{exact['error_steps']} steps")
        limit = (f"{figures.percent(best['of_limit'])}{small(best['limited_by'] or '')}" if best["of_limit"] else "–")
        if (best["of_limit"] or 0) > 1:
            limit += remark("faster than its limit, so the limit is wrong")
        remarks = [f"not to be told from {names(entry.equals)}"] if entry.equals else []
        if entry.absent:
            were = "was" if len(entry.absent) == 1 else "were"
            remarks.append(f"without the main contenders: {figures.listed(entry.absent)} {were} not measured here")
        paper = papers.get((best["machine"], best["scene"], best["contender"]))
        if paper:
            remarks.append(f"{paper:.2f} times as fast as the best of the paper's strategies")
        cells = [strategy(best["contender"]) + "".join(map(remark, remarks)),
                 f"<b>{escape(figures.time_text(best['microseconds']))}</b>"
                 + small(figures.engineering(best["spring_rate"], "springs/s")) + spread(best)
                 + (remark("uncertain by a tenth or more: " + best["noisy"]) if best["noisy"] else ""),
                 strip(charts, each, (min(times), max(times))), limit]
        if best["rounding"] is None:
            cells.append("–")
        else:
            cells.append(f"<b>{figures.error_text(best['rounding'])}</b>" + small(f"after {best['error_steps']} steps"))
        heading = escape(best["scene"]) + small(figures.engineering(best["particles"], "particles"))
        rows.append((best["scene"], heading, cells + [other]))
    return cards(["Dataset", "Fastest strategy", "A step", "Every backend", "Of limit", "Rounding error",
                  f"Fastest within {figures.error_text(SMALL_ERROR)}"], rows)


def error_table(runs):
    """What reaches an error soonest, a row for each dataset."""
    rows = []
    for (scene,), group in figures.groups(runs, "scene").items():
        cells = []
        for target in figures.TARGETS:
            row = figures.fastest_within(group, target)
            cells.append("not reached" if row is None else
                         f"<b>{escape(figures.time_text(row['seconds'] * 1e6))}</b>"
                         + f'<small class="remark">{strategy(row["contender"])}</small>'
                         + small(f"in {row['steps']} steps"))
        rows.append((scene, escape(scene) + small(f"to t = {group[0]['end_time']:.3g}"), cells))
    return cards(["Dataset"] + [f"Error of {figures.error_text(target)}" for target in figures.TARGETS], rows)


def amount(quantity, value):
    """The value of a target's quantity, in the units of the page."""
    if quantity.endswith(("seconds", "seconds_per_step")):
        return figures.time_text(value * 1e6)
    if quantity.endswith("_per_second"):
        return figures.engineering(value, quantity.removesuffix("_per_second").replace("_updates", "s") + "/s")
    return figures.percent(value) if quantity.startswith("fraction_of") else f"{value:.3g}"


QUANTITIES = {"seconds_per_step": "time per step", "ready_seconds": "time to first step", "fraction_of_limit": "of limit",
              "speed_ratio": "speed", "spring_updates_per_second": "springs per second", "particle_updates_per_second": "particles per second"}


def targets_table(result):
    rows, without = [], 0
    for block in result.lists["fastest"]:
        for target in block["targets"]:
            if target.get("met") is None or target.get("measured") is None:
                without += 1
                continue
            what = QUANTITIES.get(target["quantity"], target["quantity"].replace("_", " "))
            over = small(f"as a multiple of {target['over']}") if target.get("over") else ""
            rows.append((block["scene"], escape(block["scene"]) + small(f"{block['formulation']}, {block['precision']}"),
                         [strategy(target.get("backends") or "all backends"), escape(what) + over,
                          escape(amount(target["quantity"], target["value"])), escape(amount(target["quantity"], target["measured"])),
                          "met" if target["met"] else "missed"]))
    if not rows:
        return ""
    more = "1 more target was" if without == 1 else f"{without} more targets were"
    note = f'<p class="note">{more} not measured here.</p>' if without else ""
    return cards(["Dataset", "Of", "Quantity", "Aim", "Measured", "Verdict"], rows) + note


def by_size(entries):
    """Which backends win which sizes of a dataset as a headline and as a sentence, or nothing where no such order shows."""
    found = figures.ladder(entries)
    if not found:
        return None
    family, steps = found
    last, headline_words, words = len(steps) - 1, [], []
    for index, (backends, on_chip, particles) in enumerate(steps):
        size = figures.engineering(particles, "particles")
        until = "beyond" if index == last else f"up to {size}"
        headline_words.append(f"{'on chip' if on_chip else figures.listed(backends)} {until}")
        verb = "" if index else " are the fastest" if len(backends) > 1 else " is the fastest"
        words.append(f"{figures.listed(backends)}{verb} up to {size}{', with the state on the chip,' * on_chip}")
    return f"{family}: {', '.join(headline_words)}", f"Of the sizes of {family}, {figures.listed(words)}".removesuffix(",")


def headline(found, runs, drawn):
    """The machine, the answer in a line, and in a few more sentences; without any of times or errors the first finding."""
    if found:
        machine, entries = next(iter(found.items()))
        told = [entry.best for entry in entries if entry.won]
        sizes = by_size(entries)
        lead = ""
        if len(entries) <= figures.FEW:
            wins = figures.groups(told, "backend").items()
            parts = [f"{name} is the fastest on {figures.listed(row['scene'] for row in rows)}" for (name,), rows in wins]
            parts += [f"{names([entry.best] + entry.equals)} cannot be told apart on {entry.best['scene']}" for entry in entries if entry.equals]
            parts += [f"the main contenders are not measured on {entry.best['scene']}" for entry in entries if entry.absent and not entry.equals]
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


def answer(charts, results, rows, runs, drawn, pictures):
    found = figures.outcomes(results, rows)
    machine, title, lead = headline(found, runs, drawn)
    papers = {(result.machine, block["scene"], reading.contender(block)): block["paper"]["ratio"]
              for result in results for block in result.lists["fastest"]
              if block.get("paper") and block["paper"]["name"] != block["name"]}
    kicker = f"Voxspring on {machine}, " * bool(machine) + f"results of {len(results)} {'study' if len(results) == 1 else 'studies'}"
    parts = [f'<header><p class="kicker">{escape(figures.sentence(kicker))}</p><h1>{escape(title)}</h1><div class="opening-row">'
             f'<p class="lead">{escape(lead)}</p>{opening_picture(pictures)}</div></header><main>']
    for machine in dict.fromkeys(list(found) + figures.distinct(runs, "machine")):
        parts.append(f'<section class="answer"><h2>{escape(machine)}: the fastest strategy on each dataset, and what it '
                     "costs in error</h2>")
        if machine in found:
            parts.append(fastest_table(charts, found[machine], papers))
            parts.append('<p class="note">Fastest over every formulation, precision and tuning that was measured. Every '
                         "backend: its best time on one logarithmic line, fastest left, in the colours of the figures. Of "
                         "limit: the share of what the device allows at best by its own measured rates. The rounding error "
                         "is the relative L2 distance of displacements from float64 after the same steps.</p>")
        of_machine = [row for row in runs if row["machine"] == machine]
        if of_machine:
            parts.append("<h3>Fastest way to a total error, of rounding and time step together</h3>"
                         + error_table(of_machine))
        studies = [result for result in results if result.machine == machine and result.lists["fastest"]]
        table = targets_table(studies[-1]) if studies else ""
        if table:
            parts.append("<h3>Targets</h3>" + table)
        parts.append("</section>")
    return f"{machine}: {title}" if machine else title, "".join(parts)


def filters(charts, results):
    scenes = sorted({row["scene"] for result in results for name in reading.MEASURED for row in result.lists[name]},
                    key=reading.natural)
    options = "".join(f'<option value="{escape(scene)}">{escape(scene)}</option>' for scene in scenes)
    boxes = "".join(f'<label><input type="checkbox" checked value="{escape(name)}">'
                    f"{swatch(figures.SHAPES[reading.family(name)], charts.colours[name])}{escape(name)}</label>"
                    for name in charts.backends)
    return ('<form id="filters" aria-label="Filters of all figures" tabindex="0"><label>Dataset '
            f'<select id="scene"><option value="">all</option>{options}</select></label>'
            f'<button type="button" id="all">All or no backends</button><fieldset aria-label="Backends">{boxes}</fieldset>'
            "</form>")


def key(words):
    items = []
    if "formulation" in words:
        shapes = figures.FORMULATIONS
        coloured = "backend" not in words
        items += [swatch(shape, f"var(--{name})" if coloured else "var(--soft)") + name
                  for name, shape in shapes.items()]
    if "precision" in words:
        items += ["— float32", "··· float64"]
    if "handed_over" in words:
        items += [swatch(shape, "var(--soft)") + how for how, shape in figures.HANDED_OVER.items()]
    if "region" in words:
        items += [swatch("square", f"var(--{name})") + f"{name[0]}: {name}" for name in reading.REGIONS]
    return f'<ul class="key">{"".join(f"<li>{item}</li>" for item in items)}</ul>' if items else ""


def figure_section(figure):
    files = {}
    for result in figure.results:
        files.setdefault(result.origin(), []).append(result.path.name)
    captions = "<br>".join(escape(f"{origin} ({', '.join(names)})") for origin, names in files.items())
    panels = "".join(f'<figure><h3>{escape(panel.heading)}</h3><div class="chart" id="{figure.name}-{index}"></div>'
                     "</figure>" for index, panel in enumerate(figure.panels))
    finding = f'<p class="finding">{escape(figure.detail)}</p>' if figure.detail else ""
    return (f'<section data-figure="{figure.name}"><h2>{escape(figure.title)}</h2>'
            f'{finding}<p class="note">{escape(figure.note)}</p>{key(figure.legend)}<div class="panels">{panels}</div><p class="empty" hidden>Nothing here matches the '
            f'filters.</p><p class="caption">{captions}</p><details data-figure="{figure.name}"><summary>The numbers '
            f'behind it: {len(figure.rows)} rows</summary><div class="scroll" tabindex="0" role="region" '
            f'aria-label="Rows of {escape(figure.title)}"></div></details></section>')


def shown_by(picture):
    """What a picture shows in words, its largest value included."""
    about = picture.about
    steps = f"{about['steps']} step{'s' * (about['steps'] != 1)}"
    # As BackendSpec::label() has it: backend/formulation/precision and tuning.
    by = about["backend"].replace("/", " ")
    if picture.coloured_by == "displacement":
        return f"{about['scene']} after {steps} of {by}, coloured by displacement: at most {about['largest']:.3g}"
    if about["largest"] == 0:
        return f"{about['scene']} after {steps} of {by}, coloured by the error: none against float64"
    return (f"{about['scene']} after {steps} of {by}, coloured by the error against float64: at most "
            f"{figures.error_text(about['largest'])}")


def image(picture):
    return (f'<img width="{picture.width}" height="{picture.height}" alt="{escape(shown_by(picture))}" '
            f'src="data:image/png;base64,{base64.b64encode(picture.data).decode()}">')


def opening_picture(pictures):
    """The first dataset beside the headline."""
    if not pictures:
        return ""
    first = next(iter(pictures.values()))[0]
    return (f'<figure class="picture opening">{image(first)}<figcaption>The dataset {escape(first.scene)} after '
            f'{first.about["steps"]} steps; <a href="#pictures">all datasets, and the error on them</a></figcaption></figure>')


def pictures_section(pictures, left_out):
    """The deformed body and the error on it, a dataset a row."""
    if not pictures and not left_out:
        return ""
    errors = {scene: pair[1].about for scene, pair in pictures.items()}
    title = "The datasets deformed, and the error on them"
    if errors:
        scene, about = max(errors.items(), key=lambda item: item[1]["largest"])
        title += f": the largest, {figures.error_text(about['largest'])}, is on {scene}"
    rows = []
    for scene, pair in pictures.items():
        figures_of = "".join(f'<figure class="picture">{image(picture)}<figcaption>{escape(shown_by(picture))}</figcaption>'
                             "</figure>" for picture in pair)
        heading = escape(scene) + ", " + figures.engineering(pair[0].about["particles"], "particles")
        rows.append(f'<div class="pair" data-scene="{escape(scene)}"><h3>{heading}</h3>'
                    f'<div class="panels">{figures_of}</div></div>')
    renderers = figures.listed(dict.fromkeys(picture.about["renderer"] for pair in pictures.values() for picture in pair))
    note = (f"Runs of the machine that made this page, in the formulation and precision that were the fastest on the "
            f"dataset, drawn by {renderers}. The error is each particle's distance from where float64 has it after the same "
            "steps, in the dataset's unit of length, on a logarithmic scale." if pictures else "")
    reasons = "; ".join(f"{figures.listed(scenes)} ({reason})" for scenes, reason in left_out)
    without = f'<p class="caption">Without a picture: {escape(reasons)}.</p>' if left_out else ""
    if not pictures:
        return f'<section id="pictures"><h2>The datasets</h2>{without}</section>'
    return (f'<section id="pictures"><h2>{escape(title)}</h2><p class="note">{escape(note)}</p>{"".join(rows)}{without}'
            "</section>")


def sources_section(results):
    rows = []
    for result in results:
        counts = {name: len(result.lists[name]) for name in reading.REQUIRED}
        measured = sum(counts.values()) - counts["failed"] - counts["skipped"]
        rows.append(("", escape(result.path.name) + small(f"study {result.study}"), [
            escape(result.machine) + (small(f"driver {result.driver}") if result.driver else ""),
            escape(result.commit) + small(result.date[:16].replace("T", " ")),
            f"{measured}" + small(f"{counts['failed']} failed, {counts['skipped']} skipped")]))
    table = cards(["File", "Machine", "Commit and date", "Rows"], rows)
    failed = [f'<li><code>{escape(row["name"])}</code>: {escape(row["reason"])} ({escape(result.path.name)})</li>'
              for result in results for row in result.lists["failed"]]
    failures = ""
    if failed:
        failures = f'<details><summary>What failed: {len(failed)} rows</summary><ul>{"".join(failed)}</ul></details>'
    return f"<section><h2>What this page was made from</h2>{table}{failures}</section>"


def script_safe(text):
    """Text inside a script element, which the first </script would end."""
    return text.replace("</", "<\\/").replace("<!--", "<\\!--")


def compact(figure):
    used = {column[0] for column in figure.columns}
    used |= {key for panel in figure.panels for key in [*panel.match, *(panel.step or ())[:1]]}
    drawn = json.dumps([panel.spec for panel in figure.panels])
    used |= {name for name in figure.rows[0] if name in drawn}
    names = sorted(used)
    rows = [[reading.significant(row[name]) for name in names] for row in figure.rows]
    return {"name": figure.name, "columns": figure.columns, "keys": names, "rows": rows,
            "panels": [{"match": panel.match, "spec": panel.spec, "step": panel.step} for panel in figure.panels]}


def page(results, pictures, left_out):
    """The whole page as text: pictures by dataset, and (datasets, why they have none)."""
    # The machine with most rows of time comes first everywhere.
    weight = collections.Counter()
    for result in results:
        weight[result.machine] += len(result.lists["benchmarks"])
    results = sorted(results, key=lambda result: -weight[result.machine])
    charts, drawn = figures.all_figures(results)
    rows, runs = reading.measured(results), figures.latest_runs(results)
    title, opening = answer(charts, results, rows, runs, drawn, pictures)
    data = json.dumps({"config": figures.CONFIG, "figures": [compact(figure) for figure in drawn]}, ensure_ascii=False, separators=(",", ":"))
    files = importlib.resources.files(__package__)
    style, script = ((files / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    return "".join((
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{escape(title)}</title><style>{style}</style></head><body>", opening,
        '<noscript><p>The figures below need JavaScript; all of it is in this file.</p></noscript>',
        filters(charts, results), *map(figure_section, drawn), pictures_section(pictures, left_out), sources_section(results),
        f'</main><script type="application/json" id="report">{script_safe(data)}</script>'
        f"<script>{script_safe_bundle()}</script><script>{script}</script></body></html>\n"))


@functools.cache
def script_safe_bundle():
    """The chart library, whose source takes two seconds to put together."""
    bundle = vl_convert.javascript_bundle()
    if "</script" in bundle or "<!--" in bundle:
        raise RuntimeError("the chart library cannot be inlined: it contains the end of a script")
    return bundle
