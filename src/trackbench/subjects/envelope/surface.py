"""A value between the cells of a map: an interpolation that knows its own error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from trackbench.base.scipy_functions import scipy_function
from trackbench.base.types import Array
from trackbench.subjects.envelope.axes import MapAxis, Point

#: More cells than these are not interpolated: those of the start come first.
MOST_CELLS = 2000
#: Points of the Sobol sequence by which the variance is shared out; a power of two.
_SAMPLES = 1024


class Surface:
    """Cubic radial functions with a linear part through ``values`` ``(cells,)`` at some points.

    Source: Buhmann (2003), "Radial Basis Functions"; its error at each cell if that is left out: Rippa (1999).

    Raises:
        numpy.linalg.LinAlgError: the points lie in a plane.
    """

    def __init__(self, axes: Sequence[MapAxis], points: Sequence[Point], values: Array) -> None:
        self.axes = axes
        self.values = values[:MOST_CELLS]
        self._places = _places(axes, points[:MOST_CELLS])
        linear = self._linear(self._places)
        zero = np.zeros((linear.shape[1], linear.shape[1]))
        self._inverse = np.linalg.inv(np.block([[self._radial(self._places), linear], [linear.T, zero]]))
        self._weights = self._inverse @ np.concatenate([self.values, np.zeros(len(zero))])

    def __call__(self, places: Array) -> Array:
        """``(n,)`` values at ``(n, coordinates)`` places."""
        value: Array = np.hstack([self._radial(places), self._linear(places)]) @ self._weights
        return value

    @cached_property
    def error(self) -> float:
        """Root mean square error at a cell that is left out, as a share of the spread of the values."""
        spread, alone = float(np.std(self.values)), np.diagonal(self._inverse)[: len(self.values)]
        if not spread or np.abs(alone).min() <= 1e-9 * np.abs(alone).max():
            # Without one of the cells the others lie in a plane.
            return math.inf
        return float(np.sqrt(np.mean((self._weights[: len(alone)] / alone) ** 2))) / spread

    def sobol_indices(self) -> tuple[Array, Array]:
        """``(axes,)`` each: the share of the variance that an axis explains alone, and with all its interactions.

        Continuous axes are uniform on their scale; levels and choices are equally likely.

        Source: Saltelli et al. (2010), by ``scipy.stats.sobol_indices``.
        """
        find = scipy_function("scipy.stats", "_sensitivity_analysis", "sobol_indices")
        uniform = scipy_function("scipy.stats", "_continuous_distns", "uniform")
        indices = find(func=self._at_shares, n=_SAMPLES, dists=[uniform] * len(self.axes), rng=0)
        return np.clip(indices.first_order, 0.0, 1.0), np.clip(indices.total_order, 0.0, 1.0)

    def _at_shares(self, shares: Array) -> Array:
        """``(n,)`` values at ``(axes, n)`` numbers from 0 to 1."""
        columns = []
        for axis, share in zip(self.axes, shares, strict=True):
            if axis.continuous:
                columns.append(share[:, None])
            else:
                number = np.minimum((share * len(axis.values)).astype(int), len(axis.values) - 1)
                columns.append(_coordinates(axis)[number])
        return self(np.hstack(columns))

    def _radial(self, places: Array) -> Array:
        square = (places**2).sum(axis=1)[:, None] + (self._places**2).sum(axis=1) - 2 * places @ self._places.T
        radial: Array = np.maximum(square, 0.0) ** 1.5
        return radial

    @staticmethod
    def _linear(places: Array) -> Array:
        return np.hstack([np.ones((len(places), 1)), places])


def _places(axes: Sequence[MapAxis], points: Sequence[Point]) -> Array:
    """``(points, coordinates)``"""
    columns = []
    for number, axis in enumerate(axes):
        values = [point[number] for point in points]
        if axis.continuous:
            columns.append(np.array([[axis.share(value)] for value in values]))
        else:
            columns.append(_coordinates(axis)[[axis.values.index(value) for value in values]])
    return np.hstack(columns)


def _coordinates(axis: MapAxis) -> Array:
    """``(values, coordinates)`` of levels along a line; of choices equally far from each other."""
    if axis.ordered:
        return np.array([[axis.share(value)] for value in axis.values])
    # The corners of a regular simplex, in one dimension less than there are choices.
    count = len(axis.values)
    centred = np.eye(count) - 1.0 / count
    return np.linalg.svd(centred)[0][:, : count - 1] * math.sqrt(0.5)
