"""Is every angle wrapped where it passes pi?

If the target, the prediction and the measurement are turned about the sensor, the estimate must turn with them. It does
not where an angle at pi is not wrapped.
"""

from __future__ import annotations

from collections.abc import Sequence

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
#: Innovation that counts as none, in standard deviations of the measurement, as for the second-order terms elsewhere.
UNMOVED = 0.75
#: The gain counts as lost where the difference is more than the share `LOST` of the turned target's update, if that is
#: more than `CLEAR` standard deviations.
LOST, CLEAR = 0.5, 0.6
#: Difference of logarithms below which two variances count as equal.
EQUAL = 0.2
PARTS = (slice(0, 2), slice(2, 4))
#: Angle by which the target is turned, rad: no angle is near pi then.
TURN = -1.9


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
        if not jumps:
            result.checks.append(CheckResult(f"{angle}_wrapping", question, None, "there was no estimate to update"))
            continue
        size, text, sensor = max(jumps, key=lambda jump: jump[0])
        result.checks.append(CheckResult(f"{angle}_wrapping", question, size < FAR, text))
        if size >= FAR:
            confidence = 0.97 if size > 5 * FAR else 0.85
            finding = Finding("azimuth_not_wrapped", confidence, text, sensor=sensor, shown_by=probes[0].name)
            result.findings.append(finding)
            # Where the innovation is not wrapped, which is clear, the points are probably not wrapped either.
            if angle == "azimuth" and size <= 5 * FAR:
                result.findings += _uncentred(tracker, probes, polar)
    return result


def _uncentred(tracker: TrackerUnderTest, probes: Sequence[Probe], sensors: Sequence[str]) -> list[Finding]:
    """Means of azimuths that are not those of the points: the predicted measurement has an innovation at pi alone."""
    for probe in probes:
        for name in sensors:
            for sensor_set in tracker.sensor_sets():
                here = tracker.trial(probe, name, sensor_set)
                turned = tracker.trial(probe.turned(TURN), name, sensor_set)
                applied, other = _azimuth_innovation(here), _azimuth_innovation(turned)
                if here is None or not abs(applied) > FAR or not abs(other) < UNMOVED:
                    continue
                text = (
                    f"predicted azimuth {here.predicted_measurement[1]:+.4f} rad: a measurement equal to it has an "
                    f"innovation of {applied:+.3g} sigma, and {other:+.2g} sigma with the same target turned away from "
                    "pi: the predicted measurement is not the mean of points whose azimuths jump by 2 pi"
                )
                return [Finding("angle_mean_not_circular", 0.95, text, sensor=name, shown_by=probe.name)]
    return []


def _azimuth_innovation(trial: Trial | None) -> float:
    """Applied to the predicted measurement, in standard deviations; NaN where unknown."""
    update = trial.update(trial.predicted_measurement) if trial is not None and trial.usable else None
    return np.nan if update is None else float(update.innovation[1])


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
