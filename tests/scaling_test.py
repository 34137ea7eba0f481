"""Ranks that mpirun starts: bits, faults, a killed rank and another build.

FAULTY names the program with tests/faulty_backends.cpp in it, OTHER_BUILD a rank that is of another build, MESSAGES
ranks that send to each other; the current directory is the source tree. Exit code 77: there is no mpirun.
"""

import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time
import unittest

from faulty import FAULTY, PATIENCE, FaultyStudies, processes
from folder import run

OTHER_BUILD = os.environ["OTHER_BUILD"]
MESSAGES = os.environ["MESSAGES"]
MPIRUN = ["mpirun", "--oversubscribe", "--bind-to", "none"] + (["--allow-run-as-root"] if os.geteuid() == 0 else [])


class Scaling(FaultyStudies):
    defaults = {"kind": "scaling", "steps": 12, "repetitions": 1}

    def command(self, ranks, *options):
        return [*MPIRUN, "-n", str(ranks), FAULTY, "study", self.folder / "study.json", "--out", self.out, *options]

    def run_study(self, ranks, *options, code=0):
        ran = run(*self.command(ranks, *options))
        self.assertEqual(ran.returncode, code, ran.stdout + ran.stderr)
        self.assert_nothing_runs()
        return ran

    def test_one_to_four_ranks_give_the_bits_of_one(self):
        edits = {"dataset": {"type": "heart", "dims": [22, 24, 21]}, "pinned": {"side": "y+"}, "gravity": [0, 0, -1e-3],
                 "time_step": {"fraction_of_stable": 0.5},
                 "edits": [{"step": 2, "cut": {"triangles": [[[11, -9, -9], [11, 30, -9], [11, 10, 50]]]}},
                           {"step": 7, "suture": {"triangles": [[[11, -9, -9], [11, 30, -9], [11, 10, 50]]], "within": 1.5}}]}
        self.write("cut.json", edits)
        self.study(backends=["cpu_parallel:formulation=increment"], ranks=[1, 2, 3, 4], cuts=["slabs", "bricks"],
                   scenes=[{"scene": "cut.json"}, {"scene": "heart@15x17x23", "strained_start": True}])
        ran = self.run_study(4)
        rows = self.result()["scaling"]
        self.assertEqual(self.result()["failed"], [])
        slabs = [(ranks, way) for ranks in (2, 3, 4) for way in ("memory", "mpi")]
        for of_scene in (rows[:9], rows[9:]):
            self.assertEqual([(row["ranks"], row["way"]) for row in of_scene], [(1, "none"), *slabs, *slabs[-2:]], of_scene)
            self.assertEqual([row["cut"] for row in of_scene[-2:]], 2 * ["2x1x2"])
            self.assertEqual([row["same_bits"] for row in of_scene], [None] + 8 * [True])
        self.assertEqual(self.result()["context"]["voxspring"]["study"]["strained_starts"], ["heart@15x17x23"])
        self.assertEqual(ran.stdout.count("written:"), 1, "rank 0 alone prints")

    def test_threads_of_a_card_are_none_of_the_processor(self):
        self.study(backends=["has_threads_per_tile"], ranks=[1, 2], scenes=[{"scene": "box@5"}])
        self.run_study(2)
        self.assertEqual(self.result()["failed"], [])
        self.assertEqual({row["tuning"] for row in self.result()["scaling"]}, {"threads=auto"})

    def test_all_may_send_to_all_before_any_receives(self):
        """Simulates what ranks send about a task, for any number of repetitions."""
        ran = run(*MPIRUN, "-n", 3, MESSAGES)
        self.assertEqual(ran.returncode, 0, ran.stdout + ran.stderr)

    def test_a_sample_is_gathered_from_all_ranks(self):
        self.study(backends=["cpu_parallel:formulation=increment"], ranks=[1, 2, 3], cuts=["slabs"],
                   scenes=[{"scene": "heart@15x17x23", "sample_layers": 2}])
        self.run_study(3)
        rows = self.result()["scaling"]
        self.assertEqual(self.result()["failed"], [])
        self.assertEqual([row["way"] for row in rows], ["none", "memory", "mpi", "memory", "mpi"])
        self.assertEqual([row["same_bits"] for row in rows], [None] + 4 * [True])
        for row in rows:
            self.assertLess(row["judged_particles"], row["particles"])

    def test_a_part_that_crashes_or_hangs_fails_its_row_alone(self):
        self.study(backends=["part_crashes", "part_hangs", "cpu_reference:formulation=position"], ranks=[2],
                   scenes=[{"scene": "box@6"}])
        begin = time.monotonic()
        self.run_study(2, "--timeout", "4", code=1)
        self.assertLess(time.monotonic() - begin, 60)
        self.assertEqual([row["way"] for row in self.result()["scaling"]], ["memory", "mpi"])
        reasons = {(row["backend"], row["reason"].partition(":")[0]): row["reason"] for row in self.result()["failed"]}
        host = os.uname().nodename
        self.assertRegex(reasons["part_crashes", "as 2 ranks of 1x1x2 by memory"], "killed by signal 11")
        self.assertRegex(reasons["part_crashes", "as 2 ranks of 1x1x2 by mpi"], f"rank 1 on {host}: was killed by signal 11")
        for way in ("memory", "mpi"):
            self.assertRegex(reasons["part_hangs", f"as 2 ranks of 1x1x2 by {way}"], "rank 0 waited for rank 1 for 1 s")

    def test_a_study_whose_rank_was_killed_is_resumed(self):
        self.study(backends=["cpu_reference:formulation=position", "slow"], ranks=[2], steps=20, scenes=[{"scene": "box@5"}])
        with subprocess.Popen(self.command(2), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as study:
            self.wait_for(lambda: self.journal.exists() and "2 ranks of 1x1x2 by mpi" in self.journal.read_text(),
                          "the first rows")
            keeper = next(process for process in processes() if process not in self.before and
                          b"OMPI_COMM_WORLD_RANK=1" in pathlib.Path(f"/proc/{process}/environ").read_bytes() and
                          b"--of-a-study" not in pathlib.Path(f"/proc/{process}/cmdline").read_bytes())
            os.kill(keeper, signal.SIGKILL)
            study.communicate(timeout=PATIENCE)
            self.assertNotEqual(study.returncode, 0)
        self.assert_nothing_runs()
        self.run_study(2, "--resume")
        self.assertEqual(len(self.result()["scaling"]), 4)
        self.assertEqual(self.result()["context"]["voxspring"]["study"]["sessions"], 2)

    def test_ranks_of_another_build_and_other_studies_are_refused(self):
        self.study(backends=["cpu_reference"], scenes=[{"scene": "box@4"}])
        ran = run(*self.command(1), ":", "-n", 1, OTHER_BUILD)
        self.assertEqual(ran.returncode, 2, ran.stderr)
        self.assertIn("rank 1 on this host", ran.stderr)
        self.assertIn("same build", ran.stderr)
        self.study(kind="timing", backends=["cpu_reference"], scenes=[{"scene": "box@4"}])
        self.assertIn("not of the kind scaling", self.run_study(1, code=2).stderr)

    def test_says_why_there_is_no_open_mpi(self):
        (self.folder / "libmpi.so.40").write_text("no library")
        self.study(backends=["cpu_reference"], scenes=[{"scene": "box@4"}])
        command = [FAULTY, "study", self.folder / "study.json", "--ranks", "2"]
        surroundings = os.environ | {"LD_LIBRARY_PATH": str(self.folder)}
        ran = run(*command, env=surroundings)
        self.assertEqual(ran.returncode, 0, "without mpirun none is needed: " + ran.stderr)
        ran = run(*command, env=surroundings | {"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "0"})
        self.assertEqual(ran.returncode, 2)
        self.assertIn("libmpi.so.40", ran.stderr)


if __name__ == "__main__":
    if shutil.which("mpirun") is None:
        print("there is no mpirun")
        sys.exit(77)
    unittest.main()
