"""How much each axis changes the value of a requirement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackbench.base.distributions import t_quantile
from trackbench.base.scipy_functions import scipy_function
from trackbench.base.types import Array
from trackbench.subjects.envelope.axes import MapAxis, Point, Value
from trackbench.subjects.envelope.claim import ClaimCell, ClaimedLimit, Envelope
from trackbench.subjects.envelope.margins import distance_from, lines_near_base

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


#: An interpolation whose error at a cell that is left out is larger, as a share of the spread, explains nothing.
LARGEST_ERROR = 0.25


class Swing(NamedTuple):
    """The change of a value along an axis, all else as in the scenario or near it."""

    start: Value
    stop: Value
    """The ends of the axis; of choices those with the least and the largest value."""
    low: float
    high: float
    """The values there."""
    reach: float | None
    """Half of the 95 % interval of their difference; None of one run, and of choices, picked by their values."""

    @property
    def change(self) -> float:
        """From start to stop."""
        return self.high - self.low


@dataclass(frozen=True)
class Sensitivity:
    """Of one requirement to all axes."""

    limit: ClaimedLimit
    swings: tuple[tuple[MapAxis, Swing | None], ...]
    """By axis; None where no line of cells runs along it."""
    error: float | None
    """Of the interpolation between the cells; None where there is none."""
    first: tuple[float, ...] = ()
    """By axis, the share of the variance over the whole map that it explains alone; none where the error is large."""
    total: tuple[float, ...] = ()
    """With its interactions."""


def sensitivities(made: Envelope) -> list[Sensitivity]:
    """Of each requirement."""
    return [_sensitivity(made, place) for place in range(len(made.claim.limits))]


def _sensitivity(made: Envelope, place: int) -> Sensitivity:
    claim = made.claim
    limit = claim.limits[place]
    swings = tuple((axis, _swing(made, number, place)) for number, axis in enumerate(claim.axes))
    rows = [(cell.at, value) for cell in claim.cells if (value := _value(made, cell, place)) is not None]
    if len(claim.axes) < 2 or len(rows) < 0.9 * len(claim.cells):
        return Sensitivity(limit, swings, None)
    try:
        surface = Surface(claim.axes, [at for at, _ in rows], np.array([value for _, value in rows]))
    except np.linalg.LinAlgError:
        return Sensitivity(limit, swings, None)
    if not surface.error <= LARGEST_ERROR:
        return Sensitivity(limit, swings, surface.error)
    first, total = surface.sobol_indices()
    return Sensitivity(limit, swings, surface.error, tuple(first.tolist()), tuple(total.tolist()))


def _swing(made: Envelope, number: int, place: int) -> Swing | None:
    claim, axis = made.claim, made.claim.axes[number]
    others = [other for i, other in enumerate(claim.axes) if i != number]

    def apart(line: list[ClaimCell]) -> float:
        values = [value for i, value in enumerate(line[0].at) if i != number]
        return distance_from(claim.own_values, list(zip(others, values, strict=True)))

    lines = lines_near_base(claim, number)
    if not lines:
        return None
    valued = [(cell, value) for cell in min(lines, key=apart) if (value := _value(made, cell, place)) is not None]
    if len(valued) < 2:
        return None
    if not axis.ordered:
        valued.sort(key=lambda item: item[1])
    (start, low), (stop, high) = valued[0], valued[-1]
    numbers = {cell.at: number for number, cell in enumerate(claim.cells)}
    parts = [made.values(numbers[cell.at], place) for cell in (start, stop)]
    reach = _reach(*parts) if axis.ordered and min(map(len, parts)) > 1 else None
    return Swing(start.at[number], stop.at[number], low, high, reach)


def _reach(low: Array, high: Array) -> float:
    """Half of the 95 % interval of the difference of two means: paired of the same runs, else of independent ones."""
    if len(low) == len(high):
        variance = np.var(high - low, ddof=1) / len(low)
    else:
        variance = np.var(low, ddof=1) / len(low) + np.var(high, ddof=1) / len(high)
    return t_quantile(0.975, min(len(low), len(high)) - 1) * float(np.sqrt(variance))


def _value(made: Envelope, cell: ClaimCell, place: int) -> float | None:
    limit = made.claim.limits[place]
    values = cell.trackers[limit.tracker].values
    return values[made.claim.limits_of(limit.tracker).index(limit)].value if values else None
