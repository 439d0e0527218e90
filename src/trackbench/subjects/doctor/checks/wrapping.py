"""Is every angle wrapped where it passes pi?

If the target, the prediction and the measurement are turned about the sensor, the estimate must turn with them. The
estimate does not turn where an angle at pi is not wrapped. So updates of a target near the azimuth pi are compared with
updates of the same target turned away from pi.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.findings import Finding, KnownFault, PartResult, Question, Role, doctor_check
from trackbench.subjects.doctor.inside.values import trace_step
from trackbench.subjects.doctor.probes import MOUNTED_TURN, Probe, rotation, turned_mounting
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import ZERO, Trial

#: Difference from the estimate of the turned target that is a fault, in standard deviations of the prediction.
FAR = 3.0
#: The gain counts as lost where the difference is more than the share `LOST` of the turned target's update, if that is
#: more than `CLEAR` standard deviations.
LOST, CLEAR = 0.5, 0.6
#: Difference of the logarithms of two variances below which they count as equal.
EQUAL = 0.2
PARTS = (slice(0, 2), slice(2, 4))
#: Largest position error of a turned target with which updates are compared, m.
NEAR = 1.0
#: Difference of two covariances after an update that rounding does not explain, relative to the predicted variances.
SPREAD = 1e-3
#: Measurements tried beside the predicted one, in standard deviations.
SIDES = (-2.0, 2.0)
#: Standard deviations of the predicted azimuth within which all sigma points lie; and distance of the measurement
#: beyond pi, in its standard deviations, where a prediction is that far before pi.
SPREAD_OVER, BEYOND = 5.0, 2.0
#: Angle by which the target is turned, rad: no angle is near pi then.
TURN = -1.2
#: Difference of angles that is only rounding, rad.
ROUNDED = 1e-6
#: Largest angle from pi of the targets that are tried, rad; targets at the sites of other sensors are farther.
NEAR_PI = 0.02


class Jump(NamedTuple):
    """An update near the azimuth pi, compared with the update of the same target turned away from pi."""

    size: float
    """How much the update across pi differs from that of the same target turned away from pi, in standard deviations of
    the prediction."""
    text: str
    sensor: str
    probe: Probe
    measured: bool = False
    """Whether the measured and the predicted azimuth lie on different sides of pi."""
    without_innovation: bool = False
    """Whether updates across pi and away from pi differ even with a measurement equal to the predicted one."""
    line: str = ""
    """Line of the tracker's code with the difference that is not wrapped; empty where it is not found."""
    confirmed: bool = False
    """Whether pi is the cause: updates are right where a turned mounting or target keeps all azimuths off pi."""


@doctor_check(
    Question(
        "azimuth_wrapping",
        "Is the update at the azimuth pi the same as at any other azimuth?",
        finds=("azimuth_not_wrapped", "angle_mean_not_circular"),
    ),
    place=190,
    of_filters=True,
    faults={
        "azimuth_not_wrapped": KnownFault(
            "an angle is not wrapped to (-pi, pi]",
            "Where the innovation, or the difference of sigma points from their mean, is computed.",
            "Wrap every difference of angles, of the azimuth and of the course in the state: d = (d + pi) % (2 pi) - "
            "pi.",
            Role("exact", rank=44, drive="azimuth_crossing"),
        ),
        "angle_mean_not_circular": KnownFault(
            "angles of sigma points are averaged or subtracted across pi",
            "Where the mean of the sigma points' azimuths is computed, and their differences from it.",
            "mean = a_0 + sum w wrap(a - a_0) with a_0 of one point, or atan2(sum w sin a, sum w cos a); wrap every "
            "difference from the mean.",
            Role("exact", rank=18, drive="azimuth_crossing"),
        ),
    },
)
def wrapping(tracker: TrackerUnderTest) -> PartResult:
    """Try measurements beside a target at the azimuth pi, and compare with the target turned away from it."""
    polar = [name for name, sensor in tracker.sensors.items() if sensor.type != "lidar"]
    jumps = [
        jump
        for probe in tracker.probes.axes
        for name in polar
        # The sensor has to see the target near the azimuth pi.
        if np.pi - abs(tracker.scan(probe, name, 0.0).measurement[1]) < NEAR_PI
        for sensor_set in tracker.sensor_sets()
        for jump in _jumps_of(tracker, probe, name, sensor_set)
    ]
    if not polar:
        return PartResult()
    if not jumps:
        return PartResult().add("azimuth_wrapping", None, "there was no estimate to update")
    worst, far = max(jumps, key=lambda jump: jump.size), [jump for jump in jumps if jump.size >= FAR]
    finding = _azimuth(tracker, far, worst) if far else None
    return PartResult().add("azimuth_wrapping", finding is None, worst.text, finding)


def _azimuth(tracker: TrackerUnderTest, jumps: Sequence[Jump], worst: Jump) -> Finding:
    of_mean = any(jump.without_innovation for jump in jumps) and not any(jump.measured for jump in jumps)
    if of_mean:
        # Uncertain predictions beside pi have azimuths on both sides: the measurement alone may also make a jump.
        wider = (_beyond_pi(tracker, worst.probe, worst.sensor, sensor_set) for sensor_set in tracker.sensor_sets())
        far = next((jump for jump in wider if jump is not None and jump.measured and jump.size >= FAR), None)
        of_mean, worst = far is None, far or worst
    confidence = 0.97 if worst.confirmed and worst.size > 5 * FAR else 0.85
    fault, text = "azimuth_not_wrapped", worst.text
    if of_mean:
        fault, confidence = "angle_mean_not_circular", 0.95
        text += "; where the prediction's own azimuths are all on one side of pi, it does not; the update by the "
        text += "predicted measurement differs too"
    return Finding(fault, confidence, worst.line + text, sensor=worst.sensor, shown_by=worst.probe.name)


def _jumps_of(tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...]) -> list[Jump]:
    """Compare updates left and right of a target at the azimuth pi with those of the target turned away from pi."""
    turned_probe = probe.turned(TURN, tracker.sensors[name])
    at_pi, turned = tracker.trial(probe, name, sensor_set), tracker.trial(turned_probe, name, sensor_set)
    # Where the turned target's update is wrong, the two differ for another reason.
    if at_pi is None or turned is None or not (at_pi.usable and _is_right(turned, turned_probe)):
        return []
    jumps = [jump for side in SIDES if (jump := _jump(at_pi, turned, rotation(-TURN), side, probe)) is not None]
    if all(jump.size < FAR for jump in jumps):
        return jumps
    mounted = _mounted(tracker, probe, name, sensor_set)
    if mounted is None or not _is_right(mounted, probe):
        return jumps
    depends = _covariance_depends_on_mounting(at_pi, mounted)
    mounted_jumps = [_jump(at_pi, mounted, np.eye(2), side, probe) for side in SIDES]
    return [
        jump._replace(measured=jump.measured and not depends, without_innovation=depends, confirmed=True)
        for jump in mounted_jumps
        if jump is not None
    ]


def _beyond_pi(tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...]) -> Jump | None:
    """Compare an update across pi of a target turned so far that all its predicted azimuths lie before pi."""
    trial, sensor = tracker.trial(probe, name, sensor_set), tracker.sensors[name]
    if trial is None or not trial.usable:
        return None
    row, side = trial.jacobian[1], np.sign(trial.predicted_measurement[1])
    margin = SPREAD_OVER * float(np.sqrt(row @ trial.prediction.covariance @ row))
    before = probe.turned(-side * margin, sensor)
    turned_probe = before.turned(TURN, sensor)
    before_pi, turned = tracker.trial(before, name, sensor_set), tracker.trial(turned_probe, name, sensor_set)
    if before_pi is None or turned is None or not (_is_right(before_pi, before) and _is_right(turned, turned_probe)):
        return None
    jump = _jump(before_pi, turned, rotation(-TURN), side * (margin / trial.sigma[1] + BEYOND), probe)
    return None if jump is None else jump._replace(confirmed=True)


def _mounted(tracker: TrackerUnderTest, probe: Probe, name: str, sensor_set: tuple[str, ...]) -> Trial | None:
    """Return a trial with sensors whose turned mounting keeps the target off the azimuth pi; None if a step fails."""
    turned = [turned_mounting(scan, MOUNTED_TURN) for scan in tracker.approach(probe, sensor_set)]
    try:
        session = TrackerSession.after(tracker.make, turned)
        scan = turned_mounting(tracker.scan(probe, name, 0.0), MOUNTED_TURN)
        prediction = session.predict(scan)
    except StepFailed:
        return None
    return None if prediction is None else Trial(probe.name, probe.description, scan, prediction, session)


def _is_right(trial: Trial, probe: Probe) -> bool:
    """Return whether the prediction is at the target, and a measured azimuth equal to the predicted moves nothing."""
    if not trial.usable or np.hypot(*(trial.prediction.mean - probe.truth(0.0))[:2]) > NEAR:
        return False
    update = trial.update(trial.predicted_measurement)
    angular = list(SENSOR_MODELS[trial.scan.kind].angular)
    return update is not None and bool(np.all(np.nan_to_num(np.abs(update.innovation[angular])) < ZERO))


def _jump(trial: Trial, turned: Trial, back: Array, side: float, probe: Probe) -> Jump | None:
    """Return how a target's update differs from that of the target turned about the sensor, after rotating it back.

    ``back`` ``(2, 2)`` is this rotation, ``side`` is +1 or -1: the side of the prediction on which the measurement
    lies. None where an update is missing.
    """
    change, turned_change = _change(trial, side), _change(turned, side)
    if change is None or turned_change is None:
        return None
    rotation_back: Array = np.asarray(np.kron(np.eye(2), back))
    difference = np.abs(change - rotation_back @ turned_change) / trial.state_sigma
    usual = np.abs(rotation_back @ turned_change) / trial.state_sigma
    size = float(np.max(difference))
    p, q = trial.prediction.covariance, turned.prediction.covariance
    # The gains can be compared where the predictions have similar variances.
    ratios = (np.trace(p[part, part]) / np.trace(q[part, part]) for part in PARTS)
    lost = size > LOST * float(np.max(usual)) > LOST * CLEAR and all(abs(np.log(ratio)) < EQUAL for ratio in ratios)
    centre, beside = trial.predicted_measurement, _beside(trial, side)
    angular = list(SENSOR_MODELS[trial.scan.kind].angular)
    measured = bool(np.any(np.abs(beside[angular] - centre[angular]) > np.pi))
    text, line = _text(trial, side, size), _line(trial, beside) if measured and (lost or size >= FAR) else ""
    return Jump(max(size, FAR) if lost else size, text, trial.scan.sensor, probe, measured, line=line)


def _covariance_depends_on_mounting(trial: Trial, mounted: Trial) -> bool:
    first, second = trial.posterior(trial.predicted_measurement), mounted.posterior(mounted.predicted_measurement)
    if first is None or second is None:
        return True
    gap = (first.covariance - second.covariance) / np.outer(trial.state_sigma, trial.state_sigma)
    return float(np.abs(gap).max()) > SPREAD


def _change(trial: Trial, side: float) -> Array | None:
    """Return the updated mean ``(4,)`` for a measurement beside the predicted one, minus that for the predicted one.

    None where the tracker makes no update.
    """
    estimate, centre = trial.posterior(_beside(trial, side)), trial.posterior(trial.predicted_measurement)
    return None if estimate is None or centre is None else estimate.mean - centre.mean


def _beside(trial: Trial, side: float) -> Array:
    """Return the predicted measurement with ``side`` standard deviations added to its azimuth (left is positive)."""
    measurement = trial.predicted_measurement.copy()
    measurement[1] = wrap_angle(measurement[1] + side * trial.sigma[1])
    return measurement


def _line(trial: Trial, measurement: Array) -> str:
    """Name the tracker's line that assigns an unwrapped azimuth difference, and its value; empty text if none does."""
    plain, named = measurement[1] - trial.predicted_measurement[1], dict[tuple[str, str], str]()
    with suppress(StepFailed):
        twin = trial.session.copy()
        for entry in trace_step(lambda: twin.step(trial.scan._replace(measurement=measurement)))[1]:
            indices = np.flatnonzero(np.abs(np.abs(np.ravel(entry.value)) - abs(plain)) < ROUNDED)
            if not len(indices):
                named.pop((entry.file, entry.name), None)
                continue
            name = f"{entry.name}[{indices[0]}]" if entry.value.size > 1 else entry.name
            value = np.ravel(entry.value)[indices[0]]
            words = f"{entry.where}: {name} is {value:.4f}, and wrapped {wrap_angle(value):.4f}; "
            named.setdefault((entry.file, entry.name), words)
    return next(iter(named.values()), "")


def _text(trial: Trial, side: float, size: float) -> str:
    measured, predicted = _beside(trial, side)[1], trial.predicted_measurement[1]
    return (
        f"predicted azimuth {predicted:+.4f} rad, measurement {measured:+.4f} rad, {abs(side):g} sigma apart (plain "
        f"difference {measured - predicted:+.4f}): the update differs by {size:.3g} of its standard deviations from "
        "that of the same target turned away"
    )
