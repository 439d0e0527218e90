"""Motion of all simulated or recorded vehicles before the choice of targets, and the edges of lanes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.streams import stream
from trackbench.base.types import Array, Mask, Observer, Truth
from trackbench.base.units import wrap_angle
from trackbench.truth.config.highway import SelectedTargets, VehicleSizes
from trackbench.truth.config.recording import FixedObserver


@dataclass(frozen=True)
class Frames:
    """Motion of every vehicle at the start of each simulation step, ``(steps, bodies)``; NaN where absent."""

    dt: float
    """Duration of one simulation step, s."""
    ids: tuple[str, ...]
    px: Array
    py: Array
    heading: Array
    """Heading ``(steps, bodies)``, rad, counter-clockwise from the fixed x axis."""
    slip: Array
    """Direction of motion minus heading ``(steps, bodies)``, during the step that begins at the instant, rad."""
    speed: Array
    """Speed ``(steps, bodies)`` along the direction of motion, m/s; negative in reverse."""
    collided: Mask
    """``(steps, bodies)`` whether each body has collided by the start of the step."""
    length: Array
    width: Array

    @property
    def alive(self) -> Mask:
        """``(steps, bodies)`` whether the body is present."""
        return np.isfinite(self.px)

    def truth(self, bodies: Sequence[int], observer: Observer) -> Truth:
        """Return the truth of the bodies with these indices; a body in reverse has a positive speed backwards."""
        chosen = list(bodies)
        alive = self.alive[:, chosen]
        heading, slip, speed = (hold_nearest(a[:, chosen], alive) for a in (self.heading, self.slip, self.speed))
        course = heading + slip + np.where(speed < 0.0, np.pi, 0.0)
        return Truth(
            time=np.arange(len(self.px), dtype=np.float64) * self.dt,
            ids=tuple(self.ids[i] for i in chosen),
            px=hold_nearest(self.px[:, chosen], alive)[..., None],
            py=hold_nearest(self.py[:, chosen], alive)[..., None],
            heading=wrap_angle(heading)[..., None],
            course=wrap_angle(course)[..., None],
            speed=np.abs(speed)[..., None],
            acceleration=rate(np.abs(speed), self.dt, alive)[..., None],
            yaw_rate=rate(heading, self.dt, alive)[..., None],
            alive=alive,
            length=self.length[chosen],
            width=self.width[chosen],
            observer=observer,
        )

    def carrier(self, body: int) -> Observer:
        """Return an observer that moves with the body of this index."""
        course = self.heading[:, body] + self.slip[:, body]
        alive = self.alive[:, body, None]
        return Observer(
            px=self.px[:, body],
            py=self.py[:, body],
            yaw=wrap_angle(self.heading[:, body]),
            vx=self.speed[:, body] * np.cos(course),
            vy=self.speed[:, body] * np.sin(course),
            yaw_rate=rate(self.heading[:, body, None], self.dt, alive)[:, 0],
            length=float(self.length[body]),
            width=float(self.width[body]),
        )


def fixed_observer(observer: FixedObserver, steps: int) -> Observer:
    """Return the observer at rest at the configured point, as arrays of ``steps`` equal instants."""
    at_rest = np.zeros(steps)
    yaw = np.deg2rad(observer.yaw_deg)
    return Observer(at_rest + observer.x, at_rest + observer.y, at_rest + yaw, at_rest, at_rest, at_rest)


def hold_nearest(values: Array, alive: Mask) -> Array:
    """Return ``values`` with a body's first value repeated before it appears, and its last after it has left."""
    steps = np.arange(len(values))[:, None]
    first = np.argmax(alive, axis=0)
    last = len(values) - 1 - np.argmax(alive[::-1], axis=0)
    return np.asarray(np.take_along_axis(values, np.clip(steps, first, last), axis=0))


def rate(values: Array, dt: float, alive: Mask) -> Array:
    """Return the rate of change over the step after each instant; a body's last instant repeats the rate before it.

    The simulator integrates by Euler's explicit rule: the rate at an instant acts until the next instant.
    """
    slope = np.zeros_like(values)
    slope[:-1] = np.diff(values, axis=0) / dt
    is_present_at_both_ends = np.zeros_like(alive)
    is_present_at_both_ends[:-1] = alive[:-1] & alive[1:]
    return np.where(is_present_at_both_ends.any(axis=0), hold_nearest(slope, is_present_at_both_ends), 0.0)


#: Length and width, m. highway-env's drivers stop 10 m from centre to centre, so a longer truck would touch.
VAN, TRUCK = (7.0, 2.0), (10.0, 2.5)


def with_sizes(frames: Frames, shares: VehicleSizes, seed: int) -> Frames:
    """Return the frames with some bodies, chosen at random, as large as vans and trucks; the ego keeps its size.

    A body's size depends only on the seed and its name. The motion is unchanged: in highway-env the length is also the
    wheelbase, and drivers measure gaps from centre to centre, so that these sizes would change it.
    """
    length, width = frames.length.copy(), frames.width.copy()
    for body, name in enumerate(frames.ids):
        draw = stream(seed, "vehicle sizes", 0, name).random()
        if name != "ego" and draw < shares.truck + shares.van:
            length[body], width[body] = TRUCK if draw < shares.truck else VAN
    return replace(frames, length=length, width=width)


def target_bodies(
    targets: Literal["all"] | SelectedTargets, frames: Frames, observer: Observer, carrier: int | None
) -> list[int]:
    """Return the indices of the target bodies; ``carrier``, the body with the observer, is no target.

    Raises:
        InputError: a named target is not in the scene.
    """
    bodies = [i for i in range(len(frames.ids)) if i != carrier]
    if targets == "all":
        return bodies
    if targets.ids is not None:
        by_name = {frames.ids[i]: i for i in bodies}
        for name in targets.ids:
            if name not in by_name:
                raise InputError(
                    f"there is no vehicle {name!r} in this scene; {nearest_choices(name, by_name)}",
                    key="truth.targets.ids",
                )
        return sorted({by_name[name] for name in targets.ids})
    nearest_m = _least_distance(frames, observer)
    bodies.sort(key=lambda i: float(nearest_m[i]))
    return sorted(bodies[: targets.nearest])


def bodies_near(
    limit: float, frames: Frames, observer: Observer, named: Sequence[int], carrier: int | None
) -> list[int]:
    """Return the bodies within ``limit`` m of the observer at any time, and the bodies ``named``; all as indices.

    The body ``carrier``, on which the observer is mounted, is left out unless it is named.

    Raises:
        InputError: no body is near or named.
    """
    near = _least_distance(frames, observer) <= limit
    bodies = [i for i in range(len(frames.ids)) if i in named or (near[i] and i != carrier)]
    if not bodies:
        raise InputError(f"no vehicle comes within {limit:g} m of the observer", key="truth.targets")
    return bodies


def _least_distance(frames: Frames, observer: Observer) -> Array:
    """Return the smallest distance of each body from the observer while it is present, ``(bodies,)`` m."""
    distance = np.hypot(frames.px - observer.px[:, None], frames.py - observer.py[:, None])
    return np.asarray(np.nanmin(distance, axis=0))


#: Period at which boxes are compared, s.
OFTEN_S = 0.2


def overlaps(frames: Frames, margin: float) -> Mask:
    """Return which pairs of bodies have boxes that ever come nearer than ``margin`` m, ``(bodies, bodies)``.

    With a negative margin the boxes must overlap by more than ``-margin``, both along and across.
    """
    bodies = len(frames.ids)
    result = np.zeros((bodies, bodies), dtype=bool)
    for step in range(0, len(frames.px), max(1, round(OFTEN_S / frames.dt))):
        present = np.flatnonzero(frames.alive[step])
        x, y, heading = frames.px[step, present], frames.py[step, present], frames.heading[step, present]
        dx, dy = x - x[:, None], y - y[:, None]
        c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
        half_length, half_width = frames.length[present] / 2, frames.width[present] / 2
        # Extent of the other body along and across this body.
        even, turned = np.abs(c * c.T + s * s.T), np.abs(c * s.T - s * c.T)
        along = half_length[:, None] + even * half_length + turned * half_width
        across = half_width[:, None] + turned * half_length + even * half_width
        is_near = (np.abs(c * dx + s * dy) < along + margin) & (np.abs(c * dy - s * dx) < across + margin)
        result[np.ix_(present, present)] |= is_near & is_near.T
    np.fill_diagonal(result, False)
    return result


MARGIN_M = 100.0
SPACING_M = 2.0
STRAIGHT_M = 1e-3


def lane_edges(lanes: Iterable[Any], px: Array, py: Array) -> tuple[Array, ...]:
    """Return the marked edges of highway-env's ``lanes`` within 100 m of the positions, each ``(points, 2)`` m.

    Positions and edges are in the fixed frame, whose y points opposite to the simulator's.
    """
    low = np.array([px.min(), py.min()]) - MARGIN_M
    high = np.array([px.max(), py.max()]) + MARGIN_M
    edges: dict[tuple[float, ...], Array] = {}
    for lane in lanes:
        for side, kind in zip((-0.5, 0.5), lane.line_types or (1, 1), strict=True):
            if kind:
                s = np.linspace(0.0, lane.length, max(2, int(np.ceil(lane.length / SPACING_M)) + 1))
                points = np.array([lane.position(at, side * lane.width_at(at)) for at in s]) * (1.0, -1.0)
                for part in _runs_inside(points, np.all((points >= low) & (points <= high), axis=1)):
                    line = _without_collinear_points(part)
                    edges.setdefault(tuple(np.round(line, 1).ravel().tolist()), line)
    return tuple(edges.values())


def _runs_inside(points: Array, inside: Mask) -> list[Array]:
    """Return each stretch of at least two consecutive points that are inside."""
    breaks = np.flatnonzero(np.diff(inside.astype(int))) + 1
    runs = zip(np.split(points, breaks), np.split(inside, breaks), strict=True)
    return [run for run, kept in runs if kept[0] and len(run) > 1]


def _without_collinear_points(line: Array) -> Array:
    before, after = line[1:-1] - line[:-2], line[2:] - line[1:-1]
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    is_corner = np.abs(turn) > STRAIGHT_M * SPACING_M
    return line[np.concatenate(([True], is_corner, [True]))]
