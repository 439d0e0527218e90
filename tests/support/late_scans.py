"""Linear problems whose scans come late."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from tests.support.scenes import scan

from trackbench.base.types import Array, Estimate, Scan
from trackbench.filters import KalmanFilter
from trackbench.models.motion import MotionModel
from trackbench.trackers.builtin import build
from trackbench.trackers.config import FilterConfig
from trackbench.trackers.filtered import FilterTracker
from trackbench.trackers.initial import InitialConfig
from trackbench.trackers.late import LateScans

FIRST = {"from": "first_measurement", "velocity_sigma_mps": 10}


class WhiteAcceleration(MotionModel):
    """Constant velocity, driven by continuous white noise: two steps are the same as one of their length."""

    components: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")
    linear: ClassVar[bool] = True
    driving_noise: ClassVar[tuple[str, ...]] = ("a", "b", "c", "d")
    a: float = 1.0
    b: float = 1.0
    c: float = 1.0
    d: float = 1.0

    def transition(self, x: Array, dt: float) -> Array:
        return np.concatenate([x[:2] + dt * x[2:], x[2:]])

    def jacobian(self, x: Array, dt: float) -> Array:
        return np.kron([[1, dt], [0, 1.0]], np.eye(2))

    def noise_gain(self, x: Array, dt: float) -> Array:
        if dt == 0.0:
            return np.zeros((4, 4))
        return np.kron(np.linalg.cholesky([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))


def late_tracker(**keys: Any) -> LateScans:
    """A built-in tracker with what becomes of its late scans, from the keys of a scenario."""
    return build(FilterConfig.model_validate(keys))


def linear(late: str, lag: float = 1.0) -> LateScans:
    initial = InitialConfig.model_validate(FIRST)
    return LateScans(FilterTracker(KalmanFilter(WhiteAcceleration()), initial), late, lag)


def lidar_scans(count: int = 12, seed: int = 0, batch: int = 3, period: float = 0.1, valid: float = 0.9) -> list[Scan]:
    random = np.random.default_rng(seed)
    seen = random.random((count, batch)) < valid
    seen[0] = True
    made = []
    for k in range(count):
        position = np.array([[40.0], [30.0]]) + period * k * np.array([[12.0], [-5.0]])
        made.append(scan("lidar", period * k, position + 0.3 * random.normal(size=(2, batch)), valid=seen[k]))
    return made


def taken(of: Any, scans: list[Scan]) -> list[Estimate]:
    state, estimates = None, []
    for item in scans:
        state, estimate = of.step(state, item)
        estimates.append(estimate)
    return estimates


def swapped(scans: list[Scan], *numbers: int) -> list[Scan]:
    """The scans of these numbers each after the one that follows it."""
    order = list(range(len(scans)))
    for number in numbers:
        order[number], order[number + 1] = order[number + 1], order[number]
    return [scans[k] for k in order]
