"""Rows of the committed results, and how their figures are written."""

import functools
import pathlib
import statistics

import result_files
from result_files import name_of

RESULTS = pathlib.Path(__file__).resolve().parent.parent
GPU, CPU = "nvidia-h200", "amd-epyc"
# The strategies that the paper compares, as harness/study/fastest.cpp has them (a test compares both).
PAPER = ("gl_fragment_implicit", "gl_fragment_explicit", "cuda_implicit_device", "cuda_implicit_shared",
         "cuda_implicit_cached", "cuda_explicit_device", "cuda_explicit_cached", "cuda_explicit_cached_grid")


class Missing(Exception):
    """No committed result has what is asked for."""


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


def machines(study):
    """The result of a study on every machine that has one."""
    return [result(study, machine) for machine in having(study)]


def limits_of_machine(machine=GPU):
    """The best value of each limit over all studies of a machine."""
    return result_files.best_limits(loaded(path) for path in result_files.within(RESULTS / machine))


def about_backend(one, row):
    """What a result says of the backend of a row."""
    about = one["context"]["voxspring"]["backends"].get(row["backend"], {})
    return {"family": result_files.family(about), "limits_of": result_files.limits_of(about),
            "addressing": result_files.addressing(row["backend"], about), "on_card": bool(about.get("uuid"))}


def medians_of(one):
    """The median row of each case of a result, with the relative spread of its times and what the result says of its backend."""
    return [row | {"spread": result_files.spread_of(row["times"])} | about_backend(one, row)
            for row in result_files.medians(one["benchmarks"], one.get("verification", []))]


def medians(study, machine=GPU):
    return medians_of(result(study, machine))


def by_name(one):
    return {name_of(row): row for row in medians_of(one)}


def tuning_of(row):
    """The tuning parameters of a row that are not at their defaults."""
    return name_of(row).split("/")[4:]


def contender(row):
    """A row's strategy, such as `cuda_implicit_cached fetch=l1`: backend, precision unless float32, tuning not at its default."""
    _, backend, _, precision, *tuning = name_of(row).split("/")
    return " ".join([f"`{backend}`"] + [precision] * (precision != "float32") + tuning)


def is_papers(row):
    """Whether a row is a strategy of the paper. Plain L1-cached loads are not: they came after it (2008)."""
    return row["backend"] in PAPER and "fetch=l1" not in tuning_of(row)


def alike(rows, row):
    """The rows with the dataset, formulation and precision of `row`, from which the fastest is chosen."""
    return [other for other in rows if all(other[key] == row[key] for key in ("scene", "formulation", "precision"))]


# The least number of repetitions that are divided. Fewer of them all choose the row and are all reported, as in
# harness/study/fastest.cpp.
FEWEST_TO_DIVIDE = 4


def divided(row):
    """(median of every other repetition from the first on, by which a row is chosen; median of the others, which is its time)."""
    times = row.get("times", ())
    if len(times) < FEWEST_TO_DIVIDE:
        return row["real_time"], row["real_time"]
    return statistics.median(times[0::2]), statistics.median(times[1::2])


def held_out(row):
    """A row with the time of the repetitions by which it is not chosen, and with the rates and share of its limit for that time."""
    time = divided(row)[1]
    rates = {key: row[key] * row["real_time"] / time
             for key in ("particle_updates_per_second", "spring_updates_per_second", "fraction_of_limit") if row.get(key)}
    return row | rates | {"real_time": time}


def fastest_of(rows):
    """The fastest of several rows, as the study `fastest` has it: one half of the repetitions chooses, the
    other half is reported.

    The least of many medians is partly due to chance. The other half of the repetitions does not have that
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
    """The time of a row over that of another."""
    return as_known(row["real_time"] / base["real_time"], row, base)


def share(row):
    """What share of its limit a row reaches."""
    fraction = row.get("fraction_of_limit")
    return f"{as_known(100 * fraction, row, decimals=0)} %" if fraction is not None else "-"


def share_of_sum(row):
    """What share of its time the terms of its limit take together: more than 100 % if they overlap."""
    terms = row.get("limit_sum_seconds")
    return f"{as_known(100e6 * terms / row['real_time'], row, decimals=0)} %" if terms else "-"


def sustained(row):
    """The time of a step in us while steps run for seconds without a pause; a dash if that was not measured."""
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
