"""What an object was doing and how far away it was at each instant: the classes by which scores are broken down."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from trackbench.sensing.scans import IdealSensor
from trackbench.types import Array, Indices, Mask, Truth

#: An object is in one of these at each instant: the last that applies.
MANOEUVRES = ("straight", "accelerating", "braking", "turning", "sensor gap")
#: Turning: the heading changes faster than this, rad/s.
TURNING = float(np.deg2rad(3.0))
#: Braking and accelerating: the speed changes faster than this, m/s^2.
CHANGING_SPEED = 1.0
#: Sensor gap: no sensor could see the object for longer than this many periods of the slowest one.
GAP_PERIODS = 3.0
#: Range bands from the observer are bounded by these, m.
BAND_EDGES = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
BANDS = len(BAND_EDGES) + 1

T = TypeVar("T", bound=np.generic)
Classes = npt.NDArray[np.int8]


def conditions(truth: Truth, instants: Indices, sensors: Sequence[IdealSensor], runs: range) -> Classes:
    """``(instants, objects, runs or 1)`` the class of each object: its place in ``MANOEUVRES`` times ``BANDS``, plus
    that of its range band.

    Args:
        truth: the motion.
        instants: ``(instants,)`` indices of the truth's steps.
        sensors: those that the tracker reads.
        runs: the runs that are wanted, where the motion is another one in each.
    """

    def of_runs(values: npt.NDArray[T]) -> npt.NDArray[T]:
        return values if values.shape[-1] == 1 else values[..., runs.start : runs.stop]

    acceleration, yaw_rate = of_runs(truth.acceleration)[instants], of_runs(truth.yaw_rate)[instants]
    manoeuvre = np.zeros(acceleration.shape, dtype=np.int8)
    manoeuvre[acceleration > CHANGING_SPEED] = MANOEUVRES.index("accelerating")
    manoeuvre[acceleration < -CHANGING_SPEED] = MANOEUVRES.index("braking")
    manoeuvre[np.abs(yaw_rate) > TURNING] = MANOEUVRES.index("turning")
    gap = _in_gap(truth.time, instants, [(sensor, of_runs(sensor.visible)) for sensor in sensors])
    manoeuvre = np.where(gap, np.int8(MANOEUVRES.index("sensor gap")), manoeuvre)
    observer = truth.observer
    distance = np.hypot(
        of_runs(truth.px)[instants] - observer.px[instants, None, None],
        of_runs(truth.py)[instants] - observer.py[instants, None, None],
    )
    return np.asarray(manoeuvre * BANDS + np.digitize(distance, BAND_EDGES), dtype=np.int8)


def _in_gap(time: Array, instants: Indices, sensors: Sequence[tuple[IdealSensor, Mask]]) -> Mask:
    """Where no sensor could have seen the object for too long; chance misses do not count."""
    latest: Array = np.array(-np.inf)
    for sensor, visible in sensors:
        seen = np.maximum.accumulate(np.where(visible, sensor.time[:, None, None], -np.inf), axis=0)
        measurement = np.searchsorted(sensor.steps, instants, side="right") - 1
        latest = np.maximum(latest, np.where(measurement[:, None, None] < 0, -np.inf, seen[measurement]))
    periods = [float(np.median(np.diff(sensor.time))) if len(sensor.time) > 1 else np.inf for sensor, _ in sensors]
    # The times of measurements are rounded.
    limit = GAP_PERIODS * max(periods) * (1 + 1e-9)
    return np.asarray(time[instants][:, None, None] - latest > limit)
