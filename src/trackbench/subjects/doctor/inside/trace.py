"""The values that the lines of a tracker assign in a step."""

from __future__ import annotations

import sys
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, TypeVar

import numpy as np

import trackbench
from trackbench.base.types import Array
from trackbench.subjects.doctor.inside.values import SAME, Pool, held_values

Answer = TypeVar("Answer")
#: Folders of code whose lines are not the tracker's: of libraries, and the standard library, below which in a plain
#: installation those of other packages are.
_NUMPY = Path(np.__file__).resolve().parent
LIBRARIES = tuple(map(str, (_NUMPY, _NUMPY.with_name("scipy"), Path(trackbench.__file__).resolve().parent)))
STANDARD = tuple(str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib"))
INSTALLED = "site-packages"
#: How far below a local variable its values are looked for.
DEPTH = 4


class Assigned(NamedTuple):
    """A value that a line has made."""

    file: str
    line: int
    name: str
    """Of the variable, with what leads from it to the value."""
    value: Array

    @property
    def where(self) -> str:
        """File and line, for a sentence."""
        return f"{Path(self.file).name}:{self.line}"


def traced(step: Callable[[], Answer]) -> tuple[Answer, list[Assigned]]:
    """What a function returns, and the values that the tracker's own lines assign on the way, in their order.

    A value is one of a local variable or below it, and what a function returns. A line that is left by a call has
    those that were assigned in the call too, after it.
    """
    assignments: list[Assigned] = []
    frames: dict[int, tuple[int, dict[tuple[Any, ...], bytes]]] = {}

    def snapshot(frame: FrameType) -> dict[tuple[Any, ...], tuple[bytes, Array]]:
        return {
            (name, *entry.path): (entry.value.tobytes(), entry.value)
            for name, value in frame.f_locals.items()
            for entry in held_values(value, DEPTH)
        }

    def local(frame: FrameType, event: str, answer: Any) -> Any:
        line, before = frames.get(id(frame), (frame.f_lineno, {}))
        now = snapshot(frame)
        for key, (content, value) in now.items():
            if before and before.get(key) != content:
                assignments.append(Assigned(frame.f_code.co_filename, line, _name(key), value))
        if event == "return":
            assignments.extend(
                Assigned(frame.f_code.co_filename, line, "return", entry.value) for entry in held_values(answer, DEPTH)
            )
            frames.pop(id(frame), None)
            return None
        frames[id(frame)] = (frame.f_lineno, {key: content for key, (content, _) in now.items()} | {("",): b""})
        return local

    def called(frame: FrameType, _event: str, _answer: Any) -> Any:
        return local if _own(frame.f_code.co_filename) else None

    earlier = sys.gettrace()
    sys.settrace(called)
    try:
        return step(), assignments
    finally:
        sys.settrace(earlier)


@cache
def _own(file: str) -> bool:
    """Whether the lines of a file are the tracker's."""
    if file.startswith("<"):
        return False
    path = str(Path(file).resolve())
    if path.startswith(LIBRARIES):
        return False
    return INSTALLED in path or not path.startswith(STANDARD)


def _name(key: tuple[Any, ...]) -> str:
    first, *more = key
    return str(first) + "".join(f"[{entry}]" if isinstance(entry, int) else f".{entry}" for entry in more)


def nearest_assigned(assigned: Sequence[Assigned], right: Array, earlier: Array) -> tuple[Assigned, float] | None:
    """What is nearest to one of several right values and is none of them, with its error relative to the largest entry.

    Args:
        assigned: in a step.
        right: ``(m, ...)``
        earlier: ``(m, ...)`` values of the same shape that were there before, which do not count.
    """
    best: tuple[Assigned, float] | None = None
    others = [*right, *earlier]
    for entry in assigned:
        for value in _of_size(entry.value, right[0].size):
            errors = [float(np.abs(value - np.ravel(other)).max() / np.abs(other).max()) for other in others]
            if min(errors) > SAME and (best is None or min(errors[: len(right)]) < best[1]):
                best = entry, min(errors[: len(right)])
    return best


def with_value(assigned: Sequence[Assigned], *values: Array) -> Assigned | None:
    """The first that has one of some values, in any order of its axes."""
    for entry in assigned:
        for value in values:
            if entry.value.size == value.size and (Pool([entry.value]).has(value)):
                return entry
    return None


def _of_size(value: Array, size: int) -> Iterator[Array]:
    """The value, or what it holds at each place of an axis, where that has a number of entries."""
    if value.size == size:
        yield np.ravel(value)
    for axis in range(value.ndim):
        if value.size == size * value.shape[axis]:
            yield from (np.ravel(part) for part in np.moveaxis(value, axis, 0))
