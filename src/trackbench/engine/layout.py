"""Where a kernel finds its inputs, and where it puts its outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

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
        """For what it is the same; see :class:`trackbench.engine.graph.Node`."""
        if self.batch_axes == 0:
            return ALL
        return GROUP if self.shared else MEMBER

    def full(self, batch: tuple[int, ...]) -> tuple[int, ...]:
        """Its shape as a kernel reads it."""
        if self.level == ALL:
            return self.shape
        return (*self.shape, *batch[:-1], 1) if self.shared else self.shape + batch


class Output(NamedTuple):
    """An output."""

    name: str
    shape: tuple[int, ...]
    boolean: bool

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
    def rows(self) -> list[int]:
        """For each component of each output its row, among those of numbers or those of masks."""
        found: list[int] = []
        # The first of the masks is the guard.
        filled = [0, 1]
        for output in self.outputs:
            first = filled[output.boolean]
            filled[output.boolean] += output.size
            found += range(first, filled[output.boolean])
        return found
