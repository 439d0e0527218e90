"""What an object was doing, how far away it was and how long it was known at each instant: the classes by which
scores are broken down, and under each of which a covariance is judged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask, Truth, of_runs
from trackbench.sensing.scans import IdealSensor
from trackbench.truth.jumps import after_jump

#: An object is in one of these at each instant: the last that applies.
MANOEUVRES = ("straight", "accelerating", "braking", "turning", "sensor gap")
#: Turning: the heading changes faster than this, rad/s.
TURNING = float(np.deg2rad(3.0))
#: Braking and accelerating: the speed changes faster than this, m/s^2.
CHANGING_SPEED = 1.0
#: Accelerations and yaw rates are means over so much time, s. Single steps of a random motion are no manoeuvre: where
#: the noise of the motion is large, so is the error of a sound filter.
WINDOW = 0.5
#: Sensor gap: no sensor could see the object for longer than this many periods of the slowest one.
GAP_PERIODS = 3.0
#: Range bands from the observer are bounded by these, m.
BAND_EDGES = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
BANDS = len(BAND_EDGES) + 1
#: Time since a sensor could first see the object.
AGES = ("first second", "later")
FIRST = 1.0
#: Whether the velocity of the truth jumped shortly before.
JUMPS = ("elsewhere", "after a velocity jump")
#: A class is one of each: its place in an array of this shape.
SHAPE = (len(MANOEUVRES), BANDS, len(AGES), len(JUMPS))
#: Of times, relative.
ROUNDING = 1e-9

Classes = npt.NDArray[np.int16]


def condition_classes(truth: Truth, instants: Indices, sensors: Sequence[IdealSensor], runs: range) -> Classes:
    """``(instants, objects, runs or 1)`` the class of each object, as a flat index into ``SHAPE``.

    Args:
        truth: the motion.
        instants: ``(instants,)`` indices of the truth's steps.
        sensors: those that the tracker reads.
        runs: the runs that are wanted, where the motion is another one in each.
    """
    acceleration, yaw_rate = (
        _smoothed(of_runs(values, runs), truth)[instants] for values in (truth.acceleration, truth.yaw_rate)
    )
    seen = [(sensor, of_runs(sensor.visible, runs)) for sensor in sensors]
    manoeuvre = np.zeros(acceleration.shape, dtype=np.int16)
    manoeuvre[acceleration > CHANGING_SPEED] = MANOEUVRES.index("accelerating")
    manoeuvre[acceleration < -CHANGING_SPEED] = MANOEUVRES.index("braking")
    manoeuvre[np.abs(yaw_rate) > TURNING] = MANOEUVRES.index("turning")
    # Chance misses do not count.
    periods = [float(np.median(np.diff(sensor.time))) if len(sensor.time) > 1 else np.inf for sensor in sensors]
    in_gap = out_of_view(truth.time, instants, seen) > GAP_PERIODS * max(periods) * (1 + ROUNDING)
    manoeuvre = np.where(in_gap, MANOEUVRES.index("sensor gap"), manoeuvre)
    observer = truth.observer
    distance = np.hypot(
        of_runs(truth.px, runs)[instants] - observer.px[instants, None, None],
        of_runs(truth.py, runs)[instants] - observer.py[instants, None, None],
    )
    first_seen: Array = np.array(np.inf)
    for sensor, visible in seen:
        first_seen = np.minimum(
            first_seen, np.where(visible.any(axis=0), sensor.time[np.argmax(visible, axis=0)], np.inf)
        )
    later = truth.time[instants][:, None, None] - first_seen >= FIRST * (1 - ROUNDING)
    jumped = of_runs(after_jump(truth), runs)[instants]
    parts = np.broadcast_arrays(manoeuvre, np.digitize(distance, BAND_EDGES), later.astype(int), jumped.astype(int))
    return np.ravel_multi_index(parts, SHAPE).astype(np.int16)


def _smoothed(values: Array, truth: Truth) -> Array:
    """The mean of values ``(steps, objects, runs or 1)`` over the steps within half a ``WINDOW`` of each."""
    time, reach = truth.time, WINDOW / 2 * (1 + ROUNDING)
    ends = np.searchsorted(time, time - reach), np.searchsorted(time, time + reach)

    def total(terms: Array) -> Array:
        sums = np.concatenate([np.zeros_like(terms[:1]), np.cumsum(terms, axis=0)])
        return np.asarray(sums[ends[1]] - sums[ends[0]])

    alive = truth.alive[:, :, None].astype(float)
    return total(values * alive) / np.maximum(total(alive), 1.0)


def out_of_view(time: Array, instants: Indices, sensors: Sequence[tuple[IdealSensor, Mask]]) -> Array:
    """``(instants, objects, runs or 1)`` for how long no sensor could see the object, s; infinite where none could yet.

    Args:
        time: of the truth's steps, s.
        instants: indices of those that are wanted.
        sensors: each with where it can see the objects, ``(measurements, objects, runs or 1)``.
    """
    latest: Array = np.array(-np.inf)
    for sensor, visible in sensors:
        seen = np.maximum.accumulate(np.where(visible, sensor.time[:, None, None], -np.inf), axis=0)
        measurement = np.searchsorted(sensor.steps, instants, side="right") - 1
        latest = np.maximum(latest, np.where(measurement[:, None, None] < 0, -np.inf, seen[measurement]))
    return np.asarray(time[instants][:, None, None] - latest)
