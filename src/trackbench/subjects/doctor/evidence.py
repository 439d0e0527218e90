"""The run of a test drive that shows a finding: its estimates, their errors, and the innovation of each measurement."""

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

#: The evidence of a healthy tracker, and of a fault that no drive shows.
DEFAULT_DRIVE = "azimuth_crossing"
#: Largest number of drives with evidence.
MOST_SHOWN = 3
#: Most scans of a drive whose innovations are computed of a tracker that is not copied: each takes several fresh ones
#: that are given all scans before.
REPEATED = 300


@dataclass(frozen=True, eq=False)
class SensorInnovations:
    """The innovations of one sensor in a run: those that the tracker applied, and those that are right."""

    sensor: str
    kind: str
    components: tuple[str, ...]
    sigma: Array
    """``(m,)`` stated standard deviations of the measurement."""
    time: Array
    """``(k,)`` s, of the valid measurements."""
    applied: Array
    """``(m, k)`` the innovation by which the estimate moved; NaN where it did not."""
    expected: Array
    """``(m, k)`` the measurement minus that of the tracker's own prediction, by the right measurement model."""


@dataclass(frozen=True, eq=False)
class EvidenceRun:
    """A run of a test drive."""

    drive: str
    description: str
    findings: list[Finding]
    """Those that it shows, the most likely root cause first."""
    scans: list[Scan]
    """Without batch axes."""
    time: Array
    """``(scans,)`` s."""
    target: Array
    """``(4, scans)`` the true px, py, vx, vy."""
    mean: Array
    """``(4, scans)`` of the tracker, NaN where there is no estimate."""
    covariance: Array
    """``(4, 4, scans)`` of the tracker."""
    reference_mean: Array
    """``(4, scans)``"""
    reference_covariance: Array
    """``(4, 4, scans)``"""
    innovations: list[SensorInnovations]


def shown_drives(
    findings: Sequence[Finding], checks: Sequence[CheckResult], drives: Sequence[TestDrive]
) -> dict[str, list[Finding]]:
    """The names of the drives that show the root causes, each with what it shows, the first root cause first.

    Args:
        findings: the most likely root cause first.
        checks: with the results of the drives.
        drives: those that were driven.
    """
    failed = {check.name for check in checks if check.passed is False}
    shown: dict[str, list[Finding]] = {}
    for finding in findings:
        # The drive that the finding names, or else the one of its fault, if that failed.
        own = known_faults()[finding.fault].role.drive
        names = [drive.name for drive in drives if drive.name in (finding.shown_by, own)]
        names = [name for name in names if name == finding.shown_by] or [name for name in names if name in failed]
        if finding.consequence_of is None and names and len(shown) < MOST_SHOWN:
            shown.setdefault(names[0], []).append(finding)
    return shown or {DEFAULT_DRIVE: []}


def evidence_run(
    make: Callable[[], Tracker], drive: TestDrive, reference: Rollout, findings: list[Finding]
) -> EvidenceRun:
    """Step a fresh tracker through a run of a drive, and compute the innovation of every measurement.

    Args:
        make: gives a fresh tracker.
        drive: the test drive.
        reference: the estimates of the reference in it.
        findings: those that the drive shows; the run is that of the first one.
    """
    run = findings[0].run if findings else 0
    scans = [scan_of_member(scan, run) for scan in drive.scans]
    mean, covariance = np.full((4, len(scans)), np.nan), np.full((4, 4, len(scans)), np.nan)
    innovations: dict[str, list[tuple[float, Array, Array]]] = {}
    # As many as the questions that give one innovation: the measurement, and two beside it in each component.
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
    """Time, ``applied`` and ``expected`` of one measurement, as in `SensorInnovations`."""
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
    """After each scan; NaN where there is no estimate."""

    position: Array
    """``(scans,)`` distance of the estimated position from the true one, m."""
    two_sigma: Array
    """``(scans,)`` twice the standard deviation of that distance by the estimate's own covariance, m."""
    nees: Array
    """``(scans,)`` of position and velocity; NaN where the covariance is not positive definite."""


def run_errors(run: EvidenceRun) -> dict[str, RunErrors]:
    """By name: "tracker" and "reference"."""
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
