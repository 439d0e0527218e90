"""What explains wrong innovations: measurement models with one known fault each, and constant errors of a sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask, Scan
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import Finding
from trackbench.subjects.doctor.probes import rotation
from trackbench.subjects.doctor.trial import Trial

DEGREE = 180.0 / np.pi

#: Fault, description, and the azimuth that the wrong model gives for the right one.
AZIMUTHS: tuple[tuple[str, str, Callable[[float], float]], ...] = (
    ("arctan_quadrant", "azimuths behind the sensor are predicted ahead of it", lambda a: np.arctan(np.tan(a))),
    ("axis_mirrored", "the azimuth is measured clockwise", lambda a: -a),
    ("axis_mirrored", "the x axis points backward", lambda a: np.pi - a),
    ("axis_swapped", "the azimuth is measured from the y axis", lambda a: np.pi / 2 - a),
    ("degrees_for_radians", "the azimuth is predicted in degrees", lambda a: a * DEGREE),
    ("degrees_for_radians", "the azimuth in radians is converted to radians again", lambda a: a / DEGREE),
)

#: What is subtracted from the range rate over ground for the sensor's own velocity ``(2,)``, by its yaw and the line of
#: sight ``(2,)``.
EGO_VELOCITIES: tuple[tuple[str, Callable[[Array, float, Array], float]], ...] = (
    ("the sensor's own velocity is added to the target's", lambda v, _, sight: -float(v @ sight)),
    (
        "the sensor's own velocity counts along its boresight, not along the line of sight",
        lambda v, yaw, _: float(v @ rotation(yaw)[:, 0]),
    ),
    ("the sensor's own speed is subtracted from the range rate", lambda v, *_: float(np.hypot(*v))),
    ("the sensor's own speed is added to the range rate", lambda v, *_: -float(np.hypot(*v))),
    (
        "the sensor's own velocity is turned into its frame, and the line of sight is not",
        lambda v, yaw, sight: float((rotation(-yaw) @ v) @ sight),
    ),
    (
        "the sensor's own velocity is turned by its yaw, and is in the fixed frame already",
        lambda v, yaw, sight: float((rotation(yaw) @ v) @ sight),
    ),
)


class WrongModel(NamedTuple):
    """A measurement model with one known fault."""

    fault: str
    description: str
    """What the tracker does."""
    measure: Callable[[Array, Scan], Array]
    """The predicted measurement ``(m,)`` of a target ``(4,)`` at a scan."""


def wrong_models(kind: str) -> Iterator[WrongModel]:
    """The wrong models of a kind of sensor, simple ones first."""
    if kind == "lidar":
        rotated = "x and y are swapped, and one has the other sign"
        for fault, description, order, signs in (
            ("axis_swapped", "x and y are swapped", -1, [1, 1]),
            ("axis_mirrored", "y has the other sign", 1, [1, -1]),
            ("axis_mirrored", "x has the other sign", 1, [-1, 1]),
            ("axis_swapped", rotated, -1, [1, -1]),
            ("axis_swapped", rotated, -1, [-1, 1]),
        ):
            yield WrongModel(fault, description, partial(_reordered, order=order, signs=signs))
    if kind == "radar":
        description = "the range rate has the other sign"
        yield WrongModel("doppler_sign", description, partial(_reordered, order=1, signs=[1, 1, -1]))
        for relative, signed in product((False, True), repeat=2):
            description = "the range rate is predicted as the speed" + " with the sign of the range rate" * signed
            yield WrongModel("speed_for_range_rate", description, partial(_speed, relative=relative, signed=signed))
        description = "the range rate leaves out the sensor's own velocity"
        yield WrongModel("ego_motion_ignored", description, partial(_posed, pose=(1, 1, 1), velocity=0))
        for description, own in EGO_VELOCITIES:
            yield WrongModel("ego_motion_wrong", description, partial(_rated, own=own))
    for fixed in (False, True) if kind != "lidar" else ():
        for fault, description, change in AZIMUTHS:
            yield WrongModel(fault, description, partial(_azimuth, change=change, fixed=fixed))
    for description, pose, velocity in (
        ("the sensor's pose is left out", (0, 0, 0), 1),
        ("the sensor's position is left out", (0, 0, 1), 1),
        ("the sensor's yaw is left out", (1, 1, 0), 1),
        ("the sensor's pose and velocity are left out", (0, 0, 0), 0),
        ("the sensor's position and velocity are left out", (0, 0, 1), 0),
        ("the sensor's yaw and velocity are left out", (1, 1, 0), 0),
    ):
        yield WrongModel("ego_motion_ignored", description, partial(_posed, pose=pose, velocity=velocity))
    for description, pose in (
        ("the sensor's position has the wrong sign", (-1, -1, 1)),
        ("the sensor's yaw has the wrong sign", (1, 1, -1)),
        ("the sensor's yaw is applied twice", (1, 1, 2)),
    ):
        yield WrongModel("ego_motion_wrong", description, partial(_posed, pose=pose, velocity=1))
    description = "the sensor's position is subtracted after the turn into its frame"
    yield WrongModel("ego_motion_wrong", description, _turned_first)
    for description, factor in (("in degrees", DEGREE), ("converted to radians twice", 1 / DEGREE)):
        measure = partial(_posed, pose=(1, 1, factor), velocity=1)
        yield WrongModel("degrees_for_radians", f"the sensor's yaw is {description}", measure)


def right_measurement(target: Array, scan: Scan) -> Array:
    """``(m,)`` by the right model."""
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _reordered(target: Array, scan: Scan, order: int, signs: list[int]) -> Array:
    return right_measurement(target, scan)[::order] * signs


def _azimuth(target: Array, scan: Scan, change: Callable[[float], float], fixed: bool) -> Array:
    """The azimuth changed in the sensor's frame, or in the fixed frame before the yaw is subtracted."""
    z, yaw = right_measurement(target, scan).copy(), scan.sensor_pose[2] if fixed else 0.0
    z[1] = change(float(z[1] + yaw)) - yaw
    return z


def _posed(target: Array, scan: Scan, pose: tuple[float, float, float], velocity: float) -> Array:
    """With the sensor's pose and velocity multiplied by factors."""
    pose_used, velocity_used = scan.sensor_pose * np.array(pose, dtype=float), scan.sensor_velocity * velocity
    return SENSOR_MODELS[scan.kind].measure(target, pose_used, velocity_used)


def _speed(target: Array, scan: Scan, relative: bool, signed: bool) -> Array:
    z = right_measurement(target, scan).copy()
    speed = float(np.hypot(*(target[2:] - (scan.sensor_velocity if relative else 0.0))))
    z[2] = np.copysign(speed, z[2]) if signed else speed
    return z


def _rated(target: Array, scan: Scan, own: Callable[[Array, float, Array], float]) -> Array:
    """With another share of the sensor's velocity in the range rate."""
    still = scan._replace(sensor_velocity=np.zeros(2))
    z = right_measurement(target, still).copy()
    sight = target[:2] - scan.sensor_pose[:2]
    z[2] -= own(scan.sensor_velocity, float(scan.sensor_pose[2]), sight / max(float(np.hypot(*sight)), 1e-9))
    return z


def _turned_first(target: Array, scan: Scan) -> Array:
    """A position that is turned about the origin of the fixed frame, and then moved."""
    pose = scan.sensor_pose.copy()
    pose[:2] = rotation(float(pose[2])) @ pose[:2]
    return SENSOR_MODELS[scan.kind].measure(target, pose, scan.sensor_velocity)


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
    bias = np.median(offsets, axis=0)
    candidates = (
        SystematicFit("sensor_bias", np.tile(bias, (len(offsets), 1)), bias),
        _scale(known, offsets),
        _time(known, offsets),
    )
    fits = [fit for fit in candidates if _good(fit, offsets, sigma, clear)]
    if not fits:
        return None
    best = min(fits, key=lambda fit: float(np.sum(_spread(fit, offsets, sigma) ** 2)))
    text, confidence, factor = _evidence(sensor, known, best, offsets, clear)
    return Finding(best.fault, confidence, text, sensor=sensor, factor=factor)


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
    mean = trial.prediction.mean
    ahead, behind = (
        right_measurement(mean + np.array([*side * SHORT * mean[2:], 0.0, 0.0]), trial.scan) for side in (0.5, -0.5)
    )
    return np.asarray(difference(ahead, behind, SENSOR_MODELS[trial.scan.kind].angular) / SHORT)


def _spread(fit: SystematicFit, offsets: Array, sigma: Array) -> Array:
    """``(m,)`` median distance of the offsets from the fit, in sigma."""
    return np.asarray(np.median(np.abs(offsets - fit.offsets), axis=0) / sigma)


def _off(fit: SystematicFit, sigma: Array, clear: float) -> Mask:
    """``(m,)`` which components are off, in the median of the trials."""
    return np.asarray(np.median(np.abs(fit.offsets), axis=0) > clear * sigma)


def _good(fit: SystematicFit, offsets: Array, sigma: Array, clear: float) -> bool:
    allowed = SPREAD + SHARE * np.median(np.abs(fit.offsets), axis=0) / sigma
    return bool(_off(fit, sigma, clear).any()) and not np.any(_spread(fit, offsets, sigma) > allowed)


def _evidence(
    sensor: str, trials: Sequence[Trial], fit: SystematicFit, offsets: Array, clear: float
) -> tuple[str, float, float | None]:
    """The evidence for a fit, its confidence and its factor."""
    model, sigma = SENSOR_MODELS[trials[0].scan.kind], trials[0].sigma
    off = np.flatnonzero(_off(fit, sigma, clear))
    names = [model.components[i].replace("_", " ") for i in off]
    around = f"(spread {np.max(_spread(fit, offsets, sigma)[off]):.2g} sigma over {len(offsets)} trials)"
    if fit.fault == "scale_error":
        factors = [1.0 / (1.0 + fit.size[i]) for i in off]
        parts = ", ".join(f"{name} times {factor:.4g}" for name, factor in zip(names, factors, strict=True))
        return f"the tracker takes the measurements of {sensor} as {parts} {around}", 0.92, factors[0]
    if fit.fault == "time_offset":
        delay = float(fit.size[0])
        when = "after" if delay > 0.0 else "before"
        text = (
            f"a measurement of {sensor} has no innovation where the target is {1e3 * abs(delay):.2g} ms {when} the "
            f"time of the scan {around}"
        )
        return text, 0.92, None
    parts = ", ".join(
        f"{name} {fit.size[i]:+.3g} {'rad' if i in model.angular else 'm or m/s'}"
        for name, i in zip(names, off, strict=True)
    )
    return f"the predicted measurement has a constant bias: {parts} {around}", 0.9, None
