"""The border of a map: along lines through the scenario itself, and over two axes with the band in which it may lie."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.report.numbers import joined_names
from trackbench.subjects.envelope.axes import MapAxis, Point, Value
from trackbench.subjects.envelope.claim import Claim, ClaimCell, ClaimedLimit, State

if TYPE_CHECKING:
    from matplotlib.tri import Triangulation

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
    cells = tuple((float(cell.point[number]), cell) for cell in line)
    crossings = tuple(_crossings(claim.limits_of(tracker), tracker, axis, cells))
    return AxisMargin(tracker, axis, at, cells, crossings)


def lines_near_base(claim: Claim, number: int) -> list[list[ClaimCell]]:
    """The cells in the order of an axis, along the line that is nearest to the scenario's own values of the others.

    There is one for each combination of the categories. A line has cells at as many of the levels at which the axis
    started as any other: the few cells that were put near a border are no line of their own.
    """
    axes = claim.axes
    lines: dict[Point, list[ClaimCell]] = {}
    for cell in claim.cells:
        lines.setdefault((*cell.at[:number], *cell.at[number + 1 :]), []).append(cell)
    others = [*axes[:number], *axes[number + 1 :]]
    levels = set(axes[number].values)

    chosen = []
    for category in product(*(axis.values for axis in others if not axis.ordered)):
        alike = [at for at in lines if tuple(v for v in at if isinstance(v, str)) == category]
        if alike:
            started = {at: len(levels & {cell.point[number] for cell in lines[at]}) for at in alike}
            away = {at: distance_from_base(claim, [*zip(others, at, strict=True)]) for at in alike}
            nearest = min(alike, key=lambda at: (-started[at], away[at], -len(lines[at])))
            chosen.append(sorted(lines[nearest], key=lambda cell: axes[number].share(cell.point[number])))
    return chosen


def distance_from_base(claim: Claim, at: Sequence[tuple[MapAxis, Value]]) -> float:
    """Return how far the values of some axes are from the scenario's own, in shares of each range."""
    own = dict(zip([axis.name for axis in claim.axes], claim.base_point, strict=True))
    return math.hypot(*(axis.distance(value, own[axis.name]) for axis, value in at))


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
        return f"at {joined_names(met)} {axis.unit}".strip() if met else "at none of its values"
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


@dataclass(frozen=True)
class Slice:
    """The cells over two axes at the same values of the others."""

    across: MapAxis
    up: MapAxis
    at: tuple[tuple[MapAxis, Value], ...]
    """The others."""
    cells: tuple[ClaimCell, ...]
    places: Array
    """``(cells, 2)`` where each lies on the two axes, from 0 to 1."""

    def states(self, tracker: str) -> list[State]:
        """Of the cells."""
        return [cell.trackers[tracker].state for cell in self.cells]


def slices(claim: Claim, across: int, up: int) -> list[Slice]:
    """The map over two of its axes, one for each combination of the values that the others had at the start.

    Cells that were put between such values to refine the map are in none of them.
    """
    axes = claim.axes
    others = [i for i in range(len(axes)) if i not in (across, up)]
    grouped: dict[tuple[Value, ...], list[ClaimCell]] = {}
    for cell in claim.cells:
        if all(cell.point[i] in axes[i].values for i in others):
            grouped.setdefault(tuple(cell.point[i] for i in others), []).append(cell)
    ways = [axes[i] for i in others]
    parts = [
        Slice(
            axes[across],
            axes[up],
            tuple(zip(ways, at, strict=True)),
            tuple(cells),
            np.array([[axes[i].share(cell.point[i]) for i in (across, up)] for cell in cells]),
        )
        for at, cells in grouped.items()
    ]
    return sorted(parts, key=lambda part: [axis.share(value) for axis, value in part.at])


class Border(NamedTuple):
    """Where one tracker stops to meet its requirement, on a slice: where the interpolated excess is 0."""

    mesh: Triangulation
    """Triangles of neighbouring cells that have a value, or a state that is decided; from 0 to 1 on each axis."""
    beyond: Array
    """``(cells,)`` how far the worst value is beyond its limit; its sign is that of the decision."""
    areas: tuple[State, ...]
    """``(triangles,)`` the state of all three cells; undecided where they are not alike."""

    @property
    def is_line(self) -> bool:
        """Whether there is a line: an undecided cell whose value equals the limit makes none."""
        return bool(self.beyond.min() < -_NEXT_TO / 2 and self.beyond.max() > _NEXT_TO / 2)


def border_of(part: Slice, claim: Claim, tracker: str) -> Border | None:
    """Return the border of a tracker on a slice; None where all its cells lie on a line."""
    from matplotlib.tri import TriAnalyzer, Triangulation

    beyond = excess(part.cells, tracker, claim.limits_of(tracker))
    worst = np.where(np.isfinite(beyond).any(axis=1), np.nanmax(np.nan_to_num(beyond, nan=-np.inf), axis=1), np.nan)
    states = np.array(part.states(tracker))
    # Where it fails for another cause than a limit, the border is about half way.
    finite = np.abs(worst[np.isfinite(worst)])
    worst[(states == "fails") & ~(worst > 0)] = float(np.median(finite)) if finite.size else 1.0
    is_known = np.isfinite(worst)
    places, states = part.places[is_known], states[is_known]
    if len(places) < 3 or np.linalg.matrix_rank(places - places[0], tol=1e-9) < 2:
        return None
    x, y = places.T
    mesh = Triangulation(x, y)
    # Rounding leaves triangles without an area along straight edges.
    mesh = Triangulation(x, y, mesh.triangles[~TriAnalyzer(mesh).get_flat_tri_mask(1e-9)])
    corners = states[mesh.triangles]
    areas = np.where((corners == corners[:, :1]).all(axis=1), corners[:, 0], "undecided")
    return Border(mesh, worst[is_known], tuple(areas.tolist()))
