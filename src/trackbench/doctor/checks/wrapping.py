"""Is every angle wrapped where it passes pi?

If the target, the prediction and the measurement are turned about the sensor, the estimate must turn with them. It does
not where an angle at pi is not wrapped.
"""

from __future__ import annotations

import numpy as np

from trackbench.doctor.findings import CheckResult, Finding, PartResult
from trackbench.doctor.probes import Probe
from trackbench.doctor.tracker_under_test import TrackerUnderTest
from trackbench.doctor.trial import Trial
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
#: Error of the velocity after 3 s without noise, as a share of the speed, of a target that is as good as lost, and the
#: least ratio to that of the turned target.
ASTRAY, WORSE = 0.05, 5.0
#: The drive on a circle passes the course pi; a probe's drive has the azimuth pi.
SHOWN_BY = {"course_not_wrapped": "long_run"}
#: Angle by which the target is turned, rad: no angle is near pi then.
TURN = -1.2


def wrapping(tracker: TrackerUnderTest) -> PartResult:
    """Try measurements beside a target at the azimuth pi, and beside one with the course pi."""
    result = PartResult()
    polar = [name for name, sensor in tracker.sensors.items() if sensor.type != "lidar"]
    for angle, probes, sensors in (
        ("azimuth", tracker.probes.axes, polar),
        ("course", (tracker.probes.course_axis,), tracker.sensors),
    ):
        question = f"Is the update of a target with the {angle} pi the same as with any other?"
        jumps = [
            jump
            for probe in probes
            for name in sensors
            for sensor_set in tracker.sensor_sets()
            for jump in _jumps(tracker, probe, name, sensor_set)
        ]
        if angle == "course":
            jumps += [astray for of in tracker.sensor_sets() if (astray := _astray(tracker, probes[0], of)) is not None]
        if not jumps:
            result.checks.append(CheckResult(f"{angle}_wrapping", question, None, "there was no estimate to update"))
            continue
        size, text, sensor = max(jumps, key=lambda jump: jump[0])
        result.checks.append(CheckResult(f"{angle}_wrapping", question, size < FAR, text))
        if size >= FAR:
            confidence = 0.97 if size > 5 * FAR else 0.85
            fault = "azimuth_not_wrapped" if angle == "azimuth" else "course_not_wrapped"
            of = sensor if angle == "azimuth" else None
            finding = Finding(fault, confidence, text, sensor=of, shown_by=SHOWN_BY.get(fault, probes[0].name))
            result.findings.append(finding)
    return result


def _jumps(
    tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...]
) -> list[tuple[float, str, str]]:
    """Differences from the turned target's updates in standard deviations, each with its evidence and sensor."""
    here, turned = tracker.trial(probe, name, sensor_set), tracker.trial(probe.turned(TURN), name, sensor_set)
    if here is None or turned is None or not (here.usable and turned.usable):
        return []
    found = []
    for side in (-2.0, 2.0):
        change, other = _change(here, side), _change(turned, side)
        if change is None or other is None:
            continue
        c, s = np.cos(-TURN), np.sin(-TURN)
        back = np.kron(np.eye(2), np.array([[c, -s], [s, c]]))
        apart = np.abs(change - back @ other) / here.state_sigma
        usual = np.abs(back @ other) / here.state_sigma
        size = float(np.max(apart))
        lost = size > LOST * float(np.max(usual)) > LOST * CLEAR and _equally_certain(here, turned)
        found.append((max(size, FAR) if lost else size, _text(here, side, size), name))
    return found


def _astray(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> tuple[float, str, str] | None:
    """A target that was followed without noise and has another velocity then, where the turned target has its own."""
    turned = probe.turned(TURN)
    here, other = (tracker.trial(one, sensor_set[0], sensor_set) for one in (probe, turned))
    if here is None or other is None:
        return None
    true, speed = probe.truth(0.0)[2:], float(np.hypot(*probe.target[2:]))
    error = float(np.nan_to_num(np.hypot(*(here.prediction.mean[2:] - true)), nan=speed))
    usual = float(np.nan_to_num(np.hypot(*(other.prediction.mean - turned.truth(0.0))[2:]), nan=speed))
    if error < max(ASTRAY * speed, WORSE * usual):
        return None
    vx, vy = here.prediction.mean[2:]
    text = (
        f"after 3 s of measurements without noise {probe.description} has the velocity {vx:.3g}, {vy:.3g} m/s, where "
        f"{true[0]:.3g}, {true[1]:.3g} is right; that of the same target turned away is right to {usual:.2g} m/s"
    )
    return 6 * FAR * error / (ASTRAY * speed), text, sensor_set[0]


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
