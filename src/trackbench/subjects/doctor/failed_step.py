"""What is known of a failed step: the scans before it are given again, to fresh trackers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Estimate, Scan
from trackbench.driving.drive import empty_scan
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.course_jump import course_jump, followed
from trackbench.subjects.doctor.exhibits import Matrices, Panel, components_of
from trackbench.subjects.doctor.probes import TURNS, turned_mounting
from trackbench.subjects.doctor.session import MissGiven, StepFailed, TrackerSession, apart, finite
from trackbench.trackers.answers import Tracker

Make = Callable[[], Tracker]

#: Difference of two estimates that rounding does not explain, in standard deviations.
APART = 1e-3
#: How far an estimate that follows its target may be from the last measured position, beside six of its standard
#: deviations, m.
NEAR = 1.0


class Circumstances(NamedTuple):
    """What goes before a failed step."""

    before: Estimate | None
    """After the scan before."""
    predicted: Estimate | None
    """Predicted to the time of the scan, as for a missed measurement."""
    missed_fails: bool | None
    """Whether a missed measurement at that time fails as well; None where none may be given."""


def circumstances(make: Make, failure: StepFailed) -> Circumstances:
    """Give the scans before the failed step to a fresh tracker, and then a missed measurement.

    Raises:
        StepFailed: the tracker fails at another scan this time.
    """
    session, before = TrackerSession(make), None
    for scan in failure.given:
        before = session.step(scan)
    try:
        return Circumstances(before, session.step(empty_scan(failure.scan)), False)
    except MissGiven:
        return Circumstances(before, None, None)
    except StepFailed:
        return Circumstances(before, None, True)


class JumpingAngle(NamedTuple):
    """An angle that jumps at pi, and thereby breaks a tracker."""

    fault: str
    evidence: str
    sensor: str | None
    exhibit: Matrices | None


def jumping_angle(make: Make, failure: StepFailed) -> JumpingAngle | None:
    """Whether the failure comes of where an angle jumps: then the same scene, turned, does not break the tracker.

    A sensor mounted at another yaw measures other azimuths of the same target; a scene turned about the origin has
    other courses, and the same azimuths.
    """
    scans = [*failure.given, failure.scan]
    for angle in TURNS:
        other = [turned_mounting(scan, angle) for scan in scans]
        if _passes(make, other):
            k = _parting(make, scans, other)
            return _azimuth(make, scans, other, k, angle)
    course = course_jump(make, scans, followed(make, scans))
    return None if course is None else JumpingAngle("course_not_wrapped", course.text, None, None)


def _azimuth(make: Make, scans: Sequence[Scan], other: Sequence[Scan], k: int, angle: float) -> JumpingAngle | None:
    """Whether it is the mean of sigma points or the innovation: the former acts without an innovation too."""
    scan, predicted = scans[k], _prediction(make, scans[:k], scans[k])
    if predicted is None or not scan.valid or not SENSOR_MODELS[scan.kind].angular:
        return None
    measurement = SENSOR_MODELS[scan.kind].measure(predicted.mean, scan.sensor_pose, scan.sensor_velocity)
    if not any(_near_pi(measurement[i]) for i in SENSOR_MODELS[scan.kind].angular):
        return None
    text = (
        f"from a sensor mounted at another yaw ({-angle:+g} rad) the same target does not break it: the azimuth jumps "
        f"at pi, first at {scan.time:.4g} s, where {measured(scan)}"
    )
    expected = scan._replace(measurement=measurement)
    with_jump = _after(make, scans[:k], expected)
    if _same(with_jump, _after(make, other[:k], turned_mounting(expected, angle))):
        return JumpingAngle("azimuth_not_wrapped", text, scan.sensor, _measured_shown(scan, measurement))
    text += "; the update by its own predicted measurement, without an innovation, is wrong too"
    return JumpingAngle("angle_mean_not_circular", text, scan.sensor, _measured_shown(scan, measurement))


def _measured_shown(scan: Scan, predicted: Array) -> Matrices:
    """The measurement beside the predicted one; the angles are marked."""
    return Matrices(
        f"Measurement of {scan.sensor} at {scan.time:.4g} s, where the azimuth jumps",
        components_of(scan.kind),
        ("value",),
        (Panel("measured", scan.measurement[:, None]), Panel("predicted", predicted[:, None], "before")),
        tuple((i, 0) for i in SENSOR_MODELS[scan.kind].angular),
    )


def _near_pi(angle: float) -> bool:
    return np.pi - abs(angle) < max(TURNS)


def _parting(make: Make, scans: Sequence[Scan], other: Sequence[Scan]) -> int:
    """Number of the first scan after which the estimates differ; the last one fails in one of them."""
    one, two = TrackerSession(make), TrackerSession(make)
    for k in range(len(scans) - 1):
        if not _same(one.step(scans[k]), two.step(other[k])):
            return k
    return len(scans) - 1


def _same(one: Estimate | None, other: Estimate | None) -> bool:
    if one is None or other is None:
        return one is other
    return apart(one, other) < APART


def _prediction(make: Make, given: Sequence[Scan], scan: Scan) -> Estimate | None:
    session = TrackerSession(make)
    try:
        for earlier in given:
            session.step(earlier)
        estimate = session.predict(scan)
    except StepFailed:
        return None
    return estimate if estimate is not None and finite(estimate) else None


def _after(make: Make, given: Sequence[Scan], scan: Scan) -> Estimate | None:
    """The estimate after a scan, and None where a step fails."""
    session = TrackerSession(make)
    try:
        for earlier in given:
            session.step(earlier)
        return session.step(scan)
    except StepFailed:
        return None


def _passes(make: Make, scans: Sequence[Scan]) -> bool:
    """Whether no step fails, and the estimate after the last measurement is at it."""
    session, last = TrackerSession(make), None
    try:
        for scan in scans:
            estimate = session.step(scan)
            last = (scan, estimate) if scan.valid else last
    except StepFailed:
        return False
    return last is not None and _at_target(*last)


def _at_target(scan: Scan, estimate: Estimate | None) -> bool:
    if estimate is None or not finite(estimate):
        return False
    position = SENSOR_MODELS[scan.kind].position(scan)
    return bool(np.hypot(*(estimate.mean[:2] - position.mean)) < NEAR + 6.0 * np.sqrt(np.trace(position.covariance)))


def measured(scan: Scan) -> str:
    """The measurement in words."""
    return f"{scan.sensor} measures {', '.join(_components(scan))}" if scan.valid else f"{scan.sensor} measures nothing"


def _components(scan: Scan) -> Iterator[str]:
    model = SENSOR_MODELS[scan.kind]
    for i, name in enumerate(model.components):
        yield f"{name.replace('_', ' ')} {scan.measurement[i]:.4g}"
