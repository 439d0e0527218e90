"""The audit of a log: every sensor, the clocks, the truth, and what follows for the scenario."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trackbench.errors import InputError
from trackbench.log_audit.blocks import Interval
from trackbench.log_audit.clocks import Clock, clock_of
from trackbench.log_audit.corrections import corrected, error_changes, sigma_keys
from trackbench.log_audit.detection import Detections, detections_of
from trackbench.log_audit.drift import clock_drift
from trackbench.log_audit.findings import EFFECT, FAMILY, SHAPE, SIGMA_OFF, LogFinding, error_finding
from trackbench.log_audit.joint_fit import FEWEST_ROWS, JointFit, joint_fit, refit
from trackbench.log_audit.noise import ComponentNoise, noise_of
from trackbench.log_audit.sensor_log import SensorLog
from trackbench.log_audit.simple_findings import (
    clock_findings,
    drift_finding,
    hole_findings,
    shape_finding,
    sigma_finding,
    silence_finding,
    truth_findings,
    unit_finding,
)
from trackbench.log_audit.truth_check import VelocityCheck, velocity_check
from trackbench.log_audit.units_check import WrongUnit, wrong_units
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of
from trackbench.truth.recorded import Drive, assemble, read
from trackbench.truth.recorded.cycles import Cycles
from trackbench.truth.sources import RecordingTruth
from trackbench.types import Array, Progress, no_progress

#: A clock drifts if its offset changes by more than this during the log, s.
DRIFT_S = 0.005


@dataclass(frozen=True)
class SensorAudit:
    """What the log says of one sensor."""

    log: SensorLog
    units: tuple[WrongUnit, ...]
    detections: Detections
    fit: JointFit | None = None
    """None where there are too few measurements."""
    noise: tuple[ComponentNoise, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """``(m, m)`` of a measurement: the suggested R."""
    square_before: float | None = None
    """Mean square of the measurements' errors over the stated sigmas, as logged; 1 is right."""
    square_after: float | None = None
    """With the findings put in."""


@dataclass(frozen=True)
class LogAudit:
    """What was found in a log."""

    scenario: Scenario
    sensors: dict[str, SensorAudit]
    clocks: tuple[Clock, ...]
    velocities: tuple[VelocityCheck, ...]
    findings: tuple[LogFinding, ...]
    duration_s: float

    @property
    def name(self) -> str:
        """Of the scenario."""
        return self.scenario.config.name


def audit_log(loaded: Scenario, progress: Progress = no_progress) -> LogAudit:
    """Audit the recorded sensors of a scenario.

    Args:
        loaded: a scenario whose truth is recorded, with measurements of at least one sensor.
        progress: called with the number of sensors done and of all.

    Raises:
        InputError: the truth is not recorded, no sensor is, or a file is damaged.
    """
    truth, drive = _read(loaded)
    clipped = drive.clipped()
    looked = assemble.scan_cycles(clipped)
    clocks = [clock_of("truth", np.concatenate([m.time for m in drive.motions.values()]), drive.order)]
    found: list[LogFinding] = []
    sensors: dict[str, SensorAudit] = {}
    for number, (name, log) in enumerate(drive.logs.items()):
        progress(number, len(drive.logs))
        inside = clipped.logs[name]
        clocks.append(clock_of(name, log.scans, log.order, len(log.time) - len(inside.time)))
        config = loaded.config.sensors[name]
        sensor = SensorLog(name, config, inside, drive, truth, np.ones(len(config.components)))
        sensors[name] = _audited(sensor, looked[name])
    velocities = _velocities(truth, drive)
    found += [unit_finding(item.log, wrong) for item in sensors.values() for wrong in item.units]
    found += clock_findings(clocks)
    found += truth_findings(truth, velocities)
    found += hole_findings(drive.motions)
    level = 1 - (1 - FAMILY) / max(1, sum(_tests(item) for item in sensors.values()))
    for item in sensors.values():
        found += _sensor_findings(item, level)
    sensors = _with_squares(loaded, sensors, found)
    progress(len(sensors), len(sensors))
    duration = max(float(m.time[-1]) for m in drive.motions.values())
    return LogAudit(loaded, sensors, tuple(clocks), tuple(velocities), tuple(found), duration)


def _read(loaded: Scenario) -> tuple[RecordingTruth, Drive]:
    truth = loaded.config.truth
    if not isinstance(truth, RecordingTruth):
        message = "an audit needs a recording: truth: {source: recording, ...}"
        raise loaded.locate(InputError(message, key="truth.source"))
    kinds = {name: sensor.type for name, sensor in loaded.config.sensors.items()}
    try:
        drive = read(truth, kinds, loaded.path.resolve().parent)
        if not drive.logs:
            raise InputError(
                "no sensor's measurements are recorded, so there is nothing to audit", key="truth.readings"
            )
        assemble.require_measurements(drive, drive.clipped())
    except InputError as error:
        raise loaded.locate(error) from None
    return truth, drive


def _audited(log: SensorLog, looked: Cycles) -> SensorAudit:
    units = tuple(wrong_units(log))
    for wrong in units:
        log = log.with_factor(log.components.index(wrong.component), wrong.factor)
    if len(log.log.time) < FEWEST_ROWS:
        return SensorAudit(log, units, detections_of(log, looked, {}))
    fit = joint_fit(log)
    if fit.inlier.sum() < FEWEST_ROWS:
        return SensorAudit(log, units, detections_of(log, looked, {}))
    noise, covariance = noise_of(log, fit)
    return SensorAudit(log, units, detections_of(log, looked, fit.errors), fit, tuple(noise), covariance)


def _velocities(truth: RecordingTruth, drive: Drive) -> list[VelocityCheck]:
    columns = truth.columns
    key = "vx" if columns is not None and columns.vx is not None else "speed"
    unit = (columns.units.get(key) if columns is not None else None) or truth.units.speed
    bodies = [*drive.motions.items(), *([("observer", drive.observer)] if drive.observer is not None else [])]
    checks = (velocity_check(name, motion, unit) for name, motion in bodies)
    return [check for check in checks if check is not None]


def _tests(item: SensorAudit) -> int:
    """How many errors, noises and shapes of a sensor are judged."""
    shapes = sum(noise.exponent is not None for noise in item.noise)
    return 0 if item.fit is None else 1 + len(item.fit.estimates) + len(sigma_keys(item.log)) + shapes


def _sensor_findings(item: SensorAudit, level: float) -> Iterator[LogFinding]:
    if item.detections.silent_from_s is not None:
        yield silence_finding(item.log.name, item.detections)
    if item.fit is None:
        return
    drift = clock_drift(item.log, item.fit)
    if drift is not None and drift.excludes(0.0, level) and abs(drift.value) > DRIFT_S:
        yield drift_finding(item.log, drift)
    wrong = [
        name
        for name, estimate in item.fit.estimates.items()
        if estimate.effect >= EFFECT and estimate.interval.excludes(0.0, level)
    ]
    changes = error_changes(item.log, refit(item.log, wrong, item.fit.errors))
    for name in wrong:
        yield error_finding(item.log.name, item.fit.estimates[name], changes[name])
    for key, components in sigma_keys(item.log).items():
        noises = [item.noise[i] for i in components]
        ratio = _ratio(noises)
        if ratio.excludes(0.0, level) and abs(ratio.value) > np.log(SIGMA_OFF):
            yield sigma_finding(item.log, key, noises, ratio)
    for noise in item.noise:
        shape = noise.exponent
        if shape is not None and shape.excludes(0.0, level) and noise.spread ** abs(shape.value) > SHAPE:
            yield shape_finding(item.log.name, noise, shape)


def _ratio(noises: list[ComponentNoise]) -> Interval:
    """Logarithm of the standard deviation found over the stated one, the mean of several components."""
    logs = [np.log(max(noise.sigma.value, 1e-300) / noise.stated) for noise in noises]
    relative = [noise.sigma.sigma / max(noise.sigma.value, 1e-300) for noise in noises]
    freedom = min(noise.sigma.freedom for noise in noises)
    return Interval(float(np.mean(logs)), float(np.hypot.reduce(relative)) / len(noises), freedom)


def _with_squares(
    loaded: Scenario, sensors: dict[str, SensorAudit], findings: list[LogFinding]
) -> dict[str, SensorAudit]:
    """The sensors with the mean square of their errors, before and after the findings are put in."""
    before = _squares(loaded)
    after = before
    if any(finding.changes for finding in findings):
        after = _squares(scenario_of(corrected(loaded, findings), loaded.path))
    return {
        name: replace(item, square_before=before.get(name), square_after=after.get(name))
        for name, item in sensors.items()
    }


def _squares(loaded: Scenario) -> dict[str, float]:
    truth, drive = _read(loaded)
    found = {}
    for name, log in drive.clipped().logs.items():
        config = loaded.config.sensors[name]
        residual = SensorLog(name, config, log, drive, truth, np.ones(len(config.components))).residual({})
        square = (residual / np.array(config.sigmas())[:, None]) ** 2
        square = square[:, np.isfinite(square).all(axis=0)]
        if square.size:
            found[name] = float(square.mean())
    return found


def finding_changes(audit: LogAudit) -> dict[str, Any]:
    """All keys of the scenario that the findings change, with their new values."""
    return {key: value for finding in audit.findings for key, value in finding.changes.items()}
