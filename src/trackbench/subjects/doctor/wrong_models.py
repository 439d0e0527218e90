"""What explains wrong innovations: models with a known fault, and constant errors of a sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask, Scan
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import Finding
from trackbench.subjects.doctor.right_answers import measurement_shown
from trackbench.subjects.doctor.trial import Trial

DEGREE = 180.0 / np.pi

Measure = Callable[[Array, Scan], Array]

#: Fault, description, and the azimuth that the wrong model gives for the right one.
AZIMUTHS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("arctan_quadrant", "azimuths behind the sensor are predicted ahead of it", lambda a: np.arctan(np.tan(a))),
    ("axis_mirrored", "the azimuth is measured clockwise", lambda a: -a),
    ("axis_mirrored", "the x axis points backward", lambda a: np.pi - a),
    ("axis_swapped", "the azimuth is measured from the y axis", lambda a: np.pi / 2 - a),
    ("degrees_for_radians", "the azimuth is predicted in degrees", lambda a: a * DEGREE),
    ("degrees_for_radians", "the azimuth in radians is converted to radians again", lambda a: a / DEGREE),
)


class WrongModel(NamedTuple):
    """A measurement model with one known fault."""

    fault: str
    description: str
    """What the tracker does."""
    measure: Measure
    """The predicted measurement ``(m,)`` of a target ``(4,)`` at a scan."""


def wrong_models(kind: str) -> list[WrongModel]:
    """The wrong models of a kind of sensor, simple ones first."""
    return [*(_lidar() if kind == "lidar" else _polar(kind)), *_posed()]


def _right(target: Array, scan: Scan) -> Array:
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _changed(change: Callable[[Array], Array]) -> Measure:
    return lambda target, scan: change(_right(target, scan))


def _azimuth(change: Callable[[float], float], fixed: bool = False) -> Measure:
    """The azimuth changed in the sensor's frame, or in the fixed frame before the yaw is subtracted."""

    def measure(target: Array, scan: Scan) -> Array:
        z, yaw = _right(target, scan).copy(), scan.sensor_pose[2] if fixed else 0.0
        z[1] = change(float(z[1] + yaw)) - yaw
        return z

    return measure


def _polar(kind: str) -> Iterator[WrongModel]:
    if kind == "radar":
        yield WrongModel("doppler_sign", "the range rate has the other sign", _changed(lambda z: z * [1, 1, -1]))
        for relative in (False, True):
            yield WrongModel("speed_for_range_rate", "the range rate is predicted as the speed", _speed(relative))
        yield WrongModel("ego_motion_ignored", "the range rate leaves out the sensor's own velocity", _at_rest)
    for fixed in (False, True):
        for fault, description, change in AZIMUTHS:
            yield WrongModel(fault, description, _azimuth(change, fixed))


def _lidar() -> Iterator[WrongModel]:
    yield WrongModel("axis_swapped", "x and y are swapped", _changed(lambda z: z[::-1]))
    yield WrongModel("axis_mirrored", "y has the other sign", _changed(lambda z: z * [1, -1]))
    yield WrongModel("axis_mirrored", "x has the other sign", _changed(lambda z: z * [-1, 1]))
    rotated = "x and y are swapped, and one has the other sign"
    yield WrongModel("axis_swapped", rotated, _changed(lambda z: z[::-1] * [1, -1]))
    yield WrongModel("axis_swapped", rotated, _changed(lambda z: z[::-1] * [-1, 1]))


def _posed() -> Iterator[WrongModel]:
    """Faults in the use of the sensor's pose and velocity."""
    still, standing = np.zeros(2), np.ones(2)
    for description, keep_pose, keep_velocity in (
        ("the sensor's pose is left out", (0, 0, 0), standing),
        ("the sensor's position is left out", (0, 0, 1), standing),
        ("the sensor's yaw is left out", (1, 1, 0), standing),
        ("the sensor's pose and velocity are left out", (0, 0, 0), still),
        ("the sensor's position and velocity are left out", (0, 0, 1), still),
        ("the sensor's yaw and velocity are left out", (1, 1, 0), still),
    ):
        yield WrongModel("ego_motion_ignored", description, _scaled(np.array(keep_pose, dtype=float), keep_velocity))
    for description, factor in (("in degrees", DEGREE), ("converted to radians twice", 1 / DEGREE)):
        yield WrongModel(
            "degrees_for_radians", f"the sensor's yaw is {description}", _scaled(np.array([1, 1, factor]), np.ones(2))
        )


def _scaled(pose: Array, velocity: Array) -> Measure:
    return lambda target, scan: SENSOR_MODELS[scan.kind].measure(
        target, scan.sensor_pose * pose, scan.sensor_velocity * velocity
    )


def _at_rest(target: Array, scan: Scan) -> Array:
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, np.zeros(2))


def _speed(relative: bool) -> Measure:
    def measure(target: Array, scan: Scan) -> Array:
        z = _right(target, scan).copy()
        z[2] = float(np.hypot(*(target[2:] - (scan.sensor_velocity if relative else 0.0))))
        return z

    return measure


#: Share of the trials in which the measurement without an innovation has to be found.
MOST = 0.85
#: Distance from the fitted error in the median of the trials, in standard deviations of the measurement, and besides
#: as a share of that error.
SPREAD, SHARE = 0.5, 0.1
#: Time over which a target's measurement is differentiated, s.
SHORT = 1e-3


class SystematicFit(NamedTuple):
    """The offsets of all trials by one kind of error."""

    fault: str
    offsets: Array
    """``(trials, m)``"""
    size: Array
    """``(m,)`` the bias, the factor less 1, or the time in s of all components."""


def systematic_error(sensor: str, trials: Sequence[Trial], clear: float) -> Finding | None:
    """The kind of error that fits best what measurements have no innovation.

    Args:
        sensor: its name.
        trials: of that sensor.
        clear: offset of a component that is one, in standard deviations of the measurement.
    """
    pairs = [(trial, offset) for trial in trials if (offset := trial.offset()) is not None]
    if len(pairs) < MOST * len(trials):
        return None
    known, offsets = [trial for trial, _ in pairs], np.array([offset for _, offset in pairs])
    sigma = known[0].sigma
    fits = [
        fit
        for fit in (_bias(offsets), _scale(known, offsets), _time(known, offsets))
        if _good(fit, offsets, sigma, clear)
    ]
    if not fits:
        return None
    best = min(fits, key=lambda fit: float(np.sum(_spread(fit, offsets, sigma) ** 2)))
    clearest = int(np.argmax(np.max(np.abs(offsets) / sigma, axis=1)))
    exhibit = measurement_shown(known[clearest], known[clearest].predicted_measurement + offsets[clearest], clear)
    return replace(_finding(sensor, known, best, offsets, clear), exhibit=exhibit)


def _bias(offsets: Array) -> SystematicFit:
    middle = np.median(offsets, axis=0)
    return SystematicFit("sensor_bias", np.tile(middle, (len(offsets), 1)), middle)


def _scale(trials: Sequence[Trial], offsets: Array) -> SystematicFit:
    """By least squares; an angle has no scale."""
    predicted = np.array([trial.predicted_measurement for trial in trials])
    factor = np.sum(offsets * predicted, axis=0) / np.maximum(np.sum(predicted**2, axis=0), 1e-12)
    factor[list(SENSOR_MODELS[trials[0].scan.kind].angular)] = 0.0
    return SystematicFit("scale_error", factor * predicted, factor)


def _time(trials: Sequence[Trial], offsets: Array) -> SystematicFit:
    """By least squares of all components, each in its standard deviations."""
    rates = np.array([_rate(trial) for trial in trials])
    weighted = rates / trials[0].sigma ** 2
    delay = float(np.sum(offsets * weighted) / max(np.sum(rates * weighted), 1e-12))
    return SystematicFit("time_offset", delay * rates, np.full(offsets.shape[1], delay))


def _rate(trial: Trial) -> Array:
    """``(m,)`` change of the measurement by the target's motion, per second."""
    model, scan, mean = SENSOR_MODELS[trial.scan.kind], trial.scan, trial.prediction.mean
    ahead, behind = (
        model.measure(mean + np.array([*side * SHORT * mean[2:], 0.0, 0.0]), scan.sensor_pose, scan.sensor_velocity)
        for side in (0.5, -0.5)
    )
    return np.asarray(difference(ahead, behind, model.angular) / SHORT)


def _spread(fit: SystematicFit, offsets: Array, sigma: Array) -> Array:
    """``(m,)`` median distance of the offsets from the fit, in sigma."""
    return np.asarray(np.median(np.abs(offsets - fit.offsets), axis=0) / sigma)


def _off(fit: SystematicFit, sigma: Array, clear: float) -> Mask:
    """``(m,)`` which components are off, in the median of the trials."""
    return np.asarray(np.median(np.abs(fit.offsets), axis=0) > clear * sigma)


def _good(fit: SystematicFit, offsets: Array, sigma: Array, clear: float) -> bool:
    allowed = SPREAD + SHARE * np.median(np.abs(fit.offsets), axis=0) / sigma
    return bool(_off(fit, sigma, clear).any()) and not np.any(_spread(fit, offsets, sigma) > allowed)


def _finding(sensor: str, trials: Sequence[Trial], fit: SystematicFit, offsets: Array, clear: float) -> Finding:
    model, sigma = SENSOR_MODELS[trials[0].scan.kind], trials[0].sigma
    off = np.flatnonzero(_off(fit, sigma, clear))
    names = [model.components[i].replace("_", " ") for i in off]
    around = f"(spread {np.max(_spread(fit, offsets, sigma)[off]):.2g} sigma over {len(offsets)} trials)"
    if fit.fault == "scale_error":
        factors = [1.0 / (1.0 + fit.size[i]) for i in off]
        parts = ", ".join(f"{name} times {factor:.4g}" for name, factor in zip(names, factors, strict=True))
        text = f"the tracker takes the measurements of {sensor} as {parts} {around}"
        return Finding(fit.fault, 0.92, text, sensor=sensor, factor=factors[0])
    if fit.fault == "time_offset":
        delay = float(fit.size[0])
        when = "after" if delay > 0.0 else "before"
        text = (
            f"a measurement of {sensor} has no innovation where the target is {1e3 * abs(delay):.2g} ms {when} the "
            f"time of the scan {around}"
        )
        return Finding(fit.fault, 0.92, text, sensor=sensor)
    parts = ", ".join(
        f"{name} {fit.size[i]:+.3g} {'rad' if i in model.angular else 'm or m/s'}"
        for name, i in zip(names, off, strict=True)
    )
    return Finding(
        "sensor_bias", 0.9, f"the predicted measurement has a constant bias: {parts} {around}", sensor=sensor
    )
