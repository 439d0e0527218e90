"""What shows a finding: one run of the drive in which it comes out, looked at measurement by measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.doctor.bench import Reply
from trackbench.doctor.drives import Course
from trackbench.doctor.findings import Finding
from trackbench.doctor.following import Track, one_run
from trackbench.doctor.session import Broken, Session, blind
from trackbench.doctor.stations import Station
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.trackers.base import Tracker
from trackbench.types import Array, Scan
from trackbench.units import difference


@dataclass(frozen=True, eq=False)
class Innovations:
    """One sensor's measurements, as they surprise the tracker and as they should."""

    sensor: str
    kind: str
    components: tuple[str, ...]
    sigma: Array
    """``(m,)`` stated standard deviations."""
    time: Array
    """``(k,)`` s, of the measurements that there were."""
    taken: Array
    """``(m, k)`` the innovation that explains how each measurement moved the estimate; NaN where it did not."""
    sound: Array
    """``(m, k)`` the measurement less what the tracker's own prediction leads to expect."""
    white: Array
    """``(m, k)`` the latter in standard deviations of the prediction and the sensor; NaN where there is no such."""


@dataclass(frozen=True, eq=False)
class Exhibit:
    """One run of one drive."""

    course: str
    purpose: str
    findings: list[Finding]
    """Those that it shows, the first one first."""
    scans: list[Scan]
    """Without batch axes."""
    time: Array
    """``(scans,)`` s."""
    target: Array
    """``(4, scans)`` the true px, py, vx, vy."""
    mean: Array
    """``(4, scans)`` the tracker's, NaN where there is none."""
    covariance: Array
    """``(4, 4, scans)``"""
    reference_mean: Array
    """``(4, scans)``"""
    reference_covariance: Array
    """``(4, 4, scans)``"""
    innovations: list[Innovations]


class Watched(NamedTuple):
    """A tracker on one run of a drive."""

    scans: list[Scan]
    """Without batch axes."""
    mean: Array
    """``(4, scans)``, NaN where there is no estimate."""
    covariance: Array
    """``(4, 4, scans)``"""
    innovations: list[Innovations]


def exhibit(make: Callable[[], Tracker], course: Course, reference: Track, findings: list[Finding]) -> Exhibit:
    """What one run of a drive shows of a tracker."""
    watched = watch(make, course)
    target = np.broadcast_to(course.target, (*course.target.shape[:2], max(1, course.target.shape[2])))[..., 0]
    return Exhibit(
        course.name,
        course.drive.purpose,
        findings,
        watched.scans,
        course.time,
        target,
        watched.mean,
        watched.covariance,
        reference.mean[..., 0],
        reference.covariance[..., 0],
        watched.innovations,
    )


def watch(make: Callable[[], Tracker], course: Course) -> Watched:
    """Take a fresh tracker through the first run of a drive, and ask it about every measurement."""
    scans = [one_run(scan, 0) for scan in course.scans]
    mean, covariance = np.full((4, len(scans)), np.nan), np.full((4, 4, len(scans)), np.nan)
    seen: dict[str, list[Surprise]] = {}
    session = Session(make)
    begun = False
    for k, scan in enumerate(scans):
        begun = begun or bool(scan.valid)
        if not begun:
            continue
        try:
            surprise = _surprise(session, scan, course.name) if scan.valid else None
            if surprise is not None:
                seen.setdefault(scan.sensor, []).append(surprise)
            answer = session.step(scan)
        except Broken:
            break
        if answer is not None:
            mean[:, k], covariance[:, :, k] = answer.mean, answer.covariance
    kinds = {scan.sensor: scan for scan in scans}
    return Watched(scans, mean, covariance, [_gathered(kinds[name], parts) for name, parts in seen.items()])


class Surprise(NamedTuple):
    """One measurement, as it surprises a tracker and as it should."""

    time: float
    taken: Array
    sound: Array
    white: Array


def _surprise(session: Session, scan: Scan, where: str) -> Surprise | None:
    predicted = session.peek(blind(scan))
    if predicted is None:
        return None
    reply = Reply(Station(where, "", (0.0, 0.0, 0.0, 0.0)), (), scan, predicted, session)
    if not reply.sound:
        return None
    effect = reply.effect(scan.measurement)
    taken = np.full(len(scan.measurement), np.nan) if effect is None else effect.surprise * reply.sigma
    sound = difference(scan.measurement, reply.expected, SENSOR_MODELS[scan.kind].angular)
    spread = linalg.quadratic(reply.jacobian, linalg.symmetrise(predicted.covariance)) + scan.noise_covariance
    factor = linalg.cholesky(spread)
    white = factor.whiten(sound) if factor.positive else np.full(len(sound), np.nan)
    return Surprise(scan.time, taken, sound, white)


def _gathered(scan: Scan, parts: list[Surprise]) -> Innovations:
    time, taken, sound, white = zip(*parts, strict=True)
    return Innovations(
        scan.sensor,
        scan.kind,
        SENSOR_MODELS[scan.kind].components,
        np.sqrt(np.diag(scan.noise_covariance)),
        np.array(time),
        np.stack(taken, axis=1),
        np.stack(sound, axis=1),
        np.stack(white, axis=1),
    )
