#!/usr/bin/env python3
"""Measures every committed study of a machine anew, with one program of one commit on one card.

Usage: remake.py [--program PROGRAM] [--check] [FOLDER] [STUDY...]

FOLDER (results/<machine>) gets STUDY.json.gz of each study. A file that this program's commit has already measured on this card
stays, so that a second call continues an interrupted one, also within a study. --check measures nothing: it says which files are
stale (missing, incomplete, or from another commit or card, or a tree with changes), and why.

The machine is all GPUs that CUDA finds, or else the processor. With several GPUs only `scaling` is measured unless other studies
are named; these run on the first GPU. CUDA_VISIBLE_DEVICES=0 leaves one GPU. With more than two GPUs `scaling` steps only its
largest bodies. `peers` is measured only if it is named, with the command of the Python package as the program: remake.py --program
env/bin/voxspring results/<machine> peers. A program that was built from a tree with changes is refused, since no commit contains
what it would measure.

If a study ends before its result is complete, the run ends. The study's journal stays, so that the next call resumes the study.

Exit code: 0 if done; 1 if a study failed, or if --check found a stale file; 2 for bad input; 130 if interrupted.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import time

import compact
import result_files

HERE = pathlib.Path(__file__).resolve().parent

# The studies of the first tables come first, so that an interrupted run has measured them. haptic plays in real time, for some six
# minutes.
GPU_STUDIES = ("table1", "fastest", "figure8", "figure7", "as_paper", "edits", "skips", "formulations", "tuning", "pareto", "stability",
               "stress", "overhead", "energy", "haptic")
# The studies for several cards: only those in which several cards step one body together.
MULTI_GPU_STUDIES = ("scaling",)
# The bodies for more than two cards: smaller ones gain little on two cards already.
SCENES_ON_MANY_GPUS = ["--scene", "box@256", "--scene", "box@512"]
# Studies of the Python package's command (docs/python.md). They are measured only if they are named.
PYTHON_STUDIES = ("peers",)
CPU_STUDIES = ("fastest", "pareto", "stability", "stress", "haptic")
# On a GPU server these studies leave out the processor, whose results are in another folder: it would take nearly
# half of the time of pareto, and a quarter of that of stress.
OPTIONS_ON_GPU = dict.fromkeys(("pareto", "stability", "stress", "energy"), ["--backend", "!cpu_*"])
OPTIONS_ON_GPU |= {"peers": ["--device", "cuda"], "scaling": ["--backend", "!cpu_*"]}
# On a processor `fastest` leaves out OpenGL and Vulkan in software. Their threads wait for each other and for a processor, so that
# a quarter of the rows would be noisy, and they would take sixteen of seventeen minutes.
OPTIONS_ON_CPU = {"fastest": ["--backend", "!gl_*", "--backend", "!vulkan_*"]}
# The time that all studies of a GPU server may take together; a longer run prints a note.
BUDGET_SECONDS = 25 * 60


class Machine:
    """The program that measures, the commit that it was built from, and what it measures on."""

    def __init__(self, program):
        self.program = program
        self.commit = self.commit_of(self.said("--version"))
        present = [backend for backend in json.loads(self.said("list", "--json"))["backends"] if backend["available"]]
        cards = [one for one in present if one.get("uuid") and one["api"].startswith("CUDA")]
        processors = [one for one in present if one["api"] == "CPU"]
        self.has_gpu = bool(cards)
        self.devices = max((one.get("devices", 1) for one in cards), default=1)
        self.device, self.uuid = next(((one["device"], one.get("uuid", "")) for one in cards or processors), ("unknown", ""))

    def said(self, *arguments):
        try:
            return subprocess.run([self.program, *arguments], check=True, capture_output=True, text=True).stdout
        except (OSError, subprocess.CalledProcessError) as error:
            reason = getattr(error, "stderr", None) or error
            raise result_files.BadInput(f"{self.program}: {reason}; expected a voxspring program") from None

    def commit_of(self, version):
        """The commit in "voxspring 0.2.0 (commit 1911cee49e72)"; a program built from a tree with changes is refused."""
        found = re.search(r"\(commit ([0-9a-f]+)(.*)\)", version)
        if not found or found[2]:
            raise result_files.BadInput(f"{self.program}: {version.strip()}: expected a program built from a commit, with no "
                                        "changes in its tree: commit them and build again")
        return found[1]

    def folder(self):
        """The folder of the machine: nvidia-h200 for NVIDIA H200, nvidia-h200-x2 for two of them."""
        name = re.sub(r"[^a-z0-9]+", "-", self.device.lower().split("(r)")[0]).strip("-")
        return HERE / (name if self.devices == 1 else f"{name}-x{self.devices}")

    def studies(self):
        """(the studies that are measured by default, the further studies that may be named)."""
        if not self.has_gpu:
            return CPU_STUDIES, PYTHON_STUDIES
        if self.devices == 1:
            return GPU_STUDIES, PYTHON_STUDIES
        return MULTI_GPU_STUDIES, GPU_STUDIES + PYTHON_STUDIES


def context_of(path):
    return result_files.load(path).get("context", {}).get("voxspring", {})


def reason_stale(path, machine):
    """Why a result has to be measured again with this program on this machine; empty if it is up to date."""
    if not path.exists():
        return "there is no result"
    if path.with_name(path.name.removesuffix(".gz") + ".journal").exists():
        return "cut short"
    context = context_of(path)
    if context.get("unfinished"):
        return "cut short"
    if context.get("commit") != machine.commit:
        return f"of commit {str(context.get('commit'))[:8]}, not {machine.commit[:8]}"
    if not context.get("clean", False):
        return "of a source tree with uncommitted changes"
    cards = {one.get("uuid") for one in context.get("backends", {}).values()} - {"", None}
    if machine.uuid and cards and cards != {machine.uuid}:
        return "of another card"
    return ""


def arguments_of(study, plain, machine):
    """The command line that runs a study, or resumes it if it was cut short."""
    options = (OPTIONS_ON_GPU if machine.has_gpu else OPTIONS_ON_CPU).get(study, [])
    if study in MULTI_GPU_STUDIES:
        options = [*options, "--devices", str(machine.devices), *(SCENES_ON_MANY_GPUS if machine.devices > 2 else [])]
    resume = ["--resume"] * plain.with_name(plain.name + ".journal").exists()
    return [machine.program, "study", study, "--out", plain, *options, *resume]


def measure(study, out, machine):
    """Runs or resumes a study, and compresses its result if that is complete. Returns (exit code, whether it is complete)."""
    plain = out / f"{study}.json"
    with subprocess.Popen(arguments_of(study, plain, machine)) as process:
        try:
            code = process.wait()
        except KeyboardInterrupt:
            # After Ctrl-C a study finishes what is in flight. subprocess.run() would kill it a quarter of a second later.
            process.wait()
            raise
    # With exit code 1 a backend failed, and the result says why, or the study could not go on and is unfinished.
    whole = code in (0, 1) and plain.exists() and not context_of(plain).get("unfinished", False)
    if whole:
        plain.with_name(plain.name + ".journal").unlink(missing_ok=True)
        compact.compact(plain)
    return code, whole


def remake(studies, out, machine, check):
    """Measures the studies whose results are stale. Returns the exit code."""
    stale = {}
    for study in studies:
        if reason := reason_stale(result_files.named(out, study), machine):
            stale[study] = reason
        print(f"{study:<14} {'stale: ' + reason if reason else 'of this commit'}", flush=True)
    if check:
        return 1 if stale else 0
    out.mkdir(parents=True, exist_ok=True)
    begin, worst = time.monotonic(), 0
    for number, study in enumerate(stale, 1):
        print(f"\n{study}: study {number} of {len(stale)}, {time.monotonic() - begin:.0f} s so far", flush=True)
        code, whole = measure(study, out, machine)
        if not whole:
            print(f"\n{study} ended before its result was whole: the studies after it are not measured")
            return code or 1
        worst = max(worst, code)
    seconds = time.monotonic() - begin
    print(f"\n{len(stale)} of {len(studies)} studies measured in {seconds:.0f} s: {out}")
    if machine.has_gpu and seconds > BUDGET_SECONDS:
        print(f"That is longer than the {BUDGET_SECONDS} s that all studies may take on a GPU server.")
    return worst


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default=HERE.parent / "build/release/voxspring", type=pathlib.Path,
                        help="the voxspring program")
    parser.add_argument("--check", action="store_true", help="say which results are stale, and measure nothing")
    parser.add_argument("folder", nargs="?", metavar="FOLDER",
                        help="where results are kept (default: results/<machine>)")
    parser.add_argument("study", nargs="*", metavar="STUDY", help="only these studies")
    arguments = parser.parse_args()
    try:
        machine = Machine(arguments.program)
        known, others = machine.studies()
        if arguments.folder in known + others:
            raise result_files.BadInput(f"command line: FOLDER: {arguments.folder} is the name of a study; expected a folder before "
                                        f"the studies, where ./{arguments.folder} names a folder")
        for study in arguments.study:
            if study not in known + others:
                raise result_files.BadInput(f"command line: STUDY: {study} is not accepted; expected "
                                            f"{', '.join(known + others)}")
        out = pathlib.Path(arguments.folder) if arguments.folder else machine.folder()
        if arguments.check:
            known += tuple(study for study in PYTHON_STUDIES if result_files.named(out, study).exists())
        print(f"{machine.device}, commit {machine.commit}, {out}")
        if machine.devices > 1 and not arguments.study:
            print(f"{machine.devices} cards: only {', '.join(known)} is measured; CUDA_VISIBLE_DEVICES=0 measures the studies of one card")
        sys.exit(remake(arguments.study or known, out, machine, arguments.check))
    except (result_files.BadInput, OSError) as error:
        result_files.refuse(__file__, error)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
