"""Numbers that an object holds, with the path to each, and numbers that the lines of a tracker assign in a step."""

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

#: Limits of the search below an object: its depth, the number of parts, and the size of an array. A filter is smaller.
DEPTH, MOST, LARGEST = 6, 20_000, 4096
#: Relative difference of two values that is only rounding.
SAME = 1e-9

KeyPath = tuple[str | int, ...]
"""Path from an object down to a value: names of attributes, keys, and indices in lists."""


class HeldAt(NamedTuple):
    """Place of a value: the object that holds it, and the key or attribute."""

    holder: Any
    key: Any

    def get(self) -> Any:
        if isinstance(self.holder, Mapping | list):
            return self.holder[self.key]
        return getattr(self.holder, self.key)

    def put(self, value: Any) -> None:
        if isinstance(self.holder, dict | list):
            self.holder[self.key] = value
        else:
            setattr(self.holder, self.key, value)


class Held(NamedTuple):
    """A number or array found below an object."""

    path: KeyPath
    value: Array
    place: HeldAt | None
    """Where the value can be replaced; None for the searched object itself, and for entries of tuples."""


def held_values(root: Any, depth: int = DEPTH) -> Iterator[Held]:
    """Yield copies of all numbers, arrays, lists and dictionaries of numbers below an object, nearest first.

    Scans are left out.
    """
    seen: set[int] = set()
    waiting: deque[tuple[KeyPath, Any, HeldAt | None]] = deque([((), root, None)])
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
    """Return the entries of an object with their keys or indices, or its attributes with their names."""
    if isinstance(value, Scan | type | types.ModuleType | types.FunctionType | types.MethodType | str | bytes):
        return []
    if isinstance(value, Mapping):
        return [(key, below) for key, below in value.items() if isinstance(key, str | int)]
    if isinstance(value, list | tuple):
        return list(enumerate(value)) if len(value) <= LARGEST else []
    attributes = dict(getattr(value, "__dict__", {}))
    for base in type(value).__mro__:
        slots = base.__dict__.get("__slots__", ())
        attributes |= {name: getattr(value, name) for name in slots if isinstance(name, str) and hasattr(value, name)}
        # Numbers that a class holds for all its objects.
        if base.__module__ not in ("builtins", "numpy"):
            entries = [(name, entry) for name, entry in list(vars(base).items()) if not name.startswith("__")]
            shared = {name: entry for name, entry in entries if _numbers(entry) is not None}
            attributes = {**shared, **attributes}
    return list(attributes.items())


def reshape(template: Any, value: Array) -> Any:
    """Return the numbers of ``value`` in the type of ``template``: array, mapping, list, tuple or number."""
    if isinstance(template, np.ndarray):
        return value.reshape(template.shape)
    if isinstance(template, Mapping):
        return {key: reshape(entry, part) for (key, entry), part in zip(template.items(), value, strict=True)}
    if isinstance(template, list | tuple):
        return type(template)(reshape(entry, part) for entry, part in zip(template, value, strict=True))
    return float(value)


class Pool:
    """Set of numbers in which computed values are looked up."""

    def __init__(self, arrays: Iterable[Array]) -> None:
        flat = [np.ravel(array) for array in arrays]
        every = np.concatenate(flat) if flat else np.zeros(0)
        self._sorted = np.unique(every[np.isfinite(every)])

    def has(self, values: Array) -> bool:
        """Return whether all values are in the set, but for rounding."""
        wanted = np.ravel(values)
        if not len(self._sorted) or not np.isfinite(wanted).all():
            return False
        index = np.searchsorted(self._sorted, wanted)
        near = [self._sorted[np.clip(index + side, 0, len(self._sorted) - 1)] for side in (-1, 0)]
        scale = np.maximum(np.abs(wanted), float(np.abs(wanted).max()) * 1e-3)
        return bool(np.all(np.minimum(*(np.abs(entry - wanted) for entry in near)) <= SAME * scale + 1e-300))


Answer = TypeVar("Answer")
#: Folders of code that is not the tracker's: of libraries, and of the standard library. A plain installation has other
#: packages below the latter.
_NUMPY = Path(np.__file__).resolve().parent
LIBRARIES = tuple(map(str, (_NUMPY, _NUMPY.with_name("scipy"), Path(trackbench.__file__).resolve().parent)))
STANDARD = tuple(str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib"))
INSTALLED = "site-packages"
#: Depth to which values are looked for below a local variable.
LOCAL_DEPTH = 4


class Assigned(NamedTuple):
    """A number or array that a line of the tracker assigns or returns."""

    file: str
    line: int
    name: str
    """Name of the variable, with the path from it to the value."""
    value: Array

    @property
    def where(self) -> str:
        """Name of the file and number of the line, such as ``filter.py:12``."""
        return f"{Path(self.file).name}:{self.line}"


def trace_step(step: Callable[[], Answer]) -> tuple[Answer, list[Assigned]]:
    """Call ``step``; return its result, and the values that the tracker's own lines assign meanwhile, in order.

    Values are those of local variables, those held below them, and returned ones. A line that calls a function also
    assigns what the call has changed.
    """
    assignments: list[Assigned] = []
    frames: dict[int, tuple[int, dict[tuple[Any, ...], bytes]]] = {}

    def snapshot(frame: FrameType) -> dict[tuple[Any, ...], tuple[bytes, Array]]:
        return {
            (name, *entry.path): (entry.value.tobytes(), entry.value)
            for name, value in frame.f_locals.items()
            for entry in held_values(value, LOCAL_DEPTH)
        }

    def trace_line(frame: FrameType, event: str, answer: Any) -> Any:
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
        return trace_line

    def trace_call(frame: FrameType, _event: str, _answer: Any) -> Any:
        return trace_line if _is_of_tracker(frame.f_code.co_filename) else None

    previous = sys.gettrace()
    sys.settrace(trace_call)
    try:
        return step(), assignments
    finally:
        sys.settrace(previous)


@cache
def _is_of_tracker(file: str) -> bool:
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
    """Return the assigned value nearest to a right value but not equal, and its error; None if no shape fits.

    The error is relative to the largest entry of the right value.

    Args:
        assigned: assignments of a step; right and earlier values among them do not count.
        right: right value ``(m, ...)`` of each of m models.
        earlier: value ``(m, ...)`` of each model before the step.
    """
    best: tuple[Assigned, float] | None = None
    excluded = [*right, *earlier]
    for entry in assigned:
        for value in _of_size(entry.value, right[0].size):
            errors = [float(np.abs(value - np.ravel(other)).max() / np.abs(other).max()) for other in excluded]
            if min(errors) > SAME and (best is None or min(errors[: len(right)]) < best[1]):
                best = entry, min(errors[: len(right)])
    return best


def with_value(assigned: Sequence[Assigned], *values: Array) -> Assigned | None:
    """Return the first assignment of the numbers of one of ``values``, in any order; None where there is none."""
    for entry in assigned:
        for value in values:
            if entry.value.size == value.size and (Pool([entry.value]).has(value)):
                return entry
    return None


def _of_size(value: Array, size: int) -> Iterator[Array]:
    """Yield the flattened value, or its slices along an axis, where they have ``size`` entries."""
    if value.size == size:
        yield np.ravel(value)
    for axis in range(value.ndim):
        if value.size == size * value.shape[axis]:
            yield from (np.ravel(part) for part in np.moveaxis(value, axis, 0))
