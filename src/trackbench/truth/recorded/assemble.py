"""Recorded motion and measurements on one grid of times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.models.sensors import SENSOR_MODELS
from trackbench.truth.config import FixedObserver, RecordingOptions
from trackbench.types import Array, Indices, Observer, RecordedMeasurements, Truth
from trackbench.units import wrap_angle


class Motion(NamedTuple):
    """The recorded motion of one object, each ``(rows,)``, at strictly increasing times."""

    time: Array
    """s from the recording's first instant."""
    px: Array
    py: Array
    vx: Array
    vy: Array
    heading: Array | None = None
    """rad; None: the course."""
    yaw_rate: Array | None = None
    """rad/s; None: from the heading."""


class Log(NamedTuple):
    """The recorded measurements of one sensor, one row a detection."""

    time: Array
    """``(rows,)`` s."""
    object: Indices
    """``(rows,)`` number of the object."""
    measurement: Array
    """``(m, rows)``"""


def truth(
    config: RecordingOptions,
    motions: Mapping[str, Motion],
    logs: Mapping[str, Log],
    observer: Observer | None,
    times: Array,
    source: Mapping[str, Any],
) -> Truth:
    """The motion of all objects at ``times``, between the recorded instants by linear interpolation.

    Args:
        config: the scenario's.
        motions: by object.
        logs: by sensor.
        observer: what carries the sensors, at ``times``; None: the fixed point of ``config``.
        times: ``(steps,)`` s, increasing.
        source: what the result says of the recording beside its format and file.
    """
    columns = [_on_grid(motion, times) for motion in motions.values()]

    def stacked(name: str) -> Array:
        return np.stack([column[name] for column in columns], axis=1)[:, :, None]

    alive = np.stack([(times >= m.time[0]) & (times <= m.time[-1]) for m in motions.values()], axis=1)
    return Truth(
        time=times,
        ids=tuple(motions),
        px=stacked("px"),
        py=stacked("py"),
        heading=stacked("heading"),
        course=stacked("course"),
        speed=stacked("speed"),
        acceleration=stacked("acceleration"),
        yaw_rate=stacked("yaw_rate"),
        alive=alive,
        length=np.full(len(motions), config.length_m),
        width=np.full(len(motions), config.width_m),
        observer=observer if observer is not None else fixed(config.observer, len(times)),
        source={"source": "recording", "format": config.format, "recorded": list(logs), **source},
    )


def measurements(log: Log, kind: str, times: Array, objects: int) -> RecordedMeasurements:
    """A sensor's measurements by step and object, its angles wrapped to (-pi, pi].

    Args:
        log: at most one row for each time and object.
        kind: of the sensor.
        times: ``(steps,)`` those of the truth, with all of the log's among them.
        objects: how many there are.
    """
    model = SENSOR_MODELS[kind]
    instants, of_row = np.unique(log.time, return_inverse=True)
    measurement = np.full((len(model.components), len(instants), objects), np.nan)
    measurement[:, of_row, log.object] = log.measurement
    for i in model.angular:
        measurement[i] = wrap_angle(measurement[i])
    return RecordedMeasurements(np.searchsorted(times, instants), measurement, np.isfinite(measurement).all(axis=0))


def grid(arrays: Sequence[Array]) -> Array:
    """All the times of several recordings, each once and in order."""
    return np.unique(np.concatenate(arrays))


def fixed(observer: FixedObserver, steps: int) -> Observer:
    """A point at rest."""
    at_rest = np.zeros(steps)
    yaw = np.deg2rad(observer.yaw_deg)
    return Observer(at_rest + observer.x, at_rest + observer.y, at_rest + yaw, at_rest, at_rest, at_rest)


def _on_grid(motion: Motion, times: Array) -> dict[str, Array]:
    def at(values: Array) -> Array:
        return np.interp(times, motion.time, values)

    vx, vy = at(motion.vx), at(motion.vy)
    course = np.arctan2(vy, vx)
    heading = course if motion.heading is None else wrap_angle(at(np.unwrap(motion.heading)))
    turning = _slope(np.unwrap(course if motion.heading is None else heading), times)
    speed = np.hypot(vx, vy)
    return {
        "px": at(motion.px),
        "py": at(motion.py),
        "heading": heading,
        "course": course,
        "speed": speed,
        "acceleration": _slope(speed, times),
        "yaw_rate": turning if motion.yaw_rate is None else at(motion.yaw_rate),
    }


def _slope(values: Array, times: Array) -> Array:
    return np.gradient(values, times) if len(times) > 1 else np.zeros_like(values)
