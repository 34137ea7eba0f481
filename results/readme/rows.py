"""Reads the rows of the committed results, writes their figures as text, and prepares the tables of tables.jinja."""

import argparse
import collections
import csv
import functools
import math
import pathlib
import statistics

import result_files
from result_files import aim_verdict, distinct, groups, listed, name_of

RESULTS = pathlib.Path(__file__).resolve().parent.parent
GPU, CPU = "nvidia-h200", "amd-epyc"
# The strategies that the paper compares, as harness/study/fastest.cpp has them (a test compares both).
PAPER = ("gl_fragment_implicit", "gl_fragment_explicit", "cuda_implicit_device", "cuda_implicit_shared",
         "cuda_implicit_cached", "cuda_explicit_device", "cuda_explicit_cached", "cuda_explicit_cached_grid")
FORMULATIONS = ["paper", "position", "displacement", "increment", "compensated"]


class Missing(Exception):
    """Raised if no committed result has what is asked for."""


def is_check(description):
    """Whether a script was called with --check, its one option. Any other argument ends the script with exit code 2."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a file is out of date")
    return parser.parse_args().check


@functools.lru_cache(maxsize=None)
def loaded(path):
    found = result_files.load(path)
    result_files.check_agreement(path, found)
    return found


def result(study, machine=GPU):
    return loaded(result_files.named(RESULTS / machine, study))


def having(study):
    """The machines with a committed result of a study."""
    return [path.parent.name for path in result_files.committed(RESULTS) if result_files.study_of(path) == study]


def studies(machine=GPU):
    """The results of a machine by study."""
    return {result_files.study_of(path): loaded(path) for path in result_files.within(RESULTS / machine)}


def machines(study):
    """The result of a study on every machine that has one."""
    return [result(study, machine) for machine in having(study)]


def limits_of_machine(machine=GPU):
    """The best value of each limit over all studies of a machine."""
    return result_files.best_limits(studies(machine).values())


def about_backend(one, row):
    """What a result says of the backend of a row."""
    about = one["context"]["voxspring"]["backends"].get(row["backend"], {})
    return {"family": result_files.family(about), "limits_of": result_files.limits_of(about),
            "addressing": result_files.addressing(row["backend"], about), "on_card": bool(about.get("uuid"))}


def widest(*spreads):
    """The largest of the spreads that are known; None if none is."""
    return max((spread for spread in spreads if spread is not None), default=None)


def medians_of(one):
    """The median row of each case of a result, with the relative spread of its times and what the result says of its backend.
    A backend on the host is timed in several processes, whose medians may differ by more than the repetitions of one."""
    return [row | {"spread": widest(result_files.spread_of(row["times"]), row.get("process_spread"))} | about_backend(one, row)
            for row in result_files.medians(one["benchmarks"], one.get("verification", []))]


def medians(study, machine=GPU):
    return medians_of(result(study, machine))


def by_case(one):
    return {result_files.case_of(row): row for row in medians_of(one)}


def by_name(one):
    """The median rows by the names of their cases, each of which has one number of steps."""
    found = {}
    for row in medians_of(one):
        if name_of(row) in found:
            raise Missing(f"{name_of(row)} has rows of several numbers of steps")
        found[name_of(row)] = row
    return found


def tuning_of(row):
    """The tuning parameters of a row that are not at their defaults."""
    return name_of(row).split("/")[4:]


def contender(row):
    """A row's strategy, such as `cuda_implicit_cached fetch=l1`: backend, precision unless float32, tuning not at its default."""
    _, backend, _, precision, *tuning = name_of(row).split("/")
    return " ".join([f"`{backend}`"] + [precision] * (precision != "float32") + tuning)


def is_papers(row):
    """Whether a row is of a strategy of the paper. Plain L1-cached loads are not, since they came after the paper (2008)."""
    return row["backend"] in PAPER and "fetch=l1" not in tuning_of(row)


def alike(rows, row):
    """The rows with the dataset, formulation, precision and number of steps of `row`: those among which the fastest is chosen."""
    return [other for other in rows if all(other[key] == row[key] for key in ("scene", "formulation", "precision", "steps"))]


# A row with at least this many repetitions has them divided: one half takes part in choosing the fastest row, the
# other half is reported. All of fewer repetitions do both, as in medians_of_halves() (harness/base/statistics.h).
FEWEST_TO_DIVIDE = 4


def divided(row):
    """(median of every other repetition from the first on, by which a row is chosen; median of the others, which is reported)."""
    times = row.get("times", ())
    if len(times) < FEWEST_TO_DIVIDE:
        return row["real_time"], row["real_time"]
    return statistics.median(times[0::2]), statistics.median(times[1::2])


def held_out(row):
    """A row with the time of its reported repetitions (divided()), and with its rates and share of its limit for that time."""
    time = divided(row)[1]
    rates = {key: row[key] * row["real_time"] / time
             for key in ("particle_updates_per_second", "spring_updates_per_second", "fraction_of_limit") if row.get(key)}
    return row | rates | {"real_time": time}


def fastest_of(rows):
    """The fastest of several rows, as the study `fastest` chooses it: one half of the repetitions chooses the row,
    the other half is reported.

    The least of many medians is partly due to chance. The reported half of the repetitions does not have that
    bias. A single row needs no choice and keeps all its repetitions.
    """
    if len(rows) == 1:
        return rows[0]
    return held_out(min(rows, key=lambda row: divided(row)[0]))


def three_digits(value):
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def giga(value):
    return three_digits(value * 1e-9)


def figure(value):
    """A ratio or a time as text for a sentence: two decimals from 0.1 to 10, else three significant digits."""
    return f"{value:.2f}" if 0.1 <= abs(value) < 10 else three_digits(value)


def microseconds(value):
    return three_digits(value) if value is not None else "-"


def percent(value):
    return f"{100 * value:.0f} %" if value is not None else "-"


def as_known(value, *rows, decimals=2):
    """`value`, a ratio or a share that times of `rows` give, with as many digits as their spreads justify."""
    return result_files.as_known(value, *(row.get("spread") for row in rows), decimals=decimals)


def ratio_text(row, base):
    """The time of `row` over that of `base`, as text."""
    return as_known(row["real_time"] / base["real_time"], row, base)


def share(row):
    """The share of its limit that a row reaches, as text."""
    fraction = row.get("fraction_of_limit")
    return f"{as_known(100 * fraction, row, decimals=0)} %" if fraction is not None else "-"


def share_of_sum(row):
    """The sum of the terms of a row's limit as a share of its time, as text: more than 100 % if the terms overlap."""
    terms = row.get("limit_sum_seconds")
    return f"{as_known(100e6 * terms / row['real_time'], row, decimals=0)} %" if terms else "-"


def sustained(row):
    """The time of a step in us while batches follow each other without a pause; a dash if that was not measured."""
    seconds = row.get("sustained_seconds_per_step")
    return microseconds(seconds * 1e6 if seconds else None)


def without_sustained(rows):
    """A sentence on why no row of a table has a sustained time; empty if a row has one."""
    old = all("sustained_seconds_per_step" not in row for row in rows)
    return "A dash under *sustained*: files of this commit have bursts alone. " * old


def marked(row, text):
    """A figure, with a mark (~) if the row's run says that its times are not to be trusted."""
    return "~" * bool(row.get("noisy")) + text


def spread_text(row):
    """` ± 6 %`, the spread of a row, if it is MIN_SPREAD or more; otherwise empty."""
    return f" ± {percent(row['spread'])}" if (row.get("spread") or 0) >= result_files.MIN_SPREAD else ""


def time_of(row):
    """The median of a row, marked, with its spread."""
    return marked(row, microseconds(row["real_time"])) + spread_text(row)


# --- What tables are made of --------------------------------------------------------------------------------

def papers(row):
    return "paper" if is_papers(row) else "later"


def limit_of(row):
    """The share of its limit that a row reaches, then in parentheses the limit's name if it binds, and share_of_sum()."""
    if not row["fraction_of_limit"]:
        return "-"
    words = [result_files.binder(row), row.get("limit_sum_seconds") and f"sum {share_of_sum(row)}"]
    return share(row) + f" ({', '.join(filter(None, words))})" * any(words)


@functools.cache
def profiles():
    """The issue slots that a profiler counted on H200s, in percent of those of an SM at work, by formulation; empty: not profiled."""
    with open(RESULTS / "readme/profiles.csv", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def slots_of(row):
    """The issue slots that the strategy of a row of an H200 fills on its dataset, if it was profiled there."""
    found = [one.get(row["formulation"]) for one in profiles() if (one["scene"], one["backend"]) == (row["scene"], row["backend"])]
    return f"{found[0]} %" if any(found) and row["precision"] == "float32" else "-"


def contenders(rows):
    """[(contender, its rows by scene)], in the order of the file."""
    return [(name, {row["scene"]: row for row in own}) for (name,), own in groups(rows, contender).items()]


def fastest_first(rows):
    """contenders(rows), sorted by their times on the first scene."""
    first = rows[0]["scene"]
    return sorted(contenders(rows), key=lambda line: line[1][first]["real_time"] if first in line[1] else math.inf)


def headings(rows, *texts):
    """The formats `texts`, filled for each scene: {key} is the value in the scene's first row, and {edge} is 32 for box@32."""
    firsts = [own[0] | {"edge": own[0]["scene"][4:]} for own in groups(rows, "scene").values()]
    return [text.format_map(row) for row in firsts for text in texts]


def thresholds(rows):
    """Sentences below a table: the thresholds on the errors of its rows, and the rows of which some repetitions were not judged."""
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
    """The results of the study fastest of each card, and [(dataset, formulation, precision, steps, [its fastest row or None on
    each card])] for datasets that two cards or more have measured."""
    results = [one for one in machines("fastest") if one["context"]["voxspring"].get("gpu")]
    best = [{(row["scene"], row["formulation"], row["precision"], row["steps"]): held_out(known[result_files.case_of(row)])
             for row in one["fastest"]} for one, known in ((one, by_case(one)) for one in results)]
    measured = [key for key in dict.fromkeys(key for of_card in best for key in of_card) if sum(key in of_card for of_card in best) > 1]
    return results, [(*key, [of_card.get(key) for of_card in best]) for key in measured]


def copy_rate(one):
    """Bytes per second, read and written, of a copy beyond the card's cache."""
    copies = [size for size in one["context"]["voxspring"]["limits"]["CUDA"]["bandwidth"] if size["written_share"] == 0.5]
    return max(copies, key=lambda size: size["footprint_bytes"])["bytes_per_second"]


def slow_down(row):
    return row["real_time"] * 1e-6 / row["seconds_per_step_without_edits"] - 1


# Without edits a backend steps the same body in every scene of the study edits. If these times are further apart than this share,
# not all of them are right, and slow-downs over them are not to be trusted.
MAX_APART = 0.1


def edited(rows):
    """Rows of the study edits, those with times without edits that are too far apart marked as noisy."""
    found = []
    for own in groups(rows, contender).values():
        times = [row["seconds_per_step_without_edits"] for row in own]
        apart = ["times without edits differ"] * (max(times) > (1 + MAX_APART) * min(times))
        found += [row | {"noisy": (row.get("noisy") or []) + apart} for row in own]
    return found


def tunings():
    """Yields (row with the default tuning or None, row with the best tuning, number of tunings tried) for each strategy and
    scene."""
    for _, rows in sorted(groups(medians("tuning"), "backend", "scene").items()):
        default = next((row for row in rows if not tuning_of(row)), None)
        if default and len(rows) > 1:
            default = held_out(default)
        best = fastest_of(rows)
        slower = default and default["real_time"] >= best["real_time"] * (1 + result_files.MIN_SPREAD)
        yield default, best if slower or not default else default, len(rows)


def multiples():
    """Yields (case, its row in the formulation position, [its row or None in each of FORMULATIONS]) for cases whose tuning is at
    most a fetch path."""
    rows = [row for row in medians("formulations") if all(part.startswith("fetch=") for part in tuning_of(row))]
    for (scene, count, name), group in groups(rows, "scene", "steps", contender).items():
        known = {row["formulation"]: row for row in group}
        if "position" in known:
            yield f"{name}, {scene}, {count} steps", known["position"], [known.get(name) for name in FORMULATIONS]


def worst_measurements():
    """Yields (measurement, [(largest error, gate or None) for each of FORMULATIONS]) from the parts of the stress suite about
    rounding."""
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
    """[(entry of the list `fastest`, target)] for the targets of a result that were measured."""
    return [(block, target) for block in one["fastest"] for target in block["targets"] if target["measured"] is not None]


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
    """Milliseconds from the start to the first step, with their spread, as two texts: with no kernel in the disk cache
    (and in parentheses the time of compiling), and with all kernels there. A dash stands for a start that was not measured.
    """
    compiling = f" ({milliseconds(row, 'compile_seconds')})" if row.get("compile_seconds") else ""
    return [milliseconds(row, "ready_seconds") + spread_text({"spread": row.get("ready_spread")}) + compiling,
            milliseconds(row, "warm_ready_seconds") + spread_text({"spread": row.get("warm_ready_spread")})]


def resting_cases():
    """[(case, {scene: (row that steps all tiles, row that skips tiles at rest, share of tiles that the second row stepped)})]."""
    work = {row["name"]: row["work"] for row in result("skips")["verification"] if "work" in row}
    times, cases = by_name(result("skips")), {}
    for name, skipping in times.items():
        plain, _, way = name.partition("/rest=")
        if way in ("skip", "flush"):
            title = f"`{skipping['backend']}` {skipping['formulation']}" + ", flush" * (way == "flush")
            cases.setdefault(title, {})[skipping["scene"]] = (
                times[plain + "/rest=step"], skipping, work[name]["tiles_stepped"] / work[name]["tiles"])
    return sorted(cases.items())


def resting_rows():
    return [row for _, scenes in resting_cases() for whole, moving, _ in scenes.values() for row in (whole, moving)]


def cross_check(row):
    """The difference in percent between the power by samples and the power by the energy counter; "no" without samples."""
    if row.get("sampled_watts") is None:
        return "no"
    return f"yes, {100 * abs(row['sampled_watts'] / row['watts'] - 1):.1f} %"


def card_ids(one):
    """The identities of the cards that a result is of."""
    return sorted({backend["uuid"] for backend in one["context"]["voxspring"]["backends"].values() if backend.get("uuid")})


def marked_files():
    """Yields (study, result, letters of its cards, least and most repetitions, counts) for each file. The counts are the number of
    rows that their run marked as noisy, of all rows, and of rows marked because of other processes on the card."""
    cards = {}
    for study, one in studies().items():
        counts = collections.Counter(row["name"] for row in one["benchmarks"] if row["run_type"] == "iteration").values()
        noisy = ["; ".join(row.get("noisy") or []) for row in medians_of(one)]
        yield (study, one, [chr(ord("A") + cards.setdefault(uuid, len(cards))) for uuid in card_ids(one)],
               sorted({min(counts), max(counts)}) if counts else [],
               (sum(map(bool, noisy)), len(noisy), sum("other processes" in reasons for reasons in noisy)))
