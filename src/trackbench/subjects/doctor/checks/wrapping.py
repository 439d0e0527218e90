"""Is every angle wrapped where it passes pi?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.subjects.doctor.course_jump import course_jump, followed
from trackbench.subjects.doctor.exhibits import Predictions, StatedBelief
from trackbench.subjects.doctor.findings import DoctorCheck, Finding, KnownFault, PartResult, Question, Role
from trackbench.subjects.doctor.probes import Probe
from trackbench.subjects.doctor.right_answers import named
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.subjects.doctor.trial import Trial
from trackbench.subjects.doctor.turned_update import FAR, OTHER_TURN, TURN, Jump, beyond_pi, jumps_of

#: Error of the velocity after 3 s without noise, as a share of the speed, of a target that is as good as lost, and the
#: least ratio to that of the turned target.
ASTRAY, WORSE = 0.05, 5.0
#: The same error from which on the track has diverged: a wrong course, of any speed that is about right, has up to 2.
DIVERGED = 5.0
#: By how much it is turned elsewhere, rad. After a quarter turn the sigma points of an uncertain course lie about the
#: axes as before: what leads them astray there too is no angle that jumps.
ELSEWHERE = (TURN, OTHER_TURN, np.pi / 2, np.pi)
#: Time for which a turning target is followed, s.
TURNING = 5.0
#: Angle from pi of the targets that are tried, rad; those of other sensors' sites are elsewhere.
NEAR_PI = 0.02


def wrapping(tracker: TrackerUnderTest) -> PartResult:
    """Try measurements beside a target at the azimuth pi, and beside one with the course pi; follow one through it."""
    result = PartResult()
    polar = [name for name, sensor in tracker.sensors.items() if sensor.type != "lidar"]
    for angle, probes, sensors in (
        ("azimuth", tracker.probes.axes, polar),
        ("course", (tracker.probes.course_axis,), tracker.sensors),
    ):
        if not sensors:
            continue
        jumps = [
            jump
            for probe in probes
            for name in sensors
            if angle == "course" or _at_pi(tracker, probe, name)
            for sensor_set in tracker.sensor_sets()
            for jump in jumps_of(tracker, probe, name, sensor_set, angle == "azimuth")
        ]
        if angle == "course":
            jumps += [astray for of in tracker.sensor_sets() if (astray := _astray(tracker, probes[0], of)) is not None]
            jumps += _turning(tracker)
        if not jumps:
            result.add(f"{angle}_wrapping", None, "there was no estimate to update")
            continue
        worst = max(jumps, key=lambda jump: jump.size)
        finding = None
        if worst.size >= FAR:
            far = [jump for jump in jumps if jump.size >= FAR]
            finding = _course(worst) if angle == "course" else _azimuth(tracker, far, worst)
        result.add(f"{angle}_wrapping", finding is None, worst.text, finding)
    return result


def _at_pi(tracker: TrackerUnderTest, probe: Probe, name: str) -> bool:
    """Whether the sensor sees the target near the azimuth pi."""
    return bool(np.pi - abs(probe.scan(name, tracker.sensors[name], 0.0).measurement[1]) < NEAR_PI)


def _course(worst: Jump) -> Finding:
    # Wrong gains are not turned with the target either.
    confidence = 0.97 if worst.size > 5 * FAR else 0.75
    # The drive on a circle passes the course pi; the probe's own has no other target.
    return Finding("course_not_wrapped", confidence, worst.text, shown_by="long_run", exhibit=worst.exhibit)


def _azimuth(tracker: TrackerUnderTest, jumps: Sequence[Jump], worst: Jump) -> Finding:
    of_mean = any(jump.without_innovation for jump in jumps) and not any(jump.measured for jump in jumps)
    if of_mean and (wider := _beyond_pi(tracker, worst)) is not None:
        of_mean, worst = False, wider
    confidence = 0.97 if worst.confirmed and worst.size > 5 * FAR else 0.85
    fault, text = "azimuth_not_wrapped", worst.text
    if of_mean:
        fault, confidence = "angle_mean_not_circular", 0.95
        text += "; where the prediction's own azimuths are all on one side of pi, it does not; the update by the "
        text += "predicted measurement differs too"
        if abs(worst.innovation) > FAR:
            text += f", and its azimuth has an innovation of {worst.innovation:+.3g} sigma"
    return Finding(fault, confidence, text, sensor=worst.sensor, shown_by=worst.probe.name, exhibit=worst.exhibit)


def _beyond_pi(tracker: TrackerUnderTest, worst: Jump) -> Jump | None:
    """An update that jumps for the measurement alone: uncertain predictions beside pi have azimuths on both sides."""
    found = (beyond_pi(tracker, worst.probe, worst.sensor, sensor_set) for sensor_set in tracker.sensor_sets())
    return next((jump for jump in found if jump is not None and jump.measured and jump.size >= FAR), None)


def _astray(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> Jump | None:
    """A target that was followed without noise and has another velocity then, where turned targets have their own."""
    true, speed = probe.truth(0.0)[2:], float(np.hypot(*probe.target[2:]))
    here, error = _followed(tracker, probe, sensor_set)
    if here is None or not ASTRAY * speed <= error < DIVERGED * speed:
        return None
    usual, others = 0.0, []
    for turn in ELSEWHERE:
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
        StatedBelief(
            "the same target turned away",
            both @ others[0].mean,
            both @ others[0].covariance @ both.T,
        ),
    )
    return Jump(6 * FAR * error / (ASTRAY * speed), text, sensor_set[0], probe, False, False, False, shown)


def _turning(tracker: TrackerUnderTest) -> list[Jump]:
    """A target that turns through the course pi, held against the same scene turned away."""
    probe = tracker.probes.course_turn
    scans = tracker.approach(probe, tracker.sensor_sets()[-1], TURNING)
    here = followed(tracker.make, scans)
    text = probe.description
    if here.failure is not None:
        tracker.failures.append((probe.name, here.failure))
        text += f": {here.failure}"
    found = course_jump(tracker.make, scans, here)
    if found is None:
        return []
    text += f"; {found.text}"
    return [Jump(found.size, text, found.scan.sensor, probe, False, False, False, found.exhibit)]


def _followed(tracker: TrackerUnderTest, probe: Probe, sensor_set: tuple[str, ...]) -> tuple[Trial | None, float]:
    """The trial of a target, and the error of its velocity; its speed where that is not a number, m/s."""
    trial = tracker.trial(probe, sensor_set[0], sensor_set)
    if trial is None:
        return None, np.inf
    error = float(np.hypot(*(trial.prediction.mean - probe.truth(0.0))[2:]))
    return trial, error if np.isfinite(error) else float(np.hypot(*probe.target[2:]))


WRAPPING_CHECK = DoctorCheck(
    wrapping,
    place=190,
    questions=(
        Question(
            "azimuth_wrapping",
            "Is the update of a target with the azimuth pi the same as with any other?",
            finds=("azimuth_not_wrapped", "angle_mean_not_circular"),
        ),
        Question(
            "course_wrapping",
            "Is the update of a target with the course pi the same as with any other?",
            finds=("course_not_wrapped",),
        ),
    ),
    of_filters=True,
    faults={
        "azimuth_not_wrapped": KnownFault(
            "an angle is not wrapped to (-pi, pi]",
            "Where the innovation, or the difference of sigma points from their mean, is computed.",
            "Wrap every difference of angles, of the azimuth and of the course in the state: d = (d + pi) % (2 pi) - "
            "pi.",
            Role("exact angle", rank=42, causes="numerical", drive="azimuth_crossing"),
        ),
        "angle_mean_not_circular": KnownFault(
            "angles of sigma points are averaged or subtracted across pi",
            "Where the mean of the sigma points' azimuths is computed, and their differences from it.",
            "mean = a_0 + sum w wrap(a - a_0) with a_0 of one point, or atan2(sum w sin a, sum w cos a); wrap every "
            "difference from the mean.",
            Role(
                "exact angle",
                rank=18,
                causes="measured noise angle",
                always="azimuth_not_wrapped",
                drive="azimuth_crossing",
            ),
        ),
        "course_not_wrapped": KnownFault(
            "a difference of courses in the state is not wrapped to (-pi, pi]",
            "Where the mean of the sigma points, or of the models of an IMM, is computed, and their differences from "
            "it.",
            "Wrap every difference of courses: d = (d + pi) % (2 pi) - pi; for a mean, that of the differences from "
            "one point.",
            Role(
                "exact angle",
                rank=19,
                causes="stepped",
                always="predicted_covariance_not_psd covariance_not_psd",
                drive="long_run",
            ),
        ),
    },
)
