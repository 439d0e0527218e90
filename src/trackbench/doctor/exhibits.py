"""What shows a finding: one run of the drive in which it comes out, looked at reading by reading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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
    """One sensor's readings, as they surprise the tracker and as they should."""

    sensor: str
    kind: str
    components: tuple[str, ...]
    sigma: Array
    """``(m,)`` stated standard deviations."""
    time: Array
    """``(k,)`` s, of the readings that there were."""
    taken: Array
    """``(m, k)`` the innovation that explains how far each reading moved the estimate; NaN where it moved nothing."""
    sound: Array
    """``(m, k)`` the reading less what the tracker's own prediction leads to expect."""


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


def exhibit(make: Callable[[], Tracker], course: Course, reference: Track, findings: list[Finding]) -> Exhibit:
    """Take a fresh tracker through the first run of a drive, and ask it about every reading."""
    scans = [one_run(scan, 0) for scan in course.scans]
    mean, covariance = np.full((4, len(scans)), np.nan), np.full((4, 4, len(scans)), np.nan)
    seen: dict[str, list[tuple[float, Array, Array]]] = {}
    session = Session(make)
    begun = False
    for k, scan in enumerate(scans):
        begun = begun or bool(scan.valid)
        if not begun:
            continue
        try:
            if scan.valid:
                surprise = _surprise(session, scan, course.name)
                if surprise is not None:
                    seen.setdefault(scan.sensor, []).append(surprise)
            answer = session.step(scan)
        except Broken:
            break
        if answer is not None:
            mean[:, k], covariance[:, :, k] = answer.mean, answer.covariance
    kinds = {scan.sensor: scan for scan in scans}
    innovations = [_gathered(kinds[name], parts) for name, parts in seen.items()]
    target = np.broadcast_to(course.target, (*course.target.shape[:2], max(1, course.target.shape[2])))[..., 0]
    return Exhibit(
        course.name,
        course.drive.purpose,
        findings,
        scans,
        course.time,
        target,
        mean,
        covariance,
        reference.mean[..., 0],
        reference.covariance[..., 0],
        innovations,
    )


def _surprise(session: Session, scan: Scan, where: str) -> tuple[float, Array, Array] | None:
    predicted = session.peek(blind(scan))
    if predicted is None:
        return None
    reply = Reply(Station(where, "", (0.0, 0.0, 0.0, 0.0)), (), scan, predicted, session)
    if not reply.sound:
        return None
    effect = reply.effect(scan.reading)
    taken = np.full(len(scan.reading), np.nan) if effect is None else effect.surprise * reply.sigma
    sound = difference(scan.reading, reply.expected, SENSOR_MODELS[scan.kind].angular)
    return scan.time, taken, sound


def _gathered(scan: Scan, parts: list[tuple[float, Array, Array]]) -> Innovations:
    time, taken, sound = zip(*parts, strict=True)
    return Innovations(
        scan.sensor,
        scan.kind,
        SENSOR_MODELS[scan.kind].components,
        np.sqrt(np.diag(scan.noise)),
        np.array(time),
        np.stack(taken, axis=1),
        np.stack(sound, axis=1),
    )
