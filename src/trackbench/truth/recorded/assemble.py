"""A recorded drive on one grid of times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array, Observer, RecordedMeasurements, Truth
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.truth.config import FixedObserver, RecordingOptions
from trackbench.truth.recorded.drive import Cycles, Drive, Log, Motion, cycles


def truth(config: RecordingOptions, drive: Drive, times: Array) -> Truth:
    """The motion of all objects at ``times``, between the recorded instants by linear interpolation.

    Args:
        config: the scenario's.
        drive: what the files say.
        times: ``(steps,)`` s, increasing.
    """
    motions = drive.motions
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
        observer=fixed(config.observer, len(times)) if drive.observer is None else carrier(drive.observer, times),
        source={"source": "recording", "format": config.format, "recorded": list(drive.logs), **drive.source},
    )


def scan_cycles(drive: Drive) -> dict[str, Cycles]:
    """When each sensor looked, by name."""
    return {name: cycles(log.time, log.object, log.scans) for name, log in drive.logs.items()}


def grid(drive: Drive, looked: Mapping[str, Cycles]) -> Array:
    """All times of the truth's rows and of the scans, each once and in order, as far as the observer is known.

    Raises:
        InputError: the observer is known at none of them.
    """
    times = np.unique(
        np.concatenate([m.time for m in drive.motions.values()] + [found.instants for found in looked.values()])
    )
    if drive.observer is None:
        return times
    first, last = float(drive.observer.time[0]), float(drive.observer.time[-1])
    known = times[(times >= first) & (times <= last)]
    if not len(known):
        span = f"from {times[0]:g} to {times[-1]:g} s"
        message = f"it is known from {first:g} to {last:g} s, and the truth {span}: check the units of time"
        raise InputError(message, key="truth.columns.observer")
    return np.asarray(known)


def measurements(log: Log, kind: str, looked: Cycles, times: Array, objects: int) -> RecordedMeasurements:
    """A sensor's measurements by scan and object, its angles wrapped to (-pi, pi].

    Args:
        log: at most one row for each time and object.
        kind: of the sensor.
        looked: when it looked.
        times: ``(steps,)`` those of the truth, with all of the log's among them.
        objects: how many there are.
    """
    model = SENSOR_MODELS[kind]
    there = (looked.instants >= times[0]) & (looked.instants <= times[-1])
    instants = looked.instants[there]
    measurement = np.full((len(model.components), len(instants), objects), np.nan)
    measurement[:, np.searchsorted(instants, log.time), log.object] = log.measurement
    for i in model.angular:
        measurement[i] = wrap_angle(measurement[i])
    valid = np.isfinite(measurement).all(axis=0)
    return RecordedMeasurements(np.searchsorted(times, instants), measurement, valid, looked.cycle[there])


def left_out(drive: Drive, clipped: Drive) -> dict[str, dict[str, int]]:
    """How many rows of the truth and of each sensor were put in order or left out; what did not occur is not named."""
    seen = drive.observer
    unknown = (
        0
        if seen is None
        else sum(int(((m.time < seen.time[0]) | (m.time > seen.time[-1])).sum()) for m in drive.motions.values())
    )
    found = {
        "truth": {
            "out_of_order": drive.order.backwards,
            "duplicates": drive.order.duplicates,
            "outside_observer": unknown,
        }
    }
    for name, log in drive.logs.items():
        found[name] = {
            "out_of_order": log.order.backwards,
            "duplicates": log.order.duplicates,
            "outside_truth": len(log.time) - len(clipped.logs[name].time),
        }
    counts = {name: {what: count for what, count in of.items() if count} for name, of in found.items()}
    return {name: of for name, of in counts.items() if of}


def notes(drive: Drive, counts: Mapping[str, Mapping[str, int]]) -> Iterator[str]:
    """A line for the truth and each sensor whose rows were put in order or left out."""
    words = {
        "out_of_order": "out of the order of time (sorted)",
        "duplicates": "of an object and a time that came before (left out)",
        "outside_truth": "outside the time of the truth (left out)",
        "outside_observer": "outside the time of the observer (left out)",
    }
    for name, of in counts.items():
        rows = drive.order.rows if name == "truth" else drive.logs[name].order.rows
        said = ", ".join(f"{count} {words[what]}" for what, count in of.items())
        yield f"{name}: of {counted(rows, 'row')}, {said}"


def require_measurements(drive: Drive, clipped: Drive) -> None:
    """Make sure that every sensor has a measurement within the time of the truth.

    Raises:
        InputError: one has none.
    """
    spans = [drive.span(number) for number in range(len(drive.motions))]
    for name, log in drive.logs.items():
        if len(clipped.logs[name].time):
            continue
        if drive.observer is not None and all(first > last for first, last in spans):
            grid(drive, {})
        known = f"from {min(first for first, _ in spans):g} to {max(last for _, last in spans):g} s"
        own = f"from {log.time[0]:g} to {log.time[-1]:g} s"
        message = f"no measurement of {name} ({own}) lies within the time of its object's truth ({known})"
        raise InputError(f"{message}: check the units of time", key=f"truth.readings.{name}")


def fixed(observer: FixedObserver, steps: int) -> Observer:
    """A point at rest."""
    at_rest = np.zeros(steps)
    yaw = np.deg2rad(observer.yaw_deg)
    return Observer(at_rest + observer.x, at_rest + observer.y, at_rest + yaw, at_rest, at_rest, at_rest)


def carrier(motion: Motion, times: Array) -> Observer:
    """A recorded observer at ``times``; its heading is interpolated the short way round."""
    assert motion.heading is not None
    yaw = np.unwrap(motion.heading)
    rate = _slope(yaw, motion.time) if motion.yaw_rate is None else motion.yaw_rate

    def at(values: Array) -> Array:
        return np.interp(times, motion.time, values)

    return Observer(at(motion.px), at(motion.py), at(yaw), at(motion.vx), at(motion.vy), at(rate))


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
