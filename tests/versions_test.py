"""Published schemas, the files that follow them, and files of other versions.

VOXSPRING names the executable; the current directory is the source tree.
"""

import copy
import gzip
import json
import pathlib
import re
import sys
import unittest

import jsonschema

sys.path.insert(0, "results")
import result_files  # noqa: E402

from program import VOXSPRING, InTemporaryFolder, run  # noqa: E402

RESULTS = pathlib.Path("results")
SCHEMAS = {"scene": RESULTS / "scene.schema.json", "study": RESULTS / "study.schema.json",
           "result": RESULTS / "schema.json"}
# Cut from a result of commit feeaa65, which had neither schema_version nor many of today's fields of rows.
OLD = pathlib.Path("tests/result_of_version_1.json")
REPORT_PYTHON = pathlib.Path("build/report-venv/bin/python")


def read(path):
    text = pathlib.Path(path).read_bytes()
    return json.loads(gzip.decompress(text) if text.startswith(result_files.GZIP) else text)


def validator(kind):
    schema = read(SCHEMAS[kind])
    found = jsonschema.validators.validator_for(schema)
    found.check_schema(schema)
    return found(schema)


def committed(kind):
    """Every file of a kind in the source tree, except the user's measurements in results/local."""
    return {"scene": sorted(pathlib.Path("harness/scenes").glob("*.json")),
            "study": sorted(pathlib.Path("harness/studies").glob("*.json")),
            "result": [OLD, pathlib.Path("docs/truth.json.gz"), *result_files.committed(RESULTS)]}[kind]


class Schemas(unittest.TestCase):
    def test_every_committed_file_follows_its_schema(self):
        for kind in SCHEMAS:
            schema = validator(kind)
            files = committed(kind)
            self.assertGreater(len(files), 5)
            for path in files:
                with self.subTest(path=str(path)):
                    schema.validate(read(path))

    def test_scenes_and_studies_say_where_their_schema_is(self):
        for kind in ("scene", "study"):
            for path in committed(kind):
                self.assertEqual((path.parent / read(path)["$schema"]).resolve(), SCHEMAS[kind].resolve())

    def test_id_and_accepted_versions_agree_and_so_do_the_programs(self):
        constants = dict(re.findall(r"int (\w+)_schema_version = (\d+);",
                                    pathlib.Path("harness/base/json.h").read_text()))
        self.assertEqual(constants.keys(), SCHEMAS.keys())
        for kind, path in SCHEMAS.items():
            schema = read(path)
            version = schema["properties"]["schema_version"]
            self.assertEqual(schema["$id"], f"urn:voxspring:{kind}:{version['maximum']}")
            self.assertEqual(constants[kind], str(version["maximum"]))
            self.assertEqual((version["type"], version["minimum"]), ("integer", 1))
        self.assertIn(f"\nRESULT = {constants['result']} ", (RESULTS / "result_files.py").read_text())

    def test_a_schema_refuses_what_is_of_another_version(self):
        for kind in SCHEMAS:
            good = read(committed(kind)[0])
            schema = validator(kind)
            self.assertTrue(schema.is_valid(good | {"schema_version": 1}))
            for version in (0, 2, 1.5, "1", None, True):
                self.assertFalse(schema.is_valid(good | {"schema_version": version}), version)


class OtherVersions(InTemporaryFolder):
    def test_an_old_result_compares_with_a_new_one(self):
        self.assertNotIn("schema_version", read(OLD))
        new = read(OLD) | {"schema_version": 1}
        same = run(sys.executable, "results/diff.py", OLD, self.write("new.json", new), "--json")
        self.assertEqual(same.returncode, 0, same.stderr)
        self.assertEqual(read_counts(same), {"same": 4}, "a step and a start of each row")
        slower = copy.deepcopy(new)
        for row in slower["benchmarks"]:
            if row["backend"] == "cuda_implicit_cached":
                row["real_time"] *= 1.5
        compared = run(sys.executable, "results/diff.py", OLD, self.write("slower.json", slower), "--json")
        self.assertEqual(compared.returncode, 1, compared.stderr)
        self.assertEqual(read_counts(compared), {"same": 3, "slower": 1})

    @unittest.skipUnless(REPORT_PYTHON.exists(), "the packages of results/requirements.txt are not installed")
    def test_an_old_result_is_on_the_page(self):
        page = self.folder / "page.html"
        made = run(REPORT_PYTHON, "results/report.py", OLD, "--out", page)
        self.assertEqual(made.returncode, 0, made.stderr)
        text = page.read_text()
        for word in ("scalpel_1", "cuda_implicit_cached", read(OLD)["context"]["voxspring"]["commit"][:7]):
            self.assertIn(word, text)

    def test_advise_reads_a_compressed_result(self):
        result = RESULTS / "amd-epyc/pareto.json.gz"
        plain = self.write("pareto.json", read(result))
        said = [run(VOXSPRING, "advise", "box@32", "--error", 1e-4, "--results", path) for path in (result, plain)]
        self.assertEqual(said[0].returncode, 0, said[0].stderr)
        self.assertIn("is reached soonest by", said[0].stdout)
        self.assertEqual(said[0].stdout, said[1].stdout)

    def test_every_reader_of_results_refuses_a_newer_one(self):
        readers = {
            "diff.py": lambda path: run(sys.executable, "results/diff.py", OLD, path),
            "reading.py": lambda path: run(sys.executable, "-c", READ_FOR_THE_PAGE, path),
            "advise": lambda path: run(VOXSPRING, "advise", "box@64", "--error", 1e-4, "--results", path),
        }
        kind = {"advise": "pareto"}
        for name, reader in readers.items():
            good = read(RESULTS / "amd-epyc" / f"{kind.get(name, 'fastest')}.json.gz")
            # The scripts share result_files.py.
            for version in (2, 0, 1.5, "one") if name in ("diff.py", "advise") else (2,):
                with self.subTest(name, version=version):
                    path = self.write("newer.json", good | {"schema_version": version})
                    self.assert_refused(reader(path), str(path), "schema_version", str(version), "1")
        self.assertEqual([p.name for p in self.folder.iterdir()], ["newer.json"])

    def test_the_program_refuses_a_newer_scene_or_study(self):
        scene = {"dataset": {"type": "box", "dims": [2, 2, 2]}}
        study = {"backends": ["cpu_reference"], "scenes": [{"scene": "box@2", "steps": 2}], "repetitions": 1}
        for version in (2, 0, 1.5, "one", None):
            path = self.write("newer.json", scene | {"schema_version": version})
            self.assert_refused(run(VOXSPRING, "info", path), str(path), "schema_version", json.dumps(version), "1")
            path = self.write("newer.json", study | {"schema_version": version})
            self.assert_refused(run(VOXSPRING, "study", path), str(path), "schema_version", json.dumps(version), "1")
        for document, arguments in ((scene, ("info",)), (study, ("study",))):
            path = self.write("explicit.json", document | {"schema_version": 1})
            self.assertEqual(run(VOXSPRING, *arguments, path).returncode, 0)


READ_FOR_THE_PAGE = """
import pathlib, sys
sys.path.insert(0, "results")
from page import reading
try:
    reading.read_all([pathlib.Path(sys.argv[1])])
except reading.BadInput as error:
    print(error, file=sys.stderr)
    sys.exit(2)
"""


def read_counts(compared):
    return json.loads(compared.stdout)["counts"]


if __name__ == "__main__":
    unittest.main()
