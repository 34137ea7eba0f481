"""Verifies and times peers, other systems that a user might pick instead of Voxspring, by the rules for a backend.

The file of a peer has the step as the system's users would write it. Its peer(body, device) returns step(x, v, n), the arrays for
judge() and, if the system is not the library of the arrays, the system's name with its version.
"""

from __future__ import annotations

import argparse
import contextlib
import fnmatch
import importlib
import importlib.util
import multiprocessing
import os
import pathlib
import random
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection

from .. import _core
from ..judging import Judge, Wrong, count_lines
from ..results import Result, scene, study

PEERS = ("numpy", "numba", "torch", "jax", "cupy", "warp", "taichi", "newton")
# Scenes of the study `fastest`, each with a number of steps that the slowest peer makes within seconds on a card.
SCENES = {"box@32": 200, "heart": 200, "box@48": 100, "box@96": 20}
# On a processor a case makes a quarter of these steps. The default scenes are only these two there: Newton builds a body
# spring by spring, and box@96 has 27 times the springs of box@32.
ON_PROCESSOR, SHARE_ON_PROCESSOR = ("box@32", "heart"), 4
# As in a study, a case makes no further repetition once it has made two and all have taken this many seconds together.
MOST_SECONDS = 10


def _serve(peer: str, argument: str, steps: int, repetitions: int, device: str, pipe: Connection) -> None:
    """The main function of a peer's process: warms the peer up, and answers the requests "repeat" and "result" from `pipe`."""
    try:
        body = scene(argument)
        file = pathlib.Path(__file__).parent / f"{peer}.py"
        step, arrays, *system = importlib.import_module(f"{__name__}.{peer}").peer(body, device)
        judge = Judge(step, body, steps, arrays=arrays, name=peer, version=system[0] if system else None, repetitions=repetitions,
                      lines=count_lines(file.read_text()))
        judge.warm_up()
        pipe.send(None)
        while (asked := pipe.recv()) == "repeat":
            begin = time.perf_counter()
            judge.repeat()
            pipe.send(time.perf_counter() - begin)
        if asked == "result":
            try:
                pipe.send(judge.result().json)
            except Wrong as wrong:
                pipe.send(wrong.result.json)
    except BaseException as failure:  # any exception: the parent process reports it
        with contextlib.suppress(OSError):
            absent = isinstance(failure, (ImportError, _core.Unavailable))
            kind = "" if isinstance(failure, _core.Unavailable) else f"{type(failure).__name__}: "
            pipe.send(failure if isinstance(failure, KeyboardInterrupt) else (absent, f"{kind}{failure}"))


class _Case:
    def __init__(self, peer: str, argument: str, steps: int, repetitions: int, device: str):
        self.peer, self.seconds, self.done, self.reason, self.absent = peer, 0.0, 0, "", False
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(peer, argument, steps, repetitions, device, theirs), daemon=True)
        self._process.start()
        theirs.close()
        self._answer()

    def _answer(self, request: str = "") -> object:
        """What the process answers to a request. It may have been killed before it got that, or before it answered."""
        try:
            if request:
                self._pipe.send(request)
            answer = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode or 0
            answer = False, f"its process was killed by signal {-code}" if code < 0 else f"its process ended with exit code {code}"
        if isinstance(answer, KeyboardInterrupt):
            raise answer
        if isinstance(answer, tuple):
            # A compiler's message has many lines; the reason in a row has one.
            self.absent, self.reason = answer[0], " ".join(answer[1].split())[:500]
        return answer

    def repeat(self) -> None:
        if self.reason or (self.done >= 2 and self.seconds > MOST_SECONDS):
            return
        seconds = self._answer("repeat")
        if isinstance(seconds, float):
            self.seconds, self.done = self.seconds + seconds, self.done + 1

    def result(self) -> Result | None:
        if self.reason:
            return None
        answer = self._answer("result")
        return Result(answer) if isinstance(answer, dict) else None

    def end(self) -> None:
        self._process.kill()
        self._process.join()


def _row(argument: str, peer: str, reason: str) -> dict[str, str]:
    return {"name": f"{argument}/{peer}/position/float32", "scene": argument, "backend": peer, "formulation": "position",
            "precision": "float32", "tuning": "", "reason": reason}


def run(peers: list[str], scenes: dict[str, int], repetitions: int, device: str, backends: list[str],
        out: str | None) -> Result:
    """Runs the backends and judges every peer on each scene. Repetitions of different peers take turns in random order."""
    results = []
    for argument, steps in scenes.items():
        print(f"{argument}: {', '.join(backends)}", file=sys.stderr)
        results.append(study("fastest", scene(argument), steps=steps, backends=backends, repetitions=repetitions))
        results[-1].json.pop("fastest")  # a list of the fastest backends, which says nothing about one backend per formulation
        cases, ended = [], results[-1].json
        try:
            for peer in peers:
                # Finds the package without importing it, which would leave its threads and memory in this process.
                reason = "" if importlib.util.find_spec(peer) else f"no Python package {peer} is installed"
                if not reason:
                    print(f"{argument}: warming up {peer}", file=sys.stderr)
                    case = _Case(peer, argument, steps, repetitions, device)
                    cases.append(case)
                    reason = case.reason if case.absent else ""
                if reason:
                    ended["skipped"].append(_row(argument, peer, reason))
            order = [case for case in cases if not case.reason] * repetitions
            random.shuffle(order)
            for number, case in enumerate(order):
                if sys.stderr.isatty():
                    print(f"\r{argument}: {number} of {len(order)}", end="\033[K\r", file=sys.stderr)
                case.repeat()
            for case in cases:
                if case.absent:
                    continue
                result = case.result()
                if result is None:
                    ended["failed"].append(_row(argument, case.peer, case.reason))
                else:
                    results.append(result)
        finally:
            for case in cases:
                case.end()
        whole = Result.joined(results, "peers")
        whole.json["context"]["voxspring"]["study"] = {"name": "peers", "kind": "judge", "repetitions": repetitions}
        if argument != list(scenes)[-1]:
            whole.json["context"]["voxspring"]["unfinished"] = True
        if out:
            whole.save(out)
    return whole


def _check_writable(path: pathlib.Path) -> None:
    """Raises BadInput now if a result could not be written after minutes of measuring."""
    if path.suffix != ".json" or path.is_dir() or not os.access(path.parent, os.W_OK):
        raise _core.BadInput(f"command line: --out: {path} is not accepted; expected a path that ends in .json, in a folder "
                             "where a file can be created")


def scenes_of(device: str, names: Sequence[str] | None = None) -> dict[str, int]:
    """{scene: number of steps} on a device. Without `names` these are the device's default scenes."""
    on_card = device == "cuda"
    return {name: SCENES[name] // (1 if on_card else SHARE_ON_PROCESSOR) for name in names or (SCENES if on_card else ON_PROCESSOR)}


def main(arguments: list[str] | None = None) -> int:
    options = argparse.ArgumentParser(prog="voxspring study peers", description=__doc__.splitlines()[0])
    options.add_argument("--peer", action="append", metavar="GLOB",
                         help=f"peers to run, of {', '.join(PEERS)}; repeatable (default: all)")
    options.add_argument("--scene", action="append", metavar="GLOB", help=f"scenes to step, of {', '.join(SCENES)}; "
                         f"repeatable (default: all with --device cuda, else {' and '.join(ON_PROCESSOR)})")
    options.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="what the peers compute on (default: cpu)")
    options.add_argument("--backend", action="append", help="a backend of Voxspring to compare with; "
                         "repeatable (default: cpu_parallel, or with --device cuda the backend that auto chooses, "
                         "each in the formulations position, which keeps two positions as the paper does, and increment, "
                         "which keeps a velocity as the peers do)")
    options.add_argument("--repetitions", type=int, default=9, help="timed runs of each peer and backend (default: 9)")
    options.add_argument("--out", metavar="FILE.json", help="write the result to this .json file")
    given = options.parse_args(arguments)

    def matching(names: list[str], globs: list[str] | None) -> list[str]:
        found = [name for name in names if globs is None or any(fnmatch.fnmatch(name, glob) for glob in globs)]
        if not found:
            options.error(f"none of {', '.join(names)} matches {', '.join(globs or ())}")
        return found

    peers = matching(list(PEERS), given.peer)
    scenes = scenes_of(given.device, matching(list(SCENES), given.scene) if given.scene else None)
    own = "cpu_parallel" if given.device == "cpu" else "auto"
    backends = given.backend or [f"{own}:formulation={formulation}" for formulation in ("position", "increment")]
    try:
        if given.out:
            _check_writable(pathlib.Path(given.out))
        result = run(peers, scenes, given.repetitions, given.device, backends, given.out)
    except KeyboardInterrupt:
        return 130
    except _core.BadInput as error:
        print(f"voxspring: {error}", file=sys.stderr)
        return 2
    print(result)
    return 1 if result.failed else 0
