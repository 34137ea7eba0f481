"""Scenes, studies and their results."""

from __future__ import annotations

import gzip
import json
import os
import pathlib
import shutil
import sys
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

from . import _core

PROGRAM = pathlib.Path(__file__).parent / "bin" / "voxspring"


def scene(argument: str | os.PathLike[str]) -> _core.Body:
    """The body of a built-in scene ("heart", "box@64"), a scene file (*.json), a volume file or a mesh.

    What the loader guessed, rounded or left out is in `notes` of the body. Raises BadInput.
    """
    return _core.load_scene(os.fspath(argument))


class Result:
    """A result file: Google Benchmark's JSON with further fields (results/schema.json of the source).

    Printing it gives the program's table of its kind of study.
    """

    def __init__(self, text: str | dict[str, Any]):
        self.json: dict[str, Any] = json.loads(text) if isinstance(text, str) else text

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Result:
        """The result in a file (.json, or compressed .json.gz). Raises OSError, and BadInput for a file that is no result."""
        content = pathlib.Path(file).read_bytes()
        try:
            whole = json.loads(gzip.decompress(content) if content.startswith(b"\x1f\x8b") else content)
        except (ValueError, EOFError, OSError, zlib.error) as error:
            raise _core.BadInput(f"{file}: {error}; expected a result of a study, in JSON, compressed by gzip or not") from None
        if not isinstance(whole, dict) or "benchmarks" not in whole:
            raise _core.BadInput(f"{file}: expected a result of a study, whose JSON has the key benchmarks")
        return cls(whole)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Writes the result. A file of this name is replaced in one step. Raises OSError."""
        file = pathlib.Path(file).resolve()
        part = file.with_name(f".{file.name}.{os.getpid()}")
        try:
            part.write_text(json.dumps(self.json, indent=2) + "\n")
            part.replace(file)
        except BaseException:
            part.unlink(missing_ok=True)
            raise

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The rows that passed, one per case: the median over its repetitions."""
        return [row for row in self.json["benchmarks"] if row.get("aggregate_name") == "median" or row["repetitions"] == 1]

    @property
    def failed(self) -> list[dict[str, Any]]:
        """The rows that failed, each with its `reason`."""
        return self.json["failed"]

    def frame(self, rows: str | None = None) -> Any:
        """A pandas frame of the list called `rows`, such as "verification"; without an argument, of the property `rows`."""
        import pandas

        return pandas.DataFrame(self.rows if rows is None else self.json[rows])

    def __str__(self) -> str:
        # Rows are cut to the width of a terminal, but not in a file or a notebook.
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
        return _core.table(json.dumps(self.json), width)

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        printer.text(str(self))

    @classmethod
    def joined(cls, results: Iterable[Result], name: str) -> Result:
        """One result with the rows of one or more results, which must be of the same build and machine. Raises BadInput if there is
        none."""
        whole: dict[str, Any] = {}
        for result in results:
            if not whole:
                whole = json.loads(json.dumps(result.json))
                continue
            for key, rows in result.json.items():
                if isinstance(rows, list):
                    whole.setdefault(key, []).extend(rows)
            mine, other = whole["context"]["voxspring"], result.json["context"]["voxspring"]
            for key in ("backends", "counters", "limits"):
                if key in other:
                    mine.setdefault(key, {}).update(other[key])
            for key in ("gpu", "driver", "gl_renderer"):
                mine[key] = mine[key] or other[key]
        if not whole:
            raise _core.BadInput("Result.joined(): results: none is not accepted; expected one or more results")
        whole["context"]["voxspring"]["study"]["name"] = name
        return cls(whole)


def study(name: str | os.PathLike[str] = "default", body: _core.Body | None = None, *, steps: int | None = None,
          backends: Sequence[str] = (), scenes: Sequence[str] = (), repetitions: int | None = None,
          out: str | os.PathLike[str] | None = None) -> Result:
    """Runs a built-in study or a study file, the backends in other processes.

    With `body`, this body is the study's only scene, and a batch has `steps` steps, 1000 by default. `backends` and `scenes` are
    globs, as after --backend and --scene of the program. The file `out` is written after every scene. Ctrl-C finishes the work in
    flight, writes `out` and raises KeyboardInterrupt. Raises BadInput, also for `steps` without `body`.
    """
    if steps is not None and (body is None or steps < 1):
        raise _core.BadInput(f"study(): steps: {steps} is not accepted; expected 1 or more, and a body: the scenes of a study have "
                             "their own numbers of steps")
    return Result(_core.study(os.fspath(name), body, 1000 if steps is None else steps, list(backends), list(scenes), repetitions,
                              None if out is None else os.fspath(out), str(PROGRAM)))
