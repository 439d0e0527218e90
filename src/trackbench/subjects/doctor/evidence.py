"""A run of a test drive that shows findings: estimates, their errors, and the innovation of each measurement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Mask, Scan, scan_of_member
from trackbench.base.units import difference
from trackbench.metrics.consistency import normalised_square
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.drives import Rollout, TestDrive
from trackbench.subjects.doctor.findings import CheckResult, Finding, known_faults
from trackbench.subjects.doctor.session import StepFailed, TrackerSession
from trackbench.subjects.doctor.trial import Trial
from trackbench.trackers.answers import Tracker

#: Drive that is shown of a healthy tracker, and of faults that no drive shows.
DEFAULT_DRIVE = "azimuth_crossing"
#: Largest number of drives with evidence.
MOST_SHOWN = 3
#: Largest number of scans with innovations where the tracker cannot be copied: each innovation takes several fresh
#: trackers that repeat all earlier scans.
REPEATED = 300


@dataclass(frozen=True, eq=False)
class SensorInnovations:
    """Innovations of one sensor in a run: as the tracker applied them, and as they should be."""

    sensor: str
    kind: str
    components: tuple[str, ...]
    sigma: Array
    """Stated standard deviations of the measurement ``(m,)``."""
    time: Array
    """Times of the valid measurements ``(k,)``, s."""
    applied: Array
    """Innovations ``(m, k)`` of the k measurements by which the estimates moved; NaN where no estimate moved."""
    expected: Array
    """Measurements minus predictions ``(m, k)``, by the tracker's own state and the right measurement model."""


@dataclass(frozen=True, eq=False)
class EvidenceRun:
    """A run of a test drive with the estimates of the tracker and of the reference."""

    drive: str
    description: str
    findings: list[Finding]
    """Findings that the run shows, the most likely root cause first."""
    scans: list[Scan]
    """Scans of the run, without batch axes."""
    time: Array
    """Times of the scans ``(scans,)``, s."""
    target: Array
    """True px, py, vx, vy ``(4, scans)``."""
    mean: Array
    """Estimates of the tracker ``(4, scans)``, NaN where there is no estimate."""
    covariance: Array
    """Covariances of the tracker ``(4, 4, scans)``."""
    reference_mean: Array
    """Estimates of the reference tracker ``(4, scans)``, NaN where there is no estimate."""
    reference_covariance: Array
    """Covariances of the reference tracker ``(4, 4, scans)``."""
    innovations: list[SensorInnovations]


def shown_drives(
    findings: Sequence[Finding], checks: Sequence[CheckResult], drives: Sequence[TestDrive]
) -> dict[str, list[Finding]]:
    """Return the names of the drives that show the root causes, each with the findings that it shows.

    Args:
        findings: all findings, the most likely root cause first.
        checks: all checks, with the results of the drives.
        drives: drives through which the tracker was stepped.
    """
    failed = {check.name for check in checks if check.passed is False}
    shown: dict[str, list[Finding]] = {}
    for finding in findings:
        # The drive that the finding names, or else the drive of its fault, if that drive failed.
        fault_drive = known_faults()[finding.fault].role.drive
        names = [drive.name for drive in drives if drive.name in (finding.shown_by, fault_drive)]
        names = [name for name in names if name == finding.shown_by] or [name for name in names if name in failed]
        if finding.consequence_of is None and names and len(shown) < MOST_SHOWN:
            shown.setdefault(names[0], []).append(finding)
    return shown or {DEFAULT_DRIVE: []}


def evidence_run(
    make: Callable[[], Tracker], drive: TestDrive, reference: Rollout, findings: list[Finding]
) -> EvidenceRun:
    """Return a run of a drive: the estimates of a fresh tracker, and the innovation of every measurement.

    Args:
        make: makes a fresh tracker.
        drive: test drive.
        reference: estimates of the reference in the drive.
        findings: findings that the drive shows; the first one chooses the run.
    """
    run = findings[0].run if findings else 0
    scans = [scan_of_member(scan, run) for scan in drive.scans]
    mean, covariance = np.full((4, len(scans)), np.nan), np.full((4, 4, len(scans)), np.nan)
    innovations: dict[str, list[tuple[float, Array, Array]]] = {}
    # One column for the measurement, and two for each of its components: all that an innovation is computed from.
    session = TrackerSession(make, columns=1 + 2 * max(len(scan.measurement) for scan in scans))
    started = False
    for k, scan in enumerate(scans):
        started = started or bool(scan.valid)
        if not started:
            continue
        try:
            left_out = k >= REPEATED and session.not_copied is not None
            innovation = _innovation(session, scan, drive) if scan.valid and not left_out else None
            if innovation is not None:
                innovations.setdefault(scan.sensor, []).append(innovation)
            estimate = session.step(scan)
        except StepFailed:
            break
        if estimate is not None:
            mean[:, k], covariance[:, :, k] = estimate.mean, estimate.covariance
    last = {scan.sensor: scan for scan in scans}
    description = drive.config.description
    if len(scans) > REPEATED and session.not_copied is not None:
        description += f" (innovations of the first {REPEATED} scans: the tracker cannot be copied)"
    return EvidenceRun(
        drive.name,
        description,
        findings,
        scans,
        drive.time,
        drive.target[..., min(run, drive.target.shape[-1] - 1)],
        mean,
        covariance,
        reference.mean[..., run],
        reference.covariance[..., run],
        [_series(last[name], parts) for name, parts in innovations.items()],
    )


def _innovation(session: TrackerSession, scan: Scan, drive: TestDrive) -> tuple[float, Array, Array] | None:
    """Return the time of a measurement, s, its applied and its right innovation ``(m,)``; None without a prediction."""
    prediction = session.predict(scan)
    if prediction is None:
        return None
    trial = Trial(drive.name, drive.config.description, scan, prediction, session)
    if not trial.usable:
        return None
    update = trial.update(scan.measurement)
    applied = np.full(len(scan.measurement), np.nan) if update is None else update.innovation * trial.sigma
    expected = difference(scan.measurement, trial.predicted_measurement, SENSOR_MODELS[scan.kind].angular)
    return scan.time, applied, expected


def _series(scan: Scan, innovations: list[tuple[float, Array, Array]]) -> SensorInnovations:
    time, applied, expected = zip(*innovations, strict=True)
    return SensorInnovations(
        scan.sensor,
        scan.kind,
        SENSOR_MODELS[scan.kind].components,
        np.sqrt(np.diag(scan.noise_covariance)),
        np.array(time),
        np.stack(applied, axis=1),
        np.stack(expected, axis=1),
    )


class RunErrors(NamedTuple):
    """Errors after each scan of a run; NaN where there is no estimate."""

    position: Array
    """Distance of the estimated position from the true one ``(scans,)``, m."""
    two_sigma: Array
    """Twice the standard deviation of the position by the estimate's own covariance ``(scans,)``, m."""
    nees: Array
    """NEES of position and velocity ``(scans,)``; NaN where the covariance is not positive definite."""


def run_errors(run: EvidenceRun) -> dict[str, RunErrors]:
    """Return the errors of a run by name: ``tracker`` and ``reference``."""
    errors = {}
    for name, mean, covariance in (
        ("tracker", run.mean, run.covariance),
        ("reference", run.reference_mean, run.reference_covariance),
    ):
        finite: Mask = np.asarray(np.isfinite(mean).all(axis=0) & np.isfinite(covariance).all(axis=(0, 1)))
        error = np.where(finite, mean - run.target, np.nan)
        two_sigma, nees = np.full((2, len(finite)), np.nan)
        two_sigma[finite] = 2.0 * np.sqrt(np.maximum(covariance[0, 0, finite] + covariance[1, 1, finite], 0.0))
        square, _, positive = normalised_square(error[:, finite], covariance[:, :, finite])
        nees[finite] = np.where(positive, square, np.nan)
        errors[name] = RunErrors(np.hypot(error[0], error[1]), two_sigma, nees)
    return errors
