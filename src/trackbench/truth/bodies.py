"""Sizes and poses of vehicles, and the roads."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from trackbench.base.errors import InputError, nearest
from trackbench.base.streams import stream
from trackbench.base.types import Array, Mask, Observer
from trackbench.truth.config import HighwayOptions, IdTargets, NearestTargets, VehicleSizes
from trackbench.truth.frames import Frames

#: Length and width, m. highway-env's drivers leave 10 m from centre to centre at rest: a longer truck would touch.
VAN, TRUCK = (7.0, 2.0), (10.0, 2.5)


def with_sizes(frames: Frames, shares: VehicleSizes, seed: int) -> Frames:
    """The frames with some bodies the size of vans and trucks; the ego keeps its own.

    Each body's size depends on the seed and its name alone. The motion stays as it was: in highway-env the length is
    also the wheelbase, and drivers look from centre to centre, so that another size would make another drive.
    """
    length, width = frames.length.copy(), frames.width.copy()
    for body, name in enumerate(frames.ids):
        draw = stream(seed, "vehicle sizes", 0, name).random()
        if name != "ego" and draw < shares.truck + shares.van:
            length[body], width[body] = TRUCK if draw < shares.truck else VAN
    return replace(frames, length=length, width=width)


def target_bodies(config: HighwayOptions, frames: Frames, observer: Observer) -> list[int]:
    """The bodies that are tracked.

    Raises:
        InputError: one of them is not in the scene, or none is.
    """
    bodies = [i for i in range(len(frames.ids)) if i > 0 or config.observer != "ego"]
    if isinstance(config.targets, IdTargets):
        known = {frames.ids[i]: i for i in bodies}
        for name in config.targets.ids:
            if name not in known:
                raise InputError(
                    f"there is no vehicle {name!r} in this scene; {nearest(name, known)}", key="truth.targets.ids"
                )
        bodies = sorted({known[name] for name in config.targets.ids})
    elif isinstance(config.targets, NearestTargets):
        nearest_m = _least_distance(frames, observer)
        bodies.sort(key=lambda i: float(nearest_m[i]))
        bodies = sorted(bodies[: config.targets.nearest])
    if not bodies:
        raise InputError(f"there is no vehicle to track in {config.env} with this configuration", key="truth.targets")
    return bodies


def truth_bodies(config: HighwayOptions, frames: Frames, observer: Observer, targets: list[int]) -> list[int]:
    """The bodies of the truth: the targets, or with hidden identities all that a sensor might reach.

    Raises:
        InputError: there is none.
    """
    limit = config.others_within_m
    if limit is None:
        return targets
    near = _least_distance(frames, observer) <= limit
    named = [] if config.targets == "all" else targets
    bodies = [i for i in range(len(frames.ids)) if i in named or (near[i] and (i > 0 or config.observer != "ego"))]
    if not bodies:
        raise InputError(f"no vehicle comes within {limit:g} m of the observer", key="truth.targets")
    return bodies


def _least_distance(frames: Frames, observer: Observer) -> Array:
    """``(bodies,)`` m, over the time that each is there."""
    distance = np.hypot(frames.px - observer.px[:, None], frames.py - observer.py[:, None])
    return np.asarray(np.nanmin(distance, axis=0))


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
