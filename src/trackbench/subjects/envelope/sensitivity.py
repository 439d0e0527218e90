"""How much each axis changes the value of a requirement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.base.distributions import t_quantile
from trackbench.base.types import Array
from trackbench.subjects.envelope.axes import MapAxis, Value
from trackbench.subjects.envelope.claim import ClaimCell, ClaimedLimit, Envelope
from trackbench.subjects.envelope.margins import distance_from, lines_near_base
from trackbench.subjects.envelope.surface import Surface

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
