"""What a simulator reported at each of its steps, and the truth that follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array, Mask, Observer, Truth
from trackbench.base.units import wrap_angle


@dataclass(frozen=True)
class Frames:
    """Raw motion of every body at the start of each simulation step, ``(steps, bodies)``; NaN where it is absent."""

    dt: float
    """s."""
    ids: tuple[str, ...]
    px: Array
    py: Array
    heading: Array
    """rad."""
    slip: Array
    """Course minus heading during the step that starts here, rad."""
    speed: Array
    """Along the course; negative in reverse, m/s."""
    reported_vx: Array
    """The velocity that the simulator itself states, m/s."""
    reported_vy: Array
    collided: Mask
    """After a collision."""
    length: Array
    """``(bodies,)`` m."""
    width: Array
    """``(bodies,)`` m."""
    clock: Array
    """``(steps,)`` the simulator's own time, s; NaN where it keeps none."""

    @property
    def alive(self) -> Mask:
        """``(steps, bodies)``."""
        return np.isfinite(self.px)

    def truth(self, bodies: Sequence[int], observer: Observer) -> Truth:
        """The truth of the bodies with these numbers: course along the motion, speed not negative."""
        chosen = list(bodies)
        alive = self.alive[:, chosen]
        heading, slip, speed = (held(a[:, chosen], alive) for a in (self.heading, self.slip, self.speed))
        course = heading + slip + np.where(speed < 0.0, np.pi, 0.0)
        return Truth(
            time=np.arange(len(self.px), dtype=np.float64) * self.dt,
            ids=tuple(self.ids[i] for i in chosen),
            px=held(self.px[:, chosen], alive)[..., None],
            py=held(self.py[:, chosen], alive)[..., None],
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
        """The observer that rides on a body."""
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


def held(values: Array, alive: Mask) -> Array:
    """``values`` with the nearest living value held before a body appears and after it has left."""
    steps = np.arange(len(values))[:, None]
    first = np.argmax(alive, axis=0)
    last = len(values) - 1 - np.argmax(alive[::-1], axis=0)
    return np.asarray(np.take_along_axis(values, np.clip(steps, first, last), axis=0))


def rate(values: Array, dt: float, alive: Mask) -> Array:
    """Rate of change over the step that starts at each frame; a body's last frame keeps the one before.

    The step that starts at a frame, not the one that ends there, because the simulator integrates by Euler's
    explicit rule: what holds at a frame acts until the next.
    """
    slope = np.zeros_like(values)
    slope[:-1] = np.diff(values, axis=0) / dt
    known = np.zeros_like(alive)
    known[:-1] = alive[:-1] & alive[1:]
    return np.where(known.any(axis=0), held(slope, known), 0.0)
