"""Inputs and outputs of a kernel, and the key under which a kernel is kept."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trackbench import STARTED
from trackbench.engine.equations import Equations
from trackbench.engine.graph import ALL, GROUP, MEMBER


class Input(NamedTuple):
    """An input of equations, as a kernel is made for it."""

    name: str
    shape: tuple[int, ...]
    """Of its components."""
    batch_axes: int
    """How many batch axes follow; 0: it is the same for all members."""
    kind: str
    """Its type, as NumPy has it for short: d, doubles, or ?, a mask; others are not traced."""
    shared: bool = False
    """Whether the last batch axis is of length one, where that of the batch is not."""

    @property
    def boolean(self) -> bool:
        """Whether it is a mask."""
        return self.kind == "?"

    @property
    def level(self) -> int:
        """Whether all members share it, a group does, or none; see :class:`trackbench.engine.graph.Node`."""
        if self.batch_axes == 0:
            return ALL
        return GROUP if self.shared else MEMBER

    def full(self, batch: tuple[int, ...]) -> tuple[int, ...]:
        """Its shape as a kernel reads it."""
        if self.level == ALL:
            return self.shape
        return (*self.shape, *batch[:-1], 1) if self.shared else self.shape + batch


#: What becomes of an output in a sequence of calls: the numbers of each member are added to what is there, or those of
#: all members are summed. Otherwise they are written.
ADDED, SUMMED = "added", "summed"


class Output(NamedTuple):
    """An output."""

    name: str
    shape: tuple[int, ...]
    boolean: bool
    mode: str = ""
    """``ADDED``, ``SUMMED`` or neither."""

    @property
    def size(self) -> int:
        """Number of components."""
        return int(np.prod(self.shape, dtype=int))


class KernelLayout(NamedTuple):
    """The inputs that a kernel reads, in the order of its table; and its outputs, numbers and masks apart."""

    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    same: Mapping[str, str] = {}
    """Outputs that are the same as another, under its name."""

    @property
    def first_rows(self) -> list[int]:
        """For each output its first row, among those of numbers or those of masks."""
        result: list[int] = []
        # The first of the masks is the guard.
        filled = [0, 1]
        for output in self.outputs:
            result.append(filled[output.boolean])
            filled[output.boolean] += output.size
        return result


PACKAGE = Path(__file__).parent.parent


def source_key(equations: Equations, inputs: Sequence[Input]) -> str | None:
    """What equations of the package compute of certain inputs, as text; None of others, whose source may change."""
    source = package_source()
    of_package = equations.function.__module__.startswith("trackbench.") and not equations.user_types
    if source is None or not of_package:
        return None
    key = _key_text(equations.key)
    return None if key is None else repr((source, equations.name, key, tuple(inputs)))


@cache
def package_source() -> str | None:
    """A checksum of the package.

    None where there are no sources, they cannot be read, or a file was changed after the process began, which may have
    read it.
    """
    files = sorted(PACKAGE.rglob("*.py"))
    total = hashlib.sha256()
    try:
        if not files or max(file.stat().st_mtime for file in files) >= STARTED:
            return None
        for file in files:
            total.update(file.read_bytes())
    except OSError:
        return None
    return total.hexdigest()


def _key_text(value: Hashable) -> str | None:
    """A key as text that means the same in another process."""
    if isinstance(value, tuple):
        parts = [_key_text(item) for item in value]
        return None if None in parts else f"({', '.join(map(str, parts))})"
    if isinstance(value, type):
        name = f"{value.__module__}.{value.__qualname__}"
        return name if name.startswith("trackbench.") else None
    if value is None or isinstance(value, str | float | int | bytes):
        return repr(value)
    own = _key_text(type(value))
    return None if own is None or "object at 0x" in repr(value) else repr(value)
