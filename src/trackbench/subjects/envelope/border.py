"""The border of a map over two axes: where the interpolated value meets the limit, and the band in which it may lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackbench.base.scipy_functions import scipy_function
from trackbench.base.types import Array, Indices
from trackbench.subjects.envelope.axes import MapAxis, Value
from trackbench.subjects.envelope.claim import Claim, ClaimCell, State
from trackbench.subjects.envelope.margins import excess

#: Parts of an axis for which a Sobol design is drawn apart.
_PARTS = 3


@dataclass(frozen=True)
class Slice:
    """The cells over two axes at about the same values of the others."""

    across: MapAxis
    up: MapAxis
    at: tuple[tuple[MapAxis, Value], ...]
    """The others; of a Sobol design the middle of the part of the axis in which the cells are."""
    exact: bool
    """Whether all cells have those values."""
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
    levels = {i: _levels(axes[i], claim.config.design) for i in others}
    grouped: dict[tuple[Value, ...], list[ClaimCell]] = {}
    for cell in claim.cells:
        at = tuple(_level(axes[i], levels[i], cell.point[i], claim.config.design) for i in others)
        if None not in at:
            grouped.setdefault(at, []).append(cell)  # type: ignore[arg-type]
    exact = claim.config.design == "grid" or not any(axes[i].continuous for i in others)
    ways = [axes[i] for i in others]
    parts = [
        Slice(
            axes[across],
            axes[up],
            tuple(zip(ways, at, strict=True)),
            exact,
            tuple(cells),
            np.array([[axes[i].share(cell.point[i]) for i in (across, up)] for cell in cells]),
        )
        for at, cells in grouped.items()
    ]
    return sorted(parts, key=lambda part: [axis.share(value) for axis, value in part.at])


def _levels(axis: MapAxis, design: str) -> list[Value]:
    if design == "grid" or not axis.continuous:
        return list(axis.values)
    return [axis.at((part + 0.5) / _PARTS) for part in range(_PARTS)]


def _level(axis: MapAxis, levels: Sequence[Value], value: Value, design: str) -> Value | None:
    if design == "grid" or not axis.continuous:
        return value if value in levels else None
    return levels[min(int(axis.share(value) * _PARTS), _PARTS - 1)]


@dataclass(frozen=True)
class Border:
    """Where one tracker stops to meet its requirement, on a slice, by its values between neighbouring cells."""

    places: Array
    """``(cells, 2)`` of the cells with a value, or a state that is decided; from 0 to 1 on each axis."""
    states: tuple[State, ...]
    beyond: Array
    """``(cells,)`` how far the worst value is beyond its limit; its sign is that of the decision."""

    @cached_property
    def triangles(self) -> Indices:
        """``(triangles, 3)`` neighbouring cells; none where all cells lie on a line."""
        if len(self.places) < 3 or np.linalg.matrix_rank(self.places - self.places[0], tol=1e-9) < 2:
            return np.zeros((0, 3), dtype=np.intp)
        corners: Indices = scipy_function("scipy.spatial", "_qhull", "Delaunay")(self.places).simplices
        corner = self.places[corners]
        (ax, ay), (bx, by) = (corner[:, 1] - corner[:, 0]).T, (corner[:, 2] - corner[:, 0]).T
        # Rounding leaves triangles without an area along straight edges.
        whole: Indices = corners[np.abs(ax * by - ay * bx) > 1e-12]
        return whole

    @cached_property
    def segments(self) -> Array:
        """``(segments, 2, 2)`` the pieces of the border: their ends, and the place of each."""
        meets = (self.beyond < 0)[self.triangles]
        alone = np.flatnonzero((meets != meets[:, :1]).any(axis=1))
        pieces = []
        for row, met in zip(self.triangles[alone], meets[alone], strict=True):
            # The corner on its own side of the border, and the two on the other.
            tip = int(np.flatnonzero(met == (met.sum() == 1))[0])
            pieces.append([self._between(row[tip], row[(tip + step) % 3]) for step in (1, 2)])
        return np.array(pieces).reshape(-1, 2, 2)

    def area(self, state: State) -> Array:
        """``(triangles, 3, 2)`` the corners of those whose cells all hold or all fail; the border is in the others."""
        states = np.array(self.states)[self.triangles]
        same = (states == states[:, :1]).all(axis=1)
        own = np.where(same, states[:, 0], "undecided") if len(states) else np.zeros(0, dtype=str)
        corners: Array = self.places[self.triangles[own == state]]
        return corners

    def _between(self, a: int, b: int) -> Array:
        """Where the border crosses the edge between two cells."""
        share = self.beyond[a] / (self.beyond[a] - self.beyond[b])
        place: Array = self.places[a] + share * (self.places[b] - self.places[a])
        return place


def border_of(part: Slice, claim: Claim, tracker: str) -> Border:
    """The border of a tracker on a slice."""
    beyond = excess(part.cells, tracker, claim.limits_of(tracker))
    worst = np.where(np.isfinite(beyond).any(axis=1), np.nanmax(np.nan_to_num(beyond, nan=-np.inf), axis=1), np.nan)
    states = np.array(part.states(tracker))
    # Where it fails for another cause than a limit, the border is about half way.
    finite = np.abs(worst[np.isfinite(worst)])
    worst[(states == "fails") & ~(worst > 0)] = float(np.median(finite)) if finite.size else 1.0
    finite = np.isfinite(worst)
    return Border(part.places[finite], tuple(states[finite].tolist()), worst[finite])
