"""Updates of a target near the axis, held against those of the same target turned away.

If the target, the prediction and the measurement are turned about the sensor, the estimate must turn with them. It does
not where an angle at pi is not wrapped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.exhibits import Predictions, StatedBelief
from trackbench.subjects.doctor.probes import TURNS, Probe, rotation, turned_mounting
from trackbench.subjects.doctor.right_answers import named
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import ZERO, Trial

#: Difference from the estimate of the turned target that is a fault, in standard deviations of the prediction.
FAR = 3.0
#: The gain counts as lost where the difference is more than the share `LOST` of the turned target's update, if that is
#: more than `CLEAR` standard deviations.
LOST, CLEAR = 0.5, 0.6
#: Difference of logarithms below which two variances count as equal.
EQUAL = 0.2
PARTS = (slice(0, 2), slice(2, 4))
#: Error of a turned target's position from which on nothing is compared with it, m.
NEAR = 1.0
#: Difference of two covariances after an update that rounding does not explain, relative to the predicted variances.
SPREAD = 1e-3
#: Measurements tried beside the predicted one, standard deviations.
SIDES = (-2.0, 2.0)
#: Standard deviations of the predicted azimuth within which all sigma points lie; those of the measurement by which it
#: is beyond pi, where a prediction is so far from it.
SPREAD_OVER, BEYOND = 5.0, 2.0
#: Angles by which the target is turned, rad: no angle is near pi then.
TURN, OTHER_TURN = -1.2, 1.9
#: Share of a jump which the two turned targets may differ by.
ALIKE = 0.2


class Jump(NamedTuple):
    """An update that is not turned with the target."""

    size: float
    """Of the difference, in standard deviations of the prediction."""
    text: str
    sensor: str
    probe: Probe
    measured: bool
    """Whether only the measurement is on the other side of pi."""
    without_innovation: bool
    """Whether the update by the predicted measurement differs too."""
    confirmed: bool
    """Whether the update is right where the same target is seen by a sensor mounted at another yaw, or by a measurement
    before pi."""
    exhibit: Predictions | None = None
    innovation: float = np.nan
    """That of the predicted azimuth, in standard deviations of the measurement."""


def jumps_of(
    tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...], azimuth: bool
) -> list[Jump]:
    """The updates beside the target, each compared with that of the turned target."""
    away = probe.turned(TURN, tracker.sensors[name])
    here, turned = tracker.trial(probe, name, sensor_set), tracker.trial(away, name, sensor_set)
    # Where the other update is wrong, the two differ for another reason.
    if here is None or turned is None or not (here.usable and _right(turned, away)):
        return []
    found = [jump for side in SIDES if (jump := _jump(here, turned, rotation(-TURN), side, probe)) is not None]
    if all(jump.size < FAR for jump in found):
        return found
    if not azimuth:
        return [] if _turns_differ(tracker, probe, turned, max(jump.size for jump in found)) else found
    mounted = _mounted(tracker, probe, name, sensor_set)
    if mounted is None or not _right(mounted, probe):
        return found
    moved = _moved(here, mounted)
    again = [_jump(here, mounted, np.eye(2), side, probe) for side in SIDES]
    return [
        jump._replace(
            measured=jump.measured and not moved,
            without_innovation=moved,
            confirmed=True,
            innovation=_azimuth_innovation(here),
        )
        for jump in again
        if jump is not None
    ]


def beyond_pi(tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...]) -> Jump | None:
    """The update by a measurement beyond pi, of the target turned so far that all of its own azimuths are before it."""
    trial, sensor = tracker.trial(probe, name, sensor_set), tracker.sensors[name]
    if trial is None or not trial.usable:
        return None
    row, side = trial.jacobian[1], np.sign(trial.predicted_measurement[1])
    margin = SPREAD_OVER * float(np.sqrt(row @ trial.prediction.covariance @ row))
    before = probe.turned(-side * margin, sensor)
    away = before.turned(TURN, sensor)
    here, turned = tracker.trial(before, name, sensor_set), tracker.trial(away, name, sensor_set)
    if here is None or turned is None or not (_right(here, before) and _right(turned, away)):
        return None
    jump = _jump(here, turned, rotation(-TURN), side * (margin / trial.sigma[1] + BEYOND), probe)
    return None if jump is None else jump._replace(confirmed=True)


def _turns_differ(tracker: TrackerUnderTest, probe: Probe, turned: Trial, size: float) -> bool:
    """Whether the updates of two turned targets, whose courses are not near pi, differ like that of the probe: a wrong
    gain is not turned with the target either."""
    other = tracker.trial(
        probe.turned(OTHER_TURN, tracker.sensors[turned.scan.sensor]), turned.scan.sensor, turned.sensor_set
    )
    if other is None or not other.usable:
        return False
    jumps = (_jump(turned, other, rotation(TURN - OTHER_TURN), side, probe) for side in SIDES)
    return any(jump is not None and jump.size > ALIKE * size for jump in jumps)


def _mounted(tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...]) -> Trial | None:
    """The same target, seen by sensors that are mounted at another yaw: away from pi."""
    angle = TURNS[1]
    session = TrackerSession(tracker.make)
    try:
        for scan in tracker.approach(probe, sensor_set):
            session.step(turned_mounting(scan, angle))
        scan = turned_mounting(probe.scan(name, tracker.sensors[name], 0.0), angle)
        prediction = session.predict(scan)
    except StepFailed:
        return None
    return None if prediction is None else Trial(probe.name, probe.description, scan, prediction, session)


def _right(trial: Trial, probe: Probe) -> bool:
    """Whether the estimate is at the target, and the predicted azimuth has no innovation."""
    if not trial.usable or np.hypot(*(trial.prediction.mean - probe.truth(0.0))[:2]) > NEAR:
        return False
    update = trial.update(trial.predicted_measurement)
    angular = list(SENSOR_MODELS[trial.scan.kind].angular)
    return update is not None and bool(np.all(np.nan_to_num(np.abs(update.innovation[angular])) < ZERO))


def _jump(here: Trial, turned: Trial, back: Array, side: float, probe: Probe) -> Jump | None:
    """``back`` ``(2, 2)`` turns positions and velocities of the turned target back."""
    change, other = _change(here, side), _change(turned, side)
    if change is None or other is None:
        return None
    both: Array = np.asarray(np.kron(np.eye(2), back))
    apart = np.abs(change - both @ other) / here.state_sigma
    usual = np.abs(both @ other) / here.state_sigma
    size = float(np.max(apart))
    lost = size > LOST * float(np.max(usual)) > LOST * CLEAR and _equally_certain(here, turned)
    centre, beside = here.predicted_measurement, _beside(here, side)
    angular = list(SENSOR_MODELS[here.scan.kind].angular)
    measured = bool(np.any(np.abs(beside[angular] - centre[angular]) > np.pi))
    text = _text(here, side, size)
    shown = _shown(here, turned, both, side)
    return Jump(max(size, FAR) if lost else size, text, here.scan.sensor, probe, measured, False, False, shown)


def _shown(here: Trial, turned: Trial, both: Array, side: float) -> Predictions | None:
    """The update beside the target, and that of the turned target, turned back to it ``(4, 4)``."""
    after, other, centre = (
        here.posterior(_beside(here, side)),
        turned.posterior(_beside(turned, side)),
        turned.prediction,
    )
    if after is None or other is None:
        return None
    mean = here.prediction.mean + both @ (other.mean - centre.mean)
    return Predictions(
        f"Update with {here.scan.sensor}: {here.description}",
        named("before the measurement", here.prediction),
        named("tracker, after it", after),
        StatedBelief("as of the same target turned away", mean, both @ other.covariance @ both.T),
    )


def _moved(here: Trial, mounted: Trial) -> bool:
    """Whether the covariance after the predicted measurement depends on the yaw of the mounting."""
    one, other = here.posterior(here.predicted_measurement), mounted.posterior(mounted.predicted_measurement)
    if one is None or other is None:
        return True
    gap = (one.covariance - other.covariance) / np.outer(here.state_sigma, here.state_sigma)
    return float(np.abs(gap).max()) > SPREAD


def _azimuth_innovation(here: Trial) -> float:
    update = here.update(here.predicted_measurement)
    return np.nan if update is None else float(update.innovation[1])


def _equally_certain(one: Trial, other: Trial) -> bool:
    """Whether the predictions have similar variances, so that the gains can be compared."""
    ratios = (
        np.trace(one.prediction.covariance[part, part]) / np.trace(other.prediction.covariance[part, part])
        for part in PARTS
    )
    return all(abs(np.log(ratio)) < EQUAL for ratio in ratios)


def _change(trial: Trial, side: float) -> Array | None:
    """``(4,)`` the estimate after a measurement beside the predicted one, minus that after the predicted one."""
    estimate, centre = trial.posterior(_beside(trial, side)), trial.posterior(trial.predicted_measurement)
    return None if estimate is None or centre is None else estimate.mean - centre.mean


def _beside(trial: Trial, side: float) -> Array:
    """The predicted measurement moved by some standard deviations to the left, as seen from the sensor."""
    if trial.scan.kind != "lidar":
        measurement = trial.predicted_measurement.copy()
        measurement[1] = wrap_angle(measurement[1] + side * trial.sigma[1])
        return measurement
    dx, dy = trial.prediction.mean[:2] - trial.scan.sensor_pose[:2]
    left = side * trial.sigma[0] * np.array([-dy, dx, 0.0, 0.0]) / np.hypot(dx, dy)
    target, scan = trial.prediction.mean + left, trial.scan
    return SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)


def _text(trial: Trial, side: float, size: float) -> str:
    if trial.scan.kind == "lidar":
        course = np.arctan2(trial.prediction.mean[3], trial.prediction.mean[2])
        at = f"course {course:+.4f} rad, measurement {abs(side):g} sigma to the side"
    else:
        measured, predicted = _beside(trial, side)[1], trial.predicted_measurement[1]
        at = (
            f"predicted azimuth {predicted:+.4f} rad, measurement {measured:+.4f} rad, {abs(side):g} sigma apart "
            f"(plain difference {measured - predicted:+.4f})"
        )
    return f"{at}: the update differs by {size:.3g} of its standard deviations from that of the same target turned away"
