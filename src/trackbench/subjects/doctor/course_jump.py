"""Whether an estimate depends on where the course jumps at pi: the same scans, and the scene turned about the origin.

A scene turned about the origin has other courses and the same measurements, and its estimates are the same, turned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Estimate, Scan
from trackbench.subjects.doctor.probes import Probe, rotation, turned_scene, with_measurement_noise
from trackbench.subjects.doctor.session import StepFailed, TrackerSession, apart, finite
from trackbench.subjects.doctor.tracker_under_test import TrackerUnderTest
from trackbench.trackers.answers import Tracker

#: Angles by which a scene is turned, rad, in the order in which they are tried.
ANGLES = (-0.9, -1.5, 0.9, 1.5, 2.1, -2.1)
#: How far the course of a turned scene has to be from pi, rad, and in how many of its last scans.
AWAY, LAST = 0.45, 15
#: How far from pi the course may be where it jumps: as far as sigma points lie, rad.
NEAR_PI = 0.6
#: Difference from the estimates of both turned scenes that is a jump, of a mean in their standard deviations and of a
#: covariance in their variances.
FAR = 3.0
#: The same of a mean in m and m/s: stated standard deviations may be those of no error.
MOVED = 0.05
#: Share of it which the turned scenes may differ by: a tracker that starts with the course 0 has another track in each.
ALIKE = 0.2
#: Time for which a target is followed, s.
TURNING = 5.0
#: The jump of a step that fails.
FAILED = 100.0 * FAR


class CourseJump(NamedTuple):
    """An estimate, or a failed step, that two turned scenes do not have."""

    size: float
    """The largest difference, as of `FAR`."""
    scan: Scan
    text: str


class Followed(NamedTuple):
    """A target followed in a turned scene."""

    estimates: list[Estimate | None]
    """After each scan up to a failed step, turned back; None where there is none that is finite."""
    failure: StepFailed | None


def jumps_of_course(tracker: TrackerUnderTest) -> Iterator[tuple[Probe, CourseJump]]:
    """Of a target that turns through the course pi, and of one that has it.

    The latter is measured with noise: the courses of several models are on both sides of pi then.
    """
    random = np.random.default_rng(tracker.seed)
    for probe, noisy in ((tracker.probes.course_turn, False), (tracker.probes.course_axis, True)):
        scans = tracker.approach(probe, tracker.sensor_sets()[-1], TURNING)
        scans = [with_measurement_noise(scan, random) for scan in scans] if noisy else scans
        here = followed(tracker.make, scans)
        jump = course_jump(tracker.make, scans, here)
        if here.failure is not None:
            tracker.failures.append((probe.name, here.failure))
            jump = jump and jump._replace(text=f"{here.failure}; {jump.text}")
        if jump is not None:
            yield probe, jump


def course_jump(make: Callable[[], Tracker], scans: Sequence[Scan], here: Followed) -> CourseJump | None:
    """Hold the estimates of a scene against those of two turned scenes whose course is not near pi in the last scans.

    None where they are alike, where the two turned scenes differ too, and where the course is elsewhere.
    """
    turned: list[tuple[float, Followed]] = []
    for angle in ANGLES:
        other = followed(make, scans, angle)
        last = [estimate for estimate in other.estimates[-LAST:] if estimate is not None]
        if all(_from_pi(_course(estimate) + angle) > AWAY for estimate in last):
            if other.failure is not None:
                return None
            turned.append((angle, other))
        if len(turned) == 2:
            return _jump(scans, here, turned)
    return None


def followed(make: Callable[[], Tracker], scans: Sequence[Scan], angle: float = 0.0) -> Followed:
    """Give the scans of the scene turned by an angle in rad to a fresh tracker."""
    session, back = TrackerSession(make), np.kron(np.eye(2), rotation(-angle))
    estimates: list[Estimate | None] = []
    try:
        for after in session.walk([turned_scene(scan, angle) for scan in scans]):
            if after is not None:
                after = Estimate(back @ after.mean, back @ after.covariance @ back.T) if finite(after) else None
            estimates.append(after)
    except StepFailed as failure:
        return Followed(estimates, failure)
    return Followed(estimates, None)


def _from_pi(course: float) -> float:
    return abs(float(np.angle(-np.exp(1j * course))))


def _course(estimate: Estimate) -> float:
    return float(np.arctan2(estimate.mean[3], estimate.mean[2]))


def _jump(scans: Sequence[Scan], here: Followed, turned: Sequence[tuple[float, Followed]]) -> CourseJump | None:
    (angle, first_scene), (other_angle, second_scene) = turned
    gaps = [_gap(*three) for three in zip(here.estimates, first_scene.estimates, second_scene.estimates, strict=False)]
    first = next((k for k, gap in enumerate(gaps) if gap > FAR), len(gaps) if here.failure else None)
    if first is None:
        return None
    right = first_scene.estimates[first]
    if right is None or _from_pi(_course(right)) > NEAR_PI or not _alike(right, second_scene.estimates[first]):
        return None
    by = f"turned about the origin by {angle:g} and by {other_angle:g} rad the same scans"
    time = scans[first].time
    if here.failure is not None:
        text = f"{by} do not break it: the course jumps at pi, first at {time:.4g} s"
        return CourseJump(FAILED, scans[first], text)
    wrong = here.estimates[first]
    assert wrong is not None
    text = (
        f"at {time:.4g} s, where the course is {_course(right):+.3f} rad, the velocity is {_velocity(wrong)}; "
        f"{by} give {_velocity(right)} (turned back)"
    )
    return CourseJump(max(gaps[first:]), scans[first], text)


def _gap(here: Estimate | None, first: Estimate | None, second: Estimate | None) -> float:
    """The lesser difference from the two; 0 where they are not alike."""
    if here is None or first is None or second is None or not _alike(first, second):
        return 0.0
    if np.abs(here.mean - first.mean).max() < MOVED:
        here = here._replace(mean=first.mean)
    return min(apart(here, first), apart(here, second))


def _alike(first: Estimate, second: Estimate | None) -> bool:
    return second is not None and apart(first, second) < ALIKE * FAR


def _velocity(estimate: Estimate) -> str:
    vx, vy = estimate.mean[2:]
    sigma = float(np.sqrt(max(np.trace(estimate.covariance[2:, 2:]), 0.0)))
    return f"{vx:.3g}, {vy:.3g} m/s with a standard deviation of {sigma:.3g} m/s"
