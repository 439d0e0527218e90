"""The audit of one sensor of a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.log_audit.blocks import BlockInterval
from trackbench.subjects.log_audit.corrections import error_changes, sigma_keys
from trackbench.subjects.log_audit.direct_checks import WrongUnit, wrong_units
from trackbench.subjects.log_audit.findings import EFFECT, SHAPE, SIGMA_OFF, LogFinding, error_finding
from trackbench.subjects.log_audit.joint_fit import FEWEST_ROWS, JointFit, joint_fit, refit
from trackbench.subjects.log_audit.noise import Detections, ResidualNoise, clock_drift, detections_of, noise_of
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.subjects.log_audit.simple_findings import (
    drift_finding,
    outlier_finding,
    shape_finding,
    sigma_finding,
    silence_finding,
    unit_finding,
)
from trackbench.truth.recorded.drive import Cycles

#: A clock drifts if its offset changes by more than this during the log, s.
DRIFT_S = 0.005
#: More outliers than this share are no tail of the noise.
OUTLIERS = 0.005


@dataclass(frozen=True)
class SensorAudit:
    """What the log says of one sensor."""

    log: SensorLog
    units: tuple[WrongUnit, ...]
    detections: Detections
    fit: JointFit | None = None
    """None where there are too few measurements."""
    noise: tuple[ResidualNoise, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """``(m, m)`` of a measurement: the suggested R."""
    square_before: float | None = None
    """Mean square of the measurements' errors over the stated sigmas, as logged; 1 is right."""
    square_after: float | None = None
    """With the findings put in."""

    @property
    def tests(self) -> int:
        """How many errors, noises and shapes are judged, and the drift."""
        shapes = sum(noise.exponent is not None for noise in self.noise)
        return 0 if self.fit is None else 1 + len(self.fit.estimates) + len(sigma_keys(self.log)) + shapes


def audit_sensor(log: SensorLog, looked: Cycles) -> SensorAudit:
    """Audit one sensor.

    Args:
        log: its measurements within the time of the truth.
        looked: when it looked.
    """
    if len(log.log.time) < FEWEST_ROWS:
        return SensorAudit(log, (), detections_of(log, looked, {}))
    units = tuple(wrong_units(log))
    for wrong in units:
        log = log.with_factor(log.components.index(wrong.component), wrong.factor)
    fit = joint_fit(log)
    if fit.inlier.sum() < FEWEST_ROWS:
        return SensorAudit(log, units, detections_of(log, looked, {}))
    noise, covariance = noise_of(log, fit)
    return SensorAudit(log, units, detections_of(log, looked, fit.errors), fit, tuple(noise), covariance)


def sensor_findings(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    """What is wrong with a sensor.

    Args:
        item: its audit.
        level: probability with which an interval holds the truth, so that all of the log's do so together.
    """
    for wrong in item.units:
        yield unit_finding(item.log, wrong)
    if item.detections.silent_from_s is not None:
        yield silence_finding(item.log.name, item.detections)
    if item.fit is None:
        return
    outliers = int(item.fit.outlier.sum())
    if outliers > OUTLIERS * len(item.fit.inlier):
        yield outlier_finding(item.log.name, outliers, len(item.fit.inlier))
    drift = clock_drift(item.log, item.fit)
    drifts = drift is not None and drift.excludes(0.0, level) and abs(drift.value) > DRIFT_S
    if drift is not None and drifts:
        yield drift_finding(item.log, drift)
    yield from _errors(item, item.fit, level)
    if not drifts:
        yield from _noises(item, level)


def _errors(item: SensorAudit, fit: JointFit, level: float) -> Iterator[LogFinding]:
    wrong = [
        name
        for name, estimate in fit.estimates.items()
        if estimate.effect >= EFFECT and estimate.interval.excludes(0.0, level)
    ]
    changes = error_changes(item.log, refit(item.log, wrong, fit.errors))
    for name in wrong:
        yield error_finding(item.log.name, fit.estimates[name], changes[name])


def _noises(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    for key, components in sigma_keys(item.log).items():
        noises = [item.noise[i] for i in components]
        ratio = _ratio(noises)
        if ratio.excludes(0.0, level) and abs(ratio.value) > np.log(SIGMA_OFF):
            yield sigma_finding(item.log, key, noises, ratio)
    for noise in item.noise:
        shape = noise.exponent
        if shape is not None and shape.excludes(0.0, level) and noise.spread ** abs(shape.value) > SHAPE:
            yield shape_finding(item.log.name, noise, shape)


def _ratio(noises: list[ResidualNoise]) -> BlockInterval:
    """Logarithm of the standard deviation found over the stated one, the mean of several components."""
    logs = [np.log(max(noise.sigma.value, 1e-300) / noise.stated) for noise in noises]
    relative = [noise.sigma.sigma / max(noise.sigma.value, 1e-300) for noise in noises]
    freedom = min(noise.sigma.freedom for noise in noises)
    return BlockInterval(float(np.mean(logs)), float(np.hypot.reduce(relative)) / len(noises), freedom)
