"""README.md and docs/: their figures come from committed results and sources, their links lead somewhere, their commands exist.

VOXSPRING names the program; the current directory is the source tree.
"""

import json
import pathlib
import re
import shutil
import sys
import unittest

import jsonschema
from program import InTemporaryFolder, json_of, run, succeeds

sys.path.insert(0, "docs")
import figures  # noqa: E402  # pylint: disable=wrong-import-position

PAGES = [pathlib.Path("README.md"), pathlib.Path("CONTRIBUTING.md"), *sorted(pathlib.Path("docs").glob("*.md"))]
# A number with a unit of time, rate or ratio.
MEASURED = re.compile(r"~?\d[\d.,]*\s*(us|ms|ns|GB/s|MB|GB|%|G/s|M/s|times)(?![\w])")


class Pages(InTemporaryFolder):
    def test_the_first_page_is_short(self):
        self.assertLessEqual(len(pathlib.Path("README.md").read_text().splitlines()), 150)

    def test_a_tick_says_what_drawing_costs(self):
        def row(hertz, backend="cpu_parallel", drawn=False, edited=False, fit=50):
            return {"name": f"heart/{backend}/increment/float32", "scene": "heart", "backend": backend, "hertz": hertz, "drawn": drawn,
                    "edited": edited, "median_seconds": 1e-5 / fit, "p99_seconds": 2e-5, "p999_seconds": 3e-5, "worst_seconds": 1e-3,
                    "missed": 3, "ticks": 20000, "from_due": True, "steps_that_fit": fit, "force_error": 1.4e-7}
        rows = [row(1000), row(1000, drawn=True, fit=48), row(1000, edited=True), row(10000, fit=5), row(1000, "cuda_resident", fit=100)]
        about = {"voxspring": {"gpu": "a card", "commit": "0123456789"}}
        text = str(figures.tables().ticks([{"haptic": [one | {"real_time": True} for one in rows], "context": about}]))
        lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.split("\n") if line.startswith("| heart")]
        self.assertEqual([line[1:3] for line in lines], [["`cuda_resident`", "1"], ["`cpu_parallel`", "1"], ["`cpu_parallel`", "10"]])
        self.assertEqual(lines[1][4:], ["20 us", "30 us", "1000 us", "3 of 20,003", "50", "4 %", "1e-07"])
        self.assertEqual(lines[0][9], "-", "nobody drew it")
        self.assertIn("its rows are not verified", text)
        verdict = {"passed": True, "tolerance_rms": 2e-6, "motion_rms": 2, "strained_share": 0.9}
        verified = str(figures.tables().ticks([{"haptic": [one | {"real_time": True} | verdict for one in rows], "context": about}]))
        self.assertIn("| 1e-07 | 1.0e-06 |", verified)
        self.assertNotIn("not verified", verified)
        few = {"haptic": [row(1000) | {"real_time": True, "ticks": 9990, "from_due": None}], "context": about}
        old = str(figures.tables().ticks([few]))
        self.assertIn("| 20 us | - | 1000 us |", old, "fewer than ten ticks lie beyond a percentile of 99.9 %")
        self.assertIn("; times of this file begin when a tick began", old)
        self.assertIn("a card; the host's thread was real-time; commit 01234567.", text)

    def test_peers_are_beside_voxsprings_own_row_by_size(self):
        def rows(scene, particles, backend, times, lines, formulation="position"):
            common = {"name": f"{scene}/{backend}/{formulation}/float32/iterations:9", "run_name": f"{scene}/{backend}/{formulation}",
                      "formulation": formulation, "steps": 9, "scene": scene, "particles": particles, "backend": backend, "error_max": 2e-6, "lines_of_code": lines}
            return ([common | {"run_type": "iteration", "real_time": time} for time in times] +
                    [common | {"run_type": "aggregate", "aggregate_name": "median", "real_time": sorted(times)[1]}])

        reason = "CuPy computes on a card only"
        one = {"benchmarks": [*rows("large", 8000, "cpu_parallel", [100, 100, 100], None), *rows("large", 8000, "numba", [300, 250, 350], 34),
                              *rows("large", 8000, "cpu_parallel", [200, 200, 200], None, "increment"),
                              *rows("small", 27, "cpu_parallel", [2, 2, 2], None), *rows("small", 27, "numba", [50, 50, 50], 34)],
               "skipped": [{"scene": scene, "backend": "cupy", "reason": reason} for scene in ("small", "large")], "failed": [],
               "context": {"voxspring": {"gpu": "", "cpu": "a processor", "commit": "0123456789",
                                         "backends": {"numba": {"api": "numba 1.2"}, "cpu_parallel": {"api": "CPU"}}}}}
        text = str(figures.tables().peers([one]))
        lines = [line for line in text.split("\n") if line.startswith("| ")]
        self.assertEqual(lines[0], "|  | lines of code | small, 27 particles | large, 8,000 particles |")
        self.assertEqual(lines[2:], ["| Voxspring, `position` | - | 2 (`cpu_parallel`), 1.00 x, 2e-06 | 100 (`cpu_parallel`), 1.00 x, 2e-06 |",
                                     "| numba 1.2 | 34 | 50, 25.0 x, 2e-06 | 300 ± 8 %, 3.0 x, 2e-06 |",
                                     "| Voxspring, `increment` | - | - | 200 (`cpu_parallel`), 2.00 x, 2e-06 |"])
        self.assertEqual(text.count(f"Not here: cupy, because {reason}."), 1)
        self.assertIn("a processor; commit 01234567.", text)
        self.assertIn("No committed result has it yet.", str(figures.tables().peers([])))

    def test_figures_are_what_results_and_sources_say(self):
        done = run(sys.executable, "docs/figures.py", "--check")
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_figure_by_hand_is_noticed(self):
        root = self.folder
        for name in ("backends", "cuda", "harness", "results", "tests"):
            (root / name).symlink_to(pathlib.Path(name).resolve())
        shutil.copytree("docs", root / "docs")
        readme = pathlib.Path("README.md").read_text()
        row = re.search(r"\| `cuda_resident` \| ([\d.]+) ", readme)
        (root / "README.md").write_text(readme[:row.start(1)] + "0.99" + readme[row.end(1):])
        check = [sys.executable, root / "docs/figures.py"]
        done = run(*check, "--check")
        self.assertEqual(done.returncode, 1)
        self.assertIn("README.md is not what results and sources say", done.stderr)
        run(*check, check=True)
        self.assertEqual((root / "README.md").read_text(), readme)

    def test_the_first_page_has_no_figure_of_its_own(self):
        text = re.sub(r"<!-- (\w+) -->\n.*?<!-- /\1 -->", "", pathlib.Path("README.md").read_text(), flags=re.DOTALL)
        self.assertEqual([match[0] for match in MEASURED.finditer(text)], [])
        self.assertTrue(MEASURED.search("takes 1.22 us a step"))

    def test_links_lead_somewhere(self):
        for page in PAGES:
            for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
                if "://" in link:
                    continue
                file, _, anchor = link.partition("#")
                target = page.parent / file if file else page
                self.assertTrue(target.exists(), f"{page}: {link}")
                if anchor:
                    heads = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
                    anchors = {re.sub(r"[^\w -]", "", head).strip().lower().replace(" ", "-") for head in heads}
                    self.assertIn(anchor, anchors, f"{page}: {link}")

    def test_help_after_any_command(self):
        """As README says; the two that are scripts need no package for it."""
        said = succeeds("--help").stdout
        commands = re.findall(r"^  ([a-z]+) ", said[said.index("Subcommands:"):], re.MULTILINE)
        self.assertLessEqual({"run", "study", "diff", "report", "completion"}, set(commands))
        for command in commands:
            done = succeeds(command, "--help")
            self.assertEqual(done.stderr, "", command)
            self.assertIn("-h, --help" if command in ("diff", "report") else "-h,--help", done.stdout)

    def test_measure_explains_every_column_of_the_first_page(self):
        text = pathlib.Path("docs/measure.md").read_text()
        header = re.search(r"<!-- heart -->\n\n(.*)\n", pathlib.Path("README.md").read_text())[1]
        for column in [cell.strip() for cell in header.split("|")[1:-1]]:
            # The name that a table with another unit uses.
            name = {"backend": None, "us per step": "time per step", "G particles/s": "particles/s"}.get(column, column)
            if name:
                self.assertRegex(text, rf"(?m)^- .*\*{re.escape(name)}\*", column)

    def test_every_tuning_parameter_is_in_the_glossary(self):
        keys = {key for backend in json_of("list", "--json")["backends"] for key in backend.get("tuning", [])}
        text = pathlib.Path("docs/glossary.md").read_text()
        explained = re.findall(r"^\| `(\w+)` \|", text[text.index("## Tuning parameters"):], re.MULTILINE)
        self.assertLessEqual({"threads", "rest", "fetch"}, keys)
        self.assertEqual(sorted(set(explained)), explained, "each once, in alphabetical order")
        self.assertLessEqual(keys, set(explained))
        # Parameters that this build leaves out are explained too, but none that no backend has.
        sources = "".join(path.read_text() for folder in ("backends", "cuda") for path in pathlib.Path(folder).rglob("*.[ch]*"))
        for key in explained:
            self.assertIn(f'"{key}"', sources)

    def test_the_glossary_is_in_order_and_has_what_pages_do_not_explain(self):
        text = pathlib.Path("docs/glossary.md").read_text()
        words = [row.split("|")[1].strip() for row in text[:text.index("## Tuning")].split("\n") if row.startswith("| ")][2:]
        self.assertEqual(words, sorted(words, key=str.lower))
        for word in ("NVML", "RAPL", "PSS", "MIG", "fetch path", "secondary list", "SCHED_FIFO", "Lanczos", "Richardson", "empirical null"):
            self.assertIn(word, words)

    def test_both_citations_and_the_build_agree(self):
        """.zenodo.json is what Zenodo takes for the DOI of a release; it ignores CITATION.cff beside it."""
        cff, zenodo = pathlib.Path("CITATION.cff").read_text(), json.loads(pathlib.Path(".zenodo.json").read_text())
        said = dict(re.findall(r"^(\w+): (.*)$", cff, re.MULTILINE))
        self.assertEqual([said[key] for key in ("title", "abstract", "version", "license", "type")],
                         [zenodo[key] for key in ("title", "description", "version", "license", "upload_type")])
        authors = cff[cff.index("\nauthors:"):cff.index("\nreferences:")]
        self.assertEqual(re.findall(r"^  - name: (.*)$", authors, re.MULTILINE), [one["name"] for one in zenodo["creators"]])
        self.assertEqual(re.findall(r"^ +doi: (.*)$", cff, re.MULTILINE), [one["identifier"] for one in zenodo["related_identifiers"]])
        self.assertIn(f"project(voxspring VERSION {zenodo['version']} ", pathlib.Path("CMakeLists.txt").read_text())

    def test_the_example_of_a_study_is_one(self):
        example = json.loads(re.search(r"```json\n(.*?)```", pathlib.Path("docs/measure.md").read_text(), re.DOTALL)[1])
        jsonschema.validate(example, json.loads(pathlib.Path("results/study.schema.json").read_text()))
        # The example's own scenes do not exist here; the rest of it runs.
        example["scenes"] = [{"scene": "box@4"}]
        example |= {"repetitions": 1, "steps": 1, "backends": ["cpu_parallel", "cpu_parallel:precision=float64"]}
        succeeds("study", self.write("my_study.json", example))

    def test_code_comes_before_long_tables(self):
        """If a page has code, readers came for that."""
        for page in PAGES:
            text = page.read_text()
            tables = [match.start() for match in re.finditer(r"(?:^\|.*\n){30,}", text, re.MULTILINE)]
            code = [match.start() for match in re.finditer(r"^```(?:cpp|json)", text, re.MULTILINE)]
            if tables and code:
                self.assertLess(code[0], tables[0], page)

    def test_commands_exist(self):
        commands, usage = succeeds("--help").stdout, run("./run", "help", check=True).stdout
        for page in PAGES:
            text = page.read_text()
            for command in re.findall(r"(?:^    |`)(?:build/release/)?voxspring ([a-z]+)", text, re.MULTILINE):
                self.assertRegex(commands, rf"(?m)^ +{command}\b", page)
            for command in re.findall(r"(?:^    |`)\./run ([a-z]+)", text, re.MULTILINE):
                self.assertIn(f"./run {command}", usage, page)


if __name__ == "__main__":
    unittest.main()
