"""Matrices that the lines of a tracker write, compared with the right ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.doctor.findings import PROVEN, Finding
from trackbench.subjects.doctor.inside.values import Assigned
from trackbench.subjects.doctor.matrices import largest_entry

#: Least difference of an entry that is counted, relative to the sum of both values.
OFF = 0.1
#: Difference of two matrices that is only rounding, relative to the largest entry.
SAME = 1e-4


def wrong_entry(assigned: Sequence[Assigned], wrong: Assigned, right: Array, sensor: str | None, by: str) -> Finding:
    """Report the entry of a Jacobian with the largest error and its line; ``by``: words for the source of ``right``."""
    error = np.abs(wrong.value - right) / (np.abs(wrong.value) + np.abs(right) + 1e-6 * np.abs(right).max())
    i, j = largest_entry(error)
    same_name = [entry for entry in assigned if (entry.file, entry.name) == (wrong.file, wrong.name)]
    values = [entry for entry in same_name if entry.value.shape == right.shape]
    made = next(entry for entry in values if entry.value[i, j] == wrong.value[i, j])
    # An entry that still has its first value was missed by the last line.
    where = wrong.where if made is values[0] else made.where
    marked = [(int(row), int(column)) for row, column in np.argwhere(error > OFF)]
    count = f" ({len(marked)} of its entries differ)" if len(marked) > 1 else ""
    text = f"{where}: {wrong.name}[{i}, {j}] is {wrong.value[i, j]:.4g}, and {by} give {right[i, j]:.4g}{count}"
    return Finding("jacobian_wrong", PROVEN, text, sensor=sensor)


def last_values(assigned: Sequence[Assigned], shape: tuple[int, ...]) -> list[Assigned]:
    """Return, for each variable, the last assignment of a value with the given shape."""
    return list({(entry.file, entry.name): entry for entry in assigned if entry.value.shape == shape}.values())


def same_matrix(value: Array, other: Array) -> bool:
    """Return whether two matrices are equal but for rounding."""
    return bool(np.abs(value - other).max() < SAME * np.abs(other).max())
