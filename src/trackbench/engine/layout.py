"""Inputs and outputs of a kernel, and the key under which a kernel is cached."""

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
    """Input of equations, with the shape and the type for which a kernel is made."""

    name: str
    shape: tuple[int, ...]
    """Shape ``(components...)`` of the input without its batch axes."""
    batch_axes: int
    """Number of batch axes after the components; 0 where all members share the input."""
    kind: str
    """NumPy's type character: "d" for doubles, "?" for a mask; equations with other types are not traced."""
    shared: bool = False
    """Whether the input has length 1 on the last batch axis although the batch has several members there."""

    @property
    def boolean(self) -> bool:
        return self.kind == "?"

    @property
    def level(self) -> int:
        """Members that share the input: ``ALL`` of the batch, a ``GROUP`` of them, or one ``MEMBER`` alone."""
        if self.batch_axes == 0:
            return ALL
        return GROUP if self.shared else MEMBER

    def full(self, batch: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape in which a kernel reads the input, for batch axes of lengths ``batch``."""
        if self.level == ALL:
            return self.shape
        return (*self.shape, *batch[:-1], 1) if self.shared else self.shape + batch


#: Modes of an output in a sequence of calls: the numbers of each member are added to the numbers in place, or the
#: numbers of all members are summed. An output without a mode is written.
ADDED, SUMMED = "added", "summed"


class Output(NamedTuple):
    """Output of a kernel, with its component shape."""

    name: str
    shape: tuple[int, ...]
    boolean: bool
    mode: str = ""
    """Rule for repeated calls: ``added`` adds each member's numbers to those of earlier calls, and ``summed`` also sums
    over members; empty if each call overwrites the output."""

    @property
    def size(self) -> int:
        """Number of components of the output."""
        return int(np.prod(self.shape, dtype=int))


class KernelLayout(NamedTuple):
    """Inputs that a kernel reads, in order, and its outputs; rows of numbers and rows of masks are apart."""

    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    same: Mapping[str, str] = {}
    """Name of an equal output, for each output that is not computed because another one equals it."""

    @property
    def first_rows(self) -> list[int]:
        """Index of each output's first row, among the rows of numbers, or for a mask among the rows of masks."""
        result: list[int] = []
        # The first row of masks is the guard.
        filled = [0, 1]
        for output in self.outputs:
            result.append(filled[output.boolean])
            filled[output.boolean] += output.size
        return result


PACKAGE = Path(__file__).parent.parent


def source_key(equations: Equations, inputs: Sequence[Input]) -> str | None:
    """Return a text that identifies the kernel of equations on disk; None for users' equations, which may change."""
    source = package_source()
    of_package = equations.function.__module__.startswith("trackbench.") and not equations.user_types
    if source is None or not of_package:
        return None
    key = _key_text(equations.key)
    return None if key is None else repr((source, equations.name, key, tuple(inputs)))


@cache
def package_source() -> str | None:
    """Return a checksum of the package's source; None where the process may have loaded another source.

    So it is None if sources are missing or unreadable, or a file was changed after the process began.
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
    """Return a key as text that means the same in another process; None if that is not possible."""
    if isinstance(value, tuple):
        parts = [_key_text(item) for item in value]
        return None if None in parts else f"({', '.join(map(str, parts))})"
    if isinstance(value, type):
        name = f"{value.__module__}.{value.__qualname__}"
        return name if name.startswith("trackbench.") else None
    if value is None or isinstance(value, str | float | int | bytes):
        return repr(value)
    type_text = _key_text(type(value))
    return None if type_text is None or "object at 0x" in repr(value) else repr(value)
