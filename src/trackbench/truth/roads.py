"""Lane edges as polylines to draw."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from trackbench.base.types import Array, Mask

MARGIN_M = 100.0
SPACING_M = 2.0
STRAIGHT_M = 1e-3


class Lane(Protocol):
    """The part of a highway-env lane that is needed here."""

    length: float
    line_types: list[int] | None

    def position(self, longitudinal: float, lateral: float) -> Array: ...
    def width_at(self, longitudinal: float) -> float: ...


def lane_edges(lanes: Iterable[Lane], px: Array, py: Array) -> tuple[Array, ...]:
    """The marked edges of ``lanes`` within 100 m of the area that the positions span, each ``(points, 2)`` m.

    Positions and edges are in the fixed frame, whose y is the simulator's turned up.
    """
    low = np.array([px.min(), py.min()]) - MARGIN_M
    high = np.array([px.max(), py.max()]) + MARGIN_M
    edges: dict[tuple[float, ...], Array] = {}
    for lane in lanes:
        for side, kind in zip((-0.5, 0.5), lane.line_types or (1, 1), strict=True):
            if kind:
                points = _edge(lane, side)
                for part in _parts(points, np.all((points >= low) & (points <= high), axis=1)):
                    line = _simplified(part)
                    edges.setdefault(tuple(np.round(line, 1).ravel().tolist()), line)
    return tuple(edges.values())


def _edge(lane: Lane, side: float) -> Array:
    s = np.linspace(0.0, lane.length, max(2, int(np.ceil(lane.length / SPACING_M)) + 1))
    return np.array([lane.position(at, side * lane.width_at(at)) for at in s]) * (1.0, -1.0)


def _parts(points: Array, inside: Mask) -> list[Array]:
    """The runs of consecutive points that are inside, each of at least two points."""
    breaks = np.flatnonzero(np.diff(inside.astype(int))) + 1
    runs = zip(np.split(points, breaks), np.split(inside, breaks), strict=True)
    return [run for run, kept in runs if kept[0] and len(run) > 1]


def _simplified(line: Array) -> Array:
    """Without the points that lie on the line between their neighbours."""
    before, after = line[1:-1] - line[:-2], line[2:] - line[1:-1]
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    corner = np.abs(turn) > STRAIGHT_M * SPACING_M
    return line[np.concatenate(([True], corner, [True]))]
