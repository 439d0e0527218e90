"""The border of a map: where it crosses lines through the scenario, and its course and band over two axes."""

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

#: Smallest excess of a decided value, which gives it the sign of its decision.
_NEXT_TO = 1e-12


class Crossing(NamedTuple):
    """Crossing of a line of cells with the border, between a cell that holds and a cell that fails."""

    low: float
    """Axis value of the decided cell below the border; cells between ``low`` and ``high`` are undecided."""
    high: float
    point: float
    """Axis value at which the interpolated metric meets the limit."""
    holds_below: bool
    """Whether the requirement is met at axis values below the border, and not above it."""


@dataclass(frozen=True)
class AxisMargin:
    """States of a tracker along one line of cells, and where the line crosses the border."""

    tracker: str
    axis: MapAxis
    at: tuple[tuple[MapAxis, Value], ...]
    """The other axes, with their fixed values on the line."""
    cells: tuple[tuple[float, ClaimCell], ...]
    """Pairs of an axis value and the cell there, in order along the line."""
    crossings: tuple[Crossing, ...]

    @property
    def states(self) -> dict[float, State]:
        """State of each cell, by value of the axis."""
        return {value: cell.trackers[self.tracker].state for value, cell in self.cells}

    @property
    def decided(self) -> dict[float, State]:
        """States of the decided cells, by value of the axis."""
        return {value: state for value, state in self.states.items() if state != "undecided"}


def margins(claim: Claim, tracker: str) -> list[AxisMargin]:
    """Return where a tracker's requirements hold along each numeric axis, on the line of cells nearest to the scenario.

    Axes of choices give one line for each combination of choices.
    """
    result = []
    for number, axis in enumerate(claim.axes):
        if axis.ordered:
            result += [margin_on(claim, tracker, number, line) for line in lines_near_base(claim, number)]
    return result


def margin_on(claim: Claim, tracker: str, number: int, line: Sequence[ClaimCell]) -> AxisMargin:
    """Return in which cells of a line a tracker's requirements hold, and where the line crosses the border.

    ``number`` is the index of the axis. The cells of ``line`` differ in this axis alone, and are sorted along it.
    """
    axes = claim.axes
    axis, first = axes[number], line[0].point
    at = tuple((other, first[i]) for i, other in enumerate(axes) if i != number)
    cells = tuple((float(cell.point[number]), cell) for cell in line)
    crossings = tuple(_crossings(claim.limits_of(tracker), tracker, axis, cells))
    return AxisMargin(tracker, axis, at, cells, crossings)


def lines_near_base(claim: Claim, number: int) -> list[list[ClaimCell]]:
    """Return for each combination of choices one line of cells along the axis with the index ``number``, sorted.

    It is the line with the most starting levels of the axis, since the few cells added near a border make no useful
    line. Of several such lines it is the nearest to the scenario's own values of the other axes.
    """
    axes = claim.axes
    lines: dict[Point, list[ClaimCell]] = {}
    for cell in claim.cells:
        lines.setdefault((*cell.at[:number], *cell.at[number + 1 :]), []).append(cell)
    others = [*axes[:number], *axes[number + 1 :]]
    levels = set(axes[number].values)

    chosen = []
    for category in product(*(axis.values for axis in others if not axis.ordered)):
        candidates = [at for at in lines if tuple(v for v in at if isinstance(v, str)) == category]
        if candidates:
            started = {at: len(levels & {cell.point[number] for cell in lines[at]}) for at in candidates}
            distance = {at: distance_from_base(claim, [*zip(others, at, strict=True)]) for at in candidates}
            nearest = min(candidates, key=lambda at: (-started[at], distance[at], -len(lines[at])))
            chosen.append(sorted(lines[nearest], key=lambda cell: axes[number].share(cell.point[number])))
    return chosen


def distance_from_base(claim: Claim, at: Sequence[tuple[MapAxis, Value]]) -> float:
    """Return the distance of some axes' values from the scenario's own, with each axis scaled to the range 0 to 1."""
    items = dict(zip([axis.name for axis in claim.axes], claim.base_point, strict=True))
    return math.hypot(*(axis.distance(value, items[axis.name]) for axis, value in at))


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
    """Return the share of the axis at which the requirement ceases to be met, from the end at which it is met.

    Args:
        shares: positions of the points along the axis, ``(points,)``, ascending.
        beyond: result of :func:`excess`, ``(points, limits)``.
        holds_below: whether the requirement is met at the first point; otherwise it is met at the last.
    """
    if not holds_below:
        return 1.0 - _first_beyond(1.0 - shares[::-1], beyond[::-1], True)
    borders = []
    for values in beyond.T:
        is_finite = np.isfinite(values)
        x, y = shares[is_finite], values[is_finite]
        if (y > 0).any():
            i = int(np.argmax(y > 0))
            borders.append(float(x[i - 1] + (x[i] - x[i - 1]) * y[i - 1] / (y[i - 1] - y[i])))
    # A failure for another cause than a limit has no interpolated border.
    return min(borders, default=float(shares[0] + shares[-1]) / 2)


def excess(cells: Sequence[ClaimCell], tracker: str, limits: Sequence[ClaimedLimit]) -> Array:
    """Return by how much each value violates its limit, ``(cells, limits)``; negative where met, NaN without a value.

    Differences are of logarithms if all values and the limit are positive. A decided value has its decision's sign.
    """
    columns = []
    for place, limit in enumerate(limits):
        items = [values[place] if values else None for values in (cell.trackers[tracker].values for cell in cells)]
        value = np.array([math.nan if item is None or item.value is None else item.value for item in items])
        positive = limit.limit > 0 and bool((value[np.isfinite(value)] > 0).all())
        beyond = np.log(value / limit.limit) if positive else value - limit.limit
        states = np.array(["" if item is None else item.state for item in items])
        beyond = beyond if limit.direction == "below" else -beyond
        beyond = np.where(states == "holds", np.minimum(beyond, -_NEXT_TO), beyond)
        columns.append(np.where(states == "fails", np.maximum(beyond, _NEXT_TO), beyond))
    return np.stack(columns, axis=-1)


#: Largest difference of a band's halves, as a share of the band, at which it is written with ±.
SYMMETRIC = 0.2


def holding(margin: AxisMargin) -> str:
    """Return the values of the axis at which the requirement is met, as text with the band of each border."""
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
    axis, crossings = margin.axis, margin.crossings
    for start, stop in zip([None, *crossings], [*crossings, None], strict=True):
        if start is None and stop is not None and stop.holds_below:
            yield f"up to {border(axis, stop)}"
        elif start is not None and not start.holds_below:
            yield f"from {border(axis, start)}" + (" on" if stop is None else f" to {border(axis, stop)}")


def border(axis: MapAxis, crossing: Crossing) -> str:
    """Return a border as text: "2.1 ± 0.1 deg", or "2.1 deg (2.0 to 2.4)" if not half way between cells.

    The ends of the band are rounded outwards, each by less than a tenth of its width.
    """
    low, high, point = crossing.low, crossing.high, crossing.point
    # The band has one digit, or two where the first would be a 1.
    step = 10.0 ** math.floor(math.log10((high - low) / 2) - 0.3)
    if abs((high - point) - (point - low)) <= SYMMETRIC * (high - low):
        centre = _rounded(point, step)
        half = step * math.ceil(max(high - float(centre), float(centre) - low) / step - 1e-6)
        return f"{centre} ± {_rounded(half, step)} {axis.unit}".strip()
    span = min(high - low, 10 * low) if low > 0 else high - low
    step = 10.0 ** math.floor(math.log10(span) - 1)
    ends = step * math.floor(low / step + 1e-6), step * math.ceil(high / step - 1e-6)
    band = " to ".join(_rounded(end, step) for end in ends)
    return f"{_rounded(point, step)} {axis.unit}".strip() + f" ({band})"


def undecided(margin: AxisMargin) -> str:
    """Return as text the axis values of undecided cells outside the bands of the borders; empty without any."""
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
    return f"not shown at {', '.join(spans)}" if spans else ""


def place_of_line(margin: AxisMargin) -> str:
    """Return as text the values of the axes along which a line does not run; empty where there are no such axes."""
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in margin.at)


def _number(value: float) -> str:
    return f"{value:.4g}"


def _rounded(value: float, step: float) -> str:
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}"


@dataclass(frozen=True)
class Slice:
    """Cells of a map over two of its axes, at fixed values of all other axes."""

    across: MapAxis
    up: MapAxis
    at: tuple[tuple[MapAxis, Value], ...]
    """The axes that the slice does not vary, with their fixed values."""
    cells: tuple[ClaimCell, ...]
    places: Array
    """Position of each cell on the two axes, ``(cells, 2)``, 0 to 1."""

    def states(self, tracker: str) -> list[State]:
        return [cell.trackers[tracker].state for cell in self.cells]


def slices(claim: Claim, across: int, up: int) -> list[Slice]:
    """Return the slices of a map over two axes, one for each combination of the other axes' starting values.

    ``across`` and ``up`` are indices of axes. Cells that were added between starting values of the other axes are in no
    slice.
    """
    axes = claim.axes
    others = [i for i in range(len(axes)) if i not in (across, up)]
    grouped: dict[tuple[Value, ...], list[ClaimCell]] = {}
    for cell in claim.cells:
        if all(cell.point[i] in axes[i].values for i in others):
            grouped.setdefault(tuple(cell.point[i] for i in others), []).append(cell)
    other_axes = [axes[i] for i in others]
    parts = [
        Slice(
            axes[across],
            axes[up],
            tuple(zip(other_axes, at, strict=True)),
            tuple(cells),
            np.array([[axes[i].share(cell.point[i]) for i in (across, up)] for cell in cells]),
        )
        for at, cells in grouped.items()
    ]
    return sorted(parts, key=lambda part: [axis.share(value) for axis, value in part.at])


class Border(NamedTuple):
    """Border of a tracker's requirement on a slice: the line on which the interpolated excess is 0."""

    mesh: Triangulation
    """Triangles between neighbouring cells that have a value or a decision; coordinates are 0 to 1 on each axis."""
    beyond: Array
    """Largest excess of each cell over the limits, ``(cells,)``, with the sign of the cell's decision."""
    areas: tuple[State, ...]
    """State of each triangle ``(triangles,)``: the state of its three cells, or undecided where they differ."""

    @property
    def is_line(self) -> bool:
        """Whether the excess clearly changes its sign; an undecided cell whose value equals the limit makes no line."""
        return bool(self.beyond.min() < -_NEXT_TO / 2 and self.beyond.max() > _NEXT_TO / 2)


def border_of(part: Slice, claim: Claim, tracker: str) -> Border | None:
    """Return where, on a slice of the map, a tracker's requirements cease to hold; None where cells span no area."""
    from matplotlib.tri import TriAnalyzer, Triangulation

    beyond = excess(part.cells, tracker, claim.limits_of(tracker))
    worst = np.where(np.isfinite(beyond).any(axis=1), np.nanmax(np.nan_to_num(beyond, nan=-np.inf), axis=1), np.nan)
    states = np.array(part.states(tracker))
    # A failure for another cause than a limit gets a typical excess: the border is then about half way.
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
