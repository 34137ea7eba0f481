"""Figures and verdicts for the sentences of README.in.md: one small function each, over the committed results.

A case is named as in the tables: `cuda_implicit_cached fetch=l1`. Formulation and precision are `position` and `float32` unless a
function takes others.
"""

import collections
import itertools
import re
import statistics

import result_files
from readme.rows import (CPU, GPU, PAPER, Missing, about_backend, alike, by_name, card_ids, contender, copy_rate, fastest_of, figure,
                         held_out, is_papers, machines, medians, medians_of, microseconds, name_of, profiles, result, slow_down,
                         studies, three_digits, tuning_of)
from result_files import case_of, distinct, groups, listed, threshold_of  # noqa: F401 (templates use all names here)

# Positions (48 bytes per particle) and lists (72 bytes) of more particles exceed the 60 MB of an H200's L2.
LARGE = 500_000
# A body that fills less of its grid than this is sparse.
SPARSE = 0.5
KINDS = ("small sparse", "small full", "large sparse", "large full")
# Two times that differ by less than this share are called the same.
ALIKE = 0.03
# Time is linear in size as long as the time per particle is within this share of that of the largest box.
LINEAR = 0.2
# The verdict is that edits cost little if they slow steps down by at most this share.
CHEAP = 0.05
# If compute shaders reach more than this multiple of the arithmetic of fragment shaders, times of fragment shaders say nothing
# about OpenGL.
HELD_BACK = 4
NOT_DECIDABLE = "not decidable on this card"


def row(study, scene, case, formulation="position", precision="float32", machine=GPU, rows=None):
    """The median row of a case. If `rows` are given, the row among them that has the name of the case. Raises Missing."""
    backend, *tuning = case.split()
    name = "/".join([scene, backend, formulation, precision, *tuning])
    found = by_name(result(study, machine)) if rows is None else {one["name"]: one for one in rows}
    if name not in found:
        raise Missing(f"{machine}/{study} has no row {name}")
    return found[name]


def us(study, scene, case, **which):
    """Microseconds per step."""
    return row(study, scene, case, **which)["real_time"]


def ratio(study, scene, case, over, **which):
    """The time of `case` divided by that of the case `over`."""
    return us(study, scene, case, **which) / us(study, scene, over, **which)


def of_limit(study, scene, case, **which):
    return whole_percent(row(study, scene, case, **which)["fraction_of_limit"])


def commit(study, machine=GPU):
    return result(study, machine)["context"]["voxspring"]["commit"][:8]


def whole_percent(value):
    return f"{100 * value:.0f}%"


def each(function, *values):
    """The results of a function for each value of a list, or for each combination of the values of several lists."""
    return [function(*one) for one in itertools.product(*values)]


def span(values, written=figure):
    """The range of some values: `1.10 to 1.23`, or one figure if both ends are written alike."""
    values = list(values)
    if not values:
        raise Missing("there is no row to take the range of")
    ends = [written(min(values)), written(max(values))]
    return ends[1] if ends[0] == ends[1] else f"{ends[0].removesuffix('%')} to {ends[1]}"


def verdict(ratios):
    """Whether a preference of the paper holds: whether what the paper prefers is faster on all datasets. `ratios`: the times of
    what it prefers over those of the alternative."""
    ratios = list(ratios)
    if not ratios:
        raise Missing("there is no row to judge by")
    return winner(ratios).replace("is undecided", "depends on the dataset")


# --- Where the files are from -----------------------------------------------------------------------------

def provenance():
    """The commits and the cards of the results of the page's machine, in words: "3 commits and of one card"."""
    commits = {one["context"]["voxspring"]["commit"][:8] for one in studies().values()}
    cards = {uuid for one in studies().values() for uuid in card_ids(one)}
    of_commits = f"commit {next(iter(commits))}" if len(commits) == 1 else f"{len(commits)} commits"
    return f"{of_commits} and of {'one card' if len(cards) == 1 else f'{len(cards)} cards'}"


def cards_without(study):
    """The cards of the results of the page's machine, without one study."""
    return {uuid for name, one in studies().items() if name != study for uuid in card_ids(one)}


def above_limit(rows):
    """The rows that are faster than their measured limit."""
    return [one for one in rows if (one["fraction_of_limit"] or 0) > 1]


def rows_above_limit():
    return [one for study in studies().values() for one in above_limit(medians_of(study))]


def repetitions_above_limit():
    """How many single repetitions are faster than their limit, of how many, and in which rows, in words."""
    repetitions = [one for study in studies().values() for one in study["benchmarks"]
                   if one["run_type"] == "iteration" and one["fraction_of_limit"] is not None]
    above = above_limit(repetitions)
    names = listed(sorted({f"{contender(one)} on {one['scene']}" for one in above}))
    marked = all(one.get("noisy") and one["limited_by"] == "launch" for one in above)
    reason = ", marked `~`, by launches" if marked else ""
    if not above:
        return f"neither is any of the {len(repetitions):,} repetitions that have a limit"
    return f"{len(above)} of the {len(repetitions):,} repetitions that have a limit are ({names}{reason})"


def fragment_share():
    """The rate of arithmetic of a compute shader over that of a fragment shader."""
    limit = result("table1")["context"]["voxspring"]["limits"]["OpenGL"]
    return limit["compute_shader_float32_operations_per_second"] / limit["float32_operations_per_second"]


# --- Explicit against implicit addressing, by size and by sparsity ----------------------------------------

def of_paper(kind):
    """The paper's CUDA strategies with "implicit" or "explicit" addressing, in the paper's order."""
    found = {row["backend"] for row in medians("table1") if row["family"] == "CUDA" and row["addressing"] == kind}
    return tuple(name for name in PAPER if name in found)


IMPLICIT, EXPLICIT = of_paper("implicit"), of_paper("explicit")


def datasets(formulation="position", rows=None):
    """The datasets, by size, on which both kinds of addressing ran without edits. `rows`: by default those of the
    study `fastest`.

    In a dataset, `implicit` and `explicit` are the rows of the paper's CUDA strategies, and `later` those of newer
    strategies with lists. `ratio` is the best explicit time over the best implicit one.
    """
    rows = [row for row in (medians("fastest") if rows is None else rows)
            if row["formulation"] == formulation and row["precision"] == "float32" and not row.get("edits")]
    found = []
    for (scene,), own in groups(rows, "scene").items():
        implicit, explicit = ([row for row in own if row["backend"] in side] for side in (IMPLICIT, EXPLICIT))
        lists = [row for row in own if row["family"] == "CUDA" and row["addressing"] == "explicit"]
        particles, active = own[0]["particles"], own[0]["particles"] / own[0]["voxels"]
        if implicit and explicit:
            found.append({
                "scene": scene, "particles": particles, "active": active, "implicit": implicit, "explicit": explicit,
                "later": [row for row in lists if row["backend"] not in PAPER],
                "kind": ("large" if particles > LARGE else "small") + (" sparse" if active < SPARSE else " full"),
                "ratio": fastest_of(explicit)["real_time"] / fastest_of(implicit)["real_time"]})
    return sorted(found, key=lambda one: (one["particles"], one["active"]))


def winner(ratios):
    """"holds" if all ratios of times are clearly below 1, "inverts" if all are clearly above, else "is undecided"."""
    if all(ratio < 1 - ALIKE for ratio in ratios):
        return "holds"
    return "inverts" if all(ratio > 1 + ALIKE for ratio in ratios) else "is undecided"


def addressing_verdict(of=None):
    """On which bodies explicit addressing wins, as `holds for small sparse bodies, inverts for large sparse and
    large full bodies`. `of`: the datasets; by default those of the study `fastest`."""
    by_kind = groups(of or datasets(), "kind")
    ratios = {kind: winner([one["ratio"] for one in by_kind[kind,]]) for kind in KINDS if (kind,) in by_kind}
    if len(set(ratios.values())) == 1:
        return next(iter(ratios.values()))
    said = {word: [kind for kind, verdict_of in ratios.items() if verdict_of == word] for word in ("holds", "is undecided", "inverts")}
    return ", ".join(f"{word} for {listed(kinds)} bodies" for word, kinds in said.items() if kinds)


# --- The paper's other questions ---------------------------------------------------------------------------

def scaled_ratios(case, over, smallest=0):
    """The time of `case` over that of the case `over`, on every box of Figure 8 with at least `smallest` particles."""
    by_case = groups((one for one in medians("figure8") if one["particles"] >= smallest), lambda one: contender(one).replace("`", ""))
    return ratios_between(by_case[case,], by_case[over,], "scene")


def addressing_ratios(kind):
    """The best explicit time over the best implicit one on the datasets of a kind."""
    return [one["ratio"] for one in datasets() if one["kind"] == kind]


def close_calls():
    """The datasets of `fastest` of which the repetitions that did not choose have another row as the fastest, in words."""
    result_of, others = result("fastest"), []
    rows = medians_of(result_of)
    for block in result_of["fastest"]:
        best = min(map(held_out, alike(rows, block)), key=lambda row: row["real_time"])
        if name_of(best) != block["name"]:
            others.append(f"{block['scene']} by `{block['formulation']}` ({microseconds(best['real_time'])} us by {contender(best)})")
    gpu = result_of["context"]["voxspring"]["gpu"]
    text = f"In {len(others)} of {len(result_of['fastest'])} datasets of the {gpu} the two halves of the repetitions disagree on the fastest "
    text += f"row, so that it is not certain there: {listed(others)}." if others else "row."
    if any("sustained_seconds_per_step" not in block for block in result_of["fastest"] if block["device"] == gpu):
        text += (" A dash under *sustained*: this file measured it for the row with the least median of all repetitions, which is another "
                 "one there.")
    return text


# The card that profiles() are of.
PROFILED = "NVIDIA H200"


def most_slots():
    """The most issue slots that any profiled kernel fills, in percent."""
    return max(int(one[formulation] or 0) for one in profiles() for formulation in ("position", "increment"))


def copy_ratio():
    """The rate of a copy on the first card of the comparison over that on the last."""
    results = [one for one in machines("fastest") if one["context"]["voxspring"].get("gpu")]
    return copy_rate(results[0]) / copy_rate(results[-1])


def only_strained():
    """Which files time which bodies from a start that strains every spring, in words."""
    strained = {one["context"]["voxspring"]["gpu"]: one["context"]["voxspring"]["study"].get("strained_starts", [])
                for one in machines("fastest") if one["context"]["voxspring"].get("gpu")}
    if len({tuple(scenes) for scenes in strained.values()}) == 1:
        return "All files time the same bodies from starts that strain every spring."
    return ("Files differ in which bodies they time from a start that strains every spring: " +
            "; ".join(f"{gpu} {listed(scenes) if scenes else 'none'}" for gpu, scenes in strained.items()) +
            ". A threshold with `*` is of a second run from that start, so it compares with one of a file that times the body from there. "
            "If neither row of such a body has a `*`, their thresholds are of different motions.")


def largest_box(study):
    """The edge of the largest box of a study: 256 for box@256."""
    return max(int(one["scene"][4:]) for one in medians(study) if re.fullmatch(r"box@\d+", one["scene"]))


def concatenated(case, scene=None):
    """The time of a case with concatenated lists over that with vertical lists, on a scene or else the largest box."""
    return ratio("tuning", scene or f"box@{largest_box('tuning')}", case + " layout=concatenated", case)


def vertical(case, scene):
    return 1 / concatenated(case, scene)


def opengl_verdict():
    """The verdict on the paper's statement that CUDA is faster than OpenGL's fragment shaders with either addressing."""
    if fragment_share() > HELD_BACK:
        return NOT_DECIDABLE
    return verdict(ratio("table1", scene, cuda, gl) for scene in ("box@32", "heart") for cuda, gl in
                   (("cuda_implicit_cached", "gl_fragment_implicit"), ("cuda_explicit_cached_grid", "gl_fragment_explicit")))


# How an implicit strategy fetches a neighbour, in words for the page.
FETCHES = {"cuda_implicit_cached": "texture", "cuda_implicit_shared": "shared memory", "cuda_implicit_device": "loads past L1",
           "cuda_implicit_cached fetch=l1": "L1-cached loads"}


def fetches(times):
    """How strategies fetch a neighbour, with their times, fastest first: `texture (2.4), shared memory (2.9)`. `times`: pairs
    (time, strategy)."""
    return ", ".join(f"{FETCHES[way]} ({three_digits(time)})" for time, way in sorted(times))


def order_of(study, scene):
    return sorted(FETCHES, key=lambda case: us(study, scene, case))


def by_time(study, scene):
    return fetches((us(study, scene, case), case) for case in FETCHES)


def l1_wins():
    """The number of boxes of Figure 8 on which plain L1-cached loads are the fastest implicit strategy, in words."""
    won = {scene: us("figure8", scene, "cuda_implicit_cached fetch=l1") < min(us("figure8", scene, case) for case in IMPLICIT)
           for scene in distinct(medians("figure8"), "scene")}
    lost = [f"{scene.removeprefix('box@')}^3" for scene in won if not won[scene]]
    return f"{sum(won.values())} of the {len(won)} boxes (all but {listed(lost)})" if lost else f"all {len(won)} boxes"


def papers_cuda(one):
    return is_papers(one) and one["family"] == "CUDA"


def is_fragments(one):
    return one["limits_of"] == "OpenGL"


def slow_downs(edits, of=papers_cuda):
    return [slow_down(one) for one in medians("edits") if one["edits"] == edits and of(one)]


def edit_verdict():
    """The verdict on the paper's statement that edits cost little: up to how many edits in 1000 steps slow each of its CUDA
    strategies down by at most CHEAP."""
    counts = sorted({one["edits"] for one in medians("edits")})
    cheap = [count for count in counts if max(slow_downs(count)) <= CHEAP]
    if not cheap:
        return "does not hold"
    return "holds" if cheap == counts else f"holds up to {max(cheap)} edit{'s' * (max(cheap) != 1)} in 1000 steps"


def edit_us(case):
    """Microseconds of one edit, from an idle device until the device is idle again."""
    scene = max(medians("edits"), key=lambda one: one["edits"])["scene"]
    return row("edits", scene, case, formulation="increment")["edit_seconds_median"] * 1e6


def papers_lists(one):
    return papers_cuda(one) and one["addressing"] == "explicit"


def growth(cases=papers_cuda, smallest=0, rows=None):
    """The largest relative difference between a case's time per particle on a box and on its largest box.
    `rows`: by default those of Figure 8. `smallest`: the least number of particles of a box that counts."""
    rows = [one for one in (medians("figure8") if rows is None else rows) if cases(one) and one["particles"] >= smallest]
    found = []
    for of_case in groups(sorted(rows, key=lambda one: one["particles"]), contender).values():
        times = [one["real_time"] / one["particles"] for one in of_case]
        found += [time / times[-1] for time in times]
    return max(max(found) - 1, 1 - min(found))


def linear_from(cases=papers_cuda, rows=None):
    """The number of particles from which on times are linear in size. `cases`: by default the paper's CUDA strategies."""
    sizes = sorted({one["particles"] for one in (medians("figure8") if rows is None else rows) if cases(one)})
    return next(size for size in sizes if growth(cases, size, rows) <= LINEAR)


def linear_verdict(cases=papers_cuda, rows=None):
    """The verdict on the paper's statement that the times of strategies with lists are linear beyond 50,000 particles."""
    size = linear_from(cases, rows)
    if size <= 50_000:
        return "holds"
    return f"holds from {size / 1e6:.2g} million on" if size >= 1e6 else f"holds from {size:,} on"


def times_as_long(study, scene, case):
    """The time of a case over that of the paper's fastest CUDA strategy on a dataset."""
    papers = [one for one in medians(study) if one["scene"] == scene and papers_cuda(one) and one["formulation"] == "position"]
    return us(study, scene, case) / fastest_of(papers)["real_time"]


# --- The strategies as the paper had them -------------------------------------------------------------------

def is_concatenated(one):
    return "layout=concatenated" in name_of(one)


def as_paper():
    """The rows of the study as_paper, without those of concatenated lists."""
    return [one for one in medians("as_paper") if not is_concatenated(one)]


def ratios_between(some, others, *keys):
    """The time of each row of `some` divided by that of the row of `others` with the same values of `keys`, if there is one."""
    over = {tuple(one[key] for key in keys): one["real_time"] for one in others}
    return [one["real_time"] / over[at] for one in some if (at := tuple(one[key] for key in keys)) in over]


def as_paper_addressing():
    return addressing_verdict(datasets("paper", as_paper()))


def as_paper_vertical():
    return verdict(ratios_between(as_paper(), filter(is_concatenated, medians("as_paper")), "scene", "backend"))


def as_paper_linear():
    return linear_verdict(papers_lists, [one for one in as_paper() if one["scene"].startswith("box@")])


def as_paper_fetches(scene):
    return fetches((one["real_time"], one["backend"]) for one in as_paper() if one["scene"] == scene and one["backend"] in IMPLICIT)


def as_paper_counters():
    by_backend = groups(as_paper(), "backend")
    return verdict(ratios_between(by_backend["cuda_explicit_cached_grid",], by_backend["cuda_explicit_cached",], "scene"))


def without_fragments():
    """The datasets of as_paper on which no fragment shader ran, as the end of a sentence; empty if there are none."""
    lacking = [scene for (scene,), own in groups(as_paper(), "scene").items() if not any(map(is_fragments, own))]
    return f", and OpenGL's fragment shaders were not run on {listed(lacking)}" if lacking else ""


def as_paper_opengl():
    if fragment_share() > HELD_BACK:
        return NOT_DECIDABLE
    fastest = ([fastest_of(own) for own in groups(filter(of, as_paper()), "scene").values()] for of in (papers_cuda, is_fragments))
    return verdict(ratios_between(*fastest, "scene"))


# --- Between studies, formulations, errors -----------------------------------------------------------------

def shared(first, second):
    """The time in the second study over that in the first, of each row that both studies have."""
    one, other = by_name(result(first)), by_name(result(second))
    return [other[name]["real_time"] / one[name]["real_time"] for name in one if name in other]


def signed_percent(value):
    """A ratio as a change in percent: +6% for 1.06."""
    return f"{100 * (value - 1):+.0f}%"


def increments_cost():
    """The time in the formulation increment over that in position, for every case of the study formulations."""
    by_formulation = groups([one | {"tuned": tuple(tuning_of(one))} for one in medians("formulations")], "formulation")
    return ratios_between(by_formulation["increment",], by_formulation["position",], "scene", "backend", "precision", "steps", "tuned")


def increments_gain(scene):
    """The error in the formulation position over that in increment, of the implicit strategy that uses textures."""
    errors = [row("formulations", scene, "cuda_implicit_cached", way)["error_relative_l2"] for way in ("position", "increment")]
    return errors[0] / errors[1]


def front(machine=GPU):
    """The runs of CUDA on the Pareto fronts of a machine, or all runs on its fronts if none is of CUDA."""
    found = result("pareto", machine)
    on_front = [one | about_backend(found, one) for one in found["pareto"] if one.get("on_front")]
    return [one for one in on_front if one["family"] == "CUDA"] or on_front


def front_of():
    """How many runs of the fronts each backend has, in words: `cuda_resident` 12, ..."""
    counts = collections.Counter(one["backend"] for one in front())
    return ", ".join(f"`{name}` {count}" for name, count in counts.most_common())


def front_float64(machine=GPU):
    """The largest error of a float64 run on each scene's front, as a range over the scenes."""
    exact = [one for one in front(machine) if one["precision"] == "float64"]
    return span((max(one["total_error_relative_l2"] for one in of) for of in groups(exact, "scene").values()), lambda error: f"{error:.0e}")


def runs(machine, backend="cpu_parallel"):
    """The runs of the study pareto of a backend by scene, formulation, precision and share of the stable time step."""
    return {(one["scene"], one["formulation"], one["precision"], one["fraction_of_stable"]): one
            for one in result("pareto", machine)["pareto"] if one["backend"] == backend}


def float64_ratios(machine=CPU, backend="cpu_parallel"):
    """{scene: the times of float64 over those of float32}, a ratio for each formulation and time step of the study pareto."""
    found, ratios = runs(machine, backend), {}
    for (scene, formulation, precision, fraction), one in found.items():
        if precision == "float64" and (scene, formulation, "float32", fraction) in found:
            ratios.setdefault(scene, []).append(one["seconds"] / found[scene, formulation, "float32", fraction]["seconds"])
    return ratios


def float64_cost():
    """The median of float64_ratios() over all scenes."""
    return statistics.median(itertools.chain.from_iterable(float64_ratios().values()))


def stress_verdict(machine=GPU):
    rows = result("stress", machine)["stress"]
    failed = sum(not one["passed"] for one in rows)
    kept = f"all {len(rows)}" if not failed else f"{len(rows) - failed} of {len(rows)}"
    return (f"{kept} measurements of {len({one['backend'] for one in rows})} strategies are within their thresholds "
            f"(commit {commit('stress', machine)})")


def worst_small_start():
    """The largest relative difference between a measured stability limit and theory, over starts of small amplitude."""
    rows = [one for one in result("stability")["stability"] if (one["start"]["amplitude"] or one["start"]["stretch"]) <= 0.001]
    return max(abs(one["ratio"] - 1) for one in rows)


def resting_ratio(scene, case, formulation="increment"):
    """The time of a step that leaves out tiles at rest over the time of a step of all tiles."""
    return ratio("skips", scene, f"{case} rest=skip", f"{case} rest=step", formulation=formulation)


def launching_all(scene):
    """For each implicit kernel: the time with every block launched over that with only blocks that hold a particle."""
    return [ratio("skips", scene, f"{case} launched=all", case, formulation="increment") for case in IMPLICIT]


def joules(scene, case):
    """The energy of a step in joules, from the study energy."""
    return row("energy", scene, case, rows=result("energy")["energy"])["joules_per_step"]


def best_of(study, scene, backend, formulation="position"):
    """Microseconds of a backend with the tuning that suits it best."""
    rows = groups(medians(study), "scene", "backend", "formulation", "precision").get((scene, backend, formulation, "float32"))
    if not rows:
        raise Missing(f"{study} has no row of {backend} on {scene}")
    return fastest_of(rows)["real_time"]


# The names that README.in.md and the tables may use.
NAMES = {name: value for name, value in globals().items() if not name.startswith("_")} | {"min": min, "max": max}
