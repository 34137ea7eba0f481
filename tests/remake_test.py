"""Tests of results/remake.py with a stand-in for the program: which studies it measures, which it leaves, what it refuses."""

import gzip
import json
import pathlib
import sys
import unittest

from folder import InTemporaryFolder, run

ROOT = pathlib.Path(__file__).resolve().parent.parent

# A voxspring of a commit and a card, whose studies take no time. Its arguments go to $CALLS; Ctrl-C ends the study $FAIL, and $BREAK
# ends after its first row. After Ctrl-C the study $SLOW finishes what is in flight for a second, and $CUT leaves an unfinished
# result without a journal.
PROGRAM = """#!/usr/bin/python3
import json, os, pathlib, signal, sys, time
commit, uuid, devices = "{commit}", "{uuid}", {devices}
if sys.argv[1] == "--version":
    print(f"voxspring 0.2.0 (commit {{commit}})")
elif sys.argv[1] == "list":
    gpu = [{{"available": True, "api": "CUDA 13.0", "device": "NVIDIA H200", "uuid": uuid, "devices": devices}}] if uuid else []
    print(json.dumps({{"backends": [{{"available": True, "api": "CPU", "device": "AMD EPYC"}}, *gpu, {{"available": False}}]}}))
else:
    out = pathlib.Path(sys.argv[sys.argv.index("--out") + 1])
    with open(os.environ["CALLS"], "a") as calls:
        print(*sys.argv[1:3], *sys.argv[5:], file=calls)
    used = {{"a": {{"uuid": uuid}}, "b": {{"uuid": ""}}}}
    if sys.argv[2] == os.environ.get("SLOW"):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.killpg(0, signal.SIGINT)
        time.sleep(1)
        pathlib.Path(f"{{out}}.journal").write_text("all that was measured")
        sys.exit(130)
    cut = sys.argv[2] == os.environ.get("CUT")
    broken = sys.argv[2] == os.environ.get("BREAK")
    if broken:
        pathlib.Path(f"{{out}}.journal").touch()
    if not broken or "WRITES" in os.environ:
        out.write_text(json.dumps({{"benchmarks": [], "context": {{"voxspring": {{
            "commit": commit, "clean": True, "backends": used, **({{"unfinished": True}} if broken or cut else {{}})}}}}}}))
    if broken or cut:
        sys.exit(1 if broken else 130)
    if sys.argv[2] == os.environ.get("FAIL"):  # what is cut short is written as far as it came
        pathlib.Path(f"{{out}}.journal").touch()
        sys.exit(130)
    sys.exit(int(os.environ.get("CODE", 0)))
"""


class Remake(InTemporaryFolder):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "out"
        self.calls = self.folder / "calls"
        self.install("aaaaaaaaaaaa", "")

    def install(self, commit, uuid, devices=1):
        self.program = self.write("voxspring", PROGRAM.format(commit=commit, uuid=uuid, devices=devices))
        self.program.chmod(0o755)

    def remake(self, *arguments, **environment):
        self.calls.write_text("")
        done = run(sys.executable, ROOT / "results/remake.py", "--program", self.program, *arguments,
                   env={"CALLS": str(self.calls), **environment}, start_new_session=True)
        return done, self.calls.read_text().splitlines()

    def test_measures_what_suits_the_machine_and_every_committed_file(self):
        done, calls = self.remake(self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(calls, ["study fastest --backend !gl_* --backend !vulkan_*", "study pareto", "study stability", "study stress",
                                 "study haptic"])
        self.assertEqual({path.name for path in self.out.iterdir()}, {f"{call.split()[1]}.json.gz" for call in calls})
        self.install("aaaaaaaaaaaa", "GPU-1")
        _, calls = self.remake(self.folder / "gpu")
        self.assertEqual(len(calls), 15)
        self.assertIn("study stress --backend !cpu_*", calls, "the processor has its own folder")
        self.install("aaaaaaaaaaaa", "GPU-1", devices=2)
        done, calls = self.remake(self.folder / "gpus")
        self.assertEqual(calls, ["study scaling --backend !cpu_* --devices 2"])
        self.assertIn("2 cards: only scaling is measured", done.stdout)
        self.assertIn("results/nvidia-h200-x2", self.remake("--check")[0].stdout)
        self.install("aaaaaaaaaaaa", "GPU-1", devices=4)
        _, calls = self.remake(self.folder / "more")
        self.assertEqual(calls, ["study scaling --backend !cpu_* --devices 4 --scene box@256 --scene box@512"])
        self.assertEqual(self.remake(self.folder / "one", "figure8")[1], ["study figure8"])
        for machine in filter(pathlib.Path.is_dir, (ROOT / "results").iterdir()):
            committed = {path.name for path in machine.glob("*.json.gz")}
            made = (self.folder / "gpu" if "figure8.json.gz" in committed else self.folder / "gpus" if "scaling.json.gz" in committed
                    else self.out)
            self.assertLessEqual(committed - {"peers.json.gz"}, {path.name for path in made.iterdir()}, machine)

    def test_measures_peers_where_they_are_named_and_checks_them_where_they_are(self):
        for uuid, call in (("", "study peers"), ("GPU-1", "study peers --device cuda")):
            self.install("aaaaaaaaaaaa", uuid)
            self.assertNotIn("peers", self.remake("--check", self.out)[0].stdout)
            self.assertEqual(self.remake(self.out, "peers")[1], [call])
            self.assertIn("peers          of this commit", self.remake("--check", self.out)[0].stdout)
            (self.out / "peers.json.gz").unlink()

    def test_leaves_what_is_of_this_commit_and_card(self):
        self.install("aaaaaaaaaaaa", "GPU-1")
        self.remake(self.out)
        self.assertEqual(self.remake(self.out)[1], [])
        self.assertEqual(self.remake("--check", self.out)[0].returncode, 0)
        for commit, uuid, reason in (("bbbbbbbbbbbb", "GPU-1", "of commit aaaaaaaa, not bbbbbbbb"),
                                     ("aaaaaaaaaaaa", "GPU-2", "of another card")):
            self.install(commit, uuid)
            done, calls = self.remake("--check", self.out, "table1")
            self.assertEqual((done.returncode, calls), (1, []))
            self.assertIn(f"table1         stale: {reason}", done.stdout)
        self.assertEqual(self.remake(self.out, "table1")[1], ["study table1"])
        self.assertEqual(json.loads(gzip.decompress((self.out / "table1.json.gz").read_bytes()))["context"]["voxspring"]["backends"]
                         ["a"]["uuid"], "GPU-2")

    def test_goes_on_where_it_was_cut_short(self):
        done, calls = self.remake(self.out, FAIL="stability")
        self.assertEqual((done.returncode, calls[-1]), (130, "study stability"))
        self.assertEqual(self.remake(self.out)[1], ["study stability --resume", "study stress", "study haptic"])

    def test_peers_that_were_cut_short_are_measured_anew(self):
        self.assertEqual(self.remake(self.out, "peers", CUT="peers")[0].returncode, 130)
        done = self.remake("--check", self.out, "peers")[0]
        self.assertEqual((done.returncode, done.stdout.splitlines()[-1].split(" ", 1)[1].strip()), (1, "stale: cut short"))
        self.assertEqual(self.remake(self.out, "peers")[1], ["study peers"])
        self.assertEqual([path.name for path in self.out.iterdir()], ["peers.json.gz"])

    def test_a_study_that_is_interrupted_finishes_what_is_in_flight(self):
        done, calls = self.remake(self.out, SLOW="stability")
        self.assertEqual((done.returncode, calls[-1]), (130, "study stability"))
        self.assertEqual((self.out / "stability.json.journal").read_text(), "all that was measured")

    def test_a_failed_backend_stops_nothing(self):
        done, calls = self.remake(self.out, CODE="1")
        self.assertEqual((done.returncode, len(calls)), (1, 5))

    def test_a_study_that_cannot_go_on_stops_all_and_keeps_its_journal(self):
        for written in ({}, {"WRITES": "1"}):
            with self.subTest(written):
                out = self.folder / f"broken{len(written)}"
                done, calls = self.remake(out, BREAK="pareto", **written)
                self.assertEqual((done.returncode, calls[-1]), (1, "study pareto"))
                self.assertIn("pareto ended before its result was whole", done.stdout)
                self.assertFalse((out / "pareto.json.gz").exists())
                self.assertEqual(self.remake(out)[1][0], "study pareto --resume")

    def test_refuses(self):
        for commit in ("aaaaaaaaaaaa, changed since", "unversioned"):
            self.install(commit, "")
            done, calls = self.remake(self.out)
            self.assertEqual((done.returncode, calls), (2, []))
            self.assertIn("expected a program built from a commit", done.stderr)
        self.install("aaaaaaaaaaaa", "")
        done, calls = self.remake(self.out, "figure8")
        self.assertEqual((done.returncode, calls), (2, []))
        self.assertIn("figure8 is not accepted; expected fastest, pareto", done.stderr)
        done, calls = self.remake("pareto")
        self.assertEqual((done.returncode, calls), (2, []))
        self.assertIn("FOLDER: pareto is the name of a study", done.stderr)
        self.program.unlink()
        self.assertEqual(self.remake(self.out)[0].returncode, 2)


if __name__ == "__main__":
    unittest.main()
