"""The numbers that an object holds, with the way to each."""

from __future__ import annotations

import types
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Scan

#: How far below an object its values are looked for, among how many of its parts, and how large an array is at most: a
#: filter is smaller.
DEPTH, MOST, LARGEST = 6, 20_000, 4096
#: Agreement of two values that are the same but for rounding, relative to the larger one.
SAME = 1e-9

Path = tuple[str | int, ...]
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

    path: Path
    value: Array
    """A copy."""
    place: HeldAt | None
    """None at the top, and in what cannot be changed."""


def held_values(root: Any, depth: int = DEPTH) -> Iterator[Held]:
    """Every number, array of numbers, and list or dictionary of numbers below an object, nearest first.

    Scans are left out.
    """
    seen: set[int] = set()
    waiting: deque[tuple[Path, Any, HeldAt | None]] = deque([((), root, None)])
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
