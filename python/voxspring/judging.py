"""Verifies and times a user's kernel by the rules of a study."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any

import numpy

from . import _core
from .results import Result

Step = Callable[[Any, Any, int], Any]


class Wrong(RuntimeError):
    """The kernel does not agree with the reference. `result` has its row in `failed`."""

    def __init__(self, message: str, result: Result):
        super().__init__(message)
        self.result = result


@dataclasses.dataclass
class Arrays:
    """What judge() needs to know about a library of arrays.

    to: makes an array of the library from one of numpy; the two share no memory.
    host: makes an array of numpy from one of the library.
    wait: returns once the two arrays that it gets, x and v, are computed.
    timed: calls a function that enqueues work, and returns its result and the seconds between two marks of the device's
        clock. None: the host's clock counts, from before the call until wait() has returned.
    api: the library with its version. device: the name of the card that it computes on; empty for this processor.
    """

    to: Callable[[numpy.ndarray], Any] = numpy.array
    host: Callable[[Any], numpy.ndarray] = numpy.asarray
    wait: Callable[..., Any] = lambda *arrays: None
    timed: Callable[[Callable[[], Any]], tuple[Any, float]] | None = None
    api: str = f"numpy {numpy.__version__}"
    device: str = ""


def _between(event: Callable[[], Any], record: Callable[[Any], Any], seconds: Callable[[Any, Any], float],
             run: Callable[[], Any]) -> tuple[Any, float]:
    """Calls `run` between two events of a card. Returns its result and the seconds between the events."""
    begin, end = event(), event()
    record(begin)
    result = run()
    record(end)
    return result, seconds(begin, end)


def _torch(device: str) -> Arrays:
    import torch

    api = f"torch {torch.__version__}"
    if device != "cuda":
        return Arrays(lambda a: torch.tensor(a), lambda t: t.numpy(), api=api)

    def seconds(begin: Any, end: Any) -> float:
        end.synchronize()
        return begin.elapsed_time(end) / 1e3

    timed = functools.partial(_between, lambda: torch.cuda.Event(enable_timing=True), lambda event: event.record(), seconds)
    return Arrays(lambda a: torch.tensor(a, device="cuda"), lambda t: t.cpu().numpy(), lambda *_: torch.cuda.synchronize(), timed,
                  api, torch.cuda.get_device_name())


def _jax(device: str) -> Arrays:
    import jax

    place = jax.devices(device or None)[0]
    on_card = place.platform != "cpu"
    return Arrays(lambda a: jax.device_put(a.copy(), place), numpy.asarray, lambda *arrays: jax.block_until_ready(arrays),
                  api=f"jax {jax.__version__}", device=place.device_kind if on_card else "")


def _cupy(_device: str) -> Arrays:
    import cupy

    def seconds(begin: Any, end: Any) -> float:
        end.synchronize()
        return cupy.cuda.get_elapsed_time(begin, end) / 1e3

    timed = functools.partial(_between, cupy.cuda.Event, lambda event: event.record(), seconds)
    name = cupy.cuda.runtime.getDeviceProperties(cupy.cuda.Device().id)["name"].decode()
    return Arrays(cupy.array, cupy.asnumpy, lambda *_: cupy.cuda.Device().synchronize(), timed, f"cupy {cupy.__version__}", name)


def _warp(device: str) -> Arrays:
    import warp

    place = warp.get_device(device or "cpu")

    def to(array: numpy.ndarray) -> Any:
        return warp.array(array, dtype=warp.vec3f if array.dtype == numpy.float32 else warp.vec3d, device=place)

    timed = None
    if place.is_cuda:
        timed = functools.partial(_between, lambda: warp.Event(device=place, enable_timing=True),
                                  lambda event: warp.get_stream(place).record_event(event),
                                  lambda begin, end: warp.get_event_elapsed_time(begin, end) / 1e3)
    return Arrays(to, lambda a: a.numpy(), lambda *_: warp.synchronize_device(place), timed, f"warp {warp.__version__}",
                  place.name if place.is_cuda else "")


def _taichi(device: str) -> Arrays:
    import taichi

    def to(array: numpy.ndarray) -> Any:
        made = taichi.ndarray(dtype=taichi.math.vec3, shape=len(array))
        made.from_numpy(array)
        return made

    version = ".".join(map(str, taichi.__version__))
    return Arrays(to, lambda a: a.to_numpy(), lambda *_: taichi.sync(), api=f"taichi {version}",
                  device="CUDA device" if device == "cuda" else "")


_LIBRARIES: dict[str, Callable[[str], Arrays]] = {
    "numpy": lambda _: Arrays(), "torch": _torch, "jax": _jax, "cupy": _cupy, "warp": _warp, "taichi": _taichi}
# What libraries compute on, if not on both a processor and a card.
_DEVICES = {"numpy": ("", "cpu"), "cupy": ("", "cuda")}


def _arrays(given: str | Arrays) -> Arrays:
    if isinstance(given, Arrays):
        return given
    library, _, device = given.partition(":")
    if library not in _LIBRARIES or device not in _DEVICES.get(library, ("", "cpu", "cuda")):
        raise _core.BadInput(f"judge(): arrays: {given!r} is not accepted; expected one of {', '.join(_LIBRARIES)}, with :cuda "
                             "after it for a card (numpy computes on the processor only, cupy on a card only), or an Arrays of "
                             "your own")
    try:
        return _LIBRARIES[library](device)
    except Exception as error:  # each library has its own exception for a device that is not there
        raise _core.Unavailable(f"judge(): arrays: {given!r}: {error}") from error


class Judge:
    """The trial of one kernel. Call warm_up() once, then repeat() as often as `repetitions` says, then result().

    judge() does all of that. With a Judge per kernel the repetitions of several kernels can take turns, as those of backends do
    in a study.
    """

    def __init__(self, step: Step, body: _core.Body, steps: int = 1000, *, arrays: str | Arrays = "numpy", name: str | None = None,
                 version: str | None = None, repetitions: int = 9, precision: str = "float32", formulation: str = "position",
                 lines: int | None = None):
        self._step, self._body, self._steps = step, body, steps
        self._arrays = _arrays(arrays)
        self._type = numpy.dtype(precision) if precision in ("float32", "float64") else numpy.dtype("float32")
        self._on_positions = formulation in ("position", "paper")
        on_host = not self._arrays.device
        api = self._arrays.api if version is None else version
        clock = "steady_clock" if self._arrays.timed is None else "the library's events"
        self._trial = _core.Trial(body, steps, repetitions, name or getattr(step, "__name__", type(step).__name__), formulation,
                                  precision, api, self._arrays.device or _core.cpu(), clock, "cpu" if on_host else "cuda",
                                  _lines_of(step) if lines is None else lines)
        self._start = body.start if self._on_positions else body.start - body.rest_position
        self._start_velocity = body.start_velocity

    def _run(self, start: numpy.ndarray, velocity: numpy.ndarray, timed: bool) -> tuple[numpy.ndarray, numpy.ndarray]:
        """Runs one batch from `start` with `velocity`. Returns the displacements and increments after it, in float64."""
        arrays = self._arrays
        x, v = arrays.to(start.astype(self._type)), arrays.to(velocity.astype(self._type))
        arrays.wait(x, v)
        left: list[Any] = [x, v]

        def make() -> None:
            returned = self._step(x, v, self._steps)
            if returned is not None:
                try:
                    left[:] = returned
                except TypeError:
                    left[:] = [returned]

        def batch() -> float | None:
            seconds = None
            if arrays.timed is not None:
                _, seconds = arrays.timed(make)
            else:
                make()
            arrays.wait(*left)
            return seconds

        if timed:
            self._trial.repeat(batch)
        else:
            batch()
        return self._taken(left)

    def _taken(self, left: list[Any]) -> tuple[numpy.ndarray, numpy.ndarray]:
        expected = (len(self._body), 3)
        if len(left) != 2:
            values = "1 value returned is" if len(left) == 1 else f"{len(left)} values returned are"
            raise _core.BadInput(f"judge(): step: {values} not accepted; expected x and v, or None if it changed them in "
                                 "place")
        x, v = (numpy.ascontiguousarray(self._arrays.host(array)) for array in left)
        for name, array in (("x", x), ("v", v)):
            if array.shape != expected:
                raise _core.BadInput(f"judge(): step: {name} of shape {array.shape} is not accepted; expected {expected}")
            if array.dtype != self._type:
                raise _core.BadInput(f"judge(): step: {name} of {array.dtype} is not accepted; expected {self._type}, the precision in "
                                     "which it is judged")
        displacement = x.astype(numpy.float64)
        if self._on_positions:
            displacement -= self._body.rest_position
        return displacement, v.astype(numpy.float64) * self._body.time_step

    def warm_up(self) -> None:
        """Runs one batch that is not timed, so that libraries compile their kernels now."""
        self._run(self._start, self._start_velocity, timed=False)

    def repeat(self) -> None:
        """Times one batch from the body's start, and judges the state that it left."""
        self._trial.judge_state(*self._run(self._start, self._start_velocity, timed=True))

    def result(self) -> Result:
        """The result with this kernel's row. If the body's own start strains too few springs to verify a kernel, a further batch
        from a strained start is judged first. Raises Wrong if a state does not agree with the reference."""
        strained = self._trial.strained_start()
        if strained is not None:
            start = strained + self._body.rest_position if self._on_positions else strained
            self._trial.judge_strained(*self._run(start, numpy.zeros_like(start), timed=False))
        result = Result(self._trial.json())
        if result.failed:
            row = result.failed[0]
            raise Wrong(f"{row['name']}: {row['reason']}", result)
        return result


def _lines_of(step: Step) -> int | None:
    """The number of lines of code of the function, without blank lines and comments; None if its source is not known."""
    try:
        source = inspect.getsource(inspect.unwrap(step))
    except (OSError, TypeError):
        return None
    return count_lines(source)


def count_lines(source: str) -> int:
    """The number of lines that are not blank, not a comment and not part of a text in triple quotes that begins a line."""
    lines, in_text = 0, False
    for line in map(str.strip, source.splitlines()):
        quotes = line.count('"""')
        if in_text or (quotes and line.startswith('"""')):
            in_text = in_text != (quotes == 1)
        elif line and not line.startswith("#"):
            lines += 1
    return lines


def judge(step: Step, body: _core.Body, steps: int = 1000, *, arrays: str | Arrays = "numpy", name: str | None = None,
          version: str | None = None, repetitions: int = 9, precision: str = "float32", formulation: str = "position",
          lines: int | None = None) -> Result:
    """Verifies and times step(x, v, n), which steps `body` n times, as a study does a backend.

    x: positions, (particles, 3), in the body's unit of length and in the order of body.rest_position; with `formulation`
        displacement, increment or compensated their displacements from rest. v: the velocities that led there,
        (x(t) - x(t - dt)) / dt. step() changes both in place or returns new ones. One step is

            v = (1 - damping) v + (force / mass + gravity) time_step,    x = x + v time_step

        with force = load + the sum over springs of stiffness (rest_length - |d|) d / |d|, d = x_i - x_j; pinned particles stay.
    arrays: whose arrays x and v are: numpy, torch, jax, cupy, warp or taichi, with ":cuda" after it for a card, or an Arrays.
    precision, formulation: what the arrays hold. The error is compared with that of correct arithmetic in this formulation.
    name: the name of the row; by default the function's. version: the library and its version; by default that of `arrays`.
    lines: the number of lines of code in the row; by default that of the function.

    After a batch that is not timed, `repetitions` batches from the same start are timed, by the device's clock where the library
    has one. The state after each is compared with the float64 reference. Returns a Result whose row has the time of a step
    and the errors; print() shows it. Raises Wrong if a state does not agree with the reference, and BadInput for a bad argument.
    """
    trial = Judge(step, body, steps, arrays=arrays, name=name, version=version, repetitions=repetitions, precision=precision,
                  formulation=formulation, lines=lines)
    trial.warm_up()
    for _ in range(repetitions):
        trial.repeat()
    return trial.result()
