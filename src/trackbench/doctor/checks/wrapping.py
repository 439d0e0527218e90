"""Is every angle wrapped where it passes pi?

If the target, the prediction and the measurement are turned about the sensor, the estimate must turn with them. It does
not where an angle at pi is not wrapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.doctor.checks.expectation import ZERO
from trackbench.doctor.exhibits import Gaussian, Predictions
from trackbench.doctor.findings import CheckResult, Finding, PartResult
from trackbench.doctor.probes import Probe
from trackbench.doctor.right_answers import named
from trackbench.doctor.session import StepFailed, TrackerSession
from trackbench.doctor.tracker_under_test import TrackerUnderTest
from trackbench.doctor.trial import Trial
from trackbench.doctor.turned import TURNS, turned_mounting
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.types import Array
from trackbench.units import wrap_angle

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
#: Error of the velocity after 3 s without noise, as a share of the speed, of a target that is as good as lost, and the
#: least ratio to that of the turned target.
ASTRAY, WORSE = 0.05, 5.0
#: Angle from pi of the targets that are tried, rad; those of other sensors' sites are elsewhere.
NEAR_PI = 0.02
#: The same error from which on the track has diverged: a wrong course, of any speed that is about right, has up to 2.
DIVERGED = 5.0
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
    """Whether the update is right where the same target is seen by a sensor mounted at another yaw."""
    exhibit: Predictions | None = None
    innovation: float = np.nan
    """That of the predicted azimuth, in standard deviations of the measurement."""


def wrapping(tracker: TrackerUnderTest) -> PartResult:
    """Try measurements beside a target at the azimuth pi, and beside one with the course pi."""
    result = PartResult()
    polar = [name for name, sensor in tracker.sensors.items() if sensor.type != "lidar"]
    for angle, probes, sensors in (
        ("azimuth", tracker.probes.axes, polar),
        ("course", (tracker.probes.course_axis,), tracker.sensors),
    ):
        if not sensors:
            continue
        question = f"Is the update of a target with the {angle} pi the same as with any other?"
        jumps = [
            jump
            for probe in probes
            for name in sensors
            if angle == "course" or _at_pi(tracker, probe, name)
            for sensor_set in tracker.sensor_sets()
            for jump in _jumps(tracker, probe, name, sensor_set, angle == "azimuth")
        ]
        if angle == "course":
            jumps += [astray for of in tracker.sensor_sets() if (astray := _astray(tracker, probes[0], of)) is not None]
        if not jumps:
            result.checks.append(CheckResult(f"{angle}_wrapping", question, None, "there was no estimate to update"))
            continue
        worst = max(jumps, key=lambda jump: jump.size)
        result.checks.append(CheckResult(f"{angle}_wrapping", question, worst.size < FAR, worst.text))
        if worst.size >= FAR:
            found = _course(worst) if angle == "course" else _azimuth([one for one in jumps if one.size >= FAR], worst)
            result.findings.append(found)
    return result


def _at_pi(tracker: TrackerUnderTest, probe: Probe, name: str) -> bool:
    """Whether the sensor sees the target near the azimuth pi."""
    return bool(np.pi - abs(probe.scan(name, tracker.sensors[name], 0.0).measurement[1]) < NEAR_PI)


def _course(worst: Jump) -> Finding:
    # Wrong gains are not turned with the target either.
    confidence = 0.97 if worst.size > 5 * FAR else 0.75
    # The drive on a circle passes the course pi; the probe's own has no other target.
    return Finding("course_not_wrapped", confidence, worst.text, shown_by="long_run", exhibit=worst.exhibit)


def _azimuth(jumps: Sequence[Jump], worst: Jump) -> Finding:
    confidence = 0.97 if worst.confirmed and worst.size > 5 * FAR else 0.85
    fault, text = "azimuth_not_wrapped", worst.text
    if any(jump.without_innovation for jump in jumps) and not any(jump.measured for jump in jumps):
        fault, confidence = "angle_mean_not_circular", 0.95
        text += "; where the prediction's own azimuths are all on one side of pi, it does not; the update by the "
        text += "predicted measurement differs too"
        if abs(worst.innovation) > FAR:
            text += f", and its azimuth has an innovation of {worst.innovation:+.3g} sigma"
    return Finding(fault, confidence, text, sensor=worst.sensor, shown_by=worst.probe.name, exhibit=worst.exhibit)


def _jumps(
    tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...], azimuth: bool
) -> list[Jump]:
    """The updates beside the target, each compared with that of the turned target."""
    away = probe.turned(TURN, tracker.sensors[name])
    here, turned = tracker.trial(probe, name, sensor_set), tracker.trial(away, name, sensor_set)
    # Where the other update is wrong, the two differ for another reason.
    if here is None or turned is None or not (here.usable and _right(turned, away)):
        return []
    found = [jump for side in SIDES if (jump := _jump(here, turned, _rotation(-TURN), side, probe)) is not None]
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


def _rotation(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _turns_differ(tracker: TrackerUnderTest, probe: Probe, turned: Trial, size: float) -> bool:
    """Whether the updates of two turned targets, whose courses are not near pi, differ like that of the probe: a wrong
    gain is not turned with the target either."""
    other = tracker.trial(
        probe.turned(OTHER_TURN, tracker.sensors[turned.scan.sensor]), turned.scan.sensor, turned.sensor_set
    )
    if other is None or not other.usable:
        return False
    jumps = (_jump(turned, other, _rotation(TURN - OTHER_TURN), side, probe) for side in SIDES)
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
        Gaussian("as of the same target turned away", mean, both @ other.covariance @ both.T),
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


def _astray(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> Jump | None:
    """A target that was followed without noise and has another velocity then, where turned targets have their own."""
    true, speed = probe.truth(0.0)[2:], float(np.hypot(*probe.target[2:]))
    here, error = _followed(tracker, probe, sensor_set)
    if here is None or not ASTRAY * speed <= error < DIVERGED * speed:
        return None
    usual, others = 0.0, []
    for turn in (TURN, OTHER_TURN):
        turned, of_turned = _followed(tracker, probe.turned(turn, tracker.sensors[sensor_set[0]]), sensor_set)
        usual = max(usual, of_turned)
        if turned is None or error < WORSE * usual:
            return None
        others.append(turned.prediction)
    vx, vy = here.prediction.mean[2:]
    text = (
        f"after 3 s of measurements without noise {probe.description} has the velocity {vx:.3g}, {vy:.3g} m/s, where "
        f"{true[0]:.3g}, {true[1]:.3g} is right; that of the same target turned away is right to {usual:.2g} m/s"
    )
    both = np.kron(np.eye(2), np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]]))
    shown = Predictions(
        f"After 3 s of measurements without noise: {probe.description}",
        None,
        named("tracker", here.prediction),
        Gaussian(
            "the same target turned away",
            both @ others[0].mean,
            both @ others[0].covariance @ both.T,
        ),
    )
    return Jump(6 * FAR * error / (ASTRAY * speed), text, sensor_set[0], probe, False, False, False, shown)


def _followed(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> tuple[Trial | None, float]:
    """The trial of a target, and the error of its velocity; its speed where that is not a number, m/s."""
    trial = tracker.trial(probe, sensor_set[0], sensor_set)
    if trial is None:
        return None, np.inf
    error = float(np.hypot(*(trial.prediction.mean - probe.truth(0.0))[2:]))
    return trial, error if np.isfinite(error) else float(np.hypot(*probe.target[2:]))


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
