"""Matrices that the lines of a tracker write, held against the right ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import PROVEN, Finding
from trackbench.subjects.doctor.inside.values import Assigned
from trackbench.subjects.doctor.matrices import largest_entry

#: Difference of an entry, over the sum of both values, from which on it is marked.
OFF = 0.1
#: Difference of two matrices that is rounding, relative to the largest entry.
SAME = 1e-4


def wrong_entry(assigned: Sequence[Assigned], at: Assigned, right: Array, sensor: str | None, by: str) -> Finding:
    """Report the entry of a Jacobian that is off most, and the line that has made it."""
    off = np.abs(at.value - right) / (np.abs(at.value) + np.abs(right) + 1e-6 * np.abs(right).max())
    i, j = largest_entry(off)
    of_name = [entry for entry in assigned if (entry.file, entry.name) == (at.file, at.name)]
    values = [entry for entry in of_name if entry.value.shape == right.shape]
    made = next(entry for entry in values if entry.value[i, j] == at.value[i, j])
    # What no line has set was missed by the last one.
    where = at.where if made is values[0] else made.where
    marked = [(int(row), int(column)) for row, column in np.argwhere(off > OFF)]
    others = f" ({len(marked)} of its entries differ)" if len(marked) > 1 else ""
    text = f"{where}: {at.name}[{i}, {j}] is {at.value[i, j]:.4g}, and {by} give {right[i, j]:.4g}{others}"
    return Finding("jacobian_wrong", PROVEN, text, sensor=sensor)


def last_values(assigned: Sequence[Assigned], shape: tuple[int, ...]) -> list[Assigned]:
    """Return the last value of each variable that has matrices of a shape."""
    return list({(entry.file, entry.name): entry for entry in assigned if entry.value.shape == shape}.values())


def same_matrix(value: Array, other: Array) -> bool:
    """Return whether two matrices are equal but for rounding."""
    return bool(np.abs(value - other).max() < SAME * np.abs(other).max())
