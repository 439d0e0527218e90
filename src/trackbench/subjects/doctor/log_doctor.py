"""The examination of a tracker of one object on the recorded scans of a log: what can be told without a truth.

The tracker is stepped through the scans, and its innovations are computed from its own predictions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from trackbench.api.scenario import loaded_scenario, sense
from trackbench.base import linalg
from trackbench.base.errors import InputError
from trackbench.base.execution import one_blas_thread
from trackbench.base.types import Array, Estimate, Scan
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.doctor.assumptions import Assumptions, require_known_checks
from trackbench.subjects.doctor.checks.steps import CannotRun
from trackbench.subjects.doctor.findings import (
    LOG_CHECKS,
    CheckResult,
    DoctorCheck,
    Finding,
    PartResult,
    checks_of,
    questions,
    rank_findings,
)
from trackbench.subjects.doctor.output_checks import quiet
from trackbench.subjects.doctor.report import Examination
from trackbench.subjects.doctor.session import Examined, StepFailed, TrackerSession, finite
from trackbench.trackers.answers import Tracker

#: Time from the first estimate of an object, or from the end of a gap, in which a track settles, s.
SETTLE = 2.0
#: Time without a scan that is a gap, s.
GAP = 1.0
#: Time by which the motion is differentiated, s.
SHORT = 1e-3


@dataclass
class LogInnovations:
    """The innovations of one sensor, each ``(m,)``, in the order of the scans."""

    kind: str
    owner: list[int] = field(default_factory=list)
    """Number of the object."""
    time: list[float] = field(default_factory=list)
    """s"""
    expected: list[Array] = field(default_factory=list)
    """Measurement minus that of the tracker's own prediction, by the right measurement model, in stated sigma."""
    whitened: list[Array] = field(default_factory=list)
    """The same, whitened by ``H P H^T + R``."""
    rate: list[Array] = field(default_factory=list)
    """Change of the predicted measurement by the motion of the object, per second, whitened in the same way."""
    implied: list[Array] = field(default_factory=list)
    """Variances of the measurement that the change of the covariance implies, over the stated ones; NaN where none."""

    apart: list[float] = field(default_factory=list)
    """Largest difference of the update from that of the own covariance and the implied noise, in standard deviations of
    the prediction."""
    crosses: list[bool] = field(default_factory=list)
    """Whether an angle passes pi between the predicted and the measured value."""

    def stacked(self, values: list[Array]) -> Array:
        """``(m, k)``"""
        return np.array(values).reshape(len(values), -1).T


@dataclass
class FollowedLog:
    """What a tracker has made of a log."""

    innovations: dict[str, LogInnovations] = field(default_factory=dict)
    """By sensor."""
    moved: list[tuple[float, float, float]] = field(default_factory=list)
    """Of each prediction: the time step, how far it moved along its velocity, and how far that takes it, s and m."""
    growth: list[float] = field(default_factory=list)
    """Of each prediction, by how much the variance of the velocity along an axis grows per second, m^2/s^3."""
    failures: list[StepFailed] = field(default_factory=list)
    estimates: int = 0
    scans: int = 0
    not_finite: list[Scan] = field(default_factory=list)
    """Scans after which the estimate was not."""

    @property
    def nis(self) -> float:
        """Mean over all sensors of the NIS over its degrees of freedom; infinite without any."""
        squares = [value**2 for of in self.innovations.values() for one in of.whitened for value in one]
        return float(np.mean(squares)) if squares else np.inf


@dataclass(frozen=True)
class RecordedLog:
    """Recorded scans, and a tracker to be followed through them."""

    make: Callable[[], Tracker]
    objects: Sequence[Sequence[Scan]]
    """The scans of each object, without batch axes, in the order in which they arrive."""

    @cached_property
    def sensors(self) -> list[str]:
        """Their names."""
        return sorted({scan.sensor for scans in self.objects for scan in scans})

    @cached_property
    def followed(self) -> FollowedLog:
        """What the tracker makes of it."""
        return follow(self.make, self.objects)

    def shifted(self, sensor: str, offset: float) -> FollowedLog:
        """The same, where the scans of a sensor are of ``offset`` seconds later."""

        def shift(scan: Scan) -> Scan:
            later = scan._replace(time=scan.time + offset, arrival_time=scan.arrival_time + offset)
            return later if scan.sensor == sensor else scan

        objects = [sorted(map(shift, scans), key=lambda scan: scan.arrival_time) for scans in self.objects]
        return follow(self.make, objects)


def follow(make: Callable[[], Tracker], objects: Sequence[Sequence[Scan]]) -> FollowedLog:
    """Step a fresh tracker for each object through its scans.

    Args:
        make: gives a fresh tracker.
        objects: the scans of each, without batch axes, in the order in which they arrive.
    """
    log = FollowedLog()
    for owner, scans in enumerate(objects):
        try:
            _follow_one(log, make, owner, scans)
        except StepFailed as failure:
            log.failures.append(failure)
    return log


def _follow_one(log: FollowedLog, make: Callable[[], Tracker], owner: int, scans: Sequence[Scan]) -> None:
    session, last, settled, latest = TrackerSession(make), None, np.inf, -np.inf
    for scan in scans:
        if latest == -np.inf and not scan.valid.any():
            continue
        if scan.time > latest + GAP:
            settled = np.inf if last is None else scan.time + SETTLE
        in_order = scan.time > latest or (scan.time == latest and last is not None)
        predicted = session.predict(scan) if last is not None and in_order and scan.valid.any() else None
        estimate = session.step(scan)
        log.scans += 1
        if estimate is not None:
            log.estimates += 1
            log.not_finite += [] if finite(estimate) else [scan]
            settled = min(settled, scan.time + SETTLE) if last is None else settled
        if predicted is not None and finite(predicted) and last is not None:
            if scan.time > latest:
                step = scan.time - latest
                log.moved.append(_moved(last, predicted, step))
                variances = [float(np.trace(estimate.covariance[2:, 2:])) / 2 for estimate in (last, predicted)]
                log.growth.append((variances[1] - variances[0]) / step)
            if scan.time >= settled:
                _add(
                    log.innovations.setdefault(scan.sensor, LogInnovations(scan.kind)), owner, scan, predicted, estimate
                )
        last, latest = estimate if estimate is not None else last, max(latest, scan.time)


def _moved(before: Estimate, after: Estimate, step: float) -> tuple[float, float, float]:
    velocity = 0.5 * (before.mean[2:] + after.mean[2:])
    speed = float(np.hypot(*velocity))
    along = float((after.mean[:2] - before.mean[:2]) @ velocity) / max(speed, 1e-12)
    return step, along, speed * step


def _add(of: LogInnovations, owner: int, scan: Scan, predicted: Estimate, estimate: Estimate | None) -> None:
    model, place = SENSOR_MODELS[scan.kind], (scan.sensor_pose, scan.sensor_velocity)
    prior = linalg.symmetrise(predicted.covariance)
    measured = model.measure(predicted.mean, *place)
    innovation = difference(scan.measurement, measured, model.angular)
    slope = model.jacobian(predicted.mean, *place)
    uncertain = np.asarray(slope @ prior @ slope.T)
    factor = linalg.cholesky(uncertain + scan.noise_covariance)
    if not factor.positive:
        return
    step = np.array([*(0.5 * SHORT * predicted.mean[2:]), 0.0, 0.0])
    ahead, behind = (model.measure(predicted.mean + side * step, *place) for side in (1.0, -1.0))
    of.owner.append(owner)
    of.time.append(scan.time)
    of.expected.append(innovation / np.sqrt(np.diag(scan.noise_covariance)))
    of.whitened.append(factor.whiten(innovation))
    of.rate.append(factor.whiten(difference(ahead, behind, model.angular) / SHORT))
    of.implied.append(_implied(slope, uncertain, estimate, scan.noise_covariance))
    of.crosses.append(bool(np.any(np.abs(scan.measurement - measured)[list(model.angular)] > np.pi)))
    of.apart.append(np.nan if estimate is None else _apart(predicted, prior, slope, innovation, estimate))


def _apart(predicted: Estimate, prior: Array, slope: Array, innovation: Array, estimate: Estimate) -> float:
    """``x+ - x-`` against ``P+ H^T R^-1 v``, the update of the information form, with the noise of the change of the
    covariance: ``H^T R^-1 H = P+^-1 - P^-1`` (Bar-Shalom, Li and Kirubarajan 2001, section 5.2.3)."""
    posterior = linalg.symmetrise(estimate.covariance)
    with np.errstate(all="ignore"):
        try:
            information = np.linalg.inv(posterior) - np.linalg.inv(prior)
            state = np.linalg.lstsq(slope, innovation, rcond=None)[0]
        except np.linalg.LinAlgError:
            return np.nan
        update = estimate.mean - predicted.mean
        return float(np.max(np.abs(update - posterior @ information @ state) / np.sqrt(np.diag(prior))))


def _implied(slope: Array, before: Array, estimate: Estimate | None, stated: Array) -> Array:
    """The variances over the stated ones, from the covariance of the predicted measurement before and after:
    ``R^-1 = (H P+ H^T)^-1 - (H P H^T)^-1`` (Bar-Shalom, Li and Kirubarajan 2001, section 5.2.3, the information form).
    """
    if estimate is None:
        return np.full(len(stated), np.nan)
    after = np.asarray(slope @ linalg.symmetrise(estimate.covariance) @ slope.T)
    with np.errstate(all="ignore"):
        try:
            noise = np.linalg.inv(np.linalg.inv(after) - np.linalg.inv(before))
        except np.linalg.LinAlgError:
            return np.full(len(stated), np.nan)
    ratio = np.diag(noise) / np.diag(stated)
    return np.where(ratio > 0.0, ratio, np.nan)


#: Scans that are given to a tracker at most: of the objects with the most measurements.
MOST = 6000
#: Faults that innovations show in every way, those first that cause the others.
CAUSES = (
    "azimuth_not_wrapped",
    "missed_scan_not_predicted",
    "wrong_dt",
    "time_offset",
    "r_too_small",
    "r_too_large",
    "sensor_bias",
)
NOT_ASKED = "it needs a truth, or scans that are tried; a log has neither"


def objects_of(file: Path) -> list[list[Scan]]:
    """The scans of each object of a log, as they arrive: from its first measurement to its last.

    Raises:
        InputError: the file is no scenario, or its detections do not say of which object they are.
    """
    loaded = loaded_scenario(file)
    if loaded.config.sensing.identities == "hidden":
        raise InputError("its detections do not say of which object they are (identities: hidden)", file=file)
    scans = sorted(sense(loaded), key=lambda scan: scan.arrival_time)
    objects = []
    for i in range(scans[0].valid.shape[0] if scans else 0):
        own = [scan._replace(measurement=scan.measurement[:, i, 0], valid=scan.valid[i, 0]) for scan in scans]
        measured = [k for k, scan in enumerate(own) if scan.valid]
        if measured:
            objects.append(own[measured[0] : measured[-1] + 1])
    return objects


class LogDoctor:
    """Examines trackers on the scans of a log.

    Args:
        objects: the scans of each object, as of ``objects_of``; those with the most measurements are used.
        no_misses: whether every scan has a detection.
        skip: checks that are not made.

    Raises:
        InputError: there is no such check.
    """

    def __init__(self, objects: Sequence[Sequence[Scan]], *, no_misses: bool = False, skip: Sequence[str] = ()) -> None:
        used: list[list[Scan]] = []
        count = 0
        for all_scans in sorted(objects, key=lambda scans: -sum(bool(scan.valid) for scan in scans)):
            scans = [scan for scan in all_scans if scan.valid or not no_misses]
            count += len(scans)
            if not used or count <= MOST:
                used.append(scans)
        self._objects = used
        self._assumptions = Assumptions(no_misses=no_misses, skip=tuple(skip))
        require_known_checks(skip, {scan.sensor for scans in used for scan in scans}, package=LOG_CHECKS)

    @one_blas_thread()
    @quiet()
    def examine(self, name: str, make: Callable[[], Tracker]) -> Examination:
        """Make the checks of a log; those of an examination with a truth are listed as not made.

        Args:
            name: what the tracker is called in the results.
            make: gives a fresh tracker.

        Raises:
            CannotRun: it gives no estimate at any scan.
        """
        log = RecordedLog(Examined(make, self._assumptions.no_misses), self._objects)
        if not log.followed.estimates:
            failures = log.followed.failures
            raise CannotRun(str(failures[0]) if failures else "it gave no estimate at any scan")
        records = checks_of(LOG_CHECKS)
        results = [self._made(check, log) for check in records]
        findings = [finding for result in results for finding in result.findings]
        checks = [
            result
            for check, part in zip(records, results, strict=True)
            for result in check.with_faults(part.checks, part.findings, findings)
        ]
        checks += [CheckResult(question, of.asks, None, NOT_ASKED) for question, of in questions().items()]
        return Examination(name, _explained(rank_findings(findings)), checks)

    def _made(self, check: DoctorCheck[[RecordedLog]], log: RecordedLog) -> PartResult:
        result = check.make(log)
        result.checks = check.with_questions(result.checks)
        return self._assumptions.applied(result, self._assumptions.left_out(check, log.sensors), check)


def _explained(ranked: Sequence[Finding]) -> list[Finding]:
    """What the innovations show of a wrong time, noise or bias is its consequence, and a bias that of the others."""
    cause = min((finding.fault for finding in ranked if finding.fault in CAUSES), key=CAUSES.index, default=None)
    roots = {cause, *CAUSES[:-1]}
    explained = [
        finding if cause is None or finding.fault in roots else replace(finding, consequence_of=cause)
        for finding in ranked
    ]
    return sorted(explained, key=lambda finding: finding.consequence_of is not None)
