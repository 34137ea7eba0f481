"""Pages say what the committed results say: the template of results/README.md, its verdicts, and no figure of unknown origin.

The current directory is the source tree.
"""

import pathlib
import re
import shutil
import statistics
import sys
import unittest
from unittest import mock

from folder import InTemporaryFolder, run

sys.path.insert(0, "results")
import audit  # noqa: E402
import figures_in_prose  # noqa: E402
import result_files  # noqa: E402
import paper  # noqa: E402
from readme import facts, rows  # noqa: E402

# Figures in prose that are not measurements, and what they are: (page, words of the sentence).
ALLOWED = {
    ("cuda/README.md", "80% of all voxels at random"): "how the case is defined",
    ("cuda/README.md", "(0.9 to 1.75 times)"): "the rule of backends/layout/march_plan.cpp",
    ("docs/accuracy.md", "Springs at 20% strain"): "the strain of the case in harness/studies/truth.json",
    ("docs/accuracy.md", "come within 5% of the continuum"): "what the command asks for",
    ("docs/accuracy.md", "edges 10% softer, rest lengths and gravity 1% larger"): "the wrong models that gate_test tries",
    ("docs/accuracy.md", "the random 37% and 10,000 of the rope"): "the body's name",
    ("docs/measure.md", "or than 2%"): "the rule of results/readme/rows.py",
    ("docs/measure.md", "more than 5 seconds"): "max_start_seconds of harness/study/measure.cpp",
    ("docs/measure.md", "reaches 60% of it"): "the bound from which a limit is named",
    ("docs/measure.md", "the middle half of the repetitions spreads over more than 10%"): "a bound of harness/device/noise.h",
    ("docs/measure.md", "agree with its counter within 5%"): "the bound that fails a row (harness/device)",
    ("docs/measure.md", "their choice is within 5% of the fastest"): "the bound that fastest_test holds",
    ("docs/volumes.md", "what becomes of it at 20%"): "the strain of a case in docs/accuracy.md",
    ("harness/scenes/README.md", "within 2% of the true limit"): "the bound that stability_test holds",
    ("harness/scenes/README.md", "21% of the grid"): "how the phantom is defined",
    ("results/README.in.md", "given from 3 % on"): "result_files.MIN_SPREAD",
    ("results/README.in.md", "only a change beyond 30%"): "comparison.UNKNOWN_NOISE",
}


def pages():
    """Every page that a person writes; for a page that is made, its template."""
    found = []
    for path in sorted(pathlib.Path(".").rglob("*.md")):
        hidden = any(part.startswith(".") or part in ("build", "local") for part in path.parts)
        if not hidden and not path.with_name(path.name.removesuffix(".md") + ".in.md").exists():
            found.append(path)
    return found


class Prose(unittest.TestCase):
    def test_no_figure_is_of_unknown_origin(self):
        self.assertGreater(len(pages()), 15)
        used = set()
        for page in pages():
            for sentence in figures_in_prose.unfounded(page.read_text()):
                reasons = [key for key in ALLOWED if key[0] == str(page) and key[1] in sentence]
                used.update(reasons)
                self.assertTrue(reasons, f"{page}: a figure that no template made and no commit stands beside: {sentence}")
        self.assertEqual(used, set(ALLOWED), "what is allowed is there")

    def test_a_figure_by_hand_is_noticed_in_every_page(self):
        for page in pages():
            for figure in ("It takes 1.22 us a step.", "It reaches 43% of it.", "That is 2.5 times as fast.", "It moves 4.1 TB/s.",
                           "It makes 929 G springs/s.", "A step takes 0.3 J.", "A build takes 12 s.", "An edit takes 9 to 11 ms."):
                found = figures_in_prose.unfounded(page.read_text() + "\n# Another\n\n" + figure + "\n")
                self.assertIn(figure, found, page)

    def test_tables_by_hand_are_noticed_by_their_header(self):
        table = "| case | us a step |\n| --- | --: |\n| a | 12.5 |\n| b | - |"
        self.assertEqual(figures_in_prose.unfounded(table), ["| a | 12.5 |"])
        self.assertEqual(figures_in_prose.unfounded(f"Of commit 0b0c168:\n\n{table}"), [])
        self.assertEqual(figures_in_prose.unfounded("| bytes |\n| --- |\n| 48 |"), [])

    def test_what_has_an_origin_is_let_through(self):
        for text in ("Commit 0b0c168 took 2.5 us.", "It takes {{ us() }} us.", "<!-- a -->\n3 us\n<!-- /a -->\n", "Give `--time 5 s`.",
                     "```\n12 us\n```", "So:\n\n    sleep 5 s\n\nEnd.",
                     "# Trials\n\nUp to commit 0b0c168.\n\nIt took 5 us.\n\n## Part\n\n7 us.",
                     "A box of 256^3 has 18 springs in 72 bytes."):
            self.assertEqual(figures_in_prose.unfounded(text), [], text)
        self.assertEqual(figures_in_prose.unfounded("# Trials\n\nUp to commit 0b0c168.\n\n# Now\n\nWords.\n\nIt takes 5 us. Commit 0b0c168 took 6 us."),
                         ["It takes 5 us."])


class Audit(InTemporaryFolder):
    """results/audit.py computes the figures of pages without the code that made them."""

    def test_every_figure_is_right(self):
        known, _ = audit.claims()
        self.assertGreater(len(known), 1000)
        self.assertEqual([claim for claim in known if not audit.is_right(claim)], [])
        self.assertEqual({claim.page for claim in known}, set(audit.PAGES))

    def test_wrong_figures_are_named(self):
        """The last digit of a figure in a table and in a sentence."""
        right = audit.claims()[0]
        root = self.folder
        shutil.copytree("docs", root / "docs")
        shutil.copytree("results", root / "results", ignore=shutil.ignore_patterns("local", "__pycache__"))
        shutil.copy("README.md", root)
        page = root / "results/README.md"
        text, count = re.subn(r"(`cuda_march` takes 0\.\d)(\d)( of the\s+energy)", lambda match: match[1] + str(9 - int(match[2])) + match[3],
                              page.read_text())
        self.assertEqual(count, 1)
        cell = next(claim for claim in right if claim.page == "results/README.md" and claim.what.endswith("256^3: 16777216"))
        lines = text.split("\n")
        last = re.search(r"\d(?= \()", cell.said)
        lines[cell.line - 1] = lines[cell.line - 1].replace(cell.said, cell.said[:last.start()] + str(9 - int(last[0])) + cell.said[last.end():])
        page.write_text("\n".join(lines))
        with mock.patch.object(audit, "ROOT", root):
            wrong = [claim for claim in audit.claims()[0] if not audit.is_right(claim)]
        self.assertEqual([claim.line for claim in wrong], [cell.line, 0])
        for said, value, is_right in (("2.6", 2.6, True), ("2.6", 2.66, False), ("1,234", 1234, True), ("8.8e-03", 8.8234e-3, True),
                                      ("8.8e-03", 8.86e-3, False), ("42 %", 41.7, True), ("~3.05 ± 4 %", 3.047, True)):
            self.assertEqual(audit.is_right(audit.Claim("", 0, "", said, value)), is_right, said)


class Counts(unittest.TestCase):
    def test_command_buffers_of_a_thousand_steps(self):
        """backends/vulkan/README.md: powers of two up to the longest, which the backend's source has."""
        text = " ".join(pathlib.Path("backends/vulkan/README.md").read_text().split())
        longest = 2 ** int(re.search(r"A command buffer has 2\^n steps, n from 0 to (\d)", text)[1])
        count = 1000 // longest + (1000 % longest).bit_count()
        words = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
        self.assertIn(f"`step(1000)` enqueues {words[count - 1]} of them", text)


class Template(InTemporaryFolder):
    def test_fills_in_and_breaks_lines(self):
        names = {"a": 12.345, "b": lambda text: text.upper(), "c": 1234567}
        self.assertEqual(paper.render("{{ a }}, {{ b('x') }}, {{ c }}\nlines\n\n| {{ a }} |\n", names, "page"),
                         "12.3, X, 1,234,567 lines\n\n| 12.3 |\n")
        long = "word " * 40 + "{{ a }}."
        self.assertTrue(all(len(line) <= paper.WIDTH for line in paper.render(long, names, "page").split("\n")))
        untouched = "one\ntwo\n\n    code\n"
        self.assertEqual(paper.render(untouched, names, "page"), untouched)

    def test_a_sentence_that_does_not_hold_is_named(self):
        text = "# Page\n\nThe first is true. Lists take\nless time than masks{{ holds(times[0] < 1) }}. The last as well."
        self.assertNotIn("holds", paper.render(text, {"times": [0.9]}, "page.md"))
        for text, times, words in ((text, [1.1],
                                    r'page\.md:4: what it claims no longer holds: "Lists take less time than masks\{\{.*\}\}\."$'),
                                   (text, [], r"page\.md:4: UndefinedError"), ("{{ times }}", None, "page.md:1: None is no figure")):
            with self.assertRaisesRegex(paper.Stale, words):
                paper.render(text, {"times": times}, "page.md")

    def test_the_page_is_checked_and_refused(self):
        copy = self.folder / "results"
        shutil.copytree("results", copy, ignore=shutil.ignore_patterns("local", "__pycache__"))

        def make(*arguments):
            return run(sys.executable, "-B", copy / "paper.py", *arguments)
        self.assertEqual(make("--check").stderr, "")
        page, source = copy / "README.md", copy / "README.in.md"
        text, words = page.read_text(), source.read_text()
        page.write_text(text.replace("on an NVIDIA H200", "on another card"))
        self.assertIn("README.md is not what the results say", make("--check").stderr)
        changed, done = page.read_text(), make("--chekc")
        self.assertEqual((done.returncode, page.read_text()), (2, changed), "an option that there is not")
        self.assertIn("unrecognized arguments: --chekc", done.stderr)
        self.assertEqual(make().returncode, 0)
        self.assertEqual(page.read_text(), text)
        source.write_text(words + '\nThe box takes less{{ holds(us("table1", "box@32", "cuda_march") < 1) }}.\n')
        done = make()
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"README\.in\.md:\d+: what it claims no longer holds: \"The box takes less")
        source.write_text(words + '\nIt takes {{ us("table1", "box@32", "cuda_none") }} us.\n')
        self.assertIn("nvidia-h200/table1 has no row box@32/cuda_none/position/float32", make("--check").stderr)
        self.assertEqual(page.read_text(), text, "nothing is written")


def as_paper_of(result, slower):
    """A made-up result of the study as_paper, from one of figure8: steps of a backend take `slower(backend, scene)` times as long."""
    made = {key: [] if isinstance(value, list) else value for key, value in result.items()}
    for name in ("benchmarks", "verification"):
        for row in result[name]:
            scene, backend, _, precision, *rest = row["name"].split("/")
            own = rows.PAPER[2:] if name == "benchmarks" else ()
            if backend not in rows.PAPER or any("=" in one for one in rest):
                continue
            for layout in ["", ",layout=concatenated"] if backend in own and "explicit" in backend and scene == "box@32" else [""]:
                tuning = [f"counters=rows,graph=off{layout}"] * backend.startswith("cuda")
                time = slower(backend, scene) * (2 if layout else 1)
                made[name].append(row | {"name": "/".join([scene, backend, "paper", precision, *tuning, *rest]), "formulation": "paper"}
                                  | ({"real_time": row["real_time"] * time} if "real_time" in row else {}))
    return made


class AsPaper(InTemporaryFolder):
    """The page with a made-up result of the study as_paper."""

    def page(self, result):
        copy = self.folder / "results"
        shutil.copytree("results", copy, ignore=shutil.ignore_patterns("local", "__pycache__", "as_paper.json*"))
        self.write("results/nvidia-h200/as_paper.json", result)
        done = run(sys.executable, "-B", copy / "paper.py")
        self.assertEqual(done.stderr, "")
        text = (copy / "README.md").read_text()
        verdicts = {line[0]: line[2:] for line in cells_of(text) if len(line) == 4}
        return text, verdicts

    def test_measured(self):
        """Lists take 0.01 of their time on boxes, and 9 times it with counters on the largest one."""
        def slower(backend, scene):
            return 0.01 * (900 if (backend, scene) == ("cuda_explicit_cached_grid", "box@256") else 1) if "explicit" in backend else 1
        text, verdicts = self.page(as_paper_of(rows.result("figure8"), slower))
        for name, said in (("lists are faster than implicit addressing", "holds"),
                           ("counters are faster than a secondary list", "depends on the dataset"),
                           ("vertical lists are faster (Figure 6)", "holds"), ("CUDA is faster than OpenGL", "not decidable on this card"),
                           ("changes of topology cost little", "not measured by the paper"),
                           ("time is linear beyond 50,000 particles", "lists: holds from 17 million on")):
            self.assertEqual(verdicts[name][0], said)
        today = {name: own[1] for name, own in verdicts.items()}
        self.assertTrue(today["CUDA is faster than OpenGL"].startswith("not decidable on this card; by compute shaders"))
        self.assertIn(facts.addressing_verdict(), today.values())
        lines = {line[0]: line[1:] for line in cells_of(text)}
        self.assertNotIn("-", lines["`cuda_explicit_device`"][-9:])
        self.assertEqual(len([one for one in lines["`cuda_explicit_device`, concatenated"] if one != "-"]), 1)


def case(scene, backend, microseconds, particles=1000, voxels=1000, tuning="", **more):
    name = "/".join([scene, backend, "position", "float32"] + [tuning] * bool(tuning))
    return {"name": f"{name}/iterations:10/repeats:9/manual_time_median", "scene": scene, "backend": backend, "formulation": "position",
            "precision": "float32", "real_time": microseconds, "particles": particles, "voxels": voxels, "spread": 0.01,
            "family": "CUDA", "addressing": "explicit" if "explicit" in backend else "implicit"} | more


class Verdicts(unittest.TestCase):
    def test_the_papers_strategies_are_those_of_the_program(self):
        source, = (text for path in pathlib.Path("harness").rglob("*.cpp") if "paper_backends() {" in (text := path.read_text()))
        listed = re.search(r"paper_backends\(\) \{.*?names = \{(.*?)\}", source, re.DOTALL)[1]
        self.assertEqual(list(rows.PAPER), re.findall(r'"(\w+)"', listed))
        for backend, tuning, papers in (("cuda_implicit_cached", "", True), ("cuda_implicit_cached", "fetch=l1", False),
                                        ("cuda_march", "", False)):
            self.assertEqual(rows.is_papers(case("a", backend, 1, tuning=tuning)), papers)

    def test_addressing_by_size_and_sparsity(self):
        """By explicit over implicit time of small sparse, small full, large sparse and large full bodies."""
        for times, said in (((0.8, 1.2, 1.4, 1.9),
                             "holds for small sparse bodies, inverts for small full, large sparse and large full bodies"),
                            ((0.8, 0.9, 0.7, 0.6), "holds"), ((2, 2, 2, 2), "inverts"),
                            ((0.8, 1.01, 0.7, 1.5), "holds for small sparse and large sparse bodies, is undecided for small full bodies, "
                                                    "inverts for large full bodies")):
            bodies = zip("abcd", (0.2, 1, 0.2, 1), (1000, 1000, 10**7, 10**7), times)
            found = [case(scene, backend, time, particles, particles / share) for scene, share, particles, ratio in bodies
                     for backend, time in (("cuda_implicit_shared", 200), ("cuda_implicit_cached", 100),
                                           ("cuda_explicit_cached", 100 * ratio), ("cuda_march", 1))]
            with mock.patch.object(facts, "medians", return_value=found):
                self.assertEqual(facts.addressing_verdict(), said)

    def test_verdicts_follow_the_ratios(self):
        for ratios, said in (((0.5, 0.9), "holds"), ((0.5, 1.1), "depends on the dataset"), ((1.5, 1.1), "inverts")):
            self.assertEqual(facts.verdict(ratios), said)
        for slow, said in (((0.01, 0.04, 0.2), "holds up to 10 edits in 1000 steps"), ((0.01, 0.02, 0.03), "holds"),
                           ((0.1, 0.2, 0.3), "does not hold")):
            found = [case("a", "cuda_implicit_cached", 10 * (1 + one), edits=count, seconds_per_step_without_edits=1e-5)
                     for count, one in zip((1, 10, 100), slow)]
            with mock.patch.object(facts, "medians", return_value=found):
                self.assertEqual(facts.edit_verdict(), said)
        for nanoseconds, said, growth in (((9, 2, 1.1, 1), "holds from 262,144 on", 0.1), ((1, 1, 1, 1), "holds", 0),
                                          ((9, 4, 2, 1), "holds from 2.1 million on", 0)):
            found = [case(f"box@{n}", "cuda_implicit_cached", one * n**3 / 1000, n**3, n**3)
                     for n, one in zip((16, 32, 64, 128), nanoseconds)]
            with mock.patch.object(facts, "medians", return_value=found):
                self.assertEqual(facts.linear_verdict(), said)
                self.assertAlmostEqual(facts.growth(smallest=facts.linear_from()), growth)

    def test_spans(self):
        for values, written, said in (((1.234, 0.5, 20), rows.figure, "0.50 to 20"), ((1.001, 1.002), rows.figure, "1.00"),
                                      ((0.2, 0.31), facts.whole_percent, "20 to 31%"), ((0.99, 1.06), facts.signed_percent, "-1 to +6%")):
            self.assertEqual(facts.span(values, written), said)
        for of_nothing in (facts.span, facts.verdict):
            with self.assertRaises(rows.Missing):
                of_nothing([])


class Accuracy(unittest.TestCase):
    """The rules of docs/accuracy.md, against the committed results of pareto. A GPU server's leave its processor out."""
    BACKENDS = {rows.GPU: "cuda_implicit_cached", rows.CPU: "cpu_parallel"}

    def errors(self, machine, formulation):
        """The errors of float32 against the converged solution by scene, beginning with the largest time step."""
        found = {}
        for (scene, *kind, _), run in sorted(facts.runs(machine, self.BACKENDS[machine]).items(), key=lambda item: -item[0][3]):
            if kind == [formulation, "float32"] and run["total_error_relative_l2"] is not None:
                found.setdefault(scene, []).append(run["total_error_relative_l2"])
        return found

    def test_rules_hold_on_both_machines(self):
        def grows(machine):
            found = [one for name in ("position", "paper") for one in self.errors(machine, name).values()]
            return len(found) >= 4 and all(min(one[1:]) > one[0] for one in found)
        def exact(machine):
            displacement, position = self.errors(machine, "displacement"), self.errors(machine, "position")
            return all(min(displacement[scene]) < min(position[scene]) for scene in displacement)
        def serves_small_steps(machine):
            compensated, increment = self.errors(machine, "compensated"), self.errors(machine, "increment")
            return all(compensated[scene][-1] < increment[scene][-1] / 2 for scene in increment)
        def about_twice(machine):
            # "About" allows a tenth. A card's float64 is another one.
            medians = [statistics.median(ratios) for ratios in facts.float64_ratios(machine).values()]
            return machine == rows.GPU or len(medians) >= 3 and 1.8 < max(medians) < 2.2
        # The minimum is over every backend, not only over one per machine.
        least = {}
        for machine in self.BACKENDS:
            for run in rows.result("pareto", machine)["pareto"]:
                error = run["total_error_relative_l2"]
                if (run["formulation"], run["precision"]) == ("displacement", "float32") and error is not None:
                    least[machine, run["scene"]] = min(error, least.get((machine, run["scene"]), error))
        ends = " to ".join(f"{end(least.values()):.0e}".replace("e-0", "e-") for end in (min, max))
        text = " ".join(pathlib.Path("docs/accuracy.md").read_text().split())
        for words, holds in (
                ("Never refine the time step of `position` or `paper` in float32: with a smaller one the error is larger.", grows),
                ("`displacement` is about as fast as `position` and more accurate: in float32 its least total error is "
                 f"{ends}, depending on the scene.", exact),
                ("`compensated` keeps low parts as well. It serves small time steps", serves_small_steps),
                ("On a processor float64 takes up to about twice the time of float32, in the median of a scene", about_twice)):
            self.assertIn(words, text)
            for machine in self.BACKENDS:
                self.assertTrue(holds(machine), f"docs/accuracy.md: \"{words}\" is not what pareto of {machine} says")


def cells_of(table):
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.split("\n") if line.startswith("|")]


class Tables(unittest.TestCase):
    def test_marks_and_spread(self):
        for more, said in (({}, "3.4"), ({"spread": 0.06}, "3.4 ± 6 %"), ({"spread": 0.06, "noisy": ["a clock moved"]}, "~3.4 ± 6 %")):
            self.assertEqual(rows.time_of(case("a", "cuda_march", 3.4, **more)), said)
        self.assertEqual(result_files.spread_of([1, 2]), None)
        self.assertAlmostEqual(result_files.spread_of([8, 9, 10, 11, 12]), 0.1)

    def test_a_tuning_that_is_no_better_is_not_called_best(self):
        for time, said in ((9.9, ["10", "10", "2", "the default"]), (9.0, ["10", "9", "2", "block=64"]),
                           (11.0, ["10", "10", "2", "the default"])):
            found = [case("a", "cuda_march", 10, times=[10] * 9, steps=40),
                     case("a", "cuda_march", time, tuning="block=64", times=[time] * 9, steps=40)]
            with mock.patch.object(rows, "medians", return_value=found):
                self.assertEqual(cells_of(paper.Tables().tuning())[2][-4:], said)

    def test_one_half_of_the_repetitions_chooses_and_the_other_is_reported(self):
        def row(backend, *times):
            return case("a", backend, statistics.median(times), times=list(times), particle_updates_per_second=1000.0,
                        fraction_of_limit=0.5, limited_by="bandwidth")
        # Repetitions 0, 2, ... choose, so that lucky is chosen; 1, 3, ... give its time.
        lucky, steady = row("lucky", 1, 9, 1, 9, 1, 9, 5), row("steady", 4, 4, 4, 4, 4, 4, 4)
        found = rows.fastest_of([steady, lucky])
        self.assertEqual((found["backend"], found["real_time"]), ("lucky", 9))
        self.assertEqual(found["particle_updates_per_second"] * found["real_time"], 1000 * lucky["real_time"])
        self.assertEqual(found["fraction_of_limit"] * found["real_time"], 0.5 * lucky["real_time"])
        self.assertIs(rows.fastest_of([lucky]), lucky, "one alone is not chosen")
        self.assertEqual(rows.fastest_of([row("a", 3, 9, 3), row("b", 2, 9, 9)])["real_time"], 3, "three are not divided")

    def test_best_of_rows_are_those_that_the_program_chose(self):
        """The list `fastest` of each file, by harness/study/fastest.cpp, and the table of it."""
        cells = cells_of(paper.Tables().fastest())
        for machine in (rows.GPU, rows.CPU):
            found = rows.medians("fastest", machine)
            for block in rows.result("fastest", machine)["fastest"]:
                tried = rows.alike(found, block)
                best = rows.fastest_of(tried) if len(tried) > 1 else rows.held_out(*tried)
                self.assertEqual(rows.name_of(best), block["name"])
                self.assertAlmostEqual(best["real_time"] / (block["seconds_per_step"] * 1e6), 1, 6)
                for key in ("particle_updates_per_second", "spring_updates_per_second", "fraction_of_limit"):
                    self.assertAlmostEqual(best[key] / block[key], 1, 6)
                line = [f"{block['scene']} {block['formulation']} {block['precision']}", rows.contender(block), str(len(tried)),
                        rows.time_of(best)]
                self.assertIn(line, [one[:3] + one[4:5] for one in cells], "the fourth column has the steps of a batch")
                if block["paper"] is not None:
                    papers = [row for row in tried if row["backend"] in rows.PAPER]
                    paper_s = rows.fastest_of(papers) if len(papers) > 1 else rows.held_out(*papers)
                    self.assertAlmostEqual(block["paper"]["ratio"] * best["real_time"] / paper_s["real_time"], 1, 6)

    def test_the_wider_of_the_spreads_of_a_row(self):
        self.assertEqual([rows.widest(0.1, None), rows.widest(0.1, 0.2), rows.widest(None, None)], [0.1, 0.2, None])

    def test_cold_and_warm_starts_of_every_strategy(self):
        self.assertEqual(rows.starts_of({"ready_seconds": 0.3, "compile_seconds": 0.1, "warm_ready_seconds": 0.2}), ["300 (100)", "200"])
        self.assertEqual(rows.starts_of({}), ["-", "-"])
        self.assertEqual(rows.starts_of({"ready_seconds": 0.3, "warm_ready_seconds": 0.2, "ready_spread": 2.5, "warm_ready_spread": 0.01}),
                         ["300 ± 250 %", "200"])
        lines = cells_of(paper.Tables().starts())[2:]
        self.assertEqual({line[0].strip("`") for line in lines}, {row["backend"] for row in rows.medians("table1")})
        self.assertNotIn("-", sum(lines, []), "all are measured")
        for row in rows.medians("table1"):
            self.assertLessEqual(row["warm_ready_seconds"], row["ready_seconds"], row["name"])

    def test_energy(self):
        for row, said in (({"watts": 200, "sampled_watts": 199}, "yes, 0.5 %"), ({"watts": 200}, "no"),
                          ({"watts": 200, "sampled_watts": None}, "no")):
            self.assertEqual(rows.cross_check(row), said)
        found = rows.result("energy")["energy"]
        lines = cells_of(paper.Tables().energy())[2:]
        self.assertEqual(len(lines), len(found))
        for line, row in zip(lines, found):
            self.assertAlmostEqual(float(line[2]) / 1e3 / row["joules_per_step"], 1, 2)
            self.assertAlmostEqual(float(line[2]) * float(line[3]) * 1e6 / row["springs"], 1, 1)
        self.assertEqual(facts.joules(found[0]["scene"], found[0]["backend"]), found[0]["joules_per_step"])
        with self.assertRaises(rows.Missing):
            facts.joules("box@32", "cuda_none")

    def test_the_papers_strategies_are_marked(self):
        whose = {line[0]: line[1] for line in cells_of(paper.Tables().steps("figure7"))}
        for name, said in (("`cuda_implicit_shared`", "paper"), ("`cuda_resident`", "later"), ("`cuda_implicit_cached` fetch=l1", "later")):
            self.assertEqual(whose[name], said)


if __name__ == "__main__":
    unittest.main()
