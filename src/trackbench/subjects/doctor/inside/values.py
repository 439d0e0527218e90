"""The numbers that an object holds, with the way to each, and those that the lines of a tracker assign in a step."""

from __future__ import annotations

import sys
import sysconfig
import types
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from numbers import Real
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, TypeVar

import numpy as np

import trackbench
from trackbench.base.types import Array, Scan

#: How far below an object its values are looked for, among how many of its parts, and how large an array is at most: a
#: filter is smaller.
DEPTH, MOST, LARGEST = 6, 20_000, 4096
#: Agreement of two values that are the same but for rounding, relative to the larger one.
SAME = 1e-9

Way = tuple[str | int, ...]
"""Attributes and keys by name, places of a list by number."""


class HeldAt(NamedTuple):
    """Where a value is held."""

    holder: Any
    key: Any

    def get(self) -> Any:
        """What is there."""
        if isinstance(self.holder, Mapping | list):
            return self.holder[self.key]
        return getattr(self.holder, self.key)

    def put(self, value: Any) -> None:
        """Hold another value there."""
        if isinstance(self.holder, dict | list):
            self.holder[self.key] = value
        else:
            setattr(self.holder, self.key, value)


class Held(NamedTuple):
    """A value that an object holds."""

    path: Way
    value: Array
    """A copy."""
    place: HeldAt | None
    """None at the top, and in what cannot be changed."""


def held_values(root: Any, depth: int = DEPTH) -> Iterator[Held]:
    """Every number, array of numbers, and list or dictionary of numbers below an object, nearest first.

    Scans are left out.
    """
    seen: set[int] = set()
    waiting: deque[tuple[Way, Any, HeldAt | None]] = deque([((), root, None)])
    while waiting and len(seen) < MOST:
        path, value, place = waiting.popleft()
        array = _numbers(value)
        if array is not None:
            yield Held(path, array, place)
        if array is not None or id(value) in seen or len(path) >= depth or isinstance(value, np.ndarray):
            continue
        seen.add(id(value))
        for key, below in parts(value):
            changeable = not isinstance(value, tuple)
            waiting.append(((*path, key), below, HeldAt(value, key) if changeable else None))


def _numbers(value: Any) -> Array | None:
    if isinstance(value, np.ndarray):
        return np.array(value, dtype=float) if value.dtype.kind in "fiu" and 0 < value.size <= LARGEST else None
    if isinstance(value, Real) and not isinstance(value, bool):
        return np.array(float(value))
    if isinstance(value, list | tuple | Mapping) and 0 < len(value) <= LARGEST and not isinstance(value, Scan):
        parts = list(value.values() if isinstance(value, Mapping) else value)
        if any(isinstance(entry, np.ndarray) for entry in parts):
            return None
        rows = [_numbers(entry) for entry in parts]
        arrays = [row for row in rows if row is not None]
        if len(arrays) == len(rows) and all(row.ndim < 2 and row.shape == arrays[0].shape for row in arrays):
            return np.stack(arrays)
    return None


def parts(value: Any) -> Iterable[tuple[Any, Any]]:
    """What an object holds, by name or place."""
    if isinstance(value, Scan | type | types.ModuleType | types.FunctionType | types.MethodType | str | bytes):
        return []
    if isinstance(value, Mapping):
        return [(key, below) for key, below in value.items() if isinstance(key, str | int)]
    if isinstance(value, list | tuple):
        return list(enumerate(value)) if len(value) <= LARGEST else []
    own = dict(getattr(value, "__dict__", {}))
    for base in type(value).__mro__:
        slots = base.__dict__.get("__slots__", ())
        own |= {name: getattr(value, name) for name in slots if isinstance(name, str) and hasattr(value, name)}
        # What a class holds for all its objects.
        if base.__module__ not in ("builtins", "numpy"):
            entries = [(name, entry) for name, entry in list(vars(base).items()) if not name.startswith("__")]
            shared = {name: entry for name, entry in entries if _numbers(entry) is not None}
            own = {**shared, **own}
    return list(own.items())


def formed(there: Any, value: Array) -> Any:
    """A value in the form of what is there."""
    if isinstance(there, np.ndarray):
        return value.reshape(there.shape)
    if isinstance(there, Mapping):
        return {key: formed(entry, part) for (key, entry), part in zip(there.items(), value, strict=True)}
    if isinstance(there, list | tuple):
        return type(there)(formed(entry, part) for entry, part in zip(there, value, strict=True))
    return float(value)


class Pool:
    """Numbers among which others are looked for."""

    def __init__(self, arrays: Iterable[Array]) -> None:
        flat = [np.ravel(array) for array in arrays]
        every = np.concatenate(flat) if flat else np.zeros(0)
        self._sorted = np.unique(every[np.isfinite(every)])

    def has(self, values: Array) -> bool:
        """Whether each of some values is among them, but for rounding."""
        wanted = np.ravel(values)
        if not len(self._sorted) or not np.isfinite(wanted).all():
            return False
        at = np.searchsorted(self._sorted, wanted)
        near = [self._sorted[np.clip(at + side, 0, len(self._sorted) - 1)] for side in (-1, 0)]
        scale = np.maximum(np.abs(wanted), float(np.abs(wanted).max()) * 1e-3)
        return bool(np.all(np.minimum(*(np.abs(entry - wanted) for entry in near)) <= SAME * scale + 1e-300))


Answer = TypeVar("Answer")
#: Folders of code whose lines are not the tracker's: of libraries, and the standard library, below which in a plain
#: installation those of other packages are.
_NUMPY = Path(np.__file__).resolve().parent
LIBRARIES = tuple(map(str, (_NUMPY, _NUMPY.with_name("scipy"), Path(trackbench.__file__).resolve().parent)))
STANDARD = tuple(str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib"))
INSTALLED = "site-packages"
#: How far below a local variable its values are looked for.
LOCAL_DEPTH = 4


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
            for entry in held_values(value, LOCAL_DEPTH)
        }

    def local(frame: FrameType, event: str, answer: Any) -> Any:
        line, before = frames.get(id(frame), (frame.f_lineno, {}))
        now = snapshot(frame)
        for key, (content, value) in now.items():
            if before and before.get(key) != content:
                assignments.append(Assigned(frame.f_code.co_filename, line, _name(key), value))
        if event == "return":
            assignments.extend(
                Assigned(frame.f_code.co_filename, line, "return", entry.value)
                for entry in held_values(answer, LOCAL_DEPTH)
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
