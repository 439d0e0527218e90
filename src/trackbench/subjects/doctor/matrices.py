"""Small matrices that several checks need."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array


def largest_entry(matrix: Array) -> tuple[int, int]:
    """Return row and column of the largest entry, by value and not by magnitude."""
    row, column = np.unravel_index(int(np.argmax(matrix)), matrix.shape)
    return int(row), int(column)


def best_multiple(value: Array, matrix: Array) -> float:
    """Return the number c for which ``c * matrix`` is nearest to ``value`` in least squares."""
    return float(np.sum(value * matrix) / np.sum(matrix**2))


def cv_transition(step: float) -> Array:
    """Return the transition matrix ``(4, 4)`` of px, py, vx, vy with constant velocity over ``step`` s."""
    return np.eye(4) + step * np.eye(4, k=2)
