"""Classes of estimates by condition: manoeuvre and range of the object, time in view, jump of the truth's velocity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask, Truth, of_runs
from trackbench.sensing.scans import IdealSensor
from trackbench.truth.jumps import after_jump

#: Manoeuvres of an object; where several apply at an instant, the last of them counts.
MANOEUVRES = ("straight", "accelerating", "braking", "turning", "sensor gap")
#: Yaw rate above which an object is turning, rad/s.
TURNING = float(np.deg2rad(3.0))
#: Change of speed above which an object is braking or accelerating, m/s^2.
CHANGING_SPEED = 1.0
#: Time over which accelerations and yaw rates are averaged, s. Single large steps of a random motion are no manoeuvre:
#: there even a sound filter has a large error.
WINDOW = 0.5
#: Periods of the slowest sensor without a view of the object after which a sensor gap begins.
GAP_PERIODS = 3.0
#: Distances from the observer that separate the range bands, m.
BAND_EDGES = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
BANDS = len(BAND_EDGES) + 1
#: Classes of the time since a sensor could first see the object; the first one lasts ``FIRST`` s.
AGES = ("first second", "later")
FIRST = 1.0
#: Whether the velocity of the truth jumped shortly before.
JUMPS = ("elsewhere", "after a velocity jump")
#: Shape of the array in which a class has a place: one axis each for manoeuvre, range band, age and jump.
SHAPE = (len(MANOEUVRES), BANDS, len(AGES), len(JUMPS))
#: Relative rounding error of times.
ROUNDING = 1e-9

Classes = npt.NDArray[np.int16]


def condition_classes(truth: Truth, instants: Indices, sensors: Sequence[IdealSensor], runs: range) -> Classes:
    """Return each object's class, ``(instants, objects, runs or 1)``: manoeuvre, range, age and jump as one index.

    Args:
        truth: motion of the objects and the observer.
        instants: ``(instants,)`` indices of the truth's steps.
        sensors: the sensors that the tracker uses.
        runs: the runs to classify, where the motion differs between runs.
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
    """Average values ``(steps, objects, runs or 1)`` over the steps within half a ``WINDOW`` of each step."""
    time, reach = truth.time, WINDOW / 2 * (1 + ROUNDING)
    ends = np.searchsorted(time, time - reach), np.searchsorted(time, time + reach)

    def total(terms: Array) -> Array:
        sums = np.concatenate([np.zeros_like(terms[:1]), np.cumsum(terms, axis=0)])
        return np.asarray(sums[ends[1]] - sums[ends[0]])

    alive = truth.alive[:, :, None].astype(float)
    return total(values * alive) / np.maximum(total(alive), 1.0)


def out_of_view(time: Array, instants: Indices, sensors: Sequence[tuple[IdealSensor, Mask]]) -> Array:
    """Return the time since each object was last in view, ``(instants, objects, runs or 1)`` s; infinity if never yet.

    Args:
        time: times of the truth's steps, s.
        instants: indices of the steps to evaluate.
        sensors: each sensor with the mask ``(measurements, objects, runs or 1)`` of the objects that it can see.
    """
    latest: Array = np.array(-np.inf)
    for sensor, visible in sensors:
        seen = np.maximum.accumulate(np.where(visible, sensor.time[:, None, None], -np.inf), axis=0)
        measurement = np.searchsorted(sensor.steps, instants, side="right") - 1
        latest = np.maximum(latest, np.where(measurement[:, None, None] < 0, -np.inf, seen[measurement]))
    return np.asarray(time[instants][:, None, None] - latest)
