"""Instants of a truth, and the recorder that fills them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trackbench.base.types import Array, Mask, Truth
from trackbench.base.units import wrap_angle
from trackbench.truth.frames import Frames


def at_instants(truth: Truth, stepped: Mask) -> Truth:
    """The truth with the rates that hold at its instants, where those of the step that begins there are stated.

    A body that moves with one velocity until the next instant has that velocity half a step later, on the smooth path
    through its positions. At the instant it has the mean of the steps before and after, to second order in the step.
    Else the range rate and the velocity would be ahead of the position: by 0.3 m/s at 12 m/s^2 and 20 Hz.

    Args:
        truth: velocity, acceleration and yaw rate are those of the step that begins at each instant.
        stepped: ``(objects,)`` the bodies that move so; the others stay. The observer moves so.
    """
    known = np.zeros_like(truth.alive)
    known[1:] = truth.alive[1:] & truth.alive[:-1]
    known = (known & stepped)[..., None]

    def middle(values: Array) -> Array:
        return np.where(known, 0.5 * (values + _before(values)), values)

    vx, vy = middle(truth.vx), middle(truth.vy)
    moves = known & (np.hypot(vx, vy) > 0.0)
    carrier = truth.observer
    vx_of_carrier, vy_of_carrier, turning = (
        0.5 * (rate + _before(rate)) for rate in (carrier.vx, carrier.vy, carrier.yaw_rate)
    )
    return replace(
        truth,
        speed=np.where(known, np.hypot(vx, vy), truth.speed),
        course=np.where(moves, wrap_angle(np.arctan2(vy, vx)), truth.course),
        # The change from the step before to the step after is that at the instant.
        acceleration=np.where(known, _before(truth.acceleration), truth.acceleration),
        yaw_rate=middle(truth.yaw_rate),
        observer=replace(carrier, vx=vx_of_carrier, vy=vy_of_carrier, yaw_rate=turning),
    )


def _before(values: Array) -> Array:
    """Those of one step before; the first has none and keeps its own."""
    return np.concatenate([values[:1], values[:-1]])


class Recorder:
    """Stands in for ``road.step`` and notes, at the start of each step, every vehicle on the road."""

    def __init__(self, env: Any) -> None:
        self.frames: list[dict[int, tuple[float, ...]]] = []
        self._env = env
        self._bodies: list[Any] = [env.vehicle]
        self._numbers = {id(env.vehicle): 0}
        self._clock: dict[int, float] = {}
        self._step: Callable[[float], None] = env.road.step
        env.road.step = self

    def __call__(self, dt: float) -> None:
        vehicles = list(self._env.road.vehicles)
        before = [(*v.position, v.heading, v.speed, *v.velocity, v.crashed) for v in vehicles]
        self._step(dt)
        # Steering is what this step used, so it is read after the step has clipped it.
        self.frames.append(
            {self._number(v): (*state, float(v.action["steering"])) for v, state in zip(vehicles, before, strict=True)}
        )

    def note_clock(self) -> None:
        """The environment's time between two of its steps; within one it runs ahead."""
        self._clock[len(self.frames)] = float(self._env.time)

    def _number(self, vehicle: Any) -> int:
        if id(vehicle) not in self._numbers:
            self._numbers[id(vehicle)] = len(self._bodies)
            self._bodies.append(vehicle)  # keeps it alive, so that no other can take its id
        return self._numbers[id(vehicle)]

    def result(self, steps: int, dt: float) -> Frames:
        """The first ``steps`` frames; the ego is body 0."""
        raw = np.full((8, min(steps, len(self.frames)), len(self._bodies)), np.nan)
        for k, frame in enumerate(self.frames[:steps]):
            for body, state in frame.items():
                raw[:, k, body] = state
        seen = np.isfinite(raw[0]).any(axis=0)
        raw = raw[:, :, seen]
        px, down, clockwise, speed, vx, vy_down, crashed, steering = raw
        return Frames(
            dt=dt,
            ids=tuple("ego" if i == 0 else f"v{i}" for i in np.flatnonzero(seen)),
            px=px,
            # The simulator's y points down its screen, to the right of the cars; the fixed frame's points up.
            py=-down,
            heading=-clockwise,
            # The slip angle of the kinematic bicycle (Polack et al. 2017): beta = atan(tan(steering) / 2).
            slip=-np.arctan(0.5 * np.tan(steering)),
            speed=speed,
            reported_vx=vx,
            reported_vy=-vy_down,
            collided=crashed == 1.0,
            length=np.array([float(v.LENGTH) for v, kept in zip(self._bodies, seen, strict=True) if kept]),
            width=np.array([float(v.WIDTH) for v, kept in zip(self._bodies, seen, strict=True) if kept]),
            clock=self._times(px.shape[0]),
        )

    def _times(self, steps: int) -> Array:
        kept = any(self._clock.values())
        return np.array([self._clock.get(k, math.nan) if kept else math.nan for k in range(steps)])
