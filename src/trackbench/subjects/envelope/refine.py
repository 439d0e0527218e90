"""Where the map is refined: between neighbours on different sides of the border."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from trackbench.subjects.envelope.axes import MapAxis, Point, Value, between, shares

#: By tracker, the state of a cell.
States = Mapping[str, str]


def refined(
    axes: Sequence[MapAxis], states: Mapping[Point, States], most: int, resolution: float, design: str
) -> list[Point]:
    """New points half way between neighbours that differ in a state, those furthest apart first.

    Args:
        axes: of the map.
        states: of each point, by tracker.
        most: how many more cells there may be.
        resolution: share of an axis at which nothing is put between two points any more.
        design: as of :class:`EnvelopeConfig`.
    """
    if most <= 0 or not any(axis.continuous for axis in axes):
        return []
    pairs = _along_axes(axes, states) if design == "grid" else _neighbours(axes, states)
    gaps: dict[Point, float] = {}
    for a, b in pairs:
        if _differ(states[a], states[b]):
            point = between(axes, a, b, resolution)
            if point is not None and point not in states:
                gaps[point] = max(gaps.get(point, 0.0), float(np.abs(np.diff(shares(axes, [a, b]), axis=0)).max()))
    return sorted(gaps, key=lambda point: -gaps[point])[:most]


def _differ(a: States, b: States) -> bool:
    """Whether the border of some tracker may lie between two cells: not where both are undecided."""
    return any(a[tracker] != b[tracker] for tracker in a)


def _along_axes(axes: Sequence[MapAxis], points: Mapping[Point, States]) -> Iterator[tuple[Point, Point]]:
    """Neighbours that differ in one continuous axis alone."""
    for number, axis in enumerate(axes):
        if not axis.continuous:
            continue
        lines: dict[tuple[Value, ...], list[Point]] = {}
        for point in points:
            lines.setdefault((*point[:number], *point[number + 1 :]), []).append(point)
        for line in lines.values():
            line.sort(key=lambda point: float(point[number]))
            yield from pairwise(line)


def _neighbours(axes: Sequence[MapAxis], points: Mapping[Point, States]) -> Iterator[tuple[Point, Point]]:
    """Pairs with no third point in the sphere over them, among points with the same values of all other axes.

    Source: Gabriel and Sokal (1969), "A new statistical approach to geographic variation analysis".
    """
    fixed = [number for number, axis in enumerate(axes) if not axis.continuous]
    groups: dict[tuple[Value, ...], list[Point]] = {}
    for point in points:
        groups.setdefault(tuple(point[number] for number in fixed), []).append(point)
    for group in groups.values():
        at = shares(axes, group)
        for place, point in enumerate(group):
            for other in range(place + 1, len(group)):
                inside = ((at - at[place]) * (at - at[other])).sum(axis=1) <= 0
                # The two themselves are on the sphere.
                if inside.sum() == 2:
                    yield point, group[other]
