"""How far each axis may be moved, along a line through the scenario itself, before the requirement is no longer met."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise, product
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.report.numbers import joined
from trackbench.subjects.envelope.axes import MapAxis, Point, Value
from trackbench.subjects.envelope.claim import Claim, ClaimCell, ClaimedLimit, State

#: Of a value that is decided, but at its limit.
_NEXT_TO = 1e-12


class Crossing(NamedTuple):
    """Where a line crosses the border: between two cells that are decided, and differ."""

    low: float
    """The decided cell below the border; those between it and ``high`` are undecided."""
    high: float
    point: float
    """Where the interpolated value meets the limit."""
    holds_below: bool
    """Whether the requirement is met below the border."""


@dataclass(frozen=True)
class AxisMargin:
    """What the cells of one line say of one tracker."""

    tracker: str
    axis: MapAxis
    at: tuple[tuple[MapAxis, Value], ...]
    """The other axes with their values on the line."""
    through_base: bool
    """Whether the numbers among them are the scenario's own; the line is the nearest to it otherwise."""
    cells: tuple[tuple[float, ClaimCell], ...]
    """Those of the line by their value of the axis."""
    crossings: tuple[Crossing, ...]

    @property
    def states(self) -> dict[float, State]:
        """By value of the axis."""
        return {value: cell.trackers[self.tracker].state for value, cell in self.cells}

    @property
    def decided(self) -> dict[float, State]:
        """By value of the axis, those that are."""
        return {value: state for value, state in self.states.items() if state != "undecided"}


def margins(claim: Claim, tracker: str) -> list[AxisMargin]:
    """For each axis of numbers, the line through the scenario itself, or the nearest to it; one a category."""
    every = []
    for number, axis in enumerate(claim.axes):
        if axis.ordered:
            every += [margin_on(claim, tracker, number, line) for line in lines_near_base(claim, number)]
    return every


def margin_on(claim: Claim, tracker: str, number: int, line: Sequence[ClaimCell]) -> AxisMargin:
    """What a line says of a tracker.

    Args:
        claim: of the map.
        tracker: its name.
        number: of the axis along which the line goes.
        line: cells that differ in this axis alone.
    """
    axes = claim.axes
    axis, first = axes[number], line[0].point
    at = tuple((other, first[i]) for i, other in enumerate(axes) if i != number)
    own = all(claim.base[i] == first[i] for i, other in enumerate(axes) if i != number and other.ordered)
    cells = tuple((float(cell.point[number]), cell) for cell in line)
    return AxisMargin(tracker, axis, at, own, cells, tuple(_crossings(claim.limits_of(tracker), tracker, axis, cells)))


def lines_near_base(claim: Claim, number: int) -> list[list[ClaimCell]]:
    """The cells in the order of an axis, along the line that is nearest to the scenario's own values of the others.

    There is one for each combination of the categories. A line has cells at all levels at which the axis started; of a
    Sobol design, as many: the few cells that were put near a border are no line of their own.
    """
    axes = claim.axes
    lines: dict[Point, list[ClaimCell]] = {}
    for cell in claim.cells:
        lines.setdefault((*cell.at[:number], *cell.at[number + 1 :]), []).append(cell)
    others = [*axes[:number], *axes[number + 1 :]]
    levels, grid = set(axes[number].values), claim.config.design == "grid"

    def whole(at: Point) -> bool:
        values = {cell.point[number] for cell in lines[at]}
        return levels <= values if grid else len(values) >= len(levels)

    chosen = []
    for category in product(*(axis.values for axis in others if not axis.ordered)):
        alike = [at for at in lines if tuple(v for v in at if isinstance(v, str)) == category and whole(at)]
        if alike:
            nearest = min(
                alike,
                key=lambda at: (distance_from(claim.own_values, [*zip(others, at, strict=True)]), -len(lines[at])),
            )
            chosen.append(sorted(lines[nearest], key=lambda cell: axes[number].share(cell.point[number])))
    return chosen


def distance_from(own: Mapping[str, Value | None], at: Sequence[tuple[MapAxis, Value]]) -> float:
    """From the scenario's own values, by axis, to others; half way along an axis of numbers where it has none."""
    gaps = []
    for axis, value in at:
        base = own[axis.name]
        if not axis.ordered:
            gaps.append(float(base != value))
            continue
        low, high = axis.ends
        share = 0.5 if base is None else axis.share(min(max(float(base), low), high))
        gaps.append(axis.share(value) - share)
    return math.hypot(*gaps)


def _crossings(
    limits: Sequence[ClaimedLimit], tracker: str, axis: MapAxis, cells: Sequence[tuple[float, ClaimCell]]
) -> Iterator[Crossing]:
    values = [value for value, _ in cells]
    beyond = excess([cell for _, cell in cells], tracker, limits)
    states = [cell.trackers[tracker].state for _, cell in cells]
    decided = [place for place, state in enumerate(states) if state != "undecided"]
    for a, b in pairwise(decided):
        if states[a] != states[b]:
            shares = np.array([axis.share(value) for value in values[a : b + 1]])
            holds_below = states[a] == "holds"
            point = axis.at(_first_beyond(shares, beyond[a : b + 1], holds_below))
            yield Crossing(values[a], values[b], min(max(point, values[a]), values[b]), holds_below)


def _first_beyond(shares: Array, beyond: Array, holds_below: bool) -> float:
    """The share of the axis at which the requirement is first not met, coming from the end at which it is.

    Args:
        shares: ``(points,)`` of an axis, in order.
        beyond: ``(points, limits)`` of :func:`excess`.
        holds_below: whether it is met at the first of the points; at the last one otherwise.
    """
    if not holds_below:
        return 1.0 - _first_beyond(1.0 - shares[::-1], beyond[::-1], True)
    meets = []
    for values in beyond.T:
        there = np.isfinite(values)
        x, y = shares[there], values[there]
        if (y > 0).any():
            i = int(np.argmax(y > 0))
            meets.append(float(x[i - 1] + (x[i] - x[i - 1]) * y[i - 1] / (y[i - 1] - y[i])))
    # There is none where it fails for another cause than a limit.
    return min(meets, default=float(shares[0] + shares[-1]) / 2)


def excess(cells: Sequence[ClaimCell], tracker: str, limits: Sequence[ClaimedLimit]) -> Array:
    """``(cells, limits)`` how far each value is beyond its limit: above 0 where it is not met, NaN where there is none.

    Differences of logarithms where all values and the limit are positive. Where a value is decided, its sign is that
    of the decision.
    """
    columns = []
    for place, limit in enumerate(limits):
        own = [values[place] if values else None for values in (cell.trackers[tracker].values for cell in cells)]
        value = np.array([math.nan if item is None or item.value is None else item.value for item in own])
        positive = limit.limit > 0 and bool((value[np.isfinite(value)] > 0).all())
        beyond = np.log(value / limit.limit) if positive else value - limit.limit
        states = np.array(["" if item is None else item.state for item in own])
        beyond = beyond if limit.direction == "below" else -beyond
        beyond = np.where(states == "holds", np.minimum(beyond, -_NEXT_TO), beyond)
        columns.append(np.where(states == "fails", np.maximum(beyond, _NEXT_TO), beyond))
    return np.stack(columns, axis=-1)


#: A band is written as ± where its halves differ by no more than this share of it.
SYMMETRIC = 0.2


def holding(margin: AxisMargin) -> str:
    """For which values of the axis the requirement is met, with the band of each border."""
    axis = margin.axis
    if not margin.decided:
        return "at no value surely"
    if not axis.continuous:
        met = [_number(value) for value, state in margin.states.items() if state == "holds"]
        return f"at {joined(met)} {axis.unit}".strip() if met else "at none of its values"
    spans = [*_spans(margin)]
    if spans:
        return " and ".join(spans)
    states = margin.states
    held, total = [*states.values()].count("holds"), len(states)
    share = f"all {total}" if held == total else f"{held or 'none'} of its {total}"
    return f"in {share} cells from {_number(min(states))} to {axis.shown(max(states))}"


def _spans(margin: AxisMargin) -> Iterator[str]:
    """In which it is met, between the borders on both sides of each."""
    axis, crossings = margin.axis, margin.crossings
    for start, stop in zip([None, *crossings], [*crossings, None], strict=True):
        if start is None and stop is not None and stop.holds_below:
            yield f"up to {border(axis, stop)}"
        elif start is not None and not start.holds_below:
            yield f"from {border(axis, start)}" + (" on" if stop is None else f" to {border(axis, stop)}")


def border(axis: MapAxis, crossing: Crossing) -> str:
    """Such as "2.1 ± 0.1 deg", or "2.1 deg (2.0 to 2.4)" where the border is not half way between the cells."""
    low, high, point = crossing.low, crossing.high, crossing.point
    # One digit of the band, two where the first would be a 1.
    step = 10.0 ** math.floor(math.log10((high - low) / 2) - 0.3)
    if abs((high - point) - (point - low)) <= SYMMETRIC * (high - low):
        centre = _rounded(point, step)
        half = step * math.ceil(max(high - float(centre), float(centre) - low) / step - 1e-6)
        return f"{centre} ± {_rounded(half, step)} {axis.unit}".strip()
    return f"{_rounded(point, step)} {axis.unit}".strip() + f" ({_number(low)} to {_number(high)})"


def undecided(margin: AxisMargin) -> str:
    """Where no cell outside the bands is decided; empty where there is none."""
    spans = []
    outside = {
        value: state == "undecided" and not any(item.low < value < item.high for item in margin.crossings)
        for value, state in margin.states.items()
    }
    for is_open, group in groupby(outside, key=lambda value: outside[value]):
        values = list(group)
        if is_open:
            start = f"{_number(values[0])} to " if len(values) > 1 else ""
            spans.append(f"{start}{margin.axis.shown(values[-1])}")
    return f"undecided at {', '.join(spans)}" if spans else ""


def place_of_line(margin: AxisMargin) -> str:
    """The values of the other axes; empty where there is none."""
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in margin.at)


def _number(value: float) -> str:
    return f"{value:.4g}"


def _rounded(value: float, step: float) -> str:
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}"
