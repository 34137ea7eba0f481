"""What the tables of tables.jinja are made of."""

import collections
import math

import result_files
from readme.rows import (
    GPU, RESULTS, by_name, contender, fastest_of, giga, held_out, is_papers, loaded, machines, medians, medians_of, percent, result, share,
    share_of_sum, three_digits, time_of, tuning_of,
)
from result_files import distinct, groups, listed

FORMULATIONS = ["paper", "position", "displacement", "increment", "compensated"]


def papers(row):
    return "paper" if is_papers(row) else "later"


def limit_of(row):
    """What share of its limit a row reaches, which limit that is if it binds, and the share of the sum of its terms."""
    if not row["fraction_of_limit"]:
        return "-"
    words = [result_files.binder(row), row.get("limit_sum_seconds") and f"sum {share_of_sum(row)}"]
    return share(row) + f" ({', '.join(filter(None, words))})" * any(words)


def contenders(rows):
    """[(contender, its rows by scene)], in the order of the file."""
    return [(name, {row["scene"]: row for row in own}) for (name,), own in groups(rows, contender).items()]


def fastest_first(rows):
    """Contenders by their times on the first scene."""
    first = rows[0]["scene"]
    return sorted(contenders(rows), key=lambda line: line[1][first]["real_time"] if first in line[1] else math.inf)


def headings(rows, *texts):
    """`texts` for each scene, as formats: {key} is the value in the scene's first row, and {edge} is 32 for box@32."""
    firsts = [own[0] | {"edge": own[0]["scene"][4:]} for own in groups(rows, "scene").values()]
    return [text.format_map(row) for row in firsts for text in texts]


def thresholds(rows):
    """Sentences below a table: by which thresholds the errors of its rows were judged, and in which rows some repetitions were not."""
    scenes = {}
    for (scene, formulation, precision), own in groups(rows, "scene", "formulation", "precision").items():
        name = formulation + f" {precision}" * (precision != "float32")
        scenes.setdefault(scene, {})[name] = " or ".join(distinct(own, "bound"))
    one = len(set().union(*scenes.values())) == 1
    texts = (f"{scene} " + ", ".join(text if one else f"{name} {text}" for name, text in models.items())
             for scene, models in scenes.items())
    partly = groups((row for row in rows if row["partly"]), "partly").items()
    judged_in_part = (f" {text}: {listed(contender(row) + ' on ' + row['scene'] for row in own)}." for (text,), own in partly)
    return f"Threshold on the error over the motion: {'; '.join(texts)}.{''.join(judged_in_part)}"


def across_cards():
    """The results of `fastest` of each card, and [(dataset, formulation, precision, its fastest row on each card, or None)] for what
    two cards or more have measured."""
    results = [one for one in machines("fastest") if one["context"]["voxspring"].get("gpu")]
    best = [{(row["scene"], row["formulation"], row["precision"]): held_out(by_name(one)[row["name"]]) for row in one["fastest"]}
            for one in results]
    measured = [key for key in dict.fromkeys(key for of_card in best for key in of_card) if sum(key in of_card for of_card in best) > 1]
    return results, [(*key, [of_card.get(key) for of_card in best]) for key in measured]


def copy_rate(one):
    """Bytes per second, read and written, of a copy beyond the card's cache."""
    copies = [size for size in one["context"]["voxspring"]["limits"]["CUDA"]["bandwidth"] if size["written_share"] == 0.5]
    return max(copies, key=lambda size: size["footprint_bytes"])["bytes_per_second"]


def slow_down(row):
    return row["real_time"] * 1e-6 / row["seconds_per_step_without_edits"] - 1


def tunings():
    """(row with the default tuning or None, row with the best one, number of tunings tried) of each strategy and scene."""
    for _, rows in sorted(groups(medians("tuning"), "backend", "scene").items()):
        default = next((row for row in rows if not tuning_of(row)), None)
        if default and len(rows) > 1:
            default = held_out(default)
        best = fastest_of(rows)
        slower = default and default["real_time"] >= best["real_time"] * (1 + result_files.MIN_SPREAD)
        yield default, best if slower or not default else default, len(rows)


def multiples():
    """(case, its row of `position`, its row or None for each of FORMULATIONS) of cases that tune at most the fetch path."""
    rows = [row for row in medians("formulations") if all(part.startswith("fetch=") for part in tuning_of(row))]
    for (scene, count, name), group in groups(rows, "scene", "steps", contender).items():
        known = {row["formulation"]: row for row in group}
        if "position" in known:
            yield f"{name}, {scene}, {count} steps", known["position"], [known.get(name) for name in FORMULATIONS]


def worst_measurements():
    """(measurement, (largest error, gate or None) for each of FORMULATIONS), from the parts of the stress suite about rounding."""
    rows = [row for row in result("stress")["stress"] if row["part"] in (7, 9) and row["precision"] == "float32"]
    for (measurement, scene, count), group in groups(rows, "measurement", "scene", "steps").items():
        own = {formulation: (max(math.inf if row["measured"] is None else row["measured"] for row in of), of[-1]["gate"])
               for (formulation,), of in groups(group, "formulation").items()}
        if len(own) == len(FORMULATIONS):
            yield f"{measurement}, {scene}, {count} steps", [own[name] for name in FORMULATIONS]


def start_of(row):
    start = row["start"]
    return f"{start['kind']} {start['amplitude'] or start['stretch']:g}, damping {row['damping']:g}"


def aims(one):
    """(entry of the list `fastest`, target) for the measured targets of a result."""
    return [(block, target) for block in one["fastest"] for target in block["targets"] if target["met"] is not None]


def title_of(block):
    return f"{block['scene']} {block['formulation']} {block['precision']}"


def best_cell(rows):
    row = fastest_of(rows)
    return f"{time_of(row)} ({contender(row).replace('`', '')}, of {len(rows)})"


def quantity(target, value):
    kind = target["quantity"]
    if kind in ("seconds_per_step", "ready_seconds"):
        return f"{three_digits(value * 1e6)} us" if value < 1e-2 else f"{three_digits(value)} s"
    if kind == "fraction_of_limit":
        return f"{percent(value)} of the limit"
    if kind == "speed_ratio":
        return f"{value:.2f} of the speed of `{target['over']}`"
    return f"{giga(value)} G {kind.split('_')[0]}s/s"


def milliseconds(row, key):
    return three_digits(row[key] * 1e3) if row.get(key) is not None else "-"


def starts_of(row):
    """Milliseconds from the start to the first step: with no kernel in the disk cache (of which compiling, in
    parentheses), and with all kernels there. A dash stands for a start that the study left out.
    """
    compiling = f" ({milliseconds(row, 'compile_seconds')})" if row.get("compile_seconds") else ""
    return [milliseconds(row, "ready_seconds") + compiling, milliseconds(row, "warm_ready_seconds")]


def resting():
    """[(case, {scene: (row that steps all tiles, row that skips tiles at rest, share of the tiles that the latter stepped)})]."""
    work = {row["name"]: row["work"] for row in result("skips")["verification"] if "work" in row}
    times, cases = by_name(result("skips")), {}
    for name, skipping in times.items():
        plain, _, way = name.partition("/rest=")
        if way in ("skip", "flush"):
            title = f"`{skipping['backend']}` {skipping['formulation']}" + ", flush" * (way == "flush")
            cases.setdefault(title, {})[skipping["scene"]] = (
                times[plain + "/rest=step"], skipping, work[name]["tiles_stepped"] / work[name]["tiles"])
    return sorted(cases.items())


def cross_check(row):
    """The difference between the sampled power and that of the energy counter in percent, or "no" if the device has no samples."""
    if row.get("sampled_watts") is None:
        return "no"
    return f"yes, {100 * abs(row['sampled_watts'] / row['watts'] - 1):.1f} %"


def results_of(machine=GPU):
    return [loaded(path) for path in result_files.within(RESULTS / machine)]


def cards_of(one):
    """The identities of the cards that a result is of."""
    return sorted({backend["uuid"] for backend in one["context"]["voxspring"]["backends"].values() if backend.get("uuid")})


def files():
    """(study, result, letters of its cards, least and most repetitions, counts) of each file. The counts are those of rows that
    their run marked, of all rows, and of rows that it marked because of other processes on the card."""
    cards = {}
    for path in result_files.within(RESULTS / GPU):
        one = loaded(path)
        counts = collections.Counter(row["name"] for row in one["benchmarks"] if row["run_type"] == "iteration").values()
        noisy = ["; ".join(row.get("noisy") or []) for row in medians_of(one)]
        yield (result_files.study_of(path), one, [chr(ord("A") + cards.setdefault(uuid, len(cards))) for uuid in cards_of(one)],
               sorted({min(counts), max(counts)}) if counts else [],
               (sum(map(bool, noisy)), len(noisy), sum("other processes" in reasons for reasons in noisy)))
